//! The server's side of a worker process. Each bake has its own: a crash affects only that bake, a bake that hangs is
//! killed, and its memory is bounded.

use crate::config::Config;
use crate::event_log::codec;
use crate::folder::ResultKind;
use crate::memory::{MemoryBudget, Share};
use crate::status::Fault;
use crate::worker_message::{Envelope, WorkerMessage};
use cairn_files::failpoints;
use cairn_files::plain_reason;
use cairn_job::machine;
use prost::Message;
use std::io::Result;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::AsyncReadExt;
use tokio::process::{Child, ChildStdin, ChildStdout, Command};
use tokio::task::JoinHandle;
use tokio_stream::StreamExt;
use tokio_util::codec::{FramedRead, LengthDelimitedCodec};

/// Variables that a worker needs, or that tests set.
const KEPT: [&str; 8] =
    ["FAILPOINTS", "PATH", "LD_LIBRARY_PATH", "RUST_BACKTRACE", "SystemRoot", "TEMP", "TMP", "TMPDIR"];
/// What the standard library says at the memory limit, and what the program says of threads that it does not get there.
const SAID_WITHOUT_MEMORY: [&str; 3] = ["memory allocation of", "no thread could be started", "failed to spawn thread"];

/// The task of a worker.
#[derive(Clone)]
pub enum WorkerTask {
    Plan,
    /// A plan without estimates, made before a bake.
    Accept,
    Bake,
    /// A finished bake's result in a further format or layout.
    Export(ResultKind),
    /// The analysis of a pile.
    Analyse,
}

/// A running worker. Dropping it kills the process.
pub struct Worker {
    child: Child,
    messages: FramedRead<ChildStdout, LengthDelimitedCodec>,
    /// Its standard error.
    stderr: JoinHandle<String>,
    /// Of the memory of all.
    share: Share,
    /// The limit of its own memory.
    memory_mib: u64,
    /// The worker ends when this is closed, and so when the server ends.
    _alive: Option<ChildStdin>,
}

impl Worker {
    pub fn start(
        config: &Config,
        memory: &Arc<MemoryBudget>,
        task: WorkerTask,
        folder: &Path,
        cache: Option<PathBuf>,
        threads: usize,
    ) -> std::result::Result<Worker, Fault> {
        Worker::spawn(config, memory, &task, folder, cache, threads).map_err(|error| {
            tracing::error!(%error, "a worker process could not be started");
            Fault::BakeNotStarted(plain_reason(&error))
        })
    }

