//! Long: a fault at each place where the service writes, syncs, renames, starts a process or sends: the caller gets a
//! message, nothing is left behind, and the same call succeeds once the fault is gone. The places are named in
//! `server/`.

use crate::service::server::{
    PROGRAM, Server, accepted_id, assert_fault, command, content, events, request, sha256, short, status, watch,
};
use cairn_service::client::Connection;
use cairn_wire::proto::{
    Artifact, BakeEvent, BakeRequest, BakeResponse, BakeState, DeleteBakeRequest, DownloadResultRequest,
    ListBakesRequest, PlanBakeRequest,
};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use tonic::{Code, Status, Streaming};

const FULL: (Code, &str) = (Code::ResourceExhausted, "STORAGE_LIMIT");
const BROKEN: (Code, &str) = (Code::Internal, "DATA_DIRECTORY");
const KILLED: (Code, &str) = (Code::ResourceExhausted, "BAKE_KILLED");
const CRASHED: (Code, &str) = (Code::Internal, "BAKE_CRASHED");
const NOT_STARTED: (Code, &str) = (Code::Unavailable, "BAKE_NOT_STARTED");
const BUSY: (Code, &str) = (Code::ResourceExhausted, "TOO_MANY_CALLS");
const DAMAGED: (Code, &str) = (Code::DataLoss, "BAKE_DAMAGED");

/// Faults, and the messages to their callers.
type Case = (&'static str, (Code, &'static str));

/// One worker and no queue: a permit that is not released blocks everybody.
const ONE: [&str; 4] = ["--workers", "1", "--queue", "0"];

fn server_of_one(folder: &Path, faults: &str) -> Server {
    server_with(folder, faults, &ONE[2..])
}

/// A server with one worker whose processes have the faults in the file `TASK.faults`, if it exists. `args`: further
/// arguments.
pub fn server_with(folder: &Path, faults: &str, args: &[&str]) -> Server {
    let program = folder.join("worker.sh");
    let faults_of_task = folder.join("$2.faults");
    let script = format!(
        "#!/bin/sh\nunset FAILPOINTS\nif [ -e {0} ]; then export FAILPOINTS=\"$(cat {0})\"; fi\n\
         exec {PROGRAM} \"$@\"\n",
        faults_of_task.display()
    );
    std::fs::write(&program, script).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let args = [&["--workers", "1", "--worker-program", program.to_str().unwrap()], args].concat();
    Server::start_with_faults(folder, &args, faults)
}

/// A bake to its end.
async fn bake(connection: &mut Connection, request: BakeRequest) -> Result<Vec<BakeEvent>, Status> {
    let stream: Streaming<BakeResponse> = connection.service.bake(request).await?.into_inner();
    let (events, end) = events(stream).await;
    end.map(|()| events)
}

/// Names of all files and folders below.
fn below(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in folder.read_dir().into_iter().flatten().flatten() {
        found.push(entry.path().to_string_lossy().into_owned());
        found.extend(below(&entry.path()));
    }
    found
}

/// A fault leaves no process and no temporary file, and a failed bake leaves neither assets nor results.
#[track_caller]
fn assert_clean(server: &Server, faults: &str) {
    assert!(server.children().is_empty(), "{faults}: a process is left");
    assert!(below(&server.path("data/partial")).is_empty(), "{faults}: {:?}", below(&server.path("data/partial")));
    let bakes = below(&server.path("data/bakes"));
    let of_result =
        |name: &String| name.ends_with("/assets") || name.contains("result.") || name.ends_with("report.json");
    let left: Vec<_> = bakes.iter().filter(|name| name.ends_with(".part") || of_result(name)).collect();
    assert!(left.is_empty(), "{faults}: {left:?}");
}

/// The caller gets this message, which names no folder of the server.
#[track_caller]
fn assert_refused(server: &Server, faults: &str, answer: &Status, expected: (Code, &str)) {
    println!("{faults}: {}", answer.message());
    assert_fault(answer, expected.0, expected.1);
    let own = server.folder().file_name().unwrap().to_str().unwrap();
    let all = format!("{} {}", answer.message(), String::from_utf8_lossy(answer.details()));
    assert!(!all.contains(own) && !all.contains("data/") && !all.contains(".part"), "{faults}: {all}");
}

