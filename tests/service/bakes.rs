//! A bake in the service: planned, baked, watched, listed, downloaded, deleted. Long: a test for each of these, and for
//! what a plan shares with its bake.

use crate::service::server::{
    Server, accepted_id, assert_contiguous, assert_fault, content, events, fields, numbered, poses, request, sha256,
    short, spec, status, take, until, watch,
};
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{
    Accuracy, Artifact, AssetReference, BakeEvent, BakeRequest, BakeState, ControlMode, DeleteBakeRequest,
    DownloadResultRequest, FrameSelection, GetBakeRequest, GetServerInfoRequest, Goal, ListBakesRequest, OutputFormat,
    PlanBakeRequest, Prop, Stage, WatchBakeRequest, goal,
};
use tonic::Code;

#[tokio::test]
async fn the_server_tells_what_it_is() {
    let server = Server::start(&["--workers", "3", "--queue", "7"]);
    let mut service = server.connect().await.service;
    let info = service.get_server_info(GetServerInfoRequest { protocol_version: 1 }).await.unwrap().into_inner();
    assert_eq!(info.versions.unwrap().cairn, env!("CARGO_PKG_VERSION"));
    let limits = info.limits.unwrap();
    assert_eq!((limits.worker_count, limits.queue_size), (3, 7));
    assert_eq!(info.accuracy_presets.len(), 6);
    let paper = info.accuracy_presets.iter().find(|preset| preset.accuracy() == Accuracy::Paper).unwrap();
    assert_eq!(paper.parameters.as_ref().unwrap().control.unwrap().mode(), ControlMode::Nails);

    let newer = service.get_server_info(GetServerInfoRequest { protocol_version: 99 }).await.unwrap_err();
    assert_fault(&newer, Code::FailedPrecondition, "PROTOCOL_MISMATCH");
    assert!(newer.message().contains("update the server"), "{}", newer.message());
}

#[tokio::test]
async fn a_plan_simulates_nothing() {
    let server = Server::start(&[]);
    let mut service = server.ready().await.service;
    let request = PlanBakeRequest { spec: Some(short(1)) };
    let planned = service.plan_bake(request).await.unwrap().into_inner();
    let plan = planned.plan.unwrap();
    assert_eq!(plan.expected_body_count, 12);
    assert!(plan.expected_step_count > 100 && plan.prop_diameter > 1.0 && plan.stages.len() == 6);
    assert_eq!(plan.estimates.len(), 5);
    assert!(plan.estimates.iter().all(|e| e.cpu_seconds > 0.0 && e.factor >= 1.0 && e.overlap_rel >= 0.0));
    assert!(plan.estimates.iter().all(|e| e.glue_dots > 0.0));
    assert!(plan.estimates.iter().all(|e| e.kept_shape_low <= e.kept_shape && e.kept_shape <= e.kept_shape_high));
    assert!(plan.estimates.iter().all(|e| e.kept_shape > 0.9), "as modelled");
    assert_eq!(planned.effective_scene.unwrap().seed, Some(1));
    let list = service.list_bakes(ListBakesRequest::default()).await.unwrap().into_inner();
    assert!(list.bakes.is_empty());

    // The bake then has the announced id.
    let (answer, end) =
        events(service.bake(crate::service::server::request(short(1))).await.unwrap().into_inner()).await;
    end.unwrap();
    assert_eq!(accepted_id(&answer), planned.bake_id);
    // Its events are the same on every machine.
    let Some(Kind::Accepted(accepted)) = &answer[0].kind else { panic!("{answer:?}") };
    assert!(accepted.plan.as_ref().unwrap().estimates.is_empty());
}

