//! Ends of bakes and servers. Long: cancelled, past their deadline, abandoned by their caller, killed and restarted.

use crate::service::server::{
    Server, accepted_id, assert_contiguous, assert_fault, begin, endless, events, long, numbered, request, short,
    status, take, until, watch, within,
};
use cairn_service::api::pile_service_client::PileServiceClient;
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{
    Artifact, BakeEvent, BakeRequest, BakeResponse, BakeSpec, BakeState, BakeStatus, CancelBakeRequest,
    WatchBakeRequest, WatchBakeResponse,
};
use prost::Message;
use std::time::{Duration, Instant};
use tonic::transport::Endpoint;
use tonic::{Code, Status, Streaming};

#[track_caller]
fn assert_failed(status: &BakeStatus, state: BakeState, reason: &str) {
    assert_eq!(status.state(), state, "{status:?}");
    assert_eq!(status.failure.as_ref().unwrap().reason, reason);
}

#[tokio::test]
async fn cancel_ends_the_physics() {
    let server = Server::start(&["--workers", "1"]);
    let mut connection = server.ready().await;
    let running = connection.service.bake(request(endless(1))).await.unwrap().into_inner();
    let queued = begin(&mut connection, endless(2)).await;
    let id = {
        let mut watched = connection.clone();
        let id = watched.service.list_bakes(cairn_wire::proto::ListBakesRequest::default()).await.unwrap().into_inner();
        id.bakes.last().unwrap().bake_id.clone()
    };
    until(&mut connection, &id, BakeState::Running).await;
    assert_eq!(status(&mut connection, &queued).await.state(), BakeState::Queued);
    for id in [&queued, &id] {
        let request = CancelBakeRequest { bake_id: id.clone() };
        let bake = connection.service.cancel_bake(request.clone()).await.unwrap().into_inner().bake.unwrap();
        assert_failed(&bake, BakeState::Cancelled, "BAKE_CANCELLED");
        // Once more does no harm.
        connection.service.cancel_bake(request).await.unwrap();
    }
    assert!(server.children().is_empty(), "the processes are gone when the answer comes");
    let (_, end) = events(running).await;
    assert_fault(&end.unwrap_err(), Code::Cancelled, "BAKE_CANCELLED");

    // The worker is free, and the same request starts again.
    let again = begin(&mut connection, endless(1)).await;
    assert_eq!(again, id);
    until(&mut connection, &again, BakeState::Running).await;
}

/// Of many cancelled bakes, the latest thousand are kept; bakes with a result stay.
#[tokio::test]
async fn bakes_without_a_result_are_forgotten_in_the_end() {
    let mut server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (received, _) = events(connection.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    server.signal("-KILL");
    server.wait();
    let cancelled = |number: i64| {
        let mut status = BakeStatus { bake_id: format!("{number:064x}"), ..Default::default() };
        status.create_time = Some(prost_types::Timestamp { seconds: number, nanos: 0 });
        status.set_state(BakeState::Cancelled);
        status
    };
    for status in (1..=1010).map(cancelled) {
        let folder = server.path("data/bakes").join(&status.bake_id);
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(folder.join("status.binpb"), status.encode_to_vec()).unwrap();
    }
    let next = Server::start_in(server.folder(), &[]);
    let mut connection = next.connect().await;
    let folders = || std::fs::read_dir(next.path("data/bakes")).unwrap().count();
    for _ in 0..3000 {
        if folders() <= 1001 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    assert_eq!(folders(), 1001);
    assert_eq!(status(&mut connection, &accepted_id(&received)).await.state(), BakeState::Succeeded);
    assert_eq!(status(&mut connection, &cancelled(11).bake_id).await.state(), BakeState::Cancelled);
    let oldest = cairn_wire::proto::GetBakeRequest { bake_id: cancelled(10).bake_id };
    assert_eq!(connection.service.get_bake(oldest).await.unwrap_err().code(), Code::NotFound);
}

/// Deadlines to try, shortest first. tonic ends a call whose answer has not begun by its deadline, at both ends: on
/// a busy machine, only a longer one leaves a bake the time to be planned.
fn deadlines() -> impl Iterator<Item = Duration> {
    (0..9).map(|doubled| Duration::from_millis(700 << doubled))
}

/// Whether a call ended before its answer began.
#[track_caller]
fn is_too_short(status: &Status) -> bool {
    assert!(matches!(status.code(), Code::DeadlineExceeded | Code::Cancelled), "{status:?}");
    true
}

#[tokio::test]
async fn the_deadline_of_a_bake_ends_the_physics() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    for (seed, deadline) in (1..).zip(deadlines()) {
        let stream = match connection.service.bake(within(deadline, ending(endless(seed)))).await {
            Err(status) if is_too_short(&status) => continue,
            stream => stream.unwrap().into_inner(),
        };
        let (received, end) = events(stream).await;
        assert_eq!(end.unwrap_err().code(), Code::DeadlineExceeded);
        if !received.iter().any(|event| matches!(event.kind, Some(Kind::Progress(_)))) {
            continue; // it had no time to begin
        }
        let ended = until(&mut connection, &accepted_id(&received), BakeState::Failed).await;
        assert_failed(&ended, BakeState::Failed, "DEADLINE");
        assert!(server.children().is_empty());
        return;
    }
    panic!("no deadline was long enough");
}

/// Libraries set deadlines on every call; they end only the call.
#[tokio::test]
async fn a_deadline_ends_the_call_alone_by_default() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    for (seed, deadline) in (1..).zip(deadlines()) {
        let stream = match connection.service.bake(within(deadline, request(endless(seed)))).await {
            Err(status) if is_too_short(&status) => continue,
            stream => stream.unwrap().into_inner(),
        };
        let (received, end) = events(stream).await;
        assert_eq!(end.unwrap_err().code(), Code::DeadlineExceeded);
        until(&mut connection, &accepted_id(&received), BakeState::Running).await;
        return;
    }
    panic!("no deadline was long enough");
}

