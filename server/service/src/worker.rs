//! The worker's side of a bake's process. It reads the folder that the server has made, appends events to the log
//! there, writes the result beside it, and reports to the server by messages on its standard output.

use crate::earlier_pile::EarlierPile;
use crate::event_log::{self, LogWriter};
use crate::folder::{ASSETS, EARLIER_PILE, EVENTS, PILE, REPORT, ResultKind, SPEC, layout_name, write_scene};
use crate::seal::{CHANGED, sealed, unsealed};
use crate::status::DISK_FULL;
use crate::worker_message::{Envelope, Invalid, ResultHead, WorkerMessage};
use bytes::Bytes;
use cairn_core::report::bake::BakedPile;
use cairn_export::{Encoded, ExportError, Format, Measures};
use cairn_files::FileSource;
use cairn_files::problem::{Cause, Problem};
use cairn_input::observer::{Frame, Observer, Progress, Stage};
use cairn_job::machine;
use cairn_job::pace::StagePace;
use cairn_job::reuse::BakeCache;
use cairn_job::{FinishedBake, Job, JobError, Refused};
use cairn_wire::digest::hex;
use cairn_wire::frame_delta::FrameDelta;
use cairn_wire::proto::{self, bake_event::Kind};
use cairn_wire::to_proto;
use prost::Message;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Why a worker could not finish its task.
pub enum WorkerError {
    /// A fault of the scene or the disk, which the server has to know.
    Message(Box<WorkerMessage>),
    /// A fault in Cairn.
    Internal(String),
}

impl From<std::io::Error> for WorkerError {
    fn from(error: std::io::Error) -> WorkerError {
        WorkerError::Message(Box::new(match error.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
                WorkerMessage::NotWritten(DISK_FULL.into())
            }
            ErrorKind::InvalidData => WorkerMessage::Broken(CHANGED.into()),
            _ => WorkerMessage::Broken(cairn_files::plain_reason(&error)),
        }))
    }
}

/// The error of a job whose files were read with these notes.
fn failed(error: JobError, notes: &[String]) -> WorkerError {
    let problems = match error {
        JobError::Bake(cairn_core::Error::Invalid(problems)) => problems.into_iter().map(Problem::from).collect(),
        JobError::Export(ExportError::Source { .. } | ExportError::Pack(_) | ExportError::TooLarge) => {
            vec![Problem::from(error.to_string())]
        }
        _ => return WorkerError::Internal(error.to_string()),
    };
    let mut fields: Vec<_> = problems.iter().map(to_proto::field_problem).collect();
    fields.extend(to_proto::notes(notes));
    invalid_fields(fields, false)
}

pub fn invalid(problems: &[Problem]) -> WorkerError {
    invalid_fields(problems.iter().map(to_proto::field_problem).collect(), false)
}

/// Keeps a readable number of problems: a scene may have 100,000.
pub fn invalid_fields(mut problems: Vec<proto::FieldProblem>, only_missing: bool) -> WorkerError {
    /// More than a status has room for.
    const MOST: usize = 100;
    let more = problems.len() > MOST;
    problems.truncate(MOST);
    if more {
        problems.push(proto::FieldProblem { field: "spec".into(), description: "and more problems".into() });
    }
    WorkerError::Message(Box::new(WorkerMessage::Invalid(Invalid { problems, only_missing })))
}

/// Sends a message to the server. Ends the process if the server is gone.
pub fn send(message: WorkerMessage) {
    let mut stdout = std::io::stdout().lock();
    let sent = event_log::write_message("message-write", &mut stdout, &Envelope { message: Some(message) })
        .and_then(|_| stdout.flush());
    if sent.is_err() {
        std::process::exit(1);
    }
}

/// Ends this process when the server ends, which holds the other end of the standard input and never writes.
pub fn end_with_server() {
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        std::process::exit(1);
    });
}

