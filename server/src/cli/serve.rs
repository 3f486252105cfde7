//! `cairn serve`: runs the gRPC service.

use super::{Failure, print};
use cairn_files::problem::{Problem, nearest};
use cairn_service::config::Config;
use cairn_service::listen;
use cairn_service::secrets::Secrets;
use cairn_service::serve::{self, ServeError};
use cairn_service::telemetry;
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::sync::Notify;

/// Serves bakes over gRPC, to pipeline tools and to Blender
///
/// Each setting can be given in a TOML file under the flag's name with underscores, in the environment, or as a flag;
/// later ones in this list override earlier ones. The server prints its addresses once it listens. SIGTERM and Ctrl-C
/// let running bakes finish within the drain time; a second one ends the server at once. SIGHUP reloads token and
/// certificates.
#[derive(clap::Args, Serialize)]
#[command(after_help = "\
Examples:
  cairn serve
  cairn serve --listen unix:/run/cairn/socket
  cairn serve --listen 0.0.0.0:50151 --token-file token --tls-certificate cert.pem --tls-key key.pem")]
pub struct Args {
    /// TOML file with settings
    #[arg(long, value_name = "FILE", env = "CAIRN_CONFIG")]
    #[serde(skip)]
    config: Option<PathBuf>,

    /// HOST:PORT or unix:PATH; repeat it for several [default: 127.0.0.1:50151]
    #[arg(long, value_name = "ADDRESS", env = "CAIRN_LISTEN", value_delimiter = ',')]
    listen: Vec<String>,

    /// Folder for assets and bakes [default: `cairn-server` in the user's
    /// data folder, such as ~/.local/share]
    #[arg(long, value_name = "FOLDER", env = "CAIRN_DATA")]
    data: Option<PathBuf>,

    /// File with the token that callers must send; or set CAIRN_TOKEN to the token
    #[arg(long, value_name = "FILE", env = "CAIRN_TOKEN_FILE")]
    token_file: Option<PathBuf>,

    /// TOML file of callers: names, tokens or certificates, roles, limits (see examples/guide/server.md)
    #[arg(long, value_name = "FILE", env = "CAIRN_CALLERS_FILE")]
    callers_file: Option<PathBuf>,

    /// The server's certificate, PEM
    #[arg(long, value_name = "FILE", env = "CAIRN_TLS_CERTIFICATE")]
    tls_certificate: Option<PathBuf>,

    /// The certificate's key, PEM
    #[arg(long, value_name = "FILE", env = "CAIRN_TLS_KEY")]
    tls_key: Option<PathBuf>,

    /// Certificates of the authorities that sign client certificates, PEM; makes client certificates mandatory
    #[arg(long, value_name = "FILE", env = "CAIRN_TLS_CLIENT_CA")]
    tls_client_ca: Option<PathBuf>,

    /// Bakes that run at the same time; 0: one per core [default: 0]
    #[arg(long, env = "CAIRN_WORKERS")]
    workers: Option<usize>,

    /// Bakes that may wait; more are refused [default: 32]
    #[arg(long, env = "CAIRN_QUEUE")]
    queue: Option<usize>,

    /// Threads of one bake; 0: the cores divided by the bakes that run or wait when it starts [default: 0]
    #[arg(long, env = "CAIRN_THREADS")]
    threads: Option<usize>,

    /// Memory limit of one bake, MiB; 0: none [default: 8192]
    #[arg(long, value_name = "MIB", env = "CAIRN_BAKE_MEMORY_MIB")]
    bake_memory_mib: Option<u64>,

    /// Memory of all bakes and plans together, MiB; 0: four fifths of the machine's, or of what its control group
    /// leaves [default: 0]
    #[arg(long, value_name = "MIB", env = "CAIRN_MEMORY_MIB")]
    memory_mib: Option<u64>,

    /// Time limit of one bake, s; 0: none [default: 86400]
    #[arg(long, value_name = "SECONDS", env = "CAIRN_BAKE_SECONDS")]
    bake_seconds: Option<u64>,

    /// Largest asset, MiB [default: 256]
    #[arg(long, value_name = "MIB", env = "CAIRN_ASSET_MIB")]
    asset_mib: Option<u64>,

