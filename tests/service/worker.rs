//! Bakes whose process misbehaves: only that bake is affected.

use crate::service::server::{
    PROGRAM, Server, accepted_id, assert_fault, begin, endless, events, request, short, status, until,
};
use cairn_wire::proto::{BakeState, CancelBakeRequest};
use std::os::unix::fs::PermissionsExt;
use tonic::Code;

/// A server whose workers plan normally but run this shell command for bakes, except for seed 2.
fn server_with(folder: &std::path::Path, bake: &str, args: &[&str]) -> Server {
    server_of(1, folder, bake, args)
}

fn server_of(workers: usize, folder: &std::path::Path, bake: &str, args: &[&str]) -> Server {
    let script = format!(
        "#!/bin/sh\nif [ $2 = bake ] && ! grep -q spared $3/spec.binpb; then {bake}; fi\nexec {PROGRAM} \"$@\"\n"
    );
    let program = folder.join("worker.sh");
    std::fs::write(&program, script).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let program = program.to_str().unwrap();
    Server::start_in(folder, &[&["--workers", &workers.to_string(), "--worker-program", program], args].concat())
}

/// The server measures how slow the machine is, once for all of its workers.
#[tokio::test]
async fn workers_know_how_slow_the_machine_is() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("arguments");
    let server = server_of(1, folder.path(), &format!("echo \"$*\" >> {}", log.display()), &[]);
    let mut connection = server.ready().await;
    for seed in 1.. {
        assert!(seed < 100, "it is never known");
        events(connection.service.bake(request(short(seed))).await.unwrap().into_inner()).await.1.unwrap();
        if std::fs::read_to_string(&log).unwrap().contains("--slowness ") {
            break;
        }
    }
}

/// A bake alone gets all cores; one that starts beside it gets its share.
#[tokio::test]
async fn bakes_share_the_cores() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("threads");
    let server =
        server_of(2, folder.path(), &format!("echo $RAYON_NUM_THREADS >> {0}; exec sleep 1000", log.display()), &[]);
    let mut connection = server.ready().await;
    let cores = std::thread::available_parallelism().unwrap().get();
    for (seed, threads) in [(1, vec![cores]), (2, vec![cores, (cores / 2).max(1)])] {
        begin(&mut connection, short(seed)).await;
        let wanted = threads.iter().map(|threads| format!("{threads}\n")).collect::<String>();
        while std::fs::read_to_string(&log).unwrap_or_default().len() < wanted.len() {
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
        assert_eq!(std::fs::read_to_string(&log).unwrap(), wanted);
    }
}

#[tokio::test]
async fn a_crash_is_internal_for_its_call_alone() {
    let folder = tempfile::tempdir().unwrap();
    let server = server_with(folder.path(), "echo the reason >&2; kill -SEGV $$", &[]);
    let mut connection = server.ready().await;
    let (answer, end) = events(connection.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    let status_told = end.unwrap_err();
    assert_fault(&status_told, Code::Internal, "BAKE_CRASHED");
    assert!(status_told.message().contains("the reason"), "{}", status_told.message());
    assert_eq!(status(&mut connection, &accepted_id(&answer)).await.state(), BakeState::Failed);

    let mut spared = short(2);
    spared.assets[0].uri = "spared.glb".into();
    spared.scene.as_mut().unwrap().control_mesh.as_mut().unwrap().path = "spared.glb".into();
    events(connection.service.bake(request(spared)).await.unwrap().into_inner()).await.1.unwrap();
}

/// Kills a worker, as the system does when memory runs out.
#[tokio::test]
async fn a_killed_worker_is_no_fault_of_ours() {
    let folder = tempfile::tempdir().unwrap();
    let server = server_with(folder.path(), "kill -KILL $$", &[]);
    let mut connection = server.ready().await;
    let (_, end) = events(connection.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    assert_fault(&end.unwrap_err(), Code::ResourceExhausted, "BAKE_KILLED");
}

#[tokio::test]
async fn what_does_not_return_is_ended() {
    let folder = tempfile::tempdir().unwrap();
    let server = server_with(folder.path(), "exec sleep 1000", &[]);
    let mut connection = server.ready().await;
    let id = begin(&mut connection, short(1)).await;
    until(&mut connection, &id, BakeState::Running).await;
    let request = CancelBakeRequest { bake_id: id.clone() };
    connection.service.cancel_bake(request).await.unwrap();
    assert!(server.children().is_empty());
}

#[tokio::test]
async fn time_and_memory_are_bounded() {
    let server = Server::start(&["--bake-seconds", "1", "--workers", "1"]);
    let mut connection = server.ready().await;
    let (_, end) = events(connection.service.bake(request(endless(1))).await.unwrap().into_inner()).await;
    assert_fault(&end.unwrap_err(), Code::DeadlineExceeded, "TIME_LIMIT");
    assert!(server.children().is_empty());

    // The kernel enforces the limit: further allocations fail.
    let folder = tempfile::tempdir().unwrap();
    let hungry = "echo memory allocation of 9999 bytes failed >&2; kill -ABRT $$";
    let server = server_with(folder.path(), hungry, &["--bake-memory-mib", "512"]);
    let mut connection = server.ready().await;
    let (_, end) = events(connection.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    assert_fault(&end.unwrap_err(), Code::ResourceExhausted, "MEMORY_LIMIT");
}

/// A mesh of a million triangles does not fit within the limit.
#[tokio::test]
async fn a_plan_is_bounded_as_well() {
    let server = Server::start(&["--bake-memory-mib", "64"]);
    let mut connection = server.ready().await;
    let large = crate::service::server::sphere(700);
    connection.upload(&[(crate::service::server::sha256(&large), large.clone().into())].into()).await.unwrap();
    let mut spec = short(1);
    spec.assets[0].sha256 = crate::service::server::sha256(&large);
    let refused = connection.service.bake(request(spec)).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "MEMORY_LIMIT");
}
