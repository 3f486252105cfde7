//! One bake in a process of its own: the server's side. A bake that hangs is killed, one that crashes takes nothing with
//! it, and its memory is bounded.

use crate::files::plain_reason;
use crate::service::config::Config;
use crate::service::event_log::codec;
use crate::service::news::{News, Told};
use crate::service::status::Fault;
use crate::service::store::CACHE;
use crate::trouble;
use prost::Message;
use std::io::Result;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;
use tokio::io::AsyncReadExt;
use tokio::process::{Child, ChildStdin, ChildStdout, Command};
use tokio::task::JoinHandle;
use tokio_stream::StreamExt;
use tokio_util::codec::{FramedRead, LengthDelimitedCodec};

/// What a worker does.
#[derive(Clone, Copy)]
pub enum Task {
    Plan,
    /// A plan without what it would cost: a bake is to begin.
    Accept,
    Bake,
}

/// A running worker. Dropping it kills the process.
pub struct Worker {
    child: Child,
    news: FramedRead<ChildStdout, LengthDelimitedCodec>,
    /// What it says to a person.
    stderr: JoinHandle<String>,
    memory_mib: u64,
    /// The worker ends when this is closed, and thus when the server does.
    _alive: Option<ChildStdin>,
}

impl Worker {
    pub fn start(config: &Config, task: Task, folder: &Path) -> std::result::Result<Worker, Fault> {
        Worker::spawn(config, task, folder).map_err(|error| {
            tracing::error!(%error, "no process could be started");
            Fault::BakeNotStarted(plain_reason(&error))
        })
    }

    fn spawn(config: &Config, task: Task, folder: &Path) -> Result<Worker> {
        let program = match &config.worker_program {
            Some(program) => program.clone(),
            // Still this version after another one was installed in its place.
            None if cfg!(target_os = "linux") => "/proc/self/exe".into(),
            None => std::env::current_exe()?,
        };
        let mut command = Command::new(program);
        command.arg("worker").arg(match task {
            Task::Plan => "plan",
            Task::Accept => "accept",
            Task::Bake => "bake",
        });
        command.arg(folder);
        if let Some(bytes) = config.bake_memory() {
            command.arg("--memory").arg(bytes.to_string());
        }
        if config.reuse {
            command.arg("--cache").arg(config.data.join(CACHE));
        }
        command.env("RAYON_NUM_THREADS", config.threads().to_string());
        // Ctrl-C at the terminal is the server's to handle.
        #[cfg(unix)]
        command.process_group(0);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).kill_on_drop(true);
        trouble::at("worker-spawn")?;
        let mut child = command.spawn()?;
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let stdout = stdout.ok_or_else(|| std::io::Error::other("no pipe to the worker"))?;
        let stderr = tokio::spawn(async move {
            /// Bytes kept of what a worker says.
            const MOST: u64 = 4096;
            let mut text = Vec::new();
            if let Some(mut stderr) = stderr {
                let _ = (&mut stderr).take(MOST).read_to_end(&mut text).await;
                // It must not wait for us to read the rest.
                let _ = tokio::io::copy(&mut stderr, &mut tokio::io::sink()).await;
            }
            String::from_utf8_lossy(&text).into_owned()
        });
        let alive = child.stdin.take();
        let news = FramedRead::new(stdout, codec());
        Ok(Worker { child, news, stderr, memory_mib: config.bake_memory_mib, _alive: alive })
    }

    /// What the worker tells next; `None` once it has no more to say. May be dropped and called again.
    pub async fn next(&mut self) -> std::result::Result<Option<News>, Fault> {
        let told = self.read().await;
        told.map_err(|error| Fault::BakeCrashed(format!("what it tells cannot be read: {}", plain_reason(&error))))
    }

    async fn read(&mut self) -> Result<Option<News>> {
        trouble::at("news-read")?;
        match self.news.next().await.transpose()? {
            Some(told) => Ok(Told::decode(told)?.news),
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
        // The standard library's words when the memory limit is reached.
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

/// Whether somebody else has ended the process: the system, since memory ran out, or an operator. A process cannot kill itself
/// by a fault of its own in this way.
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
