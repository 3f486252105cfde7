//! The method end to end on small piles: promises of a bake that hold for every scene.

use super::common::{block, cone, disc, scene, stick};
use cairn_core::bake;
use cairn_core::cache::NoCache;
use cairn_core::report::TIMED_FIGURES;
use cairn_engine::shape::hull_mesh;
use cairn_engine::world::Role;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::{Observer, Progress, Silent};
use cairn_input::params::{Accuracy, ControlMode, FillMethod, GlueMode, Params, Switch};
use cairn_input::scene::Scene;
use glam::DVec3;
use std::ops::ControlFlow;

fn params() -> Params {
    natural(Params::new(Accuracy::Draft))
}

/// Held by the control to the end, and not glued.
fn natural(mut params: Params) -> Params {
    params.glue.mode = GlueMode::Natural;
    params.control.stand = Switch::Off;
    params
}

#[test]
fn a_cone_of_sticks_keeps_its_shape_and_comes_to_rest() {
    let scene = scene(cone(0.9, 2.0), stick());
    // Single props may stand out of a natural surface by 0.15 d; those that were parted stick out of a cast one by
    // little more than they may.
    for (surface, out, inside) in [(0.5, 0.3, 0.95), (1.0, 0.15, 0.98)] {
        let mut params = natural(Params::new(Accuracy::Standard));
        params.fill.surface = surface;
        let bake = bake(&scene, &params, &mut Silent).unwrap();
        let figure = |name: &str| bake.report.measures[name].unwrap();
        assert!(bake.pile.bodies.len() > 25, "{} bodies", bake.pile.bodies.len());
        assert!(figure("fill_fraction") > 0.3, "fill {}", figure("fill_fraction"));
        assert!(figure("kept_shape") > 0.95, "kept {}", figure("kept_shape"));
        assert!(figure("protrusion_rel") <= out, "surface {surface}: {}", figure("protrusion_rel"));
        assert!(figure("penetration_max_rel") < 0.25);
        assert!(figure("resting_speed_max_rel") < 0.01);
        assert_eq!(figure("hanging"), 0.0);
        assert!(figure("unsupported_fraction") <= 0.05);
        assert!(figure("inside_fraction") > inside, "surface {surface}: inside {}", figure("inside_fraction"));
        assert!(bake.report.counts["candidates"] > 0);
    }
}

/// Mugs jam in a box that is fuller than full: those for which there is no room go, and few others.
#[test]
fn what_is_locked_in_is_taken_out() {
    let mut mug = disc(0.05, 0.1);
    for foot in mug.points.iter_mut().filter(|p| p.y < 0.0) {
        *foot *= DVec3::new(0.8, 1.0, 0.8);
    }
    let scene = scene(block(DVec3::splat(0.42)), mug);
    let mut params = Params::new(Accuracy::Standard);
    params.output.frames = Some(1);
    for seed in [3, 4] {
        params.seed = seed;
        let bake = bake(&scene, &params, &mut Silent).unwrap();
        let (deepest, bodies) = (bake.report.measures["penetration_max_rel"].unwrap(), bake.pile.bodies.len());
        assert!(deepest <= 8.0 * params.fill.residual_overlap && bodies >= 60, "{seed}: {deepest} in {bodies} bodies");
    }
}

#[test]
fn the_same_request_gives_the_same_bits_for_any_number_of_threads() {
    // Large enough that the engine shares its work.
    let scene = scene(cone(1.3, 1.6), stick());
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| bake(&scene, &params(), &mut Silent).unwrap())
    };
    // Times differ; figures made of them are left out.
    let timeless = |b: &cairn_core::report::bake::Bake| {
        let mut m = b.report.measures.clone();
        m.retain(|name, _| !TIMED_FIGURES.contains(&&**name));
        m
    };
    let one = run(1);
    assert!(one.pile.bodies.len() > 80, "{} bodies", one.pile.bodies.len());
    for threads in [2, 4] {
        let other = run(threads);
        assert_eq!(one.pile.frames, other.pile.frames);
        assert_eq!(one.pile.bodies, other.pile.bodies);
        assert_eq!(timeless(&one), timeless(&other));
    }
}

#[test]
fn bakes_that_share_their_threads_do_not_wait_for_each_other() {
    let scene = scene(cone(1.3, 1.6), stick());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let bodies = || bake(&scene, &params(), &mut Silent).unwrap().pile.bodies;
    let (one, other) = pool.install(|| rayon::join(bodies, bodies));
    assert_eq!(one, other);
}

#[test]
fn another_seed_gives_another_pile() {
    let scene = scene(cone(0.8, 1.2), stick());
    let run = |seed| bake(&scene, &Params { seed, ..params() }, &mut Silent).unwrap();
    assert_ne!(run(1).pile.frames, run(2).pile.frames);
}

