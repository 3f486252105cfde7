//! The siege: eight clients bake tiny piles, while an attacker without a token and one with a token do their worst.
//!
//! ```text
//! cargo nextest run --release -p cairn --run-ignored only -E 'test(siege::)' --no-capture
//! ```
//!
//! First each attack alone, on a server of its own, for its peak memory; then all of them at once for three minutes, or
//! `SIEGE_SECONDS`. The server has a memory limit of its own (`ulimit -v`), and so have the processes of its bakes.
//! It fails if a client meets an error, if an attack is not answered as it should be, or if a bake is accepted too
//! late. With `UPDATE_PAGE=1` it writes the table to `tests/studies/siege.md`.

use crate::service::attacks::{self, Bomb, BombSize, RawCall};
use crate::service::server::{Server, channel, children, content, request, short, take};
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::PlanBakeRequest;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tonic::Code;
use tonic::transport::Channel;

const CALLERS: &str = "[[caller]]\nname = 'anna'\ntoken = 'anna'\n[[caller]]\nname = 'mallory'\ntoken = 'mallory'\n";
/// Memory of the server, and of each process that it starts, KiB; handles.
const LIMITS: &str = "ulimit -v 4000000; ulimit -n 1024";
const SETTINGS: [&str; 6] = ["--workers", "2", "--bake-memory-mib", "2048", "--memory-mib", "3072"];
const CLIENTS: i64 = 8;
const SECONDS: u64 = 180;
/// Of an attack alone.
const ALONE: Duration = Duration::from_secs(5);
/// Pause of an attacker between two calls.
const PAUSE: Duration = Duration::from_millis(200);
/// How soon 99 of 100 bakes are accepted.
const SOON: Duration = Duration::from_millis(250);
/// Bytes of the requests that were found to kill a server.
const LARGE: usize = 30 << 20;
/// The files that were found to take all memory or time: this many primitives.
const PRIMITIVES: usize = 100_000;
const SILENT: usize = 1100;
const NO_ANSWER: &str = "no answer";

/// A server that is attacked.
struct Besieged {
    server: Server,
    folder: TempDir,
}

impl Besieged {
    fn start() -> Besieged {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("callers.toml"), CALLERS).unwrap();
        let args = [&["--callers-file", "callers.toml"], &SETTINGS[..]].concat();
        Besieged { server: Server::start_by_shell(folder.path(), LIMITS, &args), folder }
    }

    async fn connect(&self, token: &str) -> Connection {
        Connection::open(&Target { token: Some(token.into()), ..self.server.target() }).await.unwrap()
    }

    async fn channel(&self) -> Channel {
        channel(&format!("http://{}", self.server.addresses[0])).await
    }

    /// Memory of it and of all that it has started, MiB.
    fn memory(&self) -> u64 {
        let server = self.server.id();
        children(server).into_iter().chain([server]).map(resident).sum::<u64>() >> 20
    }
}

/// The memory that a process has, bytes.
pub fn resident(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok()).unwrap_or(0) << 10
}

