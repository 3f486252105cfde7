//! A server in its own folder, and scenes for it.

use cairn_service::client::{Connection, Target};
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{
    AssetReference, BakeEvent, BakeRequest, BakeSpec, BakeState, BakeStatus, ControlMesh, GetBakeRequest, Prop, Scene,
    WatchBakeRequest,
};
use cairn_wire::scene_file::SceneTree;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Request, Status, Streaming};
use tonic_types::{ErrorDetails, StatusExt};

pub const PROGRAM: &str = env!("CARGO_BIN_EXE_cairn");

/// A running server. Dropping it kills the server.
pub struct Server {
    process: Child,
    pub addresses: Vec<String>,
    folder: Folder,
}

enum Folder {
    Own(TempDir),
    Other(PathBuf),
}

impl Server {
    /// `cairn serve` on a free port, with these arguments.
    pub fn start(args: &[&str]) -> Server {
        Server::launch(Folder::Own(tempfile::tempdir().unwrap()), args, "", "")
    }

    /// Another server on the data of an ended one.
    pub fn start_in(folder: &Path, args: &[&str]) -> Server {
        Server::launch(Folder::Other(folder.to_owned()), args, "", "")
    }

    /// A server that a shell starts after this command, such as `ulimit -v 1000000`.
    pub fn start_by_shell(folder: &Path, shell: &str, args: &[&str]) -> Server {
        Server::launch(Folder::Other(folder.to_owned()), args, "", shell)
    }

    /// A server with these faults: see `server/files/src/failpoints.rs`.
    pub fn start_with_faults(folder: &Path, args: &[&str], faults: &str) -> Server {
        Server::launch(Folder::Other(folder.to_owned()), args, faults, "")
    }

    fn launch(folder: Folder, args: &[&str], faults: &str, shell: &str) -> Server {
        let mut server = Server { process: Command::new("true").spawn().unwrap(), addresses: Vec::new(), folder };
        server.process.wait().unwrap();
        let mut command = command(server.folder());
        if !shell.is_empty() {
            let plain = command;
            command = Command::new("sh");
            command.arg("-c").arg(format!("{shell} && exec \"$@\"")).arg("sh");
            command.arg(plain.get_program()).args(plain.get_args());
            command.stdin(Stdio::null()).current_dir(server.folder()).env_remove("CAIRN_TOKEN");
        }
        command.env("FAILPOINTS", faults).args(["--listen", "127.0.0.1:0"]).args(args).stdout(Stdio::piped());
        command.stderr(std::fs::File::options().append(true).create(true).open(server.path("log")).unwrap());
        server.process = command.spawn().unwrap();
        let stdout = BufReader::new(server.process.stdout.take().unwrap());
        let listens = args.iter().filter(|arg| **arg == "--listen").count() + 1;
        server.addresses = stdout.lines().take(listens).map(Result::unwrap).collect();
        assert_eq!(server.addresses.len(), listens, "{}", server.log());
        server
    }

    pub fn folder(&self) -> &Path {
        match &self.folder {
            Folder::Own(folder) => folder.path(),
            Folder::Other(folder) => folder,
        }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder().join(name)
    }

    pub fn log(&self) -> String {
        std::fs::read_to_string(self.path("log")).unwrap()
    }

    pub fn target(&self) -> Target {
        Target { address: self.addresses[0].clone(), ..Default::default() }
    }

    pub async fn connect(&self) -> Connection {
        Connection::open(&self.target()).await.unwrap()
    }

    /// A connection, with the example models uploaded.
    pub async fn ready(&self) -> Connection {
        let mut server = self.connect().await;
        let files = ["cone-small.glb", "stick.glb", "cube.glb"].map(content);
        server.upload(&files.into_iter().map(|bytes| (sha256(&bytes), bytes.into())).collect()).await.unwrap();
        server
    }

    /// A connection whose uploads bypass the server, so that none of its faults happens.
    pub async fn ready_without_faults(&self) -> Connection {
        for name in ["cone-small.glb", "stick.glb"] {
            std::fs::copy(asset(name), self.path("data/assets").join(sha256(&content(name)))).unwrap();
        }
        self.connect().await
    }

    /// Asks the server to end.
    pub fn signal(&self, signal: &str) {
        assert!(Command::new("kill").args([signal, &self.process.id().to_string()]).status().unwrap().success());
    }

    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// Whether its process runs.
    pub fn is_running(&mut self) -> bool {
        self.process.try_wait().unwrap().is_none()
    }

