//! The operator's own program, which gets the status of each bake that has ended.

use crate::config::{self, Config};
use crate::status_json;
use cairn_files::problem::Problem;
use cairn_wire::digest::hex;
use cairn_wire::proto::BakeStatus;
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::AsyncWriteExt;
use tokio::process::Command;
use tokio::sync::Semaphore;
use tracing::warn;

/// Programs that run at the same time; more wait.
const MOST: usize = 4;
/// Time after which a program is killed.
const LONGEST: Duration = Duration::from_secs(60);

/// The hook of the settings.
#[derive(Clone)]
pub struct Hook {
    program: PathBuf,
    key: Option<Arc<Vec<u8>>>,
    places: Arc<Semaphore>,
}

impl Hook {
    /// The hook, if the settings have one.
    pub fn read(config: &Config) -> Result<Option<Hook>, Vec<Problem>> {
        let mut problems = Vec::new();
        let key = config::read_file("hook_key_file", &config.hook_key_file, &mut problems);
        if key.as_ref().is_some_and(|key| key.trim_ascii().is_empty()) {
            let remedy = "Write a long random text into it, or omit it.";
            problems.push(Problem::new("hook_key_file", "the key is empty", remedy));
        }
        match &config.hook {
            Some(program) if !program.is_file() => {
                problems.push(Problem::at(program, "no such file (hook)", "Name a program by its path."));
            }
            None if config.hook_key_file.is_some() => {
                problems.push(Problem::new("hook_key_file", "there is no hook", "Give hook, too."));
            }
            _ => {}
        }
        let key = key.map(|key| Arc::new(key.trim_ascii().to_vec()));
        let places = Arc::new(Semaphore::new(MOST));
        let hook = config.hook.clone().map(|program| Hook { program, key: key.clone(), places });
        if problems.is_empty() { Ok(hook) } else { Err(problems) }
    }

    /// Runs the program with the status as JSON on its standard input. `CAIRN_SIGNATURE` is the input's HMAC-SHA256.
    pub fn report(&self, bake: &BakeStatus) {
        let text = status_json::object(bake).to_string();
        let (hook, id) = (self.clone(), bake.bake_id.clone());
        tokio::spawn(async move {
            let Ok(_place) = hook.places.acquire().await else { return };
            let ended = tokio::time::timeout(LONGEST, hook.run(text.as_bytes())).await;
            match ended {
                Ok(Ok(status)) if status.success() => {}
                Ok(Ok(status)) => warn!(bake_id = %id, %status, "the hook failed"),
                Ok(Err(error)) => warn!(bake_id = %id, %error, "the hook could not be run"),
                Err(_) => warn!(bake_id = %id, "the hook took too long and was ended"),
            }
        });
    }

    async fn run(&self, text: &[u8]) -> std::io::Result<std::process::ExitStatus> {
        let mut command = Command::new(&self.program);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null()).kill_on_drop(true);
        if let Some(key) = &self.key {
            let mut mac = Hmac::<Sha256>::new_from_slice(key).map_err(std::io::Error::other)?;
            mac.update(text);
            command.env("CAIRN_SIGNATURE", hex(&mac.finalize().into_bytes()));
        }
        let mut child = command.spawn()?;
        if let Some(mut input) = child.stdin.take() {
            // A program need not read it.
            let _ = input.write_all(text).await;
        }
        child.wait().await
    }
}
