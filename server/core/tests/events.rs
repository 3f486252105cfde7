//! Additions of a scene to its fill, end to end. Long: a scene for each of placed bodies, emitters, moving scenery,
//! blows, the end of the control, and bodies that are taken away.

use super::common::{block, cone, scene, stick};
use cairn_core::report::bake::Bake;
use cairn_core::{Error, bake};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::{Frame, Observer, Progress, Silent, State};
use cairn_input::params::{Accuracy, ContactSelection, ControlMode, GlueMode, Params, ReleaseOrder, Switch};
use cairn_input::scene::{
    Emitter, EmitterVolume, Keyframe, Model, PlacedBody, Prop, RemovalChoice, RemovalRequest, Scene, StaticModel,
};
use cairn_show::taking_apart::RemovedBody;
use glam::{DQuat, DVec3};
use std::ops::ControlFlow;

fn params() -> Params {
    let mut params = Params::new(Accuracy::Draft);
    params.release.order = ReleaseOrder::AtOnce;
    params
}

fn prop(name: &str, mesh: TriMesh) -> Prop {
    let model = Model::new(name, mesh);
    Prop { model, ..scene(TriMesh::default(), TriMesh::default()).props.remove(0) }
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose { translation: DVec3::new(x, y, z), rotation: DQuat::IDENTITY }
}

/// Bricks of 0.4 x 0.2 x 0.2 m.
fn bricks(bodies: Vec<PlacedBody>) -> Scene {
    Scene { props: vec![prop("brick", block(DVec3::new(0.4, 0.2, 0.2)))], bodies, ..Scene::default() }
}

fn tower(bricks: usize) -> Vec<PlacedBody> {
    (0..bricks).map(|k| PlacedBody::new(0, at(0.0, 0.1 + 0.2 * k as f64, 0.0))).collect()
}

fn baked(scene: &Scene, params: &Params) -> Bake {
    bake(scene, params, &mut Silent).unwrap()
}

fn figure(bake: &Bake, name: &str) -> f64 {
    bake.report.measures[name].unwrap()
}

#[test]
fn a_given_stack_needs_no_control_mesh() {
    let bake = baked(&bricks(tower(6)), &params());
    assert_eq!(bake.pile.bodies.len(), 6);
    assert!(figure(&bake, "stack_drift_rel") < 0.02);
    assert_eq!(figure(&bake, "fallen_fraction"), 0.0);
    assert_eq!(figure(&bake, "hanging"), 0.0);
    assert!(!bake.report.measures.contains_key("shape_iou"), "there is no shape to compare with");
}

#[test]
fn a_late_body_is_not_there_before_its_frame() {
    #[derive(Default)]
    struct Watcher(Vec<usize>);
    impl Observer for Watcher {
        fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
            ControlFlow::Continue(())
        }

        fn cpu_seconds(&mut self) -> f64 {
            0.0
        }

        fn wants_frames(&self) -> bool {
            true
        }

        fn frame(&mut self, frame: &Frame) {
            assert!(frame.bodies.iter().all(Option::is_some));
            self.0.push(frame.bodies.len());
        }
    }
    let mut bodies = tower(2);
    let velocity = DVec3::new(2.0, 0.0, 0.0);
    bodies.insert(0, PlacedBody { start: 12.0 / 24.0, velocity, ..PlacedBody::new(0, at(-3.0, 1.0, 5.0)) });
    let mut watcher = Watcher::default();
    let bake = bake(
        &bricks(bodies),
        &Params { output: cairn_input::params::Output { frames: Some(20), ..params().output }, ..params() },
        &mut watcher,
    )
    .unwrap();
    // Those of the beginning come first.
    assert_eq!(bake.pile.bodies.iter().map(|b| b.first_frame).collect::<Vec<_>>(), [0, 0, 12]);
    assert_eq!(watcher.0[..12], [2; 12]);
    assert_eq!(watcher.0[12..], [3; 9]);
    let place = |frame: usize| bake.pile.frames[frame][2].translation;
    assert!(place(12).distance(DVec3::new(-3.0, 1.0, 5.0)) < 0.01, "{}", place(12));
    assert!((place(14).x - place(12).x - 2.0 * 2.0 / 24.0).abs() < 1e-3, "it flies freely");
    assert_eq!(place(3), place(12), "before, it has the pose in which it appears");
}

