//! Callers that mean harm: small attacks here, and all of them at once in `siege.rs`.

use crate::service::attacks;
use crate::service::server::{PROGRAM, Server, assert_fault, begin, channel, endless, events, request, short, until};
use crate::service::siege::resident;
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::{BakeState, DeleteBakeRequest, GetServerInfoRequest, PlanBakeRequest};
use std::io::{ErrorKind, Read};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Duration;
use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

/// A server with few handles and a token.
fn guarded(folder: &Path, shell: &str) -> Server {
    std::fs::write(folder.join("token"), "right").unwrap();
    Server::start_by_shell(folder, shell, &["--token-file", "token", "--workers", "2"])
}

async fn known(server: &Server) -> Connection {
    Connection::open(&Target { token: Some("right".into()), ..server.target() }).await.unwrap()
}

/// Of 256 handles, half are for connections, and half of these for those who have shown no token.
#[tokio::test]
async fn silent_connections_lock_nobody_out() {
    let folder = tempfile::tempdir().unwrap();
    let server = guarded(folder.path(), "ulimit -n 256");
    let mut anna = known(&server).await;
    let silent: Vec<TcpStream> = (0..300).filter_map(|_| TcpStream::connect(&server.addresses[0]).ok()).collect();
    anna.service.get_server_info(GetServerInfoRequest::default()).await.unwrap();
    let mut another = known(&server).await;
    another.service.get_server_info(GetServerInfoRequest::default()).await.unwrap();
    let mut health = HealthClient::new(channel(&format!("http://{}", server.addresses[0])).await);
    health.check(HealthCheckRequest::default()).await.unwrap();
    let has_ended = |mut stream: TcpStream| {
        stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
        loop {
            match stream.read(&mut [0; 64]) {
                Ok(0) => return true,
                Ok(_) => {}
                Err(error) => return !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut),
            }
        }
    };
    let left = silent.into_iter().filter(|stream| !has_ended(stream.try_clone().unwrap())).count();
    assert!(left <= 64, "{left} silent connections are left");
    assert!(!server.log().contains("data directory"), "{}", server.log());
}

