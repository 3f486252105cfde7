//! The server around the service: sockets, encryption, token, health, reflection, and its end.

use crate::problem::Problem;
use crate::service::calls::Service;
use crate::service::config::Config;
use crate::service::jobs::Bakes;
use crate::service::status::Fault;
use crate::service::store::Store;
use crate::wire::proto::pile_service_server::PileServiceServer;
use std::future::Future;
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;
use tokio::net::TcpListener;
#[cfg(unix)]
use tokio::net::UnixListener;
use tokio_util::sync::CancellationToken;
use tonic::service::Routes;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::server::TcpIncoming;
use tonic::transport::{Certificate, Identity, Server, ServerTlsConfig};
use tonic::{Request, Status};
use tracing::{info, warn};

/// All descriptors of `cairn.v1`, for reflection.
const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));

/// Bytes of one request: a scene with the most bodies that one may have, 100,000, each with all its values.
const MAX_REQUEST: usize = 32 << 20;
/// Calls that one connection may have open.
const MAX_STREAMS_PER_CONNECTION: u32 = 2048;
/// A connection is asked so often whether it still lives, and is closed if it says nothing for so long.
const KEEPALIVE: [Duration; 2] = [Duration::from_secs(30), Duration::from_secs(20)];
/// After the last bake has ended, callers have so long to read the end of their streams.
const FAREWELL: Duration = Duration::from_secs(5);

/// Why a server does not start, or ends.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The settings are wrong.
    #[error("{}", .0.iter().map(Problem::to_string).collect::<Vec<_>>().join("\n"))]
    Settings(Vec<Problem>),
    #[error("{0}")]
    Failed(String),
}

impl From<tonic::transport::Error> for ServeError {
    fn from(error: tonic::transport::Error) -> ServeError {
        let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}")).unwrap_or_default();
        ServeError::Failed(format!("{error}{cause}"))
    }
}

/// A bound socket.
pub enum Listener {
    Tcp(TcpListener),
    #[cfg(unix)]
    Unix(UnixListener, std::path::PathBuf),
}

impl Listener {
    /// What a client is given as the server's address.
    pub fn address(&self) -> String {
        match self {
            Listener::Tcp(listener) => listener.local_addr().map(|addr| addr.to_string()).unwrap_or_default(),
            #[cfg(unix)]
            Listener::Unix(_, path) => format!("unix:{}", path.display()),
        }
    }
}

/// What is read from the files that the settings name.
pub struct Secrets {
    token: Option<blake3::Hash>,
    tls: Option<ServerTlsConfig>,
}

impl Secrets {
    /// Reads them. `token`: one that is not in a file.
    pub fn read(config: &Config, token: Option<String>) -> Result<Secrets, ServeError> {
        let mut problems = Vec::new();
        let mut read = |setting: &str, path: &Option<std::path::PathBuf>| {
            let text = path.as_ref().map(|path| crate::files::read(path)).transpose();
            text.unwrap_or_else(|mut problem| {
                problem.what += &format!(" ({setting})");
                problems.push(problem);
                None
            })
        };
        let token_file = read("token_file", &config.token_file);
        let certificate = read("tls_certificate", &config.tls_certificate);
        let key = read("tls_key", &config.tls_key);
        let client_ca = read("tls_client_ca", &config.tls_client_ca);
        let token = token_file.map(|text| String::from_utf8_lossy(&text).trim().to_owned()).or(token);
        if token.as_ref().is_some_and(String::is_empty) {
            problems.push(Problem::new("token", "it is empty", "Put a long random text there, or leave it out."));
        }
        let halves = [config.tls_certificate.is_some(), config.tls_key.is_some()];
        if halves[0] != halves[1] {
            let remedy = "Give tls_certificate and tls_key, or neither.";
            problems.push(Problem::new("tls", "a certificate without its key, or a key alone", remedy));
        }
        if config.tls_client_ca.is_some() && halves == [false, false] {
            let remedy = "Give tls_certificate and tls_key, too.";
            problems.push(Problem::new("tls_client_ca", "callers' certificates need an encrypted connection", remedy));
        }
        if !problems.is_empty() {
            return Err(ServeError::Settings(problems));
        }
        let tls = certificate.zip(key).map(|(certificate, key)| {
            let tls = ServerTlsConfig::new().identity(Identity::from_pem(certificate, key));
            match client_ca {
                Some(ca) => tls.client_ca_root(Certificate::from_pem(ca)),
                None => tls,
            }
        });
        Ok(Secrets { token: token.map(|token| blake3::hash(token.as_bytes())), tls })
    }
}

