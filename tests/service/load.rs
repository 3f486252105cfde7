//! More callers than the server serves at once.

use crate::service::server::{
    Server, accepted_id, assert_fault, begin, channel, endless, events, fields, request, short, until,
};
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::{BakeState, ListBakesRequest, PlanBakeRequest};
use std::collections::BTreeSet;
use std::time::Duration;
use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

#[tokio::test]
async fn a_full_queue_refuses_and_says_when_to_come_back() {
    let server = Server::start(&["--workers", "1", "--queue", "1"]);
    let mut connection = server.ready().await;
    let first = begin(&mut connection, endless(1)).await;
    begin(&mut connection, endless(2)).await;
    let refused = connection.service.bake(request(endless(3))).await.unwrap_err();
    let details = assert_fault(&refused, Code::ResourceExhausted, "QUEUE_FULL");
    assert!(details.retry_info().unwrap().retry_delay.is_some() && fields(&details).is_empty());
    // A request for a running bake is not refused.
    assert_eq!(begin(&mut connection, endless(1)).await, first);
    // A plan does not need a bake's permit.
    let plan = cairn_wire::proto::PlanBakeRequest { spec: Some(endless(3)) };
    connection.service.plan_bake(plan).await.unwrap();
}

/// A caller that has used its whole quota leaves room for others. Without names, callers differ by their addresses.
#[tokio::test]
async fn one_caller_leaves_places_to_others() {
    let folder = tempfile::tempdir().unwrap();
    let socket = format!("unix:{}", folder.path().join("socket").display());
    let server = Server::start_in(folder.path(), &["--workers", "1", "--queue", "7", "--listen", &socket]);
    let mut greedy = server.ready().await;
    let mut other = Connection::open(&Target { address: socket, ..Default::default() }).await.unwrap();
    let mut held = Vec::new();
    let refused = loop {
        match greedy.service.bake(request(endless(held.len() as i64))).await {
            Ok(stream) => held.push(accepted_id(&crate::service::server::take(stream.into_inner(), 1).await.0)),
            Err(refused) => break refused,
        }
    };
    assert_fault(&refused, Code::ResourceExhausted, "QUEUE_FULL");
    assert_eq!(held.len(), 6, "three quarters of eight places");
    for seed in 100..102 {
        begin(&mut other, endless(seed)).await;
    }
    let refused = other.service.bake(request(endless(102))).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "QUEUE_FULL");
    // A released permit can be taken again.
    greedy.cancel(&held[0]).await.unwrap();
    begin(&mut other, endless(102)).await;
}

/// Two endless plans of one caller do not block another caller's plans.
#[tokio::test]
async fn heavy_plans_leave_planning_to_others() {
    let folder = tempfile::tempdir().unwrap();
    let socket = format!("unix:{}", folder.path().join("socket").display());
    let server = crate::service::faults::server_with(folder.path(), "", &["--queue", "8", "--listen", &socket]);
    let greedy = server.ready().await;
    let mut other = Connection::open(&Target { address: socket, ..Default::default() }).await.unwrap();
    std::fs::write(folder.path().join("plan.faults"), "message-write=sleep(100000)").unwrap();
    let plan = |seed: i64| PlanBakeRequest { spec: Some(short(seed)) };
    let heavy: Vec<_> = (0..2)
        .map(|seed| {
            let mut service = greedy.service.clone();
            tokio::spawn(async move { service.plan_bake(plan(seed)).await })
        })
        .collect();
    // It has read its faults once the shell has become the worker.
    let command = |process: u32| std::fs::read_to_string(format!("/proc/{process}/cmdline")).unwrap_or_default();
    while !server.children().into_iter().any(|process| command(process).contains("cairn\0worker\0plan")) {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    std::fs::remove_file(folder.path().join("plan.faults")).unwrap();
    other.service.plan_bake(plan(2)).await.unwrap();
    assert!(heavy.iter().all(|plan| !plan.is_finished()), "they are planned still, or wait for that");
}

/// A thousand simultaneous callers: as many as there are permits are served, each once; the others are refused.
#[tokio::test(flavor = "multi_thread")]
async fn a_thousand_callers() {
    const CALLERS: usize = 1000;
    /// The quota of one caller, with two workers and a queue of eight. All calls are of one caller.
    const PLACES: usize = 8;
    let server = Server::start(&["--workers", "2", "--queue", "8"]);
    let mut connection = server.ready().await;
    // The permits are held until all have called.
    let mut ids = BTreeSet::new();
    for seed in 0..PLACES as i64 - 4 {
        ids.insert(begin(&mut connection, endless(seed)).await);
    }
    let address = format!("http://{}", server.addresses[0]);
    let mut health = HealthClient::new(channel(&address).await);
    let calls: Vec<_> = (0..CALLERS)
        .map(|seed| {
            let mut service = connection.service.clone();
            tokio::spawn(async move { service.bake(request(endless(100 + seed as i64))).await })
        })
        .collect();
    let mut refused = 0;
    let mut streams = Vec::new();
    for (number, call) in calls.into_iter().enumerate() {
        match call.await.unwrap() {
            Ok(stream) => streams.push(stream.into_inner()),
            Err(status) => {
                assert_fault(&status, Code::ResourceExhausted, "QUEUE_FULL");
                refused += 1;
            }
        }
        if number % 100 == 0 {
            let request = HealthCheckRequest { service: "cairn.v1.PileService".into() };
            assert_eq!(health.check(request).await.unwrap().into_inner().status(), ServingStatus::Serving);
        }
    }
    assert_eq!((streams.len(), refused), (4, CALLERS - 4));
    assert_eq!(server.children().len(), 2, "as many processes as workers");
    for stream in streams {
        ids.insert(accepted_id(&crate::service::server::take(stream, 1).await.0));
    }
    let list = connection.service.list_bakes(ListBakesRequest::default()).await.unwrap().into_inner().bakes;
    assert_eq!(list.iter().map(|bake| bake.bake_id.clone()).collect::<BTreeSet<_>>(), ids);
}

/// A hundred callers of the same pile: one bake.
#[tokio::test(flavor = "multi_thread")]
async fn callers_of_the_same_pile_share_it() {
    let server = Server::start(&["--workers", "1", "--queue", "0"]);
    let connection = server.ready().await;
    let calls: Vec<_> = (0..100)
        .map(|_| {
            let mut service = connection.service.clone();
            tokio::spawn(async move { events(service.bake(request(short(1))).await.unwrap().into_inner()).await })
        })
        .collect();
    let mut hashes = BTreeSet::new();
    for call in calls {
        let (answer, end) = call.await.unwrap();
        end.unwrap();
        crate::service::server::assert_contiguous(&answer, 1);
        hashes.insert(accepted_id(&answer));
    }
    assert_eq!(hashes.len(), 1);
    assert_eq!(server.log().matches("started").count(), 1, "{}", server.log());
}

/// Waiting bakes start in the order of the requests.
#[tokio::test]
async fn the_queue_keeps_its_order() {
    let server = Server::start(&["--workers", "1"]);
    let mut connection = server.ready().await;
    let mut ids = Vec::new();
    for seed in 1..=4 {
        ids.push(begin(&mut connection, short(seed)).await);
    }
    let mut starts = Vec::new();
    for id in &ids {
        let time = until(&mut connection, id, BakeState::Succeeded).await.start_time.unwrap();
        starts.push((time.seconds, time.nanos));
    }
    assert!(starts.is_sorted());
}
