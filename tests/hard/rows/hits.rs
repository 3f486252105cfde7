//! What flies into a wall.

use super::engines::{Engine, FPS, Motion, run};
use super::scenes::{at, ball, block, placed, prop};
use super::{Extent, Outcome, all};
use cairn_geometry::pose::Pose;
use cairn_input::scene::{PlacedBody, Scene};
use glam::DVec3;

const EDGE: f64 = 0.1;
const CUBE_MASS: f64 = 1000.0 * EDGE * EDGE * EDGE;
/// When the ball appears, s.
const START: f64 = 0.5;
const GRAVITY: f64 = 9.81;

/// A wall of 5 x 5 cubes, and the last body: a ball of the same width that flies at the middle of the middle cube.
fn scene(ratio: f64, speed: f64) -> Scene {
    let wall = (0..5).flat_map(|y| (0..5).map(move |z| (y, z)));
    let pose = |(y, z): (i32, i32)| at(0.0, EDGE * (f64::from(y) + 0.5), EDGE * f64::from(z - 2));
    let mut scene = placed(prop("cube", block(DVec3::splat(EDGE)), 0.7), wall.map(pose));
    scene.props.push(prop("ball", ball(EDGE / 2.0), 0.5));
    let from = at(-0.13, 2.5 * EDGE, 0.0);
    let mass = Some(ratio * CUBE_MASS);
    scene.bodies.push(PlacedBody { velocity: DVec3::X * speed, mass, start: START, ..PlacedBody::new(1, from) });
    scene
}

pub fn projectile(engine: Engine, _: Extent) -> Outcome {
    let begin = (START * FPS) as usize;
    let (mut gain, mut nearest) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut lost, mut let_go, mut cases) = (0, 0, 0);
    for ratio in [1.0, 10.0, 100.0] {
        for speed in [1.0, 10.0, 100.0] {
            let motion = run(engine, &scene(ratio, speed), START + 1.0);
            cases += 1;
            let_go += motion.count("shaken") + motion.count("holds_broken");
            lost += motion.lost() + u64::from(!motion.is_finite());
            let brought = CUBE_MASS * ratio * speed * speed / 2.0;
            let at_first = brought + potential(&motion.frames[begin], ratio);
            let energies = (begin + 1..motion.frames.len()).map(|frame| energy(&motion, frame, ratio));
            gain = gain.max((energies.fold(0.0, f64::max) - at_first) / brought);
            nearest = nearest.min(nearest_pass(&motion, begin));
        }
    }
    let summary = if engine == Engine::Cairn { format!("; {let_go} bodies released by blows") } else { String::new() };
    let passes =
        if nearest.is_finite() { format!("{:.0} % of an edge", 100.0 * nearest / EDGE) } else { "none".into() };
    all([
        (format!("nearest pass by a cube: {passes}"), nearest > 0.9 * EDGE),
        (format!("energy changes by {:+.1} % at most{summary}", 100.0 * gain), gain < 0.02),
        (format!("{lost} lost in {cases}"), lost == 0),
    ])
}

/// How near to a cube's middle the ball's middle was, across its flight, when it left the cube behind; infinite where
/// it never did. An edge apart they touch at most; what went through a cube was nearer.
fn nearest_pass(motion: &Motion, begin: usize) -> f64 {
    let ball = motion.frames[begin].len() - 1;
    let ahead = |frame: usize, cube: usize| motion.place(frame, cube) - motion.place(frame, ball);
    let pass = |(frame, cube): (usize, usize)| {
        let (before, after) = (ahead(frame, cube), ahead(frame + 1, cube));
        let share = before.x / (before.x - after.x);
        (before.x > 0.0 && after.x <= 0.0).then(|| before.lerp(after, share).with_x(0.0).length())
    };
    let frames = begin..motion.frames.len() - 1;
    frames.flat_map(|frame| (0..ball).map(move |cube| (frame, cube))).filter_map(pass).fold(f64::INFINITY, f64::min)
}

/// Mass of each body, kg; the ball is the last one.
fn masses(count: usize, ratio: f64) -> impl Iterator<Item = f64> {
    (0..count).map(move |body| if body + 1 == count { ratio * CUBE_MASS } else { CUBE_MASS })
}

/// Energy of height, J.
fn potential(poses: &[Pose], ratio: f64) -> f64 {
    poses.iter().zip(masses(poses.len(), ratio)).map(|(pose, mass)| mass * GRAVITY * pose.translation.y).sum()
}

/// All mechanical energy between a frame and the one before, J. What turns by more than half a turn in a frame counts
/// for less.
fn energy(motion: &Motion, frame: usize, ratio: f64) -> f64 {
    let (before, after) = (&motion.frames[frame - 1], &motion.frames[frame]);
    let ball = before.len() - 1;
    let moving = before.iter().zip(after).zip(masses(before.len(), ratio)).enumerate().map(|(body, ((a, b), mass))| {
        let speed = a.translation.distance(b.translation) * FPS;
        let spin = a.rotation.angle_between(b.rotation) * FPS;
        // Of a ball 2/5 r^2, of a cube a^2/6.
        let inertia = mass * if body == ball { 0.1 * EDGE * EDGE } else { EDGE * EDGE / 6.0 };
        (mass * speed * speed + inertia * spin * spin) / 2.0
    });
    moving.sum::<f64>() + (potential(before, ratio) + potential(after, ratio)) / 2.0
}
