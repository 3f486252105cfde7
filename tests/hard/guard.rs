//! The guard against provoked faults: what no scene does by itself is put into a pile from outside.

use super::rows::engines::{Engine, FPS, params};
use super::rows::places::in_a_row;
use super::rows::scenes::{at, block, placed, prop};
use cairn_core::cache::NoCache;
use cairn_core::{Error, bake};
use cairn_engine::shape;
use cairn_engine::world::{Insertion, Role, Units, World};
use cairn_geometry::pose::Pose;
use cairn_input::observer::{Silent, Stage};
use cairn_input::params::{Accuracy, Params, Switch, Time};
use cairn_input::scene::{Keyframe, Model, Scene, StaticModel};
use cairn_motion::guard::{AsideReason, Guard};
use cairn_motion::pile::Pile;
use cairn_prepare::check;
use cairn_prepare::effects::Resolved;
use glam::DVec3;

const BODIES: usize = 10;

fn stacks() -> Scene {
    let pose = |k: usize| at((k / 5) as f64, 0.1 * ((k % 5) as f64 + 0.5), 0.0);
    placed(prop("cube", block(DVec3::splat(0.1)), 0.5), (0..BODIES).map(pose))
}

/// Two stacks of five; `fault` meddles with the world before each step.
fn provoked(params: &Params, steps: u64, fault: impl Fn(&mut Pile, u64)) -> Result<Outcome, Error> {
    run(&stacks(), params, steps, fault)
}

/// One cube under a plate that comes down on it: from above to this height in this time.
fn pressed(to: f64, seconds: f64) -> Outcome {
    let mut scene = placed(prop("cube", block(DVec3::splat(0.1)), 0.5), [at(0.0, 0.05, 0.0)]);
    let plate = Model::new("plate", block(DVec3::new(4.0, 0.2, 4.0)));
    let key = |time: f64, low: f64| Keyframe { time, pose: at(0.0, low + 0.1, 0.0) };
    scene.statics =
        vec![StaticModel { model: plate, friction: 0.5, keys: vec![key(0.2, 0.12), key(0.2 + seconds, to)] }];
    run(&scene, &uncontrolled(), 200, |_, _| {}).unwrap()
}

fn run(scene: &Scene, params: &Params, steps: u64, fault: impl Fn(&mut Pile, u64)) -> Result<Outcome, Error> {
    let full = cairn_core::fill_container(scene, params, &mut NoCache, &mut Silent)?;
    let mut sim = full.turn_over(scene, params)?;
    let all: Vec<usize> = sim.pile.world.present().collect();
    all.into_iter().for_each(|id| sim.pile.release(id));
    for step in 0..steps {
        fault(&mut sim.pile, step);
        sim.advance(&mut Silent, Stage::Hold, |_| 0.0)?;
    }
    let actions = sim.guard.actions.clone();
    let world = &sim.pile.world;
    let fastest = world.present().map(|id| world.speed(id)).fold(0.0, f64::max);
    Ok(Outcome { aside: actions.aside, retries: actions.retries, stiffened: actions.stiffened, fastest })
}

#[derive(Debug)]
struct Outcome {
    aside: Vec<(usize, AsideReason)>,
    retries: u64,
    stiffened: u64,
    fastest: f64,
}

fn launch(pile: &mut Pile, id: usize, velocity: DVec3) {
    pile.world.set_role(id, Role::Free);
    pile.world.launch(id, velocity, DVec3::ZERO);
}

fn uncontrolled() -> Params {
    params(Engine::Uncontrolled, 1.0)
}

#[test]
fn nothing_is_done_where_nothing_is_wrong() {
    let found = provoked(&uncontrolled(), 200, |_, _| {}).unwrap();
    assert_eq!((found.aside.len(), found.retries, found.stiffened), (0, 0, 0), "{found:?}");
}

#[test]
fn what_is_no_number_is_set_aside() {
    let found = provoked(&uncontrolled(), 60, |pile, step| {
        if step == 20 {
            launch(pile, 2, DVec3::splat(f64::NAN));
        }
    });
    assert_eq!(found.unwrap().aside, [(2, AsideReason::NotFinite)]);
}

#[test]
fn what_is_too_fast_is_tried_again_and_set_aside() {
    let found = provoked(&uncontrolled(), 60, |pile, step| {
        if step == 20 {
            launch(pile, 4, DVec3::new(0.0, 60.0, 0.0));
        }
    });
    let found = found.unwrap();
    assert_eq!(found.aside, [(4, AsideReason::TooFast)]);
    assert!(found.retries > 0 && found.fastest < 1.0, "{found:?}");
}

/// The same world without its ground.
#[test]
fn what_falls_through_the_ground_is_set_aside() {
    let (scene, params) = (stacks(), uncontrolled());
    let checked = check::run(&scene, &params).unwrap();
    let shapes = shape::run(&scene, &params, &checked.sizes, &mut Silent).unwrap();
    let units = Units::new(checked.diameter, shapes[0].mass, params.gravity);
    let mut world = World::new(units, &params.physics, 0.5, false);
    let pose = Pose { translation: DVec3::Y, ..Pose::IDENTITY };
    world.insert(&shapes[0], &Insertion { prop: 0, scale: 1.0, pose, friction: 0.5, restitution: 0.0 }).unwrap();
    let summaries: Vec<_> = shapes.iter().map(|shape| shape.summary()).collect();
    let mut guard = Guard::new(&scene, &params, &Resolved::new(&scene, &params, &checked, &summaries), units, 0.0);
    (0..60).for_each(|_| guard.step(&mut world).unwrap());
    assert_eq!(guard.actions.aside, [(0, AsideReason::BelowGround)]);
    assert!(!world.is_present(0));
}