    /// Total size of assets, bakes and cached fills, MiB [default: 20480]
    #[arg(long, value_name = "MIB", env = "CAIRN_STORE_MIB")]
    store_mib: Option<u64>,

    /// Days after which unused assets and bakes are removed; 0: never [default: 30]
    #[arg(long, value_name = "DAYS", env = "CAIRN_STORE_DAYS")]
    store_days: Option<u64>,

    /// Whether to reuse the fill of an earlier bake where it is the same; cached fills count toward the store [default:
    /// true]
    #[arg(long, value_name = "BOOL", env = "CAIRN_REUSE")]
    reuse: Option<bool>,

    /// Treatment of bakes that ran when the server ended [default: restart]
    #[arg(long, value_parser = ["restart", "fail"], env = "CAIRN_UNFINISHED")]
    unfinished: Option<String>,

    /// Time for running bakes to finish when the server shuts down, s [default: 30]
    #[arg(long, value_name = "SECONDS", env = "CAIRN_DRAIN_SECONDS")]
    drain_seconds: Option<u64>,

    /// Folder in which each program that uses the server locks a file; once none is locked, the server ends at once
    /// [default: none]
    #[arg(long, value_name = "FOLDER", env = "CAIRN_USERS")]
    users: Option<PathBuf>,

    /// HTTP address of Prometheus metrics [default: none]
    #[arg(long, value_name = "HOST:PORT", env = "CAIRN_METRICS")]
    metrics: Option<SocketAddr>,

    /// Program that runs when a bake has ended, with the bake's status as JSON on its standard input [default: none]
    #[arg(long, value_name = "PROGRAM", env = "CAIRN_HOOK")]
    hook: Option<PathBuf>,

    /// File with the key of the signature in the hook's variable CAIRN_SIGNATURE: HMAC-SHA256 of that input
    #[arg(long, value_name = "FILE", env = "CAIRN_HOOK_KEY_FILE")]
    hook_key_file: Option<PathBuf>,

    /// Form of the log lines on stderr; RUST_LOG selects them [default: text]
    #[arg(long, value_parser = ["text", "json"], env = "CAIRN_LOG")]
    log: Option<String>,

    /// The program that bakes, instead of this one
    #[arg(long, hide = true)]
    #[serde(skip)]
    worker_program: Option<PathBuf>,
}

impl Args {
    /// Defaults, then the file, then environment and flags.
    fn config(&self) -> Result<Config, Failure> {
        let internal = |error: &dyn std::fmt::Display| Failure::Internal(error.to_string());
        let mut problems = Vec::new();
        let mut settings = match &self.config {
            Some(path) => read_settings(path, &mut problems),
            None => toml::Table::new(),
        };
        let given = toml::Table::try_from(self).map_err(|error| internal(&error))?;
        settings.extend(given.into_iter().filter(|(_, value)| value.as_array().is_none_or(|list| !list.is_empty())));
        if !problems.is_empty() {
            return Err(Failure::Settings(problems));
        }
        let config = Config::deserialize(settings).map_err(|error| internal(&error))?;
        Ok(Config { worker_program: self.worker_program.clone(), ..config })
    }
}

/// The settings of a file. Each one is held against its form by itself, so that all problems are found.
fn read_settings(path: &Path, problems: &mut Vec<Problem>) -> toml::Table {
    let text = cairn_files::read(path).and_then(|bytes| {
        String::from_utf8(bytes).map_err(|_| Problem::at(path, "it is not text in UTF-8", "Save it as UTF-8."))
    });
    let remedy = "See `cairn serve --help` for the settings.";
    let read = text.and_then(|text| {
        let read = text.parse::<toml::Table>();
        read.map_err(|error| Problem::at(path, error.to_string().trim(), "Correct the file: it must be TOML."))
    });
    let settings = match read {
        Ok(settings) => settings,
        Err(problem) => {
            problems.push(problem);
            return toml::Table::new();
        }
    };
    // What has no default is `null` there.
    let known = serde_json::to_value(Config::default()).unwrap_or_default();
    let known: Vec<&str> = known.as_object().into_iter().flatten().map(|(name, _)| name.as_str()).collect();
    for (name, value) in &settings {
        if !known.contains(&name.as_str()) {
            let meant = nearest(name, known.iter().copied());
            let remedy = meant.map_or(remedy.to_owned(), |meant| format!("Did you mean `{meant}`?"));
            problems.push(Problem::at(path, format!("unknown setting `{name}`"), remedy));
        } else if let Err(error) = Config::deserialize(toml::Table::from_iter([(name.clone(), value.clone())])) {
            problems.push(Problem::at(path, format!("`{name}`: {}", error.message()), remedy));
        }
    }
    settings
}