#[test]
fn a_pinned_body_stays_while_others_are_filled_in_around_it() {
    let mut scene = scene(cone(0.7, 1.0), stick());
    scene.props.push(Prop { weight: 0.0, ..prop("brick", block(DVec3::new(0.4, 0.2, 0.2))) });
    let pose = at(0.1, 0.5, 0.0);
    scene.bodies = vec![PlacedBody { pinned: true, ..PlacedBody::new(1, pose) }];
    let mut params = params();
    params.release.order = ReleaseOrder::BottomUp;
    let bake = baked(&scene, &params);
    let kept = bake.pile.bodies.iter().position(|b| b.prop == 1).unwrap();
    assert!(bake.pile.bodies.len() > 20, "{} bodies", bake.pile.bodies.len());
    assert!(bake.pile.frames.iter().all(|f| f[kept].translation.distance(pose.translation) < 1e-6));
    assert!(figure(&bake, "penetration_max_rel") < 0.25);
    assert_eq!(figure(&bake, "hanging"), 0.0, "others may rest on it");
}

#[test]
fn a_pinned_body_is_released_at_its_time() {
    let until = 0.5;
    let bake = baked(
        &bricks(vec![PlacedBody { pinned: true, pinned_until: Some(until), ..PlacedBody::new(0, at(0.0, 1.0, 0.0)) }]),
        &params(),
    );
    let height = |frame: usize| bake.pile.frames[frame][0].translation.y;
    // It is released with the step that its time falls into.
    assert!((height(11) - 1.0).abs() < 1e-6 && (height(12) - 1.0).abs() < 0.01);
    assert!((bake.pile.frames.last().unwrap()[0].translation.y - 0.1).abs() < 0.02);
}

#[test]
fn an_emitter_lets_bodies_appear_at_its_rate() {
    let mut scene = bricks(Vec::new());
    let place = EmitterVolume::Box { center: DVec3::Y * 1.5, size: DVec3::new(2.0, 1.0, 2.0) };
    scene.emitters = vec![Emitter { place, props: vec![], rate: 24.0, count: 30, velocity: DVec3::ZERO, start: 0.25 }];
    let one = baked(&scene, &params());
    assert_eq!(one.pile.bodies.len(), 30);
    let there = |frame: usize| one.pile.bodies.iter().filter(|b| b.first_frame <= frame).count();
    assert_eq!(there(5), 0);
    for (frame, least) in [(6, 1), (16, 11), (35, 30)] {
        assert!((least..=least + 1).contains(&there(frame)), "{} bodies at frame {frame}", there(frame));
    }
    assert!(figure(&one, "resting_speed_max_rel") < 0.01);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(pool.install(|| baked(&scene, &params())).pile.frames, one.pile.frames);

    // A place that is full at once: the report counts the bodies that could not appear.
    let within = |center: DVec3, size: DVec3| EmitterVolume::Box { center, size };
    for (case, place, count, words) in [
        ("when there is room", within(DVec3::Y * 1.5, DVec3::new(2.0, 1.0, 2.0)), 4, ""),
        ("when it is full in the end", within(DVec3::Y * 0.2, DVec3::splat(0.1)), 1, ""),
        (
            "when it is full at once",
            within(DVec3::Y * 0.2, DVec3::splat(0.1)),
            30,
            "of 30 bodies could appear: there was no free spot left; make its place larger, or move it away from the \
             pile",
        ),
    ] {
        scene.emitters[0] = Emitter { place, count, ..scene.emitters[0].clone() };
        let bake = baked(&scene, &params());
        let said: Vec<&String> = bake.report.warnings.iter().filter(|w| w.starts_with("emitters.0: only ")).collect();
        assert_eq!(
            (said.len(), bake.pile.bodies.len() < count as usize),
            (!words.is_empty() as usize, !said.is_empty())
        );
        assert!(said.iter().all(|w| w.contains(words)), "{case}: {said:?}");
    }
}

#[test]
fn tilted_draws_stay_within_their_angle() {
    let mut scene = bricks(Vec::new());
    scene.props[0].tilt_max = 20.0;
    let place = EmitterVolume::Box { center: DVec3::Y * 9.0, size: DVec3::splat(8.0) };
    scene.emitters = vec![Emitter { place, props: vec![0], rate: 1e6, count: 60, velocity: DVec3::ZERO, start: 0.0 }];
    let mut params = params();
    params.output.frames = Some(1);
    let bake = baked(&scene, &params);
    let tilts: Vec<f64> =
        bake.pile.frames[1].iter().map(|p| (p.rotation * DVec3::Y).angle_between(DVec3::Y).to_degrees()).collect();
    assert!(tilts.len() > 30 && tilts.iter().all(|&t| t < 21.0));
    assert!(tilts.iter().any(|&t| t > 12.0));
}

