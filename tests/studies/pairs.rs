//! Bakes pairs of props and control meshes drawn from a collection, and judges each: `cargo run --release --package
//! cairn-studies --example pairs -- [--pairs 60] [--seed 1] [--only 0..60] [--out table.md] [--runs FOLDER]`.
//!
//! The collection is a folder with a `MANIFEST.tsv` (name, kind, source, licence, bytes, triangles, watertight, ...):
//! `CAIRN_COLLECTION`, or `../shared/data` beside the workspace. Drawn are its watertight glTF files of the kinds
//! `object` and `control`. A prop is scaled so that about 220 fit into the control mesh, first by volume and then, if
//! fewer than 150 or more than 300 do, by what the fill found. One Markdown row per pair, written as soon as it is
//! known. With `--runs`, what each bake took is kept for the example `fit_estimate`; with `--strengths 0.5,2,8,32`,
//! what glue of these strengths and none keep of the shape, too.

mod collection;

use anyhow::{Context, anyhow, bail};
use cairn::cost::{Ledger, Record};
use cairn_core::cache::NoCache;
use cairn_core::calibrate::calibrate;
use cairn_core::free_pour::free_pour;
use cairn_core::report::bake::Bake;
use cairn_engine::shape;
use cairn_geometry::mesh::TriMesh;
use cairn_input::observer::{Observer, Progress, Stage};
use cairn_input::params::{Accuracy, Glue, GlueMode, Params};
use cairn_input::scene::{Prop, Scene};
use cairn_job::machine;
use cairn_prepare::check;
use cairn_prepare::effects::EffectName;
use clap::Parser;
use cpu_time::ProcessTime;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::ops::{ControlFlow, Range};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

const WANTED: f64 = 220.0;
const FEWEST: usize = 150;
const MOST: usize = 300;
/// Sizes tried for one pair.
const ATTEMPTS: usize = 8;
/// More bodies than this say no more about the size than that it is too small.
const TRIAL_LIMIT: u32 = 400;
/// Share of the volume that props usually fill.
const PACKING: f64 = 0.42;
/// The fill must reach this share of a free pour.
const LEAST_RATIO: f64 = 0.8;
/// In units of sqrt(g d).
const REST_SPEED: f64 = 0.01;

const HEADER: &str = "| # | prop | control | bodies | shape | deviation | fill | free pour | ratio | iou start | \
 kept, natural | kept, glued | freed | moved | dots / touches | anchored | CPU s glue, proof | \
protrusion | penetration max | mean | speed | hanging | unsupported | removed out/overlap/escaped | CPU s \
 shape/fill/release+hold/measure | CPU s expected | verdict |\n\
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|";

/// Bakes pairs of props and control meshes drawn from a collection, and judges each.
#[derive(clap::Parser)]
struct Arguments {
    /// Pairs drawn
    #[arg(long, default_value_t = 60)]
    pairs: usize,
    /// Of the drawing
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Bake these only, such as 10..20
    #[arg(long, value_parser = range)]
    only: Option<Range<usize>>,
    /// File for the table, besides the standard output
    #[arg(long)]
    out: Option<PathBuf>,
    /// Folder for what the bakes took
    #[arg(long)]
    runs: Option<PathBuf>,
    /// Glue that is tried besides, in weights of the prop: the most that a dot carries
    #[arg(long, value_delimiter = ',')]
    strengths: Vec<f64>,
}

