//! Who calls: the token or the certificate that a call shows. Nothing is done for a call before it was let in here.

use crate::problem::Problem;
use crate::service::config::Config;
use crate::service::status::Fault;
use std::sync::Arc;
use tokio::sync::watch;
use tonic::transport::server::{TcpConnectInfo, TlsConnectInfo};
use tonic::{Request, Status};
use tracing::warn;

/// Who makes a call, as far as the server can tell one from another.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Caller {
    /// The address that it calls from, or its user on this machine.
    pub name: Arc<str>,
}

/// What opens the doors.
#[derive(Clone, Default)]
pub struct Access {
    /// Hash of the token; `None`: none is asked for.
    token: Option<blake3::Hash>,
}

impl Access {
    /// Reads what the settings name. `token`: one that is not in a file.
    pub fn read(config: &Config, token: Option<String>) -> Result<Access, Vec<Problem>> {
        let file = config.token_file.as_ref().map(|path| crate::files::read(path)).transpose();
        let file = file.map_err(|mut problem| {
            problem.what += " (token_file)";
            vec![problem]
        })?;
        let token = file.map(|text| String::from_utf8_lossy(&text).trim().to_owned()).or(token);
        if token.as_ref().is_some_and(String::is_empty) {
            let remedy = "Put a long random text there, or leave it out.";
            return Err(vec![Problem::new("token", "it is empty", remedy)]);
        }
        Ok(Access { token: token.map(|token| blake3::hash(token.as_bytes())) })
    }

    /// Whether everybody who reaches the server is let in.
    pub fn is_open(&self) -> bool {
        self.token.is_none()
    }

    /// Hashes are compared, in constant time: a wrong token tells nothing of the right one.
    fn admits<T>(&self, request: &Request<T>) -> bool {
        let given = request.metadata().get("authorization").and_then(|value| value.to_str().ok());
        let given = given.and_then(|value| value.split_once(' '));
        let given = given.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"));
        self.is_open() || self.token == given.map(|(_, token)| blake3::hash(token.as_bytes()))
    }
}

/// Lets a call in with its caller among its extensions, or refuses it.
#[allow(clippy::result_large_err)]
pub fn check(mut request: Request<()>, access: &watch::Receiver<Access>) -> Result<Request<()>, Status> {
    let caller = Caller { name: origin(&request).into() };
    if !access.borrow().admits(&request) {
        metrics::counter!("cairn_calls_refused_total", "reason" => "token").increment(1);
        warn!(caller = &*caller.name, "a call without the right token is refused");
        return Err(Fault::TokenInvalid.into());
    }
    request.extensions_mut().insert(caller);
    Ok(request)
}

/// The caller of a call that was let in.
pub fn caller<T>(request: &Request<T>) -> Caller {
    request.extensions().get::<Caller>().cloned().unwrap_or(Caller { name: "unknown".into() })
}

/// Where a call comes from.
fn origin<T>(request: &Request<T>) -> String {
    let extensions = request.extensions();
    let plain = extensions.get::<TcpConnectInfo>().and_then(TcpConnectInfo::remote_addr);
    let encrypted = extensions.get::<TlsConnectInfo<TcpConnectInfo>>();
    if let Some(address) = plain.or_else(|| encrypted?.get_ref().remote_addr()) {
        return address.ip().to_string();
    }
    #[cfg(unix)]
    if let Some(user) = extensions.get::<tonic::transport::server::UdsConnectInfo>().and_then(|peer| peer.peer_cred) {
        return format!("user {}", user.uid());
    }
    "unknown".into()
}
