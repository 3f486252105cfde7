//! Generates the service of `proto/cairn/v1`; its messages are those of `cairn-wire`.

use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    println!("cargo:rerun-if-changed=../../proto/cairn");
    let compiler = cairn_codegen::compile("../../proto")?;
    tonic_prost_build::configure()
        .out_dir(&out)
        .extern_path(".cairn.v1", "::cairn_wire::proto")
        .compile_fds(compiler.file_descriptor_set())?;
    check_requests(&out.join("cairn.v1.rs"))
}

/// Lets the service see the fields of requests that this version does not know. The generator has no setting for it.
fn check_requests(generated: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string(generated)?;
    let checked = text.replace("tonic_prost::ProstCodec::default()", "crate::codec::CheckedCodec::default()");
    if checked == text {
        return Err("the generated code has another codec".into());
    }
    Ok(std::fs::write(generated, checked)?)
}
