//! Analyses of piles on the server.

use crate::service::server::{
    PROGRAM, Server, accepted_id, assert_fault, events, fields, request, sha256, short, within,
};
use bytes::Bytes;
use cairn_service::client::Connection;
use cairn_wire::proto::{AnalysePileRequest, AnalysePileResponse, AssetReference};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use tonic::{Code, Status};

fn stack(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets/stacks").join(name)
}

/// Uploads a file, and asks about it.
async fn about(connection: &mut Connection, name: &str, content: &[u8]) -> AnalysePileRequest {
    let sha256 = sha256(content);
    connection.upload(&[(sha256.clone(), Bytes::copy_from_slice(content))].into()).await.unwrap();
    AnalysePileRequest { assets: vec![AssetReference { uri: name.into(), sha256 }], ..Default::default() }
}

async fn asked(connection: &mut Connection, request: AnalysePileRequest) -> Result<Vec<AnalysePileResponse>, Status> {
    connection.analyse(request, |_| ()).await
}

#[test]
fn the_same_answers_from_near_and_far() {
    let server = Server::start(&[]);
    let far = &server.addresses[0];
    for file in ["arch.glb", "table.glb"] {
        let analyse = |args: &[&str]| {
            let mut command = Command::new(PROGRAM);
            command.arg("analyse").arg(stack(file)).args(["--friction", "0.6", "--without", "ground*"]).args(args);
            let done = command.env_remove("CAIRN_TOKEN").output().unwrap();
            (done.status.code(), String::from_utf8(done.stdout).unwrap(), String::from_utf8(done.stderr).unwrap())
        };
        // No node of this name: the reading of the file says so before anything is sent.
        assert!(analyse(&["--json", "--server", far]).2.contains("no node has the name"));
        let analyse = |args: &[&str]| {
            let done = Command::new(PROGRAM).arg("analyse").arg(stack(file)).args(args).output().unwrap();
            assert!(done.status.success(), "{done:?}");
            String::from_utf8(done.stdout).unwrap()
        };
        let near = analyse(&["--json"]);
        assert!(near == analyse(&["--json", "--server", far]), "{file}");
        let answers: Value = serde_json::from_str(&near).unwrap();
        assert!(answers["whole"]["knock_over"]["tried"].as_u64().unwrap() > 0, "{}", answers["whole"]);
    }
}

#[tokio::test]
async fn a_bake_is_analysed_by_its_id() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (answer, end) = events(connection.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    end.unwrap();
    let by_id = AnalysePileRequest { bake_id: accepted_id(&answer)[..12].into(), ..Default::default() };
    let parts = asked(&mut connection, by_id.clone()).await.unwrap();
    let bodies: Vec<_> = parts.iter().flat_map(|part| &part.bodies).collect();
    assert_eq!(bodies.len(), 12);
    assert!(bodies.iter().all(|body| body.name.starts_with("stick.glb.")), "{:?}", bodies[0]);
    let pile = parts.last().unwrap().pile.as_ref().unwrap();
    assert!(
        pile.gravity > 9.0 && pile.ground_height.is_some() && parts.iter().filter(|p| p.pile.is_some()).count() == 1
    );
    // As anybody who has the file would be answered.
    let result = connection.download(&accepted_id(&answer), cairn_wire::proto::Artifact::Result).await.unwrap();
    let by_file = about(&mut connection, "pile.glb", &result).await;
    assert_eq!(asked(&mut connection, by_file).await.unwrap().last(), parts.last());
    // Wider friction, other answers.
    let slippery = AnalysePileRequest { friction: Some(0.0), ..by_id };
    let parts = asked(&mut connection, slippery).await.unwrap();
    assert!(!parts.last().unwrap().pile.as_ref().unwrap().stands);
}

#[tokio::test]
async fn wrong_requests_are_refused() {
    let server = Server::start(&[]);
    let mut connection = server.connect().await;
    let good = about(&mut connection, "arch.glb", &std::fs::read(stack("arch.glb")).unwrap()).await;
    let refused = async |connection: &mut Connection, request: AnalysePileRequest, code: Code, reason: &str| {
        fields(&assert_fault(&asked(connection, request).await.unwrap_err(), code, reason))
    };
    let wrong = AnalysePileRequest {
        bake_id: "abcdef".into(),
        friction: Some(f64::NAN),
        friction_share: Some(1.5),
        density: Some(0.0),
        ground_height: Some(0.0),
        no_ground: true,
        scenery: vec!["x".repeat(5000)],
        ..good.clone()
    };
    let found = refused(&mut connection, wrong, Code::InvalidArgument, "REQUEST_INVALID").await;
    assert_eq!(found, ["bake_id", "scenery", "friction", "density", "friction_share", "ground_height"]);
    let none = AnalysePileRequest::default();
    assert_eq!(refused(&mut connection, none, Code::InvalidArgument, "REQUEST_INVALID").await, ["assets"]);
    let unknown = AnalysePileRequest { bake_id: "abcdef".into(), ..Default::default() };
    refused(&mut connection, unknown, Code::NotFound, "BAKE_NOT_FOUND").await;
    let mut missing = good.clone();
    missing.assets[0].sha256 = sha256(b"never uploaded");
    refused(&mut connection, missing, Code::FailedPrecondition, "ASSETS_MISSING").await;
    let garbage = about(&mut connection, "pile.glb", b"glTF, but not for long").await;
    refused(&mut connection, garbage, Code::InvalidArgument, "SCENE_INVALID").await;
    let nobody = AnalysePileRequest { without: vec!["*".into()], ..good.clone() };
    refused(&mut connection, nobody, Code::InvalidArgument, "SCENE_INVALID").await;
    // A call that has no time, and one whose caller leaves: the process ends with it.
    let late = connection.service.analyse_pile(within(Duration::from_millis(1), good.clone())).await;
    let late = match late {
        Ok(messages) => messages.into_inner().message().await.unwrap_err(),
        Err(status) => status,
    };
    assert!(matches!(late.code(), Code::DeadlineExceeded | Code::Cancelled), "{late:?}");
    drop(connection.service.analyse_pile(good.clone()).await.unwrap());
    while !server.children().is_empty() {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    // Nothing of them is left, and the next one is answered.
    assert!(asked(&mut connection, good).await.is_ok());
    while std::fs::read_dir(server.path("data/partial")).unwrap().next().is_some() {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}
