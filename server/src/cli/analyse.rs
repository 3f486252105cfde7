//! `cairn analyse`: what holds what in a pile that stands.

use super::allowed::{AllowArgs, check_refused};
use super::bounds::{self, Bounds};
use super::remote::{self, ConnectionArgs};
use super::{Failure, analysis_summary, interrupt, output, print, print_note};
use cairn_analysis::{AnalysisOptions, PileAnalysis};
use cairn_export::analysis::{self, Figure, FoundPile, Selection};
use cairn_files::FileSource;
use cairn_gltf::Document;
use cairn_input::observer::{Observer, Progress};
use cairn_job::{InputFile, machine};
use cairn_render::{RenderModel, Settings, render};
use std::io::Cursor;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

/// Reports what holds what in a pile, and what may be taken away
///
/// Each node of the file is a rigid body, as it stands: of a result of Cairn the bodies of its pile, of any other file
/// the topmost nodes with a mesh. Nothing is simulated: every answer has a proof, forces or a motion, that is put into
/// the equations. For each body: whether it stands, what it carries, what rests on it, how far it is from moving, and
/// whether it may be removed. For the whole: the tilt, the shake and the friction at which it goes, an order in which
/// it comes apart, and where glue is needed if it does not stand.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn analyse table.glb
  cairn analyse room.glb --scenery Table --scenery 'Wall*' --friction 0.5
  cairn analyse pile.glb --json > pile.json
  cairn analyse pile.glb -o load.glb --picture load.png --show load
  cairn analyse pile.glb --graph pile.svg

Needs no closed meshes, and changes nothing. Glue of a result is left aside.")]
pub struct Args {
    /// The pile: .glb, .gltf, .usdc, .usda or .usdz
    #[arg(value_name = "PILE")]
    pile: PathBuf,

    /// Node that stands still, with all below it; a name that ends in * stands for all that begin so. Repeat it for
    /// more
    #[arg(long, value_name = "NODE")]
    scenery: Vec<String>,

    /// Node that is left out, with all below it; as for --scenery
    #[arg(long, value_name = "NODE")]
    without: Vec<String>,

    /// Coulomb friction coefficient of everything [default: as the pile was baked, or else 0.7]
    #[arg(long, value_name = "NUMBER", value_parser = friction)]
    friction: Option<f64>,

    /// Density of the bodies, kg/m^3 [default: as the pile was baked, or else 1000]
    #[arg(long, value_name = "NUMBER", value_parser = positive)]
    density: Option<f64>,

    /// Height of the ground, m [default: as the pile was baked, or else 0 if the lowest body or scenery stands about
    /// there, or else its lowest point]
    #[arg(long, value_name = "METERS", value_parser = number, allow_negative_numbers = true)]
    #[arg(conflicts_with = "no_ground")]
    ground: Option<f64>,

    /// There is no ground, only scenery
    #[arg(long)]
    no_ground: bool,

    /// Time in the animation, seconds [default: its end]
    #[arg(long, value_name = "SECONDS", value_parser = number)]
    time: Option<f64>,

    /// A body is safe to remove if the others stand with this share of their friction, 0 to 1
    #[arg(long, value_name = "SHARE", value_parser = share)]
    #[arg(default_value_t = AnalysisOptions::default().friction_share)]
    safety: f64,

    /// Print all answers as JSON
    #[arg(long)]
    json: bool,

    /// Print only the bodies that carry most, this many
    #[arg(long, value_name = "COUNT", default_value_t = 20)]
    top: usize,

    /// Also write a .glb in which each body has the color of a figure, and all figures as extras
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Also write a picture of that, .png
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,

    /// The figure that colors show
    #[arg(long, value_name = "FIGURE", value_enum, default_value_t = Show::Removal)]
    show: Show,

    /// Also write the graph of contacts: .svg, a picture, or .dot, for Graphviz
    #[arg(long, value_name = "FILE")]
    graph: Option<PathBuf>,

    /// Let a server analyse: HOST:PORT or unix:PATH of a `cairn serve`
    #[arg(long, value_name = "ADDRESS", help_heading = "Server")]
    server: Option<String>,

    #[command(flatten)]
    connection: ConnectionArgs,

    #[command(flatten)]
    allow: AllowArgs,

