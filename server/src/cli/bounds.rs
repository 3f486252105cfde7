//! Bounds on what a command may take on this machine. A server has its own.

use super::Failure;
use super::interrupt;
use crate::job::machine;
use crate::problem::Problem;
use crate::trouble;
use cairn_core::asset::Limits;
use std::ffi::OsString;
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

#[derive(clap::Args)]
#[command(next_help_heading = "Bounds")]
pub struct Bounds {
    /// Triangles of one input file, every instance counted
    #[arg(long, value_name = "COUNT", env = "CAIRN_MAX_TRIANGLES", default_value_t = Limits::default().triangles)]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    max_triangles: u64,

    /// Memory that the command may take, address space included, where the system can bound it [default: all]
    #[arg(long, value_name = "MIB", env = "CAIRN_MAX_MEMORY_MIB", value_parser = clap::value_parser!(u64).range(512..=1 << 30))]
    max_memory_mib: Option<u64>,
}

/// Tells the process with the bound that it is the one.
const MARK: &str = "CAIRN_IS_BOUNDED";
/// Between two looks at whether it has ended.
const LOOK: Duration = Duration::from_millis(20);

impl Bounds {
    /// The same arguments, for another process.
    pub fn again(&self) -> Vec<OsString> {
        let memory = self.max_memory_mib.map(|mib| format!("--max-memory-mib={mib}"));
        [Some(format!("--max-triangles={}", self.max_triangles)), memory]
            .into_iter()
            .flatten()
            .map(OsString::from)
            .collect()
    }

    /// Of each file that is read.
    pub fn limits(&self) -> Limits {
        Limits { triangles: self.max_triangles, ..Limits::default() }
    }

    /// Does the work within the bounds. What has reached the bound of its memory cannot tell so any more: a process of its own does
    /// the work, and this one tells.
    pub fn hold(&self, work: impl FnOnce() -> Result<(), Failure>) -> Result<(), Failure> {
        let Some(mib) = self.max_memory_mib else { return work() };
        let unbounded = |error: std::io::Error| {
            let what = format!("memory cannot be bounded at {mib} MiB: {error}");
            Failure::Usage(vec![Problem::new("--max-memory-mib", what, "Leave it out, or give another number.")])
        };
        if std::env::var_os(MARK).is_some() {
            interrupt::when_input_ends();
            machine::limit_memory(mib << 20).map_err(unbounded)?;
            return work();
        }
        interrupt::listen();
        let status = again().map_err(|error| {
            let remedy = "See that this machine has memory and processes left, and run the command again.";
            Failure::TryAgain(Problem::new("--max-memory-mib", format!("no process could be started: {error}"), remedy))
        })?;
        match status.code() {
            Some(0) => Ok(()),
            // It was asked by this process, and does not know by whom that was.
            Some(_) if interrupt::asked() => Err(Failure::Told(interrupt::code())),
            Some(code) => Err(Failure::Told(u8::try_from(code).unwrap_or(1))),
            None if has_aborted(status) => Err(Failure::Input(vec![Problem::new(
                "the scene",
                format!("it takes more memory than the limit of {mib} MiB"),
                "Use simpler meshes, or fewer and larger props; or raise --max-memory-mib.",
            )])),
            None => Err(Failure::TryAgain(Problem::new(
                "the command",
                format!("it was ended from outside ({status})"),
                "See that nobody ends it and that this machine has memory left, and run the command again.",
            ))),
        }
    }
}

/// Runs this very command again, within the bound. It ends when this process does, or asks it to by closing its standard input.
fn again() -> std::io::Result<ExitStatus> {
    trouble::at("bounded-spawn")?;
    let mut command = Command::new(std::env::current_exe()?);
    let mut child = command
        .args(std::env::args_os().skip(1))
        .env(MARK, "1")
        .env("RUST_BACKTRACE", "0")
        .stdin(Stdio::piped())
        .spawn()?;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if interrupt::asked() {
            drop(child.stdin.take());
        }
        std::thread::sleep(LOOK);
    }
}

/// Whether a process ended itself, as it does where it gets no more memory.
#[cfg(unix)]
fn has_aborted(status: ExitStatus) -> bool {
    use std::os::unix::process::ExitStatusExt;
    const SIGABRT: i32 = 6;
    status.signal() == Some(SIGABRT)
}

#[cfg(not(unix))]
fn has_aborted(_: ExitStatus) -> bool {
    false
}
