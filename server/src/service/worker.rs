//! One bake in a process of its own: the child's side. It reads a folder that the server has made, appends events to the
//! log there, writes the result beside it, and tells the server by messages on its standard output how far it is.

use crate::files;
use crate::job::machine;
use crate::job::pace::Pace;
use crate::job::reuse::Cache;
use crate::job::{self, Job, Open, Outcome};
use crate::model::export::{self, ExportError};
use crate::problem::{Cause, Problem};
use crate::scene_file::SceneTree;
use crate::service::event_log::{self, Writer};
use crate::service::folder::{ASSETS, EVENTS, REPORT, SCENE, SPEC, result_name};
use crate::service::news::{Invalid, News, Told};
use crate::service::status::DISK_FULL;
use crate::wire::digest::hex;
use crate::wire::frame_delta::FrameDelta;
use crate::wire::proto::{self, bake_event::Kind};
use crate::wire::to_proto;
use cairn_core::input::observer::{Frame, Observer, Progress, Stage};
use cairn_core::prepare::estimate::Estimate;
use prost::Message;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Why a worker ends without having done its work.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("the scene is at fault")]
    Invalid(Invalid),
    #[error("{0}")]
    NotWritten(String),
    #[error("the data directory: {0}")]
    Broken(String),
    /// Our fault.
    #[error("{0}")]
    Internal(String),
}

impl From<std::io::Error> for Error {
    fn from(error: std::io::Error) -> Error {
        match error.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
                Error::NotWritten(DISK_FULL.into())
            }
            _ => Error::Broken(files::plain_reason(&error)),
        }
    }
}

impl From<job::Error> for Error {
    fn from(error: job::Error) -> Error {
        match error {
            job::Error::Bake(cairn_core::Error::Invalid(problems)) => {
                invalid(problems.into_iter().map(Problem::from).collect())
            }
            job::Error::Export(ExportError::Source { .. } | ExportError::TooLarge) => {
                invalid(vec![Problem::from(error.to_string())])
            }
            _ => Error::Internal(error.to_string()),
        }
    }
}

fn invalid(problems: Vec<Problem>) -> Error {
    told(problems.iter().map(to_proto::field_problem).collect(), false)
}

/// As many problems as a caller can read: a scene may have 100,000.
fn told(mut problems: Vec<proto::FieldProblem>, only_missing: bool) -> Error {
    /// More than a status has room for.
    const MOST: usize = 100;
    let more = problems.len() > MOST;
    problems.truncate(MOST);
    if more {
        problems.push(proto::FieldProblem { field: "spec".into(), description: "and more problems".into() });
    }
    Error::Invalid(Invalid { problems, only_missing })
}

/// Tells the server. One that is gone is no longer interested.
pub fn tell(news: News) {
    let mut stdout = std::io::stdout().lock();
    let told =
        event_log::write_message("news-write", &mut stdout, &Told { news: Some(news) }).and_then(|_| stdout.flush());
    if told.is_err() {
        std::process::exit(1);
    }
}

/// Ends the process when the server does: it holds the other end of the standard input and never writes.
pub fn end_with_server() {
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        std::process::exit(1);
    });
}

/// Tells what a bake would do and cost, or all that is wrong with it.
pub fn plan(folder: &Path) -> Result<(), Error> {
    let (_, job) = read(folder)?;
    let estimates = job.estimates().map_err(job::Error::from)?;
    tell_plan(folder, job, &estimates)
}

/// The same, but for what it costs: that takes as long as the bake's first stage, and tells of the machine.
pub fn accept(folder: &Path) -> Result<(), Error> {
    let (_, job) = read(folder)?;
    tell_plan(folder, job, &[])
}

fn tell_plan(folder: &Path, job: Job, estimates: &[Estimate]) -> Result<(), Error> {
    let plan = cairn_core::plan(&job.scene, &job.params).map_err(job::Error::from)?;
    files::write_atomically(&folder.join(SCENE), SceneTree::from_message(&job.effective).to_json().as_bytes())?;
    let has_parameters_only = job.effective.encoded_len() > MAX_SCENE;
    tell(News::Planned(Box::new(proto::Accepted {
        plan: Some(to_proto::plan(&plan, &job.notes, estimates, &job.params)),
        effective_scene: Some(if has_parameters_only { to_proto::params(&job.params) } else { job.effective }),
        has_parameters_only,
        ..Default::default()
    })));
    Ok(())
}

/// Bytes of a scene in an event: the rest of the event has room beside it.
const MAX_SCENE: usize = 2 << 20;

/// Bakes, and leaves the files in the folder.
pub fn bake(folder: &Path, cache: &mut Cache) -> Result<(), Error> {
    // It waits no longer, even if there is much to read.
    let begun = Progress { stage: Stage::Shape, fraction: 0.0, bodies: 0, released: 0, at_rest: 0, nails: 0 };
    tell(News::Progress(to_proto::progress(&begun, None)));
    let (spec, job) = read(folder)?;
    let name = result_name(spec.format());
    let path = folder.join(name);
    let format = export::check_destination(&path).map_err(job::Error::from)?;
    let mut watcher = Watcher::new(Writer::resume(&folder.join(EVENTS))?);
    let done = job.run(format, name, cache, &mut watcher);
    if let Some(error) = watcher.failed {
        return Err(error.into());
    }
    let done = done?;
    files::write_atomically(&folder.join(REPORT), done.report.as_bytes())?;
    files::write_atomically(&path, &done.result.bytes)?;
    let summary = summary(&done, &job.notes);
    watcher.log.append(Kind::Summary(summary.clone()))?;
    tell(News::Logged(watcher.log.sync()?));
    tell(News::Done(summary));
    Ok(())
}

