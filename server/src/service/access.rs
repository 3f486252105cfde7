//! Who calls: the token or the certificate that a call shows. Nothing is done for a call before it was let in here.

use crate::problem::Problem;
use crate::service::audit;
use crate::service::config::Config;
use crate::service::status::Fault;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::watch;
use tonic::transport::server::{TcpConnectInfo, TlsConnectInfo};
use tonic::{Request, Status};
use tracing::warn;
use x509_parser::prelude::{FromDer, X509Certificate};

/// Who makes a call.
#[derive(Clone, Debug, PartialEq)]
pub struct Caller {
    /// As the file of callers has it; without such a file, the address that it calls from, or its user on this machine.
    pub name: Arc<str>,
    pub role: Role,
    pub limits: Limits,
}

/// What a caller may do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Bakes, sees all bakes, and ends or deletes its own.
    #[default]
    Artist,
    /// Ends and deletes all bakes, and may put its own before those of others.
    Operator,
}

/// What a caller may take of the server at once; `None`: as much as the server has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Bakes that run.
    pub bakes: Option<usize>,
    /// Bakes that wait besides.
    pub queue: Option<usize>,
    /// What its bakes take in the store, bytes.
    pub bytes: Option<u64>,
}

impl Caller {
    /// Somebody of whom only this is known.
    pub fn named(name: &str) -> Caller {
        Caller { name: name.into(), role: Role::Operator, limits: Limits::default() }
    }

    /// Whether it may end and delete what this caller asked for.
    pub fn may_change(&self, owner: &str) -> bool {
        self.role == Role::Operator || *self.name == *owner
    }

    /// Most of the bakes' own range of priorities.
    pub fn highest_priority(&self) -> i32 {
        if self.role == Role::Operator { LAST_PRIORITY } else { 0 }
    }
}

/// Priorities go from this, negated, to this.
pub const LAST_PRIORITY: i32 = 100;

/// The file of callers.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    caller: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    #[serde(default)]
    token: String,
    /// The common name in the subject of its certificate.
    #[serde(default)]
    certificate: String,
    #[serde(default)]
    role: Role,
    bakes: Option<usize>,
    queue: Option<usize>,
    store_mib: Option<u64>,
}

/// A caller that is known by name, and what it shows.
#[derive(Clone)]
struct Known {
    token: Option<blake3::Hash>,
    /// A common name, not empty.
    certificate: Option<String>,
    caller: Caller,
}

/// What opens the doors.
#[derive(Clone, Default)]
pub struct Access {
    /// Hash of the one token of all callers; `None`: none is asked for.
    token: Option<blake3::Hash>,
    known: Arc<Vec<Known>>,
}

impl Access {
    /// Reads what the settings name. `token`: one that is not in a file.
    pub fn read(config: &Config, token: Option<String>) -> Result<Access, Vec<Problem>> {
        let mut problems = Vec::new();
        let mut read = |setting: &str, path: &Option<std::path::PathBuf>| {
            let text = path.as_ref().map(|path| crate::files::read(path)).transpose();
            let text = text.unwrap_or_else(|mut problem| {
                problem.what += &format!(" ({setting})");
                problems.push(problem);
                None
            });
            text.map(|text| String::from_utf8_lossy(&text).into_owned())
        };
        let token = read("token_file", &config.token_file).map(|text| text.trim().to_owned()).or(token);
        let callers = read("callers_file", &config.callers_file);
        if token.as_ref().is_some_and(String::is_empty) {
            let remedy = "Put a long random text there, or leave it out.";
            problems.push(Problem::new("token", "it is empty", remedy));
        }
        let file = config.callers_file.as_deref().unwrap_or(Path::new("")).display().to_string();
        let known = match callers.map(|text| known(&file, &text)) {
            Some(Err(wrong)) => {
                problems.extend(wrong);
                Vec::new()
            }
            known => known.and_then(Result::ok).unwrap_or_default(),
        };
        let access = Access { token: token.map(|token| blake3::hash(token.as_bytes())), known: Arc::new(known) };
        if problems.is_empty() { Ok(access) } else { Err(problems) }
    }

