//! Which build this is.

fn main() -> Result<(), std::env::VarError> {
    // Given by the release command; a commit found by itself would build everything again at each commit.
    println!("cargo:rerun-if-env-changed=CAIRN_COMMIT");
    println!("cargo:rerun-if-changed=build.rs");
    let version = std::env::var("CARGO_PKG_VERSION")?;
    match std::env::var("CAIRN_COMMIT") {
        Ok(commit) if !commit.is_empty() => println!("cargo:rustc-env=CAIRN_BUILD={version} ({commit})"),
        _ => println!("cargo:rustc-env=CAIRN_BUILD={version}"),
    }
    Ok(())
}