#[test]
fn moving_scenery_takes_along_the_bodies_on_it() {
    let mut scene = bricks(vec![PlacedBody::new(0, at(0.0, 0.3, 0.0)), PlacedBody::new(0, at(0.0, 0.5, 0.0))]);
    let board = Model::new("board", block(DVec3::new(3.0, 0.2, 3.0)));
    let key = |time: f64, x: f64| Keyframe { time, pose: at(x, 0.1, 0.0) };
    scene.statics = vec![StaticModel { model: board, friction: 0.7, keys: vec![key(0.5, 0.0), key(2.5, 1.0)] }];
    let bake = baked(&scene, &params());
    let end = bake.pile.frames.last().unwrap();
    assert_eq!(bake.pile.scenery[0].last().unwrap().translation.x, 1.0);
    for body in end {
        assert!((body.translation.x - 1.0).abs() < 0.15, "{}", body.translation);
    }
    assert!(end[1].translation.y > 0.45, "the upper one is still on the lower one");
}

#[test]
fn a_blow_breaks_holds() {
    // A tower with a steel ball's weight of momentum against it: it must not stop the ball like a wall.
    let mut scene = bricks(tower(6));
    let velocity = DVec3::new(6.0, 0.0, 0.0);
    let ball = PlacedBody { velocity, start: 1.0, mass: Some(80.0), ..PlacedBody::new(0, at(-2.0, 0.7, 0.0)) };
    scene.bodies.push(ball);
    let mut params = params();
    let bake = baked(&scene, &params);
    assert!(figure(&bake, "stack_drift_rel") < 0.02, "until then it stands");
    assert!(bake.report.counts["held_peak"] >= 6);
    assert!(bake.report.counts["shaken"] >= 3);
    assert!(figure(&bake, "fallen_fraction") >= 0.3);
    // As far as without control, or nearly.
    params.control.mode = ControlMode::Off;
    let off = baked(&scene, &params);
    let reached = |bake: &Bake| bake.pile.frames.last().unwrap()[6].translation.x;
    assert!((reached(&bake) - reached(&off)).abs() < 0.5, "{} and {}", reached(&bake), reached(&off));
}

/// A heap of bricks takes the momentum of a ball of four times a brick's mass, as the same heap does in MuJoCo and
/// Bullet: bricks give way, and the ball keeps a part of its way and does not bounce back.
#[test]
fn a_heap_gives_way_to_a_ball() {
    let mut scene = scene(cone(0.8, 0.7), block(DVec3::new(0.24, 0.071, 0.115)));
    scene.props[0].density = 1900.0;
    scene.props.push(prop("ball", super::common::disc(0.15, 0.3)));
    let velocity = DVec3::new(8.0, 0.6, 0.0);
    let ball = PlacedBody { velocity, start: 3.0, mass: Some(14.0), ..PlacedBody::new(1, at(-2.0, 0.35, 0.1)) };
    scene.bodies.push(ball);
    let mut params = Params::new(Accuracy::Draft);
    params.glue.mode = GlueMode::Natural;
    let bake = baked(&scene, &params);
    let (frames, fps) = (&bake.pile.frames, bake.pile.fps);
    let (before, last) = (3 * fps as usize - 1, frames.len() - 1);
    let bricks = frames[before].len() - usize::from(frames[before].len() == frames[last].len());
    let moved = (0..bricks).filter(|&k| frames[before][k].translation.distance(frames[last][k].translation) > 0.05);
    let moved = moved.count();
    assert!((3..bricks / 2).contains(&moved), "{moved} of {bricks} bricks moved");
    let ball = |frame: usize| frames[frame][bricks].translation;
    let speeds: Vec<f64> = (before + 2..last).map(|f| (ball(f + 1) - ball(f)).length() * fps).collect();
    let hit = speeds.iter().position(|speed| *speed < 6.0).unwrap();
    let after = speeds[hit + 2];
    assert!((0.5..4.0).contains(&after), "{after} m/s after the hit: {speeds:?}");
    let back = (before + 2..last).map(|f| (ball(f + 1) - ball(f)).x * fps).fold(f64::INFINITY, f64::min);
    assert!(back > -2.5, "it comes back with {back} m/s");
}