/// Plans a bake and sends the plan, or all problems of the scene. `with_estimates`: what each accuracy costs on this
/// machine, which takes as long as the bake's first stage.
pub fn plan(folder: &Path, with_estimates: bool) -> Result<(), WorkerError> {
    let (spec, job) = read(folder)?;
    let refused = |error: cairn_core::Error| failed(error.into(), &job.notes);
    let estimates = if with_estimates { job.estimates().map_err(refused)? } else { Vec::new() };
    let plan = cairn_core::plan(&job.scene, &job.params).map_err(refused)?;
    if !with_estimates {
        write_scene(folder, &job.effective)?;
    }
    let most_bytes = job.most_bytes(&plan, Format::from_wire(spec.format()));
    let has_parameters_only = job.effective.encoded_len() > MAX_SCENE;
    send(WorkerMessage::Planned(Box::new(proto::Accepted {
        plan: Some(to_proto::plan(&plan, &job.notes_of_plan(), &estimates, &job.params, most_bytes)),
        effective_scene: Some(if has_parameters_only { to_proto::params(&job.params) } else { job.effective }),
        has_parameters_only,
        ..Default::default()
    })));
    Ok(())
}

/// Largest scene in an event, bytes. It leaves room for the rest of the event.
const MAX_SCENE: usize = 2 << 20;

/// Bakes, and writes the files into the folder.
pub fn bake(folder: &Path, cache: &mut BakeCache) -> Result<(), WorkerError> {
    // Report the start before reading, which may take long.
    let begun =
        Progress { stage: Stage::Shape, fraction: 0.0, bodies: 0, released: 0, at_rest: 0, nails: 0, frames: 0 };
    send(WorkerMessage::Progress(to_proto::progress(&begun, None)));
    let (spec, job) = read(folder)?;
    let kind = ResultKind::of(Format::from_wire(spec.format()));
    let name = kind.result_name();
    let mut watcher = Watcher::new(LogWriter::resume(&folder.join(EVENTS))?);
    let done = job.run(kind.format, &name, cache, &mut watcher);
    if let Some(error) = watcher.failed {
        return Err(error.into());
    }
    let done = done.map_err(|error| failed(error, &job.notes))?;
    let pile = postcard::to_stdvec(&(&done.bake.pile, &done.bake.report.measures))
        .map_err(|error| WorkerError::Internal(error.to_string()))?;
    cairn_files::write_atomically(&folder.join(PILE), &sealed(pile))?;
    write(folder, &kind, &done.result, REPORT, &done.report)?;
    let summary = summary(&done);
    watcher.log.append(Kind::Summary(summary.clone()))?;
    send(WorkerMessage::Logged(watcher.log.sync()?));
    send(WorkerMessage::Done(summary));
    Ok(())
}

/// Makes the result of a finished bake in a further format or layout, with a report of its own.
pub fn export(folder: &Path, format: &str, layout: Option<&str>) -> Result<(), WorkerError> {
    let format = Format::from_extension(format).ok_or_else(|| WorkerError::Internal("no such format".into()))?;
    let kind = ResultKind { format, layout: layout.map(str::to_owned) };
    let (_, mut job) = read(folder)?;
    if let Some(layout) = layout {
        let asked = proto::DownloadResultRequest::decode(Bytes::from(unsealed(std::fs::read(
            folder.join(layout_name(layout)),
        )?)?))
        .map_err(|error| WorkerError::Internal(error.to_string()))?;
        let laid_out = job.laid_out(asked.usd.as_ref()).map_err(|problems| invalid(&problems))?;
        job = laid_out.referred_from(&asked.asset_folder);
    }
    let first = std::fs::read_to_string(folder.join(REPORT))?;
    let (pile, measures) = kept(folder, &first)?;
    let result = job.encode(format, &pile, &measures).map_err(|error| failed(error.into(), &job.notes))?;
    let report = cairn_job::report::of_format(&first, &kind.result_name(), &result, &job.notes).map_err(broken)?;
    let head = write(folder, &kind, &result, &kind.report_name(), &report)?;
    send(WorkerMessage::Exported(head));
    Ok(())
}

/// The pile of a finished bake, and its measures. `report`: the bake's own.
fn kept(folder: &Path, report: &str) -> Result<(BakedPile, Measures), WorkerError> {
    if folder.join(PILE).is_file() {
        let bytes = unsealed(read_file(&folder.join(PILE))?)?;
        return postcard::from_bytes(&bytes).map_err(broken).or_else(|error| {
            let (pile, measures): (EarlierPile, Measures) = postcard::from_bytes(&bytes).map_err(|_| error)?;
            Ok((pile.into(), measures))
        });
    }
    // The parameters that follow the pile there are those of another version.
    let bytes = read_file(&folder.join(EARLIER_PILE))?;
    let (pile, _) = postcard::take_from_bytes::<EarlierPile>(&bytes).map_err(broken)?;
    let report: serde_json::Value = serde_json::from_str(report).map_err(broken)?;
    Ok((pile.into(), serde_json::from_value(report["measures"].clone()).map_err(broken)?))
}

