//! Stacks: what stands must stand, and not sink.

use super::engines::{Engine, FPS, Motion, run};
use super::scenes::{at, block, cards, placed, prop};
use super::{Extent, Outcome, all};
use cairn_input::scene::{Keyframe, Model, Scene, StaticModel};
use glam::DVec3;

pub fn card_tower(engine: Engine, extent: Extent) -> Outcome {
    card_house(engine, extent, 1.0)
}

pub fn card_thin(engine: Engine, extent: Extent) -> Outcome {
    // The example's cards are 0.88 mm thick.
    card_house(engine, extent, 0.1 / 0.88)
}

fn card_house(engine: Engine, extent: Extent, factor: f64) -> Outcome {
    let seconds = if extent == Extent::Full { 60.0 } else { 10.0 };
    let height = |motion: &Motion| motion.first().iter().map(|p| p.translation.y).fold(0.0, f64::max);
    let run = |friction: f64, seconds: f64| run(engine, &cards(factor, friction), seconds);
    let (stands, falls) = (run(0.7, seconds), run(0.2, 2.0));
    let moved = |m: &Motion| m.drift(0, m.frames.len() - 1) / height(m);
    let (drift, fallen) = (moved(&stands), moved(&falls));
    let mut parts = vec![
        (format!("moves {:.2} % of its height in {seconds} s", 100.0 * drift), drift < 0.02),
        (format!("at friction 0.2 {:.0} %", 100.0 * fallen), fallen > 0.1),
    ];
    if stands.report.is_some() {
        let deepest = stands.figure("penetration_max_rel");
        parts.push((format!("penetration {:.1} %", 100.0 * deepest), deepest < 0.12));
    }
    all(parts)
}

/// One of two cards that lean against each other is scenery that moves away after a second. (Under the load of a whole
/// house, the other would stay: at this friction it is a strut that jams.)
pub fn card_pull(engine: Engine, _: Extent) -> Outcome {
    const START: f64 = 1.0;
    let mut scene = cards(1.0, 0.7);
    scene.bodies.truncate(2);
    let pulled = scene.bodies.remove(0);
    let model = Model::new("pulled", scene.props[0].model.mesh.clone());
    let out = cairn_geometry::pose::Pose { translation: pulled.pose.translation + DVec3::Z * 0.3, ..pulled.pose };
    let keys = vec![Keyframe { time: START, pose: pulled.pose }, Keyframe { time: START + 0.3, pose: out }];
    scene.statics.push(StaticModel { model, friction: 0.05, keys });
    let motion = run(engine, &scene, START + 2.0);
    let before = (START * FPS) as usize;
    let thickness = 0.00088;
    let earlier = motion.drift(0, before - 2);
    // How long after the pull the partner has sunk by ten thicknesses.
    // A card's origin is in its lower edge.
    let top = |frame: usize| motion.frames[frame][0].transform_point(DVec3::Y * 0.088).y;
    let fallen = |frame: &usize| top(before) - top(*frame) > 10.0 * thickness;
    let when = (before..motion.frames.len()).find(fallen).map(|frame| (frame - before) as f64 / FPS);
    all([
        (format!("moves {:.1} mm before", 1e3 * earlier), earlier < 10.0 * thickness),
        match when {
            Some(seconds) => (format!("the other falls after {seconds:.2} s"), seconds < 0.5),
            None => ("the other does not fall".into(), false),
        },
    ])
}

fn cube(edge: f64) -> cairn_input::scene::Prop {
    prop("cube", block(DVec3::splat(edge)), 0.7)
}

/// A cube that is so many times as heavy on one of 1 kg.
pub fn heavy(ratio: f64) -> Scene {
    let mut scene = placed(cube(0.1), [at(0.0, 0.05, 0.0), at(0.0, 0.15, 0.0)]);
    scene.bodies[1].mass = Some(ratio);
    scene
}

/// How deep the heavy cube sinks in 5 s, in edges, and whether the report names the masses.
fn sag(engine: Engine, ratio: f64) -> (f64, bool) {
    let motion = run(engine, &heavy(ratio), 5.0);
    let sag = (0.15 - motion.last()[1].translation.y) / 0.1;
    (sag, motion.report.as_ref().is_some_and(|r| r.warnings.iter().any(|w| w.contains("mass"))))
}

pub fn heavy_on_light(engine: Engine, _: Extent) -> Outcome {
    let part = |ratio: f64| {
        let (sag, _) = sag(engine, ratio);
        (format!("{ratio}:1 sinks {:.2} %", 100.0 * sag), sag.abs() < 0.01)
    };
    all([10.0, 100.0, 1e3].map(part))
}

pub fn heaviest_on_light(engine: Engine, _: Extent) -> Outcome {
    let (sag, _) = sag(engine, 1e4);
    all([(format!("sinks {:.2} %", 100.0 * sag), sag.abs() < 0.01)])
}

pub fn heaviest_is_told(engine: Engine, _: Extent) -> Outcome {
    let summary = |ratio: f64| sag(engine, ratio).1;
    let (light, heavy) = (summary(10.0), summary(1e4));
    let word = |summary: bool| if summary { "a warning" } else { "none" };
    all([(format!("10:1: {}", word(light)), !light), (format!("10000:1: {}", word(heavy)), heavy)])
}

/// Ten cubes on top of each other.
pub fn cubes(edge: f64) -> Scene {
    placed(cube(edge), (0..10).map(|k| at(0.0, edge * (f64::from(k) + 0.5), 0.0)))
}

pub fn tower(engine: Engine, extent: Extent) -> Outcome {
    let part = |edge: f64| {
        // The time that a small tower takes to fall grows with the square root of its size.
        let seconds = if extent == Extent::Full || edge > 0.05 { 20.0 } else { 5.0 };
        let motion = run(engine, &cubes(edge), seconds);
        let height = 10.0 * edge;
        let sag = (motion.first()[9].translation.y - motion.last()[9].translation.y) / height;
        let sideways = motion.last().iter().map(|p| p.translation.x.hypot(p.translation.z)).fold(0.0, f64::max);
        let (sag, sideways) = (100.0 * sag, 100.0 * sideways / height);
        (format!("{edge} m: sinks {sag:.2} %, sideways {sideways:.2} %"), sag.abs() < 5.0 && sideways < 1.0)
    };
    all([0.001, 0.01, 0.1, 1.0, 100.0].map(part))
}

pub fn thin_stack(engine: Engine, _: Extent) -> Outcome {
    const THICK: f64 = 0.04;
    const COLUMN: usize = 45;
    let column = |c: usize| (0..COLUMN).map(move |k| at(0.6 * c as f64, THICK * (k as f64 + 0.5), 0.0));
    let book = prop("book", block(DVec3::new(0.3, THICK, 0.2)), 0.7);
    let motion = run(engine, &placed(book, (0..20).flat_map(column)), 3.0);
    let ends = motion.last();
    let depth = |k: usize| {
        let below = if k.is_multiple_of(COLUMN) { -THICK / 2.0 } else { ends[k - 1].translation.y };
        (THICK - (ends[k].translation.y - below)).max(0.0) / THICK
    };
    let mean = 100.0 * (0..ends.len()).map(depth).sum::<f64>() / ends.len() as f64;
    let fallen = (0..ends.len()).filter(|&k| motion.first()[k].translation.distance(ends[k].translation) > 0.1).count();
    all([
        (format!("mean penetration {mean:.2} % of a thickness"), mean < 1.0),
        (format!("{fallen} books away from their place"), fallen == 0),
    ])
}