/// A plank that juts out from a kept block, with a weight on its tail that is too light to hold it.
fn plank() -> Scene {
    let mut scene = bricks(vec![
        PlacedBody { pinned: true, scale: 2.0, ..PlacedBody::new(0, at(0.0, 0.2, 0.0)) },
        PlacedBody { mass: Some(2.0), ..PlacedBody::new(0, at(0.25, 0.6, 0.0)) },
        PlacedBody::new(1, at(0.7, 0.45, 0.0)),
    ]);
    scene.props.push(prop("plank", block(DVec3::new(1.2, 0.1, 0.2))));
    scene
}

#[test]
fn the_control_ends_at_its_time() {
    let mut params = params();
    params.control.selection = ContactSelection::All;
    params.control.until = Some(1.0);
    params.output.frames = Some(60);
    let bake = baked(&plank(), &params);
    let height = |frame: usize| bake.pile.frames[frame][2].translation.y;
    assert!((height(0) - height(22)).abs() < 0.01, "all contacts freeze it");
    assert!(height(60) < height(0) - 0.1, "then it falls");
}

#[test]
fn a_stand_leaves_the_pile_to_itself() {
    let mut params = Params::new(Accuracy::Draft);
    params.glue.mode = GlueMode::Natural;
    params.control.stand = Switch::On;
    let bake = baked(&scene(cone(0.7, 1.0), stick()), &params);
    assert!(
        figure(&bake, "shape_iou_after") > 0.8 * figure(&bake, "shape_iou"),
        "the report has the shape kept by standing"
    );
    assert!(figure(&bake, "resting_speed_max_rel") < 0.01);
    assert_eq!(figure(&bake, "hanging"), 0.0);
    params.control.mode = ControlMode::Off;
    let off = baked(&scene(cone(0.7, 1.0), stick()), &params);
    assert!(!off.report.measures.contains_key("shape_iou_after"), "without a control there is no end of it");
}

#[test]
fn a_stack_with_overlaps_settles_without_a_jump() {
    let overlaps = [0.05, 0.15, 0.25, 0.1];
    let mut y = 0.1;
    let mut bodies = vec![PlacedBody::new(0, at(0.0, y, 0.0))];
    for share in overlaps {
        y += 0.2 * (1.0 - share);
        bodies.push(PlacedBody::new(0, at(0.0, y, 0.0)));
    }
    let mut params = params();
    params.hold.least_seconds = 2.0;
    let bake = baked(&bricks(bodies), &params);
    let end = bake.pile.frames.last().unwrap();
    for frame in &bake.pile.frames {
        let above = |(a, b): (&Pose, &Pose)| a.translation.y - b.translation.y;
        assert!(
            frame.iter().zip(end).map(above).fold(0.0, f64::max) < 0.02,
            "a body jumps above where it comes to rest"
        );
    }
    assert!(figure(&bake, "penetration_max_rel") < 0.1, "{}", figure(&bake, "penetration_max_rel"));
    assert!((bake.pile.frames.last().unwrap()[4].translation.y - 0.9).abs() < 0.05);
}

#[test]
fn a_hard_drop_is_warned_of() {
    let mut scene = bricks(Vec::new());
    let place = |height: f64| EmitterVolume::Box { center: DVec3::Y * height, size: DVec3::ONE };
    let emitter = |height| Emitter {
        place: place(height),
        props: vec![],
        rate: 10.0,
        count: 3,
        velocity: DVec3::ZERO,
        start: 0.0,
    };
    scene.emitters = vec![emitter(1.0), emitter(20.0)];
    let plan = cairn_core::plan(&scene, &params()).unwrap();
    let warned: Vec<&String> = plan.warnings.iter().filter(|w| w.contains("energy")).collect();
    assert!(warned.len() == 1 && warned[0].starts_with("emitters.1"), "{warned:?}");
}

