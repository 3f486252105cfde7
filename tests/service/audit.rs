//! The log line of each call.

use crate::service::callers::until_logged;
use crate::service::server::{Server, accepted_id, begin, endless, events, request, short};
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::PlanBakeRequest;
use tonic::Code;

/// The line of a stream has its final status and its bake.
#[tokio::test]
async fn a_stream_is_told_with_its_end() {
    let server = Server::start(&["--bake-seconds", "1"]);
    let mut connection = server.ready().await;
    let stream = connection.service.bake(request(short(1))).await.unwrap().into_inner();
    let (answer, end) = events(stream).await;
    if end.is_ok() {
        until_logged(&server, &format!("call=\"Bake\" status=\"0\" bake=\"{}\"", accepted_id(&answer))).await;
    }
    let stream = connection.service.bake(request(endless(1))).await.unwrap().into_inner();
    let (answer, end) = events(stream).await;
    assert_eq!(end.unwrap_err().code(), Code::DeadlineExceeded);
    until_logged(&server, &format!("call=\"Bake\" status=\"4\" bake=\"{}\"", accepted_id(&answer))).await;
    assert!(connection.watch("nothing", |_| {}).await.is_err());
    until_logged(&server, "call=\"WatchBake\" status=\"3\" bake=\"nothing\"").await;
}

/// A caller that goes away has cancelled its call, not the bake.
#[tokio::test]
async fn who_goes_away_is_told() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let id = begin(&mut connection, endless(1)).await;
    until_logged(&server, &format!("call=\"Bake\" status=\"1\" bake=\"{id}\"")).await;
    // A call without a bake has none in its line.
    until_logged(&server, "call=\"UploadAsset\" status=\"0\" milliseconds=").await;
}

/// Refused calls have lines, too.
#[tokio::test]
async fn refused_calls_are_told() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("token"), "open sesame").unwrap();
    let server = Server::start_in(folder.path(), &["--token-file", "token", "--drain-seconds", "20"]);
    assert!(Connection::open(&server.target()).await.is_err());
    until_logged(&server, "caller=\"127.0.0.1\" call=\"GetServerInfo\" status=\"16\"").await;
    let target = Target { token: Some("open sesame".into()), ..server.target() };
    let mut connection = Connection::open(&target).await.unwrap();
    let files = ["cone-small.glb", "stick.glb"].map(crate::service::server::content);
    let files = files.into_iter().map(|bytes| (crate::service::server::sha256(&bytes), bytes.into())).collect();
    connection.upload(&files).await.unwrap();
    begin(&mut connection, endless(1)).await;
    server.signal("-TERM");
    while connection.service.plan_bake(PlanBakeRequest { spec: Some(short(1)) }).await.is_ok() {
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    until_logged(&server, "caller=\"127.0.0.1\" call=\"PlanBake\" status=\"14\"").await;
}
