//! What a server counts of itself, for Prometheus. All metrics of the process are here, with their help texts.

use prometheus::core::Collector;
use prometheus::{
    Gauge, Histogram, HistogramOpts, IntCounter, IntCounterVec, IntGauge, IntGaugeVec, Opts, Registry, TextEncoder,
};
use std::sync::LazyLock;

/// Bounds of the buckets of durations, s, and of sizes, bytes.
const SECONDS: [f64; 12] = [1.0, 3.0, 10.0, 30.0, 60.0, 180.0, 600.0, 1800.0, 3600.0, 10_800.0, 36_000.0, 86_400.0];
const BYTES: [f64; 8] = [67e6, 134e6, 268e6, 537e6, 1.07e9, 2.15e9, 4.29e9, 8.59e9];

/// Ends of bakes, as the label `outcome`.
const OUTCOMES: [&str; 3] = ["succeeded", "failed", "cancelled"];
/// Stages of a bake, as the label `stage`.
const STAGES: [&str; 8] = ["shape", "fill", "glue", "release", "hold", "measure", "read", "encode"];

/// Those of this process. They count whether anybody asks for them or not.
pub static METRICS: LazyLock<Metrics> = LazyLock::new(Metrics::new);

/// The page calls each by its name here, with `cairn_` before it, and `_total` behind a counter's.
pub struct Metrics {
    registry: Registry,
    pub bakes_pending: IntGauge,
    pub bakes_running: IntGauge,
    pub bakes_waiting: IntGauge,
    pub oldest_wait_seconds: Gauge,
    pub workers: IntGauge,
    pub queue_limit: IntGauge,
    /// By outcome.
    pub bakes: IntCounterVec,
    pub bakes_refused: IntCounter,
    /// By reason.
    pub calls_refused: IntCounterVec,
    pub bakes_shared: IntCounter,
    pub bake_seconds: Histogram,
    pub bodies: IntCounter,
    pub solves: IntCounter,
    /// By stage.
    pub stage_cpu_milliseconds: IntCounterVec,
    pub bake_peak_memory_bytes: Histogram,
    pub store_bytes: IntGauge,
    pub store_limit_bytes: IntGauge,
    pub disk_free_bytes: IntGauge,
}

impl Metrics {
    fn new() -> Metrics {
        let registry = Registry::new();
        let page = Page(&registry);
        let metrics = Metrics {
            bakes_pending: page.gauge("bakes_pending", "Bakes being planned, waiting or running."),
            bakes_running: page.gauge("bakes_running", "Running bakes."),
            bakes_waiting: page.gauge("bakes_waiting", "Bakes that wait for a worker."),
            oldest_wait_seconds: page
                .add(Gauge::new("cairn_oldest_wait_seconds", "Time that the oldest of these waits.")),
            workers: page.gauge("workers", "Bakes that may run at the same time."),
            queue_limit: page.gauge("queue_limit", "Bakes that may wait."),
            bakes: page.counters("bakes_total", "Ended bakes, by outcome.", "outcome", &OUTCOMES),
            bakes_refused: page.counter("bakes_refused_total", "Bakes refused because the queue was full."),
            calls_refused: page.counters("calls_refused_total", "Refused calls, by reason.", "reason", &["token"]),
            bakes_shared: page
                .counter("bakes_shared_total", "Requests answered by an existing bake of the same request."),
            bake_seconds: page.histogram("bake_seconds", "Duration of a bake, from start to end.", &SECONDS),
            bodies: page.counter("bodies_total", "Bodies baked; its rate is bodies per second."),
            solves: page.counter("solves_total", "Equilibrium analyses."),
            stage_cpu_milliseconds: page.counters(
                "stage_cpu_milliseconds_total",
                "CPU time of bakes, by stage, ms.",
                "stage",
                &STAGES,
            ),
            bake_peak_memory_bytes: page.histogram("bake_peak_memory_bytes", "Peak memory of a bake.", &BYTES),
            store_bytes: page.gauge("store_bytes", "Size of assets and bakes on disk."),
            store_limit_bytes: page.gauge("store_limit_bytes", "Size beyond which the oldest of these are removed."),
            disk_free_bytes: page.gauge("disk_free_bytes", "Free space on the disk of the data directory."),
            registry: registry.clone(),
        };
        let build = Opts::new("cairn_build_info", "1; its label is the version.");
        page.add(IntGaugeVec::new(build, &["version"])).with_label_values(&[cairn_files::version::VERSION]).set(1);
        metrics
    }

    /// In Prometheus' text format.
    pub fn page(&self) -> prometheus::Result<String> {
        TextEncoder::new().encode_to_string(&self.registry.gather())
    }
}

/// Makes metrics and registers them. Names and labels are constants, so that no fault of theirs can depend on a caller.
struct Page<'a>(&'a Registry);

impl Page<'_> {
    fn add<M: Collector + Clone + 'static>(&self, made: prometheus::Result<M>) -> M {
        let metric = made.expect("the name of a metric is right");
        self.0.register(Box::new(metric.clone())).expect("each metric is registered once");
        metric
    }

    fn gauge(&self, name: &str, help: &str) -> IntGauge {
        self.add(IntGauge::new(format!("cairn_{name}"), help))
    }

    fn counter(&self, name: &str, help: &str) -> IntCounter {
        self.add(IntCounter::new(format!("cairn_{name}"), help))
    }

    /// One counter for each of the known values of a label.
    fn counters(&self, name: &str, help: &str, label: &str, values: &[&str]) -> IntCounterVec {
        let counters = self.add(IntCounterVec::new(Opts::new(format!("cairn_{name}"), help), &[label]));
        values.iter().for_each(|value| drop(counters.with_label_values(&[value])));
        counters
    }

    fn histogram(&self, name: &str, help: &str, buckets: &[f64]) -> Histogram {
        self.add(Histogram::with_opts(HistogramOpts::new(format!("cairn_{name}"), help).buckets(buckets.to_vec())))
    }
}
