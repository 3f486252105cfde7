//! Named places where tests inject faults: a full or broken disk, a killed process, a closed stream.
//!
//! The environment variable `FAILPOINTS` sets what happens at each place, in the syntax of the crate `fail`:
//! `files-sync=1*return(EIO)` fails once. Release programs are built without the feature `failpoints`; they have no
//! such places and do not read the variable.

use std::io::{Result, Write};

/// Reads the variable. The program calls this once, before any sandbox.
pub fn set_up() {
    #[cfg(feature = "failpoints")]
    {
        std::mem::forget(fail::FailScenario::setup());
        if std::env::var("FAILPOINTS").is_ok_and(|faults| faults.contains("KILL")) {
            let (sender, asked) = std::sync::mpsc::sync_channel(1);
            let _ = KILLER.set(sender);
            std::thread::spawn(move || {
                let own = std::process::id().to_string();
                asked.recv().is_ok().then(|| std::process::Command::new("kill").args(["-KILL", &own]).status())
            });
        }
    }
}

/// A thread outside of any sandbox, which ends this process where it is asked to.
#[cfg(feature = "failpoints")]
static KILLER: std::sync::OnceLock<std::sync::mpsc::SyncSender<()>> = std::sync::OnceLock::new();

/// Fails if a fault is set for this place.
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

/// Writes all bytes. As with a disk, a fault comes after half of them.
pub fn write(place: &str, to: &mut impl Write, bytes: &[u8]) -> Result<()> {
    at(place).inspect_err(|_| {
        let _ = to.write_all(&bytes[..bytes.len() / 2]).and_then(|()| to.flush());
    })?;
    to.write_all(bytes)
}

/// The system's error of this name. `KILL` ends this process as the system does when memory runs out.
#[cfg(feature = "failpoints")]
fn error(name: &str) -> std::io::Error {
    std::io::Error::from_raw_os_error(match name {
        "ENOENT" => 2,
        "EIO" => 5,
        "EAGAIN" => 11,
        "ENOMEM" => 12,
        "EACCES" => 13,
        "EMFILE" => 24,
        "ENOSPC" => 28,
        "EROFS" => 30,
        "EPIPE" => 32,
        "ENAMETOOLONG" => 36,
        "KILL" => {
            KILLER.get().map(|killer| killer.send(()));
            std::thread::sleep(std::time::Duration::from_secs(60));
            unreachable!("this process was killed")
        }
        _ => panic!("no fault has the name {name:?}"),
    })
}