fn read(folder: &Path) -> Result<(proto::BakeSpec, Job), Error> {
    let spec = proto::BakeSpec::decode(&std::fs::read(folder.join(SPEC))?[..])
        .map_err(|error| Error::Internal(error.to_string()))?;
    let scene = spec.scene.clone().unwrap_or_default();
    let missing: Vec<usize> = (spec.assets.iter().enumerate())
        .filter(|(_, asset)| !folder.join(ASSETS).join(&asset.sha256).is_file())
        .map(|(index, _)| index)
        .collect();
    let problems = match Job::read_with(&scene, open(folder, &spec), cairn_core::asset::Limits::default()) {
        Ok(job) if missing.is_empty() => return Ok((spec, job)),
        Ok(_) => Vec::new(),
        Err(problems) => problems,
    };
    let others = problems.iter().filter(|problem| problem.cause != Cause::NotUploaded);
    let mut wrong: Vec<proto::FieldProblem> = others.map(to_proto::field_problem).collect();
    let only_missing = wrong.is_empty();
    wrong.extend(missing.into_iter().map(|index| proto::FieldProblem {
        field: format!("spec.assets[{index}].sha256"),
        description: format!("{}: {NOT_UPLOADED}. Upload it by UploadAsset.", spec.assets[index].uri),
    }));
    Err(told(wrong, only_missing))
}

const NOT_UPLOADED: &str = "the asset is not on the server";

/// Opens files by the uris of the request, and no others.
fn open(folder: &Path, spec: &proto::BakeSpec) -> Open {
    let folder = folder.join(ASSETS);
    let assets: BTreeMap<PathBuf, PathBuf> =
        spec.assets.iter().map(|asset| (PathBuf::from(&asset.uri), folder.join(&asset.sha256))).collect();
    Arc::new(move |path: &Path| {
        let name = path.display().to_string();
        let Some(file) = assets.get(path) else {
            return Err(Problem::new(name, "no asset has this uri", "Name it, with its content, in spec.assets."));
        };
        let bytes = read_file(file).map_err(|error| match error.kind() {
            ErrorKind::NotFound => Problem::new(&name, NOT_UPLOADED, "").of_cause(Cause::NotUploaded),
            _ => Problem::new(&name, format!("cannot be read: {error}"), "Upload it again."),
        })?;
        if bytes.is_empty() { Err(Problem::new(name, "the file is empty", "Export it again.")) } else { Ok(bytes) }
    })
}

/// The whole file. Memory that there is not ends the process, as it does everywhere else in a bake.
fn read_file(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::with_capacity(file.metadata()?.len() as usize);
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn summary(done: &Outcome, notes: &[String]) -> proto::Summary {
    let report = &done.bake.report;
    proto::Summary {
        body_count: to_proto::signed(report.bodies),
        frame_count: to_proto::signed(done.bake.pile.frames.len()),
        frame_rate: done.bake.pile.fps,
        measures: report.measures.iter().filter_map(|(name, value)| Some((name.to_string(), (*value)?))).collect(),
        counts: report.counts.iter().map(|(name, count)| (name.to_string(), to_proto::signed(*count))).collect(),
        stage_seconds: (report.seconds.iter())
            .map(|(stage, seconds)| (crate::job::pace::name(*stage).to_owned(), *seconds))
            .collect(),
        warnings: notes.iter().chain(&report.warnings).cloned().collect(),
        result_blake3: done.hash.to_hex().to_string(),
        result_bytes: to_proto::signed(done.result.bytes.len()),
        result_sha256: hex(&Sha256::digest(&done.result.bytes)),
        cpu_seconds: machine::cpu_seconds(),
        report_sha256: hex(&Sha256::digest(&done.report)),
        peak_memory_bytes: to_proto::signed(machine::peak_memory().unwrap_or(0)),
    }
}

/// Watches a bake for the server.
struct Watcher {
    log: Writer,
    frames: FrameDelta,
    pace: Pace,
    logged: Instant,
    told: Option<Instant>,
    /// The log could not be written; the bake is to end.
    failed: Option<std::io::Error>,
}

/// Between two looks at the log by its readers: faster than any display.
const LOG_PAUSE: Duration = Duration::from_millis(20);
/// Between two reports of progress.
const PROGRESS_PAUSE: Duration = Duration::from_millis(100);

impl Watcher {
    fn new(log: Writer) -> Watcher {
        Watcher {
            log,
            frames: FrameDelta::default(),
            pace: Pace::default(),
            logged: Instant::now(),
            told: None,
            failed: None,
        }
    }

    fn log_so_far(&mut self) {
        match self.log.flush() {
            Ok(extent) => tell(News::Logged(extent)),
            Err(error) => self.failed = Some(error),
        }
        self.logged = Instant::now();
    }
}

impl Observer for Watcher {
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()> {
        let began = self.pace.follow(progress);
        let now = Instant::now();
        // Whoever hears of a stage has the frames of the one before.
        if began || now.duration_since(self.logged) >= LOG_PAUSE {
            self.log_so_far();
        }
        if began || self.told.is_none_or(|told| now.duration_since(told) >= PROGRESS_PAUSE) {
            self.told = Some(now);
            tell(News::Progress(to_proto::progress(progress, self.pace.remaining_seconds(progress))));
        }
        if self.failed.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn cpu_seconds(&mut self) -> f64 {
        machine::cpu_seconds()
    }

    fn wants_frames(&self) -> bool {
        self.failed.is_none()
    }

    fn frame(&mut self, frame: &Frame) {
        for kind in self.frames.next(frame) {
            if let Err(error) = self.log.append(kind) {
                self.failed = Some(error);
            }
        }
    }
}
