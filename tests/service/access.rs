//! Access: tokens, addresses and sockets.

use crate::service::server::{Server, assert_fault, begin, channel, command, events, request, short, until};
use cairn_service::api::pile_service_client::PileServiceClient;
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::{BakeState, ListBakesRequest};
use std::io::{Read, Write};
use tokio_stream::StreamExt;
use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

#[tokio::test]
async fn a_token_is_asked_for_everywhere_but_at_health() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("token"), "open sesame\n").unwrap();
    let server = Server::start_in(folder.path(), &["--token-file", "token"]);
    for token in [None, Some("open"), Some("open sesame "), Some("")] {
        let target = Target { token: token.map(str::to_owned), ..server.target() };
        let refused = Connection::open(&target).await.err().unwrap();
        assert_fault(&refused, Code::Unauthenticated, "TOKEN_INVALID");
    }
    assert!(server.log().contains("missing or wrong token"), "{}", server.log());
    let target = Target { token: Some("open sesame".into()), ..server.target() };
    Connection::open(&target).await.unwrap();
    // The case of the scheme does not matter, and reloading changes the token.
    let address = format!("http://{}", server.addresses[0]);
    let mut plain = PileServiceClient::new(channel(&address).await);
    let mut list = async |token: &str| {
        let mut request = tonic::Request::new(ListBakesRequest::default());
        request.metadata_mut().insert("authorization", token.parse().unwrap());
        plain.list_bakes(request).await
    };
    list("bearer open sesame").await.unwrap();
    std::fs::write(folder.path().join("token"), "another").unwrap();
    server.signal("-HUP");
    while list("Bearer another").await.is_err() {
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    assert!(list("Bearer open sesame").await.is_err());

    let address = format!("http://{}", server.addresses[0]);
    let mut health = HealthClient::new(channel(&address).await);
    health.check(HealthCheckRequest { service: "cairn.v1.PileService".into() }).await.unwrap();
    let unknown = health.check(HealthCheckRequest { service: "cairn.v1.Other".into() }).await.unwrap_err();
    assert_eq!(unknown.code(), Code::NotFound);
    assert!(services_v1(address).await.is_err(), "reflection needs the token");
}

#[test]
fn no_open_port_beyond_this_machine() {
    let folder = tempfile::tempdir().unwrap();
    let run = |args: &[&str]| {
        let done = command(folder.path()).args(args).output().unwrap();
        (done.status.code(), String::from_utf8(done.stderr).unwrap())
    };
    let (code, message) = run(&["--listen", "0.0.0.0:0"]);
    assert_eq!(code, Some(78));
    assert!(message.contains("no token protects the server") && message.contains("--token-file"), "{message}");
    let (code, message) = run(&["--listen", "nowhere", "--listen", "127.0.0.1:99999"]);
    assert!(code == Some(78) && message.contains("nowhere") && message.contains("99999"), "{message}");
    let (code, message) = run(&["--tls-key", "gone.pem", "--token-file", "gone"]);
    assert!(code == Some(78) && message.contains("gone.pem") && message.contains("token_file"), "{message}");
    assert!(message.contains("only one of certificate and key is given"), "{message}");
    assert!(!folder.path().join("data").exists(), "nothing is made before all is right");
}

#[tokio::test]
async fn a_unix_socket() {
    let folder = tempfile::tempdir().unwrap();
    let socket = format!("unix:{}", folder.path().join("socket").display());
    let mut server = Server::start_in(folder.path(), &["--listen", &socket]);
    assert!(server.addresses.contains(&socket), "{:?}", server.addresses);
    let mut by_port = server.ready().await;
    let mut by_socket = Connection::open(&Target { address: socket.clone(), ..Default::default() }).await.unwrap();
    let id = begin(&mut by_socket, short(1)).await;
    until(&mut by_port, &id, BakeState::Succeeded).await;
    // The socket of a killed server does not matter, and a server that ends normally leaves none.
    server.signal("-KILL");
    server.wait();
    let mut server = Server::start_in(folder.path(), &["--listen", &socket]);
    server.signal("-TERM");
    assert_eq!(server.wait(), Some(0));
    assert!(!folder.path().join("socket").exists());
}

