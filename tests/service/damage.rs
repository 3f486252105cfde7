//! Foreign changes in a server's folder: other files, and truncated, emptied or changed ones.

use crate::service::server::{
    Server, accepted_id, assert_fault, channel, content, events, numbered, request, sha256, short, status, watch,
};
use cairn_service::api::pile_service_client::PileServiceClient;
use cairn_service::client::Connection;
use cairn_wire::proto::{
    Artifact, BakeState, CancelBakeRequest, DeleteBakeRequest, DownloadResultRequest, GetBakeRequest,
    GetServerInfoRequest, HaveAssetsRequest, ListBakesRequest, OutputFormat, PlanBakeRequest, WatchBakeRequest,
};
use std::path::PathBuf;
use tonic::Code;
use tonic::codec::CompressionEncoding;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

/// A finished bake: its id and its folder.
async fn baked(server: &Server, connection: &mut Connection) -> (String, PathBuf) {
    let stream = connection.service.bake(request(short(1))).await.unwrap().into_inner();
    let (events, end) = events(stream).await;
    end.unwrap();
    let id = accepted_id(&events);
    let folder = server.path("data/bakes").join(&id);
    (id, folder)
}

fn cut(path: &std::path::Path, bytes: u64) {
    std::fs::File::options().write(true).open(path).unwrap().set_len(bytes).unwrap();
}

/// Summaries are not kept in memory: they come from the disk.
#[tokio::test]
async fn a_summary_that_is_cut_off_is_found_out_and_the_bake_made_again() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (id, folder) = baked(&server, &mut connection).await;
    let answer = status(&mut connection, &id).await.summary.unwrap();
    assert!(answer.body_count > 0 && answer.result_bytes > 0);
    cut(&folder.join("status.binpb"), 10);
    let damaged = GetBakeRequest { bake_id: id.clone() };
    assert_fault(&connection.service.get_bake(damaged).await.unwrap_err(), Code::DataLoss, "BAKE_DAMAGED");
    assert_eq!(status(&mut connection, &id).await.failure.unwrap().reason, "BAKE_DAMAGED");
    assert_eq!(baked(&server, &mut connection).await.0, id);
    assert_eq!(status(&mut connection, &id).await.summary.unwrap().result_sha256, answer.result_sha256);
}

