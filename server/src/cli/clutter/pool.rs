//! Makes layouts at the same time, in processes that keep what they have read: one that crashes or takes too long costs
//! its layout alone. The results come in the order of their numbers.

use crate::cli::interrupt;
use cairn_files::failpoints;
use serde::Deserialize;
use serde_json::value::RawValue;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read, Write};
use std::ops::RangeInclusive;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// What is to be made.
pub struct Task {
    /// Arguments of a worker.
    pub args: Vec<OsString>,
    pub numbers: RangeInclusive<u64>,
    pub workers: usize,
    /// Of a layout, and of what a worker reads before its first.
    pub timeout: Duration,
}

/// A layout.
#[derive(Deserialize)]
pub struct Made {
    pub line: Box<RawValue>,
    /// CPU time.
    pub seconds: f64,
    /// Peak of the process's memory so far, bytes.
    pub memory: Option<u64>,
    /// Collision shapes that the process had to make, stated once.
    pub new_shapes: usize,
}

#[derive(Deserialize)]
struct Refusal {
    error: String,
}

/// Layouts per worker that may be finished and wait for an earlier one: a bound of the memory.
const AHEAD: u64 = 32;
/// Interval of checks whether all has to end.
const CHECK: Duration = Duration::from_millis(50);
/// A terminal's Ctrl-C ends the workers, too; this process knows soon after.
const CTRL_C: Duration = Duration::from_millis(300);
/// Time in which a worker reads its catalogue.
const READING: Duration = Duration::from_secs(600);

type Outcome = Result<Made, String>;

/// What the workers share.
struct Queue {
    /// The next number to be made.
    next: u64,
    /// The next number to be delivered.
    wanted: u64,
    is_over: bool,
    error: Option<std::io::Error>,
}

/// Makes all layouts. `deliver` gets them in order, and returns whether to go on.
pub fn work(task: &Task, mut deliver: impl FnMut(u64, Outcome) -> bool) -> std::io::Result<()> {
    let first = *task.numbers.start();
    let queue = Mutex::new(Queue { next: first, wanted: first, is_over: false, error: None });
    let pool = Pool { task, queue, changed: Condvar::new() };
    let count = task.numbers.end() - first + 1;
    thread::scope(|scope| {
        let (sender, made) = channel();
        for _ in 0..(task.workers as u64).min(count) {
            let sender = sender.clone();
            let pool = &pool;
            scope.spawn(move || pool.work(&sender));
        }
        drop(sender);
        let mut waiting = BTreeMap::new();
        for (number, outcome) in made {
            waiting.insert(number, outcome);
            let mut wanted = pool.queue().wanted;
            while let Some(outcome) = waiting.remove(&wanted) {
                let goes_on = deliver(wanted, outcome);
                wanted += 1;
                let mut queue = pool.queue();
                queue.wanted = wanted;
                if !goes_on {
                    queue.is_over = true;
                    return;
                }
            }
            pool.changed.notify_all();
        }
    });
    pool.queue.into_inner().unwrap_or_else(PoisonError::into_inner).error.map_or(Ok(()), Err)
}

struct Pool<'a> {
    task: &'a Task,
    queue: Mutex<Queue>,
    changed: Condvar,
}

impl Pool<'_> {
    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, sender: &Sender<(u64, Outcome)>) {
        let mut worker = None;
        while let Some(number) = self.next() {
            if worker.is_none() {
                match Worker::start(&self.task.args) {
                    Ok(started) => worker = Some(started),
                    Err(error) => {
                        let mut queue = self.queue();
                        (queue.is_over, queue.error) = (true, Some(error));
                        return;
                    }
                }
            }
            let Some(running) = &mut worker else { return };
            let outcome = match running.make(number, self.task.timeout) {
                Ok(outcome) => outcome,
                Err(why) => {
                    let died = worker.take().map_or(String::new(), Worker::end);
                    thread::sleep(CTRL_C);
                    if interrupt::is_requested() {
                        return;
                    }
                    Err(if why.is_empty() { died } else { why })
                }
            };
            if sender.send((number, outcome)).is_err() {
                break;
            }
        }
        if let Some(worker) = worker {
            worker.end();
        }
    }

    /// The next number, once the results before it leave room.
    fn next(&self) -> Option<u64> {
        let mut queue = self.queue();
        loop {
            if interrupt::is_requested() || queue.is_over || queue.next > *self.task.numbers.end() {
                return None;
            }
            if queue.next < queue.wanted + AHEAD * self.task.workers as u64 {
                queue.next += 1;
                return Some(queue.next - 1);
            }
            queue = self.changed.wait_timeout(queue, CHECK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// A process that makes layouts.
struct Worker {
    child: Child,
    stdin: Option<ChildStdin>,
    answers: Receiver<String>,
    errors: Receiver<String>,
    has_read: bool,
}

impl Worker {
    fn start(args: &[OsString]) -> std::io::Result<Worker> {
        failpoints::at("clutter-spawn")?;
        let mut child = Command::new(std::env::current_exe()?)
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        let (stdout, stderr) = (child.stdout.take().expect("it is piped"), child.stderr.take().expect("it is piped"));
        let (sender, answers) = channel();
        thread::spawn(move || {
            let lines = BufReader::new(stdout).lines().map_while(Result::ok);
            lines.map(|line| sender.send(line)).take_while(Result::is_ok).for_each(drop);
        });
        let (sender, errors) = channel();
        thread::spawn(move || {
            /// Of what a process writes about its end.
            const MOST: u64 = 10_000;
            let mut stderr = stderr;
            let mut text = Vec::new();
            let _ = (&mut stderr).take(MOST).read_to_end(&mut text);
            let _ = sender.send(String::from_utf8_lossy(&text).into_owned());
            let _ = std::io::copy(&mut stderr, &mut std::io::sink());
        });
        let stdin = child.stdin.take();
        Ok(Worker { child, stdin, answers, errors, has_read: false })
    }

    /// A layout. An error: the process is of no use any more, for this reason, or for the one that it gives.
    fn make(&mut self, number: u64, timeout: Duration) -> Result<Outcome, String> {
        let Some(stdin) = &mut self.stdin else { return Err(String::new()) };
        writeln!(stdin, "{number}").and_then(|()| stdin.flush()).map_err(|_| String::new())?;
        let most = if self.has_read { timeout } else { timeout + READING };
        let began = Instant::now();
        loop {
            match self.answers.recv_timeout(CHECK) {
                Ok(text) => {
                    self.has_read = true;
                    return Ok(serde_json::from_str(&text).map_err(|_| {
                        let refusal: Option<Refusal> = serde_json::from_str(&text).ok();
                        refusal.map_or("its process answered wrongly".into(), |refusal| refusal.error)
                    }));
                }
                Err(RecvTimeoutError::Disconnected) => return Err(String::new()),
                Err(RecvTimeoutError::Timeout) if interrupt::is_requested() => return Err(String::new()),
                Err(RecvTimeoutError::Timeout) if began.elapsed() > most => {
                    return Err(format!("it took longer than {} s", timeout.as_secs()));
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Ends the process, and says how it ended.
    fn end(mut self) -> String {
        drop(self.stdin.take());
        let ends_by_itself = (0..10).any(|_| {
            let is_over = self.child.try_wait().is_ok_and(|status| status.is_some());
            if !is_over {
                thread::sleep(CHECK);
            }
            is_over
        });
        if !ends_by_itself {
            let _ = self.child.kill();
        }
        let status = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        let text = self.errors.recv_timeout(CTRL_C).unwrap_or_default();
        let last = text.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default();
        format!("its process ended ({status}) {last}").trim_end().to_owned()
    }
}