/// A bake that its call's deadline ends.
fn ending(spec: BakeSpec) -> BakeRequest {
    BakeRequest { deadline_ends_bake: true, ..request(spec) }
}

#[tokio::test]
async fn the_latest_deadline_counts_and_that_of_a_watcher_does_not() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (id, brief) = with_two_callers(&mut connection).await;
    let watched = watch_within_deadline(&mut connection, &id).await;
    assert_eq!(events(watched).await.1.unwrap_err().code(), Code::DeadlineExceeded);
    assert_eq!(events(brief).await.1.unwrap_err().code(), Code::DeadlineExceeded);
    // Both deadlines have passed, and the simulation continues.
    until(&mut connection, &id, BakeState::Running).await;
    let mut live = watch(&mut connection, &id, 1).await;
    let mut progress = 0;
    // The first one may be older.
    while progress < 2 {
        let event = live.message().await.unwrap().expect("the stream goes on").event.unwrap();
        progress += i32::from(matches!(event.kind, Some(Kind::Progress(_))));
    }
    assert_eq!(status(&mut connection, &id).await.state(), BakeState::Running);
}

/// A bake started by a caller with a deadline and joined in time by one without, and the first caller's stream.
async fn with_two_callers(connection: &mut Connection) -> (String, Streaming<BakeResponse>) {
    for (seed, deadline) in (1..).zip(deadlines()) {
        // The server's own clock of the deadline starts later.
        let began = Instant::now();
        let brief = match connection.service.bake(within(deadline, ending(endless(seed)))).await {
            Err(status) if is_too_short(&status) => continue,
            stream => stream.unwrap().into_inner(),
        };
        let id = begin(connection, endless(seed)).await;
        if began.elapsed() < deadline {
            return (id, brief);
        }
        connection.service.cancel_bake(CancelBakeRequest { bake_id: id }).await.unwrap();
    }
    panic!("no deadline was long enough");
}

/// A watcher's stream that will end by its deadline.
async fn watch_within_deadline(connection: &mut Connection, id: &str) -> Streaming<WatchBakeResponse> {
    let wanted = WatchBakeRequest { bake_id: id.to_owned(), ..Default::default() };
    for deadline in deadlines() {
        match connection.service.watch_bake(within(deadline, wanted.clone())).await {
            Err(status) if is_too_short(&status) => {}
            stream => return stream.unwrap().into_inner(),
        }
    }
    panic!("no deadline was long enough");
}

#[tokio::test]
async fn who_comes_back_finds_the_place() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let stream = connection.service.bake(request(long(1))).await.unwrap().into_inner();
    let (mut received, _) = take(stream, 30).await;
    let id = accepted_id(&received);
    drop(connection);
    assert_eq!(server.children().len(), 1, "the bake goes on");

    // A second caller leaves, too; a third stays.
    for most in [50, usize::MAX] {
        let mut connection = server.connect().await;
        let from = numbered(&received).len() as i64 + 1;
        let (more, end) = take(watch(&mut connection, &id, from).await, most).await;
        end.unwrap();
        received.extend(more);
    }
    assert_contiguous(&received, 1);
    let mut connection = server.connect().await;
    let all = events(watch(&mut connection, &id, 1).await).await.0;
    assert_eq!(numbered(&received), numbered(&all));
}

