//! The server around the service: authentication, health, reflection and shutdown.

use crate::accepting;
use crate::access::{self, Access};
use crate::api::pile_service_server::PileServiceServer;
use crate::audit::{Audit, OpenCalls};
use crate::calls::Service;
use crate::config::Config;
use crate::connections::Connections;
use crate::encryption;
use crate::incoming::Incoming;
use crate::jobs::Bakes;
use crate::listen::Listener;
use crate::sandbox;
use crate::secrets::Secrets;
use crate::store::Store;
use crate::telemetry::MetricsPage;
#[cfg(unix)]
use crate::unix;
use crate::users;
use cairn_files::problem::Problem;
use cairn_job::machine;
use cairn_wire::scene_file::schema;
use std::future::Future;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::sync::{Notify, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tonic::Request;
use tonic::codec::CompressionEncoding;
use tonic::service::Routes;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::Server;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;
use tracing::{error, info, warn};

/// Largest request, bytes: a scene of 100,000 bodies, the most that one may have, with all their values.
const MAX_REQUEST: usize = 32 << 20;
/// Open calls of one connection.
const MAX_STREAMS_PER_CONNECTION: u32 = 2048;
/// Interval of keep-alive pings, and the wait for an answer before the connection is closed.
const KEEPALIVE: [Duration; 2] = [Duration::from_secs(30), Duration::from_secs(20)];
/// Interval between checks of the data directory.
const STORE_CHECK: Duration = Duration::from_secs(2);
/// Time for callers to read the end of their streams, and to begin to fetch their results, after the last bake has
/// ended.
const FAREWELL: Duration = Duration::from_secs(5);

/// Why a server does not start, or ends early.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The data directory is in use, or cannot be used.
    #[error("{0}")]
    InUse(Problem),
    #[error("{0}")]
    Failed(String),
}

fn lines(problems: &[Problem]) -> String {
    problems.iter().map(Problem::to_string).collect::<Vec<_>>().join("\n")
}

impl From<tonic::transport::Error> for ServeError {
    fn from(error: tonic::transport::Error) -> ServeError {
        let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}")).unwrap_or_default();
        ServeError::Failed(format!("{error}{cause}"))
    }
}

/// Opens the data directory of the settings.
pub fn open_store(config: &Config) -> Result<Store, ServeError> {
    Store::open(config).map_err(|error| {
        let remedy = "Choose another folder by --data, or end the server that uses it.";
        ServeError::InUse(Problem::at(&config.data, error.to_string(), remedy))
    })
}

/// Serves until `shutdown`, then lets running bakes and open calls finish within the drain time; new work is refused.
/// `reload` asks to read the secrets again.
pub async fn run(
    listeners: Vec<Listener>,
    shutdown: impl Future<Output = ()>,
    reload: Arc<Notify>,
    config: Config,
    secrets: Secrets,
    store: Store,
    metrics: Option<MetricsPage>,
) -> Result<(), ServeError> {
    let mut drain = Duration::from_secs(config.drain_seconds);
    let (data, workers) = (config.data.display().to_string(), config.workers());
    info!(version = cairn_files::version::BUILD, data, workers, "starting");
    let users = config.users.clone();
    let bakes = Bakes::new(config, store, secrets.hook);
    bakes.set_access(secrets.access.clone());
    // Meanwhile, so that no bake waits for it.
    tokio::task::spawn_blocking(machine::slowness);
    bakes.restore().map_err(|error| ServeError::Failed(format!("the store cannot be read: {error}")))?;
    let (keeper, kept) = (tokio::spawn(bakes.clone().keep_limits()), bakes.clone());
    let memory = tokio::spawn(bakes.memory.clone().watch());
    for missing in sandbox::tried() {
        warn!(missing, "the processes of bakes have no whole sandbox");
    }

    let (health, health_service) = tonic_health::server::health_reporter();
    let is_ready = Arc::<AtomicBool>::default();
    let watcher = tokio::spawn(report_health(bakes.clone(), health.clone(), is_ready.clone()));
    let metrics = metrics.map(|metrics| tokio::spawn(metrics.serve(bakes.clone(), is_ready.clone())));
    let (access, access_now) = watch::channel(secrets.access.clone());
    let tls = secrets.tls.clone().map(watch::channel);
    let (tls, tls_now) = tls.unzip();
    let reloader = tokio::spawn(read_again(reload, bakes.clone(), secrets.token, access, tls));
    let open = Arc::<OpenCalls>::default();
    let routes = routes(&bakes, &access_now, &open)?.add_service(health_service);
    let routes = Routes::from(routes.into_axum_router().layer(axum::middleware::from_fn(accepting::count_call)));

    let (closing, connections) = (CancellationToken::new(), Connections::new());
    let mut servers = tokio::task::JoinSet::new();
    let sockets: Vec<_> = listeners.iter().filter_map(Listener::file).collect();
    for listener in listeners {
        servers.spawn(serve(listener, routes.clone(), tls_now.clone(), connections.clone(), closing.clone()));
    }

    let failed = tokio::select! {
        () = shutdown => None,
        () = users::all_gone(users) => {
            // Nobody waits for a result. The next server takes up what is not finished.
            info!("nobody uses this server any more");
            drain = Duration::ZERO;
            None
        }
        ended = servers.join_next() => ended,
    };
    info!("shutting down");
    watcher.abort();
    let _ = watcher.await;
    set_health(&health, ServingStatus::NotServing).await;
    is_ready.store(false, Ordering::Relaxed);
    let until = Instant::now() + drain;
    let is_used = open.are_some() || bakes.are_at_work();
    bakes.drain(until).await;
    if is_used {
        // Callers read the end of their streams, and fetch their results.
        let _ = tokio::time::timeout_at(until.max(Instant::now() + FAREWELL), open.all_ended()).await;
    }
    closing.cancel();
    let farewell = async { while servers.join_next().await.is_some() {} };
    let _ = tokio::time::timeout(FAREWELL, farewell).await;
    servers.shutdown().await;
    keeper.abort();
    kept.store.save_clock();
    memory.abort();
    reloader.abort();
    metrics.iter().for_each(tokio::task::JoinHandle::abort);
    sockets.iter().for_each(|path| drop(std::fs::remove_file(path)));
    match failed {
        Some(Ok(Err(error))) => Err(error),
        Some(Err(error)) => Err(ServeError::Failed(error.to_string())),
        _ => Ok(()),
    }
}