async fn services_v1(address: String) -> Result<Vec<String>, tonic::Status> {
    use tonic_reflection::pb::v1 as pb;
    let mut client = pb::server_reflection_client::ServerReflectionClient::new(channel(&address).await);
    let ask = pb::server_reflection_request::MessageRequest::ListServices(String::new());
    let ask = pb::ServerReflectionRequest { host: String::new(), message_request: Some(ask) };
    let mut answers = client.server_reflection_info(tokio_stream::iter([ask])).await?.into_inner();
    use pb::server_reflection_response::MessageResponse::ListServicesResponse;
    match answers.next().await.unwrap()?.message_response.unwrap() {
        ListServicesResponse(list) => Ok(list.service.into_iter().map(|service| service.name).collect()),
        other => panic!("{other:?}"),
    }
}

async fn services_v1alpha(address: String) -> Vec<String> {
    use tonic_reflection::pb::v1alpha as pb;
    let mut client = pb::server_reflection_client::ServerReflectionClient::new(channel(&address).await);
    let ask = pb::server_reflection_request::MessageRequest::ListServices(String::new());
    let ask = pb::ServerReflectionRequest { host: String::new(), message_request: Some(ask) };
    let mut answers = client.server_reflection_info(tokio_stream::iter([ask])).await.unwrap().into_inner();
    use pb::server_reflection_response::MessageResponse::ListServicesResponse;
    match answers.next().await.unwrap().unwrap().message_response.unwrap() {
        ListServicesResponse(list) => list.service.into_iter().map(|service| service.name).collect(),
        other => panic!("{other:?}"),
    }
}

#[tokio::test]
async fn reflection_speaks_both_dialects() {
    let server = Server::start(&[]);
    let address = format!("http://{}", server.addresses[0]);
    for services in [services_v1(address.clone()).await.unwrap(), services_v1alpha(address).await] {
        assert!(services.contains(&"cairn.v1.PileService".to_owned()), "{services:?}");
        assert!(services.contains(&"grpc.health.v1.Health".to_owned()), "{services:?}");
    }
}

#[tokio::test]
async fn settings_from_file_environment_and_flags() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cairn.toml");
    std::fs::write(&file, "workers = 5\nqueue = 6\nstore_mib = 7\n").unwrap();
    let server = Server::start_in(folder.path(), &["--config", "cairn.toml", "--queue", "9"]);
    let info = server.connect().await.service.get_server_info(cairn_wire::proto::GetServerInfoRequest::default()).await;
    let limits = info.unwrap().into_inner().limits.unwrap();
    assert_eq!((limits.worker_count, limits.queue_size, limits.max_store_bytes), (5, 9, 7 << 20));
    drop(server);

    std::fs::write(&file, "workres = 5\n").unwrap();
    let run = |name: &str, value: &str, code: i32| {
        let done = command(folder.path()).env(name, value).args(["--listen", "127.0.0.1:0"]).output().unwrap();
        assert_eq!(done.status.code(), Some(code));
        String::from_utf8(done.stderr).unwrap()
    };
    let message = run("CAIRN_CONFIG", "cairn.toml", 78);
    assert!(message.contains("workres") && message.contains("cairn.toml"), "{message}");
    assert!(run("CAIRN_WORKERS", "many", 2).contains("many"));
}