#[tokio::test]
async fn a_reader_that_stands_still_holds_up_nothing() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    // With small buffers and many frames, unread events stay on the server.
    let endpoint = Endpoint::from_shared(format!("http://{}", server.addresses[0])).unwrap();
    let channel = endpoint.initial_stream_window_size(4096).initial_connection_window_size(4096).connect_lazy();
    let mut slow = PileServiceClient::new(channel);
    let mut spec = long(1);
    spec.scene.as_mut().unwrap().output.get_or_insert_default().fps = Some(1000.0);
    let stalled = slow.bake(request(spec.clone())).await.unwrap().into_inner();
    let (live, end) = events(connection.service.bake(request(spec)).await.unwrap().into_inner()).await;
    end.unwrap();
    // The bake is done, and nothing was read until now.
    assert_eq!(status(&mut connection, &accepted_id(&live)).await.state(), BakeState::Succeeded);
    let (received, end) = events(stalled).await;
    end.unwrap();
    assert_contiguous(&received, 1);
    assert_eq!(numbered(&received), numbered(&live));
    let progress = |events: &[BakeEvent]| events.len() - numbered(events).len();
    assert!(
        progress(&received) < progress(&live),
        "{} of {}: what is past is not received",
        progress(&received),
        progress(&live)
    );
}

#[tokio::test]
async fn a_killed_server_is_taken_over() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = Server::start_in(folder.path(), &["--workers", "1"]);
    let mut connection = server.ready().await;
    let finished = connection.service.bake(request(short(1))).await.unwrap().into_inner();
    let finished = events(finished).await.0;
    let stream = connection.service.bake(request(long(1))).await.unwrap().into_inner();
    let (mut received, _) = take(stream, 30).await;
    let id = accepted_id(&received);
    let queued = begin(&mut connection, short(2)).await;
    let workers = server.children();
    assert_eq!(workers.len(), 1);
    server.signal("-KILL");
    server.wait();
    for worker in workers {
        while std::fs::read_to_string(format!("/proc/{worker}/stat")).is_ok_and(|stat| !stat.contains(") Z ")) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    let server = Server::start_in(folder.path(), &["--workers", "1"]);
    let mut connection = server.connect().await;
    let kept = events(watch(&mut connection, &accepted_id(&finished), 1).await).await.0;
    assert_eq!(numbered(&kept), numbered(&finished));
    // The bake starts again with the same events, so that its watcher can resume.
    let (more, end) = events(watch(&mut connection, &id, 31).await).await;
    end.unwrap();
    received.extend(more);
    assert_contiguous(&received, 1);
    let all: Vec<BakeEvent> = events(watch(&mut connection, &id, 1).await).await.0;
    assert_eq!(numbered(&received), numbered(&all));
    until(&mut connection, &queued, BakeState::Succeeded).await;
}

#[tokio::test]
async fn unfinished_bakes_are_reported_if_so_configured() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = Server::start_in(folder.path(), &[]);
    let id = begin(&mut server.ready().await, endless(1)).await;
    server.signal("-KILL");
    server.wait();
    let server = Server::start_in(folder.path(), &["--unfinished", "fail"]);
    let mut connection = server.connect().await;
    assert_failed(&status(&mut connection, &id).await, BakeState::Failed, "SERVER_RESTARTED");
    let (received, end) = events(watch(&mut connection, &id, 1).await).await;
    assert_fault(&end.unwrap_err(), Code::Aborted, "SERVER_RESTARTED");
    assert_eq!(accepted_id(&received), id);
}

#[tokio::test]
async fn a_server_that_is_asked_to_end_lets_bakes_end() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = Server::start_in(folder.path(), &[]);
    let mut connection = server.ready().await;
    let stream = connection.service.bake(request(long(1))).await.unwrap().into_inner();
    server.signal("-TERM");
    let mut seed = 0;
    let refused = loop {
        seed += 1;
        match connection.service.bake(request(short(seed))).await {
            Err(status) => break status,
            Ok(_) => tokio::time::sleep(Duration::from_millis(10)).await,
        }
    };
    assert_fault(&refused, Code::Unavailable, "SHUTTING_DOWN");
    // A second caller of the same bake attaches; both fetch the result from the server that ends.
    let attached = connection.service.bake(request(long(1))).await.unwrap().into_inner();
    for stream in [stream, attached] {
        let (received, end) = events(stream).await;
        end.unwrap();
        assert_contiguous(&received, 1);
        assert!(!connection.download(&accepted_id(&received), Artifact::Result).await.unwrap().is_empty());
    }
    drop(connection);
    assert_eq!(server.wait(), Some(0), "{}", server.log());
}