/// Sets the health of the server as a whole and of its service.
async fn set_health(health: &HealthReporter, status: ServingStatus) {
    for name in ["", <PileServiceServer<Service> as tonic::server::NamedService>::NAME] {
        health.set_service_status(name, status).await;
    }
}

/// Reports the server as unhealthy while its data directory cannot be used.
async fn report_health(bakes: Arc<Bakes>, health: HealthReporter, is_ready: Arc<AtomicBool>) {
    let mut before = None;
    loop {
        let store = bakes.clone();
        let fault = tokio::task::spawn_blocking(move || store.store.fault()).await.ok().flatten();
        if before != Some(fault.is_none()) {
            if let Some(fault) = &fault {
                error!(fault, "the data directory cannot be used: bakes are not possible");
            } else if before.is_some() {
                info!("the data directory can be used again");
            }
            set_health(&health, if fault.is_none() { ServingStatus::Serving } else { ServingStatus::NotServing }).await;
            is_ready.store(fault.is_none(), Ordering::Relaxed);
            before = Some(fault.is_none());
        }
        tokio::time::sleep(STORE_CHECK).await;
    }
}

/// Reads the secrets again on each request. If any is wrong, all stay as they are.
async fn read_again(
    reload: Arc<Notify>,
    bakes: Arc<Bakes>,
    token: Option<String>,
    access: watch::Sender<Access>,
    tls: Option<watch::Sender<Arc<rustls::ServerConfig>>>,
) {
    loop {
        reload.notified().await;
        match Secrets::read(&bakes.config, token.clone()) {
            Ok(secrets) => {
                bakes.set_access(secrets.access.clone());
                access.send_replace(secrets.access);
                if let Some((sender, new)) = tls.as_ref().zip(secrets.tls) {
                    sender.send_replace(new);
                }
                info!("token and certificates were reloaded");
            }
            Err(problems) => error!(fault = %lines(&problems), "token and certificates were not reloaded"),
        }
    }
}

/// The services. Health needs no credentials, because monitoring has none.
fn routes(bakes: &Arc<Bakes>, access: &watch::Receiver<Access>, open: &Arc<OpenCalls>) -> Result<Routes, ServeError> {
    let access = access.clone();
    let guard = move |request: Request<()>| access::check(request, &access);
    let reflection = || {
        tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(schema::DESCRIPTORS)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
    };
    let broken = |error: tonic_reflection::server::Error| ServeError::Failed(error.to_string());
    let pile = PileServiceServer::new(Service::new(bakes.clone()));
    let pile = pile.max_decoding_message_size(MAX_REQUEST).accept_compressed(CompressionEncoding::Gzip);
    let pile = Incoming::new(pile);
    Ok(Routes::new(Audit { service: InterceptedService::new(pile, guard.clone()), open: open.clone() })
        .add_service(InterceptedService::new(reflection().build_v1().map_err(broken)?, guard.clone()))
        .add_service(InterceptedService::new(reflection().build_v1alpha().map_err(broken)?, guard)))
}

async fn serve(
    listener: Listener,
    routes: Routes,
    tls: Option<watch::Receiver<Arc<rustls::ServerConfig>>>,
    connections: Arc<Connections>,
    closing: CancellationToken,
) -> Result<(), ServeError> {
    info!(address = listener.address(), "listening");
    let mut server = Server::builder()
        .max_concurrent_streams(MAX_STREAMS_PER_CONNECTION)
        .http2_keepalive_interval(Some(KEEPALIVE[0]))
        .http2_keepalive_timeout(Some(KEEPALIVE[1]));
    let server = server.add_routes(routes);
    let closing = closing.cancelled_owned();
    match (listener, tls) {
        (Listener::Tcp(listener), Some(tls)) => {
            let incoming = encryption::incoming(listener, tls, connections);
            server.serve_with_incoming_shutdown(incoming, closing).await?;
        }
        (Listener::Tcp(listener), None) => {
            let incoming = accepting::incoming(listener, connections, |stream| std::future::ready(Some(stream)));
            server.serve_with_incoming_shutdown(incoming, closing).await?;
        }
        #[cfg(unix)]
        (Listener::Unix(listener, _), _) => {
            let greet = |stream| std::future::ready(Some(unix::UnixConnection::new(stream)));
            let incoming = accepting::incoming(listener, connections, greet);
            server.serve_with_incoming_shutdown(incoming, closing).await?;
        }
    }
    Ok(())
}
