//! Quotas mean what they say: uploads count, nobody loses a bake by another's flood, and limits outlive a restart.

use crate::service::callers::until_logged;
use crate::service::server::{
    Server, accepted_id, assert_fault, begin, content, endless, events, request, sha256, short, spec, status, until,
};
use bytes::Bytes;
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::{BakeState, CancelBakeRequest, DeleteBakeRequest};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;
use tonic::{Code, Status};

/// Bytes of a small upload: many of them fit into no limit here.
const PIECE: usize = 300 << 10;

const CALLERS: &str = "
[[project]]
name = 'dune'
store_mib = 1

[[project]]
name = 'heat'

[[project]]
name = 'mars'

[[caller]]
name = 'anna'
token = 'token of anna'
store_mib = 1
bakes = 1

[[caller]]
name = 'ben'
token = 'token of ben'

[[caller]]
name = 'cleo'
token = 'token of cleo'

[[caller]]
name = 'dora'
token = 'token of dora'
project = 'dune'

[[caller]]
name = 'ed'
token = 'token of ed'
project = 'dune'

[[caller]]
name = 'hal'
token = 'token of hal'
project = 'heat'

[[caller]]
name = 'mia'
token = 'token of mia'
project = 'mars'
";

fn start(folder: &Path, arguments: &[&str]) -> Server {
    std::fs::write(folder.join("callers.toml"), CALLERS).unwrap();
    Server::start_in(folder, &[&["--callers-file", "callers.toml"], arguments].concat())
}

async fn known(server: &Server, name: &str) -> Connection {
    let target = Target { token: Some(format!("token of {name}")), ..server.target() };
    Connection::open(&target).await.unwrap()
}

/// The models of the scenes here.
fn models() -> BTreeMap<String, Bytes> {
    let files = ["cone-small.glb", "stick.glb"].map(content);
    files.into_iter().map(|bytes| (sha256(&bytes), bytes.into())).collect()
}

/// Uploads something new of this size.
async fn upload(connection: &mut Connection, number: u8, bytes: usize) -> Result<(), Status> {
    let content = Bytes::from(vec![number; bytes]);
    connection.upload(&[(sha256(&content), content)].into()).await
}

/// A finished bake.
async fn baked(connection: &mut Connection, seed: i64) -> String {
    connection.upload(&models()).await.unwrap();
    let (answer, end) = events(connection.service.bake(request(short(seed))).await.unwrap().into_inner()).await;
    end.unwrap();
    accepted_id(&answer)
}

/// Bytes of all uploads that are kept.
fn kept(server: &Server) -> u64 {
    let entries = std::fs::read_dir(server.path("data/assets")).unwrap().flatten();
    entries.map(|entry| entry.metadata().unwrap().len()).sum()
}

/// Anna may keep 1 MiB and uploads ten times as much: her own uploads make room, and Ben's bake stays.
#[tokio::test]
async fn uploads_count_and_cost_nobody_else_a_bake() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path(), &["--store-mib", "3", "--asset-mib", "8"]);
    let (mut anna, mut ben) = (known(&server, "anna").await, known(&server, "ben").await);
    let bens = baked(&mut ben, 1).await;
    let before = kept(&server);
    for number in 0..20 {
        upload(&mut anna, number, PIECE).await.unwrap();
        assert!(kept(&server) <= before + (1 << 20), "she keeps more than she may");
    }
    until_logged(&server, "owner=\"anna\"").await;
    assert!(server.log().contains("its owner uploads more than it may keep"), "{}", server.log());
    // What cannot fit is refused before it is sent.
    let refused = upload(&mut anna, 30, 2 << 20).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
    assert!(refused.message().contains("anna may keep 1048576 bytes"), "{refused:?}");

    // Without a limit of her own, Cleo floods the store: it takes from her.
    let mut cleo = known(&server, "cleo").await;
    for number in 0..20 {
        upload(&mut cleo, 100 + number, PIECE).await.unwrap();
    }
    until_logged(&server, "its owner is furthest above its share").await;
    assert_eq!(status(&mut ben, &bens).await.state(), BakeState::Succeeded);
    let evicted: Vec<String> =
        server.log().lines().filter(|line| line.contains("evicted")).map(str::to_owned).collect();
    assert!(evicted.iter().all(|line| !line.contains("owner=\"ben\"")), "{evicted:?}");
}

/// What members upload counts toward their project, before a restart and after it.
#[tokio::test]
async fn uploads_count_toward_the_project() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = start(folder.path(), &[]);
    let mut dora = known(&server, "dora").await;
    for number in 0..3 {
        upload(&mut dora, number, PIECE).await.unwrap();
    }
    let mut ed = known(&server, "ed").await;
    // Her uploads are not his: nothing of his own makes room.
    let refused = upload(&mut ed, 9, PIECE).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
    assert!(refused.message().contains("project dune may keep 1048576 bytes"), "{refused:?}");
    server.signal("-KILL");
    server.wait();
    let next = start(folder.path(), &[]);
    let refused = upload(&mut known(&next, "ed").await, 9, PIECE).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
    // Hers do.
    upload(&mut known(&next, "dora").await, 8, PIECE).await.unwrap();
    assert_eq!(kept(&next), 3 * PIECE as u64);
}