/// A goal chooses the preset, and the bake is that of the preset: for everyone who asks for it.
#[tokio::test]
async fn a_goal_chooses_the_preset() {
    let server = Server::start(&[]);
    let mut service = server.ready().await.service;
    let mut wanted = short(1);
    let scene = wanted.scene.as_mut().unwrap();
    scene.set_accuracy(Accuracy::Auto);
    let missing = service.plan_bake(PlanBakeRequest { spec: Some(wanted.clone()) }).await.unwrap_err();
    assert_eq!(fields(&assert_fault(&missing, Code::InvalidArgument, "SCENE_INVALID")), ["spec.scene.goal"]);
    let missing = service.bake(request(wanted.clone())).await.unwrap_err();
    assert_fault(&missing, Code::InvalidArgument, "SCENE_INVALID");

    let scene = wanted.scene.as_mut().unwrap();
    scene.goal = Some(Goal { kind: Some(goal::Kind::Overlap(1e3)) });
    let planned = service.plan_bake(PlanBakeRequest { spec: Some(wanted.clone()) }).await.unwrap().into_inner();
    assert_eq!(planned.effective_scene.unwrap().accuracy(), Accuracy::Draft);
    let said = planned.plan.unwrap().warnings.join(" ");
    assert!(said.contains("accuracy draft, expected to take up to"), "{said}");

    let (answer, end) = events(service.bake(request(wanted.clone())).await.unwrap().into_inner()).await;
    end.unwrap();
    let Some(Kind::Accepted(accepted)) = &answer[0].kind else { panic!("{answer:?}") };
    let effective = accepted.effective_scene.as_ref().unwrap();
    assert_eq!((effective.accuracy(), effective.goal), (Accuracy::Draft, wanted.scene.as_ref().unwrap().goal));
    assert_eq!(accepted.bake_id, planned.bake_id);
    // The same bake, named by its preset.
    let scene = wanted.scene.as_mut().unwrap();
    scene.set_accuracy(Accuracy::Draft);
    scene.goal = None;
    let (same, end) = events(service.bake(request(wanted)).await.unwrap().into_inner()).await;
    end.unwrap();
    assert_eq!(accepted_id(&same), accepted.bake_id);
}

/// Another seed of a scene is another bake, of which everything but the seed is as it was found before.
#[tokio::test]
async fn another_seed_of_a_scene_is_accepted_with_its_own_scene() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let mut plans = Vec::new();
    for seed in [3, 4] {
        let (answer, end) = events(connection.service.bake(request(short(seed))).await.unwrap().into_inner()).await;
        end.unwrap();
        let Some(Kind::Accepted(accepted)) = &answer[0].kind else { panic!("{answer:?}") };
        let effective = accepted.effective_scene.as_ref().unwrap();
        assert_eq!(effective.seed, Some(seed));
        let saved = connection.download(&accepted.bake_id, Artifact::Scene).await.unwrap();
        let saved: serde_json::Value = serde_json::from_slice(&saved).unwrap();
        assert_eq!(saved["seed"], seed);
        plans.push(accepted.plan.clone());
    }
    assert_eq!(plans[0], plans[1]);
    // What is wrong is refused as before.
    let status = connection.service.bake(request(short(-1))).await.unwrap_err();
    assert_eq!(status.code(), Code::InvalidArgument, "{status}");
}

