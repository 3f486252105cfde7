//! Commands as clients of a server. Long: arguments, files and events are common to them.

use super::goal::Outcome;
use super::progress::{ProgressArgs, Reporter};
use super::{Failure, interrupt, output, print_done, print_note, print_warning, summary};
use bytes::Bytes;
use cairn_analysis::PileAnalysis;
use cairn_export::analysis::Selection;
use cairn_export::{Encoded, Format, SIDECAR_FOLDER};
use cairn_files::problem::Problem;
use cairn_gltf::media::media_type;
use cairn_input::observer::Observer;
use cairn_input::params::Accuracy;
use cairn_job::goal::OVERLAP;
use cairn_job::{InputFile, PortableNames, Refused};
use cairn_service::client::{Connection, Downloaded, Target};
use cairn_wire::digest::hex;
use cairn_wire::proto;
use cairn_wire::proto::{
    AnalysePileRequest, Artifact, AssetReference, BakeRequest, BakeSpec, DownloadResultRequest, OutputFormat, Plan,
    Scene, Summary, UsdLayout, bake_event::Kind,
};
use cairn_wire::scene_file::SceneTree;
use cairn_wire::to_proto::{NOTES_FIELD, accuracy_name};
use cairn_wire::{analysis, from_proto};
use prost::Message;
use serde_json::json;
use sha2::{Digest, Sha256};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tonic::{Code, Status};
use tonic_types::StatusExt;

/// The arguments of a connection to a server.
#[derive(clap::Args)]
pub struct ConnectionArgs {
    /// File with the server's token; or set CAIRN_TOKEN to the token
    #[arg(long, value_name = "FILE", env = "CAIRN_TOKEN_FILE", help_heading = "Server")]
    token_file: Option<PathBuf>,

    /// Certificate of the authority that signed the server's certificate, PEM; encrypts the connection
    #[arg(long, value_name = "FILE", env = "CAIRN_TLS_CA", help_heading = "Server")]
    tls_ca: Option<PathBuf>,

    /// Client certificate, PEM, if the server requires one
    #[arg(long, value_name = "FILE", requires = "tls_key", help_heading = "Server")]
    tls_certificate: Option<PathBuf>,

    /// Key of the client certificate, PEM
    #[arg(long, value_name = "FILE", requires = "tls_certificate", help_heading = "Server")]
    tls_key: Option<PathBuf>,

    /// For several servers behind a proxy: calls with the same text reach the same server [default of `bake`: a hash of
    /// the request]
    #[arg(long, value_name = "TEXT", env = "CAIRN_ROUTE", help_heading = "Server")]
    route: Option<String>,
}

impl ConnectionArgs {
    /// The arguments for another process. The token itself is in its environment.
    pub fn to_args(&self) -> Vec<OsString> {
        let files = [
            ("--token-file", &self.token_file),
            ("--tls-ca", &self.tls_ca),
            ("--tls-certificate", &self.tls_certificate),
            ("--tls-key", &self.tls_key),
        ];
        let files = files.into_iter().filter_map(|(flag, path)| Some([flag.into(), path.clone()?.into()])).flatten();
        let route = self.route.iter().flat_map(|route| ["--route".into(), route.into()]);
        files.chain(route).collect()
    }

    /// The target for a server's address.
    pub fn at(&self, address: &str) -> Result<Target, Failure> {
        let read = |path: &Option<PathBuf>| path.as_deref().map(cairn_files::read).transpose();
        let read = || {
            let token = read(&self.token_file)?.map(|text| String::from_utf8_lossy(&text).trim().to_owned());
            Ok(Target {
                address: address.to_owned(),
                token: token.or_else(|| std::env::var("CAIRN_TOKEN").ok()),
                ca: read(&self.tls_ca)?,
                identity: read(&self.tls_certificate)?.zip(read(&self.tls_key)?),
                route: self.route.clone(),
            })
        };
        read().map_err(|problem: Problem| Failure::Usage(vec![problem]))
    }
}

/// A bake on a server.
#[derive(clap::Args)]
pub struct RemoteBake {
    /// Id of the bake, as printed by `cairn bake --server`
    id: String,

    /// HOST:PORT or unix:PATH of a `cairn serve`
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:50151", help_heading = "Server")]
    server: String,