fn broken(error: impl std::fmt::Display) -> WorkerError {
    WorkerError::Message(Box::new(WorkerMessage::Broken(error.to_string())))
}

/// Writes a result, the files beside it, its report, and last what describes them.
fn write(
    folder: &Path,
    kind: &ResultKind,
    result: &Encoded,
    report_name: &str,
    report: &str,
) -> Result<ResultHead, WorkerError> {
    let sha256 = |bytes: &[u8]| hex(&Sha256::digest(bytes));
    let head = |bytes: &[u8]| proto::DownloadResultResponse {
        size_bytes: to_proto::signed(bytes.len()),
        sha256: sha256(bytes),
        ..Default::default()
    };
    let file = |(name, bytes): (&String, &Vec<u8>)| proto::ResultFile {
        name: name.clone(),
        size_bytes: to_proto::signed(bytes.len()),
        sha256: sha256(bytes),
    };
    let head = ResultHead {
        result: proto::DownloadResultResponse {
            files: result.sidecars.iter().map(file).collect(),
            notes: result.left_out.clone(),
            ..head(&result.bytes)
        },
        report: head(report.as_bytes()),
    };
    let path = folder.join(kind.result_name());
    cairn_files::write_atomically(&folder.join(report_name), report.as_bytes())?;
    result.write_sidecars(&path)?;
    cairn_files::write_atomically(&path, &result.bytes)?;
    cairn_files::write_atomically(&folder.join(kind.head_name()), &sealed(head.encode_to_vec()))?;
    Ok(head)
}

fn read(folder: &Path) -> Result<(proto::BakeSpec, Job), WorkerError> {
    let spec = proto::BakeSpec::decode(Bytes::from(unsealed(std::fs::read(folder.join(SPEC))?)?))
        .map_err(|error| WorkerError::Internal(error.to_string()))?;
    let scene = spec.scene.clone().unwrap_or_default();
    let missing: Vec<usize> = (spec.assets.iter().enumerate())
        .filter(|(_, asset)| !folder.join(ASSETS).join(&asset.sha256).is_file())
        .map(|(index, _)| index)
        .collect();
    let uploads = Arc::new(Uploads::of(folder, &spec.assets));
    let Refused { problems, notes } = match Job::read_with(&scene, uploads, cairn_input::asset::Limits::default()) {
        Ok(job) if missing.is_empty() => return Ok((spec, job.referred_from(""))),
        Ok(_) => Refused { problems: Vec::new(), notes: Vec::new() },
        Err(refused) => refused,
    };
    let others = problems.iter().filter(|problem| problem.cause != Cause::NotUploaded);
    let mut wrong: Vec<proto::FieldProblem> = others.map(to_proto::field_problem).collect();
    let only_missing = wrong.is_empty();
    wrong.extend(missing.into_iter().map(|index| proto::FieldProblem {
        field: format!("spec.assets[{index}].sha256"),
        description: format!("{}: {NOT_UPLOADED}. Upload it by UploadAsset.", spec.assets[index].uri),
    }));
    if !only_missing {
        wrong.extend(to_proto::notes(&notes));
    }
    Err(invalid_fields(wrong, only_missing))
}

pub const NOT_UPLOADED: &str = "the asset is not on the server";

/// The files of a request, by their uris, and no other files.
pub struct Uploads(BTreeMap<PathBuf, PathBuf>);

impl Uploads {
    pub fn of(folder: &Path, assets: &[proto::AssetReference]) -> Uploads {
        let folder = folder.join(ASSETS);
        let uri = |asset: &proto::AssetReference| cairn_files::normalized(Path::new(&asset.uri));
        Uploads(assets.iter().map(|asset| (uri(asset), folder.join(&asset.sha256))).collect())
    }
}

