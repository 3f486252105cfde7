//! Bakes that change an earlier one, which the request names by its id.

use crate::service::server::{
    PROGRAM, Server, accepted_id, assert_fault, asset, begin, content, endless, events, fields, poses, request, sha256,
    short, spec, until,
};
use bytes::Bytes;
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{
    Artifact, AssetReference, BakeEvent, BakeSpec, BakeState, CancelBakeRequest, DeleteBakeRequest,
    DownloadResultRequest, FormerResult, OutputFormat, PlanBakeRequest, Stage,
};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use tonic::{Code, Status};

async fn baked(connection: &mut Connection, spec: BakeSpec) -> Result<Vec<BakeEvent>, Status> {
    let (answer, end) = events(connection.service.bake(request(spec)).await?.into_inner()).await;
    end.map(|()| answer)
}

/// A request for more sticks in the pile of an earlier bake.
fn more(id: &str) -> BakeSpec {
    BakeSpec { from_bake_id: id.into(), ..spec(&["fill.count=16", "seed=2"]) }
}

/// The same with a name for the earlier result.
fn more_named(id: &str, path: &str) -> BakeSpec {
    let mut wanted = more(id);
    let from = FormerResult { path: path.into(), ..Default::default() };
    wanted.scene.as_mut().unwrap().from = Some(from);
    wanted
}

/// By its id, an earlier bake gives the bytes that its file gives on this machine; the request has one id whether it
/// names the bake or the file. The stream of events has the poses and names of the file, to the bit.
#[tokio::test]
async fn an_earlier_bake_by_its_id_is_its_file() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    // Its .glb is made once it is needed.
    let mut first = short(1);
    first.set_format(OutputFormat::Csv);
    let before = baked(&mut connection, first).await.unwrap();
    let id = accepted_id(&before);
    let wanted = more_named(&id[..12], "before.glb");
    let planned = connection.service.plan_bake(PlanBakeRequest { spec: Some(wanted.clone()) }).await.unwrap();
    let after = baked(&mut connection, wanted.clone()).await.unwrap();
    let changed = accepted_id(&after);
    assert_eq!(changed, planned.into_inner().bake_id);

    let format = OutputFormat::Glb.into();
    let glb = DownloadResultRequest { bake_id: id.clone(), format, ..Default::default() };
    let glb = connection.download_file(&glb).await.unwrap().bytes;
    for name in ["cone-small.glb", "stick.glb"] {
        std::fs::copy(asset(name), server.path(name)).unwrap();
    }
    std::fs::write(server.path("before.glb"), &glb).unwrap();
    let line = "bake --control cone-small.glb --prop stick.glb --accuracy draft --set fill.count=16 --seed 2 \
                --from before.glb -o after.glb --quiet";
    let done = Command::new(PROGRAM).args(line.split_whitespace()).current_dir(server.folder()).output().unwrap();
    assert!(done.status.success(), "{done:?}");
    let near = std::fs::read(server.path("after.glb")).unwrap();
    assert!(near == connection.download(&changed, Artifact::Result).await.unwrap(), "the results differ");
    let far = format!("{line} --server {}", server.addresses[0]).replace("after.glb", "far.glb");
    let done = Command::new(PROGRAM).args(far.split_whitespace()).current_dir(server.folder()).output().unwrap();
    assert!(done.status.success() && near == std::fs::read(server.path("far.glb")).unwrap(), "{done:?}");

    // The file as an upload of the caller.
    let mut by_file = more_named("", "before.glb");
    by_file.assets.push(AssetReference { uri: "before.glb".into(), sha256: sha256(&glb) });
    assert_eq!(accepted_id(&baked(&mut connection, by_file).await.unwrap()), changed);
    // Without a name of its own, it has its id's.
    let other = baked(&mut connection, more(&id)).await.unwrap();
    assert_ne!(accepted_id(&other), changed);
    let Some(Kind::Accepted(accepted)) = &other[0].kind else { panic!("{other:?}") };
    let from = accepted.effective_scene.as_ref().unwrap().from.as_ref().unwrap();
    assert_eq!((from.path.clone(), from.reach), (format!("{id}.glb"), Some(1.0)));

    let Some(Kind::Summary(summary)) = &after.last().unwrap().kind else { panic!("the summary last") };
    let counts = &summary.counts;
    assert_eq!(counts["bodies_kept"] + counts["bodies_moved"] + counts["bodies_gone"], 12);
    let (old, new) = (named_ends(&before), named_ends(&after));
    let same = old.iter().filter(|(number, pose)| new.get(*number) == Some(*pose)).count() as i64;
    assert!(same >= counts["bodies_kept"] && same > 6, "{same} of {} kept bodies", counts["bodies_kept"]);
}

/// Of each body of a result, by the number in its name: the last pose, to the bit.
fn named_ends(events: &[BakeEvent]) -> BTreeMap<i32, Vec<u32>> {
    let is_of_result = |event: &&BakeEvent| match &event.kind {
        Some(Kind::Frame(frame)) => frame.stage() != Stage::Fill,
        _ => false,
    };
    let frames: Vec<BakeEvent> = events.iter().filter(is_of_result).cloned().collect();
    let mut numbers = BTreeMap::new();
    for event in events {
        if let Some(Kind::BodyTable(table)) = &event.kind
            && table.stage() == Stage::Release
        {
            for i in 0..table.prop_indices.len() {
                let index = table.first_body_index + i as i32;
                numbers.insert(index, table.numbers.get(i).copied().unwrap_or(index));
            }
        }
    }
    let bits = |(p, r): ([f32; 3], [f32; 4])| {
        // Of the two quaternions of a rotation, either may be sent.
        let sign = r[3].signum();
        p.into_iter().chain(r.map(|x| x * sign)).map(f32::to_bits).collect()
    };
    poses(&frames).into_iter().map(|(index, pose)| (numbers[&index], bits(pose))).collect()
}