    fn spawn(
        config: &Config,
        memory: &Arc<MemoryBudget>,
        task: &WorkerTask,
        folder: &Path,
        cache: Option<PathBuf>,
        threads: usize,
    ) -> Result<Worker> {
        let program = match &config.worker_program {
            Some(program) => program.clone(),
            // Stays this version even if another one is installed in its place.
            None if cfg!(target_os = "linux") => "/proc/self/exe".into(),
            None => std::env::current_exe()?,
        };
        let mut command = Command::new(program);
        command.arg("worker").arg(match task {
            WorkerTask::Plan => "plan",
            WorkerTask::Accept => "accept",
            WorkerTask::Bake => "bake",
            WorkerTask::Export(_) => "export",
            WorkerTask::Analyse => "analyse",
        });
        command.arg(folder);
        if let WorkerTask::Export(kind) = task {
            command.arg("--format").arg(kind.format.extension());
            command.args(kind.layout.iter().flat_map(|layout| ["--layout", layout]));
        }
        if let Some(bytes) = memory.each {
            command.arg("--memory").arg(bytes.to_string());
        }
        if let Some(slowness) = machine::known_slowness() {
            command.arg("--slowness").arg(slowness.to_string());
        }
        if let Some(cache) = cache {
            command.arg("--cache").arg(cache);
        }
        // Nothing of the server's own: its token may be there.
        command.env_clear().envs(KEPT.into_iter().filter_map(|name| Some((name, std::env::var_os(name)?))));
        command.env("RAYON_NUM_THREADS", threads.to_string());
        // The server handles Ctrl-C at the terminal.
        #[cfg(unix)]
        command.process_group(0);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).kill_on_drop(true);
        failpoints::at("worker-spawn")?;
        let mut child = command.spawn()?;
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let stdout = stdout.ok_or_else(|| std::io::Error::other("no pipe to the worker"))?;
        let stderr = tokio::spawn(async move {
            /// Bytes kept of a worker's standard error.
            const MOST: u64 = 4096;
            let mut text = Vec::new();
            if let Some(mut stderr) = stderr {
                let _ = (&mut stderr).take(MOST).read_to_end(&mut text).await;
                // The worker must not block on a full pipe.
                let _ = tokio::io::copy(&mut stderr, &mut tokio::io::sink()).await;
            }
            String::from_utf8_lossy(&text).into_owned()
        });
        let alive = child.stdin.take();
        let messages = FramedRead::new(stdout, codec());
        let is_plan = !matches!(task, WorkerTask::Bake);
        let share = memory.join(child.id().unwrap_or_default(), is_plan);
        let memory_mib = memory.each.unwrap_or_default() >> 20;
        Ok(Worker { child, messages, stderr, share, memory_mib, _alive: alive })
    }

    /// The worker's next message, or `None` after the last one; a fault that it reports of the disk is an error.
    /// May be dropped and called again.
    pub async fn next(&mut self) -> std::result::Result<Option<WorkerMessage>, Fault> {
        let over = self.share.over();
        let read = tokio::select! {
            read = self.read() => read,
            () = over.cancelled() => {
                self.kill().await;
                return Err(Fault::MemoryTogether(self.share.all_mib()));
            }
        };
        match read {
            Ok(Some(WorkerMessage::NotWritten(why))) => Err(Fault::StorageLimit(why)),
            Ok(Some(WorkerMessage::Broken(why))) => Err(Fault::DataDirectory(why)),
            Ok(message) => Ok(message),
            Err(error) => Err(Fault::BakeCrashed(format!("its messages cannot be read: {}", plain_reason(&error)))),
        }
    }

    async fn read(&mut self) -> Result<Option<WorkerMessage>> {
        failpoints::at("message-read")?;
        match self.messages.next().await.transpose()? {
            Some(message) => Ok(Envelope::decode(message.freeze())?.message),
            None => Ok(None),
        }
    }

    /// Why the worker ended without a result.
    pub async fn fault(mut self) -> Fault {
        /// A process whose output has ended is about to end.
        const PATIENCE: Duration = Duration::from_secs(2);
        let status = match tokio::time::timeout(PATIENCE, self.child.wait()).await {
            Ok(Ok(status)) if was_killed(status) => return Fault::BakeKilled,
            Ok(Ok(status)) => status.to_string(),
            Ok(Err(error)) => error.to_string(),
            Err(_) => "it did not end".into(),
        };
        self.kill().await;
        let said = tokio::time::timeout(PATIENCE, &mut self.stderr).await;
        let said = said.ok().and_then(std::result::Result::ok).unwrap_or_default();
        if SAID_WITHOUT_MEMORY.iter().any(|one| said.contains(one)) {
            return Fault::MemoryLimit(self.memory_mib);
        }
        let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
        Fault::BakeCrashed(if said.is_empty() { status } else { format!("{status}: {said}") })
    }

    /// Ends the process now, whatever it is doing.
    pub async fn kill(&mut self) {
        let _ = self.child.kill().await;
    }
}

/// Whether the system, out of memory, or an operator has killed the process. These signals never come from a crash of
/// the process itself.
#[cfg(unix)]
fn was_killed(status: std::process::ExitStatus) -> bool {
    use std::os::unix::process::ExitStatusExt;
    const SIGKILL: i32 = 9;
    const SIGTERM: i32 = 15;
    matches!(status.signal(), Some(SIGKILL | SIGTERM))
}

#[cfg(not(unix))]
fn was_killed(_: std::process::ExitStatus) -> bool {
    false
}