/// A plate presses it to a third of its height.
#[test]
fn bodies_deep_in_each_other_meet_stiffer_contacts() {
    let found = pressed(0.035, 1.0);
    assert!(found.stiffened > 0 && found.aside.is_empty(), "{found:?}");
}

#[test]
fn too_many_set_aside_end_the_bake_with_a_remedy() {
    // The remedy names the step in the unit of the scene.
    let mut params = uncontrolled();
    params.physics.step = Time::Seconds(1.0 / 240.0);
    let end = provoked(&params, 60, |pile, step| {
        if step == 20 {
            (0..6).for_each(|id| launch(pile, id, DVec3::new(0.0, 60.0 + id as f64, 0.0)));
        }
    });
    let Err(Error::Invalid(problems)) = end else { panic!("it went on") };
    assert_eq!(problems[0].field, "physics.substeps", "{problems:?}");
    for part in ["does not stay stable", "lower physics.step_seconds"] {
        assert!(problems[0].text.contains(part), "no {part}: {problems:?}");
    }
}

/// Steps twenty times too long.
fn long_steps(guard: Switch, contact_frequency: f64) -> Params {
    let mut params = uncontrolled();
    params.physics.step = Time::Natural(1.0);
    params.physics.substeps = 1;
    params.physics.contact_damping_ratio = 0.1;
    params.physics.contact_frequency = contact_frequency;
    params.effects.guard = guard;
    params
}

/// With springs that ring, besides: such springs get the substeps that they need, and the stacks stay where they stand.
/// That is seen in the frames, not in what the report says.
#[test]
fn a_bad_setting_is_held_together() {
    let scene = stacks();
    let frames = bake(&scene, &long_steps(Switch::Auto, 400.0), &mut Silent).unwrap().pile.frames;
    assert_eq!(frames.len(), 61);
    for (number, frame) in frames.iter().enumerate() {
        for (body, (pose, given)) in frame.iter().zip(&scene.bodies).enumerate() {
            let moved = pose.translation.distance(given.pose.translation);
            assert!(moved < 0.01, "body {body} is {moved} m away from its place in frame {number}");
        }
    }
}

/// Cubes far in each other, a thousand times as heavy one on top: such steps gain energy. The report says so where the
/// guard takes them again, and says nothing where there is no guard, or nothing to do for it.
#[test]
fn what_the_guard_does_is_told() {
    let pose = |k: usize| at(0.04 * (k % 3) as f64, 0.05 + 0.04 * (k / 3) as f64, 0.0);
    let mut squeezed = placed(prop("cube", block(DVec3::splat(0.1)), 0.5), (0..12).map(pose));
    squeezed.bodies[11].mass = Some(1000.0);
    let warnings = |scene: &Scene, guard: Switch| {
        let report = bake(scene, &long_steps(guard, 20.0), &mut Silent).unwrap().report;
        let is_told = report.warnings.iter().any(|text| text.contains("repeated in smaller ones"));
        (report.counts["guard_retries"] > 0, is_told, report.counts["guard_steps"] > 0)
    };
    assert_eq!(warnings(&squeezed, Switch::Auto), (true, true, true));
    assert_eq!(warnings(&squeezed, Switch::Off), (false, false, false));
    assert_eq!(warnings(&stacks(), Switch::Auto), (false, false, true));
}

/// Links that pull each other taut meet in many points of many convex parts at once, and the solver gives them energy:
/// 10 J/kg where the chain swings, 6 where it is a bridge. The guard lets none of it be seen: in the frames, no more is
/// there than at the beginning, but for what lifts bodies that were placed in each other.
#[test]
fn chains_pulled_taut_gain_no_energy() {
    const LIFT: f64 = 0.25;
    let cases = [(0.99, false), (1.0, true), (1.05, true)];
    for (accuracy, (share, is_bridge)) in
        [Accuracy::Standard, Accuracy::Fine].into_iter().flat_map(|accuracy| cases.map(|case| (accuracy, case)))
    {
        let settings = params(Engine::Uncontrolled, 3.0);
        let fine = Params::new(accuracy);
        let settings = Params { accuracy, physics: fine.physics, ..settings };
        let scene = in_a_row(share, is_bridge);
        let bake = bake(&scene, &settings, &mut Silent).unwrap();
        let frames = &bake.pile.frames;
        // Mean height and speed, in J/kg; what turns has some more.
        let energy = |frame: usize| {
            let of = |body: usize| {
                let [before, now, after] = [frame - 1, frame, frame + 1].map(|f| frames[f][body].translation);
                9.81 * now.y + ((after - before) * FPS / 2.0).length_squared() / 2.0
            };
            (0..scene.bodies.len()).map(of).sum::<f64>() / scene.bodies.len() as f64
        };
        let (first, most) = (energy(1), (1..frames.len() - 1).map(energy).fold(0.0, f64::max));
        assert!(most < first + LIFT, "{accuracy:?}, {share}, {is_bridge}: {first} to {most} J/kg");
    }
}