impl FileSource for Uploads {
    fn read(&self, path: &Path) -> Result<Vec<u8>, Problem> {
        let name = path.display().to_string();
        let Some(file) = self.0.get(&cairn_files::normalized(path)) else {
            return Err(Problem::new(name, "no asset has this uri", "Add it to spec.assets, with its SHA-256."));
        };
        let bytes = read_file(file).map_err(|error| match error.kind() {
            ErrorKind::NotFound => Problem::new(&name, NOT_UPLOADED, "").of_cause(Cause::NotUploaded),
            _ => Problem::new(&name, format!("cannot be read: {error}"), "Upload it again."),
        })?;
        let is_whole = file.file_name().is_some_and(|stated| stated == hex(&Sha256::digest(&bytes)).as_str());
        if !is_whole {
            let remedy = "Export it again, so that it has another hash, or ask the operator to delete the asset.";
            return Err(Problem::new(name, "the server's copy has changed since it was uploaded", remedy));
        }
        if bytes.is_empty() { Err(Problem::new(name, "the file is empty", "Export it again.")) } else { Ok(bytes) }
    }

    fn find(&self, path: &Path) -> Option<PathBuf> {
        let path = cairn_files::normalized(path);
        if self.0.contains_key(&path) {
            return Some(path);
        }
        cairn_files::only_in_another_case(path.as_os_str(), self.0.keys()).cloned()
    }

    fn absence(&self) -> (&'static str, &'static str) {
        ("was not sent to the server", "Upload it, and add it to the assets of the request.")
    }
}

/// Reads a whole file. Lack of memory ends the process, as everywhere in a bake.
fn read_file(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::with_capacity(file.metadata()?.len() as usize);
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn summary(done: &FinishedBake) -> proto::Summary {
    let report = &done.bake.report;
    proto::Summary {
        body_count: to_proto::signed(report.bodies),
        frame_count: to_proto::signed(done.bake.pile.frames.len()),
        frame_rate: done.bake.pile.fps,
        measures: report.measures.iter().filter_map(|(name, value)| Some((name.to_string(), (*value)?))).collect(),
        counts: report.counts.iter().map(|(name, count)| (name.to_string(), to_proto::signed(*count))).collect(),
        stage_seconds: (report.seconds.iter())
            .map(|(stage, seconds)| (cairn_job::pace::name(*stage).to_owned(), *seconds))
            .collect(),
        warnings: done.notes.iter().chain(&report.warnings).cloned().collect(),
        result_blake3: done.hash.to_hex().to_string(),
        result_bytes: to_proto::signed(done.result.bytes.len()),
        result_sha256: hex(&Sha256::digest(&done.result.bytes)),
        cpu_seconds: machine::cpu_seconds(),
        report_sha256: hex(&Sha256::digest(&done.report)),
        peak_memory_bytes: to_proto::signed(machine::peak_memory().unwrap_or(0)),
    }
}

/// Observes a bake for the server.
struct Watcher {
    log: LogWriter,
    frames: FrameDelta,
    pace: StagePace,
    logged: Instant,
    reported: Option<Instant>,
    /// The log could not be written; the bake has to end.
    failed: Option<std::io::Error>,
}

/// Interval at which readers see new events: shorter than a frame of any display.
const LOG_PAUSE: Duration = Duration::from_millis(20);
/// Interval of progress reports.
const PROGRESS_PAUSE: Duration = Duration::from_millis(100);

impl Watcher {
    fn new(log: LogWriter) -> Watcher {
        Watcher {
            log,
            frames: FrameDelta::default(),
            pace: StagePace::default(),
            logged: Instant::now(),
            reported: None,
            failed: None,
        }
    }

    fn log_so_far(&mut self) {
        match self.log.flush() {
            Ok(extent) => send(WorkerMessage::Logged(extent)),
            Err(error) => self.failed = Some(error),
        }
        self.logged = Instant::now();
    }
}

impl Observer for Watcher {
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()> {
        let began = self.pace.follow(progress);
        let now = Instant::now();
        // The frames of a stage are visible before the next stage is reported.
        if began || now.duration_since(self.logged) >= LOG_PAUSE {
            self.log_so_far();
        }
        if began || self.reported.is_none_or(|last| now.duration_since(last) >= PROGRESS_PAUSE) {
            self.reported = Some(now);
            send(WorkerMessage::Progress(to_proto::progress(progress, self.pace.remaining_seconds(progress))));
        }
        if self.failed.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn cpu_seconds(&mut self) -> f64 {
        machine::cpu_seconds()
    }

    fn wants_frames(&self) -> bool {
        self.failed.is_none()
    }

    fn numbers(&mut self, numbers: &[usize]) {
        self.frames.set_numbers(numbers);
    }

    fn frame(&mut self, frame: &Frame) {
        for kind in self.frames.next(frame) {
            if let Err(error) = self.log.append(kind) {
                self.failed = Some(error);
            }
        }
    }
}
