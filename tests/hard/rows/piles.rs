//! Piles that must come to rest, and stay.

use super::engines::{Engine, FPS, Motion, baked, params, run};
use super::scenes::{asset, at, ball, block, cloud, cone, cylinder, filled, placed, prop};
use super::{Extent, Outcome, all};
use cairn_geometry::mesh::TriMesh;
use cairn_input::params::{Params, ReleaseOrder};
use cairn_input::scene::Scene;
use glam::DVec3;
use rayon::prelude::*;

pub fn balls(engine: Engine, extent: Extent) -> Outcome {
    let (count, across) = if extent == Extent::Full { (1000, 8) } else { (200, 5) };
    let seconds = 25.0;
    let scene = placed(prop("ball", ball(RADIUS), 0.7), cloud(count, across, 2.2 * RADIUS, 5));
    let motion = run(engine, &scene, seconds);
    let end = motion.frames.len() - 1;
    let speed = motion.speeds(end).into_iter().fold(0.0, f64::max);
    let limit = 0.01 * (9.81 * 2.0 * RADIUS).sqrt();
    let creep = motion.drift(end - 5 * FPS as usize, end) / (2.0 * RADIUS);
    all([
        (format!("{count} balls: fastest after {seconds} s {speed:.4} m/s of {limit:.4}"), speed < limit),
        (format!("creep in the last 5 s {creep:.4} d"), creep < 0.01),
    ])
}

/// Of the ball that rolls, m/s.
const SPEED: f64 = 1.0;

/// Radius of balls, m.
pub const RADIUS: f64 = 0.05;

/// A ball on level ground, thrown along it at a speed, m/s; so many times as fast around itself as if it rolled.
pub fn thrown_ball(mesh: TriMesh, speed: f64, turns: f64, friction: f64) -> Scene {
    let mut scene = placed(prop("ball", mesh, friction), [at(0.0, RADIUS, 0.0)]);
    scene.bodies[0].velocity = DVec3::X * speed;
    scene.bodies[0].angular_velocity = DVec3::NEG_Z * speed / RADIUS * turns;
    scene
}

/// A ball that rolls at 1 m/s on level ground slows by c g / 1.4, c the coefficient of rolling resistance.
pub fn rolling(engine: Engine, _: Extent) -> Outcome {
    // Before the late damping of everything that still moves sets in.
    const SECONDS: f64 = 1.2;
    let scene = thrown_ball(ball(RADIUS), SPEED, 1.0, 0.7);
    let exact = params(engine, 0.0).physics.rolling_resistance * 9.81 / 1.4;
    let motion = run(engine, &scene, SECONDS);
    let end = motion.frames.len() - 1;
    let slows = (SPEED - motion.speeds(end)[0]) / (SECONDS - 0.5 / FPS);
    let error = (slows / exact - 1.0).abs();
    all([(format!("slows by {slows:.3} m/s2, by theory {exact:.3}"), error < 0.05)])
}

fn filled_params(engine: Engine, count: u32, hold: f64) -> Params {
    let mut params = params(engine, hold);
    params.release.order = ReleaseOrder::BottomUp;
    params.output.frames = None;
    params.output.fps = 24.0;
    params.fill.count = Some(count);
    // The piles of the table have this surface, in all engines.
    params.fill.surface = 1.0;
    params
}

/// At rest 2 s after the last release in the median of the runs; in the worst of them, no creep from then on, none that
/// hangs, and none lost.
fn rests(motions: &[Motion], hold: f64) -> Outcome {
    let all_of = |figure: &str| -> Vec<f64> { motions.iter().map(|motion| motion.figure(figure)).collect() };
    let most = |figure: &str| all_of(figure).into_iter().fold(0.0, f64::max);
    let mut rest = all_of("rest_seconds");
    rest.sort_by(f64::total_cmp);
    let (least, middle, longest) = (rest[0], rest[rest.len() / 2], rest[rest.len() - 1]);
    let range =
        if rest.len() > 1 { format!(" ({least:.2} to {longest:.2}, {} seeds)", rest.len()) } else { String::new() };
    let lost: u64 = motions.iter().map(|motion| motion.count("bodies_lost")).sum();
    let (creep, hanging, bodies) = (most("creep_max_rel"), most("hanging"), motions[0].first().len());
    all([
        (format!("{bodies} bodies at rest after {middle:.2} s{range}"), middle < 2.0),
        (format!("creep {creep:.4} d in {hold} s"), creep < 0.01),
        (format!("{hanging} hanging"), hanging == 0.0),
        (format!("{lost} lost"), lost == 0),
    ])
}

