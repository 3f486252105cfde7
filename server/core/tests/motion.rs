//! Motion that nobody doubts: what touches nothing falls freely, and no frame is written in which nothing is seen.
//! That piles fall once, at any place, is a hard case (`tests/hard`).

use super::common::{block, cone, scene, stick};
use cairn_core::bake;
use cairn_core::report::bake::Bake;
use cairn_engine::shape::{Shape, Size};
use cairn_engine::world::{BodyId, Insertion, Role, Units, World};
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, GlueMode, Params, Switch};
use cairn_input::scene::{PlacedBody, Scene};
use cairn_motion::motion::Motion;
use cairn_prepare::effects::Count;
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
fn frames_in_which_nothing_is_seen_are_left_out_on_request() {
    let scene = scene(cone(0.6, 1.0), stick());
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
fn no_visible_meshes_cut_each_other_where_that_is_asked_for() {
    let scene = scene(cone(0.6, 1.0), stick());
    let mut params = natural();
    params.accuracy = Accuracy::Fine;
    let [left, apart] = [Switch::Auto, Switch::On].map(|switch| {
        params.hold.separate = switch;
        baked(&scene, &params)
    });
    assert!(left.report.measures["visible_cut_share"].unwrap() > 0.0, "boxes of the engine sink into each other");
    assert_eq!(left.report.measures["separation_max_rel"], None);
    let counts = &apart.report.counts;
    assert!(counts[&Count::SeparationMoved] > 0 && counts[&Count::SeparationPairs] > 100, "{counts:?}");
    assert_eq!(counts[&Count::SeparationCut], 0, "{:?}", apart.report.measures["separation_max_rel"]);
    assert_eq!(apart.report.measures["visible_cut_share"], Some(0.0));
    let farthest = apart.report.measures["separation_max_rel"].unwrap();
    assert!(farthest > 0.0 && farthest <= 0.25, "{farthest}");
    // One frame more, in which no body moves by more than that, or sinks into the ground.
    let (before, after) = apart.pile.frames.split_at(left.pile.frames.len());
    assert_eq!((before, after.len()), (&left.pile.frames[..], 1));
    for (a, b) in before[before.len() - 1].iter().zip(&after[0]) {
        assert!(a.translation.distance(b.translation) <= 0.25 * 0.06 + 1e-4);
        let points = &scene.props[0].model.mesh.points;
        let low = |pose: &Pose| points.iter().map(|&p| pose.transform_point(p).y).fold(0.0, f64::min);
        assert!(low(b) >= low(a) - 1e-6);
    }
    params.output.frames = Some(240);
    let longer = baked(&scene, &params);
    assert_eq!(longer.pile.frames.len(), 241);
    assert_eq!(longer.pile.frames[240], after[0], "it stays so");
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

/// A world with blocks that are 0.1 m wide, centred at these heights; and how more of them come in.
fn blocks(heights: &[f64]) -> (World, impl Fn(&mut World, f64) -> BodyId) {
    let scene = scene(cone(1.0, 1.0), block(DVec3::splat(0.1)));
    let params = Params::new(Accuracy::Standard);
    let shape = Shape::new(&scene.props[0], Size::of(&scene.props[0].model.mesh), &params.physics).unwrap();
    let units = Units::new(shape.size.diameter, shape.mass, params.gravity);
    let mut world = World::new(units, &params.physics, shape.thickness() / units.length, false);
    world.add_ground(0.0, 0.7);
    let insert = move |world: &mut World, height: f64| {
        let pose = Pose { translation: DVec3::Y * height / world.units.length, rotation: DQuat::IDENTITY };
        let body = Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 };
        world.insert(&shape, &body).unwrap()
    };
    for &height in heights {
        insert(&mut world, height);
    }
    (world, insert)
}

/// What was seen after one more step.
fn watched<'a>(motion: &'a mut Motion, world: &mut World) -> &'a Motion {
    motion.before_step(world);
    world.step();
    motion.after_step(world);
    motion
}

/// Two blocks on each other stand in the air, and are released after 1.5 s; where there is a `hit`, a third one has
/// fallen onto the upper one just before. How many fell untouched.
fn fall_untouched(hit: bool) -> u64 {
    let (mut world, insert) = blocks(&[1.0, 1.1]);
    let [lower, upper] = [0, 1];
    [lower, upper].into_iter().for_each(|id| world.set_role(id, Role::Frozen));
    let mut motion = Motion::default();
    let mut step = |world: &mut World| watched(&mut motion, world).second_collapse;
    let second = (1.0 / (world.units.time * world.step_length())).ceil() as usize;
    for _ in 0..second * 3 / 2 {
        assert_eq!(step(&mut world), 0);
    }
    if hit {
        insert(&mut world, 1.4);
        let hits = (0..second).any(|_| {
            step(&mut world);
            world.pressed_by(upper).next().is_some()
        });
        assert!(hits);
    }
    [lower, upper].into_iter().for_each(|id| world.set_role(id, Role::Free));
    (0..second).map(|_| step(&mut world)).last().unwrap()
}

#[test]
fn what_falls_untouched_after_it_stood_is_counted() {
    assert_eq!(fall_untouched(false), 2);
    assert_eq!(fall_untouched(true), 0, "what stood on a body that was hit falls with it");
}

/// One block hangs below another, far apart from it; a nail at the upper one holds it, which breaks later.
#[test]
fn what_a_nail_holds_is_not_in_free_fall() {
    let (mut world, _) = blocks(&[2.0, 1.5]);
    let [upper, lower] = [0, 1];
    world.set_role(upper, Role::Frozen);
    world.drive_nail(upper, Some(lower), world.pose(upper).translation, DVec3::Y);
    let mut motion = Motion::default();
    let mut step = |world: &mut World| watched(&mut motion, world).ballistic_error;
    let height = world.pose(lower).translation.y;
    assert_eq!((0..20).map(|_| step(&mut world)).fold(0.0, f64::max), 0.0);
    assert!(world.pose(lower).translation.y > height - 0.1, "the nail holds it");
    world.pull_all_nails();
    assert!((0..5).map(|_| step(&mut world)).fold(0.0, f64::max) <= 0.01, "it falls freely");
    assert!(world.pose(lower).translation.y < height, "it falls");
}