#[test]
fn a_scene_a_thousand_times_smaller_or_larger_gives_the_same_pile() {
    let normal = scene(cone(0.6, 0.9), stick());
    let bake = |scene: &Scene, fps: f64| {
        let mut params = natural(Params::new(Accuracy::Standard));
        params.output.fps = fps;
        bake(scene, &params, &mut Silent).unwrap()
    };
    // A power of two changes no digit of any coordinate. Time goes with the root of the size: as many frames to a fall.
    for (factor, fps) in [(1.0 / 1024.0, 24.0), (1024.0, 32.0)] {
        let a = bake(&normal, fps);
        let mut scaled = normal.clone();
        let control = scaled.control.as_mut().unwrap();
        control.mesh = control.mesh.scaled(factor);
        scaled.props[0].model.mesh = scaled.props[0].model.mesh.scaled(factor);
        let b = bake(&scaled, fps / f64::sqrt(factor));
        assert_eq!(a.pile.bodies.len(), b.pile.bodies.len());
        assert_eq!(a.report.counts["steps"], b.report.counts["steps"]);
        let apart = |(p, q): (&Pose, &Pose)| p.translation.distance(q.translation / factor);
        let largest = a.pile.frames[0].iter().zip(&b.pile.frames[0]).map(apart).fold(0.0, f64::max);
        assert!(largest < 1e-5, "the piles differ by {largest} m");
        for name in
            ["penetration_mean_rel", "penetration_max_rel", "kept_shape", "fill_fraction", "unsupported_fraction"]
        {
            let (x, y) = (a.report.measures[name].unwrap(), b.report.measures[name].unwrap());
            assert!((x - y).abs() <= 1e-3 * x.abs().max(0.01), "{name}: {x}, {factor} times as large {y}");
        }
    }
}

/// Accuracies do as the estimates say: the order of the expected costs is that of the work counted, and a draft sinks
/// in most. (Between `standard` and `fine`, penetration in so small a pile differs more by seed; and glue keeps the
/// overlaps of the fill, so that the pile is natural.)
#[test]
fn a_more_accurate_bake_does_more_work_and_sinks_in_less() {
    let scene = scene(cone(0.6, 1.2), stick());
    let ladder = [Accuracy::Draft, Accuracy::Standard, Accuracy::Fine].map(|accuracy| {
        let mut params = Params::new(accuracy);
        params.glue.mode = GlueMode::Natural;
        params
    });
    let expected = cairn_core::estimates(&scene, &ladder[0], &ladder, 1.0).unwrap();
    let baked = ladder.each_ref().map(|params| {
        let report = bake(&scene, params, &mut Silent).unwrap().report;
        let substeps = report.counts["steps"] * u64::from(params.physics.substeps)
            + report.counts["fill_steps"] * u64::from(params.fill_physics(1.0).substeps);
        (substeps, report.measures["penetration_mean_rel"].unwrap())
    });
    for k in 1..ladder.len() {
        assert!(baked[k - 1].0 < baked[k].0, "substeps: {baked:?}");
        assert!(baked[0].1 > baked[k].1, "penetration: {baked:?}");
        assert!(expected[k - 1].cpu_seconds < expected[k].cpu_seconds, "{expected:?}");
    }
}

#[test]
fn a_slower_machine_and_more_bodies_are_expected_to_take_longer() {
    let seconds = |factor: f64, machine: f64| {
        let scene = scene(cone(0.6 * factor, 1.2 * factor), stick());
        let params = [Params::new(Accuracy::Standard)];
        cairn_core::estimates(&scene, &params[0], &params, machine).unwrap()[0].cpu_seconds
    };
    let here = seconds(1.0, 1.0);
    assert!((seconds(1.0, 3.0) / here - 3.0).abs() < 1e-12);
    // Eight times the bodies.
    assert!(seconds(2.0, 1.0) > 4.0 * here, "{} s, and {here} s for an eighth", seconds(2.0, 1.0));
}

#[test]
fn every_held_body_was_certified_in_its_latest_cycle() {
    let scene = scene(cone(0.7, 1.55), stick());
    let params = params();
    let full = cairn_core::fill_container(&scene, &params, &mut NoCache, &mut Silent).unwrap();
    let mut sim = full.turn_over(&scene, &params).unwrap();
    for id in sim.pile.world.present().collect::<Vec<_>>() {
        sim.pile.release(id);
    }
    let mut held_ever = 0;
    for _ in 0..200 {
        sim.advance(&mut Silent, cairn_input::observer::Stage::Hold, |_| 0.0).unwrap();
        for (id, body) in sim.pile.world.bodies().iter().enumerate() {
            if body.role == Role::Frozen {
                assert!(sim.pile.control.candidates()[id], "body {id} is held without a certificate");
                held_ever += 1;
            }
        }
    }
    assert!(held_ever > 0);
}

