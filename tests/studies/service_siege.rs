//! A stress test of the server: misbehaving callers of every kind at once, for a given time, and the cost.
//!
//! ```text
//! cargo build --release && cargo study service_siege -- --seconds 600
//! ```
//!
//! Prints one Markdown row per habit, then health, memory and handles before and after. Where `h2load` is installed
//! (Debian: nghttp2-client), its requests come beside all that for as long, and are a row of their own. Then come
//! storms of cancelled bakes: 200 ms after each, no process may be left, and the server may take no more CPU time than
//! one at rest. It fails if that does not hold, if a bake is lost or doubled, or if anything was answered by another
//! error than a refusal.

mod serving;

use anyhow::{Context, Result, ensure};
use cairn_service::client::Connection;
use cairn_wire::proto::{
    AssetHeader, BakeRequest, BakeState, CancelBakeRequest, GetServerInfoRequest, ListBakesRequest, UploadAssetRequest,
};
use clap::Parser;
use serving::{Server, asset, read, request, sha256};
use std::collections::BTreeMap;
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tonic::{Code, Status};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

#[derive(Parser, Clone)]
struct Args {
    /// How long, s.
    #[arg(long, default_value_t = 600)]
    seconds: u64,
    /// Callers of each habit.
    #[arg(long, default_value_t = 8)]
    callers: usize,
}

/// The outcomes of the calls of a habit.
#[derive(Default)]
struct Tally {
    accepted: u64,
    refused: u64,
    /// Counts by message.
    failed: BTreeMap<String, u64>,
    /// Times until the first answer.
    times: Vec<Duration>,
}

impl Tally {
    fn count<T>(&mut self, began: Instant, answer: &Result<T, Status>) {
        self.times.push(began.elapsed());
        match answer {
            Ok(_) => self.accepted += 1,
            Err(status) if status.code() == Code::ResourceExhausted => self.refused += 1,
            Err(status) => *self.failed.entry(format!("{:?}: {}", status.code(), status.message())).or_default() += 1,
        }
    }

    /// Milliseconds that 99 of 100 calls stayed below.
    fn p99(&mut self) -> f64 {
        self.times.sort();
        self.times.get(self.times.len() * 99 / 100).map_or(0.0, |time| time.as_secs_f64() * 1e3)
    }
}

type Shared = Arc<Mutex<Tally>>;

#[tokio::main]
async fn main() -> Result<()> {
    let args = Args::parse();
    let folder = tempfile::tempdir()?;
    let server = Server::start(folder.path(), &["--workers", "2", "--queue", "24"])?;
    let mut connection = Connection::open(&server.target).await?;
    let files: std::io::Result<Vec<_>> =
        ["cone-small.glb", "stick.glb"].iter().map(|name| std::fs::read(asset(name))).collect();
    connection.upload(&files?.into_iter().map(|content| (sha256(&content), content.into())).collect()).await?;
    read(connection.service.bake(short(0)).await?.into_inner()).await?;
    // Memory of the warm-up is no leak.
    fire(&args, Duration::from_secs(args.seconds / 10), 0, &connection, &server).await?;
    rest(&server).await;
    let before = size(&server)?;
    let done_before = done(&mut connection).await?;

    let h2load = h2load(&server, args.seconds);
    let tallies = fire(&args, Duration::from_secs(args.seconds), 1, &connection, &server);
    let (tallies, h2load) = tokio::join!(tallies, h2load);
    let tallies = tallies?;
    let baked = tallies[BAKES].lock().expect("no task panicked").accepted;
    println!("| calls | accepted | refused | failed | 99 % within, ms |\n| --- | --- | --- | --- | --- |");
    let mut failed = 0;
    for (habit, tally) in HABITS.into_iter().zip(&tallies) {
        let mut tally = tally.lock().expect("no task panicked");
        let p99 = tally.p99();
        let faults: u64 = tally.failed.values().sum();
        failed += faults;
        println!("| {habit} | {} | {} | {faults} | {p99:.0} |", tally.accepted, tally.refused);
        for (words, count) in &tally.failed {
            eprintln!("{habit}: {count} times: {words}");
        }
    }
    if let Some(row) = h2load? {
        println!("{row}");
    }
    aftermath(&server, before).await?;
    storms(&args, &connection, &server).await?;
    let done = done(&mut connection).await? - done_before;
    println!("bakes asked for to the end: {baked}; done: {done}");
    ensure!(done == baked as usize, "a bake was lost or doubled");
    ensure!(failed == 0, "{failed} calls failed");
    Ok(())
}

const HABITS: [&str; 7] = ["connections", "half uploads", "cancel storms", "slow readers", "bakes", "lists", "health"];
/// Their place among the habits.
const BAKES: usize = 4;

