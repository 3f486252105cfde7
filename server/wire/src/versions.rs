//! The versions that server and caller exchange.

use super::proto;
use cairn_files::version::VERSION;

/// The protocol that is spoken here: it grows with every field and call added to `cairn.v1`.
pub const PROTOCOL: i32 = 1;

/// The versions that decide a result.
pub fn versions() -> proto::Versions {
    proto::Versions {
        cairn: VERSION.into(),
        rapier3d: env!("CAIRN_RAPIER3D").into(),
        clarabel: env!("CAIRN_CLARABEL").into(),
    }
}