/// A fault of a bake's process, once while it plans and once while it bakes.
#[tokio::test]
async fn faults_of_the_process() {
    let folder = tempfile::tempdir().unwrap();
    let server = server_of_one(folder.path(), "");
    let mut connection = server.ready().await;
    let of_task: &[(&str, &[Case])] = &[
        (
            "accept",
            &[
                ("files-create=return(ENOSPC)", FULL),
                ("files-write=return(EIO)", BROKEN),
                ("files-sync=return(KILL)", KILLED),
                ("files-rename=panic", CRASHED),
                ("message-write=return(EPIPE)", CRASHED),
                ("message-write=return(KILL)", KILLED),
            ],
        ),
        (
            "bake",
            &[
                ("log-append=return(ENOSPC)", FULL),
                ("log-append=9*off->return(EIO)", BROKEN),
                ("log-append=9*off->return(KILL)", KILLED),
                ("log-append=9*off->panic", CRASHED),
                ("log-flush=return(ENOSPC)", FULL),
                ("log-flush=1*off->return(EIO)", BROKEN),
                ("log-sync=return(EIO)", BROKEN),
                ("files-create=return(ENOSPC)", FULL),
                ("files-write=return(ENOSPC)", FULL),
                ("files-sync=return(EIO)", BROKEN),
                ("files-rename=return(EIO)", BROKEN),
                ("files-sync-folder=return(EIO)", BROKEN),
                ("files-create=1*off->return(ENOSPC)", FULL),
                ("files-write=1*off->return(ENOSPC)", FULL),
                ("files-sync=1*off->return(KILL)", KILLED),
                ("files-rename=1*off->return(KILL)", KILLED),
                ("files-sync-folder=1*off->return(KILL)", KILLED),
                ("message-write=return(EPIPE)", CRASHED),
                ("message-write=5*off->return(EPIPE)", CRASHED),
                ("message-write=5*off->return(KILL)", KILLED),
            ],
        ),
    ];
    for (task, cases) in of_task {
        for (faults, expected) in *cases {
            let file = folder.path().join(format!("{task}.faults"));
            std::fs::write(&file, faults).unwrap();
            let answer = bake(&mut connection, request(short(1))).await.expect_err(faults);
            assert_refused(&server, faults, &answer, *expected);
            assert_clean(&server, faults);
            std::fs::remove_file(file).unwrap();
        }
        bake_again(&mut connection).await;
    }
    // A fault in the cache does not fail the bake.
    std::fs::write(folder.path().join("bake.faults"), "cache-write=return(ENOSPC)").unwrap();
    bake_again(&mut connection).await;
}

/// The failed bake succeeds now, and is deleted, so that the next one is new.
async fn bake_again(connection: &mut Connection) {
    let events = bake(connection, request(short(1))).await.unwrap();
    let bake_id = accepted_id(&events);
    assert_eq!(listed(connection).await, [bake_id.as_str()], "lost or doubled");
    connection.service.delete_bake(DeleteBakeRequest { bake_id }).await.unwrap();
}

/// A fault of the server itself, while it accepts a bake and while it runs one.
#[tokio::test]
async fn faults_of_the_server_end_one_bake() {
    for (faults, expected) in [
        ("store-remove=1*return(EIO)", BROKEN),
        ("store-folder=1*return(ENOSPC)", FULL),
        ("store-link=1*return(EIO)", BROKEN),
        // The request, and then the status each time that it changes.
        ("files-create=1*return(ENOSPC)", FULL),
        ("files-write=1*return(ENOSPC)", FULL),
        ("files-sync=1*return(EIO)", BROKEN),
        ("files-rename=1*return(EIO)", BROKEN),
        ("files-create=1*off->1*return(EMFILE)", BUSY),
        ("files-write=1*off->1*return(ENOSPC)", FULL),
        ("files-sync=2*off->1*return(EIO)", BROKEN),
        ("files-rename=2*off->1*return(EIO)", BROKEN),
        ("log-create=1*return(EMFILE)", BUSY),
        ("log-append=1*return(ENOSPC)", FULL),
        ("log-flush=1*return(ENOSPC)", FULL),
        ("worker-spawn=1*return(ENOMEM)", NOT_STARTED),
        ("worker-spawn=1*off->1*return(EMFILE)", NOT_STARTED),
        ("message-read=1*return(EIO)", CRASHED),
        ("message-read=3*off->1*return(EIO)", CRASHED),
        ("bake-task=1*panic", (Code::Internal, "INTERNAL")),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let server = server_of_one(folder.path(), faults);
        let mut connection = server.ready_without_faults().await;
        let answer = bake(&mut connection, request(short(1))).await.expect_err(faults);
        assert_refused(&server, faults, &answer, expected);
        assert_clean(&server, faults);
        let id = accepted_id(&bake(&mut connection, request(short(1))).await.expect(faults));
        assert_eq!(listed(&mut connection).await, [id], "{faults}: lost or doubled");
    }
}

/// Ids of all bakes that the server knows.
async fn listed(connection: &mut Connection) -> Vec<String> {
    let list = connection.service.list_bakes(ListBakesRequest::default()).await.unwrap().into_inner();
    list.bakes.into_iter().map(|bake| bake.bake_id).collect()
}

