//! Cairn's own measures of where an engine left a pile.

use crate::format::{PeerBody, PeerScene, PeerShape};
use crate::pile;
use crate::shapes::pose;
use anyhow::{Context, ensure};
use cairn_core::cache::NoCache;
use cairn_engine::world::ContactPair;
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::measure::{Instances, Overlap, Penetration, ShapeMeasurer, kept_shape, penetration};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::FillMethod;
use cairn_input::scene::PlacedBody;
use cairn_job::Job;
use serde::Serialize;

#[derive(Serialize)]
pub struct Figures {
    /// The shape's IoU over the one right after turning over.
    kept_shape: Option<f64>,
    /// The height below which 95 % of the volume lies, over the one right after turning over.
    kept_p95: f64,
    /// How deep touching pairs overlap, over the thickness of the thinner.
    penetration_mean: f64,
    penetration_max: f64,
    /// Bodies that are nowhere any more: they count as far away.
    lost: usize,
}

/// Where a body that is nowhere is taken to be, m: far beyond any pile.
const AWAY: f64 = 1e4;

/// The figures of these bodies, in the order of the scene.
pub fn figures(scene: &PeerScene, end: &[PeerBody]) -> anyhow::Result<Figures> {
    ensure!(end.len() == scene.bodies.len(), "{} bodies of {}", end.len(), scene.bodies.len());
    let mut job = pile::read(&scene.file, &scene.set)?;
    let shapes = pile::shapes(&job)?;
    let is_there = |b: &PeerBody| b.position.iter().chain(&b.rotation).all(|x| x.is_finite() && x.abs() < AWAY);
    let place = |b: &PeerBody| {
        let PeerShape { prop, scale, .. } = scene.shapes[b.shape];
        (prop, scale, shapes[prop].prop_pose(&pose(&scene.shapes, b), scale))
    };
    let before: Vec<_> = scene.bodies.iter().map(place).collect();
    let after: Vec<_> = end.iter().filter(|b| is_there(b)).map(place).collect();
    let control = job.scene.control.clone().context("the scene fills no control mesh")?.mesh;
    let props: Vec<TriMesh> = job.scene.props.iter().map(|p| p.model.mesh.clone()).collect();
    let (region, pile) = (MeshInterior::new(&control), |bodies| Instances { props: &props, bodies });
    let measurer = ShapeMeasurer::new(&control, &region, &pile(&before));
    let (start, now) = (measurer.measure(&pile(&before)), measurer.measure(&pile(&after)));
    let overlaps = overlaps(&mut job, scene.ground, &after)?;
    Ok(Figures {
        kept_shape: kept_shape(&start, &now.shape_iou),
        kept_p95: now.height_p95_rel / start.height_p95_rel,
        penetration_mean: overlaps.mean_rel,
        penetration_max: overlaps.max_rel,
        lost: end.len() - after.len(),
    })
}

/// From the poses alone, by exact geometry, the ground included.
fn overlaps(job: &mut Job, ground: f64, bodies: &[(usize, f64, Pose)]) -> anyhow::Result<Penetration> {
    job.params.fill.method = FillMethod::Off;
    job.params.ground_height = Some(ground);
    job.scene.bodies =
        bodies.iter().map(|&(prop, scale, pose)| PlacedBody { scale, ..PlacedBody::new(prop, pose) }).collect();
    let container = cairn_core::fill_container(&job.scene, &job.params, &mut NoCache, &mut Silent)?;
    let sim = container.turn_over(&job.scene, &job.params)?;
    let world = &sim.pile.world;
    let overlap = |t: &ContactPair| Overlap { depth: t.depth(), thickness: world.pair_thickness(t) };
    Ok(penetration(&world.contact_pairs(REAL_CONTACT).iter().map(overlap).collect::<Vec<_>>()))
}