/// All habits at once, for this time. Another `phase` has other bakes.
async fn fire(
    args: &Args,
    time: Duration,
    phase: i64,
    connection: &Connection,
    server: &Server,
) -> Result<Vec<Shared>> {
    let end = Instant::now() + time;
    let tallies: Vec<Shared> = HABITS.iter().map(|_| Shared::default()).collect();
    let mut tasks = tokio::task::JoinSet::new();
    for (habit, tally) in HABITS.into_iter().zip(&tallies) {
        for caller in 0..if habit == "health" { 1 } else { args.callers } {
            let (connection, target, tally) = (connection.clone(), server.target.clone(), tally.clone());
            tasks.spawn(async move {
                let mut call = 0;
                while Instant::now() < end {
                    call += 1;
                    let seed = phase * 1_000_000_000 + (caller as i64 + 1) * 1_000_000 + call;
                    once(habit, seed, connection.clone(), &target, &tally).await;
                }
            });
        }
    }
    while let Some(task) = tasks.join_next().await {
        task?;
    }
    Ok(tallies)
}

/// How many bakes the server has done.
async fn done(connection: &mut Connection) -> Result<usize> {
    let mut list = ListBakesRequest { states: vec![BakeState::Succeeded.into()], ..Default::default() };
    let mut ids = std::collections::BTreeSet::new();
    loop {
        let page = connection.service.list_bakes(list.clone()).await?.into_inner();
        for bake in page.bakes {
            ensure!(ids.insert(bake.bake_id.clone()), "{} is there twice", bake.bake_id);
        }
        if page.next_page_token.is_empty() {
            return Ok(ids.len());
        }
        list.page_token = page.next_page_token;
    }
}