    #[command(flatten)]
    connection: ConnectionArgs,
}

impl RemoteBake {
    pub fn id(&self) -> &str {
        &self.id
    }

    pub fn target(&self) -> Result<Target, Failure> {
        self.connection.at(&self.server)
    }
}

/// Paths of a finished bake's files, and the form of progress.
pub struct Delivery<'a> {
    pub output: Option<&'a Path>,
    /// Of the result and of what the report is about; `None`: as it was made with the bake.
    pub format: Option<Format>,
    pub report: Option<&'a Path>,
    pub progress: &'a ProgressArgs,
}

/// The arguments about a bake's place in a server's list and queue.
#[derive(clap::Args)]
pub struct QueueArgs {
    /// Label of the bake on the server, such as shot=a010; repeat it for several
    #[arg(long = "label", value_name = "KEY=VALUE", value_parser = label, requires = "server", help_heading = "Server")]
    labels: Vec<(String, String)>,

    /// Priority, -100 to 100; higher ones run first, and only operators may use values above 0 [default: 0]
    #[arg(long, requires = "server", allow_negative_numbers = true, help_heading = "Server")]
    #[arg(value_parser = clap::value_parser!(i32).range(-100..=100))]
    priority: Option<i32>,
}

impl QueueArgs {
    /// The arguments for another process.
    pub fn to_args(&self) -> Vec<OsString> {
        let labels = self.labels.iter().map(|(name, value)| format!("--label={name}={value}"));
        let priority = self.priority.map(|priority| format!("--priority={priority}"));
        labels.chain(priority).map(OsString::from).collect()
    }
}

pub fn label(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("it has no `=`; write KEY=VALUE")?;
    Ok((key.to_owned(), value.to_owned()))
}

/// The files of a scene, for a server.
pub struct Files {
    /// The files by their names on the server.
    references: Vec<AssetReference>,
    contents: BTreeMap<String, Bytes>,
    paths: Vec<PathBuf>,
    /// Names of files on the server and in the result.
    names: PortableNames,
}

impl Files {
    /// Reads the scene's files, and the files that they name, each of which is known by its content to be a model, a
    /// buffer or a picture. The server checks the rest. Files outside of the scene's folder: see [`Fence`].
    ///
    /// [`Fence`]: cairn_files::fence::Fence
    pub fn read(tree: &SceneTree) -> Result<Files, Failure> {
        let (scene, folder, source) = (tree.to_message(), tree.folder(), tree.files());
        debug_assert!(source.is_fenced());
        let mut found = BTreeMap::new();
        let mut problems = Vec::new();
        let models = cairn_job::model_files(&scene);
        let parts = cairn_job::usd_parts(&scene);
        let names = PortableNames::new(models.iter().map(PathBuf::as_path), folder);
        for path in models {
            let file = match InputFile::read_parts(&path, &source, parts.get(&path)) {
                Ok(file) => file,
                Err(problem) => {
                    problems.push(problem);
                    continue;
                }
            };
            problems.extend(file.recognise().err());
            let folder = cairn_files::folder_of(&path);
            // Only a bake that uses a missing texture needs it.
            for (relative, bytes) in file.sidecars() {
                let Some(there) = cairn_job::place(folder, &relative) else { continue };
                let there = source.find(&there).unwrap_or(there);
                problems.extend(check_kind(&there, &bytes).err());
                found.insert(names.beside(&file.name, &relative), (there, bytes));
            }
            found.insert(names.of(&file.name), (file.path, file.bytes));
        }
        let refused = source.refused();
        problems.extend(refused.into_iter().filter(|refused| !problems.contains(refused)).collect::<Vec<_>>());
        if !problems.is_empty() {
            return Err(Failure::Input(problems));
        }
        let (mut references, mut contents, mut paths) = (Vec::new(), BTreeMap::new(), Vec::new());
        for (uri, (path, bytes)) in found {
            let sha256 = hex(&Sha256::digest(&bytes));
            references.push(AssetReference { uri, sha256: sha256.clone() });
            contents.insert(sha256, bytes.into());
            paths.push(path);
        }
        Ok(Files { references, contents, paths, names })
    }

