//! Runs bakes at the same time, each as a `cairn bake` process of its own: a failure, a crash or a lack of memory
//! affects only that bake.

use crate::cli::interrupt;
use cairn_files::failpoints;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// A bake to run.
pub struct PoolTask {
    /// Arguments of `cairn bake`.
    pub args: Vec<OsString>,
    /// Equal for tasks that share a fill: the first simulates it, and the others reuse it.
    pub fill: Option<blake3::Hash>,
}

/// The end of a bake.
#[derive(Debug)]
pub enum BakeEnd {
    Done,
    Cancelled,
    /// The exit code, if any, and the error messages.
    Failed(Option<u8>, String),
}

/// An event of a running batch.
pub enum PoolEvent {
    /// The finished fraction of a task's stages.
    Progress(usize, f64),
    Ended(usize, BakeEnd),
}

/// Interval of checks whether a bake has to end.
const CHECK: Duration = Duration::from_millis(50);

/// Runs all tasks, `workers` of them at the same time, in their order as far as shared fills permit. `report` is called
/// for one event at a time.
pub fn work(tasks: &[PoolTask], workers: usize, report: impl FnMut(PoolEvent) + Send) {
    let pool = ProcessPool {
        tasks,
        backlog: Mutex::new(Backlog::new(tasks.len())),
        changed: Condvar::new(),
        report: Mutex::new(report),
    };
    thread::scope(|scope| {
        for _ in 0..workers.min(tasks.len()) {
            scope.spawn(|| pool.work());
        }
    });
}

/// The tasks that were not started.
struct Backlog {
    waiting: BTreeSet<usize>,
    /// Fills being simulated.
    filling: Vec<blake3::Hash>,
    /// Finished fills.
    filled: BTreeSet<[u8; 32]>,
}

impl Backlog {
    fn new(tasks: usize) -> Backlog {
        Backlog { waiting: (0..tasks).collect(), filling: Vec::new(), filled: BTreeSet::new() }
    }

    /// Takes the first task whose fill no other task is simulating.
    fn next(&mut self, tasks: &[PoolTask]) -> Option<usize> {
        let may = |task: &&usize| tasks[**task].fill.is_none_or(|fill| !self.filling.contains(&fill));
        let task = self.waiting.iter().find(may).copied()?;
        self.waiting.remove(&task);
        if let Some(fill) = tasks[task].fill
            && !self.filled.contains(fill.as_bytes())
        {
            self.filling.push(fill);
        }
        Some(task)
    }

    fn finish_fill(&mut self, fill: blake3::Hash) {
        self.filling.retain(|other| *other != fill);
        self.filled.insert(*fill.as_bytes());
    }
}

struct ProcessPool<'a, Report> {
    tasks: &'a [PoolTask],
    backlog: Mutex<Backlog>,
    changed: Condvar,
    report: Mutex<Report>,
}

/// A line about an error.
#[derive(Deserialize)]
struct Error {
    error: String,
}

/// A line of `--progress json`.
#[derive(Deserialize)]
struct Line {
    stage: String,
    fraction: f64,
}

/// The stages in their order.
const STAGES: [&str; 6] = ["shape", "fill", "glue", "release", "hold", "measure"];

impl<Report: FnMut(PoolEvent) + Send> ProcessPool<'_, Report> {
    fn work(&self) {
        while let Some(number) = self.next() {
            let end = self
                .bake(number)
                .unwrap_or_else(|error| BakeEnd::Failed(None, format!("its process could not be started: {error}")));
            // After a failed fill, the next task has to simulate it.
            self.fill_is_done(number);
            self.report(PoolEvent::Ended(number, end));
        }
    }

    fn next(&self) -> Option<usize> {
        let mut backlog = lock(&self.backlog);
        loop {
            if interrupt::is_requested() || backlog.waiting.is_empty() {
                return None;
            }
            if let Some(task) = backlog.next(self.tasks) {
                return Some(task);
            }
            backlog = self.changed.wait_timeout(backlog, CHECK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn fill_is_done(&self, number: usize) {
        if let Some(fill) = self.tasks[number].fill {
            lock(&self.backlog).finish_fill(fill);
            self.changed.notify_all();
        }
    }

    fn report(&self, event: PoolEvent) {
        (lock(&self.report))(event);
    }

    fn bake(&self, number: usize) -> std::io::Result<BakeEnd> {
        failpoints::at("batch-spawn")?;
        let mut child = Command::new(std::env::current_exe()?)
            .arg("bake")
            .args(&self.tasks[number].args)
            .args(["--progress", "json"])
            .env(interrupt::ENDS_WITH_INPUT, "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let stderr = child.stderr.take().expect("it is piped");
        thread::scope(|scope| {
            let listener = scope.spawn(|| self.listen(number, BufReader::new(stderr)));
            let status = wait(&mut child)?;
            let errors = listener.join().unwrap_or_default();
            Ok(match status.code() {
                Some(0) => BakeEnd::Done,
                _ if interrupt::is_requested() => BakeEnd::Cancelled,
                Some(code) => BakeEnd::Failed(u8::try_from(code).ok(), errors),
                None => BakeEnd::Failed(None, format!("it was stopped from outside ({status})")),
            })
        })
    }

    /// Reports the progress of a task's process. Returns its error messages.
    fn listen(&self, number: usize, stderr: impl BufRead) -> String {
        let mut errors: Vec<String> = Vec::new();
        let mut has_fill = false;
        for line in stderr.lines().map_while(Result::ok) {
            if let Ok(Line { stage, fraction }) = serde_json::from_str(&line) {
                let Some(stage) = STAGES.iter().position(|name| *name == stage) else { continue };
                if stage > 1 && !has_fill {
                    has_fill = true;
                    self.fill_is_done(number);
                }
                self.report(PoolEvent::Progress(number, (stage as f64 + fraction) / STAGES.len() as f64));
            } else if let Ok(Error { error }) = serde_json::from_str(&line) {
                errors.push(error);
            }
        }
        errors.join("\n")
    }
}

/// Waits for a child to end, and requests its end if the user cancels.
fn wait(child: &mut Child) -> std::io::Result<std::process::ExitStatus> {
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if interrupt::is_requested() {
            drop(child.stdin.take());
        }
        thread::sleep(CHECK);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fill_is_simulated_once_while_others_continue() {
        let task = |fill: &str| PoolTask { args: Vec::new(), fill: Some(blake3::hash(fill.as_bytes())) };
        let tasks = ["a", "a", "b", "a"].map(task);
        let mut backlog = Backlog::new(tasks.len());
        assert_eq!(backlog.next(&tasks), Some(0));
        assert_eq!(backlog.next(&tasks), Some(2), "the fill of 1 is being simulated");
        assert_eq!(backlog.next(&tasks), None);
        backlog.finish_fill(tasks[0].fill.unwrap());
        assert_eq!(backlog.next(&tasks), Some(1));
        assert_eq!(backlog.next(&tasks), Some(3), "a finished fill serves all");
    }
}
