//! Log lines and metrics of a server.

use crate::job::machine;
use crate::service::config::{Config, LogForm};
use crate::service::jobs::Bakes;
use axum::Router;
use axum::http::StatusCode;
use axum::routing::get;
use metrics::{Unit, describe_counter, describe_gauge, describe_histogram};
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::net::TcpListener;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

/// Sends log lines to stderr; `RUST_LOG` selects them. Lines about a bake have its id.
pub fn log(form: LogForm) {
    let asked =
        std::env::var("RUST_LOG").ok().filter(|text| !text.is_empty()).and_then(|text| text.parse::<Targets>().ok());
    let filter = asked.unwrap_or_else(|| Targets::new().with_default(LevelFilter::INFO));
    let is_terminal = std::io::stderr().is_terminal();
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_ansi(is_terminal);
    let lines = match form {
        LogForm::Text => lines.boxed(),
        LogForm::Json => lines.json().boxed(),
    };
    // A second server in the same process, as in a test, keeps the first one's logger.
    let _ = tracing_subscriber::registry().with(lines.with_filter(filter)).try_init();
}

/// Bounds of the buckets of durations, s, and of sizes, bytes.
const SECONDS: [f64; 12] = [1.0, 3.0, 10.0, 30.0, 60.0, 180.0, 600.0, 1800.0, 3600.0, 10_800.0, 36_000.0, 86_400.0];
const BYTES: [f64; 8] = [67e6, 134e6, 268e6, 537e6, 1.07e9, 2.15e9, 4.29e9, 8.59e9];

/// Ends of bakes, as the label `outcome`.
pub const OUTCOMES: [&str; 3] = ["succeeded", "failed", "cancelled"];

/// A socket for the metrics, and what is served there.
pub struct Metrics {
    listener: TcpListener,
    page: PrometheusHandle,
}

/// Opens a socket for the metrics if the settings have an address for them. All metrics are there from the start.
pub async fn metrics(config: &Config) -> std::io::Result<Option<Metrics>> {
    let Some(address) = config.metrics else { return Ok(None) };
    let listener = TcpListener::bind(address).await?;
    let buckets = PrometheusBuilder::new()
        .set_buckets_for_metric(Matcher::Suffix("_seconds".into()), &SECONDS)
        .and_then(|builder| builder.set_buckets_for_metric(Matcher::Suffix("_bytes".into()), &BYTES));
    let page = buckets.and_then(PrometheusBuilder::install_recorder).map_err(std::io::Error::other)?;
    describe();
    metrics::gauge!("cairn_build_info", "version" => crate::version::VERSION).set(1.0);
    metrics::gauge!("cairn_workers").set(config.workers() as f64);
    metrics::gauge!("cairn_queue_limit").set(config.queue as f64);
    metrics::gauge!("cairn_store_limit_bytes").set(config.store_bytes() as f64);
    for outcome in OUTCOMES {
        metrics::counter!("cairn_bakes_total", "outcome" => outcome).increment(0);
    }
    for name in ["cairn_bakes_refused_total", "cairn_bakes_shared_total", "cairn_bodies_total", "cairn_solves_total"] {
        metrics::counter!(name).increment(0);
    }
    metrics::counter!("cairn_calls_refused_total", "reason" => "token").increment(0);
    for stage in ["shape", "fill", "glue", "release", "hold", "measure", "read", "encode"] {
        metrics::counter!("cairn_stage_cpu_milliseconds_total", "stage" => stage).increment(0);
    }
    for name in ["cairn_bakes_pending", "cairn_bakes_running", "cairn_store_bytes"] {
        metrics::gauge!(name).set(0.0);
    }
    let _ = (metrics::histogram!("cairn_bake_seconds"), metrics::histogram!("cairn_bake_peak_memory_bytes"));
    Ok(Some(Metrics { listener, page }))
}

fn describe() {
    describe_gauge!("cairn_build_info", "1; its label is the version.");
    describe_gauge!("cairn_bakes_pending", "Bakes being planned, waiting or running.");
    describe_gauge!("cairn_bakes_running", "Running bakes.");
    describe_gauge!("cairn_bakes_waiting", "Bakes that wait for a worker.");
    describe_gauge!("cairn_oldest_wait_seconds", Unit::Seconds, "Time that the oldest of these waits.");
    describe_gauge!("cairn_workers", "Bakes that may run at the same time.");
    describe_gauge!("cairn_queue_limit", "Bakes that may wait.");
    describe_counter!("cairn_bakes_total", "Ended bakes, by outcome.");
    describe_counter!("cairn_bakes_refused_total", "Bakes refused because the queue was full.");
    describe_counter!("cairn_calls_refused_total", "Refused calls, by reason.");
    describe_counter!("cairn_bakes_shared_total", "Requests answered by an existing bake of the same request.");
    describe_histogram!("cairn_bake_seconds", Unit::Seconds, "Duration of a bake, from start to end.");
    describe_counter!("cairn_bodies_total", "Bodies baked; its rate is bodies per second.");
    describe_counter!("cairn_solves_total", "Equilibrium analyses.");
    describe_counter!("cairn_stage_cpu_milliseconds_total", "CPU time of bakes, by stage, ms.");
    describe_histogram!("cairn_bake_peak_memory_bytes", Unit::Bytes, "Peak memory of a bake.");
    describe_gauge!("cairn_store_bytes", Unit::Bytes, "Size of assets and bakes on disk.");
    describe_gauge!("cairn_store_limit_bytes", Unit::Bytes, "Size beyond which the oldest of these are removed.");
    describe_gauge!("cairn_disk_free_bytes", Unit::Bytes, "Free space on the disk of the data directory.");
}

impl Metrics {
    /// Serves the metrics at `/metrics`. `/livez` answers that the server runs, `/readyz` whether it takes work.
    pub async fn serve(self, bakes: Arc<Bakes>, is_ready: Arc<AtomicBool>) {
        let page = self.page.clone();
        let metrics = move || {
            let (page, bakes) = (page.clone(), bakes.clone());
            async move {
                observe(&bakes);
                page.run_upkeep();
                page.render()
            }
        };
        let ready = move || {
            let is_ready = is_ready.load(Ordering::Relaxed);
            async move {
                if is_ready { (StatusCode::OK, "ready\n") } else { (StatusCode::SERVICE_UNAVAILABLE, "not ready\n") }
            }
        };
        let routes = Router::new()
            .route("/metrics", get(metrics))
            .route("/livez", get(async || "alive\n"))
            .route("/readyz", get(ready));
        if let Err(error) = axum::serve(self.listener, routes).await {
            tracing::error!(%error, "the metrics are no longer served");
        }
    }
}

/// Takes the values that nothing else keeps.
fn observe(bakes: &Bakes) {
    let (waiting, oldest) = bakes.waiting();
    metrics::gauge!("cairn_bakes_waiting").set(waiting as f64);
    metrics::gauge!("cairn_oldest_wait_seconds").set(oldest.as_secs_f64());
    if let Some(free) = machine::free_disk(&bakes.config.data) {
        metrics::gauge!("cairn_disk_free_bytes").set(free as f64);
    }
}
