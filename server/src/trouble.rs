//! Places where tests let faults happen: a disk that is full or broken, a process that is killed, a stream that is closed.
//!
//! Each place has a name. The environment variable `FAILPOINTS` says what happens there, in the words of the crate `fail`:
//! `files-sync=1*return(EIO)` fails once. A program that is built without the feature `failpoints`, as releases are, has no
//! such places and does not read the variable.

use std::io::{Result, Write};

/// Reads what is to happen. Called once, by the program.
pub fn set_up() {
    #[cfg(feature = "failpoints")]
    std::mem::forget(fail::FailScenario::setup());
}

/// The fault that is to happen here.
#[cfg(feature = "failpoints")]
pub fn at(place: &str) -> Result<()> {
    fail::fail_point!(place, |what| Err(error(&what.unwrap_or_default())));
    Ok(())
}

#[cfg(not(feature = "failpoints"))]
#[inline(always)]
pub fn at(_: &str) -> Result<()> {
    Ok(())
}

/// Writes all bytes. A fault here comes after half of them, as that of a disk does.
pub fn write(place: &str, to: &mut impl Write, bytes: &[u8]) -> Result<()> {
    at(place).inspect_err(|_| {
        let _ = to.write_all(&bytes[..bytes.len() / 2]).and_then(|()| to.flush());
    })?;
    to.write_all(bytes)
}

/// By the names that the system has for errors. `KILL` ends this process as the system does when memory runs out.
#[cfg(feature = "failpoints")]
fn error(name: &str) -> std::io::Error {
    std::io::Error::from_raw_os_error(match name {
        "EIO" => 5,
        "ENOMEM" => 12,
        "EMFILE" => 24,
        "ENOSPC" => 28,
        "EPIPE" => 32,
        "KILL" => {
            let own = std::process::id().to_string();
            let _ = std::process::Command::new("kill").args(["-KILL", &own]).status();
            unreachable!("this process was killed")
        }
        _ => panic!("no fault has the name {name:?}"),
    })
}
