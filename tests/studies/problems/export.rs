//! Problems as other engines take them, and motions as they give them back.

use crate::format::{PeerBody, PeerLaunch, PeerRun, PeerScene, PeerScenery, PeerShape};
use crate::problem::{FPS, GRAVITY, Problem, ours};
use crate::shapes::{peer_body, peer_shape, pose};
use anyhow::ensure;
use cairn_engine::shape::{Shape, Size, Solid, hull_mesh};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{Prop, Scene, StaticModel};
use glam::DVec3;

/// Other engines get what the problem says: boxes, balls and hulls, exactly.
pub fn scene(problem: &Problem, case: usize) -> anyhow::Result<PeerScene> {
    let scene = problem.scene(case);
    let params = Params { ground_friction: scene.props[0].friction, ..Params::new(Accuracy::Standard) };
    let solids = ours::shapes(&scene, &params)?;
    let (mut shapes, mut bodies, mut launched) = (Vec::new(), Vec::new(), Vec::new());
    for (id, given) in scene.bodies.iter().enumerate() {
        let solid = &solids[given.prop];
        let bare = bare(solid, &scene.props[given.prop].model.mesh);
        let mut shape = peer_shape(solid, &bare, given.prop, given.scale)?;
        let heavier = given.mass.map_or(1.0, |mass| mass / shape.mass);
        shape.mass *= heavier;
        shape.inertia = shape.inertia.map(|moment| moment * heavier);
        let same = |s: &PeerShape| s.prop == shape.prop && s.scale == shape.scale && s.mass == shape.mass;
        let index = shapes.iter().position(same).unwrap_or_else(|| {
            shapes.push(shape);
            shapes.len() - 1
        });
        bodies.push(peer_body(&shapes, index, &solid.body_pose(&given.pose, given.scale)));
        if given.moves() {
            launched.push(PeerLaunch {
                body: id,
                velocity: given.velocity.to_array(),
                angular_velocity: given.angular_velocity.to_array(),
            });
        }
    }
    let scenery = scenery(&scene, &params, &mut shapes)?;
    Ok(PeerScene {
        file: Default::default(),
        set: Vec::new(),
        exact: true,
        gravity: GRAVITY,
        friction: friction(&scene)?,
        ground: 0.0,
        frames: problem.frames(),
        fps: FPS,
        shapes,
        bodies,
        launched,
        scenery,
    })
}

/// Volumes that differ by less are of one shape.
const SAME: f64 = 1e-6;

/// The exact shape: a box or a ball, where it is one, or the hull of a convex mesh. Else the convex parts of
/// `standard`, without the skin that Cairn's own engine gives to them.
fn bare(shape: &Shape, mesh: &TriMesh) -> Solid {
    let volume = mesh.signed_volume().abs();
    let is_same = |other: f64| (other / volume - 1.0).abs() < SAME;
    match &shape.bare {
        Solid::Ball { .. } => shape.bare.clone(),
        Solid::Box(b) if is_same(b.volume()) => shape.bare.clone(),
        _ if is_same(hull_mesh(&mesh.points).signed_volume().abs()) => {
            Solid::Convex(vec![mesh.points.iter().map(|&p| p - shape.center).collect()])
        }
        _ => shape.bare.clone(),
    }
}

/// One for all pairs: engines differ in how they make one of two.
fn friction(scene: &Scene) -> anyhow::Result<f64> {
    let first = scene.props[0].friction;
    let others = scene.props.iter().map(|p| p.friction).chain(scene.statics.iter().map(|s| s.friction));
    ensure!(others.into_iter().all(|friction| friction == first), "a problem needs one friction");
    Ok(first)
}

fn scenery(scene: &Scene, params: &Params, shapes: &mut Vec<PeerShape>) -> anyhow::Result<Vec<PeerScenery>> {
    let mut all = Vec::new();
    for (id, model) in scene.statics.iter().enumerate() {
        let prop = Prop::new(model.model.clone());
        let size = Size::of(&prop.model.mesh);
        let shape = Shape::new(&prop, size, &params.physics).map_err(anyhow::Error::msg)?;
        shapes.push(peer_shape(&shape, &bare(&shape, &prop.model.mesh), scene.props.len() + id, 1.0)?);
        let place = peer_body(shapes, shapes.len() - 1, &shape.body_pose(&model.pose_at(0.0), 1.0));
        all.push(PeerScenery { place, velocity: velocity(model).to_array() });
    }
    Ok(all)
}

/// Scenery moves evenly, or stands still.
fn velocity(model: &StaticModel) -> DVec3 {
    match &model.keys[..] {
        [a, .., b] => (b.pose.translation - a.pose.translation) / (b.time - a.time),
        _ => DVec3::ZERO,
    }
}

/// A motion of Cairn as other engines give it.
pub fn run(problem: &Problem, scene: &PeerScene, run: &ours::Run) -> PeerRun {
    let placed = |poses: &Vec<Pose>| -> Vec<PeerBody> {
        scene.bodies.iter().zip(poses).map(|(b, pose)| peer_body(&scene.shapes, b.shape, pose)).collect()
    };
    let frame = |poses: &Vec<Pose>| {
        let seven = |b: PeerBody| {
            let ([x, y, z], [i, j, k, w]) = (b.position, b.rotation);
            [x, y, z, i, j, k, w]
        };
        placed(poses).into_iter().map(seven).collect()
    };
    PeerRun {
        engine: "Cairn".into(),
        settings: String::new(),
        cpu: run.cpu,
        keyframes_cpu: None,
        resisted_steps: None,
        seconds: problem.seconds,
        bodies: run.motion.last().map(placed).unwrap_or_default(),
        motion: run.motion.iter().map(frame).collect(),
    }
}

/// Poses in the props' own axes.
pub fn motion(scene: &PeerScene, run: &PeerRun) -> anyhow::Result<Vec<Vec<Pose>>> {
    ensure!(run.motion.iter().all(|poses| poses.len() == scene.bodies.len()), "another number of bodies");
    let body = |(b, &[x, y, z, i, j, k, w]): (&PeerBody, &[f64; 7])| {
        let placed = PeerBody { shape: b.shape, position: [x, y, z], rotation: [i, j, k, w] };
        pose(&scene.shapes, &placed)
    };
    Ok(run.motion.iter().map(|poses| scene.bodies.iter().zip(poses).map(body).collect()).collect())
}