/// Waits until the server runs nothing.
async fn rest(server: &Server) {
    while children(server) > 0 {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

/// Memory, handles and processes once all have gone, and the CPU time that an idle server takes.
async fn aftermath(server: &Server, before: (f64, usize)) -> Result<()> {
    rest(server).await;
    let busy = cpu_seconds(server)?;
    tokio::time::sleep(Duration::from_secs(5)).await;
    let idle = cpu_seconds(server)? - busy;
    let after = size(server)?;
    println!("\nmemory: {:.0} MiB before, {:.0} MiB after; {:.0} MiB at most", before.0, after.0, server.peak_mib()?);
    println!("handles: {} before, {} after; no process left; CPU time of 5 s at rest: {idle:.2} s", before.1, after.1);
    Ok(())
}

/// Bakes that are cancelled all at once, several times. Soon after, the server is as idle as if there had been none.
async fn storms(args: &Args, connection: &Connection, server: &Server) -> Result<()> {
    const STORMS: i64 = 5;
    const SOON: Duration = Duration::from_millis(200);
    const WHILE: Duration = Duration::from_secs(2);
    /// CPU time that an idle server may take in that while, s: a tenth of a core. It looks through its store, which is
    /// large by now; one process that was left would take all of the while.
    const IDLE: f64 = 0.2;
    let mut most: f64 = 0.0;
    for storm in 0..STORMS {
        let mut ids = Vec::new();
        for bake in 0..2 * args.callers as i64 {
            let mut service = connection.service.clone();
            let mut stream = service.bake(endless(3_000_000_000 + storm * 1_000_000 + bake)).await?.into_inner();
            let first = stream.message().await?.and_then(|first| first.event).context("no event")?;
            ids.push(id_of(&first));
        }
        while children(server) < 2 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        let mut cancels = tokio::task::JoinSet::new();
        for bake_id in ids {
            let mut service = connection.service.clone();
            cancels.spawn(async move { service.cancel_bake(CancelBakeRequest { bake_id }).await });
        }
        while let Some(cancelled) = cancels.join_next().await {
            cancelled??;
        }
        tokio::time::sleep(SOON).await;
        ensure!(children(server) == 0, "processes are left {SOON:?} after a storm of cancelled bakes");
        let before = cpu_seconds(server)?;
        tokio::time::sleep(WHILE).await;
        most = most.max(cpu_seconds(server)? - before);
    }
    println!(
        "storms of {} cancelled bakes: {SOON:?} after each no process left; CPU time of the next {WHILE:?}: {most:.2} \
         s at most",
        2 * args.callers
    );
    ensure!(most <= IDLE, "the server is not idle after a storm of cancelled bakes");
    Ok(())
}

fn short(seed: i64) -> BakeRequest {
    request("cone-small.glb", &["accuracy=draft", "fill.count=12", &format!("seed={seed}")])
}

fn endless(seed: i64) -> BakeRequest {
    request("cone-small.glb", &["accuracy=draft", "physics.step_natural=0.000001", &format!("seed={seed}")])
}

/// One call of a habit, from its beginning to its end.
async fn once(
    habit: &str,
    seed: i64,
    mut connection: Connection,
    target: &cairn_service::client::Target,
    tally: &Shared,
) {
    let began = Instant::now();
    let count = |answer: &Result<(), Status>| tally.lock().expect("no task panicked").count(began, answer);
    let service = &mut connection.service;
    match habit {
        "connections" => {
            let opened = Connection::open(target).await;
            let answer = match opened {
                Ok(mut own) => own.service.get_server_info(GetServerInfoRequest::default()).await.map(drop),
                Err(status) => Err(status),
            };
            count(&answer);
        }
        "half uploads" => {
            let header = AssetHeader { sha256: sha256(&seed.to_le_bytes()), size_bytes: 1 << 20 };
            let half = [
                UploadAssetRequest { header: Some(header), ..Default::default() },
                UploadAssetRequest { chunk: vec![7; 1 << 19].into(), ..Default::default() },
            ];
            // Half of it and then the end: a fault of the caller, reported as that.
            match service.upload_asset(tokio_stream::iter(half)).await {
                Err(status) if status.code() == Code::InvalidArgument => count(&Ok(())),
                answer => count(&answer.map(drop)),
            }
        }
        "cancel storms" => match service.bake(endless(seed)).await {
            Ok(stream) => {
                let first = stream.into_inner().message().await;
                let id = first.as_ref().ok().and_then(|first| first.as_ref()?.event.as_ref()).map(id_of);
                let answer = service.cancel_bake(CancelBakeRequest { bake_id: id.unwrap_or_default() }).await;
                count(&answer.map(drop));
            }
            Err(status) => {
                count(&Err(status));
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        },
        // Of the same bake, which is done: one event each tenth of a second, and then no more.
        "slow readers" => match service.bake(short(0)).await {
            Ok(stream) => {
                let mut stream = stream.into_inner();
                count(&Ok(()));
                for _ in 0..20 {
                    tokio::time::sleep(Duration::from_millis(100)).await;
                    let _ = stream.message().await;
                }
            }
            Err(status) => count(&Err(status)),
        },
        // A bake is done once it has sent its summary, whoever else bakes.
        "bakes" => match service.bake(short(seed)).await {
            Ok(stream) => {
                count(&Ok(()));
                if let Err(lost) = read(stream.into_inner()).await {
                    count(&Err(Status::data_loss(lost.to_string())));
                }
            }
            Err(status) => {
                count(&Err(status));
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        },
        "lists" => count(&service.list_bakes(ListBakesRequest::default()).await.map(drop)),
        _ => {
            let address = format!("http://{}", target.address);
            let answer = match tonic::transport::Endpoint::from_shared(address).map(|server| server.connect_lazy()) {
                Ok(channel) => HealthClient::new(channel).check(HealthCheckRequest::default()).await.map(drop),
                Err(error) => Err(Status::internal(error.to_string())),
            };
            count(&answer);
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
}

fn id_of(event: &cairn_wire::proto::BakeEvent) -> String {
    match &event.kind {
        Some(cairn_wire::proto::bake_event::Kind::Accepted(accepted)) => accepted.bake_id.clone(),
        _ => String::new(),
    }
}

/// What h2load reports, if it is installed: `GetServerInfo` over 32 connections, for as long as all the others call.
async fn h2load(server: &Server, seconds: u64) -> Result<Option<String>> {
    let body = tempfile::NamedTempFile::new()?;
    // An empty message, as gRPC frames it.
    std::fs::write(body.path(), [0; 5])?;
    let mut command = Command::new("h2load");
    command.args(["-D", &seconds.to_string(), "-c", "32", "-m", "16", "-H", "te: trailers"]);
    command.args(["-H", "content-type: application/grpc", "-d"]).arg(body.path());
    command.arg(format!("http://{}/cairn.v1.PileService/GetServerInfo", server.target.address));
    let Ok(done) = tokio::task::spawn_blocking(move || command.output()).await? else { return Ok(None) };
    let output = String::from_utf8_lossy(&done.stdout).into_owned();
    let line = |start: &str| output.lines().find(|line| line.starts_with(start)).unwrap_or_default().to_owned();
    let requests = line("requests:");
    ensure!(requests.contains(" 0 failed, 0 errored"), "h2load: {output}");
    Ok(Some(format!("\nh2load: {}; {requests}", line("finished in"))))
}

/// Memory that it has now, MiB, and its open handles. From Linux.
fn size(server: &Server) -> Result<(f64, usize)> {
    let of = format!("/proc/{}", server.process.id());
    let status = std::fs::read_to_string(format!("{of}/status"))?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).context("no VmRSS")?;
    let handles = std::fs::read_dir(format!("{of}/fd"))?.count();
    Ok((line.trim().trim_end_matches(" kB").parse::<f64>()? / 1024.0, handles))
}

/// CPU time of it and of all that it has waited for, s. From Linux.
fn cpu_seconds(server: &Server) -> Result<f64> {
    /// Of `/proc`, per second.
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", server.process.id()))?;
    let (_, fields) = stat.rsplit_once(") ").context("no stat")?;
    let ticks = fields.split_whitespace().skip(11).take(4).map(str::parse::<f64>);
    Ok(ticks.sum::<Result<f64, _>>()? / TICKS)
}

fn children(server: &Server) -> usize {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", server.process.id())).into_iter().flatten().flatten();
    let children = tasks.map(|task| std::fs::read_to_string(task.path().join("children")).unwrap_or_default());
    children.map(|children| children.split_whitespace().count()).sum()
}