/// What an attacker does, again and again.
#[derive(Clone)]
enum Attack {
    Raw(RawCall, Option<&'static str>),
    /// Many at once, of which none ends.
    Unfinished(RawCall),
    Silent {
        with_preface: bool,
    },
    Bomb(Box<PlanBakeRequest>),
}

struct Row {
    name: String,
    bound: &'static str,
    attack: Attack,
    /// Every answer is one of these.
    answers: &'static [Code],
    peak: u64,
    outcome: BTreeMap<String, u64>,
}

/// The attacks; their files are uploaded by the first connection.
async fn attacks(mallory: &mut Connection, bombs: &[Bomb], primitives: &Bomb) -> Vec<Row> {
    let row =
        |name: String, bound, attack, answers| Row { name, bound, attack, answers, peak: 0, outcome: BTreeMap::new() };
    let mut rows = Vec::new();
    for (name, call) in attacks::swelling(LARGE) {
        let bound = "16 times the bytes, and 8 MiB, before it is decoded";
        // One caller may have 96 MiB on the way.
        let answers = &[Code::InvalidArgument, Code::ResourceExhausted][..];
        rows.push(row(format!("{name}, 30 MiB"), bound, Attack::Raw(call.clone(), Some("mallory")), answers));
        let bound = "the token, before anything is read";
        rows.push(row(format!("{name}, no token"), bound, Attack::Raw(call, None), &[Code::Unauthenticated]));
    }
    let unfinished = RawCall::unfinished("PlanBake", 31 << 20);
    let bound = "96 MiB of a caller that have not arrived in full, and a least pace";
    rows.push(row("30 requests of 31 MiB without an end".into(), bound, Attack::Unfinished(unfinished), &[]));
    let bound = "half of the handles, half of these without a token; 10 s";
    for (name, with_preface) in [("silent connections", false), ("connections with a preface alone", true)] {
        rows.push(row(format!("{SILENT} {name}"), bound, Attack::Silent { with_preface }, &[]));
    }
    for bomb in bombs {
        let spec = bomb.upload(mallory).await;
        let name = format!("{}, {} KiB", bomb.name, bomb.bytes() >> 10);
        let plan = Attack::Bomb(Box::new(PlanBakeRequest { spec: Some(spec) }));
        rows.push(row(name, bomb.bound, plan, &[Code::InvalidArgument, Code::ResourceExhausted]));
    }
    let plan = Box::new(PlanBakeRequest { spec: Some(primitives.upload(mallory).await) });
    let bound = "linear in triangles; 4 million of them; 120 s of a plan";
    rows.push(row(format!(".glb of {PRIMITIVES} primitives in one place"), bound, Attack::Bomb(plan), &[]));
    let mut plan = short(1);
    plan.scene.as_mut().unwrap().props[0].scale_min = Some(1e-30);
    plan.scene.as_mut().unwrap().props[0].scale_max = Some(1e-30);
    let plan = Attack::Bomb(Box::new(PlanBakeRequest { spec: Some(plan) }));
    rows.push(row("a scale of 1e-30".into(), "sums that saturate", plan, &[]));
    rows
}

/// An attacker until the end.
async fn attack(
    besieged: Arc<Besieged>,
    attack: Attack,
    is_over: Arc<AtomicBool>,
    outcome: Arc<Mutex<BTreeMap<String, u64>>>,
) {
    let count = |what: String| *outcome.lock().unwrap().entry(what).or_default() += 1;
    let named = |code: Option<Code>| code.map_or(NO_ANSWER.to_owned(), |code| format!("{code:?}"));
    let mut channel = besieged.channel().await;
    let mut mallory = besieged.connect("mallory").await;
    if let Attack::Raw(_, token @ Some(_)) = &attack {
        // Until it has shown its token, a connection gives way as a stranger's does.
        while RawCall::new("CreateBake", &[]).send(&mut channel, *token).await.is_none() {}
    }
    while !is_over.load(Ordering::Relaxed) {
        match &attack {
            Attack::Raw(call, token) => count(named(call.send(&mut channel, *token).await)),
            Attack::Unfinished(call) => {
                let sent = (0..30).map(|_| {
                    let (mut channel, call) = (channel.clone(), call.clone());
                    async move { call.send(&mut channel, Some("mallory")).await }
                });
                let mut all: tokio::task::JoinSet<_> = sent.collect();
                let whole = async {
                    while let Some(answer) = all.join_next().await {
                        count(named(answer.unwrap()));
                    }
                };
                if tokio::time::timeout(Duration::from_secs(30), whole).await.is_err() {
                    count("ended by the attacker".into());
                }
            }
            Attack::Silent { with_preface } => {
                let mut all = Vec::new();
                for _ in 0..SILENT {
                    // While the server takes none, the clients in this process go on.
                    let Ok(mut stream) = TcpStream::connect(&besieged.server.addresses[0]).await else { continue };
                    if *with_preface {
                        let _ = stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").await;
                    }
                    all.push(stream);
                }
                count("opened again and again".into());
                tokio::time::sleep(Duration::from_secs(2)).await;
            }
            Attack::Bomb(plan) => {
                let answer = mallory.service.plan_bake((**plan).clone()).await;
                count(named(Some(answer.err().map_or(Code::Ok, |status| status.code()))));
            }
        }
        tokio::time::sleep(PAUSE).await;
    }
}

/// The peak of the memory while something lasts.
async fn peak_while<T>(besieged: &Besieged, work: impl Future<Output = T>) -> (u64, T) {
    let mut peak = 0;
    let watch = async {
        loop {
            peak = peak.max(besieged.memory());
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::select! {
        done = work => (peak, done),
        () = watch => unreachable!("it watches forever"),
    }
}

/// What the clients met.
#[derive(Default)]
struct Met {
    accepted: Vec<Duration>,
    bakes: u64,
    errors: Vec<String>,
}

async fn client(besieged: Arc<Besieged>, number: i64, is_over: Arc<AtomicBool>, met: Arc<Mutex<Met>>) {
    let mut anna = besieged.connect("anna").await;
    for bake in 0.. {
        if is_over.load(Ordering::Relaxed) {
            return;
        }
        let seed = number * 1_000_000 + bake;
        let mut spec = short(seed);
        if number % 2 == 0 {
            // The server has not met this scene; the others ask for another seed of one that it has planned.
            spec.scene.as_mut().unwrap().props[0].weight = Some(seed as f64);
        }
        let began = Instant::now();
        let answer = anna.service.bake(request(spec)).await;
        let stream = match answer {
            Ok(answer) => answer.into_inner(),
            Err(status) => {
                met.lock().unwrap().errors.push(status.to_string());
                continue;
            }
        };
        met.lock().unwrap().accepted.push(began.elapsed());
        let (_, end) = take(stream, usize::MAX).await;
        let mut met = met.lock().unwrap();
        match end {
            Ok(()) => met.bakes += 1,
            Err(status) => met.errors.push(status.to_string()),
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes minutes, and the machine for itself"]
async fn clients_bake_on_while_others_attack() {
    let seconds = std::env::var("SIEGE_SECONDS").map_or(SECONDS, |seconds| seconds.parse().unwrap());
    // What others do on the machine makes everything slower.
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split(' ').next().unwrap_or_default().to_owned();
    let files = ["cone-small.glb", "stick.glb"].map(content);
    let mut rows = Vec::new();
    let probe = Besieged::start();
    let (bombs, primitives) = (attacks::bombs(BombSize::Large), attacks::primitives(PRIMITIVES));
    let count = attacks(&mut probe.connect("mallory").await, &bombs, &primitives).await.len();
    drop(probe);
    // Each alone.
    for at in 0..count {
        let besieged = Arc::new(Besieged::start());
        let mut mallory = besieged.connect("mallory").await;
        attacks::upload(&mut mallory, &files).await;
        let mut row = attacks(&mut mallory, &bombs, &primitives).await.swap_remove(at);
        let (is_over, outcome) = (Arc::<AtomicBool>::default(), Arc::default());
        let work = attack(besieged.clone(), row.attack.clone(), is_over.clone(), outcome);
        let task = tokio::spawn(work);
        (row.peak, _) = peak_while(&besieged, tokio::time::sleep(ALONE)).await;
        task.abort();
        eprintln!("{}: {} MiB", row.name, row.peak);
        rows.push(row);
    }
    // All at once.
    let besieged = Arc::new(Besieged::start());
    let mut mallory = besieged.connect("mallory").await;
    attacks::upload(&mut mallory, &files).await;
    attacks(&mut mallory, &bombs, &primitives).await;
    attacks::upload(&mut besieged.connect("anna").await, &files).await;
    let (is_over, met) = (Arc::<AtomicBool>::default(), Arc::<Mutex<Met>>::default());
    let mut clients = tokio::task::JoinSet::new();
    for number in 1..=CLIENTS {
        clients.spawn(client(besieged.clone(), number, is_over.clone(), met.clone()));
    }
    let outcomes: Vec<Arc<Mutex<BTreeMap<String, u64>>>> = rows.iter().map(|_| Arc::default()).collect();
    let mut attackers = tokio::task::JoinSet::new();
    for (row, outcome) in rows.iter().zip(&outcomes) {
        attackers.spawn(attack(besieged.clone(), row.attack.clone(), is_over.clone(), outcome.clone()));
    }
    let (peak, ()) = peak_while(&besieged, tokio::time::sleep(Duration::from_secs(seconds))).await;
    is_over.store(true, Ordering::Relaxed);
    while let Some(done) = clients.join_next().await {
        done.unwrap();
    }
    attackers.abort_all();
    for (row, outcome) in rows.iter_mut().zip(outcomes) {
        row.outcome = outcome.lock().unwrap().clone();
    }
    let met = std::mem::take(&mut *met.lock().unwrap());
    let page = page(&rows, &met, [peak, seconds], &load);
    println!("{page}");
    if std::env::var_os("UPDATE_PAGE").is_some() {
        std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/studies/siege.md"), page).unwrap();
    }
    assert!(besieged.folder.path().is_dir() && met.errors.is_empty(), "{:?}", met.errors);
    for row in rows.iter().filter(|row| !row.answers.is_empty()) {
        // Whoever shows no token may be closed at any time.
        let is_stranger = matches!(row.attack, Attack::Raw(_, None));
        let right = |what: &String| {
            is_stranger && what == NO_ANSWER || row.answers.iter().any(|answer| format!("{answer:?}") == **what)
        };
        assert!(row.outcome.keys().all(right), "{}: {:?}", row.name, row.outcome);
    }
    assert!(p99(&met) < SOON, "99 of 100 bakes were accepted within {:?}", p99(&met));
}

fn p99(met: &Met) -> Duration {
    let mut accepted = met.accepted.clone();
    accepted.sort();
    accepted.get(accepted.len() * 99 / 100).copied().unwrap_or(Duration::MAX)
}

fn page(rows: &[Row], met: &Met, [peak, seconds]: [u64; 2], load: &str) -> String {
    let mut page = [
        "# The siege",
        "",
        "What attackers reach, with and without a token, while eight clients bake. `tests/service/siege.rs`",
        "writes this page, and says how. Peak memory is that of the server and all of its processes, MiB, for an",
        "attack alone; the outcome is what was answered while all came at once. Half of the clients bake a new scene",
        "each time, half another seed of one scene.",
        "",
        "| attack | bound | peak, MiB | outcome |",
        "| --- | --- | --- | --- |",
        "",
    ]
    .join("\n");
    for row in rows {
        let outcome: Vec<String> = row.outcome.iter().map(|(what, count)| format!("{what}: {count}")).collect();
        let _ = writeln!(page, "| {} | {} | {} | {} |", row.name, row.bound, row.peak, outcome.join(", "));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let (accepted, p99, bakes, errors) = (met.accepted.len(), p99(met).as_millis(), met.bakes, met.errors.len());
    let lines = [
        format!("All at once for {seconds} s on {cores} cores, clients and attackers beside the server, and a load of"),
        format!(
            "{load} before: {accepted} bakes of the clients were accepted, 99 of 100 within {p99} ms; {bakes} finished,"
        ),
        format!("and {errors} failed. The server and all of its processes took {peak} MiB at most."),
    ];
    let _ = writeln!(page, "\n{}", lines.join("\n"));
    page
}
