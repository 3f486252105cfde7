//! Several callers, each with its own rights and limits.

use crate::service::server::{Server, assert_fault, command, endless, request, short, take};
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::{
    BakeRequest, BakeState, CancelBakeRequest, DeleteBakeRequest, DownloadResultRequest, GetBakeRequest,
    HaveAssetsRequest, ListBakesRequest, WatchBakeRequest,
};
use std::time::Duration;
use tonic::Code;

const CALLERS: &str = "
[[caller]]
name = 'anna'
token = 'token of anna'
bakes = 1
queue = 1

[[caller]]
name = 'ben'
token = 'token of ben'

[[caller]]
name = 'farm'
token = 'token of the farm'
role = 'operator'
store_mib = 0
";

async fn known(server: &Server, name: &str) -> Connection {
    let target = Target { token: Some(format!("token of {name}")), ..server.target() };
    Connection::open(&target).await.unwrap()
}

async fn ids(connection: &mut Connection, list: ListBakesRequest) -> Vec<String> {
    let list = connection.service.list_bakes(list).await.unwrap().into_inner();
    list.bakes.into_iter().map(|bake| bake.bake_id).collect()
}

async fn begin(connection: &mut Connection, request: BakeRequest) -> String {
    let stream = connection.service.bake(request).await.unwrap().into_inner();
    crate::service::server::accepted_id(&take(stream, 1).await.0)
}

#[tokio::test]
async fn rights_limits_and_labels() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("callers.toml"), CALLERS).unwrap();
    let server = Server::start_in(folder.path(), &["--callers-file", "callers.toml", "--workers", "2"]);
    assert!(Connection::open(&server.target()).await.is_err(), "nobody without a name");
    let (mut anna, mut ben) = (known(&server, "anna").await, known(&server, "ben").await);
    let mut farm = known(&server, "the farm").await;
    let files = ["cone-small.glb", "stick.glb"].map(crate::service::server::content);
    anna.upload(&files.into_iter().map(|bytes| (crate::service::server::sha256(&bytes), bytes.into())).collect())
        .await
        .unwrap();

    // One runs, one waits, and a third is refused, although the server has free permits.
    let labels = |shot: &str| [("shot".to_owned(), shot.to_owned())].into();
    let first = begin(&mut anna, BakeRequest { labels: labels("a1"), ..request(endless(1)) }).await;
    let second = begin(&mut anna, BakeRequest { labels: labels("a2"), ..request(endless(2)) }).await;
    let refused = anna.service.bake(request(endless(3))).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
    crate::service::server::until(&mut anna, &first, BakeState::Running).await;
    let third = begin(&mut ben, request(endless(4))).await;
    crate::service::server::until(&mut ben, &third, BakeState::Running).await;
    assert_eq!(
        crate::service::server::status(&mut anna, &second).await.state(),
        BakeState::Queued,
        "one of hers at once"
    );

    // Found by owner, label and state.
    let list = |owner: &str| ListBakesRequest { owner: owner.into(), ..Default::default() };
    assert_eq!(ids(&mut ben, list("anna")).await, [second.clone(), first.clone()]);
    assert_eq!(ids(&mut ben, list("ben")).await, [third.as_str()]);
    assert_eq!(ids(&mut ben, ListBakesRequest { labels: labels("a2"), ..Default::default() }).await, [second.as_str()]);
    let states = vec![BakeState::Queued.into()];
    assert_eq!(ids(&mut ben, ListBakesRequest { states, ..Default::default() }).await, [second.as_str()]);

    // Ben may watch her bake, but not end it; the farm may.
    let cancel = |id: &str| CancelBakeRequest { bake_id: id.into() };
    assert_fault(&ben.service.cancel_bake(cancel(&first)).await.unwrap_err(), Code::PermissionDenied, "NOT_YOURS");
    let delete = DeleteBakeRequest { bake_id: first.clone() };
    assert_fault(&ben.service.delete_bake(delete).await.unwrap_err(), Code::PermissionDenied, "NOT_YOURS");
    let urgent = BakeRequest { priority: 1, ..request(endless(5)) };
    assert_fault(&ben.service.bake(urgent).await.unwrap_err(), Code::PermissionDenied, "NOT_ALLOWED");
    for id in [&first, &second, &third] {
        farm.service.cancel_bake(cancel(id)).await.unwrap();
    }
    // The farm may store no bytes, not even those of its first bake.
    let wrong = BakeRequest { labels: [("Shot 1".to_owned(), String::new())].into(), ..request(short(1)) };
    assert_fault(&ben.service.bake(wrong).await.unwrap_err(), Code::InvalidArgument, "REQUEST_INVALID");
    let refused = farm.service.bake(request(short(1))).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
    until_logged(&server, "caller=\"ben\" call=\"CancelBake\" status=\"7\"").await;
}

