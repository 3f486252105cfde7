//! Several piles in one bake, and piles that ride on scenery that moves.

use super::common::{block, scene};
use cairn_core::report::bake::Bake;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, GlueMode, Params, Switch};
use cairn_input::scene::{Keyframe, Model, PileShape, Prop, Scene, StaticModel};
use glam::{DQuat, DVec3};

fn at(mesh: TriMesh, place: DVec3) -> TriMesh {
    TriMesh { points: mesh.points.iter().map(|&p| p + place).collect(), ..mesh }
}

/// Boxes of 0.5 x 0.4 x 0.5 m on the ground, one for each place along x. Shape `i` has prop `i` alone: bricks, cubes.
fn boxes(places: &[f64]) -> Scene {
    let shape = |x: f64| at(block(DVec3::new(0.5, 0.4, 0.5)), DVec3::new(x, 0.2, 0.0));
    let mut all = TriMesh::default();
    places.iter().for_each(|&x| all.append(&shape(x)));
    let pile = |(i, &x): (usize, &f64)| PileShape {
        control: Model::new(format!("box {i}"), shape(x)),
        props: vec![i],
        seed: None,
    };
    let mut scene = scene(all, block(DVec3::new(0.16, 0.08, 0.1)));
    scene.props.push(Prop::new(Model::new("cube", block(DVec3::splat(0.1)))));
    Scene { piles: places.iter().enumerate().map(pile).collect(), ..scene }
}

fn draft() -> Params {
    Params::new(Accuracy::Draft)
}

fn bake(scene: &Scene, params: &Params) -> Bake {
    cairn_core::bake(scene, params, &mut Silent).unwrap()
}

/// Prop and place of each body in a frame.
fn bodies(bake: &Bake, frame: usize) -> Vec<(usize, DVec3)> {
    let poses = bake.pile.frames[frame].iter().map(|pose| pose.translation);
    bake.pile.bodies.iter().map(|body| body.prop).zip(poses).collect()
}

#[test]
fn each_shape_has_its_own_props_and_seed() {
    let mut params = draft();
    params.output.frames = Some(0);
    let scene = boxes(&[-0.5, 0.5]);
    let done = bake(&scene, &params);
    for (prop, place) in bodies(&done, 0) {
        assert_eq!(prop, usize::from(place.x > 0.0), "{place}");
    }
    let count = |of: usize| bodies(&done, 0).iter().filter(|(prop, _)| *prop == of).count();
    assert!(count(0) > 20 && count(1) > 20, "{} and {}", count(0), count(1));
    let expected = done.report.plan.expected_bodies as f64;
    assert!((0.7..1.4).contains(&(expected / done.pile.bodies.len() as f64)), "{expected} bodies are expected");

    let mut other = scene.clone();
    other.piles[1].seed = Some(77);
    let other = bake(&other, &params);
    let of = |bake: &Bake, of: usize| -> Vec<DVec3> {
        bodies(bake, 0).into_iter().filter(|(prop, _)| *prop == of).map(|(_, place)| place).collect()
    };
    assert_eq!(of(&done, 0), of(&other, 0), "the other shape's seed does not matter");
    assert_ne!(of(&done, 1), of(&other, 1));
    // Alone, the first shape is filled as it is beside another: seeds and units are the same.
    let mut alone = scene.clone();
    alone.piles.pop();
    let alone = bake(&alone, &params);
    let near = |n: usize| (0.9..1.1).contains(&(alone.pile.bodies.len() as f64 / n as f64));
    assert!(near(count(0)), "{} alone, {} beside another", alone.pile.bodies.len(), count(0));
}