    /// The layout of a result in USD in this folder, and the way from there to the scene's.
    pub fn layout(&self, scene: &Scene, folder: &Path) -> (UsdLayout, String) {
        let has_assets = cairn_job::model_files(scene).iter().any(|path| cairn_files::is_usd(&path.to_string_lossy()));
        let way = if has_assets { cairn_files::way(folder, self.names.base()) } else { String::new() };
        // Where both are one folder, the result is that which is made with the bake.
        let way = if way == "./" { String::new() } else { way };
        (scene.usd.clone().unwrap_or_default(), way)
    }

    /// The request to a server.
    pub fn spec(&self, mut scene: Scene) -> BakeSpec {
        cairn_job::rename(&mut scene, |path| self.names.of(path));
        BakeSpec { scene: Some(scene), assets: self.references.clone(), ..Default::default() }
    }

    /// Writes the request into a folder, the message last.
    pub fn write(&self, scene: Scene, folder: &Path) -> Result<(), Failure> {
        std::fs::create_dir_all(folder).map_err(|error| Failure::write(folder, &error))?;
        for (sha256, content) in &self.contents {
            output::write(&folder.join(sha256), content)?;
        }
        output::write(&folder.join("spec"), &self.spec(scene).encode_to_vec())
    }

    pub fn paths(&self) -> Vec<PathBuf> {
        self.paths.clone()
    }
}

/// Endings of the names of glTF's buffers, as they are registered. Nothing in a buffer says what it is.
const BUFFERS: [&str; 3] = ["bin", "glbin", "glbuf"];

/// Checks that a file that a model names is a layer of USD, a picture or a buffer.
fn check_kind(path: &Path, bytes: &[u8]) -> Result<(), Problem> {
    let is_known = cairn_export::is_usd_content(bytes) || media_type(bytes).is_some();
    let extension = path.extension().unwrap_or_default();
    if is_known || BUFFERS.iter().any(|known| extension.eq_ignore_ascii_case(known)) {
        return Ok(());
    }
    let what = "not sent: a model names it as its buffer, but its name is not that of one";
    Err(Problem::at(path, what, "End its name in .bin, and name it so in the model; or export that as one .glb file."))
}

/// `cairn bake --server`. Ctrl-C cancels the bake on the server.
pub fn bake(
    target: &Target,
    scene: Scene,
    files: &Files,
    format: Format,
    queue: &QueueArgs,
    delivery: &Delivery,
) -> Result<Outcome, Failure> {
    let layout = delivery.output.filter(|_| format.is_usd());
    let layout = layout.map(|output| files.layout(&scene, cairn_files::folder_of(output)));
    let is_auto = scene.accuracy() == proto::Accuracy::Auto;
    let mut spec = files.spec(scene);
    // The same request, in any format, reaches the server that has baked it before.
    let route = target.route.clone().unwrap_or_else(|| hex(&Sha256::digest(spec.encode_to_vec())));
    spec.set_format(format.wire());
    let target = &Target { route: Some(route), ..target.clone() };
    let request = BakeRequest {
        spec: Some(spec),
        labels: queue.labels.iter().cloned().collect(),
        priority: queue.priority.unwrap_or(0),
        ..Default::default()
    };
    talk(async {
        let mut server = Connection::open(target).await?;
        server.upload(&files.contents).await?;
        let mut follower = BakeFollower { layout, is_auto, ..BakeFollower::new(delivery) };
        let baked = {
            let mut connection = server.clone();
            // Before it is accepted, the bake has no id by which to cancel it.
            let (is_accepted, has_no_room) = (Cell::new(false), Cell::new(false));
            let bake = connection.bake(request, |event| {
                follower.event(event.kind);
                is_accepted.set(!follower.id.is_empty());
                has_no_room.set(follower.no_room.is_some());
            });
            tokio::select! {
                biased;
                () = when(|| has_no_room.get() || interrupt::is_requested() && is_accepted.get()) => None,
                baked = bake => Some(baked),
            }
        };
        match baked {
            Some(baked) => follower.end(baked, &mut server).await,
            None => {
                server.cancel(&follower.id).await?;
                Err(follower.no_room.unwrap_or(Failure::Cancelled))
            }
        }
    })
}

