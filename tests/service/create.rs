//! Bakes that nobody follows: begun one by one or many at once, and reported at their end.

use crate::service::server::{Server, assert_fault, command, fields, sha256, short, until};
use cairn_wire::proto::created_bake::Outcome;
use cairn_wire::proto::{BakeState, BatchCreateBakesRequest, CreateBakeRequest};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::time::Duration;
use tonic::Code;

fn asked(seed: i64) -> CreateBakeRequest {
    CreateBakeRequest { spec: Some(short(seed)), ..Default::default() }
}

/// The hook writes what it gets, and the signature, beside itself.
const HOOK: &str = r#"#!/bin/sh
own="$(dirname "$0")/$$"
cat > "$own.part"
printf %s "$CAIRN_SIGNATURE" > "$own.signature"
mv "$own.part" "$own.status"
"#;

#[cfg(unix)]
#[tokio::test]
async fn bakes_are_begun_and_their_ends_reported() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let hook = folder.path().join("hook");
    std::fs::write(&hook, HOOK).unwrap();
    std::fs::set_permissions(&hook, std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::write(folder.path().join("key"), "a long random text\n").unwrap();
    let args = ["--hook", hook.to_str().unwrap(), "--hook-key-file", "key", "--workers", "2"];
    let server = Server::start_in(folder.path(), &args);
    let mut connection = server.ready().await;
    let labels = [("shot".to_owned(), "a010".to_owned())].into();
    let one = CreateBakeRequest { labels, ..asked(1) };
    let bake = connection.service.create_bake(one.clone()).await.unwrap().into_inner().bake.unwrap();
    assert!(matches!(bake.state(), BakeState::Queued | BakeState::Running), "{bake:?}");
    until(&mut connection, &bake.bake_id, BakeState::Succeeded).await;
    // The same again is the same bake, which has ended.
    let again = connection.service.create_bake(one).await.unwrap().into_inner().bake.unwrap();
    assert_eq!((again.state(), &again.bake_id), (BakeState::Succeeded, &bake.bake_id));

    // Of many, each has its own outcome.
    let mut wrong = asked(3);
    wrong.spec.as_mut().unwrap().assets[1].sha256 = sha256(b"never uploaded");
    let batch = BatchCreateBakesRequest { requests: vec![asked(2), wrong, CreateBakeRequest::default(), asked(4)] };
    let bakes = connection.service.batch_create_bakes(batch).await.unwrap().into_inner().bakes;
    let outcomes: Vec<String> = bakes
        .into_iter()
        .map(|created| match created.outcome.unwrap() {
            Outcome::Bake(bake) => bake.bake_id,
            Outcome::Failure(failure) => failure.reason,
        })
        .collect();
    assert_eq!(outcomes[1..3], ["ASSETS_MISSING", "REQUEST_INVALID"]);
    for id in [&outcomes[0], &outcomes[3]] {
        until(&mut connection, id, BakeState::Succeeded).await;
    }
    let none = connection.service.batch_create_bakes(BatchCreateBakesRequest::default()).await.unwrap_err();
    assert_eq!(fields(&assert_fault(&none, Code::InvalidArgument, "REQUEST_INVALID")), ["requests"]);

    // The operator's program gets each end once, and can check by whom.
    let reported = || -> Vec<std::path::PathBuf> {
        let entries = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
        entries.filter(|path| path.extension().is_some_and(|extension| extension == "status")).collect()
    };
    while reported().len() < 3 {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    let mut ids = Vec::new();
    for path in reported() {
        let text = std::fs::read(&path).unwrap();
        let mut mac = Hmac::<Sha256>::new_from_slice(b"a long random text").unwrap();
        mac.update(&text);
        let expected: String = mac.finalize().into_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(std::fs::read_to_string(path.with_extension("signature")).unwrap(), expected);
        let status: serde_json::Value = serde_json::from_slice(&text).unwrap();
        assert_eq!((status["state"].as_str(), status["bodies"].as_i64()), (Some("succeeded"), Some(12)));
        ids.push(status["id"].as_str().unwrap().to_owned());
    }
    ids.sort();
    let mut expected = vec![bake.bake_id, outcomes[0].clone(), outcomes[3].clone()];
    expected.sort();
    assert_eq!(ids, expected);
}

#[test]
fn a_hook_that_cannot_be_is_reported_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("empty"), "\n").unwrap();
    for (args, words) in [
        (&["--hook", "gone"][..], "no such file (hook)"),
        (&["--hook-key-file", "empty"], "there is no hook"),
        (&["--hook", "empty", "--hook-key-file", "empty"], "the key is empty"),
    ] {
        let done = command(folder.path()).args(["--listen", "127.0.0.1:0"]).args(args).output().unwrap();
        let said = String::from_utf8(done.stderr).unwrap();
        assert!(done.status.code() == Some(78) && said.contains(words), "{said}");
    }
}

/// A copy of the data folder of a running server is a backup; a folder of a newer layout is left as it is.
#[tokio::test]
async fn a_copy_of_the_data_is_a_backup() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let bake = connection.service.create_bake(asked(1)).await.unwrap().into_inner().bake.unwrap();
    until(&mut connection, &bake.bake_id, BakeState::Succeeded).await;
    let expected = connection.download(&bake.bake_id, cairn_wire::proto::Artifact::Result).await.unwrap();
    let copy = tempfile::tempdir().unwrap();
    let copied = std::process::Command::new("cp").arg("-r").arg(server.path("data")).arg(copy.path()).status().unwrap();
    assert!(copied.success());
    let restored = Server::start_in(copy.path(), &[]);
    let mut connection = restored.connect().await;
    assert!(connection.download(&bake.bake_id, cairn_wire::proto::Artifact::Result).await.unwrap() == expected);
    drop(restored);

    std::fs::write(copy.path().join("data/version"), "2\n").unwrap();
    let done = command(copy.path()).args(["--listen", "127.0.0.1:0"]).output().unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.code() == Some(69) && said.contains("its layout has the version 2"), "{said}");
    assert!(copy.path().join("data/bakes").join(&bake.bake_id).is_dir());
}
