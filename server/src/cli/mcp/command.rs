//! Runs a command of this program for a call of a tool.

use super::place::WriteFolder;
use crate::cli::allowed::VARIABLE;
use cairn_input::observer::Stage;
use cairn_job::pace::overall_at;
use rmcp::RoleServer;
use rmcp::model::ProgressNotificationParam;
use rmcp::service::RequestContext;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{ExitStatus, Stdio};
use tokio::io::{AsyncBufReadExt, AsyncReadExt, BufReader};
use tokio::process::Command;
use tokio::sync::Semaphore;

/// Commands that run at once: each takes all cores.
const AT_ONCE: usize = 2;

/// The server of the tools.
pub struct Cairn {
    program: PathBuf,
    places: Semaphore,
    /// Where the commands run, and below which they write.
    pub folder: WriteFolder,
    /// Where files may lie that only a scene names, as in `PATH`.
    allowed: OsString,
}

/// The arguments of a command.
pub struct Call {
    args: Vec<String>,
    /// Behind `--`, so that a name is never read as a flag.
    positional: Vec<String>,
}

impl Call {
    pub fn new(command: &str) -> Call {
        Call { args: vec![command.into()], positional: Vec::new() }
    }

    pub fn flag(mut self, flag: &str) -> Call {
        self.args.push(flag.into());
        self
    }

    pub fn option(mut self, name: &str, value: impl ToString) -> Call {
        self.args.push(format!("{name}={}", value.to_string()));
        self
    }

    /// An option once for each of its values.
    pub fn each<T: ToString>(self, name: &str, values: impl IntoIterator<Item = T>) -> Call {
        values.into_iter().fold(self, |call, value| call.option(name, value))
    }

    pub fn positional(mut self, value: &str) -> Call {
        self.positional.push(value.into());
        self
    }
}

/// A command that has ended.
pub struct Done {
    status: ExitStatus,
    stdout: String,
    /// Lines of the standard error.
    messages: Vec<String>,
}

impl Done {
    /// An error of the command's own messages unless it has succeeded.
    pub fn success(&self) -> Result<(), String> {
        if self.status.success() {
            return Ok(());
        }
        let errors: Vec<&str> = self.messages.iter().filter_map(|line| line.strip_prefix("error: ")).collect();
        Err(match errors[..] {
            [] => format!("the command ended with {}: {}", self.status, self.messages.join("; ")),
            _ => errors.join("\n"),
        })
    }

    /// The answer of a command that has succeeded.
    pub fn json<T: DeserializeOwned>(&self) -> Result<T, String> {
        self.success()?;
        self.json_in_any_case()
    }

    /// The answer, also of a command whose answer is that something is wrong.
    pub fn json_in_any_case<T: DeserializeOwned>(&self) -> Result<T, String> {
        if self.stdout.trim().is_empty() {
            self.success()?;
        }
        serde_json::from_str(&self.stdout).map_err(|error| format!("the answer of the command cannot be read: {error}"))
    }

    /// Warnings and notes.
    pub fn notes(&self) -> Vec<String> {
        let note = |line: &String| line.strip_prefix("warning: ").or(line.strip_prefix("note: ")).map(str::to_owned);
        self.messages.iter().filter_map(note).collect()
    }
}

/// A line of progress, as `--progress json` prints it.
#[derive(Deserialize)]
struct ProgressLine {
    stage: Stage,
    fraction: f64,
    bodies: usize,
}

impl Cairn {
    pub fn new(folder: WriteFolder, allowed: OsString) -> std::io::Result<Cairn> {
        Ok(Cairn { program: std::env::current_exe()?, places: Semaphore::new(AT_ONCE), folder, allowed })
    }

    /// Runs a command, and sends its progress to the client that asks for it.
    pub async fn run(&self, call: Call, context: &RequestContext<RoleServer>) -> Result<Done, String> {
        let Ok(_place) = self.places.acquire().await else { return Err("the server ends".into()) };
        let fail = |error: std::io::Error| format!("the command cannot be run: {error}");
        let mut child = Command::new(&self.program)
            .args(&call.args)
            .current_dir(self.folder.path())
            .env(VARIABLE, &self.allowed)
            .arg("--")
            .args(&call.positional)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .map_err(fail)?;
        let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
        let answer = async {
            let mut text = Vec::new();
            if let Some(mut stdout) = stdout {
                stdout.read_to_end(&mut text).await?;
            }
            Ok(String::from_utf8_lossy(&text).into_owned())
        };
        let messages = async {
            let mut messages = Vec::new();
            let Some(stderr) = stderr else { return Ok(messages) };
            let mut lines = BufReader::new(stderr).lines();
            while let Some(line) = lines.next_line().await? {
                match serde_json::from_str::<ProgressLine>(&line) {
                    Ok(progress) => progress.send(context).await,
                    Err(_) => messages.extend(plain(&line)),
                }
            }
            Ok(messages)
        };
        let work = async { tokio::try_join!(answer, messages, child.wait()) };
        tokio::select! {
            done = work => {
                let (stdout, messages, status) = done.map_err(fail)?;
                Ok(Done { status, stdout, messages })
            }
            // Results appear complete or not at all.
            () = context.ct.cancelled() => {
                child.kill().await.map_err(fail)?;
                Err("cancelled".into())
            }
        }
    }
}

impl ProgressLine {
    async fn send(&self, context: &RequestContext<RoleServer>) {
        let Some(token) = context.meta.get_progress_token() else { return };
        let message = format!("{}, {} bodies", cairn_job::pace::name(self.stage), self.bodies);
        let progress = ProgressNotificationParam::new(token, overall_at(self.stage, self.fraction));
        // A client that does not listen any more is no fault of the command.
        let _ = context.peer.notify_progress(progress.with_total(1.0).with_message(message)).await;
    }
}

/// A message as `kind: text`, from a line or from its JSON.
fn plain(line: &str) -> Option<String> {
    match serde_json::from_str::<serde_json::Map<String, serde_json::Value>>(line) {
        Ok(object) => {
            let (kind, text) = object.iter().find(|(kind, _)| ["error", "warning", "note"].contains(&kind.as_str()))?;
            Some(format!("{kind}: {}", text.as_str()?))
        }
        Err(_) => (!line.trim().is_empty()).then(|| line.to_owned()),
    }
}