/// The plan of a scene on a server.
pub fn plan(target: &Target, scene: Scene, files: &Files) -> Result<Plan, Failure> {
    let (spec, contents) = (files.spec(scene), files.contents.clone());
    ask(target, async move |mut server| {
        server.upload(&contents).await?;
        Ok(server.plan(spec).await?.plan.unwrap_or_default())
    })
}

/// `cairn analyse --server`: the answers about a pile of so many bodies, whose file was read. Ctrl-C ends the analysis.
pub fn analyse(
    target: &Target,
    file: &InputFile,
    selection: &Selection,
    friction_share: f64,
    bodies: usize,
) -> Result<PileAnalysis, Failure> {
    let names = PortableNames::new([Path::new(&file.name)].into_iter(), cairn_files::folder_of(Path::new(&file.name)));
    let beside = file.read_so_far();
    for (relative, bytes) in &beside {
        check_kind(Path::new(relative), bytes).map_err(Failure::input)?;
    }
    let beside = beside.into_iter();
    let beside = beside.map(|(relative, bytes)| (names.beside(&file.name, &relative), Bytes::from(bytes)));
    let all = std::iter::once((names.of(&file.name), Bytes::copy_from_slice(&file.bytes))).chain(beside);
    let (mut assets, mut contents) = (Vec::new(), BTreeMap::new());
    for (uri, bytes) in all {
        let sha256 = hex(&Sha256::digest(&bytes));
        assets.push(AssetReference { uri, sha256: sha256.clone() });
        contents.insert(sha256, bytes);
    }
    let request = AnalysePileRequest {
        bake_id: String::new(),
        assets,
        scenery: selection.scenery.clone(),
        without: selection.left_out.clone(),
        friction: selection.friction,
        density: selection.density,
        ground_height: selection.ground,
        no_ground: selection.no_ground,
        time_seconds: selection.seconds,
        friction_share: Some(friction_share),
    };
    let parts = ask(target, async move |mut server| {
        server.upload(&contents).await?;
        server.analyse(request, |_| ()).await
    })?;
    let wrong = || Failure::Internal("the server's answers are not those about this file".into());
    analysis::from_messages(&parts, bodies).ok_or_else(wrong)
}

/// `cairn watch`. Ctrl-C stops only the watching.
pub fn watch(bake: &RemoteBake, delivery: &Delivery) -> Result<(), Failure> {
    let target = bake.target()?;
    talk(async {
        let mut server = Connection::open(&target).await?;
        let mut follower = BakeFollower::new(delivery);
        let watched = tokio::select! {
            watched = server.watch(&bake.id, |event| follower.event(event.kind)) => watched,
            () = when(interrupt::is_requested) => return Err(Failure::Cancelled),
        };
        follower.end(watched, &mut server).await.map(drop)
    })
}

/// `cairn cancel`.
pub fn cancel(bake: &RemoteBake) -> Result<(), Failure> {
    let target = bake.target()?;
    talk(async { Ok(Connection::open(&target).await?.cancel(&bake.id).await?) })
}

/// Asks a server. Ctrl-C ends the asking.
pub fn ask<T>(target: &Target, question: impl AsyncFnOnce(Connection) -> Result<T, Status>) -> Result<T, Failure> {
    talk(async {
        let server = Connection::open(target).await?;
        tokio::select! {
            answer = question(server) => Ok(answer?),
            () = when(interrupt::is_requested) => Err(Failure::Cancelled),
        }
    })
}

fn talk<T>(talk: impl Future<Output = Result<T, Failure>>) -> Result<T, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.map_err(|error| Failure::Internal(error.to_string()))?.block_on(talk)
}

