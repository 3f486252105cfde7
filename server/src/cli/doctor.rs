//! `cairn doctor`: checks this machine, and compares a small bake with expected values.

use super::cache_args::CacheArgs;
use super::progress::{Mode, Reporter};
use super::{Failure, interrupt, print};
use anstyle::{AnsiColor, Style};
use cairn_export::Format;
use cairn_files::FileSource;
use cairn_files::problem::Problem;
use cairn_job::machine;
use cairn_job::reuse::BakeCache;
use cairn_job::{FinishedBake, Job};
use cairn_service::sandbox;
use cairn_wire::scene_file::SceneTree;
use cairn_wire::versions::versions;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Memory and disk below which real scenes may fail, bytes: about the need of a bake of a thousand detailed props.
const LITTLE_MEMORY: u64 = 2 << 30;
const LITTLE_DISK: u64 = 1 << 30;

/// The scene of the self-test: sticks in a cylinder.
const CONTROL: (&str, &[u8]) = ("cylinder.glb", include_bytes!("../../../examples/assets/cylinder.glb"));
const PROP: (&str, &[u8]) = ("stick.glb", include_bytes!("../../../examples/assets/stick.glb"));
const SETTINGS: [&str; 3] = ["accuracy=draft", "fill.count=150", "seed=1"];

/// Figures of the self-test on a healthy machine, with tolerance for future versions.
const EXPECTED: [(&str, RangeInclusive<f64>); 3] =
    [("bodies", 120.0..=150.0), ("kept_shape", 0.7..=1.2), ("resting_speed_max_rel", 0.0..=0.2)];

const WRONG: &str = "The simulation behaves differently on this machine than elsewhere.";

/// Checks whether this machine is suitable for baking
///
/// Prints versions, processor, memory and disk, and compares a small bake of about ten seconds with expected figures.
/// Include the output when you report a problem.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn doctor
  cairn doctor --json --skip-bake")]
pub struct Args {
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,

    /// Skip the bake
    #[arg(long)]
    skip_bake: bool,

    #[command(flatten)]
    cache: CacheArgs,
}

/// One line of the diagnosis.
struct Finding {
    name: &'static str,
    value: Value,
    /// The fault and its remedy.
    fault: Option<String>,
}

impl Finding {
    fn new(name: &'static str, value: impl Into<Value>) -> Finding {
        Finding { name, value: value.into(), fault: None }
    }

    fn with_fault(mut self, fault: Option<&str>) -> Finding {
        self.fault = fault.map(str::to_owned);
        self
    }

