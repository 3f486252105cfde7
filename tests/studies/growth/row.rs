//! One size of a pile, baked and measured. What was measured is kept.

use crate::scenes::{self, Kind};
use anyhow::{Context, ensure};
use cairn_job::machine;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Row {
    pub kind: Kind,
    pub wanted: usize,
    /// What the plan expected of the mesh.
    pub expected: f64,
    pub accuracy: String,
    /// Further assignments.
    pub set: Vec<String>,
    pub date: String,
    pub machine: String,
    pub version: String,
    pub bodies: u64,
    pub frames: u64,
    /// Of the fill, and of release and hold.
    pub steps: [u64; 2],
    /// CPU seconds by stage, of one thread.
    pub seconds: BTreeMap<String, f64>,
    /// In all, and from the beginning to the report.
    pub cpu_seconds: f64,
    /// By threads.
    pub wall_seconds: BTreeMap<usize, f64>,
    /// Of the bake with one thread.
    pub peak_bytes: u64,
    pub output_bytes: u64,
    /// CPU seconds of the add-on to write so many bodies and frames.
    pub blender_seconds: Option<f64>,
}

/// The number of threads of each bake.
const THREADS: [usize; 2] = [1, 2];
/// Larger piles take too long to be baked twice: they have one thread.
const LARGEST_TWICE: usize = 10_000;

pub struct Asked<'a> {
    pub accuracy: &'a str,
    pub set: &'a [String],
    pub cairn: &'a Path,
    /// A Blender, or a Python with its library.
    pub blender: Option<&'a Path>,
    /// Where rows are kept.
    pub kept: &'a Path,
}

impl Asked<'_> {
    /// The row of before, or a new one. `yields`: bodies that come out for each that the plan expects, as a smaller
    /// pile has shown.
    pub fn row(&self, kind: Kind, wanted: usize, yields: f64) -> anyhow::Result<Row> {
        let mut name = format!("{}-{wanted}-{}", kind.name(), self.accuracy);
        for assignment in self.set {
            name += &format!("-{}", assignment.replace(['/', ' '], "_"));
        }
        let folder = self.kept.join(name);
        let file = folder.join("row.json");
        let mut row = match std::fs::read(&file) {
            Ok(bytes) => serde_json::from_slice(&bytes).with_context(|| file.display().to_string())?,
            Err(_) => {
                let row = self.baked(kind, wanted, wanted as f64 / yields, &folder)?;
                std::fs::write(&file, serde_json::to_string_pretty(&row)?)?;
                row
            }
        };
        if let (Some(blender), None) = (self.blender, row.blender_seconds) {
            row.blender_seconds = Some(into_blender(blender, row.bodies, row.frames)?);
            std::fs::write(&file, serde_json::to_string_pretty(&row)?)?;
        }
        Ok(row)
    }

    fn baked(&self, kind: Kind, wanted: usize, expected: f64, folder: &Path) -> anyhow::Result<Row> {
        let scene = scenes::write(kind, expected, self.accuracy, self.set, folder)?;
        let output = folder.join("pile.glb");
        let mut wall_seconds = BTreeMap::new();
        let mut first = None;
        for &threads in THREADS.iter().filter(|&&threads| threads == 1 || wanted <= LARGEST_TWICE) {
            let report = folder.join(format!("{threads}.report.json"));
            // A size may take hours: a bake that was finished is not made again.
            if !report.exists() {
                let mut bake = Command::new(self.cairn);
                bake.arg("bake").arg(&scene).arg("-o").arg(&output).arg("--report").arg(&report);
                bake.args(["--no-cache", "--quiet", "--threads"]).arg(threads.to_string());
                let status = bake.status().with_context(|| self.cairn.display().to_string())?;
                ensure!(status.success(), "{} with {threads} threads: {status}", scene.display());
                if threads == 1 {
                    std::fs::write(folder.join("bytes"), output.metadata()?.len().to_string())?;
                }
                std::fs::remove_file(&output)?;
            }
            let report: Value = serde_json::from_slice(&std::fs::read(report)?)?;
            wall_seconds.insert(threads, report["wall_seconds"].as_f64().context("a wall time")?);
            first.get_or_insert(report);
        }
        let report = first.context("a report")?;
        let count = |name: &str| report["counts"][name].as_u64().with_context(|| format!("no count {name}"));
        Ok(Row {
            kind,
            wanted,
            expected,
            accuracy: self.accuracy.to_owned(),
            set: self.set.to_vec(),
            date: humantime::format_rfc3339_seconds(std::time::SystemTime::now()).to_string()[..10].to_owned(),
            machine: machine::name(),
            version: report["versions"]["cairn"].as_str().unwrap_or_default().to_owned(),
            bodies: report["bodies"].as_u64().context("a number of bodies")?,
            frames: count("frames")?,
            steps: [count("fill_steps")?, count("steps")?],
            seconds: serde_json::from_value(report["seconds"].clone())?,
            cpu_seconds: report["cpu_seconds"].as_f64().context("a CPU time")?,
            wall_seconds,
            peak_bytes: report["peak_memory_bytes"].as_u64().context("a peak of memory")?,
            output_bytes: std::fs::read_to_string(folder.join("bytes"))?.parse()?,
            blender_seconds: None,
        })
    }
}

/// CPU seconds to write a pile of so many bodies and frames into Blender, all of them moving.
fn into_blender(blender: &Path, bodies: u64, frames: u64) -> anyhow::Result<f64> {
    let script = Path::new(env!("CAIRN_REPOSITORY")).join("tests/addon/benchmark.py");
    let mut command = Command::new(blender);
    // A Python with bpy takes the script alone.
    if blender.file_name().is_some_and(|name| name.to_string_lossy().starts_with("blender")) {
        command.args(["--background", "--factory-startup", "--python"]);
    }
    let output = command.arg(script).args(["--", "writing", &bodies.to_string(), &frames.to_string()]).output()?;
    let report = String::from_utf8_lossy(&output.stdout);
    let seconds = report.lines().find_map(|line| line.strip_suffix(" s CPU")?.rsplit(' ').next()?.parse().ok());
    seconds.with_context(|| format!("{report}{}", String::from_utf8_lossy(&output.stderr)))
}
