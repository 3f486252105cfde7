//! Embeds the viewer of contact sheets, compressed.

use flate2::Compression;
use flate2::write::DeflateEncoder;
use std::io::Write;
use std::path::PathBuf;

/// Shows a result in a browser.
const VIEWER: &str = "server/src/sheet/viewer.min.js";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed={VIEWER}");
    let mut viewer = DeflateEncoder::new(Vec::new(), Compression::best());
    viewer.write_all(&std::fs::read(VIEWER)?)?;
    Ok(std::fs::write(PathBuf::from(std::env::var("OUT_DIR")?).join("viewer.deflate"), viewer.finish()?)?)
}
