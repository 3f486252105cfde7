//! Cost and load limits of the service: the figures of `examples/README.md`.
//!
//! ```text
//! cargo build --release && cargo study service_load
//! ```
//!
//! Times vary with the machine and its load, so each comparison alternates between its two sides.

mod serving;

use anyhow::{Result, ensure};
use cairn_service::api::pile_service_client::PileServiceClient;
use cairn_service::client::Connection;
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{Artifact, DeleteBakeRequest, Summary};
use serving::{Server, asset, program, read, request, sha256};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use tonic::Code;
use tonic::transport::Endpoint;

/// Bakes of the comparison with the command line.
const PAIRS: i64 = 7;
/// Short bakes that are timed up to their first progress.
const FIRSTS: i64 = 30;
const CALLERS: i64 = 1000;
const STALL: Duration = Duration::from_secs(60);

#[tokio::main]
async fn main() -> Result<()> {
    let folder = tempfile::tempdir()?;
    // Nothing is reused: a bake without its fill would have another pace.
    let server = Server::start(folder.path(), &["--workers", "2", "--queue", "11", "--reuse", "false"])?;
    let mut connection = Connection::open(&server.target).await?;
    let contents = ["cone-small.glb", "cone.glb", "stick.glb"].map(|name| std::fs::read(asset(name)));
    let mut files = BTreeMap::new();
    for content in contents {
        let content = content?;
        files.insert(sha256(&content), content.into());
    }
    connection.upload(&files).await?;
    overhead(&server, &mut connection, folder.path()).await?;
    first_progress(&mut connection).await?;
    callers(&server, &connection).await?;
    stalled(&server, &mut connection).await
}

/// The same bakes by `cairn bake` and through the service, all frames read; in turn.
async fn overhead(server: &Server, connection: &mut Connection, folder: &Path) -> Result<()> {
    let (mut ratios, mut near_seconds) = (Vec::new(), Vec::new());
    for seed in 1..=PAIRS {
        let near = folder.join("near.glb");
        let began = Instant::now();
        let mut bake = Command::new(program()?);
        bake.args(["bake", "--control", "cone-small.glb", "--prop", "stick.glb", "--quiet", "-o"]).arg(&near);
        bake.args(["--no-cache", "--seed", &seed.to_string()]).current_dir(asset(""));
        ensure!(bake.status()?.success(), "the bake failed");
        let near_time = began.elapsed().as_secs_f64();

        let began = Instant::now();
        let request = request("cone-small.glb", &[&format!("seed={seed}")]);
        let (id, _) = read(connection.service.bake(request).await?.into_inner()).await?;
        let far = connection.download(&id, Artifact::Result).await?;
        ratios.push(began.elapsed().as_secs_f64() / near_time);
        near_seconds.push(near_time);
        ensure!(std::fs::read(&near)? == far, "the results differ");
    }
    let [low, middle, high] = spread(&mut ratios);
    println!(
        "streaming: {middle:.3} ({low:.3} to {high:.3}) of the time of `cairn bake` ({:.1} s), {PAIRS} pairs, same \
         bytes; \
         server {:.0} MiB at most",
        spread(&mut near_seconds)[1],
        server.peak_mib()?
    );
    Ok(())
}

async fn first_progress(connection: &mut Connection) -> Result<()> {
    let mut times = Vec::new();
    for seed in 1..=FIRSTS {
        let request = request("cone-small.glb", &["fill.count=5", &format!("seed={seed}")]);
        let mut events = connection.service.bake(request).await?.into_inner();
        let mut accepted = Instant::now();
        while let Some(event) = events.message().await?.and_then(|response| response.event) {
            match event.kind {
                Some(Kind::Accepted(_)) => accepted = Instant::now(),
                Some(Kind::Progress(_)) => break,
                _ => {}
            }
        }
        times.push(accepted.elapsed().as_secs_f64() * 1e3);
        while events.message().await?.is_some() {}
    }
    let [low, middle, high] = spread(&mut times);
    println!("first progress after accept: {middle:.0} ms ({low:.0} to {high:.0}), {FIRSTS} bakes");
    Ok(())
}

/// A thousand calls at once, each for another bake.
async fn callers(server: &Server, connection: &Connection) -> Result<()> {
    let began = Instant::now();
    let calls: Vec<_> = (0..CALLERS)
        .map(|seed| {
            let mut service = connection.service.clone();
            let request = request("cone-small.glb", &["fill.count=5", &format!("seed={}", 1000 + seed)]);
            tokio::spawn(async move {
                let answer = service.bake(request).await;
                (began.elapsed(), answer.map(tonic::Response::into_inner))
            })
        })
        .collect();
    let (mut refused, mut last, mut streams) = (0, Duration::ZERO, Vec::new());
    for call in calls {
        match call.await? {
            (time, Err(status)) => {
                ensure!(status.code() == Code::ResourceExhausted, "{status}");
                refused += 1;
                last = last.max(time);
            }
            (_, Ok(stream)) => streams.push(stream),
        }
    }
    let served = streams.len();
    for stream in streams {
        read(stream).await?;
    }
    println!(
        "{CALLERS} callers: {served} served, {refused} refused, the last after {:.2} s; server {:.0} MiB at most",
        last.as_secs_f64(),
        server.peak_mib()?
    );
    Ok(())
}

/// The same bake for a caller who reads and for one who does not, in steps per CPU second.
async fn stalled(server: &Server, connection: &mut Connection) -> Result<()> {
    let pace =
        |summary: &Summary| (summary.counts["fill_steps"] + summary.counts["steps"]) as f64 / summary.cpu_seconds;
    let spec = || request("cone.glb", &["output.fps=60"]);
    let mut paces = Vec::new();
    for _ in 0..2 {
        let (id, summary) = read(connection.service.bake(spec()).await?.into_inner()).await?;
        let reading = pace(&summary);
        connection.service.delete_bake(DeleteBakeRequest { bake_id: id }).await?;

        let channel = Endpoint::from_shared(format!("http://{}", server.target.address))?.connect().await?;
        let stream = PileServiceClient::new(channel).bake(spec()).await?.into_inner();
        tokio::time::sleep(STALL).await;
        let memory = server.peak_mib()?;
        let (id, summary) = read(stream).await?;
        paces.push(pace(&summary) / reading);
        println!(
            "reader stalled for {} s: {:.1} steps per CPU second against {reading:.1}; server {memory:.0} MiB at most",
            STALL.as_secs(),
            pace(&summary)
        );
        connection.service.delete_bake(DeleteBakeRequest { bake_id: id }).await?;
    }
    let [low, middle, high] = spread(&mut paces);
    println!("ratio {middle:.3} ({low:.3} to {high:.3})");
    Ok(())
}

/// Lowest, middle and highest.
fn spread(values: &mut [f64]) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [values[0], values[values.len() / 2], values[values.len() - 1]]
}
