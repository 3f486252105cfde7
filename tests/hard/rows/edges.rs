//! Where something must just hold, or just give way.

use super::engines::{Engine, FPS, run};
use super::scenes::{at, block, placed, prop};
use super::{Extent, Outcome, all};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::scene::{Keyframe, Model, Scene, StaticModel};
use glam::{DAffine3, DQuat, DVec3};
use std::f64::consts::FRAC_PI_4;

pub fn scenery(name: &str, mesh: TriMesh, friction: f64) -> StaticModel {
    StaticModel { model: Model::new(name, mesh), friction, keys: Vec::new() }
}

pub fn moved(mesh: TriMesh, by: DVec3) -> TriMesh {
    mesh.transformed(&DAffine3::from_translation(by))
}

pub fn edge_hover(engine: Engine, _: Extent) -> Outcome {
    const EDGE: f64 = 0.01;
    const TABLE: f64 = 0.1;
    // The cube's middle is 3 mm in front of the edge, and is pushed beyond it at 2 mm/s.
    let mut scene = placed(prop("cube", block(DVec3::splat(EDGE)), 0.3), [at(-0.003, TABLE + EDGE / 2.0, 0.0)]);
    let table = moved(block(DVec3::new(0.2, TABLE, 0.2)), DVec3::new(-0.1, TABLE / 2.0, 0.0));
    scene.statics.push(scenery("table", table, 0.3));
    let pusher = |x: f64| at(x, TABLE + 0.003, 0.0);
    let from = -0.003 - EDGE / 2.0 - 0.0025;
    let keys = vec![Keyframe { time: 0.5, pose: pusher(from) }, Keyframe { time: 6.5, pose: pusher(from + 0.012) }];
    scene.statics.push(StaticModel { keys, ..scenery("pusher", block(DVec3::new(0.005, 0.004, 0.02)), 0.0) });
    let pushed = scene.statics[1].clone();
    let motion = run(engine, &scene, 7.5);
    let falls = |frame: &usize| motion.place(*frame, 0).y < TABLE + EDGE * 0.4;
    match (0..motion.frames.len()).find(falls) {
        Some(frame) => {
            // Where its middle would be if it had not tipped: half an edge before the pusher.
            let beyond = pushed.pose_at(frame as f64 / FPS).translation.x + 0.0025 + EDGE / 2.0;
            all([(format!("falls {:.2} mm beyond the edge", 1e3 * beyond), beyond.abs() < 0.1 * EDGE)])
        }
        None => all([(format!("hovers {:.1} mm beyond the edge", 1e3 * motion.last()[0].translation.x), false)]),
    }
}

/// The blocks of the overhang.
pub const OVERHANGING: DVec3 = DVec3::new(1.0, 0.2, 0.5);

/// Five blocks that overhang by `factor` times what just stands, the top one first.
pub fn overhanging(factor: f64) -> Scene {
    const BLOCKS: usize = 5;
    let size = OVERHANGING;
    // From the top: each juts out over the one below by L/2i. The lowest stands on a kept one.
    let mut x = 0.0;
    let mut poses = Vec::new();
    for i in 1..=BLOCKS {
        poses.push(at(x, size.y * ((BLOCKS - i + 1) as f64 + 0.5), 0.0));
        x -= factor * size.x / 2.0 / i as f64;
    }
    let mut scene = placed(prop("block", block(size), 0.7), poses);
    scene.statics.push(scenery("base", moved(block(size), DVec3::new(x, size.y / 2.0, 0.0)), 0.7));
    scene
}

pub fn overhang(engine: Engine, _: Extent) -> Outcome {
    let fallen = |factor: f64| {
        let motion = run(engine, &overhanging(factor), 10.0);
        motion.first()[0].translation.y - motion.last()[0].translation.y
    };
    let (inside, outside) = (fallen(0.99), fallen(1.01));
    let high = OVERHANGING.y;
    all([
        // It leans as its contacts give way, but stands.
        (format!("-1 %: the top sinks {:.1} %", 100.0 * inside / high), inside < 0.2 * high),
        (format!("+1 %: {:.0} % of a block", 100.0 * outside / high), outside > high),
    ])
}

/// A low block on a slope of this angle, which climbs toward an azimuth.
pub fn on_slope(friction: f64, angle: f64, azimuth: f64) -> Scene {
    let turn = DQuat::from_rotation_y(azimuth) * DQuat::from_rotation_z(angle);
    let base = DVec3::Y * 60.0;
    let slab = block(DVec3::new(60.0, 1.0, 60.0)).transformed(&DAffine3::from_rotation_translation(turn, base));
    // It is turned against the slope, so that no side of the engine's friction pyramid is aligned with the fall.
    let translation = base + turn * (DVec3::Y * 0.55);
    let pose = Pose { translation, rotation: turn * DQuat::from_rotation_y(azimuth) };
    let mut scene = placed(prop("block", block(DVec3::new(0.4, 0.1, 0.4)), friction), [pose]);
    scene.statics.push(scenery("slope", slab, friction));
    scene
}

/// How far it slides in 4 s, in d.
fn slide(engine: Engine, friction: f64, angle: f64, azimuth: f64) -> f64 {
    let motion = run(engine, &on_slope(friction, angle, azimuth), 4.0);
    motion.drift(FPS as usize / 2, motion.frames.len() - 1) / 0.57
}

pub fn slope(engine: Engine, _: Extent) -> Outcome {
    let part = |mu: f64| {
        let limit = mu.atan();
        let margin = (0.02 * limit).max(0.1f64.to_radians());
        let azimuths = (0..4).map(|k| f64::from(k) * FRAC_PI_4 * 0.7);
        let (mut sticks, mut slips) = (0.0f64, f64::INFINITY);
        for azimuth in azimuths {
            if mu > 0.0 {
                sticks = sticks.max(slide(engine, mu, limit - margin, azimuth));
            }
            slips = slips.min(slide(engine, mu, limit + margin, azimuth));
        }
        let summary = format!("mu {mu}: {sticks:.4} d below, {slips:.3} d above");
        (summary, sticks < 0.01 && slips > 0.02)
    };
    all([0.0, 0.05, 0.7, 1.0, 1.5].map(part))
}