#[test]
fn all_problems_of_additions_are_reported_at_once() {
    let mut scene = bricks(vec![
        PlacedBody { prop: 7, ..PlacedBody::new(0, at(0.0, f64::NAN, 0.0)) },
        PlacedBody {
            pinned: true,
            velocity: DVec3::X,
            pinned_until: Some(-1.0),
            ..PlacedBody::new(0, at(0.0, 0.0, 0.0))
        },
    ]);
    scene.bodies[0].pose.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    let place = EmitterVolume::Box { center: DVec3::ZERO, size: DVec3::ZERO };
    scene.emitters =
        vec![Emitter { place, props: vec![], rate: 0.0, count: 200_000, velocity: DVec3::ZERO, start: 0.0 }];
    let key = Keyframe { time: 1.0, pose: Pose::IDENTITY };
    let model = Model::new("board", block(DVec3::ONE));
    scene.statics = vec![StaticModel { model, friction: 0.7, keys: vec![key, key] }];
    let Err(Error::Invalid(problems)) = cairn_core::plan(&scene, &params()) else { panic!("accepted") };
    for field in [
        "bodies.0.prop",
        "bodies.0.position.1",
        "bodies.0.rotation",
        "bodies.1.kept",
        "bodies.1.kept_until",
        "emitters.0.size.0",
        "emitters.0.rate",
        "emitters.0.count",
        "emitters",
        "statics.0.keyframes.1.frame",
    ] {
        assert!(problems.iter().any(|p| p.field == field), "{field} is missing in {problems:#?}");
    }
    let none = Scene { props: scene.props.clone(), ..Scene::default() };
    assert!(matches!(cairn_core::plan(&none, &params()), Err(Error::Invalid(_))), "nothing to bake");
}

/// Keeps every frame's states.
#[derive(Default)]
struct States(Vec<Vec<State>>);

impl Observer for States {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        0.0
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame) {
        self.0.push(frame.bodies.iter().map(|shown| shown.unwrap().state).collect());
    }
}

#[test]
fn frames_show_how_the_control_treats_each_body() {
    let kept = PlacedBody { pinned: true, ..PlacedBody::new(0, at(2.0, 0.1, 0.0)) };
    let late = PlacedBody { start: 2.0 / 24.0, ..PlacedBody::new(0, at(5.0, 0.1, 0.0)) };
    let mut scene = bricks([tower(3), vec![kept, late]].concat());
    scene.region = Some(Model::new("region", block(DVec3::splat(8.0))));
    let mut params = params();
    params.release.order = ReleaseOrder::BottomUp;
    params.control.mode = ControlMode::Hold;
    params.control.stand = Switch::Off;
    let mut states = States::default();
    bake(&scene, &params, &mut states).unwrap();
    use State::{Held, Outside, Pinned, Waiting};
    assert_eq!(states.0[0], [Waiting, Waiting, Waiting, Pinned]);
    let is_outside = |states: &Vec<State>| states.get(4) == Some(&Outside);
    assert!(states.0.iter().any(is_outside), "it is not judged");
    assert_eq!(states.0.last().unwrap()[..], [Held, Held, Held, Pinned, Held], "but held once it rests");

    params.control.mode = ControlMode::Off;
    let mut states = States::default();
    bake(&scene, &params, &mut states).unwrap();
    assert!(states.0.iter().flatten().all(|&state| state == State::Free));
}

/// A stack that is taken apart.
fn taken_apart(bodies: Vec<PlacedBody>, choices: &[RemovalChoice]) -> Bake {
    let removals = choices.iter().map(|&choice| RemovalRequest { choice, start: None }).collect();
    baked(&Scene { removals, ..bricks(bodies) }, &params())
}

#[test]
fn a_tower_is_taken_apart_from_the_top() {
    let bake = taken_apart(tower(3), &[RemovalChoice::Order { most: 9 }]);
    let removed = &bake.report.removals;
    assert_eq!(removed.iter().map(|one| one.body).collect::<Vec<_>>(), [2, 1, 0]);
    for one in removed {
        let forecast = one.forecast.as_ref().unwrap();
        assert!(forecast.is_safe && one.moved.is_empty() && one.at_rest, "{one:?}");
        assert!(one.frame < one.rest_frame, "it takes its time: {} to {}", one.frame, one.rest_frame);
    }
    // On the ground beside the pile, one after the other.
    let last = bake.pile.frames.last().unwrap();
    assert!(last.iter().all(|pose| (pose.translation.y - 0.1).abs() < 0.01), "{last:?}");
    assert!(0.5 < last[2].translation.x && last[2].translation.x + 0.4 < last[1].translation.x);
    assert!(last[1].translation.x + 0.4 < last[0].translation.x);
    // Before it leaves, the forces of the contacts carry the weights above.
    let weight = 0.4 * 0.2 * 0.2 * 500.0 * 9.81;
    let down = |body: usize| {
        let of = removed[0].touches.iter().filter(|touch| touch.body == body && touch.other.is_none());
        of.map(|touch| touch.force[1]).sum::<f64>()
    };
    assert!((down(0) - 3.0 * weight).abs() < 1e-3 * weight, "{}", down(0));
    // In the middle of its way it is above all others.
    let middle = &bake.pile.frames[(removed[1].frame + removed[1].rest_frame) / 2 - 2];
    assert!(middle[1].translation.y > 0.3, "{middle:?}");
}