/// Servers follow each other at one address, while bakes run and results are fetched: each command gets its file.
#[tokio::test(flavor = "multi_thread")]
async fn no_result_is_lost_when_servers_change() {
    const CALLERS: i64 = 20;
    let folder = tempfile::tempdir().unwrap();
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let args = ["--listen", &port, "--drain-seconds", "1", "--workers", "4"];
    let mut server = Server::start_in(folder.path(), &args);
    let mut connection = server.ready().await;
    let id = begin(&mut connection, short(1)).await;
    until(&mut connection, &id, BakeState::Succeeded).await;
    let expected = connection.download(&id, Artifact::Result).await.unwrap();
    let target = Target { address: port.clone(), ..Default::default() };
    let mut callers = tokio::task::JoinSet::new();
    for caller in 0..CALLERS {
        let (mut connection, first) = (Connection::open(&target).await.unwrap(), id.clone());
        callers.spawn(async move {
            let baked = connection.bake(request(short(100 + caller)), |_| ()).await.unwrap();
            (baked != first, connection.download(&baked, Artifact::Result).await.unwrap())
        });
        let (mut connection, first) = (Connection::open(&target).await.unwrap(), id.clone());
        callers.spawn(async move { (false, connection.download(&first, Artifact::Result).await.unwrap()) });
    }
    drop(connection);
    for _ in 0..2 {
        tokio::time::sleep(Duration::from_millis(300)).await;
        server.signal("-TERM");
        assert_eq!(server.wait(), Some(0), "{}", server.log());
        server = Server::start_in(folder.path(), &args);
    }
    let mut count = 0;
    while let Some(caller) = callers.join_next().await {
        let (is_own, file) = caller.unwrap();
        assert!(if is_own { file.starts_with(b"glTF") } else { file == expected });
        count += 1;
    }
    assert_eq!(count, 2 * CALLERS);
}

#[tokio::test]
async fn the_drain_has_a_deadline() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = Server::start_in(folder.path(), &["--drain-seconds", "0"]);
    let mut connection = server.ready().await;
    let stream = connection.service.bake(request(endless(1))).await.unwrap().into_inner();
    server.signal("-TERM");
    let (received, end) = events(stream).await;
    assert_fault(&end.unwrap_err(), Code::Unavailable, "SHUTTING_DOWN");
    drop(connection);
    assert_eq!(server.wait(), Some(0));
    let server = Server::start_in(folder.path(), &[]);
    until(&mut server.connect().await, &accepted_id(&received), BakeState::Running).await;
}

/// Only one server may use a data directory.
#[tokio::test]
async fn a_data_directory_has_one_server() {
    let server = Server::start(&[]);
    let second = crate::service::server::command(server.folder()).args(["--listen", "127.0.0.1:0"]).output().unwrap();
    assert_eq!(second.status.code(), Some(69));
    assert!(String::from_utf8_lossy(&second.stderr).contains("in use by another server"));
}

/// A program that was killed asks nothing: the system has released its lock.
#[tokio::test]
async fn a_server_that_nobody_uses_any_more_ends_with_its_bakes() {
    let folder = tempfile::tempdir().unwrap();
    let users = folder.path().join("users");
    std::fs::create_dir(&users).unwrap();
    let held = std::fs::File::create(users.join("1.lock")).unwrap();
    held.lock().unwrap();
    let args = ["--drain-seconds", "3600", "--users", users.to_str().unwrap()];
    let mut server = Server::start_in(folder.path(), &args);
    let mut connection = server.ready().await;
    let stream = connection.service.bake(request(endless(1))).await.unwrap().into_inner();
    // Longer than the server waits between two looks.
    tokio::time::sleep(Duration::from_secs(3)).await;
    assert!(server.is_running(), "a lock is held");
    drop(held);
    let (received, end) = events(stream).await;
    assert_fault(&end.unwrap_err(), Code::Unavailable, "SHUTTING_DOWN");
    drop(connection);
    assert_eq!(server.wait(), Some(0));
    let server = Server::start_in(folder.path(), &[]);
    until(&mut server.connect().await, &accepted_id(&received), BakeState::Running).await;
}
