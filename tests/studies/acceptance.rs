//! The acceptance table: sticks in a steep cone, a vertical cylinder and a letter T, glued, with control, without, and
//! without but with everything damped as strongly; medians over seeds.
//!
//!     cargo study acceptance -- --seeds 5

use cairn_core::cache::NoCache;
use cairn_core::report::Report;
use cairn_input::observer::{Observer, Progress};
use cairn_input::params::{Accuracy, ControlMode, GlueMode, Params, Switch};
use cairn_input::scene::{Model, Prop, Scene};
use clap::Parser;
use std::ops::ControlFlow;
use std::path::Path;

#[derive(Parser)]
struct Args {
    /// Seeds 1 to this are baked.
    #[arg(long, default_value_t = 5)]
    seeds: u64,
    /// Control meshes, below examples/assets.
    #[arg(long, value_delimiter = ',', default_value = "cone-small,cylinder,letter-t")]
    shapes: Vec<String>,
    #[arg(long, default_value = "stick")]
    prop: String,
}

/// A column of the table: its heading, the figure's name and its digits.
const COLUMNS: [(&str, &str, usize); 16] = [
    ("touches", "touches", 0),
    ("glued, of touches", "glued_touch_fraction", 3),
    ("fill", "fill_fraction", 3),
    ("IoU at turn-over", "shape_iou_start", 3),
    ("kept shape", "kept_shape", 3),
    ("silhouette", "silhouette_iou", 3),
    ("p95 height before", "height_p95_rel_start", 3),
    ("after", "height_p95_rel", 3),
    ("protrusion", "protrusion_rel", 3),
    ("max penetration", "penetration_max_rel", 3),
    ("mean", "penetration_mean_rel", 4),
    ("rest speed", "resting_speed_max_rel", 4),
    ("hanging", "hanging", 0),
    ("unsupported", "unsupported_fraction", 3),
    ("free-standing", "free_standing_fraction", 2),
    ("analysis / steps", "control_overhead", 2),
];

fn main() -> Result<(), String> {
    let args = Args::parse();
    let headings: Vec<&str> = COLUMNS.iter().map(|c| c.0).collect();
    println!("| shape | control | bodies | {} | CPU s fill | glue, release, hold |", headings.join(" | "));
    println!("|{}", " --- |".repeat(COLUMNS.len() + 5));
    for shape in &args.shapes {
        let scene = scene(shape, &args.prop)?;
        let natural = || {
            let mut params = Params::new(Accuracy::Standard);
            params.glue.mode = GlueMode::Natural;
            params.control.stand = Switch::Off;
            params
        };
        let params = |seed| Params { seed, ..natural() };
        let fill =
            |seed| cairn_core::fill_container(&scene, &params(seed), &mut NoCache, &mut Cpu).map_err(|e| e.to_string());
        let full = (1..=args.seeds).map(fill).collect::<Result<Vec<_>, _>>()?;
        for (name, change) in variants() {
            let mut reports = Vec::new();
            for (seed, full) in (1..).zip(&full) {
                let mut params = params(seed);
                params.output.free_standing = true;
                change(&mut params);
                let bake = cairn_core::release_pile(&scene, &params, full, &mut Cpu)
                    .and_then(|released| released.measured(&mut Cpu));
                reports.push(bake.map_err(|e| e.to_string())?.report);
            }
            let figure = |&(_, key, digits): &(&str, &str, usize)| {
                let value = |r: &Report| r.measures.get(key).copied().flatten().unwrap_or(f64::NAN);
                let value = median(&reports, value);
                if value.is_nan() { "-".into() } else { format!("{value:.digits$}") }
            };
            let figures: Vec<String> = COLUMNS.iter().map(figure).collect();
            let seconds = |names: &[&str]| {
                let spent = |r: &Report| r.seconds.iter().filter(|s| names.contains(&stage(s.0))).map(|s| s.1).sum();
                median(&reports, spent)
            };
            println!(
                "| {shape} | {name} | {:.0} | {} | {:.1} | {:.1} |",
                median(&reports, |r| r.bodies as f64),
                figures.join(" | "),
                seconds(&["fill"]),
                seconds(&["glue", "release", "hold"])
            );
        }
    }
    Ok(())
}

type Change = fn(&mut Params);

/// Glued; with control; without; and without but with every body damped as strongly as the control damps uncertified
/// ones.
fn variants() -> [(&'static str, Change); 4] {
    [
        ("as modelled", |p| p.glue.mode = GlueMode::AsModelled),
        ("hold", |_| {}),
        ("off", |p| p.control.mode = ControlMode::Off),
        ("off, damped", |p| {
            p.control.mode = ControlMode::Off;
            p.release.resistance = p.control.resistance;
        }),
    ]
}

fn stage(stage: &cairn_input::observer::Stage) -> &'static str {
    use cairn_input::observer::Stage;
    match stage {
        Stage::Shape => "shape",
        Stage::Fill => "fill",
        Stage::Glue => "glue",
        Stage::Release => "release",
        Stage::Hold => "hold",
        Stage::Measure => "measure",
    }
}

fn median(reports: &[Report], value: impl Fn(&Report) -> f64) -> f64 {
    let mut values: Vec<f64> = reports.iter().map(value).collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn scene(control: &str, prop: &str) -> Result<Scene, String> {
    let stick = Prop { density: 500.0, ..Prop::new(model(prop)?) };
    Ok(Scene { control: Some(model(control)?), props: vec![stick], ..Scene::default() })
}

fn model(name: &str) -> Result<Model, String> {
    let path = Path::new(env!("CAIRN_REPOSITORY")).join("examples/assets").join(name).with_extension("glb");
    let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let source = cairn_input::asset::Source {
        name,
        bytes: &bytes,
        node: None,
        resolve: &|uri| Err(format!("{uri}: the examples have no external files")),
        limits: Default::default(),
    };
    let asset = cairn_input::asset::read(&source).map_err(|problems| format!("{problems:?}"))?;
    Ok(Model::new(name, asset.mesh))
}

/// Counts CPU time and cancels nothing.
struct Cpu;

impl Observer for Cpu {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        cpu_time::ProcessTime::now().as_duration().as_secs_f64()
    }
}