/// Two callers want one bake: each has its own labels of it, and who withdraws takes nothing from the other.
#[tokio::test]
async fn a_bake_belongs_to_all_who_want_it() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("callers.toml"), CALLERS).unwrap();
    let server = Server::start_in(folder.path(), &["--callers-file", "callers.toml", "--workers", "1"]);
    let (mut anna, mut ben) = (known(&server, "anna").await, known(&server, "ben").await);
    let mut farm = known(&server, "the farm").await;
    let files = ["cone-small.glb", "stick.glb"].map(crate::service::server::content);
    anna.upload(&files.into_iter().map(|bytes| (crate::service::server::sha256(&bytes), bytes.into())).collect())
        .await
        .unwrap();
    let labelled =
        |shot: &str, spec| BakeRequest { labels: [("shot".to_owned(), shot.to_owned())].into(), ..request(spec) };
    let id = begin(&mut anna, labelled("A010.v2: Höhle", endless(1))).await;
    assert_eq!(begin(&mut ben, labelled("b7", endless(1))).await, id);
    let list = |owner: &str, shot: &str| ListBakesRequest {
        owner: owner.into(),
        labels: [("shot".to_owned(), shot.to_owned())].into(),
        ..Default::default()
    };
    for found in [list("anna", "A010.v2: Höhle"), list("ben", "b7")] {
        assert_eq!(ids(&mut farm, found).await, [id.as_str()]);
    }
    assert!(ids(&mut farm, list("", "b8")).await.is_empty());

    // She withdraws, by the beginning of the id; it goes on for him, and ends with him.
    let cancel = |id: &str| CancelBakeRequest { bake_id: id.into() };
    let left = anna.service.cancel_bake(cancel(&id[..8])).await.unwrap().into_inner().bake.unwrap();
    assert!(left.state() == BakeState::Running || left.state() == BakeState::Queued, "{left:?}");
    assert_eq!(left.callers.iter().map(|caller| &*caller.name).collect::<Vec<_>>(), ["ben"]);
    let ended = ben.service.cancel_bake(cancel(&id)).await.unwrap().into_inner().bake.unwrap();
    assert_eq!(ended.state(), BakeState::Cancelled);

    // An operator ends it for all.
    let id = begin(&mut anna, request(endless(2))).await;
    begin(&mut ben, request(endless(2))).await;
    let ended = farm.service.cancel_bake(cancel(&id)).await.unwrap().into_inner().bake.unwrap();
    assert_eq!(ended.state(), BakeState::Cancelled);

    // The message says which part of a label is at fault.
    for (name, value, words) in [
        ("Shot", "1", "does not begin with a letter from a to z"),
        ("shot 1", "1", "other characters than"),
        ("shot", "a\nb", "its value has control characters"),
        ("shot", &"x".repeat(256), "its value has 256 bytes; give 255 at most"),
        (&"x".repeat(64), "1", "its name has 64 characters; give 63 at most"),
    ] {
        let labels = [(name.to_owned(), value.to_owned())].into();
        let refused = ben.service.bake(BakeRequest { labels, ..request(short(1)) }).await.unwrap_err();
        let details = assert_fault(&refused, Code::InvalidArgument, "REQUEST_INVALID");
        assert!(details.bad_request().unwrap().field_violations[0].description.contains(words), "{refused:?}");
    }
}

const PROJECTS: &str = "
[[project]]
name = 'dune'
queue = 1
bakes = 1

[[project]]
name = 'heat'

[[caller]]
name = 'anna'
token = 'token of anna'
project = 'dune'

[[caller]]
name = 'ben'
token = 'token of ben'
project = 'dune'

[[caller]]
name = 'cleo'
token = 'token of cleo'
project = 'heat'
role = 'operator'

[[caller]]
name = 'farm'
token = 'token of the farm'
role = 'operator'

[[caller]]
name = 'guest'
token = 'token of guest'
";