/// Binds the sockets of the settings. Refuses to open a port beyond this machine to everybody.
pub async fn bind(config: &Config, secrets: &Secrets) -> Result<Vec<Listener>, ServeError> {
    let (mut listeners, mut problems) = (Vec::new(), Vec::new());
    for address in &config.listen {
        match bind_one(address, secrets).await {
            Ok(listener) => listeners.push(listener),
            Err(problem) => problems.push(problem),
        }
    }
    if config.listen.is_empty() {
        problems.push(Problem::new("listen", "there is no address", "Give one, such as 127.0.0.1:50151."));
    }
    if problems.is_empty() { Ok(listeners) } else { Err(ServeError::Settings(problems)) }
}

async fn bind_one(address: &str, secrets: &Secrets) -> Result<Listener, Problem> {
    let fail = |what: String, remedy: &str| Problem::new(format!("listen {address}"), what, remedy);
    if let Some(path) = address.strip_prefix("unix:") {
        return bind_unix(Path::new(path.strip_prefix("//").unwrap_or(path)))
            .map_err(|error| fail(error.to_string(), "Choose a path in a folder of your own."));
    }
    let remedy = "Give HOST:PORT, such as 127.0.0.1:50151, or unix:PATH.";
    let found = tokio::net::lookup_host(address).await.map_err(|error| fail(error.to_string(), remedy))?;
    let found: Vec<SocketAddr> = found.collect();
    if secrets.token.is_none() && found.iter().any(|addr| !addr.ip().is_loopback()) {
        let what = "other machines reach this address, and there is no token: everybody could use the server";
        let remedy = "Give a token by --token-file or CAIRN_TOKEN, or listen on 127.0.0.1 or a Unix socket.";
        return Err(fail(what.into(), remedy));
    }
    if secrets.tls.is_none() && found.iter().any(|addr| !addr.ip().is_loopback()) {
        warn!(address, "the token travels unencrypted; give --tls-certificate and --tls-key, or trust the network");
    }
    let remedy = "Choose a free port and an address of this machine.";
    let listener = TcpListener::bind(&found[..]).await.map_err(|error| fail(error.to_string(), remedy))?;
    Ok(Listener::Tcp(listener))
}

#[cfg(unix)]
fn bind_unix(path: &Path) -> std::io::Result<Listener> {
    use std::os::unix::fs::{FileTypeExt, PermissionsExt};
    // The socket of a server that has ended; one that lives would take the connection.
    let is_socket = path.symlink_metadata().is_ok_and(|found| found.file_type().is_socket());
    if is_socket && std::os::unix::net::UnixStream::connect(path).is_err() {
        std::fs::remove_file(path)?;
    }
    let listener = UnixListener::bind(path)?;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))?;
    Ok(Listener::Unix(listener, std::path::absolute(path)?))
}

#[cfg(not(unix))]
fn bind_unix(_: &Path) -> std::io::Result<Listener> {
    Err(std::io::Error::other("this system has no Unix sockets"))
}

/// Opens the data directory of the settings.
pub fn open_store(config: &Config) -> Result<Store, ServeError> {
    Store::open(config).map_err(|error| {
        let remedy = "Choose another folder by --data, or end the server that uses it.";
        ServeError::Settings(vec![Problem::new(config.data.display().to_string(), error.to_string(), remedy)])
    })
}

