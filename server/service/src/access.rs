//! Authentication of callers by token or certificate. Every call passes here before anything else is done for it.

use crate::accepting::{Peer, PeerInfo};
use crate::audit;
use crate::config::{self, Config};
use crate::metrics::METRICS;
use crate::status::Fault;
use cairn_files::problem::Problem;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use tokio::sync::watch;
use tonic::{Request, Status};
use tracing::warn;
use x509_cert::Certificate;
use x509_cert::der::Decode;

/// The author of a call.
#[derive(Clone, Debug, PartialEq)]
pub struct Caller {
    /// From the file of callers; without such a file, the address that it calls from, or its user on this machine.
    pub name: Arc<str>,
    pub role: CallerRole,
    pub limits: CallerLimits,
    /// Its show: it sees nothing of others.
    pub project: Option<Arc<Project>>,
}

/// Callers that share bakes and assets, apart from all others: a show.
#[derive(Debug, Default, PartialEq)]
pub struct Project {
    pub name: String,
    /// Of all its callers together.
    pub limits: CallerLimits,
}

/// Permissions of a caller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CallerRole {
    /// Bakes, sees all bakes of its project, and ends or deletes its own.
    #[default]
    Artist,
    /// Ends and deletes all bakes of its project, and may give its own bakes priority over others. Without a project,
    /// it is one of all projects.
    Operator,
    /// Without a file of callers: an operator who leaves a bake to others that want it, too.
    #[serde(skip)]
    Anybody,
}

/// Limits of one caller or project; `None`: only the server's own limits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CallerLimits {
    /// Running bakes.
    pub bakes: Option<usize>,
    /// Waiting bakes.
    pub queue: Option<usize>,
    /// Size of its bakes in the store, bytes.
    pub bytes: Option<u64>,
}

impl Caller {
    /// Anybody, without limits.
    pub fn named(name: &str) -> Caller {
        Caller { name: name.into(), role: CallerRole::Anybody, limits: CallerLimits::default(), project: None }
    }

    /// The name of its project; empty without one.
    pub fn project(&self) -> &str {
        self.project.as_ref().map_or("", |project| &project.name)
    }

    /// Whether it sees what belongs to a project, or to none.
    pub fn sees(&self, project: &str) -> bool {
        self.project() == project || self.project.is_none() && self.is_operator()
    }

    /// Whether it may end and delete the bakes of all.
    pub fn is_operator(&self) -> bool {
        self.role != CallerRole::Artist
    }

    /// The highest priority that its bakes may have.
    pub fn highest_priority(&self) -> i32 {
        if self.is_operator() { LAST_PRIORITY } else { 0 }
    }
}

/// Priorities range from -100 to 100.
pub const LAST_PRIORITY: i32 = 100;

