//! Piles among scenery: `cargo study place -- [--only 0..60] [--seeds 1]
//! [--accuracy draft] [--method insert] [--before] [--props FOLDER] [--out table.md]`.
//!
//! Bakes scenes of bins, poles, slopes, hills, shelves, jars and tables, and judges each by its visible meshes: bodies
//! that cut scenery by more than a tenth of their thickness, bodies lost, the share of the room that is filled and the
//! CPU time, both against the same shape in the void. With `--before`, the fill does not know the scenery. Without
//! `--method` and `--accuracy`, scenes take turns.

mod judge;
mod scenes;

use anyhow::{Context, bail};
use cairn_core::cache::NoCache;
use cairn_core::report::bake::Bake;
use cairn_input::asset::{self, Limits, Source};
use cairn_input::observer::{Observer, Progress};
use cairn_input::params::{Accuracy, FillMethod, Params};
use cairn_input::scene::{Model, Scene};
use clap::Parser;
use cpu_time::ProcessTime;
use std::io::Write;
use std::ops::{ControlFlow, Range};
use std::path::PathBuf;

/// Piles among scenery, judged by their visible meshes
#[derive(clap::Parser)]
struct Arguments {
    /// Bake these scenes only, such as 10..20
    #[arg(long, value_parser = range)]
    only: Option<Range<usize>>,
    /// Seeds for each scene
    #[arg(long, default_value_t = 1)]
    seeds: u64,
    /// One accuracy for all
    #[arg(long)]
    accuracy: Option<String>,
    /// One fill method for all
    #[arg(long)]
    method: Option<String>,
    /// The fill does not know the scenery
    #[arg(long)]
    before: bool,
    /// Take the props from the glTF files of a folder, each scaled to the size of the study's own
    #[arg(long)]
    props: Option<PathBuf>,
    /// File for the page, besides the standard output
    #[arg(long)]
    out: Option<PathBuf>,
}

fn range(text: &str) -> Result<Range<usize>, String> {
    let numbers = text.split_once("..").and_then(|(from, to)| Some(from.parse().ok()?..to.parse().ok()?));
    numbers.ok_or_else(|| "give a range such as 10..20".into())
}

/// Measures CPU time.
struct Clock(ProcessTime);

impl Observer for Clock {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        self.0.elapsed().as_secs_f64()
    }
}

const PAGE: &str = "# Piles among scenery\n\n\
    Written by `cargo study place -- --out tests/studies/place/results.md`, with `--accuracy` and\n\
    `--method` where one of each is asked for. What to conclude: whether bodies cut scenery, judged by their visible \
    meshes;\nhow full the room is; and what scenery costs. *The void* is the same shape without scenery: its container \
    gives way a\nlittle, which walls of scenery do not, so that a small bin or jar holds less. The last line counts \
    what is out of order.\n";
const HEADER: &str = "| # | scene | method, accuracy, seed | bodies | cut / deepest | lost | fill of the room / void | \
 kept / void | IoU | CPU s / void |\n|---|---|---|---|---|---|---|---|---|---|";
const METHODS: [FillMethod; 3] = [FillMethod::Insert, FillMethod::Stack, FillMethod::Pour];
const ACCURACIES: [Accuracy; 4] = [Accuracy::Draft, Accuracy::Preview, Accuracy::Standard, Accuracy::Fine];

