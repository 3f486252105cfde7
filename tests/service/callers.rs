//! Several callers, each with its own rights and limits.

use crate::server::{Server, assert_fault, command, endless, request, short, take};
use cairn::client::{Connection, Target};
use cairn::wire::proto::{BakeRequest, BakeState, CancelBakeRequest, DeleteBakeRequest, ListBakesRequest};
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
    crate::server::accepted_id(&take(stream, 1).await.0)
}

#[tokio::test]
async fn rights_limits_and_labels() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("callers.toml"), CALLERS).unwrap();
    let server = Server::start_in(folder.path(), &["--callers-file", "callers.toml", "--workers", "2"]);
    assert!(Connection::open(&server.target()).await.is_err(), "nobody without a name");
    let (mut anna, mut ben) = (known(&server, "anna").await, known(&server, "ben").await);
    let mut farm = known(&server, "the farm").await;
    let files = ["cone-small.glb", "stick.glb"].map(crate::server::content);
    anna.upload(&files.into_iter().map(|bytes| (crate::server::sha256(&bytes), bytes.into())).collect()).await.unwrap();

    // One runs, one waits, and a third is refused, although the server has free permits.
    let labels = |shot: &str| [("shot".to_owned(), shot.to_owned())].into();
    let first = begin(&mut anna, BakeRequest { labels: labels("a1"), ..request(endless(1)) }).await;
    let second = begin(&mut anna, BakeRequest { labels: labels("a2"), ..request(endless(2)) }).await;
    let refused = anna.service.bake(request(endless(3))).await.unwrap_err();
    assert_fault(&refused, Code::ResourceExhausted, "CALLER_LIMIT");
    crate::server::until(&mut anna, &first, BakeState::Running).await;
    let third = begin(&mut ben, request(endless(4))).await;
    crate::server::until(&mut ben, &third, BakeState::Running).await;
    assert_eq!(crate::server::status(&mut anna, &second).await.state(), BakeState::Queued, "one of hers at once");

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
    let files = ["cone-small.glb", "stick.glb"].map(crate::server::content);
    anna.upload(&files.into_iter().map(|bytes| (crate::server::sha256(&bytes), bytes.into())).collect()).await.unwrap();
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
    let files = ["cone-small.glb", "stick.glb"].map(crate::server::content);
    anna.upload(&files.into_iter().map(|bytes| (crate::server::sha256(&bytes), bytes.into())).collect()).await.unwrap();
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