#[test]
fn what_rests_on_a_removed_body_comes_down() {
    let named = |number| RemovalChoice::Named { prop: Some(0), number };
    let bake = taken_apart(tower(3), &[named(0), named(0), named(7)]);
    let [one] = &bake.report.removals[..] else { panic!("one left") };
    assert_eq!((one.body, &one.rest_on_it[..], &one.came_down[..]), (0, &[1, 2][..], &[1, 2][..]));
    let forecast = one.forecast.as_ref().unwrap();
    assert!(!forecast.is_safe && forecast.moving.contains(&1), "{forecast:?}");
    assert!((one.after[2].translation.y - 0.3).abs() < 0.02, "one lower: {:?}", one.after[2]);
    assert_eq!((one.before[2].translation.y * 10.0).round(), 5.0);
    for number in [1, 2] {
        let note = format!("remove.{number}: there is no such body");
        assert!(bake.report.warnings.iter().any(|text| text.starts_with(&note)), "{:?}", bake.report.warnings);
    }
    // The order of chance is the same for the same seed; what is not safe may go first.
    let chance = |most| taken_apart(tower(4), &[RemovalChoice::Any { most }]).report.removals;
    let bodies = |removed: Vec<RemovedBody>| removed.iter().map(|one| one.body).collect::<Vec<_>>();
    assert_eq!(bodies(chance(4))[..2], bodies(chance(2))[..]);
}

#[test]
fn removals_wait_for_their_time_and_need_a_pile_without_glue() {
    let choice = RemovalChoice::Safe { most: 1 };
    let mut scene = bricks(tower(2));
    scene.removals = vec![RemovalRequest { choice, start: Some(3.0) }];
    let bake = baked(&scene, &params());
    assert_eq!(bake.report.removals[0].frame, 72);
    let mut glued = params();
    glued.glue.mode = GlueMode::AsModelled;
    scene.removals.push(RemovalRequest { choice: RemovalChoice::Any { most: 0 }, start: Some(-1.0) });
    let Err(Error::Invalid(problems)) = cairn_core::bake(&scene, &glued, &mut Silent) else { panic!("it is glued") };
    let fields: Vec<&str> = problems.iter().map(|problem| &*problem.field).collect();
    assert_eq!(fields, ["glue.mode", "remove.1.start", "remove.1.count"]);
    // Too few frames: said, not lost.
    let mut short = params();
    short.output.frames = Some(40);
    scene.removals.pop();
    let bake = baked(&scene, &short);
    assert!(bake.report.removals.is_empty() && bake.pile.frames.len() == 41);
    assert!(
        bake.report.warnings.iter().any(|text| text.contains("before the last frame")),
        "{:?}",
        bake.report.warnings
    );
}

#[test]
fn without_a_ground_bodies_that_miss_the_scenery_are_set_aside() {
    let mut scene = bricks(vec![PlacedBody::new(0, at(0.0, 0.1, 0.0)), PlacedBody::new(0, at(9.0, 0.1, 0.0))]);
    let params = Params { ground: false, ..params() };
    let Err(Error::Invalid(problems)) = bake(&scene, &params, &mut Silent) else { panic!("nothing to fall on") };
    assert_eq!(problems.iter().map(|p| &*p.field).collect::<Vec<_>>(), ["ground"]);
    let mut mesh = block(DVec3::new(4.0, 1.0, 4.0));
    mesh.points.iter_mut().for_each(|p| p.y -= 0.5);
    scene.statics = vec![StaticModel { model: Model::new("table", mesh), friction: 0.7, keys: Vec::new() }];
    let bake = baked(&scene, &params);
    let last = bake.pile.frames.last().unwrap();
    assert!(last[0].translation.distance(DVec3::new(0.0, 0.1, 0.0)) < 0.02, "the table carries it");
    // From 50 diameters below the table's underside on.
    assert!((-40.0..-24.0).contains(&last[1].translation.y), "{}", last[1].translation);
    let warnings = &bake.report.warnings;
    assert!(warnings.iter().any(|text| text.starts_with("1 body fell past the scenery")), "{warnings:?}");

    scene.bodies.remove(0);
    assert_eq!(baked(&scene, &params).pile.bodies.len(), 1, "even if nothing is left");
}
