//! The cost of accuracy: one scene baked with each preset and with single parameters changed, several seeds each, and a
//! table and a plot of error over CPU time.

mod advice;
pub mod effects;
mod figures;
mod ledger;
mod plot;
mod table;
mod variants;

pub use ledger::{Ledger, Record};
pub use plot::draw;
pub use table::Study;
pub use variants::{StudyVariant, VariantKind, variants, work};

use cairn_files::problem::Problem;
use cairn_geometry::mesh::TriMesh;
use cairn_input::observer::Observer;
use cairn_input::params::Params;
use cairn_job::Job;
use cairn_wire::scene_file::SceneTree;
use glam::DVec3;

/// The variant that shape errors refer to.
pub const REFERENCE: &str = "reference";

/// The scene of a run of this variant and seed, with all measures switched on.
pub fn scene_of(tree: &SceneTree, variant: &StudyVariant, seed: u64) -> Result<SceneTree, Vec<Problem>> {
    let mut tree = tree.clone();
    for assignment in &variant.set {
        tree.set(assignment)?;
    }
    tree.put("seed", seed.into());
    tree.put_in("output", "free_standing", true.into());
    for figures in ["shape", "pictures", "support"] {
        tree.put_in("report", figures, "SWITCH_ON".into());
    }
    Ok(tree)
}

/// Bakes one run. `bodies`: scales the control mesh, if any, down so that about this many bodies fit.
pub fn run(
    job: &Job,
    variant: &StudyVariant,
    key: String,
    bodies: Option<usize>,
    observer: &mut dyn Observer,
) -> Result<Record, cairn_core::Error> {
    let mut scene = job.scene.clone();
    if let Some(bodies) = bodies {
        let expected = cairn_core::plan(&scene, &job.params)?.expected_bodies;
        if let Some(control) = &mut scene.control {
            shrink(&mut control.mesh, &job.params, bodies as f64 / expected as f64);
        }
    }
    let report = cairn_core::bake(&scene, &job.params, observer)?.report;
    Record::new(key, variant.name.clone(), (&scene, &job.params), report)
}

/// Scales a control mesh about the center of its base, to at most this share of its volume.
fn shrink(mesh: &mut TriMesh, params: &Params, share: f64) {
    let (lo, hi) = mesh.bounds();
    let foot = DVec3::new((lo.x + hi.x) / 2.0, params.ground_height.unwrap_or(lo.y), (lo.z + hi.z) / 2.0);
    let scale = libm::cbrt(share.min(1.0));
    for point in &mut mesh.points {
        *point = foot + (*point - foot) * scale;
    }
}