#[tokio::test]
async fn a_bake_tells_its_events_in_order_and_leaves_its_result() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let mut wanted = short(1);
    wanted.set_format(OutputFormat::Json);
    let stream = connection.service.bake(request(wanted.clone())).await.unwrap().into_inner();
    let (answer, end) = events(stream).await;
    end.unwrap();

    assert_contiguous(&answer, 1);
    let Some(Kind::Accepted(accepted)) = &answer[0].kind else { panic!("accepted first") };
    assert_eq!(accepted.plan.as_ref().unwrap().expected_body_count, 12);
    assert_eq!(accepted.effective_scene.as_ref().unwrap().physics.unwrap().substeps, Some(8));
    assert!(!accepted.versions.as_ref().unwrap().rapier3d.is_empty());
    let Some(Kind::Summary(summary)) = &answer.last().unwrap().kind else { panic!("the summary last") };
    assert_eq!(summary.body_count, 12);
    assert!(summary.measures.contains_key("kept_shape") && summary.counts["steps"] > 0);
    let progress: Vec<Stage> = answer.iter().filter_map(progress).collect();
    let order = [Stage::Shape, Stage::Fill, Stage::Glue, Stage::Release, Stage::Hold, Stage::Measure];
    let place = |stage: &Stage| order.iter().position(|s| s == stage);
    assert!(!progress.is_empty() && progress.is_sorted_by_key(place));

    // The last frame matches the result.
    let result: serde_json::Value =
        serde_json::from_slice(&download(&mut connection, &accepted.bake_id, 0).await).unwrap();
    let frames = result["frames"].as_array().unwrap();
    assert_eq!(frames.len(), summary.frame_count as usize);
    let of_result: Vec<BakeEvent> = answer.iter().filter(|event| is_of_result(event)).cloned().collect();
    let numbers = of_result.iter().filter_map(|event| match &event.kind {
        Some(Kind::Frame(frame)) => Some(frame.frame_number),
        _ => None,
    });
    assert!(numbers.eq(0..summary.frame_count), "each frame of the result once");
    let last = frames.last().unwrap().as_array().unwrap();
    for (id, (position, rotation)) in poses(&of_result) {
        let pose: Vec<f32> = last[id as usize].as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect();
        assert_eq!(position, pose[..3]);
        let turned = rotation.iter().zip(&pose[3..]).map(|(a, b)| a * b).sum::<f32>();
        assert!(turned.abs() > 0.999_999);
    }
    assert_eq!(poses(&of_result).len(), 12);
    assert!(answer.iter().any(|event| matches!(&event.kind, Some(Kind::Frame(f)) if f.stage() == Stage::Fill)));

    // The report, and the file's own figures.
    let report: serde_json::Value =
        serde_json::from_slice(&download(&mut connection, &accepted.bake_id, Artifact::Report.into()).await).unwrap();
    assert_eq!(report["result_blake3"], summary.result_blake3.as_str());
    let result = download(&mut connection, &accepted.bake_id, Artifact::Result.into()).await;
    assert_eq!((result.len() as i64, sha256(&result)), (summary.result_bytes, summary.result_sha256.clone()));
}

fn progress(event: &BakeEvent) -> Option<Stage> {
    match &event.kind {
        Some(Kind::Progress(progress)) => Some(progress.stage()),
        _ => None,
    }
}

fn is_of_result(event: &BakeEvent) -> bool {
    matches!(&event.kind, Some(Kind::Frame(frame)) if frame.stage() != Stage::Fill)
}

async fn download(connection: &mut cairn_service::client::Connection, id: &str, artifact: i32) -> Vec<u8> {
    let request = DownloadResultRequest { bake_id: id.into(), artifact, ..Default::default() };
    let mut parts = connection.service.download_result(request).await.unwrap().into_inner();
    let (mut file, mut size) = (Vec::new(), 0);
    while let Some(part) = parts.message().await.unwrap() {
        size += part.size_bytes;
        file.extend_from_slice(&part.chunk);
    }
    assert_eq!(size, file.len() as i64, "the first part has the size, the others nothing");
    file
}