/// Threads for work that waits for the disk. Each keeps some memory.
const BLOCKING_THREADS: usize = 16;

pub fn run(args: &Args) -> Result<(), Failure> {
    let config = args.config()?;
    let token = std::env::var("CAIRN_TOKEN").ok();
    telemetry::log(config.log);
    // Before there are threads, each of which would have its own.
    cairn_service::heap::set_up();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .max_blocking_threads(BLOCKING_THREADS)
        .build()
        .map_err(|error| Failure::Internal(error.to_string()))?;
    runtime.block_on(async {
        let secrets = Secrets::read(&config, token).map_err(Failure::Settings)?;
        let listeners = listen::bind(&config, &secrets).await?;
        warn_of_earlier_data(&config);
        let store = serve::open_store(&config)?;
        let metrics = telemetry::metrics(&config).await.map_err(|error| {
            let remedy = "Choose a free port and an address of this machine.";
            Failure::Unavailable(vec![Problem::new("metrics", error.to_string(), remedy)])
        })?;
        let (end, reload) = (shutdown_request()?, reload_request()?);
        for listener in &listeners {
            print(&format!("{}\n", listener.address()))?;
        }
        Ok(serve::run(listeners, end, reload, config, secrets, store, metrics).await?)
    })
}

/// Earlier versions kept their data in the folder that they were started in.
fn warn_of_earlier_data(config: &Config) {
    let earlier = Path::new("cairn-data");
    if config.data == Config::default().data && config.data != earlier && earlier.is_dir() {
        let found = std::path::absolute(earlier).unwrap_or_else(|_| earlier.to_owned());
        tracing::warn!(
            found = %found.display(),
            used = %config.data.display(),
            "data of an earlier version are not used: to go on with them, start with `--data cairn-data`"
        );
    }
}

/// Resolves at SIGTERM or Ctrl-C, handled from this call on. A second signal ends the process.
fn shutdown_request() -> Result<impl Future<Output = ()>, Failure> {
    let broken = |error: std::io::Error| Failure::Internal(error.to_string());
    #[cfg(unix)]
    let mut next = {
        use tokio::signal::unix::{SignalKind, signal};
        let mut end = signal(SignalKind::terminate()).map_err(broken)?;
        let mut interrupt = signal(SignalKind::interrupt()).map_err(broken)?;
        async move || {
            tokio::select! {
                _ = end.recv() => {}
                _ = interrupt.recv() => {}
            }
        }
    };
    #[cfg(windows)]
    let mut next = {
        let mut interrupt = tokio::signal::windows::ctrl_c().map_err(broken)?;
        async move || {
            interrupt.recv().await;
        }
    };
    let requested = Arc::new(Notify::new());
    let sender = requested.clone();
    tokio::spawn(async move {
        next().await;
        sender.notify_one();
        next().await;
        std::process::exit(130);
    });
    Ok(async move { requested.notified().await })
}

/// Notified at SIGHUP, on systems with that signal.
fn reload_request() -> Result<Arc<Notify>, Failure> {
    let requested = Arc::new(Notify::new());
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        let mut hangup = signal(SignalKind::hangup()).map_err(|error| Failure::Internal(error.to_string()))?;
        let sender = requested.clone();
        tokio::spawn(async move {
            while hangup.recv().await.is_some() {
                sender.notify_one();
            }
        });
    }
    Ok(requested)
}

impl From<ServeError> for Failure {
    fn from(error: ServeError) -> Failure {
        match error {
            ServeError::InUse(problem) => Failure::Unavailable(vec![problem]),
            ServeError::Failed(what) => {
                Failure::TryAgain(Problem::new("the server", what, "See the log, and restart the server."))
            }
        }
    }
}