#[tokio::test]
async fn files_of_others_are_left_alone() {
    let mut server = Server::start(&[]);
    let id = baked(&server, &mut server.ready().await).await.0;
    server.signal("-KILL");
    server.wait();
    for stray in [".DS_Store", ".nfs000000000000001", "readme.txt", &"f".repeat(64)] {
        std::fs::write(server.path("data/bakes").join(stray), "not ours").unwrap();
    }
    std::fs::create_dir(server.path("data/bakes/@eaDir")).unwrap();
    let next = Server::start_in(server.folder(), &["--store-mib", "0"]);
    let mut connection = next.connect().await;
    // The limit of 0 bytes removes only the server's own files.
    for _ in 0..500 {
        if connection.watch(&id, |_| {}).await.is_err() {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    assert!(!next.path("data/bakes").join(&id).exists());
    for stray in [".DS_Store", ".nfs000000000000001", "readme.txt", &"f".repeat(64), "@eaDir"] {
        assert!(next.path("data/bakes").join(stray).exists(), "{stray}");
    }
    assert!(next.log().contains(".DS_Store"), "{}", next.log());
}

#[tokio::test]
async fn a_log_that_is_cut_off_is_found_out_and_the_bake_made_again() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (id, folder) = baked(&server, &mut connection).await;
    let log = folder.join("events.log");
    for left in [|_| 0, |_| 1, |_| 100, |whole| whole - 1] {
        let left: fn(u64) -> u64 = left;
        cut(&log, left(std::fs::metadata(&log).unwrap().len()));
        // A watcher gets the fault.
        let (_, end) = events(watch(&mut connection, &id, 1).await).await;
        assert_fault(&end.unwrap_err(), Code::DataLoss, "BAKE_DAMAGED");
        assert_eq!(status(&mut connection, &id).await.failure.unwrap().reason, "BAKE_DAMAGED");
        // A new request bakes it again.
        assert_eq!(baked(&server, &mut connection).await.0, id);
        assert_eq!(status(&mut connection, &id).await.state(), BakeState::Succeeded);
    }
    // A request before any watcher does not notice the damage.
    cut(&log, 0);
    assert_eq!(baked(&server, &mut connection).await.0, id);
    assert!(server.log().contains("damaged"), "{}", server.log());
}

#[tokio::test]
async fn a_log_that_was_cut_off_while_no_server_ran() {
    let mut server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (id, folder) = baked(&server, &mut connection).await;
    server.signal("-KILL");
    server.wait();
    cut(&folder.join("events.log"), 10);
    let next = Server::start_in(server.folder(), &[]);
    let mut connection = next.connect().await;
    assert_eq!(status(&mut connection, &id).await.failure.unwrap().reason, "BAKE_DAMAGED");
    assert_eq!(baked(&next, &mut connection).await.0, id);
}

#[tokio::test]
async fn an_unfinished_bake_without_its_events_is_planned_again() {
    let mut server = Server::start(&[]);
    let mut connection = server.ready().await;
    let id = crate::service::server::begin(&mut connection, crate::service::server::long(1)).await;
    server.signal("-KILL");
    server.wait();
    cut(&server.path("data/bakes").join(&id).join("events.log"), 0);
    let next = Server::start_in(server.folder(), &[]);
    let mut connection = next.connect().await;
    let (answer, end) = events(watch(&mut connection, &id, 1).await).await;
    end.unwrap();
    assert_eq!((accepted_id(&answer), numbered(&answer)[0].sequence_number), (id, 1));
}

/// A page token is a position in the list, which stays valid without the bake.
#[tokio::test]
async fn a_page_goes_on_where_a_bake_was_deleted() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let mut ids = Vec::new();
    for seed in 1..=3 {
        ids.push(crate::service::server::begin(&mut connection, crate::service::server::endless(seed)).await);
    }
    let mut page = ListBakesRequest { page_size: 1, ..Default::default() };
    let first = connection.service.list_bakes(page.clone()).await.unwrap().into_inner();
    assert_eq!(first.bakes[0].bake_id, ids[2]);
    connection.service.delete_bake(DeleteBakeRequest { bake_id: ids[2].clone() }).await.unwrap();
    page.page_token = first.next_page_token;
    let second = connection.service.list_bakes(page).await.unwrap().into_inner();
    assert_eq!(second.bakes[0].bake_id, ids[1]);
}

/// The health reports a missing data directory, and its return.
#[tokio::test]
async fn health_knows_the_data_directory() {
    let server = Server::start(&[]);
    // It has read its data directory once it answers.
    server.connect().await;
    let mut health = HealthClient::new(channel(&format!("http://{}", server.addresses[0])).await);
    for (from, to, status) in [("data", "gone", ServingStatus::NotServing), ("gone", "data", ServingStatus::Serving)] {
        std::fs::rename(server.path(from), server.path(to)).unwrap();
        for service in ["", "cairn.v1.PileService"] {
            let request = HealthCheckRequest { service: service.into() };
            while health.check(request.clone()).await.unwrap().into_inner().status() != status {
                tokio::time::sleep(std::time::Duration::from_millis(50)).await;
            }
        }
    }
    assert!(server.log().contains("the data directory cannot be used"), "{}", server.log());
}

