//! Turns a panic, which is always a fault in Cairn, into a failure with a message.

use super::Failure;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook};
use std::sync::{Mutex, PoisonError};

/// Message and location of the last panic. Nothing is printed at once, because the core survives some panics of its
/// libraries.
static LAST: Mutex<Option<String>> = Mutex::new(None);

/// Runs a command; a panic in it becomes [`Failure::Internal`].
pub fn catch(command: impl FnOnce() -> Result<(), Failure>) -> Result<(), Failure> {
    set_hook(Box::new(|info| {
        let payload = info.payload_as_str().unwrap_or("no message");
        let location =
            info.location().map(|place| format!(" at {}:{}", within(place.file()), place.line())).unwrap_or_default();
        *LAST.lock().unwrap_or_else(PoisonError::into_inner) = Some(format!("{payload}{location}"));
    }));
    catch_unwind(AssertUnwindSafe(command)).unwrap_or_else(|_| {
        let last = LAST.lock().unwrap_or_else(PoisonError::into_inner).take();
        Err(Failure::Internal(last.unwrap_or_default()))
    })
}

/// A source file relative to its package, without the path on the building machine.
fn within(file: &str) -> &str {
    let Some((before, _)) = file.rsplit_once("/src/").filter(|(before, _)| before.starts_with('/')) else {
        return file;
    };
    let package = before.rfind('/').map_or(0, |slash| slash + 1);
    &file[package..]
}

#[cfg(test)]
mod tests {
    use super::{Failure, catch, within};

    #[test]
    fn a_panic_is_an_internal_failure_with_its_location() {
        let Err(Failure::Internal(what)) = catch(|| panic!("no such {}", "thing")) else { panic!("it is our fault") };
        assert!(what.starts_with("no such thing at server/src/cli/panic.rs:"), "{what}");
    }

    #[test]
    fn paths_of_the_building_machine_are_removed() {
        assert_eq!(
            within("/home/ann/.cargo/registry/src/index-1/rapier3d-0.36.1/src/geometry/a.rs"),
            "rapier3d-0.36.1/src/geometry/a.rs"
        );
        assert_eq!(within("server/core/src/lib.rs"), "server/core/src/lib.rs");
    }
}
