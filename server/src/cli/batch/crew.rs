//! Bakes at the same time, each a `cairn bake` in a process of its own: one that fails, crashes or takes all memory is that
//! bake's trouble alone.

use crate::cli::interrupt;
use crate::trouble;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// A bake to be made.
pub struct Task {
    /// Of `cairn bake`.
    pub args: Vec<OsString>,
    /// Equal for tasks that share a fill: the first makes it, and the others find it.
    pub fill: Option<blake3::Hash>,
}

/// How a bake ended.
#[derive(Debug)]
pub enum End {
    Done,
    Cancelled,
    /// The exit code, where there is one, and what it told.
    Failed(Option<u8>, String),
}

/// What the crew tells meanwhile.
pub enum News {
    /// How much of its stages a task has behind it.
    Progress(usize, f64),
    Ended(usize, End),
}

/// Between two looks at whether a bake is to end.
const LOOK: Duration = Duration::from_millis(50);

/// Does all tasks, so many at the same time, in their order as far as their fills allow. `tell` is called for one piece of news at
/// a time.
pub fn work(tasks: &[Task], workers: usize, tell: impl FnMut(News) + Send) {
    let crew =
        Crew { tasks, open: Mutex::new(Open::new(tasks.len())), changed: Condvar::new(), tell: Mutex::new(tell) };
    thread::scope(|scope| {
        for _ in 0..workers.min(tasks.len()) {
            scope.spawn(|| crew.take_turns());
        }
    });
}

/// What is not begun yet.
struct Open {
    waiting: BTreeSet<usize>,
    /// Fills that are being made.
    filling: Vec<blake3::Hash>,
    /// Fills that were made.
    filled: BTreeSet<[u8; 32]>,
}

impl Open {
    fn new(tasks: usize) -> Open {
        Open { waiting: (0..tasks).collect(), filling: Vec::new(), filled: BTreeSet::new() }
    }

    /// The first task whose fill nobody else is making just now.
    fn next(&mut self, tasks: &[Task]) -> Option<usize> {
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

    fn is_filled(&mut self, fill: blake3::Hash) {
        self.filling.retain(|other| *other != fill);
        self.filled.insert(*fill.as_bytes());
    }
}

struct Crew<'a, Tell> {
    tasks: &'a [Task],
    open: Mutex<Open>,
    changed: Condvar,
    tell: Mutex<Tell>,
}

/// A line of `--progress json`.
#[derive(Deserialize)]
struct Line {
    stage: String,
    fraction: f64,
}

/// The stages in their order.
const STAGES: [&str; 6] = ["shape", "fill", "glue", "release", "hold", "measure"];

impl<Tell: FnMut(News) + Send> Crew<'_, Tell> {
    fn take_turns(&self) {
        while let Some(number) = self.next() {
            let end = self
                .bake(number)
                .unwrap_or_else(|error| End::Failed(None, format!("no process could be started for it: {error}")));
            // A fill that failed is the next one's to make.
            self.fill_is_done(number);
            self.tell(News::Ended(number, end));
        }
    }

    fn next(&self) -> Option<usize> {
        let mut open = lock(&self.open);
        loop {
            if interrupt::asked() || open.waiting.is_empty() {
                return None;
            }
            if let Some(task) = open.next(self.tasks) {
                return Some(task);
            }
            open = self.changed.wait_timeout(open, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn fill_is_done(&self, number: usize) {
        if let Some(fill) = self.tasks[number].fill {
            lock(&self.open).is_filled(fill);
            self.changed.notify_all();
        }
    }

    fn tell(&self, news: News) {
        (lock(&self.tell))(news);
    }

    fn bake(&self, number: usize) -> std::io::Result<End> {
        trouble::at("batch-spawn")?;
        let mut child = Command::new(std::env::current_exe()?)
            .arg("bake")
            .args(&self.tasks[number].args)
            .args(["--progress", "json"])
            .env(interrupt::ENDS_WITH_INPUT, "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let told = child.stderr.take().expect("it was asked for");
        thread::scope(|scope| {
            let listener = scope.spawn(|| self.listen(number, BufReader::new(told)));
            let status = wait(&mut child)?;
            let errors = listener.join().unwrap_or_default();
            Ok(match status.code() {
                Some(0) => End::Done,
                _ if interrupt::asked() => End::Cancelled,
                Some(code) => End::Failed(u8::try_from(code).ok(), errors),
                None => End::Failed(None, format!("it was ended from outside ({status})")),
            })
        })
    }

    /// Passes its progress on, and keeps what it says is wrong.
    fn listen(&self, number: usize, told: impl BufRead) -> String {
        let mut errors: Vec<String> = Vec::new();
        let mut has_fill = false;
        for line in told.lines().map_while(Result::ok) {
            if let Ok(Line { stage, fraction }) = serde_json::from_str(&line) {
                let Some(stage) = STAGES.iter().position(|name| *name == stage) else { continue };
                if stage > 1 && !has_fill {
                    has_fill = true;
                    self.fill_is_done(number);
                }
                self.tell(News::Progress(number, (stage as f64 + fraction) / STAGES.len() as f64));
            } else if let Some(error) = line.strip_prefix("error: ") {
                errors.push(error.to_owned());
            }
        }
        errors.join("\n")
    }
}

/// Waits for its end; where the user wants to end, it is asked to.
fn wait(child: &mut Child) -> std::io::Result<std::process::ExitStatus> {
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if interrupt::asked() {
            drop(child.stdin.take());
        }
        thread::sleep(LOOK);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fill_is_made_once_while_others_go_on() {
        let task = |fill: &str| Task { args: Vec::new(), fill: Some(blake3::hash(fill.as_bytes())) };
        let tasks = ["a", "a", "b", "a"].map(task);
        let mut open = Open::new(tasks.len());
        assert_eq!(open.next(&tasks), Some(0));
        assert_eq!(open.next(&tasks), Some(2), "the fill of 1 is being made");
        assert_eq!(open.next(&tasks), None);
        open.is_filled(tasks[0].fill.unwrap());
        assert_eq!(open.next(&tasks), Some(1));
        assert_eq!(open.next(&tasks), Some(3), "what was made is there for all");
    }
}
