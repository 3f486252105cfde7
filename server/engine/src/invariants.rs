//! Switch: whether the invariants of world, policy, glue and fill are checked: in debug builds always, in others once
//! [`check_always`] was called, as tests do. A check changes no result; one that fails panics, since it is a fault in
//! Cairn.

use std::sync::atomic::{AtomicBool, Ordering};

static ALWAYS: AtomicBool = AtomicBool::new(false);

/// From now on, every build checks.
pub fn check_always() {
    ALWAYS.store(true, Ordering::Relaxed);
}

pub fn are_checked() -> bool {
    cfg!(debug_assertions) || ALWAYS.load(Ordering::Relaxed)
}