/// The success of a bake is saved last. If that fails, a request to the next server bakes it again.
#[tokio::test]
async fn an_end_that_cannot_be_written_down() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = server_of_one(folder.path(), "files-write=3*off->1*return(ENOSPC)");
    let mut connection = server.ready_without_faults().await;
    let id = accepted_id(&bake(&mut connection, request(short(1))).await.unwrap());
    connection.download(&id, Artifact::Result).await.unwrap();
    server.signal("-KILL");
    server.wait();
    let next = server_of_one(folder.path(), "");
    let mut connection = next.connect().await;
    events(watch(&mut connection, &id, 1).await).await.1.unwrap();
    connection.download(&id, Artifact::Result).await.unwrap();
}

#[tokio::test]
async fn faults_of_a_plan() {
    let plan = || PlanBakeRequest { spec: Some(short(1)) };
    for (faults, expected) in [
        ("store-folder=2*return(ENOSPC)", FULL),
        ("files-write=2*return(ENOSPC)", FULL),
        ("worker-spawn=2*return(ENOMEM)", NOT_STARTED),
        ("message-read=2*return(EIO)", CRASHED),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let server = server_of_one(folder.path(), faults);
        let mut connection = server.ready_without_faults().await;
        for _ in 0..2 {
            let answer = connection.service.plan_bake(plan()).await.expect_err(faults);
            assert_refused(&server, faults, &answer, expected);
            gone(&server).await;
            assert_clean(&server, faults);
        }
        connection.service.plan_bake(plan()).await.expect(faults);
    }
}