    fn line(&self) -> String {
        let value = match &self.value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        let (word, color) = if self.fault.is_some() { ("!!", AnsiColor::Yellow) } else { ("ok", AnsiColor::Green) };
        let style = Style::new().fg_color(Some(color.into()));
        let fault = self.fault.as_ref().map(|fault| format!("\n      {fault}")).unwrap_or_default();
        format!("{style}{word}{style:#}  {:<22}{value}{fault}", self.name)
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    let mut findings = machine_findings(&args.cache.open());
    if !args.json {
        findings.iter().for_each(|finding| anstream::println!("{}", finding.line()));
    }
    if !args.skip_bake {
        let tried = self_test(if args.json { Mode::None } else { Mode::Auto })?;
        if !args.json {
            tried.iter().for_each(|finding| anstream::println!("{}", finding.line()));
        }
        findings.extend(tried);
    }
    let wrong = findings.iter().any(|finding| finding.fault.as_deref() == Some(WRONG));
    if args.json {
        let entry = |finding: &Finding| (finding.name.to_owned(), finding.value.clone());
        let faults: Vec<&String> = findings.iter().filter_map(|finding| finding.fault.as_ref()).collect();
        let ok = faults.is_empty();
        let findings: Value = Value::Object(findings.iter().map(entry).collect());
        print(&format!("{:#}\n", json!({ "ok": ok, "findings": findings, "faults": faults })))?;
    }
    if wrong { Err(Failure::Internal("the self-test failed".into())) } else { Ok(()) }
}

fn machine_findings(cache: &BakeCache) -> Vec<Finding> {
    let versions = versions();
    let gib = |bytes: u64| format!("{:.1} GiB free", bytes as f64 / (1u64 << 30) as f64);
    let memory = machine::free_memory();
    let little = "Close other programs, or bake fewer props: large bakes may fail.";
    let mut findings = vec![
        Finding::new("cairn", cairn_files::version::BUILD),
        Finding::new("engines", format!("rapier3d {}, clarabel {}", versions.rapier3d, versions.clarabel)),
        Finding::new("system", format!("{} on {}", std::env::consts::OS, std::env::consts::ARCH)),
        Finding::new("processor", format!("{} threads; {}", rayon::current_num_threads(), features())),
        Finding::new("memory", gib(memory)).with_fault((memory < LITTLE_MEMORY).then_some(little)),
    ];
    let full = "Make room: results are first written beside their final location.";
    for (name, folder) in [("this folder", Path::new(".").to_owned()), ("temporary", std::env::temp_dir())] {
        findings.push(match machine::free_disk(&folder) {
            Some(room) => Finding::new(name, gib(room)).with_fault((room < LITTLE_DISK).then_some(full)),
            None => Finding::new(name, "this system does not report free space"),
        });
    }
    let missing = sandbox::tried();
    let text =
        if missing.is_empty() { "files, connections and programs are shut off".into() } else { missing.join("; ") };
    findings.push(Finding::new("sandbox", text));
    if let Some((folder, all, others)) = cache.found() {
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        let mut text = format!("{:.0} MiB in {}", mib(all), folder.display());
        if others > 0 {
            let _ = write!(text, "; {:.0} MiB of other versions: you may delete the folder", mib(others));
        }
        findings.push(Finding::new("cache", text));
    }
    if tempfile::tempfile_in(".").is_err() {
        let refused = Finding::new("writing", "not possible in this folder");
        findings.push(refused.with_fault(Some("Write results to another folder.")));
    }
    findings
}

fn features() -> String {
    let features = machine::cpu_features();
    if features.is_empty() { "no relevant extensions".into() } else { features.join(", ") }
}

/// Compares the figures of a bake with expected ones, and its result with that of a single thread.
fn self_test(progress: Mode) -> Result<Vec<Finding>, Failure> {
    let FinishedBake { bake, hash, seconds, .. } = self_bake(progress)?;
    let mut findings = vec![Finding::new("bake", format!("{} bodies in {seconds:.1} s", bake.pile.bodies.len()))];
    for (name, expected) in EXPECTED {
        let found = match name {
            "bodies" => Some(bake.pile.bodies.len() as f64),
            name => bake.report.measures.get(name).copied().flatten(),
        };
        let good = found.is_some_and(|found| expected.contains(&found));
        let found = found.map_or("none".to_owned(), |found| format!("{found:.3}"));
        let text = format!("{found} (expected {} to {})", expected.start(), expected.end());
        findings.push(Finding::new(name, text).with_fault((!good).then_some(WRONG)));
    }
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let single = single.map_err(|error| Failure::Internal(error.to_string()))?;
    let same = single.install(|| self_bake(Mode::None))?.hash == hash;
    let text = if same { "the same with one thread" } else { "differs with one thread" };
    findings.push(Finding::new("result", text).with_fault((!same).then_some(WRONG)));
    Ok(findings)
}

fn self_bake(progress: Mode) -> Result<FinishedBake, Failure> {
    let job = Job::read_with(&scene()?, Arc::new(OwnFiles), cairn_input::asset::Limits::default())?;
    let mut reporter = Reporter::new(progress);
    let done = job.run(Format::Csv, "self-test", &mut BakeCache::none(), &mut reporter);
    reporter.finish(done.is_ok());
    Ok(done?)
}

fn scene() -> Result<cairn_wire::proto::Scene, Failure> {
    let mut scene = SceneTree::default();
    for assignment in [format!("control_mesh={}", CONTROL.0), format!("props.0={}", PROP.0)]
        .into_iter()
        .chain(SETTINGS.map(str::to_owned))
    {
        scene.set(&assignment).map_err(Failure::Usage)?;
    }
    Ok(scene.to_message())
}

/// The files that the program holds.
struct OwnFiles;

impl FileSource for OwnFiles {
    fn read(&self, path: &Path) -> Result<Vec<u8>, Problem> {
        let found = [CONTROL, PROP].into_iter().find(|(name, _)| Path::new(name) == path);
        found.map(|(_, bytes)| bytes.to_vec()).ok_or_else(|| Problem::at(path, "no such file", ""))
    }

    fn find(&self, path: &Path) -> Option<PathBuf> {
        Some(path.to_owned())
    }

    fn absence(&self) -> (&'static str, &'static str) {
        ("is not in the program", "")
    }
}