fn range(text: &str) -> Result<Range<usize>, String> {
    let numbers = text.split_once("..").and_then(|(from, to)| Some(from.parse().ok()?..to.parse().ok()?));
    numbers.ok_or_else(|| "give a range such as 10..20".into())
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let folder = collection::folder();
    let (props, controls) = watertight(&folder)?;
    let drawn = draw(&props, &controls, arguments.pairs, arguments.seed);
    let mut out = arguments.out.map(File::create).transpose()?;
    let mut runs = arguments.runs.map(|folder| Ledger::open(&folder)).transpose().map_err(|e| anyhow!("{e}"))?;
    let machine = calibrate(machine::cpu_seconds)?;
    let only = arguments.only.unwrap_or(0..usize::MAX);
    let mut print_row = |line: &str| -> anyhow::Result<()> {
        println!("{line}");
        if let Some(file) = &mut out {
            writeln!(file, "{line}")?;
            file.flush()?;
        }
        Ok(())
    };
    print_row(HEADER)?;
    let mut tally = BTreeMap::<&str, usize>::new();
    let mut poured = BTreeMap::<&str, Option<f64>>::new();
    for (i, (prop, control)) in drawn.iter().enumerate().filter(|(i, _)| only.contains(i)) {
        let start = ProcessTime::now();
        let row = catch_unwind(AssertUnwindSafe(|| {
            pair(&folder, (prop, control), machine, &arguments.strengths, &mut poured)
        }))
        .unwrap_or_else(|_| Row::without_figures("fail: panic"));
        if let Some(runs) = &mut runs {
            row.records.into_iter().try_for_each(|record| runs.add(record)).map_err(|e| anyhow!("{e}"))?;
        }
        let kind = row.verdict.split(':').next().unwrap_or_default().to_owned();
        *tally.entry(["pass", "refused", "fail"].into_iter().find(|k| *k == kind).unwrap_or("fail")).or_default() += 1;
        let seconds = start.elapsed().as_secs_f64();
        print_row(&format!("| {i} | {prop} | {control} {}| {} ({seconds:.0} s) |", row.cells, row.verdict))?;
    }
    let count = |kind| tally.get(kind).copied().unwrap_or(0);
    print_row(&format!("\n{} pass, {} refused, {} fail", count("pass"), count("refused"), count("fail")))
}

/// Watertight props and control meshes, by name.
fn watertight(folder: &Path) -> anyhow::Result<(Vec<String>, Vec<String>)> {
    let path = collection::manifest(folder);
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let of = |kind: &str| -> Vec<String> {
        let all = collection::of_kind(&text, kind).into_iter();
        all.filter(|(_, watertight)| *watertight == "yes").map(|(name, _)| name.to_owned()).collect()
    };
    let found = (of("object"), of("control"));
    if found.0.is_empty() || found.1.is_empty() {
        bail!("{}: no watertight props or control meshes", path.display());
    }
    Ok(found)
}

/// Different pairs, by SplitMix64 (Steele et al. 2014).
fn draw<'a>(props: &'a [String], controls: &'a [String], pairs: usize, seed: u64) -> Vec<(&'a str, &'a str)> {
    let mut state = seed;
    let mut random = |n: usize| {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % n as u64) as usize
    };
    let mut drawn = Vec::new();
    while drawn.len() < pairs.min(props.len() * controls.len()) {
        let pair = (props[random(props.len())].as_str(), controls[random(controls.len())].as_str());
        if !drawn.contains(&pair) {
            drawn.push(pair);
        }
    }
    drawn
}

struct Row {
    /// All columns between the control mesh and the verdict, each with its bar in front.
    cells: String,
    verdict: String,
    records: Vec<Record>,
}

impl Row {
    fn without_figures(verdict: &str) -> Row {
        Row { cells: "| ".repeat(23), verdict: verdict.replace(['|', '\n'], " "), records: Vec::new() }
    }

    fn refused(reason: &str) -> Row {
        Row::without_figures(&format!("refused: {reason}"))
    }
}

/// CPU seconds that one bake may take.
const BUDGET: f64 = 400.0;

/// The process's CPU time. Ends a bake when its budget is spent, or when it is clear that the size is wrong.
struct Watch {
    clock: ProcessTime,
    began: f64,
    /// Whether the number of bodies matters.
    counts: bool,
    stage: Option<Stage>,
    bodies: usize,
}

impl Watch {
    fn new() -> Watch {
        Watch { clock: ProcessTime::now(), began: 0.0, counts: false, stage: None, bodies: 0 }
    }

    fn begin(&mut self, counts: bool) {
        *self = Watch { clock: self.clock, began: self.cpu_seconds(), counts, stage: None, bodies: 0 };
    }

    fn is_spent(&mut self) -> bool {
        self.cpu_seconds() - self.began > BUDGET
    }
}

