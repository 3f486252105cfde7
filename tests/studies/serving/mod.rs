//! A server for a study, and bakes for it.

use anyhow::{Context, Result};
use cairn_service::client::Target;
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{AssetReference, BakeRequest, BakeResponse, BakeSpec, Summary};
use cairn_wire::scene_file::SceneTree;
use sha2::{Digest, Sha256};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use tonic::Streaming;

/// Reads a bake's stream to its end: the id and the summary.
pub async fn read(mut events: Streaming<BakeResponse>) -> Result<(String, Summary)> {
    let (mut id, mut summary) = (String::new(), None);
    while let Some(response) = events.message().await? {
        match response.event.and_then(|event| event.kind) {
            Some(Kind::Accepted(accepted)) => id = accepted.bake_id,
            Some(Kind::Summary(received)) => summary = Some(received),
            _ => {}
        }
    }
    Ok((id, summary.context("no summary")?))
}

pub fn request(control: &str, assignments: &[&str]) -> BakeRequest {
    let mut tree = SceneTree::default();
    let models = [format!("control_mesh={control}"), "props.0=stick.glb".into()];
    for assignment in models.iter().map(String::as_str).chain(assignments.iter().copied()) {
        tree.set(assignment).expect("the assignment is right");
    }
    let asset = |name: &str| AssetReference {
        uri: name.into(),
        sha256: sha256(&std::fs::read(asset(name)).expect("the example is there")),
    };
    let assets = [control, "stick.glb"].map(asset).into();
    BakeRequest {
        spec: Some(BakeSpec { scene: Some(tree.to_message()), assets, ..Default::default() }),
        ..Default::default()
    }
}

pub fn asset(name: &str) -> PathBuf {
    Path::new(env!("CAIRN_REPOSITORY")).join("examples/assets").join(name)
}

pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The program beside this example.
pub fn program() -> Result<PathBuf> {
    Ok(std::env::current_exe()?.parent().and_then(Path::parent).context("no folder")?.join("cairn"))
}

/// A server. Dropping it ends it.
pub struct Server {
    pub process: Child,
    pub target: Target,
}

impl Server {
    pub fn start(folder: &Path, args: &[&str]) -> Result<Server> {
        let mut command = Command::new(program()?);
        command.args(["serve", "--listen", "127.0.0.1:0", "--data"]).arg(folder.join("data")).args(args);
        let mut process = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn()?;
        let mut address = String::new();
        BufReader::new(process.stdout.take().context("no output")?).read_line(&mut address)?;
        let target = Target { address: address.trim().into(), ..Default::default() };
        Ok(Server { process, target })
    }

    /// Its peak memory, on Linux.
    pub fn peak_mib(&self) -> Result<f64> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.process.id()))?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).context("no VmHWM")?;
        Ok(line.trim().trim_end_matches(" kB").parse::<f64>()? / 1024.0)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
