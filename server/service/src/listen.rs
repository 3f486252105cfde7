//! The sockets of a server.

use crate::config::Config;
use crate::secrets::Secrets;
use cairn_files::problem::Problem;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use tokio::net::TcpListener;
#[cfg(unix)]
use tokio::net::UnixListener;
use tracing::warn;

/// A bound socket.
pub enum Listener {
    Tcp(TcpListener),
    #[cfg(unix)]
    Unix(UnixListener, PathBuf),
}

impl Listener {
    /// The address that clients connect to.
    pub fn address(&self) -> String {
        match self {
            Listener::Tcp(listener) => listener.local_addr().map(|addr| addr.to_string()).unwrap_or_default(),
            #[cfg(unix)]
            Listener::Unix(_, path) => format!("unix:{}", path.display()),
        }
    }

    /// The socket's file, if it has one.
    pub fn file(&self) -> Option<PathBuf> {
        match self {
            Listener::Tcp(_) => None,
            #[cfg(unix)]
            Listener::Unix(_, path) => Some(path.clone()),
        }
    }
}

/// Why a server cannot listen.
pub struct BindError {
    pub problems: Vec<Problem>,
    /// The settings are right, but other programs hold the addresses.
    pub is_taken: bool,
}

/// Binds the sockets of the settings. Refuses a port that other machines can reach without credentials.
pub async fn bind(config: &Config, secrets: &Secrets) -> Result<Vec<Listener>, BindError> {
    let (mut listeners, mut problems, mut is_taken) = (Vec::new(), Vec::new(), true);
    for address in &config.listen {
        match bind_one(address, secrets).await {
            Ok(listener) => listeners.push(listener),
            Err((problem, taken)) => {
                problems.push(problem);
                is_taken &= taken;
            }
        }
    }
    if config.listen.is_empty() {
        is_taken = false;
        problems.push(Problem::new("listen", "there is no address", "Give one, such as 127.0.0.1:50151."));
    }
    if problems.is_empty() { Ok(listeners) } else { Err(BindError { problems, is_taken }) }
}

/// The listener of an address; or what is wrong, and whether only another program holds it.
async fn bind_one(address: &str, secrets: &Secrets) -> Result<Listener, (Problem, bool)> {
    let fail = |what: String, remedy: &str| (Problem::new(format!("listen {address}"), what, remedy), false);
    if let Some(path) = address.strip_prefix("unix:") {
        return bind_unix(Path::new(path.strip_prefix("//").unwrap_or(path)))
            .map_err(|error| fail(error.to_string(), "Choose a path in a folder of your own."));
    }
    let remedy = "Give HOST:PORT, such as 127.0.0.1:50151, or unix:PATH.";
    let found = tokio::net::lookup_host(address).await.map_err(|error| fail(error.to_string(), remedy))?;
    let found: Vec<SocketAddr> = found.collect();
    if secrets.access.is_open() && found.iter().any(|addr| !addr.ip().is_loopback()) {
        let what = "other machines can reach this address, and no token protects the server";
        let remedy = "Give a token by --token-file or CAIRN_TOKEN, or listen on 127.0.0.1 or a Unix socket.";
        return Err(fail(what.into(), remedy));
    }
    if secrets.tls.is_none() && found.iter().any(|addr| !addr.ip().is_loopback()) {
        warn!(
            address,
            "tokens are sent unencrypted; give --tls-certificate and --tls-key unless the network is trusted"
        );
    }
    let remedy = "Choose a free port and an address of this machine.";
    let listener = TcpListener::bind(&found[..]).await.map_err(|error| {
        let is_taken = error.kind() == std::io::ErrorKind::AddrInUse;
        (fail(error.to_string(), remedy).0, is_taken)
    })?;
    Ok(Listener::Tcp(listener))
}

#[cfg(unix)]
fn bind_unix(path: &Path) -> std::io::Result<Listener> {
    use std::os::unix::fs::{FileTypeExt, PermissionsExt};
    // Remove the socket of an ended server: a running one would accept the connection.
    let is_socket = path.symlink_metadata().is_ok_and(|found| found.file_type().is_socket());
    if is_socket && std::os::unix::net::UnixStream::connect(path).is_err() {
        std::fs::remove_file(path)?;
    }
    let listener = UnixListener::bind(path)?;
    let own = std::fs::Permissions::from_mode(0o600);
    cairn_files::failpoints::at("listen-mode").and_then(|()| std::fs::set_permissions(path, own)).inspect_err(
        |_| {
            // A socket that every user may open must not stay.
            let _ = std::fs::remove_file(path);
        },
    )?;
    Ok(Listener::Unix(listener, std::path::absolute(path)?))
}

#[cfg(not(unix))]
fn bind_unix(_: &Path) -> std::io::Result<Listener> {
    Err(std::io::Error::other("this system has no Unix sockets"))
}