    /// Waits for its end. Returns the exit code.
    pub fn wait(&mut self) -> Option<i32> {
        self.process.wait().unwrap().code()
    }

    /// The most memory that its process has had so far, bytes.
    pub fn peak_memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.process.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() << 10
    }

    /// Its child processes.
    pub fn children(&self) -> Vec<u32> {
        children(self.process.id())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
        if std::thread::panicking() {
            eprintln!("{}", self.log());
        }
    }
}

/// A plain channel, for other services.
pub async fn channel(address: &str) -> Channel {
    Endpoint::from_shared(address.to_owned()).unwrap().connect().await.unwrap()
}

/// `cairn serve` with its data in this folder.
pub fn command(folder: &Path) -> Command {
    let mut command = Command::new(PROGRAM);
    command.arg("serve").arg("--data").arg(folder.join("data")).stdin(Stdio::null()).current_dir(folder);
    command.env_remove("CAIRN_TOKEN");
    command
}

/// Child processes, on Linux.
pub fn children(process: u32) -> Vec<u32> {
    let mut found = Vec::new();
    for task in std::fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten() {
        let children = std::fs::read_to_string(task.path().join("children")).unwrap_or_default();
        found.extend(children.split_whitespace().map(|id| id.parse::<u32>().unwrap()));
    }
    found
}

pub fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets").join(name)
}

pub fn content(name: &str) -> Vec<u8> {
    std::fs::read(asset(name)).unwrap()
}

pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Sticks in a small cone, with the names of the command line in the examples' folder.
pub fn spec(assignments: &[&str]) -> BakeSpec {
    let mut tree = SceneTree::from_message(&Scene {
        control_mesh: Some(ControlMesh { path: "cone-small.glb".into() }),
        props: vec![Prop { path: "stick.glb".into(), ..Default::default() }],
        ..Default::default()
    });
    for assignment in ["accuracy=draft"].iter().chain(assignments) {
        tree.set(assignment).unwrap();
    }
    let asset = |name: &str| AssetReference { uri: name.into(), sha256: sha256(&content(name)) };
    let assets = ["cone-small.glb", "stick.glb"].map(asset).into();
    BakeSpec { scene: Some(tree.to_message()), assets, ..Default::default() }
}

/// A bake of a third of a second.
pub fn short(seed: i64) -> BakeSpec {
    spec(&["fill.count=12", &format!("seed={seed}")])
}

/// A bake of hours, in very small steps.
pub fn endless(seed: i64) -> BakeSpec {
    spec(&["fill.count=12", "physics.step_natural=0.000001", &format!("seed={seed}")])
}

/// A bake of some seconds, with many frames.
pub fn long(seed: i64) -> BakeSpec {
    spec(&["fill.count=60", "fill.settle=1000", &format!("seed={seed}")])
}

pub fn request(spec: BakeSpec) -> BakeRequest {
    BakeRequest { spec: Some(spec), ..Default::default() }
}

/// All events, and the end of the stream.
pub async fn events<T: Event>(stream: Streaming<T>) -> (Vec<BakeEvent>, Result<(), Status>) {
    take(stream, usize::MAX).await
}

/// The first numbered events; then the stream is dropped.
pub async fn take<T: Event>(mut stream: Streaming<T>, most: usize) -> (Vec<BakeEvent>, Result<(), Status>) {
    let mut events = Vec::new();
    loop {
        match stream.message().await {
            Ok(Some(message)) => events.push(message.event()),
            Ok(None) => return (events, Ok(())),
            Err(status) => return (events, Err(status)),
        }
        if numbered(&events).len() >= most {
            return (events, Ok(()));
        }
    }
}

/// The responses of the streams of events.
pub trait Event {
    fn event(self) -> BakeEvent;
}

impl Event for cairn_wire::proto::BakeResponse {
    fn event(self) -> BakeEvent {
        self.event.unwrap()
    }
}

impl Event for cairn_wire::proto::WatchBakeResponse {
    fn event(self) -> BakeEvent {
        self.event.unwrap()
    }
}

/// The logged events, without progress.
pub fn numbered(events: &[BakeEvent]) -> Vec<&BakeEvent> {
    events.iter().filter(|event| event.sequence_number > 0).collect()
}

/// Events from this number on, none lost or doubled.
#[track_caller]
pub fn assert_contiguous(events: &[BakeEvent], from: i64) {
    for (event, number) in numbered(events).iter().zip(from..) {
        assert_eq!(event.sequence_number, number);
    }
}