/// Why an earlier bake cannot be used, and what to do, with the field; as a plan and as a bake.
async fn refused(connection: &mut Connection, wanted: BakeSpec, words: &[&str]) {
    let plan = connection.service.plan_bake(PlanBakeRequest { spec: Some(wanted.clone()) }).await;
    for answer in [plan.unwrap_err(), baked(connection, wanted).await.unwrap_err()] {
        let details = assert_fault(&answer, Code::FailedPrecondition, "EARLIER_BAKE");
        assert_eq!(fields(&details), ["spec.from_bake_id"]);
        words.iter().for_each(|word| assert!(answer.message().contains(word), "{word}: {}", answer.message()));
    }
}

#[tokio::test]
async fn an_earlier_bake_that_cannot_be_used_is_refused() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let gone = ["there is no bake", "is too old", "upload its .glb", "leave from_bake_id out"];
    refused(&mut connection, more("0123456789"), &gone).await;
    let id = begin(&mut connection, endless(1)).await;
    refused(&mut connection, more(&id), &["is not finished", "WatchBake"]).await;
    connection.service.cancel_bake(CancelBakeRequest { bake_id: id.clone() }).await.unwrap();
    until(&mut connection, &id, BakeState::Cancelled).await;
    refused(&mut connection, more(&id), &["was cancelled", "leave from_bake_id out"]).await;

    // A changed byte, and a cut.
    let id = accepted_id(&baked(&mut connection, short(1)).await.unwrap());
    let path = server.path("data/bakes").join(&id).join("result.glb");
    let mut bytes = std::fs::read(&path).unwrap();
    let length = bytes.len();
    bytes[length / 2] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    refused(&mut connection, more(&id), &["damaged", "leave from_bake_id out"]).await;
    assert_eq!(accepted_id(&baked(&mut connection, short(1)).await.unwrap()), id, "it is made again");
    std::fs::File::options().write(true).open(&path).unwrap().set_len(9).unwrap();
    refused(&mut connection, more(&id), &["has failed", "damaged", "leave from_bake_id out"]).await;

    // It is used, and then deleted: what was made of it stays.
    let id = accepted_id(&baked(&mut connection, short(1)).await.unwrap());
    baked(&mut connection, more(&id)).await.unwrap();
    connection.service.delete_bake(DeleteBakeRequest { bake_id: id.clone() }).await.unwrap();
    refused(&mut connection, more(&id), &gone).await;

    // What is wrong with the form of the request.
    let id = accepted_id(&baked(&mut connection, short(1)).await.unwrap());
    let wrong = [(more("nothing"), "not the id of a bake"), (more_named(&id, "stick.glb"), "assets has stick.glb")];
    for (wanted, words) in wrong {
        let answer = baked(&mut connection, wanted).await.unwrap_err();
        let details = assert_fault(&answer, Code::InvalidArgument, "REQUEST_INVALID");
        assert_eq!(fields(&details), ["spec.from_bake_id"]);
        assert!(answer.message().contains(words), "{}", answer.message());
    }
}

const CALLERS: &str = "
[[project]]
name = 'dune'

[[project]]
name = 'heat'

[[caller]]
name = 'anna'
token = 'token of anna'
project = 'dune'

[[caller]]
name = 'ben'
token = 'token of ben'
project = 'heat'
";

/// The bake of another project is as if there were none. The earlier result counts as an upload of who names it.
#[tokio::test]
async fn an_earlier_bake_is_one_that_its_caller_sees_and_counts() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("callers.toml"), CALLERS).unwrap();
    let server = Server::start_in(folder.path(), &["--callers-file", "callers.toml"]);
    let known = async |name: &str| {
        let target = Target { token: Some(format!("token of {name}")), ..server.target() };
        let mut connection = Connection::open(&target).await.unwrap();
        let files = ["cone-small.glb", "stick.glb"].map(content);
        let files = files.into_iter().map(|bytes| (sha256(&bytes), Bytes::from(bytes)));
        connection.upload(&files.collect()).await.unwrap();
        connection
    };
    let (mut anna, mut ben) = (known("anna").await, known("ben").await);
    let of_anna = accepted_id(&baked(&mut anna, short(1)).await.unwrap());
    refused(&mut ben, more(&of_anna), &["there is no bake"]).await;
    let of_ben = accepted_id(&baked(&mut ben, short(1)).await.unwrap());
    assert_ne!(of_anna, of_ben);
    let result = server.path("data/bakes").join(&of_ben).join("result.glb");
    let before = kept(&server.path("data/assets"));
    baked(&mut ben, more(&of_ben)).await.unwrap();
    let own = std::fs::metadata(result).unwrap().len();
    assert_eq!(kept(&server.path("data/assets")), before + own, "once for each project");
    baked(&mut ben, more(&of_ben)).await.unwrap();
    assert_eq!(kept(&server.path("data/assets")), before + own);
}

/// Bytes of the files in a folder.
fn kept(folder: &Path) -> u64 {
    std::fs::read_dir(folder).unwrap().flatten().map(|entry| entry.metadata().unwrap().len()).sum()
}