/// A server that shuts down reports that to all callers, accepts no new work, and answers all other calls.
#[tokio::test]
async fn health_of_a_server_that_ends() {
    let server = Server::start(&["--drain-seconds", "20"]);
    let mut connection = server.ready().await;
    let mut health = HealthClient::new(channel(&format!("http://{}", server.addresses[0])).await);
    let id = crate::service::server::begin(&mut connection, crate::service::server::endless(1)).await;
    server.signal("-TERM");
    for service in ["", "cairn.v1.PileService"] {
        let request = HealthCheckRequest { service: service.into() };
        while health.check(request.clone()).await.unwrap().into_inner().status() != ServingStatus::NotServing {
            tokio::time::sleep(std::time::Duration::from_millis(10)).await;
        }
    }
    let service = &mut connection.service;
    // The health changes a moment before work is refused.
    while service.plan_bake(PlanBakeRequest { spec: Some(short(1)) }).await.is_ok() {
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    for refused in [
        service.upload_asset(tokio_stream::iter([])).await.map(drop),
        service.plan_bake(PlanBakeRequest { spec: Some(short(1)) }).await.map(drop),
        service.bake(request(short(1))).await.map(drop),
    ] {
        assert_fault(&refused.unwrap_err(), Code::Unavailable, "SHUTTING_DOWN");
    }
    let bake_id = id;
    service.get_server_info(GetServerInfoRequest::default()).await.unwrap();
    service.have_assets(HaveAssetsRequest::default()).await.unwrap();
    service.list_bakes(ListBakesRequest::default()).await.unwrap();
    service.get_bake(GetBakeRequest { bake_id: bake_id.clone() }).await.unwrap();
    service.watch_bake(WatchBakeRequest { bake_id: bake_id.clone(), ..Default::default() }).await.unwrap();
    let not_done = DownloadResultRequest { bake_id: bake_id.clone(), ..Default::default() };
    let not_done = service.download_result(not_done).await;
    assert_fault(&not_done.map(drop).unwrap_err(), Code::FailedPrecondition, "BAKE_NOT_DONE");
    service.cancel_bake(CancelBakeRequest { bake_id: bake_id.clone() }).await.unwrap();
    service.delete_bake(DeleteBakeRequest { bake_id }).await.unwrap();
}

/// Some libraries compress their messages.
#[tokio::test]
async fn requests_compressed_by_gzip() {
    let server = Server::start(&[]);
    server.ready().await;
    let channel = channel(&format!("http://{}", server.addresses[0])).await;
    let mut client = PileServiceClient::new(channel).send_compressed(CompressionEncoding::Gzip);
    let (answer, end) = events(client.bake(request(short(1))).await.unwrap().into_inner()).await;
    end.unwrap();
    let bake = client.get_bake(GetBakeRequest { bake_id: accepted_id(&answer) }).await.unwrap().into_inner().bake;
    assert_eq!(bake.unwrap().state(), BakeState::Succeeded);
}

/// The cache of fills counts toward the store's limit, and is removed before any result.
#[tokio::test]
async fn the_cache_counts_and_goes_first() {
    let server = Server::start(&["--store-mib", "2"]);
    let mut connection = server.ready().await;
    let (first, _) = baked(&server, &mut connection).await;
    let cache = server.path("data/cache");
    assert!(cache.read_dir().unwrap().next().is_some(), "a fill is kept");
    // More than the limit leaves.
    std::fs::write(cache.join("large"), vec![0; 3 << 20]).unwrap();
    let stream = connection.service.bake(request(short(2))).await.unwrap().into_inner();
    let (answer, end) = events(stream).await;
    end.unwrap();
    for _ in 0..500 {
        if !cache.join("large").exists() {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    assert!(!cache.join("large").exists(), "the cache is gone");
    for id in [first, accepted_id(&answer)] {
        assert_eq!(status(&mut connection, &id).await.state(), BakeState::Succeeded, "results stay");
    }
}

#[tokio::test]
async fn a_changed_result_is_not_handed_out() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    for (name, artifact) in [("result.glb", Artifact::Result), ("report.json", Artifact::Report)] {
        let (id, folder) = baked(&server, &mut connection).await;
        let mut bytes = std::fs::read(folder.join(name)).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(folder.join(name), bytes).unwrap();
        let refused = connection.download(&id, artifact).await.unwrap_err();
        assert_fault(&refused, Code::DataLoss, "BAKE_DAMAGED");
        assert_eq!(baked(&server, &mut connection).await.0, id);
        connection.download(&id, artifact).await.unwrap();
    }
}

/// A byte of the events that the disk has changed is noticed before anybody gets it.
#[tokio::test]
async fn a_changed_event_is_not_handed_out() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (id, folder) = baked(&server, &mut connection).await;
    let log = folder.join("events.log");
    let whole = std::fs::read(&log).unwrap();
    let (sound, end) = events(watch(&mut connection, &id, 1).await).await;
    end.unwrap();
    let at = [20, whole.len() / 2, whole.len() - 1];
    for at in at {
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        std::fs::write(&log, bytes).unwrap();
        let (answer, end) = events(watch(&mut connection, &id, 1).await).await;
        assert_fault(&end.unwrap_err(), Code::DataLoss, "BAKE_DAMAGED");
        let events = numbered(&answer);
        assert!(events.len() < sound.len() && numbered(&sound).starts_with(&events), "byte {at}");
        assert_eq!(baked(&server, &mut connection).await.0, id);
    }
}

/// The pile of which further results are made is looked at, too.
#[tokio::test]
async fn no_result_is_made_of_a_changed_pile() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (id, folder) = baked(&server, &mut connection).await;
    let mut bytes = std::fs::read(folder.join("baked.postcard")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(folder.join("baked.postcard"), bytes).unwrap();
    let csv = DownloadResultRequest { bake_id: id.clone(), format: OutputFormat::Csv.into(), ..Default::default() };
    let refused = connection.service.download_result(csv).await.unwrap_err();
    assert_fault(&refused, Code::DataLoss, "BAKE_DAMAGED");
    assert!(refused.message().contains("it has changed since it was written"), "{refused:?}");
}

/// A disk or a network drive that is away for some seconds damages nothing, and needs no restart.
#[tokio::test]
async fn a_data_directory_that_is_away_for_a_moment_damages_nothing() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (id, _) = baked(&server, &mut connection).await;
    let (bake_id, fetch) = (id.clone(), DownloadResultRequest { bake_id: id.clone(), ..Default::default() });
    for is_empty_there in [false, true] {
        std::fs::rename(server.path("data"), server.path("away")).unwrap();
        if is_empty_there {
            std::fs::create_dir_all(server.path("data/bakes")).unwrap();
        }
        let service = &mut connection.service;
        let watched = match service.watch_bake(WatchBakeRequest { bake_id: id.clone(), ..Default::default() }).await {
            Ok(stream) => events(stream.into_inner()).await.1.unwrap_err(),
            Err(refused) => refused,
        };
        for refused in [
            watched,
            service.get_bake(GetBakeRequest { bake_id: bake_id.clone() }).await.unwrap_err(),
            service.bake(request(short(1))).await.unwrap_err(),
            service.plan_bake(PlanBakeRequest { spec: Some(short(2)) }).await.unwrap_err(),
            service.download_result(fetch.clone()).await.map(drop).unwrap_err(),
            service.delete_bake(DeleteBakeRequest { bake_id: bake_id.clone() }).await.unwrap_err(),
        ] {
            let details = assert_fault(&refused, Code::Unavailable, "DATA_AWAY");
            assert!(details.retry_info().is_some());
            assert!(refused.message().contains("is away, or another folder is in its place"), "{refused:?}");
        }
        assert_eq!(server.path("data").exists(), is_empty_there, "no folder appears in its place");
        if is_empty_there {
            std::fs::remove_dir_all(server.path("data")).unwrap();
        }
        std::fs::rename(server.path("away"), server.path("data")).unwrap();
        assert_eq!(status(&mut connection, &id).await.state(), BakeState::Succeeded);
        connection.download(&id, Artifact::Result).await.unwrap();
    }
}

/// No bake is made of an upload that the disk has changed.
#[tokio::test]
async fn a_changed_upload_is_not_baked() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let path = server.path("data/assets").join(sha256(&content("stick.glb")));
    let mut bytes = std::fs::read(&path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(path, bytes).unwrap();
    let refused = connection.service.plan_bake(PlanBakeRequest { spec: Some(short(1)) }).await.unwrap_err();
    assert_fault(&refused, Code::InvalidArgument, "SCENE_INVALID");
    assert!(refused.message().contains("the server's copy has changed since it was uploaded"), "{refused:?}");
}
