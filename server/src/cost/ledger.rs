//! The runs of a study, stored as lines of JSON, so that a repeated command continues the study.

use cairn_core::report::Report;
use cairn_files::failpoints;
use cairn_files::problem::Problem;
use cairn_input::params::Params;
use cairn_input::scene::Scene;
use cairn_prepare::estimate::Workload;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// One bake.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Record {
    /// Hash of everything that decides the result: scene, files, version.
    pub key: String,
    pub variant: String,
    pub seed: u64,
    pub bodies: usize,
    /// Solver substeps, over all stages.
    pub substeps: u64,
    /// The inputs of the cost estimate.
    pub workload: Workload,
    /// CPU seconds by stage.
    pub seconds: BTreeMap<String, f64>,
    pub measures: BTreeMap<String, f64>,
}

impl Record {
    /// The record of a finished bake. `of`: its scene and parameters.
    pub fn new(
        key: String,
        variant: String,
        of: (&Scene, &Params),
        report: Report,
    ) -> Result<Record, cairn_core::Error> {
        let figures = report.measures.into_iter().filter_map(|(name, value)| Some((name.into_owned(), value?)));
        let seconds = report.seconds.iter().map(|(&stage, &s)| (cairn_job::pace::name(stage).to_owned(), s)).collect();
        Ok(Record {
            key,
            variant,
            seed: report.seed,
            bodies: report.bodies,
            substeps: report.counts["fill_steps"] * u64::from(of.1.fill_physics(1.0).substeps)
                + report.counts["steps"] * u64::from(of.1.physics.substeps),
            workload: cairn_core::workload(of.0, of.1)?,
            seconds,
            measures: figures.collect(),
        })
    }

    /// CPU seconds of the bake, without its measures.
    pub fn cost(&self) -> f64 {
        self.seconds.iter().filter(|(stage, _)| *stage != "measure").map(|(_, seconds)| seconds).sum()
    }
}

pub struct Ledger {
    path: PathBuf,
    file: File,
    pub records: Vec<Record>,
}

impl Ledger {
    /// Opens or creates the ledger of a folder. Lines that are not records, such as a truncated one, are skipped.
    pub fn open(folder: &Path) -> Result<Ledger, Problem> {
        let path = folder.join("runs.jsonl");
        let failed =
            |e: std::io::Error| Problem::at(&path, format!("cannot be written: {e}"), "Name another folder by -o.");
        failpoints::at("ledger-open").and_then(|()| std::fs::create_dir_all(folder)).map_err(failed)?;
        let text = match std::fs::read_to_string(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(failed(e)),
            read => read.unwrap_or_default(),
        };
        let records = text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        let mut file = OpenOptions::new().create(true).append(true).open(&path).map_err(failed)?;
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n").map_err(failed)?;
        }
        Ok(Ledger { path, file, records })
    }

    pub fn find(&self, key: &str) -> Option<&Record> {
        self.records.iter().find(|record| record.key == key)
    }

    pub fn add(&mut self, record: Record) -> Result<(), Problem> {
        let line = serde_json::to_string(&record).expect("a record has a JSON form") + "\n";
        failpoints::write("ledger-write", &mut self.file, line.as_bytes())
            .and_then(|()| self.file.flush())
            .map_err(|e| Problem::at(&self.path, format!("cannot be written: {e}"), "Make room on the disk."))?;
        self.records.push(record);
        Ok(())
    }
}