pub fn accepted_id(events: &[BakeEvent]) -> String {
    match &events[0].kind {
        Some(Kind::Accepted(accepted)) => accepted.bake_id.clone(),
        other => panic!("the first event says that the bake was accepted, not {other:?}"),
    }
}

/// Starts a bake and leaves it. Returns its id.
pub async fn begin(server: &mut Connection, spec: BakeSpec) -> String {
    let stream = server.service.bake(request(spec)).await.unwrap().into_inner();
    accepted_id(&take(stream, 1).await.0)
}

pub async fn status(server: &mut Connection, id: &str) -> BakeStatus {
    let request = GetBakeRequest { bake_id: id.into() };
    server.service.get_bake(request).await.unwrap().into_inner().bake.unwrap()
}

pub async fn watch(server: &mut Connection, id: &str, from: i64) -> Streaming<cairn_wire::proto::WatchBakeResponse> {
    let request = WatchBakeRequest { bake_id: id.into(), from_sequence_number: from, frames: 0 };
    server.service.watch_bake(request).await.unwrap().into_inner()
}

/// Waits until a bake is in this state.
pub async fn until(server: &mut Connection, id: &str, state: BakeState) -> BakeStatus {
    for _ in 0..2000 {
        let status = status(server, id).await;
        if status.state() == state {
            return status;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("bake {id} never was {}", state.as_str_name());
}

/// A request with a deadline.
pub fn within<T>(timeout: Duration, message: T) -> Request<T> {
    let mut request = Request::new(message);
    request.set_timeout(timeout);
    request
}

/// The details of the error, if it has this reason.
#[track_caller]
pub fn assert_fault(status: &Status, code: Code, reason: &str) -> ErrorDetails {
    assert_eq!(status.code(), code, "{status:?}");
    let details = status.get_error_details();
    let info = details.error_info().expect("every error has an ErrorInfo");
    assert_eq!((info.reason.as_str(), info.domain.as_str()), (reason, "cairn"));
    details
}

/// Field paths of all reported problems.
pub fn fields(details: &ErrorDetails) -> Vec<String> {
    details.bad_request().iter().flat_map(|request| &request.field_violations).map(|v| v.field.clone()).collect()
}

/// Where each body is after all these frames: number -> position and rotation.
pub fn poses(events: &[BakeEvent]) -> BTreeMap<i32, ([f32; 3], [f32; 4])> {
    let mut poses = BTreeMap::new();
    for event in events {
        if let Some(Kind::Frame(frame)) = &event.kind {
            let (positions, rotations) = (frame.positions.chunks_exact(3), frame.rotations.chunks_exact(4));
            for ((id, p), r) in frame.body_indices.iter().zip(positions).zip(rotations) {
                poses.insert(*id, (p.try_into().unwrap(), r.try_into().unwrap()));
            }
        }
    }
    poses
}

/// A closed `.glb` sphere of `2 n^2` triangles.
pub fn sphere(n: u32) -> Vec<u8> {
    let mut data = Vec::new();
    for i in 0..=n {
        for j in 0..n {
            let (polar, around) = (
                f64::from(i) / f64::from(n) * std::f64::consts::PI,
                f64::from(j) / f64::from(n) * std::f64::consts::TAU,
            );
            let point = [polar.sin() * around.cos(), polar.cos(), polar.sin() * around.sin()];
            data.extend(point.iter().flat_map(|x| (*x as f32).to_le_bytes()));
        }
    }
    let points = data.len() / 12;
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let (a, b) = (i * n + j, i * n + (j + 1) % n);
        data.extend([a, b, a + n, b, b + n, a + n].into_iter().flat_map(u32::to_le_bytes));
    }
    let json = serde_json::json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "count": points, "type": "VEC3",
                "min": [-1, -1, -1], "max": [1, 1, 1]
            },
            { "bufferView": 1, "componentType": 5125, "count": 6 * n * n, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": points * 12 },
            { "buffer": 0, "byteOffset": points * 12, "byteLength": 24 * n * n }
        ],
        "buffers": [{ "byteLength": data.len() }]
    });
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
    [
        b"glTF\x02\0\0\0",
        &word(28 + text.len() + data.len())[..],
        &word(text.len()),
        b"JSON",
        &text,
        &word(data.len()),
        b"BIN\0",
        &data,
    ]
    .concat()
}
