//! Limits on a command's use of this machine. A server has its own.

use super::Failure;
use super::interrupt;
use cairn_files::failpoints;
use cairn_files::problem::Problem;
use cairn_input::asset::Limits;
use cairn_job::machine;
use std::ffi::OsString;
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

#[derive(clap::Args)]
#[command(next_help_heading = "Bounds")]
pub struct Bounds {
    /// Largest number of triangles in one input file, instances included
    #[arg(long, value_name = "COUNT", env = "CAIRN_MAX_TRIANGLES", default_value_t = Limits::default().triangles)]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    max_triangles: u64,

    /// Limit of the command's memory (address space), if the system supports limits [default: none]
    #[arg(long, value_name = "MIB", env = "CAIRN_MAX_MEMORY_MIB")]
    #[arg(value_parser = clap::value_parser!(u64).range(512..=1 << 30))]
    max_memory_mib: Option<u64>,
}

/// Set in the environment of the process with the limit.
const MARK: &str = "CAIRN_IS_BOUNDED";
/// Interval of checks whether it has ended.
const CHECK: Duration = Duration::from_millis(20);

impl Bounds {
    /// The arguments for another process.
    pub fn to_args(&self) -> Vec<OsString> {
        let memory = self.max_memory_mib.map(|mib| format!("--max-memory-mib={mib}"));
        [Some(format!("--max-triangles={}", self.max_triangles)), memory]
            .into_iter()
            .flatten()
            .map(OsString::from)
            .collect()
    }

    /// Limits of each input file.
    pub fn limits(&self) -> Limits {
        Limits { triangles: self.max_triangles, ..Limits::default() }
    }

    /// Does the work within the limits. A process that has reached its memory limit cannot report that any more, so a
    /// child process does the work, and this one reports.
    pub fn enforce(&self, work: impl FnOnce() -> Result<(), Failure>) -> Result<(), Failure> {
        let Some(mib) = self.max_memory_mib else { return work() };
        let unbounded = |error: std::io::Error| {
            let what = format!("memory cannot be limited to {mib} MiB: {error}");
            Failure::usage("--max-memory-mib", what, "Omit it, or give another number.")
        };
        if std::env::var_os(MARK).is_some() {
            interrupt::end_with_input();
            machine::limit_memory(mib << 20).map_err(unbounded)?;
            return work();
        }
        interrupt::listen();
        let status = run_limited().map_err(|error| {
            let remedy = "Make sure that this machine has free memory and processes, and run the command again.";
            Failure::TryAgain(Problem::new("--max-memory-mib", format!("no process could be started: {error}"), remedy))
        })?;
        match status.code() {
            Some(0) => Ok(()),
            // The child ended at this process's request, and does not know the reason.
            Some(_) if interrupt::is_requested() => Err(Failure::Reported(interrupt::code())),
            Some(code) => Err(Failure::Reported(u8::try_from(code).unwrap_or(1))),
            None if has_aborted(status) => Err(Failure::input(Problem::new(
                "the scene",
                format!("it needs more memory than the limit of {mib} MiB"),
                "Use simpler meshes, or fewer and larger props; or raise --max-memory-mib.",
            ))),
            None => Err(Failure::TryAgain(Problem::new(
                "the command",
                format!("it was stopped from outside ({status})"),
                "Make sure that nobody stops it and that this machine has free memory, and run the command again.",
            ))),
        }
    }
}

/// Runs this command in a child process within the limit. The child ends with this process, or when this process closes
/// its standard input.
fn run_limited() -> std::io::Result<ExitStatus> {
    failpoints::at("bounded-spawn")?;
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
        if interrupt::is_requested() {
            drop(child.stdin.take());
        }
        std::thread::sleep(CHECK);
    }
}

/// Starts as many threads; 0: one per processor.
pub fn use_threads(count: usize) -> Result<(), Failure> {
    let started = failpoints::at("threads-start").map_err(|error| error.to_string());
    started.and_then(|()| machine::use_threads(count).map_err(|error| error.to_string())).map_err(|why| {
        let remedy = "Let this process use more memory and start more processes, or take fewer threads.";
        Failure::TryAgain(Problem::new("this machine", format!("no thread could be started: {why}"), remedy))
    })
}

/// Whether a process has aborted, as it does when it gets no more memory.
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
