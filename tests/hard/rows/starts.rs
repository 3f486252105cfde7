//! Bad beginnings: bodies in each other, needles, a state that is no number.

use super::engines::{Engine, Motion, params, run};
use super::scenes::{at, block, cloud, placed, prop};
use super::{Extent, Outcome, all};
use cairn_core::cache::NoCache;
use cairn_geometry::pose::Pose;
use cairn_input::observer::{Silent, Stage};
use glam::DVec3;

pub fn needles(engine: Engine, _: Extent) -> Outcome {
    let rod = prop("rod", block(DVec3::new(1.0, 0.01, 0.01)), 0.5);
    let poses = cloud(60, 3, 0.6, 3);
    let height = poses.iter().map(|p| p.translation.y).fold(0.0, f64::max);
    let motion = run(engine, &placed(rod, poses), 6.0);
    let (fastest, limit) = (motion.top_speed(), 2.0 * (2.0 * 9.81 * height).sqrt());
    let outside = motion.last().iter().filter(|p| p.translation.y < -0.01 || p.translation.length() > 3.0 * height);
    let lost = outside.count() as u64 + motion.lost();
    all([
        (format!("fastest {fastest:.1} m/s of {limit:.1}"), motion.is_finite() && fastest < limit),
        (format!("{lost} lost"), lost == 0),
    ])
}

pub fn overlap(engine: Engine, _: Extent) -> Outcome {
    const EDGE: f64 = 0.1;
    let step = 0.75 * EDGE;
    let pose = |k: i32| {
        let (x, y, z) = (k % 3 - 1, k / 3 % 3, k / 9 - 1);
        at(step * f64::from(x), EDGE / 2.0 + step * f64::from(y), step * f64::from(z))
    };
    let motion = run(engine, &placed(prop("cube", block(DVec3::splat(EDGE)), 0.5), (0..27).map(pose)), 4.0);
    apart(&motion, EDGE, 1.0)
}

pub fn coincident(engine: Engine, _: Extent) -> Outcome {
    const EDGE: f64 = 0.1;
    let poses = [at(0.0, EDGE / 2.0, 0.0); 20];
    apart(&run(engine, &placed(prop("cube", block(DVec3::splat(EDGE)), 0.5), poses), 6.0), EDGE, 3.0)
}

/// Cubes that were in each other: no faster than this, and in the end beside each other and above the ground.
fn apart(motion: &Motion, edge: f64, limit: f64) -> Outcome {
    let fastest = motion.top_speed();
    let ends = motion.last();
    let buried = ends.iter().filter(|p| p.translation.y < 0.45 * edge).count();
    let pairs = (0..ends.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let nearest = pairs.map(|(a, b)| ends[a].translation.distance(ends[b].translation)).fold(f64::INFINITY, f64::min);
    all([
        (format!("fastest {fastest:.2} m/s"), motion.is_finite() && fastest < limit),
        (format!("nearest two {:.0} % of an edge apart", 100.0 * nearest / edge), nearest > 0.9 * edge),
        (format!("{buried} in the ground"), buried == 0),
        (format!("{} lost", motion.lost()), motion.lost() == 0),
    ])
}

/// Two stacks apart from each other. In one of them, a body gets a velocity that is no number.
pub fn nan_inside(engine: Engine, _: Extent) -> Outcome {
    let (sound, broken) = (stacks_of_five(engine, None), stacks_of_five(engine, Some(2)));
    let same = sound.poses[5..] == broken.poses[5..];
    let finite = broken.poses.iter().all(|p| p.translation.is_finite());
    let summary = if broken.lost == [2] { "body 2 is set aside by name" } else { "the wrong bodies are set aside" };
    all([
        (summary.into(), broken.lost == [2] && sound.lost.is_empty()),
        (format!("the other stack is {}", if same { "bit-identical" } else { "changed" }), same),
        (format!("all others are {}", if finite { "finite" } else { "broken" }), finite),
    ])
}

struct Ends {
    poses: Vec<Pose>,
    lost: Vec<usize>,
}

fn stacks_of_five(engine: Engine, broken: Option<usize>) -> Ends {
    let pose = |k: i32| at(f64::from(k / 5), 0.1 * (f64::from(k % 5) + 0.5), 0.0);
    let scene = placed(prop("cube", block(DVec3::splat(0.1)), 0.5), (0..10).map(pose));
    let params = params(engine, 1.0);
    let full = cairn_core::fill_container(&scene, &params, &mut NoCache, &mut Silent).expect("a sound scene");
    let mut sim = full.turn_over(&scene, &params).expect("a pile");
    for step in 0..60 {
        if let (20, Some(id)) = (step, broken) {
            sim.pile.release(id);
            sim.pile.world.launch(id, DVec3::splat(f64::NAN), DVec3::ZERO);
        }
        if step == 0 {
            (0..10).for_each(|id| sim.pile.release(id));
        }
        sim.advance(&mut Silent, Stage::Hold, |_| 0.0).expect("nobody cancels");
    }
    let poses = sim.pile.recorder.frames.last().expect("frame 0 is there").clone();
    Ends { poses, lost: sim.guard.actions.aside.iter().map(|aside| aside.0).collect() }
}