#[test]
fn without_control_nothing_is_analysed_held_or_nailed() {
    let scene = scene(cone(0.8, 1.2), stick());
    let mut params = params();
    params.control.mode = ControlMode::Off;
    let counts = bake(&scene, &params, &mut Silent).unwrap().report.counts;
    for name in ["control_cycles", "analyses", "candidates", "nails_driven", "held_peak"] {
        assert_eq!(counts[name], 0, "{name}");
    }
}

#[test]
fn a_nailed_pile_comes_to_rest() {
    let scene = scene(cone(0.8, 1.2), stick());
    let mut params = params();
    params.control.mode = ControlMode::Nails;
    let bake = bake(&scene, &params, &mut Silent).unwrap();
    assert!(bake.report.counts["nails_driven"] > 0);
    assert!(bake.report.measures["resting_speed_max_rel"].unwrap() < 0.01);
}

#[test]
fn a_pour_fills_through_the_opening() {
    let scene = scene(cone(0.7, 1.55), stick());
    let mut params = params();
    params.fill.method = FillMethod::Pour;
    let report = bake(&scene, &params, &mut Silent).unwrap().report;
    assert!(report.measures["fill_fraction"].unwrap() > 0.12, "fill {:?}", report.measures["fill_fraction"]);
    assert!(report.measures["protrusion_rel"].unwrap() <= 0.05);
    // Bodies that the container held must stand by themselves; the odd stick may slide off a poured pile.
    assert!(report.measures["inside_fraction"].unwrap() > 0.98);
}

#[test]
fn frames_do_not_pace_the_physics() {
    let scene = scene(cone(0.8, 1.2), stick());
    let run = |fps| {
        let mut params = params();
        params.output.fps = fps;
        bake(&scene, &params, &mut Silent).unwrap()
    };
    let (slow, fast) = (run(12.0), run(48.0));
    assert_eq!(slow.report.counts["steps"], fast.report.counts["steps"]);
    for (k, frame) in slow.pile.frames.iter().enumerate() {
        assert_eq!(frame, &fast.pile.frames[4 * k], "frame {k}");
    }
}

#[test]
fn the_number_of_frames_is_what_was_asked_for() {
    let scene = scene(cone(0.8, 1.2), stick());
    let mut params = params();
    params.output.frames = Some(10);
    assert_eq!(bake(&scene, &params, &mut Silent).unwrap().pile.frames.len(), 11);
}

#[test]
fn a_cancel_ends_the_bake_at_the_next_step() {
    struct After(u32);
    impl Observer for After {
        fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
            self.0 = self.0.saturating_sub(1);
            if self.0 == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        }

        fn cpu_seconds(&mut self) -> f64 {
            0.0
        }
    }
    let scene = scene(cone(0.8, 1.2), stick());
    for calls in [1, 2, 50] {
        let end = bake(&scene, &params(), &mut After(calls));
        assert!(matches!(end, Err(cairn_core::Error::Cancelled)), "after {calls} calls");
    }
}

#[test]
fn all_problems_of_a_scene_are_reported_at_once() {
    let mut scene = scene(cone(0.8, 1.2), stick());
    scene.control.as_mut().unwrap().mesh.triangles.truncate(1);
    scene.props[0].weight = f64::NAN;
    scene.props[0].model.mesh = scene.props[0].model.mesh.scaled(10.0);
    let mut params = params();
    params.physics.substeps = 0;
    let Err(cairn_core::Error::Invalid(problems)) = cairn_core::plan(&scene, &params) else { panic!("accepted") };
    for part in ["physics.substeps", "is open", "weight", "larger than the control mesh"] {
        assert!(problems.iter().any(|p| p.text.contains(part)), "{part} is missing in {problems:#?}");
    }
}

/// A cube with a hollow inside, of walls this thick.
fn shell(thickness: f64) -> TriMesh {
    let cube = |half: f64| {
        let corner = |k: u32| DVec3::from_array([0, 1, 2].map(|axis| if k >> axis & 1 == 0 { -half } else { half }));
        hull_mesh(&(0..8).map(corner).collect::<Vec<_>>())
    };
    let (mut solid, mut hollow) = (cube(1.0), cube(1.0 - thickness));
    hollow.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    solid.append(&hollow);
    solid
}

#[test]
fn a_shell_thinner_than_the_props_is_refused_before_any_work() {
    let planned = |thickness: f64| cairn_core::plan(&scene(shell(thickness), stick()), &params());
    let stick = stick().bounds().1 - stick().bounds().0;
    let Err(cairn_core::Error::Invalid(problems)) = planned(0.7 * stick.min_element()) else { panic!("accepted") };
    assert!(problems.iter().any(|p| p.text.contains("as thick as the thinnest prop")), "{problems:#?}");
    for thick in [1.2 * stick.min_element(), 0.9] {
        let plan = planned(thick).unwrap_or_else(|problems| panic!("{thick}: {problems}"));
        assert!(!plan.warnings.iter().any(|w| w.contains("as thick as")), "{:?}", plan.warnings);
    }
}
