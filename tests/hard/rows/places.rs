//! Piles far from the origin, scenery that moves, and links that hang in each other.

use super::engines::{Engine, FPS, baked, params, run};
use super::scenes::{asset, at, block, cone, cylinder, filled, placed, prop, ring};
use super::{Extent, Outcome, all};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::params::{Accuracy, ControlMode, GlueMode, Params};
use cairn_input::scene::{Keyframe, Model, Scene, StaticModel};
use glam::{DAffine3, DQuat, DVec3};
use std::f64::consts::FRAC_PI_2;

/// Scenery that moves along x at this speed from one time to another, m/s and s.
fn moved(mesh: TriMesh, friction: f64, height: f64, speed: f64, times: [f64; 2]) -> StaticModel {
    let key = |time: f64| Keyframe { time, pose: at(speed * (time - times[0]), height, 0.0) };
    StaticModel { model: Model::new("scenery", mesh), friction, keys: times.map(key).to_vec() }
}

/// The same pile at the origin and far from it: all coordinates are exact there, as the single precision of a file is.
pub fn far(engine: Engine, _: Extent) -> Outcome {
    const GRID: f64 = (1 << 20) as f64;
    let settings = Params { control: params(engine, 0.0).control, ..Params::new(Accuracy::Preview) };
    let pile = |offset: DVec3| {
        let mut control = cone(0.7, 1.2);
        control.points.iter_mut().for_each(|p| *p = (*p * GRID).round() / GRID + offset);
        baked(&filled(control, prop("stick", asset("stick.glb"), 0.7)), &settings)
    };
    let here = pile(DVec3::ZERO);
    let d = here.figure("prop_diameter");
    let far = [DVec3::new(1e3, 0.0, 0.0), DVec3::new(2e5, 0.0, 3e5), DVec3::new(0.0, 0.0, -1e6)];
    all(far.map(|offset| {
        let there = pile(offset);
        let pairs = here.last().iter().zip(there.last());
        let apart = pairs.map(|(a, b)| (b.translation - offset).distance(a.translation)).fold(0.0, f64::max);
        let same = here.last().len() == there.last().len();
        (format!("{:.0} km off: {:.5} d apart", offset.length() / 1e3, apart / d), same && apart < 1e-3 * d)
    }))
}

/// A wall of 8 mm that starts at 4 m/s, and three cubes of 20 mm in its way.
pub fn fast_scenery(engine: Engine, _: Extent) -> Outcome {
    let cubes = [0.03, 0.06, 0.09].map(|x| at(x, 0.01, 0.0));
    let mut scene = placed(prop("cube", block(DVec3::splat(0.02)), 0.7), cubes);
    scene.statics = vec![moved(block(DVec3::new(0.008, 0.1, 0.2)), 0.7, 0.05, 4.0, [0.5, 0.6])];
    let motion = run(engine, &scene, 1.5);
    let parts = motion.count("scenery_part_steps");
    let behind = motion.last().iter().filter(|pose| pose.translation.x < 0.41).count();
    let divided = engine == Engine::Plain || parts > 0;
    all([(format!("{behind} of 3 behind the wall"), behind == 0 && divided)])
}

/// Of the conveyor's slab, m/s.
pub const CONVEYOR: f64 = 1.0;

/// A block on a slab that moves from the first frame on: only friction takes it along.
pub fn on_conveyor(friction: f64) -> Scene {
    let mut scene = placed(prop("block", block(DVec3::splat(0.1)), friction), [at(0.0, 0.15, 0.0)]);
    scene.statics = vec![moved(block(DVec3::new(6.0, 0.1, 1.0)), friction, 0.05, CONVEYOR, [0.0, 1.5])];
    scene
}

/// How far the block slides on the slab until it moves along.
pub fn conveyor_slide(friction: f64) -> f64 {
    CONVEYOR * CONVEYOR / (2.0 * friction * 9.81)
}

