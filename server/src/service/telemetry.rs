//! Log lines and metrics of a server.

use crate::service::config::{Config, LogForm};
use metrics::{Unit, describe_counter, describe_gauge, describe_histogram};
use metrics_exporter_prometheus::{BuildError, PrometheusBuilder};
use std::io::IsTerminal;
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

/// Serves the metrics if the settings have an address for them.
pub fn metrics(config: &Config) -> Result<(), BuildError> {
    let Some(address) = config.metrics else { return Ok(()) };
    PrometheusBuilder::new().with_http_listener(address).install()?;
    describe_gauge!("cairn_bakes_pending", "Bakes being planned, waiting or running.");
    describe_gauge!("cairn_bakes_running", "Running bakes.");
    describe_counter!("cairn_bakes_total", "Ended bakes, by outcome.");
    describe_counter!("cairn_bakes_refused_total", "Bakes refused because the queue was full.");
    describe_counter!("cairn_calls_refused_total", "Refused calls, by reason.");
    describe_counter!("cairn_bakes_shared_total", "Requests answered by an existing bake of the same request.");
    describe_histogram!("cairn_bake_seconds", Unit::Seconds, "Duration of a bake, from start to end.");
    describe_counter!("cairn_bodies_total", "Bodies baked; its rate is bodies per second.");
    describe_counter!("cairn_solves_total", "Equilibrium analyses.");
    describe_gauge!("cairn_stage_cpu_seconds_total", Unit::Seconds, "CPU time of bakes, by stage.");
    describe_histogram!("cairn_bake_peak_memory_bytes", Unit::Bytes, "Peak memory of a bake.");
    describe_gauge!("cairn_store_bytes", Unit::Bytes, "Size of assets and bakes on disk.");
    Ok(())
}
