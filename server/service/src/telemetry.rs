//! Log lines of a server, and the page of its metrics.

use crate::config::{Config, LogForm};
use crate::jobs::Bakes;
use crate::metrics::METRICS;
use axum::Router;
use axum::http::StatusCode;
use axum::routing::get;
use cairn_job::machine;
use cairn_wire::to_proto::signed;
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

/// A socket for the metrics.
pub struct MetricsPage {
    listener: TcpListener,
}

/// Opens a socket for the metrics if the settings have an address for them. All metrics are there from the start.
pub async fn metrics(config: &Config) -> std::io::Result<Option<MetricsPage>> {
    let Some(address) = config.metrics else { return Ok(None) };
    let listener = TcpListener::bind(address).await?;
    METRICS.workers.set(i64::try_from(config.workers()).unwrap_or(i64::MAX));
    METRICS.queue_limit.set(i64::try_from(config.queue).unwrap_or(i64::MAX));
    METRICS.store_limit_bytes.set(signed(config.store_bytes()));
    Ok(Some(MetricsPage { listener }))
}

impl MetricsPage {
    /// Serves the metrics at `/metrics`. `/livez` answers that the server runs, `/readyz` whether it takes work.
    pub async fn serve(self, bakes: Arc<Bakes>, is_ready: Arc<AtomicBool>) {
        let metrics = move || {
            let bakes = bakes.clone();
            async move {
                observe(&bakes);
                match METRICS.page() {
                    Ok(page) => (StatusCode::OK, page),
                    Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")),
                }
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
    METRICS.bakes_waiting.set(i64::try_from(waiting).unwrap_or(i64::MAX));
    METRICS.oldest_wait_seconds.set(oldest.as_secs_f64());
    if let Some(free) = machine::free_disk(&bakes.config.data) {
        METRICS.disk_free_bytes.set(signed(free));
    }
}
