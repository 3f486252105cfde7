//! Layouts in MuJoCo, by Python's package: the drift of each, from the line and the assets alone.

use crate::cli::Failure;
use cairn_clutter::Line;
use cairn_files::failpoints;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// The reader and the loader that a user's program has.
const PROGRAM: &str =
    concat!(include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/python/cairn/clutter.py")), "\n_answer_drifts()\n");

/// Refuses a Python without MuJoCo.
pub fn check(python: &Path) -> Result<(), Failure> {
    let run = || Command::new(python).args(["-c", "import mujoco"]).stdin(Stdio::null()).output();
    let remedy = "Install it (pip install mujoco), name its Python by --python, or leave mujoco out of --stands.";
    match failpoints::at("clutter-python").and_then(|()| run()) {
        Ok(done) if done.status.success() => Ok(()),
        Ok(_) => Err(Failure::usage(python.display().to_string(), "this Python has no package mujoco", remedy)),
        Err(error) => {
            Err(Failure::usage(python.display().to_string(), format!("it cannot be started: {error}"), remedy))
        }
    }
}

/// A Python that answers lines with drifts.
pub struct Mujoco {
    child: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
}

impl Mujoco {
    pub fn start(python: &Path, assets: &Path) -> Result<Mujoco, String> {
        let start = || {
            failpoints::at("clutter-mujoco")?;
            Command::new(python)
                .args(["-c", PROGRAM])
                .arg(assets)
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(Stdio::inherit())
                .spawn()
        };
        let mut child = start().map_err(|error| format!("{}: {error}", python.display()))?;
        let (stdin, stdout) = (child.stdin.take().expect("it is piped"), child.stdout.take().expect("it is piped"));
        Ok(Mujoco { child, stdin, stdout: BufReader::new(stdout) })
    }

    /// The drift of a layout, m.
    pub fn drift(&mut self, line: &Line) -> Result<f64, String> {
        let text = serde_json::to_string(line).map_err(|error| error.to_string())?;
        let mut answer = String::new();
        let asked = writeln!(self.stdin, "{text}").and_then(|()| self.stdin.flush());
        asked.and_then(|()| self.stdout.read_line(&mut answer)).map_err(|error| format!("MuJoCo: {error}"))?;
        answer.trim().parse().map_err(|_| format!("MuJoCo has no answer: {}", answer.trim()))
    }
}

impl Drop for Mujoco {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