/// Shapes that overlap share their room, and the piles lean on each other.
#[test]
fn piles_that_touch_lean_on_each_other() {
    let done = bake(&boxes(&[-0.2, 0.2]), &draft());
    let first = bodies(&done, 0);
    assert!(first.iter().any(|(prop, place)| *prop == 0 && place.x > -0.05), "the first one has the room of both");
    assert!(first.iter().all(|(prop, place)| *prop == 0 || place.x > 0.0), "the second one has what is left");
    let figure = |name: &str| done.report.measures[name].unwrap();
    assert!(figure("penetration_max_rel") < 0.3, "{}", figure("penetration_max_rel"));
    assert!(figure("shape_iou_start") > 0.6 && figure("kept_shape") > 0.8, "{:?}", done.report.measures);
}

#[test]
fn problems_of_one_of_several_shapes_name_it() {
    let mut scene = boxes(&[-0.5, 0.5]);
    scene.piles[1].control.mesh.triangles.pop();
    scene.piles[1].control.mesh.triangles.truncate(4);
    scene.piles[0].props = vec![1];
    scene.props[1].weight = 0.0;
    let problems = cairn_prepare::check::run(&scene, &draft()).unwrap_err();
    let has = |field: &str, text: &str| problems.iter().any(|found| found.field == field && found.text.contains(text));
    assert!(has("piles.1", "box 1: the control mesh is open"), "{problems:?}");
    assert!(has("props", "all have the weight 0"), "{problems:?}");
}

/// A pile on a board that moves off after half a second.
fn ride() -> Scene {
    let board = Model::new("board", block(DVec3::new(1.6, 0.1, 1.6)));
    let pose = |x: f64| Pose { translation: DVec3::new(x, -0.05, 0.0), rotation: DQuat::IDENTITY };
    let keys = vec![Keyframe { time: 0.5, pose: pose(0.0) }, Keyframe { time: 2.5, pose: pose(0.4) }];
    let shape = at(block(DVec3::new(0.5, 0.3, 0.5)), DVec3::Y * 0.15);
    let statics = vec![StaticModel { model: board, friction: 0.7, keys }];
    Scene { statics, ..scene(shape, block(DVec3::new(0.16, 0.08, 0.1))) }
}

#[test]
fn a_pile_rides_and_is_at_rest_before() {
    for mode in [GlueMode::Natural, GlueMode::AsModelled] {
        let mut params = draft();
        params.glue.mode = mode;
        params.output.frames = Some(72);
        let done = bake(&ride(), &params);
        let frames = &done.pile.frames;
        let board = &done.pile.scenery[0];
        assert_eq!((frames.len(), board.len(), board[0].translation.x), (73, 73, 0.0));
        // Relative to the board, from frame 0 on.
        let way = |frame: usize| {
            let (moved, off) = (&frames[frame], board[frame].translation - board[0].translation);
            let ways = frames[0].iter().zip(moved).map(|(a, b)| (b.translation - off).distance(a.translation));
            let mut ways: Vec<f64> = ways.collect();
            ways.sort_by(f64::total_cmp);
            ways[ways.len() * 9 / 10]
        };
        assert!(way(10) < 0.002 && way(72) < 0.03, "{mode:?}: {} m, {} m", way(10), way(72));
    }
}

/// Without it, frame 0 is the pile right after turning over.
#[test]
fn settling_before_frame_0_is_a_choice() {
    let fall = |settled: Switch| {
        let mut params = draft();
        params.glue.mode = GlueMode::Natural;
        params.output.settled = settled;
        params.output.frames = Some(24);
        let mut scene = ride();
        scene.statics.clear();
        scene.control.as_mut().unwrap().mesh.points.iter_mut().for_each(|p| p.y += 0.2);
        params.ground_height = Some(0.0);
        let done = bake(&scene, &params);
        let height = |frame: usize| {
            let poses = &done.pile.frames[frame];
            poses.iter().map(|pose| pose.translation.y).sum::<f64>() / poses.len() as f64
        };
        (height(0) - height(24), done.pile.frames.len())
    };
    let (before, after) = (fall(Switch::Auto), fall(Switch::On));
    assert!(before.0 > 0.15 && after.0.abs() < 0.01, "{before:?} m, {after:?} m");
    assert_eq!((before.1, after.1), (25, 25));
}