    #[command(flatten)]
    bounds: Bounds,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Show {
    /// What each carries: dark blue nothing, yellow the most
    Load,
    /// The least push that moves it while its neighbors are held: red none, green half its weight or more
    Margin,
    /// Green safe to remove, red not, yellow neither proven, orange falls as it is
    Removal,
    /// Green stands, red falls, orange falls together with others
    Standing,
}

impl From<Show> for Figure {
    fn from(show: Show) -> Figure {
        match show {
            Show::Load => Figure::Load,
            Show::Margin => Figure::Margin,
            Show::Removal => Figure::Removal,
            Show::Standing => Figure::Standing,
        }
    }
}

/// Ends an analysis between two programs when the user asks for that.
struct Interruptible;

impl Observer for Interruptible {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        if interrupt::is_requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn cpu_seconds(&mut self) -> f64 {
        machine::cpu_seconds()
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    args.bounds.enforce(|| analyse(args))
}

fn analyse(args: &Args) -> Result<(), Failure> {
    let written = [&args.output, &args.picture, &args.graph];
    for path in written.into_iter().flatten() {
        output::check(path, std::slice::from_ref(&args.pile))?;
    }
    let has = |path: &Option<PathBuf>, extension: &str| {
        path.as_ref().is_none_or(|path| path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension)))
    };
    if !has(&args.output, "glb") {
        return Err(Failure::usage("--output", "not the name of a .glb", "Use the extension .glb."));
    }
    if !has(&args.picture, "png") {
        return Err(Failure::usage("--picture", "not the name of a picture", "Use the extension .png."));
    }
    bounds::use_threads(0)?;
    let disk: Arc<dyn FileSource> = args.allow.disk(&[&args.pile], args.server.is_some())?;
    let file = InputFile::read(&args.pile, &disk).map_err(Failure::input)?;
    let selection = Selection {
        scenery: args.scenery.clone(),
        left_out: args.without.clone(),
        friction: args.friction,
        density: args.density,
        ground: args.ground,
        no_ground: args.no_ground,
        seconds: args.time,
        most_triangles: args.bounds.limits().triangles,
    };
    cairn_job::analysis::with_pile(&file, &selection, |document, pile| {
        check_refused(disk.refused())?;
        show(args, &file, &selection, document, pile)
    })
    .map_err(Failure::input)?
}

/// Analyses the pile of a file, and writes and prints what is found.
fn show(
    args: &Args,
    file: &InputFile,
    selection: &Selection,
    document: &Document,
    pile: &FoundPile,
) -> Result<(), Failure> {
    let options = AnalysisOptions { friction_share: args.safety, ..AnalysisOptions::default() };
    let found: PileAnalysis = match &args.server {
        Some(server) => remote::analyse(&args.connection.at(server)?, file, selection, args.safety, pile.bodies.len())?,
        None => cairn_core::analyse(&pile.scene, &pile.params, &options, &mut Interruptible)?,
    };
    let internal = |error: &dyn std::fmt::Display| Failure::Internal(error.to_string());
    let glb = match args.output.is_some() || args.picture.is_some() {
        true => Some(analysis::colored(document, pile, &found, args.show.into()).map_err(|error| internal(&error))?),
        false => None,
    };
    let mut picture = Cursor::new(Vec::new());
    if let (Some(_), Some(glb)) = (&args.picture, &glb) {
        let model = RenderModel { name: &file.name, bytes: glb, resolve: &*file.resolve };
        let drawn = render(&model, None, &Settings::default())?;
        drawn.write_to(&mut picture, image::ImageFormat::Png).map_err(|error| internal(&error))?;
    }
    {
        let _complete = interrupt::shield();
        let write = |path: &Option<PathBuf>, content: &[u8]| match path {
            Some(path) => output::write(path, content),
            None => Ok(()),
        };
        write(&args.output, glb.as_deref().unwrap_or_default())?;
        write(&args.picture, picture.get_ref())?;
        let is_svg = args.graph.as_ref().and_then(|path| path.extension()).is_some_and(|own| own == "svg");
        let graph = if is_svg { analysis::svg(pile, &found) } else { analysis::dot(pile, &found) };
        write(&args.graph, graph.as_bytes())?;
    }
    pile.notes.iter().for_each(|note| print_note(note));
    match args.json {
        true => print(&format!("{:#}\n", analysis::to_json(pile, &found, &options))),
        false => print(&analysis_summary::text(pile, &found, args.top)),
    }
}

fn number(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|number: &f64| number.is_finite()).ok_or_else(|| "give a number".into())
}

fn positive(text: &str) -> Result<f64, String> {
    number(text).ok().filter(|number| *number > 0.0).ok_or_else(|| "give a number above 0".into())
}

fn friction(text: &str) -> Result<f64, String> {
    number(text).ok().filter(|number| (0.0..=2.0).contains(number)).ok_or_else(|| "give 0 to 2".into())
}

fn share(text: &str) -> Result<f64, String> {
    number(text).ok().filter(|number| (0.0..=1.0).contains(number)).ok_or_else(|| "give 0 to 1".into())
}