/// Shows see nothing of each other, and share their own limits.
#[tokio::test]
async fn projects_are_apart() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("callers.toml"), PROJECTS).unwrap();
    let arguments = ["--callers-file", "callers.toml", "--workers", "3"];
    let server = Server::start_in(folder.path(), &arguments);
    let (mut anna, mut ben, mut cleo) =
        (known(&server, "anna").await, known(&server, "ben").await, known(&server, "cleo").await);
    let (mut farm, mut guest) = (known(&server, "the farm").await, known(&server, "guest").await);
    let files = ["cone-small.glb", "stick.glb"].map(crate::service::server::content);
    let files: Vec<_> = files.into_iter().map(|bytes| (crate::service::server::sha256(&bytes), bytes.into())).collect();
    let files: std::collections::BTreeMap<String, bytes::Bytes> = files.into_iter().collect();
    anna.upload(&files).await.unwrap();

    // A file of one show is not there for another one, whoever knows its hash.
    let wanted = HaveAssetsRequest { sha256: files.keys().cloned().collect() };
    let missing = async |connection: &mut Connection| {
        connection.service.have_assets(wanted.clone()).await.unwrap().into_inner().missing_sha256.len()
    };
    assert_eq!((missing(&mut ben).await, missing(&mut cleo).await, missing(&mut guest).await), (0, 2, 2));
    let refused = cleo.service.bake(request(endless(1))).await.unwrap_err();
    assert_fault(&refused, Code::FailedPrecondition, "ASSETS_MISSING");

    // A request of two shows is a bake of each.
    cleo.upload(&files).await.unwrap();
    let of_dune = begin(&mut anna, request(endless(1))).await;
    assert_eq!(begin(&mut ben, request(endless(1))).await, of_dune, "within a show, it is shared");
    let of_heat = begin(&mut cleo, request(endless(1))).await;
    assert_ne!(of_dune, of_heat);

    // The other one's is as if there were none, also for an operator of another show.
    let get = |id: &str| GetBakeRequest { bake_id: id.into() };
    let watch = |id: &str| WatchBakeRequest { bake_id: id.into(), ..Default::default() };
    let fetch = |id: &str| DownloadResultRequest { bake_id: id.into(), ..Default::default() };
    let cancel = |id: &str| CancelBakeRequest { bake_id: id.into() };
    let delete = |id: &str| DeleteBakeRequest { bake_id: id.into() };
    for (mut other, id) in [(cleo.clone(), &of_dune), (anna.clone(), &of_heat), (guest.clone(), &of_dune)] {
        for refused in [
            other.service.get_bake(get(id)).await.unwrap_err(),
            other.service.watch_bake(watch(id)).await.err().unwrap(),
            other.service.download_result(fetch(id)).await.err().unwrap(),
            other.service.cancel_bake(cancel(id)).await.unwrap_err(),
            other.service.delete_bake(delete(id)).await.unwrap_err(),
        ] {
            assert_fault(&refused, Code::NotFound, "BAKE_NOT_FOUND");
        }
    }
    let all = ListBakesRequest::default;
    assert_eq!(ids(&mut ben, all()).await, [of_dune.as_str()]);
    assert_eq!(ids(&mut cleo, all()).await, [of_heat.as_str()]);
    assert_eq!(ids(&mut guest, all()).await, [""; 0]);
    assert_eq!(ids(&mut farm, all()).await, [of_heat.clone(), of_dune.clone()], "the farm's operator sees all");
    let status = farm.service.get_bake(get(&of_heat)).await.unwrap().into_inner().bake.unwrap();
    assert_eq!((&*status.project, &*status.owner), ("heat", "cleo"));

    // The limits are those of the whole show: one runs and one waits, whoever asked for them.
    crate::service::server::until(&mut anna, &of_dune, BakeState::Running).await;
    let second = begin(&mut ben, request(endless(2))).await;
    assert_eq!(crate::service::server::status(&mut anna, &second).await.state(), BakeState::Queued);
    let refused = anna.service.bake(request(endless(3))).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
    assert!(refused.message().contains("project dune has 2 running or waiting bakes of at most 2"), "{refused:?}");
    let other = begin(&mut cleo, request(endless(2))).await;
    crate::service::server::until(&mut cleo, &other, BakeState::Running).await;
    until_logged(&server, "caller=\"cleo\" project=\"heat\" call=\"GetBake\" status=\"5\"").await;

    // The next server keeps them apart.
    drop(server);
    let server = Server::start_in(folder.path(), &arguments);
    let (mut ben, mut cleo) = (known(&server, "ben").await, known(&server, "cleo").await);
    assert_eq!(ids(&mut ben, all()).await, [second, of_dune.clone()]);
    assert_fault(&cleo.service.get_bake(get(&of_dune)).await.unwrap_err(), Code::NotFound, "BAKE_NOT_FOUND");
    for id in [&of_heat, &other] {
        cleo.service.cancel_bake(cancel(id)).await.unwrap();
    }
}

#[test]
fn projects_are_named_once_and_known() {
    let folder = tempfile::tempdir().unwrap();
    for (file, words) in [
        ("[[caller]]\nname = 'a'\ntoken = 't'\nproject = 'dune'", "caller `a`: there is no project `dune`"),
        (
            "[[project]]\nname = 'dune'\n[[project]]\nname = 'dune'\n[[caller]]\nname = 'a'\ntoken = 't'",
            "project `dune`: the name is empty or used twice",
        ),
    ] {
        std::fs::write(folder.path().join("callers.toml"), file).unwrap();
        let done = command(folder.path()).args(["--callers-file", "callers.toml"]).output().unwrap();
        assert_eq!(done.status.code(), Some(78), "{done:?}");
        assert!(String::from_utf8_lossy(&done.stderr).contains(words), "{done:?}");
    }
}