/// Serves until `shutdown`, then lets running bakes end within the drain deadline.
pub async fn run(
    listeners: Vec<Listener>,
    shutdown: impl Future<Output = ()>,
    config: Config,
    secrets: Secrets,
    store: Store,
) -> Result<(), ServeError> {
    let drain = Duration::from_secs(config.drain_seconds);
    let bakes = Bakes::new(config, store);
    bakes.restore().map_err(|error| ServeError::Failed(format!("the store cannot be read: {error}")))?;
    let keeper = tokio::spawn(bakes.clone().keep_limits());

    let (health, health_service) = tonic_health::server::health_reporter();
    health.set_serving::<PileServiceServer<Service>>().await;
    let routes = routes(&bakes, &secrets)?.add_service(health_service);

    let closing = CancellationToken::new();
    let mut servers = tokio::task::JoinSet::new();
    let mut sockets = Vec::new();
    for listener in listeners {
        #[cfg(unix)]
        if let Listener::Unix(_, path) = &listener {
            sockets.push(path.clone());
        }
        servers.spawn(serve(listener, routes.clone(), secrets.tls.clone(), closing.clone()));
    }

    let failed = tokio::select! {
        () = shutdown => None,
        ended = servers.join_next() => ended,
    };
    info!("shutting down");
    health.set_not_serving::<PileServiceServer<Service>>().await;
    bakes.drain(drain).await;
    closing.cancel();
    let farewell = async { while servers.join_next().await.is_some() {} };
    let _ = tokio::time::timeout(FAREWELL, farewell).await;
    servers.shutdown().await;
    keeper.abort();
    sockets.iter().for_each(|path: &std::path::PathBuf| drop(std::fs::remove_file(path)));
    match failed {
        Some(Ok(Err(error))) => Err(error),
        Some(Err(error)) => Err(ServeError::Failed(error.to_string())),
        _ => Ok(()),
    }
}

/// The services. Health is open to all: those who watch over servers have no token.
fn routes(bakes: &std::sync::Arc<Bakes>, secrets: &Secrets) -> Result<Routes, ServeError> {
    let token = secrets.token;
    let guard = move |request: Request<()>| check_token(request, token);
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(DESCRIPTORS)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    let broken = |error: tonic_reflection::server::Error| ServeError::Failed(error.to_string());
    let pile = PileServiceServer::new(Service::new(bakes.clone())).max_decoding_message_size(MAX_REQUEST);
    Ok(Routes::new(InterceptedService::new(pile, guard))
        .add_service(InterceptedService::new(reflection().build_v1().map_err(broken)?, guard))
        .add_service(InterceptedService::new(reflection().build_v1alpha().map_err(broken)?, guard)))
}

/// Hashes are compared, in constant time: a wrong token tells nothing of the right one.
#[allow(clippy::result_large_err)]
fn check_token(request: Request<()>, token: Option<blake3::Hash>) -> Result<Request<()>, Status> {
    let given = request.metadata().get("authorization").and_then(|value| value.to_str().ok());
    let given = given.and_then(|value| value.strip_prefix("Bearer ")).map(|token| blake3::hash(token.as_bytes()));
    if token.is_none() || token == given { Ok(request) } else { Err(Fault::TokenInvalid.into()) }
}

async fn serve(
    listener: Listener,
    routes: Routes,
    tls: Option<ServerTlsConfig>,
    closing: CancellationToken,
) -> Result<(), ServeError> {
    let server = Server::builder()
        .max_concurrent_streams(MAX_STREAMS_PER_CONNECTION)
        .http2_keepalive_interval(Some(KEEPALIVE[0]))
        .http2_keepalive_timeout(Some(KEEPALIVE[1]));
    info!(address = listener.address(), "listening");
    match listener {
        Listener::Tcp(listener) => {
            let mut server = match tls {
                Some(tls) => server.tls_config(tls)?,
                None => server,
            };
            let incoming = TcpIncoming::from(listener).with_nodelay(Some(true));
            server.add_routes(routes).serve_with_incoming_shutdown(incoming, closing.cancelled_owned()).await?;
        }
        #[cfg(unix)]
        Listener::Unix(listener, _) => {
            let incoming = tokio_stream::wrappers::UnixListenerStream::new(listener);
            let mut server = server;
            server.add_routes(routes).serve_with_incoming_shutdown(incoming, closing.cancelled_owned()).await?;
        }
    }
    Ok(())
}
