//! Generates the Rust types and the service of `proto/cairn/v1` without protoc, and the conversions of the parameters;
//! embeds the descriptors with their comments, and the viewer of contact sheets, compressed.

use flate2::Compression;
use flate2::write::DeflateEncoder;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Shows a result in a browser.
const VIEWER: &str = "server/src/sheet/viewer.min.js";
/// Crates whose version decides a bake's result, as its report states.
const ENGINES: [&str; 2] = ["rapier3d", "clarabel"];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    println!("cargo:rerun-if-changed=proto/cairn");
    let compiler = cairn_codegen::compile("proto")?;
    std::fs::write(out.join("descriptors.bin"), compiler.encode_file_descriptor_set())?;
    std::fs::write(out.join("parameters.rs"), cairn_codegen::Schema::new(&compiler).wire())?;
    tonic_prost_build::configure()
        .out_dir(&out)
        // Chunks of files are passed on without copies, and maps have one order.
        .bytes(".cairn.v1")
        .btree_map(".cairn.v1")
        // Sent once; other events are small without it.
        .boxed(".cairn.v1.BakeEvent.kind.accepted")
        .boxed(".cairn.v1.CreatedBake.outcome.bake")
        .compile_fds(compiler.file_descriptor_set())?;
    check_requests(&out.join("cairn.v1.rs"))?;

    println!("cargo:rerun-if-changed={VIEWER}");
    let mut viewer = DeflateEncoder::new(Vec::new(), Compression::best());
    viewer.write_all(&std::fs::read(VIEWER)?)?;
    std::fs::write(out.join("viewer.deflate"), viewer.finish()?)?;

    // Given by the release command; a commit found by itself would build everything again at each commit.
    println!("cargo:rerun-if-env-changed=CAIRN_COMMIT");
    let version = std::env::var("CARGO_PKG_VERSION")?;
    match std::env::var("CAIRN_COMMIT") {
        Ok(commit) if !commit.is_empty() => println!("cargo:rustc-env=CAIRN_BUILD={version} ({commit})"),
        _ => println!("cargo:rustc-env=CAIRN_BUILD={version}"),
    }

    println!("cargo:rerun-if-changed=Cargo.lock");
    for name in ENGINES {
        let version = locked_version(Path::new("Cargo.lock"), name)?;
        println!("cargo:rustc-env=CAIRN_{}={version}", name.to_uppercase());
    }
    Ok(())
}

/// Lets the service see the fields of requests that this version does not know. The generator has no setting for it.
fn check_requests(generated: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string(generated)?;
    let checked = text.replace("tonic_prost::ProstCodec::default()", "crate::service::codec::CheckedCodec::default()");
    if checked == text {
        return Err("the generated code has another codec".into());
    }
    Ok(std::fs::write(generated, checked)?)
}

/// The version of a crate in the lock file.
fn locked_version(lock: &Path, name: &str) -> Result<String, Box<dyn std::error::Error>> {
    let lock: toml::Table = std::fs::read_to_string(lock)?.parse()?;
    lock["package"]
        .as_array()
        .into_iter()
        .flatten()
        .find(|package| package["name"].as_str() == Some(name))
        .and_then(|package| package["version"].as_str().map(str::to_owned))
        .ok_or_else(|| format!("{name} is not in Cargo.lock").into())
}