#[tokio::test]
async fn metrics_tell_of_bakes() {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let server = Server::start(&["--metrics", &port.to_string(), "--log", "json"]);
    // All are there from the start, and documented.
    let begin = get(&port.to_string());
    let names: std::collections::BTreeSet<&str> =
        begin.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next()).collect();
    let guide = std::fs::read_to_string(format!("{}/examples/guide/server.md", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let documented: std::collections::BTreeSet<&str> = guide
        .lines()
        .filter_map(|line| line.strip_prefix("| `cairn_"))
        .map(|line| line.split('`').next().unwrap())
        .collect();
    let short_names: std::collections::BTreeSet<&str> = names.iter().map(|name| &name["cairn_".len()..]).collect();
    assert_eq!(short_names, documented);
    for line in
        ["cairn_bakes_total{outcome=\"failed\"} 0", "cairn_bake_seconds_bucket{le=\"+Inf\"} 0", "cairn_build_info{"]
    {
        assert!(begin.contains(line), "{begin}");
    }
    let mut connection = server.ready().await;
    let (message, end) = events(connection.service.bake(request(short(1))).await.unwrap().into_inner()).await;
    end.unwrap();
    let metrics = get(&port.to_string());
    for line in ["cairn_bakes_total{outcome=\"succeeded\"} 1", "cairn_bodies_total 12", "cairn_bakes_running 0"] {
        assert!(metrics.contains(line), "{metrics}");
    }
    for name in ["cairn_stage_cpu_milliseconds_total{stage=\"fill\"} ", "cairn_bake_seconds_count 1"] {
        assert!(metrics.contains(name), "{metrics}");
    }
    // Each line about the bake carries its id.
    let id = crate::service::server::accepted_id(&message);
    let log = server.log();
    let lines: Vec<serde_json::Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of_bake = lines.iter().filter(|line| line["span"]["bake_id"] == id.as_str()).count();
    assert!(of_bake >= 3, "{log}");
}

#[tokio::test]
async fn refused_calls_are_counted() {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("token"), "open sesame").unwrap();
    let server = Server::start_in(folder.path(), &["--token-file", "token", "--metrics", &port]);
    for _ in 0..3 {
        Connection::open(&server.target()).await.err().expect("without a token");
    }
    let metrics = get(&port);
    assert!(metrics.contains("cairn_calls_refused_total{reason=\"token\"} 3"), "{metrics}");
}

/// Whether the server lives and takes work, also while it shuts down.
#[tokio::test]
async fn probes_say_whether_it_takes_work() {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut server = Server::start(&["--metrics", &port, "--drain-seconds", "60"]);
    let is = |path: &str, status: u16| page(&port, path).starts_with(&format!("HTTP/1.1 {status}"));
    while !is("/readyz", 200) {
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    assert!(is("/livez", 200) && is("/", 404) && is("/metricsx", 404));
    assert!(server.log().contains("starting") && server.log().contains("workers="), "{}", server.log());
    let mut connection = server.ready().await;
    let id = begin(&mut connection, crate::service::server::endless(1)).await;
    server.signal("-TERM");
    while !is("/readyz", 503) {
        tokio::time::sleep(std::time::Duration::from_millis(10)).await;
    }
    assert!(is("/livez", 200) && is("/metrics", 200));
    connection.cancel(&id).await.unwrap();
    drop(connection);
    assert_eq!(server.wait(), Some(0));
}

/// A port and a folder in use have exit codes of their own, as wrong settings have.
#[test]
fn what_is_in_use_has_an_exit_code_of_its_own() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    for args in [["--listen", &address, "--metrics", "127.0.0.1:0"], ["--listen", "127.0.0.1:0", "--metrics", &address]]
    {
        let folder = tempfile::tempdir().unwrap();
        let done = command(folder.path()).args(args).output().unwrap();
        let message = String::from_utf8(done.stderr).unwrap();
        assert!(done.status.code() == Some(69) && message.contains("Choose a free port"), "{message}");
    }
}

/// The metrics.
fn get(address: &str) -> String {
    page(address, "/metrics")
}

/// An HTTP page, with its head.
fn page(address: &str, path: &str) -> String {
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    text
}
