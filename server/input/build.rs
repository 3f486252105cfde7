//! Generates the parameters' types, defaults and ranges from the comments of `proto/cairn/v1`.

use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=../../proto/cairn");
    let schema = cairn_codegen::Schema::new(&cairn_codegen::compile("../../proto")?);
    std::fs::write(Path::new(&std::env::var("OUT_DIR")?).join("params.rs"), schema.core())?;
    Ok(())
}