/// A plan's process is killed when its call ends, and reaped soon after.
async fn gone(server: &Server) {
    for _ in 0..500 {
        if server.children().is_empty() {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
}

/// More uploads fail than may be open at once.
#[tokio::test]
async fn faults_of_an_upload() {
    const FAILURES: usize = 20;
    let bytes = content("stick.glb");
    let files = [(sha256(&bytes), bytes.into())].into();
    for (place, what, expected) in [
        ("upload-create", "EMFILE", BUSY),
        ("upload-write", "ENOSPC", FULL),
        ("upload-sync", "EIO", BROKEN),
        ("upload-rename", "EIO", BROKEN),
        ("owner-write", "ENOSPC", FULL),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let faults = format!("{place}={FAILURES}*return({what})");
        let server = Server::start_with_faults(folder.path(), &ONE, &faults);
        let mut connection = server.connect().await;
        for _ in 0..FAILURES {
            let answer = connection.upload(&files).await.expect_err(&faults);
            assert_refused(&server, &faults, &answer, expected);
            assert!(below(&server.path("data/partial")).is_empty() && below(&server.path("data/assets")).is_empty());
        }
        connection.upload(&files).await.unwrap();
        assert_eq!(below(&server.path("data/assets")).len(), 1);
    }
}

/// A fault in reading shows whether the bake is damaged or the server only busy.
#[tokio::test]
async fn faults_of_those_who_read() {
    for (faults, expected) in [
        ("log-read=1*return(EIO)", DAMAGED),
        ("log-read=1*return(EMFILE)", BUSY),
        ("download-open=1*return(EMFILE)", BUSY),
        ("download-open=1*return(EIO)", DAMAGED),
        ("download-read=1*return(EIO)", DAMAGED),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let mut server = server_of_one(folder.path(), "");
        let mut connection = server.ready().await;
        let id = accepted_id(&bake(&mut connection, request(short(1))).await.unwrap());
        server.signal("-KILL");
        server.wait();
        let server = server_of_one(folder.path(), faults);
        let mut connection = server.connect().await;
        let answer = match faults.starts_with("log") {
            true => events(watch(&mut connection, &id, 1).await).await.1.expect_err(faults),
            false => connection.download(&id, Artifact::Result).await.expect_err(faults),
        };
        assert_refused(&server, faults, &answer, expected);
        let state = if expected == BUSY { BakeState::Succeeded } else { BakeState::Failed };
        assert_eq!(status(&mut connection, &id).await.state(), state, "{faults}");
        bake(&mut connection, request(short(1))).await.unwrap();
        connection.download(&id, Artifact::Result).await.unwrap();
    }
}

/// Broken streams release their permits: more of them break than one caller may have open.
#[tokio::test]
async fn streams_that_break_off() {
    const BROKEN_OFF: usize = 3200;
    let folder = tempfile::tempdir().unwrap();
    let server = server_of_one(folder.path(), &format!("stream-send={BROKEN_OFF}*return(EPIPE)"));
    let mut connection = server.ready().await;
    // It continues without its caller.
    bake(&mut connection, request(short(1))).await.unwrap();
    let id = listed(&mut connection).await.remove(0);
    crate::service::server::until(&mut connection, &id, BakeState::Succeeded).await;
    for _ in 0..BROKEN_OFF {
        let (answer, end) = events(watch(&mut connection, &id, 1).await).await;
        end.unwrap();
        if !answer.is_empty() {
            break;
        }
    }
    let answer = events(watch(&mut connection, &id, 1).await).await.0;
    assert!(answer.len() > 3);
}

/// So do downloads; and an incomplete file is reported, not taken for the whole.
#[tokio::test]
async fn downloads_that_break_off() {
    const BROKEN_OFF: usize = 3200;
    let folder = tempfile::tempdir().unwrap();
    let mut server = server_of_one(folder.path(), "");
    let id = accepted_id(&bake(&mut server.ready().await, request(short(1))).await.unwrap());
    server.signal("-KILL");
    server.wait();
    let more = BROKEN_OFF + 2;
    let server = server_of_one(folder.path(), &format!("stream-send={more}*return(EPIPE)"));
    let mut connection = server.connect().await;
    for _ in 0..BROKEN_OFF {
        let request = DownloadResultRequest { bake_id: id.clone(), ..Default::default() };
        let mut parts = connection.service.download_result(request).await.unwrap().into_inner();
        assert!(parts.message().await.unwrap().is_none(), "nothing arrives");
    }
    // A client repeats what has broken off, until it has the whole file.
    connection.download(&id, Artifact::Result).await.unwrap();
    assert_eq!(listed(&mut connection).await, [id]);
}

/// A bake that cannot be removed stays, and can be removed once the disk permits it.
#[tokio::test]
async fn a_bake_that_cannot_be_removed_stays() {
    let folder = tempfile::tempdir().unwrap();
    let server = server_of_one(folder.path(), "store-remove=1*off->1*return(EIO)");
    let mut connection = server.ready().await;
    let bake_id = accepted_id(&bake(&mut connection, request(short(1))).await.unwrap());
    let answer = connection.service.delete_bake(DeleteBakeRequest { bake_id: bake_id.clone() }).await.unwrap_err();
    assert_refused(&server, "store-remove", &answer, BROKEN);
    assert_eq!(status(&mut connection, &bake_id).await.state(), BakeState::Succeeded);
    connection.service.delete_bake(DeleteBakeRequest { bake_id }).await.unwrap();
    assert!(below(&server.path("data/bakes")).is_empty());
}

/// A server starts on a full disk, since the server makes room.
#[tokio::test]
async fn a_server_starts_on_a_full_disk() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = server_of_one(folder.path(), "");
    let mut connection = server.ready().await;
    let id = accepted_id(&bake(&mut connection, request(short(1))).await.unwrap());
    server.signal("-KILL");
    server.wait();
    std::fs::remove_file(folder.path().join("data/bakes").join(&id).join("result.glb")).unwrap();
    let server = server_of_one(folder.path(), "files-create=1*return(ENOSPC);clock-write=2*return(ENOSPC)");
    let mut connection = server.connect().await;
    assert_eq!(status(&mut connection, &id).await.failure.unwrap().reason, DAMAGED.1);
    bake(&mut connection, request(short(1))).await.unwrap();
}

/// A socket that every user could open does not stay.
#[test]
fn a_socket_whose_mode_cannot_be_set() {
    let folder = tempfile::tempdir().unwrap();
    let listen = format!("unix:{}", folder.path().join("socket").display());
    let mut command = command(folder.path());
    let done = command.args(["--listen", &listen]).env("FAILPOINTS", "listen-mode=return(EIO)").output().unwrap();
    assert_eq!(done.status.code(), Some(78), "{done:?}");
    assert!(!folder.path().join("socket").exists());
}

/// A data directory that cannot be created or locked is reported before the server listens; the next server starts.
#[test]
fn a_data_directory_that_cannot_be_opened() {
    let folder = tempfile::tempdir().unwrap();
    for (faults, reason) in [("store-open=return(ENOSPC)", "No space"), ("store-lock=return(EIO)", "nput/output")] {
        let done = command(folder.path()).args(["--listen", "127.0.0.1:0"]).env("FAILPOINTS", faults).output().unwrap();
        let answer = String::from_utf8(done.stderr).unwrap();
        assert!(done.status.code() == Some(69) && done.stdout.is_empty(), "{faults}: {answer}");
        assert!(
            answer.contains("data: ") && answer.contains(reason) && answer.contains("--data"),
            "{faults}: {answer}"
        );
    }
    Server::start_in(folder.path(), &[]);
}