impl Observer for Watch {
    fn progress(&mut self, now: &Progress) -> ControlFlow<()> {
        self.bodies = now.bodies;
        if self.stage != Some(now.stage) {
            self.stage = Some(now.stage);
            eprintln!("{:?}: {} bodies, {:.1} CPU s", now.stage, now.bodies, self.cpu_seconds() - self.began);
        }
        let wrong = match now.stage {
            Stage::Shape | Stage::Glue | Stage::Measure => false,
            Stage::Fill => now.bodies >= TRIAL_LIMIT as usize,
            Stage::Release | Stage::Hold => !(FEWEST..=MOST).contains(&now.bodies),
        };
        if (self.counts && wrong) || self.is_spent() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn cpu_seconds(&mut self) -> f64 {
        self.clock.elapsed().as_secs_f64()
    }
}

/// Bakes one pair at a size that lets about as many bodies fit as wanted.
fn pair<'a>(
    folder: &Path,
    (prop, control): (&'a str, &str),
    machine: f64,
    strengths: &[f64],
    poured: &mut BTreeMap<&'a str, Option<f64>>,
) -> Row {
    let name = prop;
    let (prop_model, control) = match (collection::model(folder, prop), collection::model(folder, control)) {
        (Ok(prop), Ok(control)) => (prop, control),
        (Err(e), _) | (_, Err(e)) => return Row::refused(&e),
    };
    let room = volume(&control.mesh);
    let mut scale = (PACKING * room / WANTED / volume(&prop_model.mesh)).cbrt();
    let prop = Prop { scale: [scale; 2], ..Prop::new(prop_model) };
    let mut scene = Scene { control: Some(control), props: vec![prop], ..Scene::default() };
    let mut params = Params::new(Accuracy::Standard);
    params.fill.max_bodies = TRIAL_LIMIT;
    let natural = Params { glue: Glue { mode: GlueMode::Natural, ..params.glue.clone() }, ..params.clone() };
    let mut watch = Watch::new();
    let mut last = None;
    // Sizes of which too many fit, and too few.
    let (mut small, mut large) = (0.0, f64::INFINITY);
    for _ in 0..ATTEMPTS {
        scene.props[0].scale = [scale; 2];
        eprintln!(
            "{} in {}, scale {scale:.4}",
            scene.props[0].model.name,
            scene.control.as_ref().map_or("", |c| &c.name)
        );
        watch.begin(true);
        let baked = cairn_core::fill_container(&scene, &params, &mut NoCache, &mut watch).and_then(|full| {
            let bake = cairn_core::release_pile(&scene, &natural, &full, &mut watch)?.measured(&mut watch)?;
            watch.begin(false);
            let tacky = strengths.iter().map(|&strength| {
                let glue = Glue { mode: GlueMode::Tacky, strength: Some(strength), ..params.glue.clone() };
                let params = Params { glue, ..params.clone() };
                Ok((strength, cairn_core::release_pile(&scene, &params, &full, &mut watch)?.measured(&mut watch)?))
            });
            let tacky = tacky.collect::<Result<Vec<_>, cairn_core::Error>>()?;
            let glued = cairn_core::release_pile(&scene, &params, &full, &mut watch)?.measured(&mut watch)?;
            Ok((bake, tacky, glued))
        });
        match baked {
            Ok(all) => {
                last = Some(all);
                break;
            }
            Err(cairn_core::Error::Cancelled) if !watch.is_spent() => {
                let side = if watch.bodies > MOST { &mut small } else { &mut large };
                *side = scale;
                let guess = scale * (watch.bodies.max(10) as f64 / WANTED).cbrt();
                scale = if small < guess && guess < large { guess } else { (small * large).sqrt() };
            }
            Err(cairn_core::Error::Cancelled) => {
                return Row::without_figures(&format!("fail: not done within {BUDGET} CPU s"));
            }
            Err(e) => return Row::refused(&e.to_string()),
        }
    }
    watch.begin(false);
    let Some((bake, tacky, glued)) = last else {
        return Row::without_figures("fail: no size lets 150 to 300 fit");
    };
    let reference = *poured.entry(name).or_insert_with(|| reference(&scene, &params, &mut watch));
    let expected =
        cairn_core::estimates(&scene, &params, &[params.clone()], machine).map_or(f64::NAN, |all| all[0].cpu_seconds);
    let mut row = judge(&bake, &glued, reference, expected);
    let key = format!("{name} in {}", scene.control.as_ref().map_or("", |c| &c.name));
    let others = tacky.into_iter().map(|(strength, bake)| (format!("tacky {strength}"), bake.report));
    let all = [("pair".into(), glued.report), ("natural".into(), bake.report)].into_iter().chain(others);
    let all = all.take(if strengths.is_empty() { 1 } else { usize::MAX });
    let record = |(variant, report)| Record::new(key.clone(), variant, (&scene, &params), report).ok();
    row.records = all.filter_map(record).collect();
    row
}

fn volume(mesh: &TriMesh) -> f64 {
    mesh.signed_volume().abs()
}

fn reference(scene: &Scene, params: &Params, watch: &mut Watch) -> Option<f64> {
    let checked = check::run(scene, params).ok()?;
    let shapes = shape::run(scene, params, &checked.sizes, watch).ok()?;
    free_pour(&scene.props[0], &shapes[0], params, watch).ok()?
}

/// What is kept without glue and with it, and what the glue takes.
fn glue_cells(natural: &Bake, glued: &Bake) -> String {
    let figure = |bake: &Bake, name: &str| bake.report.measures.get(name).copied().flatten().unwrap_or(f64::NAN);
    let own = |name: EffectName| {
        let charge = glued.report.bill.iter().find(|charge| charge.name == name);
        charge.and_then(|charge| charge.seconds).unwrap_or(0.0)
    };
    format!(
        "{:.3} | {:.3} | {:.3} | {:.3} | {} / {} | {} | {:.1}, {:.1}",
        figure(natural, "kept_shape"),
        figure(glued, "kept_shape"),
        figure(glued, "kept_shape_freed"),
        figure(glued, "moved_freed"),
        glued.report.counts.get("glue_dots").copied().unwrap_or(0),
        figure(glued, "touches"),
        figure(glued, "anchored"),
        own(EffectName::Glue),
        own(EffectName::GlueProof),
    )
}

fn judge(bake: &Bake, glued: &Bake, reference: Option<f64>, expected: f64) -> Row {
    let report = &bake.report;
    let measure = |name: &str| report.measures.get(name).copied().flatten().unwrap_or(f64::NAN);
    let count = |name: &str| report.counts.get(name).copied().unwrap_or(0);
    let (fill, free) = (measure("fill_fraction"), reference.unwrap_or(f64::NAN));
    let speed = measure("resting_speed_max_rel");
    let shape = &report.shapes[0];
    let seconds: BTreeMap<String, f64> = report.seconds.iter().map(|(s, t)| (format!("{s:?}"), *t)).collect();
    let stage = |name: &str| seconds.get(name).copied().unwrap_or(0.0);
    let cells = format!(
        "| {} | {} {} | {:.3} | {fill:.3} | {free:.3} | {:.2} | {:.3} | {} | {:.3} | {:.2} | {:.4} | {speed:.4} | {} \
         | {:.3} \
         | {}/{}/{} | {:.1}/{:.1}/{:.1}/{:.1} | {expected:.0} ",
        bake.pile.bodies.len(),
        shape.kind,
        shape.parts,
        shape.deviation_rel,
        fill / free,
        measure("shape_iou_start"),
        glue_cells(bake, glued),
        measure("protrusion_rel"),
        measure("penetration_max_rel"),
        measure("penetration_mean_rel"),
        measure("hanging"),
        measure("unsupported_fraction"),
        count("removed_sticking_out"),
        count("removed_overlapping"),
        count("removed_escaped"),
        stage("Shape"),
        stage("Fill"),
        stage("Release") + stage("Hold"),
        stage("Measure"),
    );
    let finite = bake.pile.frames.iter().flatten().all(|p| p.translation.is_finite() && p.rotation.is_finite());
    let faults: Vec<&str> = [
        ("bodies", (FEWEST..=MOST).contains(&bake.pile.bodies.len())),
        ("moving", speed < REST_SPEED),
        ("fill", fill >= LEAST_RATIO * free),
        ("hanging", measure("hanging") == 0.0),
        ("lost", count("bodies_lost") == 0 && finite),
    ]
    .into_iter()
    .filter_map(|(what, fine)| (!fine).then_some(what))
    .collect();
    let verdict = if faults.is_empty() { "pass".into() } else { format!("fail: {}", faults.join(", ")) };
    Row { cells, verdict, records: Vec::new() }
}
