//! Which Cairn this is.

/// The version as reports tell it: what decides a result.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The version as `--version` tells it: a released program also knows the commit that it was built from.
pub const BUILD: &str = env!("CAIRN_BUILD");