#[tokio::test]
async fn a_fill_is_simulated_once() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let mut answer = Vec::new();
    for change in ["release.layer=0.5", "release.layer=1"] {
        let stream = connection.service.bake(request(spec(&["fill.count=12", change]))).await.unwrap().into_inner();
        let (events, end) = events(stream).await;
        end.unwrap();
        answer.push(events);
    }
    let fill = |events: &[BakeEvent]| -> Vec<Kind> {
        let frames = numbered(events).into_iter().filter_map(|event| event.kind.clone());
        frames.filter(|kind| matches!(kind, Kind::Frame(frame) if frame.stage() == Stage::Fill)).collect()
    };
    assert!(fill(&answer[0]).len() > 1);
    assert_eq!(fill(&answer[0]), fill(&answer[1]), "who watches sees the same");
    let counts = |events: &[BakeEvent]| match &events.last().unwrap().kind {
        Some(Kind::Summary(summary)) => (summary.counts["fill_steps"], summary.counts["fill_steps_recalled"]),
        _ => panic!("the summary last"),
    };
    let (first, second) = (counts(&answer[0]), counts(&answer[1]));
    assert!(first.0 > 0 && first.1 == 0, "{first:?}");
    assert_eq!(second, (0, first.0));

    // Without the setting, nothing is cached.
    let server = Server::start(&["--reuse", "false"]);
    let mut connection = server.ready().await;
    for change in ["release.layer=0.5", "release.layer=1"] {
        let stream = connection.service.bake(request(spec(&["fill.count=12", change]))).await.unwrap().into_inner();
        let (events, end) = events(stream).await;
        end.unwrap();
        assert!(counts(&events).0 > 0);
    }
}

#[tokio::test]
async fn the_same_request_is_baked_once() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (first, end) = events(connection.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    end.unwrap();
    let id = accepted_id(&first);
    let started = status(&mut connection, &id).await.start_time;

    // With a default written out, and assets in another order.
    let mut same = short(1);
    same.scene.as_mut().unwrap().gravity = Some(9.81);
    same.assets.reverse();
    let (again, end) = events(connection.service.bake(request(same)).await.unwrap().into_inner()).await;
    end.unwrap();
    let kept = |events: &[BakeEvent]| numbered(events).into_iter().cloned().collect::<Vec<_>>();
    assert_eq!(kept(&again), kept(&first));
    assert_eq!(status(&mut connection, &id).await.start_time, started);

    // Any part of it, again and again.
    let (rest, end) = events(watch(&mut connection, &id, 20).await).await;
    end.unwrap();
    assert_eq!(kept(&rest), kept(&first)[19..]);

    let request = WatchBakeRequest { bake_id: id, frames: FrameSelection::None.into(), ..Default::default() };
    let (brief, end) = events(connection.service.watch_bake(request).await.unwrap().into_inner()).await;
    end.unwrap();
    assert_eq!(brief.len(), 2, "accepted and summary");
}

#[tokio::test]
async fn two_accuracies_side_by_side() {
    let server = Server::start(&["--workers", "2"]);
    let mut connection = server.ready().await;
    let (mut one, mut two) = (connection.clone(), connection.clone());
    let [draft, fine] =
        ["draft", "fine"].map(|accuracy| request(spec(&["fill.count=6", &format!("accuracy={accuracy}")])));
    let (draft, fine) =
        tokio::join!(async { events(one.service.bake(draft).await.unwrap().into_inner()).await }, async {
            events(two.service.bake(fine).await.unwrap().into_inner()).await
        },);
    let substeps = |events: &[BakeEvent]| match &events[0].kind {
        Some(Kind::Accepted(accepted)) => accepted.effective_scene.as_ref().unwrap().physics.unwrap().substeps,
        _ => None,
    };
    assert_eq!((substeps(&draft.0), substeps(&fine.0)), (Some(8), Some(16)));
    for (events, end) in [draft, fine] {
        end.unwrap();
        assert_eq!(status(&mut connection, &accepted_id(&events)).await.state(), BakeState::Succeeded);
    }
}