pub fn conveyor(engine: Engine, _: Extent) -> Outcome {
    all([0.2, 0.7].map(|friction| {
        let motion = run(engine, &on_conveyor(friction), 1.4);
        let frame = motion.frames.len() - 1;
        let slid = CONVEYOR * frame as f64 / FPS - motion.place(frame, 0).x;
        // No step is divided for scenery that is slow.
        let whole = motion.count("scenery_part_steps") == 0;
        let exact = conveyor_slide(friction);
        let far = slid / exact - 1.0;
        (
            format!("friction {friction}: slides {:.0} mm, by theory {:.0}", 1e3 * slid, 1e3 * exact),
            far.abs() < 0.1 && whole,
        )
    }))
}

/// Of the turntable, rad/s, and how long it takes to get there.
const TURNS: f64 = 2.0;
const GETS_THERE: f64 = 1.5;
const FRICTION: f64 = 0.5;
/// Height of what it carries, m.
const TOP: f64 = 0.2;
/// Acceleration toward the axis, as a share of that of friction: all but the last stay. While the turntable speeds up,
/// blocks need a twentieth more than that.
const SHARES: [f64; 4] = [0.3, 0.6, 0.9, 1.1];
/// Where blocks must stay, as a share of their distance from the axis.
const STAYS: f64 = 0.01;

/// Stacks of two blocks on a plate that turns about a vertical axis through its middle; and how far each is from it.
fn on_turntable(seconds: f64) -> (Scene, Vec<f64>) {
    let size = DVec3::new(0.06, 0.03, 0.06);
    let radii = SHARES.map(|share| share * FRICTION * 9.81 / (TURNS * TURNS));
    let place = |k: usize| {
        let turn = DQuat::from_rotation_y(FRAC_PI_2 * (k / 2) as f64);
        let translation = turn * DVec3::X * radii[k / 2] + DVec3::Y * (TOP + size.y * ((k % 2) as f64 + 0.5));
        Pose { translation, rotation: turn }
    };
    let mut scene = placed(prop("block", block(size), FRICTION), (0..2 * SHARES.len()).map(place));
    let reach = 2.0 * radii[SHARES.len() - 1] + 1.0;
    let plate = TriMesh::transformed(
        &block(DVec3::new(reach, 0.1, reach)),
        &DAffine3::from_translation(DVec3::Y * (TOP - 0.05)),
    );
    let turned =
        |time: f64| TURNS * if time < GETS_THERE { time * time / (2.0 * GETS_THERE) } else { time - GETS_THERE / 2.0 };
    let key = |frame: u32| {
        let time = f64::from(frame) / FPS;
        let rotation = DQuat::from_rotation_y(turned(time));
        Keyframe { time, pose: Pose { translation: DVec3::ZERO, rotation } }
    };
    let keys = (0..=(seconds * FPS) as u32).map(key).collect();
    scene.statics = vec![StaticModel { model: Model::new("turntable", plate), friction: FRICTION, keys }];
    (scene, radii.to_vec())
}

/// Friction carries what rides on scenery that turns while w^2 r < mu g.
pub fn turntable(engine: Engine, _: Extent) -> Outcome {
    const SECONDS: f64 = 6.0;
    let (scene, radii) = on_turntable(SECONDS);
    let motion = run(engine, &scene, SECONDS);
    let moved = |k: usize| {
        let place = motion.place(motion.frames.len() - 1, k);
        (place.x.hypot(place.z) / radii[k / 2] - 1.0).abs()
    };
    let of = |share: usize| moved(2 * share).max(moved(2 * share + 1));
    let slides = SHARES.len() - 1;
    let most = (0..slides).map(of).fold(0.0, f64::max);
    let (stay, slide) = (SHARES[slides - 1], SHARES[slides]);
    let (percent, far) = (1e2 * most, 1e2 * of(slides));
    all([(
        format!("up to {stay} of what friction holds: move by {percent:.2} % of their radius; at {slide}: {far:.0} %"),
        most < STAYS && of(slides) > 10.0 * STAYS,
    )])
}