    /// Whether everybody who reaches the server is let in.
    pub fn is_open(&self) -> bool {
        self.token.is_none() && self.known.is_empty()
    }

    /// Hashes are compared, in constant time: a wrong token tells nothing of the right one.
    fn admit<T>(&self, request: &Request<T>) -> Option<Caller> {
        let given = request.metadata().get("authorization").and_then(|value| value.to_str().ok());
        let given = given.and_then(|value| value.split_once(' '));
        let given = given.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"));
        let given = given.map(|(_, token)| blake3::hash(token.as_bytes()));
        let subject = subject(request);
        let is_shown = |known: &&Known| {
            known.token.is_some() && known.token == given || known.certificate.is_some() && known.certificate == subject
        };
        let known = self.known.iter().find(is_shown).map(|known| known.caller.clone());
        let is_anybody = self.is_open() || self.token.is_some() && self.token == given;
        known.or_else(|| is_anybody.then(|| Caller::named(&origin(request))))
    }
}

fn known(file: &str, text: &str) -> Result<Vec<Known>, Vec<Problem>> {
    let parsed: File = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| text[..span.start].lines().count().max(1));
        vec![Problem::new(format!("{file}:{line}"), error.message(), "See examples/guide/server.md for its form.")]
    })?;
    let mut problems = Vec::new();
    let (mut names, mut keys) = (BTreeSet::new(), BTreeSet::new());
    for entry in &parsed.caller {
        let mut wrong = |what: &str, remedy: &str| {
            problems.push(Problem::new(file, format!("caller `{}`: {what}", entry.name), remedy));
        };
        if entry.name.is_empty() || !names.insert(&entry.name) {
            wrong("the name is empty or there twice", "Name each caller once.");
        }
        if entry.token.is_empty() && entry.certificate.is_empty() {
            wrong("neither token nor certificate", "Give one of them.");
        }
        for key in [("token", &entry.token), ("certificate", &entry.certificate)] {
            if !key.1.is_empty() && !keys.insert(key) {
                wrong(&format!("another caller has the same {}", key.0), "Give each its own.");
            }
        }
    }
    if parsed.caller.is_empty() {
        problems.push(Problem::new(file, "there is no caller", "Add a [[caller]], or leave the file out."));
    }
    let known = |entry: Entry| Known {
        token: Some(&entry.token).filter(|token| !token.is_empty()).map(|token| blake3::hash(token.as_bytes())),
        certificate: Some(entry.certificate).filter(|name| !name.is_empty()),
        caller: Caller {
            name: entry.name.into(),
            role: entry.role,
            limits: Limits {
                bakes: entry.bakes,
                queue: entry.queue,
                bytes: entry.store_mib.map(|mib| mib.saturating_mul(1 << 20)),
            },
        },
    };
    if problems.is_empty() { Ok(parsed.caller.into_iter().map(known).collect()) } else { Err(problems) }
}

/// Lets a call in with its caller among its extensions, or refuses it.
#[allow(clippy::result_large_err)]
pub fn check(mut request: Request<()>, access: &watch::Receiver<Access>) -> Result<Request<()>, Status> {
    match access.borrow().admit(&request) {
        Some(caller) => {
            audit::caller(request.extensions(), &caller.name);
            request.extensions_mut().insert(caller);
        }
        None => {
            metrics::counter!("cairn_calls_refused_total", "reason" => "token").increment(1);
            let origin = origin(&request);
            audit::caller(request.extensions(), &origin);
            warn!(caller = origin, "a call without the right token is refused");
            return Err(Fault::TokenInvalid.into());
        }
    }
    Ok(request)
}

/// The caller of a call that was let in.
pub fn caller<T>(request: &Request<T>) -> Caller {
    request.extensions().get::<Caller>().cloned().unwrap_or_else(|| Caller::named("unknown"))
}

/// The common name of the certificate that the caller has shown; its signature was checked before.
fn subject<T>(request: &Request<T>) -> Option<String> {
    let certificates = request.extensions().get::<TlsConnectInfo<TcpConnectInfo>>()?.peer_certs()?;
    let (_, certificate) = X509Certificate::from_der(certificates.first()?).ok()?;
    certificate.subject().iter_common_name().next()?.as_str().ok().map(str::to_owned)
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