#[tokio::test]
async fn bakes_are_listed_and_deleted() {
    let server = Server::start(&["--workers", "1"]);
    let mut connection = server.ready().await;
    let mut ids = Vec::new();
    for seed in 1..=3 {
        let stream = connection.service.bake(request(short(seed))).await.unwrap().into_inner();
        ids.push(accepted_id(&events(stream).await.0));
    }
    let mut page = ListBakesRequest { page_size: 2, ..Default::default() };
    let first = connection.service.list_bakes(page.clone()).await.unwrap().into_inner();
    page.page_token = first.next_page_token;
    let second = connection.service.list_bakes(page).await.unwrap().into_inner();
    assert!(second.next_page_token.is_empty());
    let listed: Vec<String> = first.bakes.into_iter().chain(second.bakes).map(|bake| bake.bake_id).collect();
    assert!(listed.iter().eq(ids.iter().rev()), "the latest first");

    let delete = |bake_id: &str| DeleteBakeRequest { bake_id: bake_id.into() };
    connection.service.delete_bake(delete(&ids[0])).await.unwrap();
    let gone = connection.service.get_bake(GetBakeRequest { bake_id: ids[0].clone() }).await.unwrap_err();
    assert_fault(&gone, Code::NotFound, "BAKE_NOT_FOUND");
    assert!(!server.path("data/bakes").join(&ids[0]).exists());

    // A running one ends, too.
    let id = crate::service::server::begin(&mut connection, crate::service::server::endless(1)).await;
    until(&mut connection, &id, BakeState::Running).await;
    let early = DownloadResultRequest { bake_id: id.clone(), ..Default::default() };
    let early = connection.service.download_result(early).await;
    assert_fault(&early.unwrap_err(), Code::FailedPrecondition, "BAKE_NOT_DONE");
    connection.service.delete_bake(delete(&id)).await.unwrap();
    assert!(server.children().is_empty() && !server.path("data/bakes").join(&id).exists());
    for name in ["../../log", "", "..", "x"] {
        let error = connection.service.delete_bake(delete(name)).await.unwrap_err();
        assert_fault(&error, Code::InvalidArgument, "REQUEST_INVALID");
    }
}

#[tokio::test]
async fn every_problem_is_told_with_its_field() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let mut wrong = spec(&["physics.substeps=-1", "fill.count=0", "props.0.weight=-1"]);
    wrong.scene.as_mut().unwrap().props.push(Prop { path: "gone.glb".into(), ..Default::default() });
    let answer = connection.service.plan_bake(PlanBakeRequest { spec: Some(wrong.clone()) }).await.unwrap_err();
    let details = assert_fault(&answer, Code::InvalidArgument, "SCENE_INVALID");
    let mut found = fields(&details);
    found.sort();
    let scene = |field: &str| format!("spec.scene.{field}");
    let expected = ["fill.count", "physics.substeps", "props[0].weight", "props[1].path"].map(scene);
    assert_eq!(found, expected, "{answer:?}");
    let answer = connection.service.bake(request(wrong)).await.unwrap_err();
    assert_eq!(fields(&assert_fault(&answer, Code::InvalidArgument, "SCENE_INVALID")).len(), 4);
    assert!(std::fs::read_dir(server.path("data/bakes")).unwrap().next().is_none(), "nothing is left of it");

    // A broken model, and an open one in the place of the shape.
    let broken = b"glTF, but not for long".to_vec();
    connection.upload(&[(sha256(&broken), broken.clone().into())].into()).await.unwrap();
    let mut wrong = short(1);
    wrong.assets[1].sha256 = sha256(&broken);
    let answer = connection.service.plan_bake(PlanBakeRequest { spec: Some(wrong) }).await.unwrap_err();
    assert_eq!(fields(&assert_fault(&answer, Code::InvalidArgument, "SCENE_INVALID")), ["spec.scene.props[0].path"]);
}

