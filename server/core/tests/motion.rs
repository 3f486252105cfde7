//! Motion that nobody doubts: what touches nothing falls freely, what stands does not fall by itself, nothing passes
//! through anything, and a pile is the same wherever it stands.

mod common;

use cairn_core::bake;
use cairn_core::geometry::mesh::TriMesh;
use cairn_core::geometry::pose::Pose;
use cairn_core::input::observer::Silent;
use cairn_core::input::params::{Accuracy, ControlMode, GlueMode, Params, Switch};
use cairn_core::input::scene::{Keyframe, Model, PlacedBody, Scene, StaticModel};
use cairn_core::prepare::effects::Count;
use cairn_core::report::bake::Bake;
use common::{block, cone, scene, stick};
use glam::{DQuat, DVec3};

fn natural() -> Params {
    let mut params = Params::new(Accuracy::Preview);
    params.glue.mode = GlueMode::Natural;
    params
}

fn baked(scene: &Scene, params: &Params) -> Bake {
    bake(scene, params, &mut Silent).unwrap()
}

#[test]
fn nothing_in_a_natural_pile_floats_or_falls_twice() {
    let scene = scene(cone(0.9, 1.6), stick());
    let held = |params: &mut Params| params.control.stand = Switch::Off;
    let alone = |params: &mut Params| params.control.mode = ControlMode::Off;
    for (name, change) in [("natural", None), ("held", Some(&held as &dyn Fn(&mut Params))), ("alone", Some(&alone))] {
        let mut params = natural();
        change.iter().for_each(|change| change(&mut params));
        let report = baked(&scene, &params).report;
        let figure = |name: &str| report.measures[name].unwrap();
        assert!(figure("ballistic_error_max") <= 0.01, "{name}: {}", figure("ballistic_error_max"));
        assert_eq!(figure("second_collapse"), 0.0, "{name}");
        assert!(figure("energy_growth_rel") < 1e-3, "{name}: {}", figure("energy_growth_rel"));
    }
}

#[test]
fn frames_in_which_nothing_is_seen_are_left_out_on_request() {
    let scene = scene(cone(0.9, 1.6), stick());
    let mut params = natural();
    params.output.frames = Some(240);
    let whole = baked(&scene, &params);
    params.output.trim = true;
    let trimmed = baked(&scene, &params);
    let count = trimmed.pile.frames.len();
    assert_eq!((whole.pile.frames.len(), whole.report.counts[&Count::FramesTrimmed]), (241, 0));
    assert_eq!(count as u64 + trimmed.report.counts[&Count::FramesTrimmed], 241);
    assert!((25..200).contains(&count), "{count} frames");
    assert_eq!(whole.pile.frames[..count], trimmed.pile.frames, "the others are the same");
    let d = trimmed.report.plan.prop_diameter;
    let ways = whole.pile.frames[240].iter().zip(&trimmed.pile.frames[count - 1]);
    let farthest = ways.map(|(a, b)| a.translation.distance(b.translation)).fold(0.0, f64::max);
    assert!(farthest <= 0.1 * d, "{farthest} m");
}

#[test]
fn fast_scenery_does_not_pass_through_bodies() {
    // A wall of 8 mm at 4 m/s, and cubes of 20 mm.
    let at = |x: f64, y: f64| Pose { translation: DVec3::new(x, y, 0.0), rotation: DQuat::IDENTITY };
    let mut scene = scene(cone(1.0, 1.0), block(DVec3::splat(0.02)));
    scene.control = None;
    scene.bodies = [0.03, 0.06, 0.09].map(|x| PlacedBody::new(0, at(x, 0.01))).to_vec();
    let wall = Model::new("wall", block(DVec3::new(0.008, 0.1, 0.2)));
    let key = |time: f64, x: f64| Keyframe { time, pose: at(x, 0.05) };
    scene.statics = vec![StaticModel { model: wall, friction: 0.7, keys: vec![key(0.5, 0.0), key(0.6, 0.4)] }];
    let params = Params::new(Accuracy::Standard);
    let bake = baked(&scene, &params);
    for body in bake.pile.frames.last().unwrap() {
        assert!(body.translation.x > 0.41, "{}", body.translation);
    }
    assert!(bake.report.counts[&Count::SceneryPartSteps] > 0);
    scene.statics[0].keys[1].time = 20.0;
    assert_eq!(baked(&scene, &params).report.counts[&Count::SceneryPartSteps], 0, "slow scenery needs no more steps");
}

#[test]
fn resistance_does_not_slow_what_falls() {
    let mut scene = scene(cone(0.9, 1.6), stick());
    scene.control = None;
    let pose = Pose { translation: DVec3::new(0.0, 2.0, 0.0), rotation: DQuat::IDENTITY };
    scene.bodies = vec![PlacedBody::new(0, pose)];
    let mut params = natural();
    params.release.resistance = 10.0;
    params.output.frames = Some(12);
    let bake = baked(&scene, &params);
    let fallen = 2.0 - bake.pile.frames[12][0].translation.y;
    let exact = params.gravity / 2.0 * 0.5f64.powi(2);
    // The engine adds the velocity of a step before it moves.
    assert!((fallen - exact).abs() < 0.05 * exact, "{fallen} m of {exact}");
    assert!(bake.report.measures["ballistic_error_max"].unwrap() <= 0.01);
}

#[test]
fn a_pile_is_the_same_wherever_it_stands() {
    const GRID: f64 = (1 << 20) as f64;
    let at = |offset: DVec3| {
        let control = cone(0.7, 1.2);
        // Exact at any offset, as the single precision of a file is.
        let exact = |p: DVec3| (p * GRID).round() / GRID;
        let points = control.points.iter().map(|&p| exact(p) + offset).collect();
        baked(&scene(TriMesh { points, ..control }, stick()), &natural())
    };
    let here = at(DVec3::ZERO);
    for offset in [DVec3::new(1e3, 0.0, 0.0), DVec3::new(0.0, 0.0, -1e6), DVec3::new(2e5, 0.0, 3e5)] {
        let there = at(offset);
        let (first, last) = (here.pile.frames.last().unwrap(), there.pile.frames.last().unwrap());
        assert_eq!(first.len(), last.len(), "{offset}");
        let apart = first.iter().zip(last).map(|(a, b)| (b.translation - offset).distance(a.translation));
        let apart = apart.fold(0.0, f64::max);
        assert!(apart < 1e-3 * 0.5, "{offset}: {apart} m");
    }
}