/// A worker has no token, and is in the sandbox as far as there is one.
#[tokio::test]
async fn workers_inherit_no_token_and_are_in_a_sandbox() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start_by_shell(folder.path(), "export CAIRN_TOKEN=right", &["--workers", "1"]);
    let mut anna = known(&server).await;
    attacks::upload(&mut anna, &["cone-small.glb", "stick.glb"].map(crate::service::server::content)).await;
    let id = begin(&mut anna, endless(1)).await;
    until(&mut anna, &id, BakeState::Running).await;
    let has_sandbox = !server.log().contains("no whole sandbox");
    let worker = process_of_bake(&server).await;
    for _ in 0..500 {
        let status = std::fs::read_to_string(format!("/proc/{worker}/status")).unwrap();
        if !has_sandbox || status.contains("Seccomp:\t2") {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let read = |name: &str| std::fs::read_to_string(format!("/proc/{worker}/{name}")).unwrap();
    assert!(!has_sandbox || read("status").contains("Seccomp:\t2") && read("status").contains("NoNewPrivs:\t1"));
    assert!(!read("environ").contains("CAIRN_TOKEN") && !read("cmdline").contains("right"));
}

/// The process of the bake that runs, once it is there.
async fn process_of_bake(server: &Server) -> u32 {
    let command = |process: &u32| std::fs::read_to_string(format!("/proc/{process}/cmdline")).unwrap_or_default();
    for _ in 0..500 {
        let children = server.children();
        if let Some(bake) = children.into_iter().find(|process| command(process).contains("worker\0bake")) {
            return bake;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("no bake runs")
}

/// How `nice` a process is.
fn nice(process: u32) -> i32 {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    // The name before may have spaces.
    stat.rsplit(") ").next().unwrap().split(' ').nth(16).unwrap().parse().unwrap()
}

#[tokio::test]
async fn bakes_have_a_lower_priority_than_the_server() {
    let server = Server::start(&["--workers", "1"]);
    let mut anna = server.ready().await;
    let id = begin(&mut anna, endless(1)).await;
    until(&mut anna, &id, BakeState::Running).await;
    let bake = process_of_bake(&server).await;
    let wanted = (nice(server.id()) + 10).min(19);
    // It lowers it when it begins.
    for _ in 0..500 {
        if nice(bake) == wanted {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    assert_eq!(nice(bake), wanted);
}

/// What large requests took, and bakes that are gone, is the system's again.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[tokio::test]
async fn memory_goes_back_to_the_system() {
    let server = Server::start(&["--workers", "2"]);
    let mut anna = server.ready().await;
    let once = begin(&mut anna, short(0)).await;
    until(&mut anna, &once, BakeState::Succeeded).await;
    let before = resident(server.id());
    let mut channel = channel(&format!("http://{}", server.addresses[0])).await;
    // Of 24 MiB, which take that much again when they are decoded.
    let labels = attacks::labels(24 << 20);
    for _ in 0..4 {
        let code = labels.send(&mut channel, None).await;
        assert_eq!(code, Some(Code::InvalidArgument));
    }
    anna.service.delete_bake(DeleteBakeRequest { bake_id: once }).await.unwrap();
    // Soon after, not at once.
    let most = before + (16 << 20);
    for _ in 0..500 {
        if resident(server.id()) < most {
            return;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("{} MiB before, {} MiB after", before >> 20, resident(server.id()) >> 20);
}

/// A server whose bakes, not its plans, are this shell command.
fn with_bakes(folder: &Path, shell: &str, bake: &str, args: &[&str]) -> Server {
    let program = folder.join("worker.sh");
    let script = format!("#!/bin/sh\nif [ $2 = bake ]; then {bake}; fi\nexec {PROGRAM} \"$@\"\n");
    std::fs::write(&program, script).unwrap();
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    let program = ["--worker-program", program.to_str().unwrap(), "--workers", "1"];
    Server::start_by_shell(folder, shell, &[&program, args].concat())
}

/// Below `ulimit -v`, bakes have that much; one that needs more says the figure.
#[tokio::test]
async fn a_bake_takes_the_lower_limit_of_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    let hungry = "echo memory allocation of 9999 bytes failed >&2; kill -ABRT $$";
    let server = with_bakes(folder.path(), "ulimit -v 1500000", hungry, &[]);
    let mut anna = server.ready().await;
    let info = anna.service.get_server_info(GetServerInfoRequest::default()).await.unwrap().into_inner();
    assert_eq!(info.limits.unwrap().max_bake_memory_bytes, 1_500_000 << 10);
    let (_, end) = events(anna.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    let end = end.unwrap_err();
    assert_fault(&end, Code::ResourceExhausted, "MEMORY_LIMIT");
    assert!(end.message().contains("1464 MiB"), "{}", end.message());
}

/// Takes 512 MiB, and goes on for some seconds: it does not end with the server, as a worker does.
const GREEDY: &str = "exec awk 'BEGIN { a = \"x\"; for (n = 0; n < 29; n++) a = a a; for (n = 0; n < 1e8; n++); }'";

/// A bake that grows beyond what all may have ends, and the server goes on.
#[tokio::test]
async fn all_processes_share_one_budget() {
    let folder = tempfile::tempdir().unwrap();
    let server = with_bakes(folder.path(), "true", GREEDY, &["--memory-mib", "300"]);
    let mut anna = server.ready().await;
    let (_, end) = events(anna.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    assert_fault(&end.unwrap_err(), Code::ResourceExhausted, "MEMORY_TOGETHER");
    assert!(server.children().is_empty());
    assert_eq!(server.log().matches("exceed their memory").count(), 1, "it is said once");
    begin(&mut anna, short(2)).await;
}

/// Small files that stand for much are refused by what they are.
#[tokio::test]
async fn small_files_that_stand_for_much_are_refused() {
    let server = Server::start(&["--workers", "1"]);
    let mut anna = server.ready().await;
    for bomb in attacks::bombs(attacks::BombSize::Small) {
        let spec = Some(bomb.upload(&mut anna).await);
        let refused = anna.service.plan_bake(PlanBakeRequest { spec }).await.expect_err(bomb.name);
        assert!(refused.code() == Code::InvalidArgument && refused.message().contains(bomb.says), "{refused:?}");
    }
}