/// Links of the chain; the radius of a link's middle line, and that of its tube.
const LINKS: usize = 8;
const ROUND: f64 = 0.05;
const THICK: f64 = 0.008;
/// How far apart the middles of links are that hang in each other.
pub const TAUT: f64 = 2.0 * (ROUND - THICK);

/// Links in a row from one that is kept, each so far from the one before, as a share of the taut distance; the last is
/// kept, too, or swings down.
pub fn in_a_row(share: f64, is_bridge: bool) -> Scene {
    let pose = |k: usize| Pose {
        translation: DVec3::new(share * TAUT * k as f64, 1.0, 0.0),
        rotation: DQuat::from_rotation_x(if k.is_multiple_of(2) { 0.0 } else { FRAC_PI_2 }),
    };
    let mut scene = placed(prop("link", ring(ROUND, THICK), 0.5), (0..=LINKS).map(pose));
    scene.bodies[0].pinned = true;
    scene.bodies[LINKS].pinned = is_bridge;
    scene
}

/// Each nearly touches the next one. The first is kept.
fn link(k: usize) -> Pose {
    Pose {
        translation: DVec3::Y * (1.0 - 0.99 * TAUT * k as f64),
        rotation: DQuat::from_rotation_y(if k.is_multiple_of(2) { 0.0 } else { FRAC_PI_2 }),
    }
}

/// Links that hang in each other from one that is fixed.
pub fn hanging() -> Scene {
    let mesh = ring(ROUND, THICK);
    let mut scene = placed(prop("link", mesh.clone(), 0.5), (1..=LINKS).map(link));
    let points = mesh.points.iter().map(|&p| link(0).translation + p).collect();
    let hook = Model::new("hook", TriMesh { points, ..mesh });
    scene.statics = vec![StaticModel { model: hook, friction: 0.5, keys: Vec::new() }];
    scene
}

/// The collision shapes are of several convex parts, and those of neighbours must not overlap where the meshes do not.
pub fn chain(engine: Engine, _: Extent) -> Outcome {
    let motion = run(engine, &hanging(), 3.0);
    let seconds = motion.frames.len() - 1;
    let place = |k: usize| if k == 0 { link(0).translation } else { motion.place(seconds, k - 1) };
    let moved = |k: usize| (place(k) - place(k - 1)).distance(link(k).translation - link(k - 1).translation);
    // Both collision shapes may be off by that.
    let off = Params::new(Accuracy::Standard).physics.shape_tolerance * 2.0 * (ROUND + THICK);
    let held = (1..=LINKS).map(moved).fold(0.0, f64::max);
    let (top, creep) = (motion.top_speed(), motion.drift(seconds - FPS as usize, seconds));
    all([
        (format!("fastest {top:.2} m/s"), top < 0.5),
        (format!("each moves by {:.2} of a thickness from the one above", held / THICK / 2.0), held < 2.0 * off),
        (format!("move by {:.3} of it in the last second", creep / THICK / 2.0), creep < 0.1 * THICK),
    ])
}

/// A heap that nothing holds in the end: it falls once.
pub fn falls_once(engine: Engine, _: Extent) -> Outcome {
    all([cone(0.9, 1.6), cylinder(0.5, 1.2)].map(|control| {
        let mut settings = Params::new(Accuracy::Standard);
        settings.glue.mode = GlueMode::Natural;
        if engine == Engine::Uncontrolled {
            settings.control.mode = ControlMode::Off;
        }
        let motion = baked(&filled(control, prop("stick", asset("stick.glb"), 0.7)), &settings);
        let [twice, error, energy] =
            ["second_collapse", "ballistic_error_max", "energy_growth_rel"].map(|name| motion.figure(name));
        let bodies = motion.last().len();
        let sound = twice == 0.0 && error <= 0.01 && energy <= 1e-3;
        (format!("{bodies} sticks: {twice} fall twice, free fall off by {:.2} %", 1e2 * error), sound)
    }))
}
