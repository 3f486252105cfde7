//! `cairn clutter`: settled layouts of props on trays, in bins, on shelves and tables.

mod card;
mod judge;
mod lines_file;
mod overview;
mod pool;
mod worker;

use super::bounds::{self, Bounds};
use super::cache_args::CacheArgs;
use super::progress::{self, Mode};
use super::{Failure, interrupt, print, print_error, print_note};
use crate::batch::Span;
use cairn_clutter::line::Gates;
use cairn_clutter::{Catalogue, Library, assets, line};
use cairn_files::failpoints;
use cairn_files::problem::Problem;
use cairn_job::reuse::BakeCache;
use lines_file::{LinesFile, Spent};
use overview::ClutterProgress;
use serde_json::Value;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::TempDir;

/// Makes settled layouts of props on trays, in bins, on shelves and tables: lines of JSON
///
/// A catalogue names the props and the places, and says what a layout may have. Each layout rests, stays in its place,
/// and is tried: what moves by more than 2 mm in 2 s is drawn again. Run again, it goes on where it ended.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn clutter examples/clutter/bin.toml -n 1000 -o layouts
  cairn clutter examples/clutter/bin.toml -n 10000 -o layouts --range 2000-2999     (a part of it, for array jobs)
  cairn clutter examples/clutter/bin.toml -n 100 -o layouts --stands any,mujoco

Layout number n is the same, whatever else is made, on any number of processors. The folder gets layouts.jsonl (of a
part, layouts-FIRST-LAST.jsonl), assets.json, README.md and layouts.jpg.")]
pub struct Args {
    /// A catalogue (.toml): props, places, and what a layout may have
    catalogue: PathBuf,

    /// Number of layouts
    #[arg(short = 'n', long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    number: u64,

    /// Folder of the layouts
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,

    /// Make only these layouts, counted from 0, both ends included: 8-15, or 8
    #[arg(long, value_name = "FIRST-LAST")]
    range: Option<Span>,

    /// Number of simultaneous layouts; 0: one per core
    #[arg(long, default_value_t = 0, env = "CAIRN_BATCH_JOBS")]
    jobs: usize,

    /// What each layout must stand in for 2 s: `any`, our own trial as other engines may have it; `mujoco`, by Python's
    /// package; several, separated by commas; or `none`
    #[arg(long, value_name = "GATES", value_delimiter = ',', default_value = "any")]
    stands: Vec<Stands>,

    /// Do not judge which bodies may leave
    #[arg(long)]
    no_removals: bool,

    /// The Python that has the package `mujoco`
    #[arg(long, value_name = "PROGRAM", default_value = "python3", env = "CAIRN_PYTHON")]
    python: PathBuf,

    /// A layout that takes longer is given up, s
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=86_400))]
    timeout: u64,

    /// Number of layouts on the contact sheet; 0: none is made
    #[arg(long, value_name = "COUNT", default_value_t = 24)]
    #[arg(value_parser = clap::value_parser!(u64).range(0..=200))]
    sheet: u64,

    /// Form of the progress on stderr, unless stated otherwise
    #[arg(long, value_enum, default_value_t = Mode::Auto)]
    pub progress: Mode,

    #[command(flatten)]
    cache: CacheArgs,

    #[command(flatten)]
    bounds: Bounds,

    /// Makes the layouts whose numbers come on the standard input, of collision shapes that are in this folder
    #[arg(long, value_name = "FOLDER", hide = true)]
    worker: Option<PathBuf>,
}

/// What a layout must stand in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Stands {
    Any,
    Mujoco,
    None,
}

impl Args {
    fn gates(&self) -> Gates {
        Gates { any: self.stands.contains(&Stands::Any), removals: !self.no_removals }
    }

    /// What else decides a line than its catalogue.
    fn conditions(&self) -> String {
        let mut stands: Vec<&str> = Vec::new();
        for (gate, name) in [(Stands::Any, "any"), (Stands::Mujoco, "mujoco")] {
            stands.extend(self.stands.contains(&gate).then_some(name));
        }
        format!("stands {}{}", stands.join(","), if self.no_removals { ", no removals" } else { "" })
    }