pub fn rest_sticks(engine: Engine, extent: Extent) -> Outcome {
    let (count, hold) = if extent == Extent::Full { (609, 60.0) } else { (150, 20.0) };
    let stick = prop("stick", block(DVec3::new(0.05, 0.5, 0.05)), 0.7);
    let factor = 0.5 * (f64::from(count) * 0.01 / 0.42 / 3.1).cbrt();
    let scene = filled(cone(factor * 0.96, factor * 2.9), stick);
    // One stick that slides on a little longer decides: by seed, they rest after 1 to 7 s.
    let motions: Vec<Motion> = (1..=7u64)
        .into_par_iter()
        .map(|seed| baked(&scene, &Params { seed, ..filled_params(engine, count, hold) }))
        .collect();
    rests(&motions, hold)
}

pub fn rest_bananas(engine: Engine, extent: Extent) -> Outcome {
    let (count, hold) = if extent == Extent::Full { (1000, 60.0) } else { (80, 10.0) };
    let banana = prop("banana", asset("banana.glb"), 0.7);
    let volume = banana.model.mesh.signed_volume().abs() * f64::from(count) / 0.42;
    let radius = (volume / 3.6).cbrt();
    let scene = filled(cone(radius * 1.4, radius * 1.9), banana);
    rests(&[baked(&scene, &filled_params(engine, count, hold))], hold)
}

pub fn long(engine: Engine, extent: Extent) -> Outcome {
    let hold = if extent == Extent::Full { 600.0 } else { 60.0 };
    let stick = prop("stick", block(DVec3::new(0.06, 0.6, 0.06)), 0.7);
    let motion = baked(&filled(cylinder(0.6, 1.5), stick), &filled_params(engine, 200, hold));
    let creep = motion.figure("creep_max_rel");
    all([(format!("{} bodies drift {creep:.5} d in {hold} s", motion.first().len()), creep < 0.01)])
}

/// Columns of four, which fall a little.
pub fn many(engine: Engine, extent: Extent) -> Outcome {
    let counts: &[usize] = if extent == Extent::Full { &[10_000, 100_000] } else { &[1_000] };
    let part = |&count: &usize| {
        let across = ((count / 4) as f64).sqrt().ceil() as usize;
        let pose = |k: usize| {
            let (column, level) = (k / 4, k % 4);
            let (x, z) = ((column % across) as f64, (column / across) as f64);
            at(0.15 * x, 0.05 + 0.101 * level as f64, 0.15 * z)
        };
        let scene = placed(prop("cube", block(DVec3::splat(0.1)), 0.7), (0..count).map(pose));
        let mut params = params(engine, 0.5);
        params.output.fps = 4.0;
        params.output.frames = Some(2);
        let before = peak_memory();
        let motion = baked(&scene, &params);
        let buried = motion.last().iter().filter(|p| p.translation.y < 0.0).count();
        let lost = buried as u64 + motion.lost();
        let kept = motion.is_finite() && motion.last().len() == count && lost == 0;
        let memory = match (before, peak_memory()) {
            // In a process that needed more before, nothing is learnt.
            (Some(before), Some(after)) if after > before => {
                format!(", {:.1} KiB each", (after - before) / count as f64)
            }
            _ => String::new(),
        };
        (format!("{count} bodies, {lost} lost{memory}"), kept)
    };
    all(counts.iter().map(part).collect::<Vec<_>>())
}

/// Largest resident memory of this process so far, KiB; `None` where the system does not report it.
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix("kB")?.trim().parse().ok())
}