#[tokio::test]
async fn requests_of_the_wrong_form() {
    let server = Server::start(&[]);
    let mut service = server.ready().await.service;
    let answer = service.bake(BakeRequest::default()).await.unwrap_err();
    assert_eq!(fields(&assert_fault(&answer, Code::InvalidArgument, "REQUEST_INVALID")), ["spec"]);

    let mut wrong = short(1);
    wrong.format = 77;
    wrong.scene.as_mut().unwrap().accuracy = 77;
    wrong.assets.push(wrong.assets[0].clone());
    wrong.assets.push(AssetReference { uri: "../../etc/passwd".into(), sha256: "../../etc/passwd".into() });
    let answer = service.bake(request(wrong)).await.unwrap_err();
    let found = fields(&assert_fault(&answer, Code::InvalidArgument, "REQUEST_INVALID"));
    assert_eq!(found, ["spec.format", "spec.assets[2].uri", "spec.assets[3].sha256", "spec.scene.accuracy"]);

    // The only problems are missing assets.
    let mut missing = short(1);
    missing.assets[1].sha256 = sha256(b"never uploaded");
    missing.assets.push(AssetReference { uri: "texture.png".into(), sha256: sha256(b"nor this") });
    let answer = service.bake(request(missing)).await.unwrap_err();
    let found = fields(&assert_fault(&answer, Code::FailedPrecondition, "ASSETS_MISSING"));
    assert_eq!(found, ["spec.assets[1].sha256", "spec.assets[2].sha256"]);

    for list in [
        ListBakesRequest { states: vec![99], ..Default::default() },
        ListBakesRequest { page_size: -1, ..Default::default() },
        ListBakesRequest { page_token: "nonsense".into(), ..Default::default() },
    ] {
        assert_fault(&service.list_bakes(list).await.unwrap_err(), Code::InvalidArgument, "REQUEST_INVALID");
    }
    service.list_bakes(ListBakesRequest { page_size: 100_000, ..Default::default() }).await.unwrap();
    // A token goes with its filter, and an id has a form.
    for seed in 1..=2 {
        crate::service::server::begin(&mut server.connect().await, short(seed)).await;
    }
    let first = ListBakesRequest { page_size: 1, ..Default::default() };
    let page_token = service.list_bakes(first.clone()).await.unwrap().into_inner().next_page_token;
    service.list_bakes(ListBakesRequest { page_token: page_token.clone(), ..first.clone() }).await.unwrap();
    let other = ListBakesRequest { page_token, states: vec![3], ..first };
    let refused = service.list_bakes(other).await.unwrap_err();
    assert_eq!(fields(&assert_fault(&refused, Code::InvalidArgument, "REQUEST_INVALID")), ["page_token"]);
    for bake_id in ["", "12345", "nonsense", &"0".repeat(65), &"A".repeat(64)] {
        let refused = service.get_bake(GetBakeRequest { bake_id: bake_id.into() }).await.unwrap_err();
        assert_eq!(fields(&assert_fault(&refused, Code::InvalidArgument, "REQUEST_INVALID")), ["bake_id"]);
    }
    let watch = WatchBakeRequest { bake_id: "0".repeat(64), from_sequence_number: -1, ..Default::default() };
    assert_fault(&service.watch_bake(watch).await.unwrap_err(), Code::InvalidArgument, "REQUEST_INVALID");
}

/// A model whose buffer is a file beside it.
#[tokio::test]
async fn files_beside_a_model() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (gltf, buffer) = split(&content("stick.glb"));
    let mut spec = short(1);
    spec.scene.as_mut().unwrap().props[0].path = "kit/stick.gltf".into();
    spec.assets[1] = AssetReference { uri: "kit/stick.gltf".into(), sha256: sha256(&gltf) };
    spec.assets.push(AssetReference { uri: "kit/stick.bin".into(), sha256: sha256(&buffer) });
    let files = [gltf, buffer].into_iter().map(|bytes| (sha256(&bytes), bytes.into()));
    connection.upload(&files.collect()).await.unwrap();
    let (_, end) = take(connection.service.bake(request(spec)).await.unwrap().into_inner(), usize::MAX).await;
    end.unwrap();
}

/// A `.glb` as a `.gltf` and the buffer beside it.
fn split(glb: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut document: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    document["buffers"][0]["uri"] = "stick.bin".into();
    (document.to_string().into_bytes(), glb[20 + length + 8..].to_vec())
}
