//! Cairn's version.

/// The version in reports. It decides a result.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The version that `--version` prints. A released program adds the commit that it was built from.
pub const BUILD: &str = env!("CAIRN_BUILD");
