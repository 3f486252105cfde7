//! The server's side of a worker process. Each bake has its own: a crash affects only that bake, a bake that hangs is
//! killed, and its memory is bounded.

use crate::config::Config;
use crate::event_log::codec;
use crate::folder::ResultKind;
use crate::status::Fault;
use crate::worker_message::{Envelope, WorkerMessage};
use cairn_files::failpoints;
use cairn_files::plain_reason;
use cairn_job::machine;
use prost::Message;
use std::io::Result;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;
use tokio::io::AsyncReadExt;
use tokio::process::{Child, ChildStdin, ChildStdout, Command};
use tokio::task::JoinHandle;
use tokio_stream::StreamExt;
use tokio_util::codec::{FramedRead, LengthDelimitedCodec};

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
    memory_mib: u64,
    /// The worker ends when this is closed, and so when the server ends.
    _alive: Option<ChildStdin>,
}

impl Worker {
    pub fn start(
        config: &Config,
        task: WorkerTask,
        folder: &Path,
        cache: Option<PathBuf>,
        threads: usize,
    ) -> std::result::Result<Worker, Fault> {
        Worker::spawn(config, &task, folder, cache, threads).map_err(|error| {
            tracing::error!(%error, "a worker process could not be started");
            Fault::BakeNotStarted(plain_reason(&error))
        })
    }

    fn spawn(
        config: &Config,
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
        if let Some(bytes) = config.bake_memory() {
            command.arg("--memory").arg(bytes.to_string());
        }
        if let Some(slowness) = machine::known_slowness() {
            command.arg("--slowness").arg(slowness.to_string());
        }
        if let Some(cache) = cache {
            command.arg("--cache").arg(cache);
        }
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
        Ok(Worker { child, messages, stderr, memory_mib: config.bake_memory_mib, _alive: alive })
    }

    /// The worker's next message, or `None` after the last one; a fault that it reports of the disk is an error.
    /// May be dropped and called again.
    pub async fn next(&mut self) -> std::result::Result<Option<WorkerMessage>, Fault> {
        match self.read().await {
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
        // The standard library's message at the memory limit.
        if said.contains("memory allocation of") {
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