/// The file of callers.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CallersFile {
    caller: Vec<CallerEntry>,
    #[serde(default)]
    project: Vec<ProjectEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ProjectEntry {
    name: String,
    bakes: Option<usize>,
    queue: Option<usize>,
    store_mib: Option<u64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CallerEntry {
    name: String,
    #[serde(default)]
    token: String,
    /// The common name in the subject of its certificate.
    #[serde(default)]
    certificate: String,
    #[serde(default)]
    role: CallerRole,
    #[serde(default)]
    project: String,
    bakes: Option<usize>,
    queue: Option<usize>,
    store_mib: Option<u64>,
}

/// A caller of the file, and its credentials.
#[derive(Clone)]
struct KnownCaller {
    token: Option<blake3::Hash>,
    /// A common name, not empty.
    certificate: Option<String>,
    caller: Caller,
}

/// The credentials that the server accepts.
#[derive(Clone, Default)]
pub struct Access {
    /// Hash of the token that all callers share; `None`: there is none.
    token: Option<blake3::Hash>,
    known: Arc<Vec<KnownCaller>>,
}

impl Access {
    /// Reads the files of the settings. `token`: the token where the settings name no file for it.
    pub fn read(config: &Config, token: Option<String>) -> Result<Access, Vec<Problem>> {
        let mut problems = Vec::new();
        let mut read = |setting: &str, path: &Option<std::path::PathBuf>| {
            let bytes = config::read_file(setting, path, &mut problems);
            bytes.map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
        };
        let token = read("token_file", &config.token_file).map(|text| text.trim().to_owned()).or(token);
        let callers = read("callers_file", &config.callers_file);
        if token.as_ref().is_some_and(String::is_empty) {
            let remedy = "Set it to a long random text, or omit it.";
            problems.push(Problem::new("token", "the token is empty", remedy));
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

    /// Whether calls need no credentials.
    pub fn is_open(&self) -> bool {
        self.token.is_none() && self.known.is_empty()
    }

    /// The caller of this name in a project, or in none, with the limits that the file gives both now.
    pub fn caller(&self, name: &str, project: &str) -> Caller {
        let of_project = |known: &&KnownCaller| known.caller.project() == project;
        let mut members = self.known.iter().filter(of_project);
        if let Some(known) = members.clone().find(|known| *known.caller.name == *name) {
            return known.caller.clone();
        }
        // It is no longer in the file; its project may be.
        let unknown = || Project { name: project.to_owned(), ..Project::default() };
        let shared = (!project.is_empty()).then(|| {
            let known = members.next().and_then(|known| known.caller.project.clone());
            known.unwrap_or_else(|| Arc::new(unknown()))
        });
        Caller { project: shared, ..Caller::named(name) }
    }

    /// The caller of an accepted call. Hashes are compared in constant time, so that a wrong token reveals nothing of
    /// the right one.
    fn admit<T>(&self, request: &Request<T>) -> Option<Caller> {
        let given = request.metadata().get("authorization").and_then(|value| value.to_str().ok());
        let given = given.and_then(|value| value.split_once(' '));
        let given = given.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"));
        let given = given.map(|(_, token)| blake3::hash(token.as_bytes()));
        let subject = subject(request);
        let is_shown = |known: &&KnownCaller| {
            known.token.is_some() && known.token == given || known.certificate.is_some() && known.certificate == subject
        };
        let known = self.known.iter().find(is_shown).map(|known| known.caller.clone());
        let is_anybody = self.is_open() || self.token.is_some() && self.token == given;
        known.or_else(|| is_anybody.then(|| Caller::named(&origin(request))))
    }
}

fn known(file: &str, text: &str) -> Result<Vec<KnownCaller>, Vec<Problem>> {
    let parsed: CallersFile = toml::from_str(text).map_err(|error| {
        let line = error.span().map_or(1, |span| text[..span.start].lines().count().max(1));
        vec![Problem::new(format!("{file}:{line}"), error.message(), "See examples/guide/server.md for its form.")]
    })?;
    let mut problems = Vec::new();
    let mut projects = BTreeMap::new();
    for ProjectEntry { name, bakes, queue, store_mib } in parsed.project {
        let project = Project { name: name.clone(), limits: limits(bakes, queue, store_mib) };
        if name.is_empty() || projects.insert(name.clone(), Arc::new(project)).is_some() {
            let what = format!("project `{name}`: the name is empty or used twice");
            problems.push(Problem::new(file, what, "Give each project a name of its own."));
        }
    }
    let (mut names, mut keys) = (BTreeSet::new(), BTreeSet::new());
    for entry in &parsed.caller {
        let mut wrong = |what: &str, remedy: &str| {
            problems.push(Problem::new(file, format!("caller `{}`: {what}", entry.name), remedy));
        };
        if entry.name.is_empty() || !names.insert(&entry.name) {
            wrong("the name is empty or used twice", "Give each caller a name of its own.");
        }
        if entry.token.is_empty() && entry.certificate.is_empty() {
            wrong("it has neither a token nor a certificate", "Give it one of them.");
        }
        if !entry.project.is_empty() && !projects.contains_key(&entry.project) {
            let what = format!("there is no project `{}`", entry.project);
            wrong(&what, "Add a [[project]] of this name, or correct it.");
        }
        for key in [("token", &entry.token), ("certificate", &entry.certificate)] {
            if !key.1.is_empty() && !keys.insert(key) {
                wrong(&format!("another caller has the same {}", key.0), "Give each its own.");
            }
        }
    }
    if parsed.caller.is_empty() {
        problems.push(Problem::new(file, "there is no caller", "Add a [[caller]], or omit the file."));
    }
    let known = |entry: CallerEntry| KnownCaller {
        token: Some(&entry.token).filter(|token| !token.is_empty()).map(|token| blake3::hash(token.as_bytes())),
        certificate: Some(entry.certificate).filter(|name| !name.is_empty()),
        caller: Caller {
            name: entry.name.into(),
            role: entry.role,
            limits: limits(entry.bakes, entry.queue, entry.store_mib),
            project: projects.get(&entry.project).cloned(),
        },
    };
    if problems.is_empty() { Ok(parsed.caller.into_iter().map(known).collect()) } else { Err(problems) }
}

fn limits(bakes: Option<usize>, queue: Option<usize>, store_mib: Option<u64>) -> CallerLimits {
    CallerLimits { bakes, queue, bytes: store_mib.map(|mib| mib.saturating_mul(1 << 20)) }
}

/// Accepts a call and adds its caller to its extensions, or refuses it.
#[allow(clippy::result_large_err)]
pub fn check(mut request: Request<()>, access: &watch::Receiver<Access>) -> Result<Request<()>, Status> {
    match access.borrow().admit(&request) {
        Some(caller) => {
            audit::caller(request.extensions(), &caller.name, caller.project());
            if let Some(peer) = request.extensions().get::<Peer>() {
                peer.connection.know(&caller.name);
            }
            request.extensions_mut().insert(caller);
        }
        None => {
            METRICS.calls_refused.with_label_values(&["token"]).inc();
            let origin = origin(&request);
            audit::caller(request.extensions(), &origin, "");
            warn!(caller = origin, "refused a call with a missing or wrong token");
            return Err(Fault::TokenInvalid.into());
        }
    }
    Ok(request)
}

/// The caller of an accepted call.
pub fn caller<T>(request: &Request<T>) -> Caller {
    request.extensions().get::<Caller>().cloned().unwrap_or_else(|| Caller::named("unknown"))
}

/// The common name of the caller's certificate. The TLS handshake has checked its signature.
fn subject<T>(request: &Request<T>) -> Option<String> {
    let PeerInfo::Tls(encrypted) = &request.extensions().get::<Peer>()?.info else { return None };
    let certificates = encrypted.peer_certs()?;
    let certificate = Certificate::from_der(certificates.first()?).ok()?;
    certificate.tbs_certificate().subject().common_name().ok()?.map(|name| name.value().into_owned())
}

/// The address or the user that a call comes from.
fn origin<T>(request: &Request<T>) -> String {
    let address = match request.extensions().get::<Peer>().map(|peer| &peer.info) {
        Some(PeerInfo::Tcp(plain)) => plain.remote_addr(),
        Some(PeerInfo::Tls(encrypted)) => encrypted.get_ref().remote_addr(),
        #[cfg(unix)]
        Some(PeerInfo::Unix(peer)) => {
            return peer.peer_cred.map_or("unknown".into(), |user| format!("user {}", user.uid()));
        }
        None => None,
    };
    address.map_or("unknown".into(), |address| address.ip().to_string())
}
