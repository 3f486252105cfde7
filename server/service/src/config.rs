//! The settings of a server, each with its unit and default.

use cairn_files::problem::Problem;
use etcetera::base_strategy::{self, BaseStrategy};
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// The settings of `cairn serve`, as in its TOML file.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// `HOST:PORT` or `unix:PATH`. Default: 127.0.0.1:50151, reachable only from this machine.
    pub listen: Vec<String>,
    /// Folder for assets and bakes. Default: `cairn-server` in the user's data folder (XDG's, Application
    /// Support, Local AppData); where the system names none, `cairn-data` in the current folder.
    pub data: PathBuf,
    /// File with the token that callers must send. Required beyond loopback. Default: none.
    pub token_file: Option<PathBuf>,
    /// TOML file of callers: names, tokens or certificates, roles, limits. Default: none.
    pub callers_file: Option<PathBuf>,
    /// The server's certificate and key, PEM. Default: none, no encryption.
    pub tls_certificate: Option<PathBuf>,
    pub tls_key: Option<PathBuf>,
    /// Certificates of the authorities that sign callers' certificates, PEM: mutual TLS. Default: none.
    pub tls_client_ca: Option<PathBuf>,
    /// Bakes that run at the same time. Default: 0, one per core.
    pub workers: usize,
    /// Bakes that may wait. Default: 32.
    pub queue: usize,
    /// Threads of one bake. Default: 0, the cores divided by the bakes that run or wait when it starts, at most
    /// `workers` of them: a single bake gets all cores.
    pub threads: usize,
    /// Memory of one bake, MiB; 0: not limited. Default: 8192.
    pub bake_memory_mib: u64,
    /// Memory of all bakes and plans together, MiB; the largest one ends where they take more. Default: 0, four fifths
    /// of the machine's, or of what its control group leaves.
    pub memory_mib: u64,
    /// Time of one bake, s; 0: not limited. Default: 86400, a day.
    pub bake_seconds: u64,
    /// Size of one asset, MiB. Default: 256.
    pub asset_mib: u64,
    /// Total size of assets, bakes and cached fills, MiB. Default: 20480.
    pub store_mib: u64,
    /// Days after which unused assets and bakes are removed; 0: never. Default: 30.
    pub store_days: u64,
    /// Whether a bake reuses the fill of an earlier one where it is the same. The cache is in the data directory, has
    /// up to 2 GiB and counts toward `store_mib`. Default: true.
    pub reuse: bool,
    /// Treatment of the bakes that ran when the server ended. Default: restart.
    pub unfinished: Unfinished,
    /// Time that running bakes get to finish when the server shuts down, s. Default: 30.
    pub drain_seconds: u64,
    /// Folder in which the programs that use the server each hold a lock on a file. Once none is held, the server ends,
    /// and what it bakes with it. Default: none, the server does not end by itself.
    pub users: Option<PathBuf>,
    /// HTTP address of the Prometheus metrics, `HOST:PORT`. Default: none.
    pub metrics: Option<SocketAddr>,
    /// Program that runs when a bake has ended, with the bake's status as JSON on its standard input. Default: none.
    pub hook: Option<PathBuf>,
    /// File with the key of the signature that the hook gets, HMAC-SHA256 of that input. Default: none.
    pub hook_key_file: Option<PathBuf>,
    /// `text` or `json`. Default: text.
    pub log: LogForm,
    /// The program whose command `worker` bakes. Default: this one.
    #[serde(skip)]
    pub worker_program: Option<PathBuf>,
}

/// Treatment of bakes that a server left unfinished.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Unfinished {
    /// Bake them again. A repeated bake has the same events, so that watchers can resume.
    Restart,
    /// Report them as failed.
    Fail,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LogForm {
    Text,
    Json,
}

fn default_data() -> PathBuf {
    // On Windows, the data folder roams from machine to machine, which files of this size should not.
    let folder = base_strategy::choose_native_strategy()
        .map(|folders| if cfg!(windows) { folders.cache_dir() } else { folders.data_dir() });
    folder.map_or("cairn-data".into(), |folder| folder.join("cairn-server"))
}

impl Default for Config {
    fn default() -> Config {
        Config {
            listen: vec!["127.0.0.1:50151".into()],
            data: default_data(),
            token_file: None,
            callers_file: None,
            tls_certificate: None,
            tls_key: None,
            tls_client_ca: None,
            workers: 0,
            queue: 32,
            threads: 0,
            bake_memory_mib: 8192,
            memory_mib: 0,
            bake_seconds: 86_400,
            asset_mib: 256,
            store_mib: 20_480,
            store_days: 30,
            reuse: true,
            unfinished: Unfinished::Restart,
            drain_seconds: 30,
            users: None,
            metrics: None,
            hook: None,
            hook_key_file: None,
            log: LogForm::Text,
            worker_program: None,
        }
    }
}

/// Largest chunk of an upload, bytes.
pub const MAX_CHUNK: usize = 1 << 20;

/// Reads the file that a setting names, if any.
pub fn read_file(setting: &str, path: &Option<PathBuf>, problems: &mut Vec<Problem>) -> Option<Vec<u8>> {
    let read = path.as_ref().map(|path| cairn_files::read(path)).transpose();
    read.unwrap_or_else(|mut problem| {
        problem.what += &format!(" ({setting})");
        problems.push(problem);
        None
    })
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

impl Config {
    /// Threads of a bake that starts as one of so many that run or wait.
    pub fn threads_among(&self, bakes: usize) -> usize {
        match self.threads {
            0 => (cores() / bakes.clamp(1, self.workers())).max(1),
            threads => threads,
        }
    }

    pub fn workers(&self) -> usize {
        match self.workers {
            0 => cores(),
            n => n,
        }
    }

    pub fn bake_memory(&self) -> Option<u64> {
        Some(self.bake_memory_mib << 20).filter(|&bytes| bytes > 0)
    }

    pub fn memory(&self) -> Option<u64> {
        Some(self.memory_mib << 20).filter(|&bytes| bytes > 0)
    }

    pub fn bake_time(&self) -> Option<Duration> {
        Some(Duration::from_secs(self.bake_seconds)).filter(|time| !time.is_zero())
    }

    pub fn asset_bytes(&self) -> u64 {
        self.asset_mib << 20
    }

    pub fn store_bytes(&self) -> u64 {
        self.store_mib << 20
    }

    pub fn store_time(&self) -> Option<Duration> {
        Some(Duration::from_secs(self.store_days * 86_400)).filter(|time| !time.is_zero())
    }
}