fn bake(scene: &Scene, filled: &Scene, params: &Params) -> anyhow::Result<(Bake, f64)> {
    let start = ProcessTime::now();
    let mut clock = Clock(start);
    let full = cairn_core::fill_container(filled, params, &mut NoCache, &mut clock)?;
    let bake = cairn_core::release_pile(scene, params, &full, &mut clock)?.measured(&mut clock)?;
    Ok((bake, start.elapsed().as_secs_f64()))
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let mut cases = scenes::all();
    if let Some(folder) = &arguments.props {
        replace_props(&mut cases, folder)?;
    }
    let accuracy = arguments.accuracy.as_deref().map(|name| {
        let all = [
            ("draft", Accuracy::Draft),
            ("preview", Accuracy::Preview),
            ("standard", Accuracy::Standard),
            ("fine", Accuracy::Fine),
        ];
        all.into_iter().find(|(known, _)| *known == name).map(|(_, accuracy)| accuracy).context("no such accuracy")
    });
    let accuracy = accuracy.transpose()?;
    let method = match arguments.method.as_deref() {
        None => None,
        Some("insert") => Some(FillMethod::Insert),
        Some("stack") => Some(FillMethod::Stack),
        Some("pour") => Some(FillMethod::Pour),
        Some(_) => bail!("no such method"),
    };
    let mut file = arguments.out.as_ref().map(std::fs::File::create).transpose()?;
    if let Some(file) = &mut file {
        writeln!(file, "{PAGE}")?;
    }
    let mut write = |line: &str| -> anyhow::Result<()> {
        println!("{line}");
        if let Some(file) = &mut file {
            writeln!(file, "{line}")?;
        }
        Ok(())
    };
    write(HEADER)?;
    let only = arguments.only.clone().unwrap_or(0..cases.len());
    let (mut cut, mut lost, mut poor, mut slow, mut failed, mut all) = (0, 0, 0, 0, 0, 0);
    for (number, case) in cases.iter().enumerate().filter(|(number, _)| only.contains(number)) {
        for seed in 1..=arguments.seeds {
            let turn = number + seed as usize - 1;
            let mut params = Params::new(accuracy.unwrap_or(ACCURACIES[turn % ACCURACIES.len()]));
            params.fill.method = method.unwrap_or(METHODS[turn / ACCURACIES.len() % METHODS.len()]);
            params.seed = seed;
            let void = Scene { statics: Vec::new(), ..case.scene.clone() };
            let what = format!("{:?}, {:?}, {seed}", params.fill.method, params.accuracy).to_lowercase();
            let filled = if arguments.before { &void } else { &case.scene };
            let (with, cpu) = match bake(&case.scene, filled, &params) {
                Ok(done) => done,
                Err(error) => {
                    failed += 1;
                    write(&format!("| {number} | {} | {what} | {error} | | | | | | |", case.name))?;
                    continue;
                }
            };
            let (free, free_cpu) = bake(&void, &void, &params)?;
            let judged = judge::judge(&case.scene, &with);
            let figure =
                |bake: &Bake, name: &str| bake.report.measures.get(name).copied().flatten().unwrap_or(f64::NAN);
            let [fill, void_fill] = [&with, &free].map(|bake| figure(bake, "fill_fraction"));
            let [kept, void_kept] = [&with, &free].map(|bake| figure(bake, "kept_shape"));
            (cut, lost, all) = (cut + judged.cut, lost + judged.lost, all + 1);
            poor += usize::from(fill < 0.9 * void_fill);
            slow += usize::from(cpu > 1.3 * free_cpu);
            write(&format!(
                "| {number} | {} | {what} | {} | {} / {:.2} | {} | {fill:.3} / {void_fill:.3} | \
                 {kept:.3} / {void_kept:.3} | {:.3} | {cpu:.1} / {free_cpu:.1} |",
                case.name,
                with.pile.bodies.len(),
                judged.cut,
                judged.deepest,
                judged.lost,
                figure(&with, "shape_iou_start"),
            ))?;
            for warning in with.report.warnings.iter().filter(|text| {
                text.contains("cut")
                    || text.contains("slope")
                    || text.contains("room")
                    || text.contains("removed")
                    || text.contains("only")
            }) {
                println!("    {warning}");
            }
        }
    }
    write(&format!(
        "\n{all} bakes: {cut} bodies cut scenery, {lost} lost, {poor} fill less than 0.9 of the void, {slow} took over \
         1.3 times the CPU time, {failed} failed"
    ))
}

/// Gives the scenes the props of a folder, in turn, as large as their own.
fn replace_props(cases: &mut [scenes::Case], folder: &std::path::Path) -> anyhow::Result<()> {
    let mut models = Vec::new();
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    for path in files.iter().filter(|path| path.extension().is_some_and(|end| end == "glb")) {
        let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        let bytes = std::fs::read(path)?;
        let none = |_: &str| Err("the study reads single files".to_owned());
        let source = Source { name: &name, bytes: &bytes, node: None, resolve: &none, limits: Limits::default() };
        if let Ok(asset) = asset::read(&source) {
            models.push((name, asset.mesh));
        }
    }
    if models.is_empty() {
        bail!("no model of the folder can be read");
    }
    for (i, case) in cases.iter_mut().enumerate() {
        let (name, mesh) = &models[i % models.len()];
        let size = |mesh: &cairn_geometry::mesh::TriMesh| mesh.bounds().0.distance(mesh.bounds().1);
        let own = &mut case.scene.props[0];
        let mesh = mesh.scaled(size(&own.model.mesh) / size(mesh));
        own.model = Model::new(name.clone(), mesh);
        case.name = format!("{}, as {name}", case.name);
    }
    Ok(())
}