/// A call's log line appears a moment after its answer.
pub async fn until_logged(server: &Server, words: &str) {
    for _ in 0..1000 {
        if server.log().contains(words) {
            return;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("{words} is missing in:\n{}", server.log());
}

/// A limit of waiting bakes also holds without a limit of running ones, which is then the number of workers.
#[tokio::test]
async fn a_limit_of_the_queue_alone() {
    let folder = tempfile::tempdir().unwrap();
    let callers = "[[caller]]\nname = 'anna'\ntoken = 'token of anna'\nqueue = 1\n";
    std::fs::write(folder.path().join("callers.toml"), callers).unwrap();
    let server = Server::start_in(folder.path(), &["--callers-file", "callers.toml", "--workers", "2"]);
    let mut anna = known(&server, "anna").await;
    let files = ["cone-small.glb", "stick.glb"].map(crate::service::server::content);
    anna.upload(&files.into_iter().map(|bytes| (crate::service::server::sha256(&bytes), bytes.into())).collect())
        .await
        .unwrap();
    for seed in 1..=3 {
        begin(&mut anna, request(endless(seed))).await;
    }
    let refused = anna.service.bake(request(endless(4))).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
}

/// SIGHUP reloads the file, and keeps the old callers if the file is wrong.
#[tokio::test]
async fn callers_are_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let write = |text: &str| std::fs::write(folder.path().join("callers.toml"), text).unwrap();
    write(CALLERS);
    let server = Server::start_in(folder.path(), &["--callers-file", "callers.toml"]);
    let is_known = async |name: &str| {
        let target = Target { token: Some(format!("token of {name}")), ..server.target() };
        Connection::open(&target).await.is_ok()
    };
    assert!(is_known("anna").await && !is_known("zoe").await);
    write("[[caller]]\nname = 'zoe'\n");
    server.signal("-HUP");
    until_logged(&server, "neither a token nor a certificate").await;
    assert!(is_known("anna").await, "what is wrong changes nothing");
    write("[[caller]]\nname = 'zoe'\ntoken = 'token of zoe'\n");
    server.signal("-HUP");
    until_logged(&server, "were reloaded").await;
    assert!(is_known("zoe").await && !is_known("anna").await);
}

/// A bake that waits starts by the limits that hold then, not by those of its request.
#[tokio::test]
async fn bakes_that_wait_have_the_limits_of_now() {
    let folder = tempfile::tempdir().unwrap();
    let write = |text: &str| std::fs::write(folder.path().join("callers.toml"), text).unwrap();
    write(CALLERS);
    let server = Server::start_in(folder.path(), &["--callers-file", "callers.toml", "--workers", "2"]);
    let mut anna = known(&server, "anna").await;
    crate::service::attacks::upload(&mut anna, &["cone-small.glb", "stick.glb"].map(crate::service::server::content))
        .await;
    let first = begin(&mut anna, request(endless(1))).await;
    let second = begin(&mut anna, request(endless(2))).await;
    crate::service::server::until(&mut anna, &first, BakeState::Running).await;
    assert_eq!(crate::service::server::status(&mut anna, &second).await.state(), BakeState::Queued);
    write(&CALLERS.replace("bakes = 1", "bakes = 2"));
    server.signal("-HUP");
    crate::service::server::until(&mut anna, &second, BakeState::Running).await;
}

#[test]
fn a_wrong_file_of_callers_is_told() {
    let folder = tempfile::tempdir().unwrap();
    for (text, words) in [
        ("[[caller]]\nname = 'a'\n", "neither a token nor a certificate"),
        (
            "[[caller]]\nname = 'a'\ntoken = 'x'\n[[caller]]\nname = 'a'\ntoken = 'x'\n",
            "another caller has the same token",
        ),
        ("[[caller]]\nname = ''\ntoken = 'x'\n", "the name is empty or used twice"),
        ("[[caller]]\nname = 'a'\nrole = 'king'\n", "callers.toml:3"),
        ("caller = []\n", "there is no caller"),
    ] {
        std::fs::write(folder.path().join("callers.toml"), text).unwrap();
        let done = command(folder.path()).args(["--callers-file", "callers.toml"]).output().unwrap();
        let said = String::from_utf8(done.stderr).unwrap();
        assert!(done.status.code() == Some(78) && said.contains(words), "{said}");
    }
}