/// Her uploads count toward the limit of her bakes, too.
#[tokio::test]
async fn a_bake_is_refused_where_uploads_take_all() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path(), &[]);
    let mut anna = known(&server, "anna").await;
    anna.upload(&models()).await.unwrap();
    let most = (1 << 20) - usize::try_from(kept(&server)).unwrap();
    upload(&mut anna, 1, most - (8 << 10)).await.unwrap();
    let id = baked(&mut anna, 1).await;
    let refused = anna.service.bake(request(short(2))).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
    assert!(refused.message().contains("the bakes and uploads of anna take"), "{refused:?}");
    // A deleted bake makes room again.
    anna.service.delete_bake(DeleteBakeRequest { bake_id: id }).await.unwrap();
    baked(&mut anna, 2).await;
}

/// One may run at once, before a restart and after it.
#[tokio::test]
async fn limits_hold_for_bakes_that_resume() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = start(folder.path(), &["--workers", "2"]);
    let mut anna = known(&server, "anna").await;
    anna.upload(&models()).await.unwrap();
    let mut ids = Vec::new();
    for seed in 1..=2 {
        ids.push(begin(&mut anna, endless(seed)).await);
    }
    until(&mut anna, &ids[0], BakeState::Running).await;
    server.signal("-KILL");
    server.wait();
    let next = start(folder.path(), &["--workers", "2"]);
    let mut anna = known(&next, "anna").await;
    until_logged(&next, "started").await;
    /// Looks at both, a moment apart: the second one would begin at once if it could.
    const LOOKS: usize = 50;
    for _ in 0..LOOKS {
        let mut running = 0;
        for id in &ids {
            running += usize::from(status(&mut anna, id).await.state() == BakeState::Running);
        }
        assert!(running <= 1, "one allowed, two run");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    for id in ids {
        anna.service.cancel_bake(CancelBakeRequest { bake_id: id }).await.unwrap();
    }
}

/// What two callers want stays for the other one when the store takes from who pays for it.
#[tokio::test]
async fn a_bake_that_others_want_is_paid_by_them() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path(), &["--store-mib", "2"]);
    let (mut cleo, mut ben) = (known(&server, "cleo").await, known(&server, "ben").await);
    let shared = baked(&mut cleo, 1).await;
    assert_eq!(baked(&mut ben, 1).await, shared);
    for number in 0..10 {
        upload(&mut cleo, number, PIECE).await.unwrap();
    }
    until_logged(&server, "its owner is furthest above its share").await;
    assert_eq!(status(&mut ben, &shared).await.state(), BakeState::Succeeded);
}

/// A bake whose fill is in the cache has no such stage: that would show one project the work of another work.
#[tokio::test]
async fn the_cache_of_one_project_is_not_that_of_another() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path(), &[]);
    let recalled = async |name: &str, frames: usize| {
        let mut connection = known(&server, name).await;
        connection.upload(&models()).await.unwrap();
        let variant = spec(&["fill.count=12", &format!("output.frames={frames}")]);
        let (answer, end) = events(connection.service.bake(request(variant)).await.unwrap().into_inner()).await;
        end.unwrap();
        let bake = status(&mut connection, &accepted_id(&answer)).await;
        let counts = bake.summary.unwrap().counts;
        ["fill_steps_recalled", "steps_recalled"].map(|name| counts.get(name).copied().unwrap_or(0))
    };
    assert_eq!(recalled("hal", 4).await, [0, 0]);
    assert!(recalled("hal", 5).await[0] > 0, "its own project has it");
    assert_eq!(recalled("mia", 4).await, [0, 0]);
    assert_eq!(recalled("ben", 5).await, [0, 0]);
}

/// What nobody has used for too long goes, and the log says so.
#[tokio::test]
async fn old_entries_go_by_the_time_of_the_store() {
    let folder = tempfile::tempdir().unwrap();
    let mut server = start(folder.path(), &[]);
    let ids = [baked(&mut known(&server, "ben").await, 1).await, baked(&mut known(&server, "ben").await, 2).await];
    server.signal("-KILL");
    server.wait();
    let status = server.path("data/bakes").join(&ids[0]).join("status.binpb");
    let two_days_ago = std::time::SystemTime::now() - Duration::from_secs(2 * 86_400);
    std::fs::File::options().append(true).open(status).unwrap().set_modified(two_days_ago).unwrap();
    let next = start(folder.path(), &["--store-days", "1"]);
    until_logged(&next, "nobody has used it for store_days").await;
    assert!(!next.path("data/bakes").join(&ids[0]).exists() && next.path("data/bakes").join(&ids[1]).exists());
}