/// Waits until this is so.
async fn when(is_so: impl Fn() -> bool) {
    while !is_so() {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

/// Follows the events of a bake on a server.
struct BakeFollower<'a> {
    delivery: &'a Delivery<'a>,
    reporter: Reporter,
    began: Instant,
    id: String,
    /// The server chooses the preset.
    is_auto: bool,
    /// The preset that the bake has.
    accuracy: Option<Accuracy>,
    summary: Option<Summary>,
    /// Of the result in USD; `None`: as the bake's request has it.
    layout: Option<(UsdLayout, String)>,
    /// The result will have no room here.
    no_room: Option<Failure>,
}

impl<'a> BakeFollower<'a> {
    fn new(delivery: &'a Delivery) -> BakeFollower<'a> {
        let reporter = Reporter::new(delivery.progress.shown());
        let (id, is_auto, accuracy, summary, layout, no_room) = Default::default();
        BakeFollower { delivery, reporter, began: Instant::now(), id, is_auto, accuracy, summary, layout, no_room }
    }

    fn event(&mut self, kind: Option<Kind>) {
        match kind {
            Some(Kind::Accepted(accepted)) => {
                self.id = accepted.bake_id;
                self.accuracy = accepted.effective_scene.and_then(|scene| scene.accuracy().into());
                if let Some(accuracy) = self.accuracy.filter(|_| self.is_auto && !self.delivery.progress.quiet) {
                    print_note(&format!("accuracy {}", accuracy_name(accuracy)));
                }
                let most = accepted.plan.map_or(0, |plan| plan.most_result_bytes.unsigned_abs());
                self.no_room = self.delivery.output.and_then(|output| output::check_room(output, most).err());
                if !self.delivery.progress.quiet {
                    print_done([format!("bake {}", self.id)], || json!({ "bake": self.id }));
                }
            }
            Some(Kind::Progress(progress)) => {
                // Ctrl-C is handled elsewhere.
                let _ = self.reporter.progress(&from_proto::progress(&progress));
            }
            Some(Kind::Summary(summary)) => self.summary = Some(summary),
            Some(Kind::BodyTable(_) | Kind::Frame(_)) | None => {}
        }
    }

    /// A server that is gone may come back, with the bake.
    fn lost(&self, status: Status) -> Failure {
        if status.code() != Code::Unavailable || self.id.is_empty() {
            return status.into();
        }
        let output = self.delivery.output.map(|output| format!(" -o {}", output.display())).unwrap_or_default();
        let remedy = format!("When it is back, `cairn watch {}{output}` goes on with the bake.", self.id);
        Failure::TryAgain(Problem::new("the server", status.message(), remedy))
    }

    /// Downloads the files and prints the summary.
    async fn end(mut self, ended: Result<String, Status>, server: &mut Connection) -> Result<Outcome, Failure> {
        self.reporter.finish(ended.is_ok());
        let id = ended.map_err(|status| self.lost(status))?;
        let Delivery { output, format, report, progress } = *self.delivery;
        // What was made with the bake must be what its events describe.
        let own = server.status(&id).await?.format();
        let is_own = format.is_none_or(|format| own == format.wire()) && self.layout.is_none();
        let described = self.summary.as_ref().filter(|_| is_own);
        let request = |artifact: Artifact, file: &str| DownloadResultRequest {
            bake_id: id.clone(),
            artifact: artifact.into(),
            format: format.map_or(OutputFormat::Unspecified, Format::wire).into(),
            file: file.to_owned(),
            usd: self.layout.as_ref().map(|(usd, _)| usd.clone()),
            asset_folder: self.layout.as_ref().map_or_else(String::new, |(_, way)| way.clone()),
        };
        let report = match report {
            Some(path) => {
                let text = server.download_file(&request(Artifact::Report, "")).await?;
                let text = verified(text, described.map(|summary| &*summary.report_sha256))?.bytes;
                Some((path, String::from_utf8_lossy(&text).into_owned()))
            }
            None => None,
        };
        let mut notes = Vec::new();
        match (output, report) {
            (Some(output), report) => {
                let result = server.download_file(&request(Artifact::Result, "")).await?;
                // An older server gives its own format, whatever is asked.
                if let Some(format) = format.filter(|_| result.first.sha256.is_empty()) {
                    check_format(output, format, own)?;
                }
                let Downloaded { bytes, first } = verified(result, described.map(|summary| &*summary.result_sha256))?;
                let mut sidecars = BTreeMap::new();
                for file in first.files {
                    check_name(&file.name)?;
                    let content = server.download_file(&request(Artifact::Result, &file.name)).await?;
                    let content = verified(content, Some(&file.sha256))?;
                    sidecars.insert(file.name, content.bytes);
                }
                notes = first.notes;
                output::write_result(output, &Encoded { bytes, sidecars, left_out: Vec::new() }, report)?;
            }
            (None, Some((path, text))) => output::write(path, text.as_bytes())?,
            (None, None) => {}
        }
        let seconds = self.began.elapsed().as_secs_f64();
        let accuracy = self.accuracy.unwrap_or(Accuracy::Standard);
        let Some(summary) = self.summary else { return Ok(Outcome { accuracy, overlap: None }) };
        let outcome = Outcome { accuracy, overlap: summary.measures.get(OVERLAP).copied() };
        if progress.quiet {
            return Ok(outcome);
        }
        for warning in summary.warnings.iter().chain(notes.iter().filter(|note| !summary.warnings.contains(note))) {
            print_warning(warning);
        }
        let count = |count: i32| usize::try_from(count).unwrap_or(0);
        let measure = |name: &str| summary.measures.get(name).copied();
        let counted = |name: &str| summary.counts.get(name).map_or(0, |&count| u64::try_from(count).unwrap_or(0));
        let (bodies, frames) = (count(summary.body_count), count(summary.frame_count));
        let name = output.unwrap_or(Path::new("the pile"));
        summary::print(bodies, frames, measure, counted, seconds, name);
        Ok(outcome)
    }
}

/// A downloaded file that is as the server has it, and as it was described before.
fn verified(file: Downloaded, described: Option<&str>) -> Result<Downloaded, Failure> {
    let own = hex(&Sha256::digest(&file.bytes));
    let stated = [&*file.first.sha256].into_iter().filter(|sha256| !sha256.is_empty()).chain(described);
    if stated.into_iter().all(|sha256| own == sha256) {
        return Ok(file);
    }
    let remedy = "Run the command again; if it happens again, check the server's disk and network.";
    Err(Failure::TryAgain(Problem::new("the server", "the result was changed in transfer", remedy)))
}

/// Checks the format that a server gives. `own`: of the bake, if the server states it.
fn check_format(output: &Path, format: Format, own: OutputFormat) -> Result<(), Failure> {
    if own == OutputFormat::Unspecified || own == format.wire() {
        return Ok(());
    }
    let extension = Format::from_wire(own).extension();
    let what = format!("the server is of an earlier version, which gives this bake as .{extension} only");
    Err(Failure::input(Problem::at(output, what, format!("End the name in .{extension}, or update the server."))))
}

/// Checks the name of a file beside a result, which a server gives: a plain name in the folder of such files.
fn check_name(name: &str) -> Result<(), Failure> {
    let is_plain = |name: &str| name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"._-".contains(&byte));
    let file = name.strip_prefix(SIDECAR_FOLDER).and_then(|rest| rest.strip_prefix('/'));
    match file.filter(|file| is_plain(file) && !file.starts_with('.') && !file.is_empty()) {
        Some(_) => Ok(()),
        None => {
            let what = format!("the result names a file by {name:?}, which leads elsewhere");
            Err(Failure::Internal(what))
        }
    }
}

/// Maps a server's refusal to the exit codes of a local bake.
impl From<Status> for Failure {
    fn from(status: Status) -> Failure {
        let details = status.get_error_details();
        let one = |remedy: &str| vec![Problem::new("", status.message(), remedy)];
        match status.code() {
            Code::InvalidArgument => {
                let violations = details.bad_request().map(|request| &request.field_violations[..]).unwrap_or_default();
                if violations.is_empty() {
                    return Failure::Input(one(""));
                }
                let (notes, problems): (Vec<_>, Vec<_>) = violations.iter().partition(|v| v.field == NOTES_FIELD);
                let notes = notes.into_iter().map(|v| v.description.clone()).collect();
                let problems = problems.into_iter().map(|v| Problem::from(v.description.clone())).collect();
                Failure::Refused(Refused { problems, notes })
            }
            Code::Unauthenticated | Code::NotFound | Code::FailedPrecondition | Code::PermissionDenied => {
                Failure::Usage(one(""))
            }
            Code::Cancelled => Failure::Cancelled,
            Code::Internal => Failure::Internal(status.message().into()),
            _ => Failure::TryAgain(Problem::new("the server", status.message(), "Try again.")),
        }
    }
}
