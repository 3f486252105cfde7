//! Uploads: whole, broken, too large, and from hostile callers.

use crate::service::server::{Server, assert_fault, sha256};
use cairn_wire::proto::{AssetHeader, HaveAssetsRequest, UploadAssetRequest};
use tonic::{Code, Status};

fn header(sha256: String, size_bytes: i64) -> UploadAssetRequest {
    UploadAssetRequest { header: Some(AssetHeader { sha256, size_bytes }), ..Default::default() }
}

fn chunk(bytes: &[u8]) -> UploadAssetRequest {
    UploadAssetRequest { chunk: bytes.to_vec().into(), ..Default::default() }
}

async fn upload(server: &Server, messages: Vec<UploadAssetRequest>) -> Result<(), Status> {
    let mut service = server.connect().await.service;
    service.upload_asset(tokio_stream::iter(messages)).await.map(|_| ())
}

#[tokio::test]
async fn an_asset_is_sent_once() {
    let server = Server::start(&[]);
    let mut service = server.connect().await.service;
    let (here, elsewhere) = (sha256(b"here"), sha256(b"elsewhere"));
    let have = HaveAssetsRequest { sha256: vec![here.clone(), elsewhere.clone()] };
    let missing = service.have_assets(have.clone()).await.unwrap().into_inner().missing_sha256;
    assert_eq!(missing, [here.clone(), elsewhere.clone()]);
    upload(&server, vec![header(here.clone(), 4), chunk(b"he"), chunk(b""), chunk(b"re")]).await.unwrap();
    let missing = service.have_assets(have).await.unwrap().into_inner().missing_sha256;
    assert_eq!(missing, [elsewhere]);
    assert_eq!(std::fs::read(server.path("data/assets").join(here)).unwrap(), b"here");
}

#[tokio::test]
async fn broken_uploads_leave_nothing() {
    let server = Server::start(&["--asset-mib", "1"]);
    let right = sha256(b"right");
    let all = [
        (vec![header(right.clone(), 5), chunk(b"wrong")], "ASSET_CORRUPT"),
        (vec![header(right.clone(), 5), chunk(b"rig")], "ASSET_CORRUPT"),
        (vec![header(right.clone(), 5), chunk(b"right and more")], "ASSET_CORRUPT"),
        (vec![], "REQUEST_INVALID"),
        (vec![chunk(b"right")], "REQUEST_INVALID"),
        (vec![header(right.clone(), 5), header(right.clone(), 5)], "REQUEST_INVALID"),
        (vec![header(right.clone(), -1)], "REQUEST_INVALID"),
        (vec![header("../../../tmp/x".into(), 5), chunk(b"right")], "REQUEST_INVALID"),
        (vec![header(right.to_uppercase(), 5), chunk(b"right")], "REQUEST_INVALID"),
        (vec![header(right.clone(), 1 << 20), chunk(&vec![0; (1 << 20) + 1])], "REQUEST_INVALID"),
    ];
    for (messages, reason) in all {
        assert_fault(&upload(&server, messages).await.unwrap_err(), Code::InvalidArgument, reason);
    }
    let large = upload(&server, vec![header(right.clone(), (1 << 20) + 1)]).await.unwrap_err();
    assert_fault(&large, Code::ResourceExhausted, "ASSET_TOO_LARGE");
    let large = upload(&server, vec![header(right, 5), chunk(&vec![0; 33 << 20])]).await.unwrap_err();
    assert_eq!(large.code(), Code::OutOfRange, "the limit of a message");
    for folder in ["data/assets", "data/partial"] {
        assert_eq!(std::fs::read_dir(server.path(folder)).unwrap().count(), 0, "{folder}");
    }
}

/// More simultaneous uploads than a caller may have are refused until one ends. Another caller can upload meanwhile.
#[tokio::test]
async fn uploads_are_bounded() {
    const SHARE: usize = 8;
    let folder = tempfile::tempdir().unwrap();
    let socket = format!("unix:{}", folder.path().join("socket").display());
    let server = Server::start_in(folder.path(), &["--listen", &socket]);
    let connection = server.connect().await;
    let mut open = Vec::new();
    for _ in 0..SHARE {
        let (sender, receiver) = tokio::sync::mpsc::channel(1);
        sender.send(header(sha256(b""), 100)).await.unwrap();
        let mut service = connection.service.clone();
        let messages = tokio_stream::wrappers::ReceiverStream::new(receiver);
        open.push((sender, tokio::spawn(async move { service.upload_asset(messages).await.map(|_| ()) })));
    }
    while std::fs::read_dir(server.path("data/partial")).unwrap().count() < SHARE {
        tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    }
    let refused = upload(&server, vec![header(sha256(b"x"), 1), chunk(b"x")]).await.unwrap_err();
    let details = assert_fault(&refused, Code::ResourceExhausted, "TOO_MANY_CALLS");
    assert!(details.retry_info().is_some());
    let other = cairn_service::client::Target { address: socket, ..Default::default() };
    let mut other = cairn_service::client::Connection::open(&other).await.unwrap();
    other.upload(&[(sha256(b"y"), b"y".to_vec().into())].into()).await.unwrap();
    let (sender, call) = open.pop().unwrap();
    drop(sender);
    assert_fault(&call.await.unwrap().unwrap_err(), Code::InvalidArgument, "ASSET_CORRUPT");
    upload(&server, vec![header(sha256(b"x"), 1), chunk(b"x")]).await.unwrap();
}
