//! Scenes of very many bodies.

use crate::service::server::{Server, accepted_id, assert_fault, content, fields, request, sha256, take};
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{
    Artifact, AssetReference, BakeSpec, BatchCreateBakesRequest, Body, CancelBakeRequest, CreateBakeRequest,
    PlanBakeRequest, Prop, Scene,
};
use prost::Message;
use tonic::Code;

/// Cubes far from each other, each with all its values.
fn cubes(count: usize, prop: &str) -> BakeSpec {
    let body = |number: usize| Body {
        prop: prop.into(),
        position: vec![3.0 * (number % 300) as f64, 1.0 + number as f64 / 90_000.0, 3.0 * (number / 300) as f64],
        rotation: vec![0.0, 0.0, 0.0, 1.0],
        ..Default::default()
    };
    let scene = Scene {
        props: vec![Prop { path: "cube.glb".into(), ..Default::default() }],
        bodies: (0..count).map(body).collect(),
        ..Default::default()
    };
    let asset = AssetReference { uri: "cube.glb".into(), sha256: sha256(&content("cube.glb")) };
    BakeSpec { scene: Some(scene), assets: vec![asset], ..Default::default() }
}

#[tokio::test]
async fn a_scene_of_fifty_thousand_bodies_passes() {
    const BODIES: usize = 50_000;
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let spec = cubes(BODIES, "cube");
    let plan = PlanBakeRequest { spec: Some(spec.clone()) };
    let plan = connection.service.plan_bake(plan).await.unwrap().into_inner();
    assert!(plan.has_parameters_only && plan.effective_scene.unwrap().bodies.is_empty());
    let stream = connection.service.bake(request(spec)).await.unwrap().into_inner();
    let (events, _) = take(stream, 1).await;
    let id = accepted_id(&events);
    let Some(Kind::Accepted(accepted)) = &events[0].kind else { panic!("accepted first") };
    assert!(accepted.has_parameters_only && accepted.effective_scene.as_ref().unwrap().physics.is_some());
    let scene = connection.download(&id, Artifact::Scene).await.unwrap();
    let scene: serde_json::Value = serde_json::from_slice(&scene).unwrap();
    assert_eq!(scene["bodies"].as_array().unwrap().len(), BODIES);
    connection.service.cancel_bake(CancelBakeRequest { bake_id: id }).await.unwrap();
}

#[tokio::test]
async fn very_many_problems_are_no_fault_of_the_server() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let refused = connection.service.bake(request(cubes(50_000, "ball"))).await.unwrap_err();
    assert_fault(&refused, Code::InvalidArgument, "SCENE_INVALID");
}

/// An empty entry takes two bytes on the wire, and most of a kilobyte as a request.
#[tokio::test]
async fn a_request_that_would_fill_the_memory_is_refused() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let requests = vec![CreateBakeRequest::default(); 200_000];
    let batch = BatchCreateBakesRequest { requests };
    let (bytes, before) = (batch.encoded_len() as u64, server.peak_memory());
    let refused = connection.service.batch_create_bakes(batch).await.unwrap_err();
    let details = assert_fault(&refused, Code::InvalidArgument, "REQUEST_INVALID");
    assert_eq!(fields(&details), ["requests"]);
    let now = server.peak_memory();
    assert!(now <= before + 20 * bytes + (16 << 20), "{before} and {now} for a request of {bytes}");
}
