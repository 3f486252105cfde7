//! The sockets of a server.

use crate::problem::Problem;
use crate::service::config::Config;
use crate::service::secrets::Secrets;
use crate::trouble;
use std::net::SocketAddr;
use std::path::Path;
use tokio::net::TcpListener;
#[cfg(unix)]
use tokio::net::UnixListener;
use tracing::warn;

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

/// Binds the sockets of the settings. Refuses to open a port beyond this machine to everybody.
pub async fn bind(config: &Config, secrets: &Secrets) -> Result<Vec<Listener>, Vec<Problem>> {
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
    if problems.is_empty() { Ok(listeners) } else { Err(problems) }
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
    if secrets.access.is_open() && found.iter().any(|addr| !addr.ip().is_loopback()) {
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
    let own = std::fs::Permissions::from_mode(0o600);
    trouble::at("listen-mode").and_then(|()| std::fs::set_permissions(path, own)).inspect_err(|_| {
        // Nobody is to find a socket that everybody may use.
        let _ = std::fs::remove_file(path);
    })?;
    Ok(Listener::Unix(listener, std::path::absolute(path)?))
}

#[cfg(not(unix))]
fn bind_unix(_: &Path) -> std::io::Result<Listener> {
    Err(std::io::Error::other("this system has no Unix sockets"))
}