    /// The arguments of a worker. `shapes`: the folder that has its collision shapes.
    fn of_worker(&self, shapes: &Path) -> Vec<OsString> {
        let stands = self.stands.iter().map(|gate| match gate {
            Stands::Any => "any",
            Stands::Mujoco => "mujoco",
            Stands::None => "none",
        });
        let stands = format!("--stands={}", stands.collect::<Vec<_>>().join(","));
        let mut args: Vec<OsString> = vec!["clutter".into(), self.catalogue.clone().into()];
        args.extend(["--worker".into(), shapes.into()]);
        args.extend(["-n".into(), self.number.to_string().into(), "-o".into(), self.output.clone().into()]);
        args.extend([stands.into(), "--python".into(), self.python.clone().into()]);
        args.extend(self.no_removals.then_some("--no-removals".into()));
        args.extend(self.bounds.to_args());
        args
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if let Some(shapes) = &args.worker {
        return worker::run(args, shapes);
    }
    interrupt::listen();
    bounds::use_threads(0)?;
    let (first, last) = part(args)?;
    let shapes = ShapeFolder::open(&args.cache)?;
    let library = read(args, &BakeCache::at(shapes.path()))?;
    library.notes().iter().for_each(|note| print_note(note));
    if args.stands.contains(&Stands::Mujoco) {
        judge::check(&args.python)?;
    }
    prepare_folder(args, &library)?;
    let path = args.output.join(lines_file::name(args.range.map(|_| (first, last))));
    let mut file = LinesFile::open(&path, first).map_err(|error| Failure::write(&path, &error))?;
    let before = file.next() - first;
    if file.next() <= last {
        make(args, &library, shapes.path(), &mut file, last)?;
    }
    if interrupt::is_requested() {
        let count = file.next() - first;
        print_error(&format!("cancelled; {count} layouts stay, and the same command makes the others"));
        return Err(Failure::Reported(interrupt::code()));
    }
    finish(args, &library, &path, &file, before)
}

/// The first and the last layout that are to be made.
fn part(args: &Args) -> Result<(u64, u64), Failure> {
    let Some(Span { first, last }) = args.range else { return Ok((0, args.number - 1)) };
    if first >= args.number {
        let what = format!("there are {} layouts, counted from 0", args.number);
        return Err(Failure::usage(format!("--range {first}-{last}"), what, "Choose some of them."));
    }
    Ok((first, last.min(args.number - 1)))
}

/// The folder in which this process leaves collision shapes for those that make layouts.
enum ShapeFolder {
    Cache(PathBuf),
    /// There is no cache; it goes with this.
    OfThisRun(TempDir),
}

impl ShapeFolder {
    fn open(cache: &CacheArgs) -> Result<ShapeFolder, Failure> {
        if let Some(folder) = cache.open().folder() {
            return Ok(ShapeFolder::Cache(folder.to_owned()));
        }
        let folder = failpoints::at("clutter-shapes").and_then(|()| tempfile::tempdir());
        folder.map(ShapeFolder::OfThisRun).map_err(|error| Failure::write(&std::env::temp_dir(), &error))
    }

    fn path(&self) -> &Path {
        match self {
            ShapeFolder::Cache(path) => path,
            ShapeFolder::OfThisRun(folder) => folder.path(),
        }
    }
}

fn read(args: &Args, shapes: &BakeCache) -> Result<Library, Failure> {
    let catalogue = Catalogue::read(&args.catalogue).map_err(Failure::Input)?;
    let read = || Library::read(catalogue, args.bounds.limits(), shapes);
    progress::while_reading(args.progress, read).map_err(Failure::Refused)
}

/// The file of the props and places, by which a folder is known.
const ASSETS: &str = "assets.json";

/// Makes the folder; refuses one that has layouts of something else.
fn prepare_folder(args: &Args, library: &Library) -> Result<(), Failure> {
    let folder = &args.output;
    failpoints::at("clutter-folder")
        .and_then(|()| std::fs::create_dir_all(folder))
        .map_err(|error| Failure::write(folder, &error))?;
    let path = folder.join(ASSETS);
    let mut value = assets::assets(library);
    value["conditions"] = args.conditions().into();
    if let Ok(bytes) = std::fs::read(&path) {
        let there: Value = serde_json::from_slice(&bytes).unwrap_or_default();
        let is_same = |name: &str| there.get(name) == value.get(name);
        if !(is_same("catalogue") && is_same("conditions")) {
            let what = "the folder has layouts of another catalogue, other models, another version or other gates";
            let remedy = "Choose another folder, or delete this one.";
            return Err(Failure::input(Problem::at(folder, what, remedy)));
        }
        return Ok(());
    }
    let text = format!("{value}\n");
    cairn_files::write_atomically(&path, text.as_bytes()).map_err(|error| Failure::write(&path, &error))
}

fn make(args: &Args, library: &Library, shapes: &Path, file: &mut LinesFile, last: u64) -> Result<(), Failure> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = if args.jobs == 0 { cores } else { args.jobs };
    let mut progress = ClutterProgress::new(args.progress, file.next(), last);
    let task = pool::Task {
        args: args.of_worker(shapes),
        numbers: file.next()..=last,
        workers: jobs,
        timeout: Duration::from_secs(args.timeout),
    };
    let (mut failure, mut spent) = (None, Spent { new_shapes: library.new_shapes, ..Spent::default() });
    pool::work(&task, |number, made| {
        let text = match made {
            Ok(made) => {
                spent.seconds += made.seconds;
                spent.memory = spent.memory.max(made.memory);
                spent.new_shapes += made.new_shapes;
                made.line.get().to_owned()
            }
            Err(why) => serde_json::to_string(&line::lost(library, number, &why)).unwrap_or_default(),
        };
        spent.made += 1;
        progress.end(number, &text);
        match file.write(&text) {
            Ok(()) => true,
            Err(error) => {
                failure = Some(error);
                false
            }
        }
    })
    .map_err(|error| {
        let remedy = "Make sure that this machine has free memory and processes, and run the command again.";
        Failure::TryAgain(Problem::new("--jobs", format!("no process could be started: {error}"), remedy))
    })?;
    progress.finish();
    file.spent = spent;
    match failure {
        Some(error) => Err(Failure::write(file.path(), &error)),
        None => Ok(()),
    }
}

/// Writes the data card and the contact sheet, and prints what was made.
fn finish(args: &Args, library: &Library, path: &Path, file: &LinesFile, before: u64) -> Result<(), Failure> {
    let counts = card::Counts::read(path).map_err(|error| Failure::write(path, &error))?;
    card::write(args, library, path, file, &counts)?;
    print(&counts.summary(&args.output, before))?;
    for (number, why) in &counts.failed {
        print_error(&format!("layout {number}: {why}"));
    }
    if counts.failed.is_empty() { Ok(()) } else { Err(Failure::Reported(interrupt::TRY_AGAIN)) }
}
