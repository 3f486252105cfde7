//! What becomes of every control mesh of a collection: filled, repaired and filled, or refused, and why:
//! `CAIRN_COLLECTION=FOLDER cargo study control_meshes -- [--bodies 60]`.
//!
//! The collection is a folder with a `MANIFEST.tsv` (name, kind, source, licence, bytes, triangles, watertight, ...):
//! `CAIRN_COLLECTION`, or `../shared/data` beside the workspace. Taken are all its glTF files of the kind `control`.
//! The prop is a brick, of a size of which about as many fit as wanted. One Markdown row per file.

mod collection;

use cairn_core::{Error, bake};
use cairn_geometry::mesh::TriMesh;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, Params, ReleaseOrder};
use cairn_input::scene::{Model, Prop, Scene};
use clap::Parser;
use glam::DVec3;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

#[derive(Parser)]
struct Args {
    /// Bricks wanted in each.
    #[arg(long, default_value_t = 60.0)]
    bodies: f64,
}

fn main() {
    let args = Args::parse();
    let folder = collection::folder();
    let manifest = collection::manifest(&folder);
    let Ok(text) = std::fs::read_to_string(&manifest) else {
        println!("There is no collection: {} cannot be read. Name its folder in CAIRN_COLLECTION.", manifest.display());
        return;
    };
    println!("| control mesh | watertight | what becomes of it | bodies | fill | in pockets | lost |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let mut tally = BTreeMap::<(bool, &str), usize>::new();
    std::panic::set_hook(Box::new(|_| {}));
    for (name, watertight) in collection::of_kind(&text, "control") {
        let found = catch_unwind(AssertUnwindSafe(|| fate(&folder, name, args.bodies)));
        let fate = found.unwrap_or_else(|_| Fate { kind: "panic", message: String::new(), figures: " | | | ".into() });
        *tally.entry((watertight == "yes", fate.kind)).or_default() += 1;
        let message =
            if fate.message.is_empty() { fate.kind.to_owned() } else { format!("{}: {}", fate.kind, fate.message) };
        println!("| {name} | {watertight} | {} | {} |", message.replace('|', " "), fate.figures);
    }
    println!("\n| watertight | what becomes of it | meshes |\n| --- | --- | --- |");
    for ((watertight, kind), count) in tally {
        println!("| {} | {kind} | {count} |", if watertight { "yes" } else { "no" });
    }
}

struct Fate {
    kind: &'static str,
    message: String,
    figures: String,
}

fn fate(folder: &Path, name: &str, wanted: f64) -> Fate {
    let refused =
        |message: String| Fate { kind: "refused", message: message.replace('\n', "; "), figures: " | | | ".into() };
    let mesh = match collection::model(folder, name) {
        Ok(model) => model.mesh,
        Err(message) => return refused(message),
    };
    // Bricks fill about half of the room. An open mesh has none, but is refused by itself.
    let volume = (mesh.signed_volume().abs() * 0.5 / wanted).max(f64::MIN_POSITIVE);
    let edge = (volume / (1.0 * 0.7 * 0.5)).cbrt();
    let brick = Prop::new(Model::new("brick", block(DVec3::new(1.0, 0.7, 0.5) * edge)));
    let control = Some(Model::new(name, mesh));
    let scene = Scene { control, props: vec![brick], ..Scene::default() };
    let mut params = Params::new(Accuracy::Draft);
    params.fill.max_bodies = (4.0 * wanted) as u32;
    // The fill is what matters here.
    params.release.order = ReleaseOrder::AtOnce;
    params.output.frames = Some(1);
    match bake(&scene, &params, &mut Silent) {
        Ok(bake) => {
            let report = &bake.report;
            let measure = |name: &str| report.measures.get(name).copied().flatten().unwrap_or(f64::NAN);
            let own = |w: &&String| w.starts_with(name) && !w.contains("underside") && !w.contains("filled inside");
            let message: Vec<&str> =
                report.plan.warnings.iter().filter(own).map(|w| w[name.len() + 2..].trim()).collect();
            let kind = match &message[..] {
                [] => "filled",
                all if all.iter().all(|w| w.contains("stays empty")) => "filled in part",
                _ => "repaired and filled",
            };
            let lost = report.counts["bodies_lost"] + report.counts["removed_escaped"];
            let (fill, pockets) = (measure("fill_fraction"), measure("pocket_fraction"));
            let figures = format!("{} | {fill:.2} | {pockets:.2} | {lost}", bake.pile.bodies.len());
            Fate { kind, message: message.join("; "), figures }
        }
        Err(Error::Invalid(problems)) => {
            let message: Vec<String> = problems.iter().map(|p| p.text.replace(&format!("{name}: "), "")).collect();
            refused(message.join("; "))
        }
        Err(other) => Fate { kind: "failed", message: other.to_string(), figures: " | | | ".into() },
    }
}

/// A box of these edges about the origin.
fn block(size: DVec3) -> TriMesh {
    let corner = |i: u32| {
        size / 2.0 * (DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * 2.0 - DVec3::ONE)
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { points: (0..8).map(corner).collect(), triangles }
}
