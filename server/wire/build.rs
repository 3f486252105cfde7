//! Generates the messages of `proto/cairn/v1` without protoc, and the conversions of the parameters; embeds the
//! descriptors with their comments.

use std::path::{Path, PathBuf};

/// Crates whose version decides a bake's result, as its report states.
const ENGINES: [&str; 2] = ["rapier3d", "clarabel"];
const LOCK: &str = "../../Cargo.lock";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    println!("cargo:rerun-if-changed=../../proto/cairn");
    let compiler = cairn_codegen::compile("../../proto")?;
    std::fs::write(out.join("descriptors.bin"), compiler.encode_file_descriptor_set())?;
    std::fs::write(out.join("parameters.rs"), cairn_codegen::Schema::new(&compiler).wire())?;
    tonic_prost_build::configure()
        .build_client(false)
        .build_server(false)
        .out_dir(&out)
        // Chunks of files are passed on without copies, and maps have one order.
        .bytes(".cairn.v1")
        .btree_map(".cairn.v1")
        // Sent once; other events are small without it.
        .boxed(".cairn.v1.BakeEvent.kind.accepted")
        .boxed(".cairn.v1.CreatedBake.outcome.bake")
        .compile_fds(compiler.file_descriptor_set())?;

    println!("cargo:rerun-if-changed={LOCK}");
    for name in ENGINES {
        let version = locked_version(Path::new(LOCK), name)?;
        println!("cargo:rustc-env=CAIRN_{}={version}", name.to_uppercase());
    }
    Ok(())
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
