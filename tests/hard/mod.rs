//! The hard cases: what breaks simulators must not break this one. `README.md` beside this file describes the figures;
//! the rows whose verdict is one of statics (boundary, units, duplicate, collinear, arch, wedge, and the verdicts of
//! slope and overhang) are tests of the analysis in `server/statics/tests/equilibrium/`.
//!
//! The full size of the shortened rows: `cargo test --release --test all hard:: -- --ignored`. The long run of the
//! stability sweep: `cargo study sweep`.

mod guard;
#[path = "../studies/problems/problem/mod.rs"]
mod problem;
mod problems;
mod rows;
mod sweep;

use proptest::test_runner::{
    Config, FileFailurePersistence, RngAlgorithm, TestCaseError, TestError, TestRng, TestRunner,
};
use rows::{Extent, Row};
use std::path::Path;
use sweep::Verdict;

/// Runs a row with what must pass it. An expected failure must fail: once it passes, it is none any more.
fn check(name: &str, extent: Extent) {
    let row: &Row = rows::of(name);
    for &engine in row.judged {
        let outcome = (row.run)(engine, extent);
        println!("{name}, {engine:?}: {}", outcome.summary);
        match row.miss(engine, extent) {
            None => {
                assert!(outcome.passed, "{name}, {engine:?}: {}; it passes when: {}", outcome.summary, row.passes_when)
            }
            Some(why) => {
                assert!(!outcome.passed, "{name} passes now ({}): it was to fail, since {why}", outcome.summary)
            }
        }
    }
}

macro_rules! rows {
    ($($name:ident),* $(,)?) => {
        $(#[test] fn $name() { check(stringify!($name), Extent::Short) })*

        #[test]
        fn every_row_is_a_test() {
            let tested = [$(stringify!($name)),*];
            assert!(rows::ROWS.iter().all(|row| tested.contains(&row.name)) && tested.len() == rows::ROWS.len());
        }
    };
}

rows!(
    card_tower,
    card_thin,
    card_pull,
    heavy_on_light,
    heaviest_on_light,
    heaviest_is_told,
    tower,
    thin_stack,
    edge_hover,
    overhang,
    slope,
    projectile,
    needles,
    overlap,
    coincident,
    nan_inside,
    spin,
    zero_g,
    far,
    fast_scenery,
    conveyor,
    turntable,
    chain,
    falls_once,
    balls,
    rolling,
    rest_sticks,
    rest_bananas,
    long,
    many,
    degenerate_mesh,
    bad_container,
    scaled_node,
);

macro_rules! full {
    ($($name:ident: $row:ident),* $(,)?) => {
        $(#[test] #[ignore = "minutes"] fn $name() { check(stringify!($row), Extent::Full) })*
    };
}

full!(
    card_tower_full: card_tower, card_thin_full: card_thin, tower_full: tower, balls_full: balls,
    rest_sticks_full: rest_sticks, rest_bananas_full: rest_bananas, long_full: long, many_full: many,
);

/// Thirty random scenes, always the same, after those that failed once (`sweep/failures.txt`).
#[test]
fn thirty_random_scenes_are_sound() {
    let failures = concat!(env!("CAIRN_REPOSITORY"), "/tests/hard/sweep/failures.txt");
    let config = Config {
        cases: 30,
        max_shrink_iters: 100,
        failure_persistence: Some(Box::new(FileFailurePersistence::Direct(failures))),
        ..Config::default()
    };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let outcome = runner.run(&sweep::recipe::recipe(), |recipe| {
        let verdict = sweep::run(&recipe).map_err(TestCaseError::fail)?;
        // A sample of them must come out the same again.
        if let (Verdict::Sound(bake), 0) = (verdict, recipe.seed % 8) {
            let again = sweep::run(&recipe).map_err(TestCaseError::fail)?;
            let same = matches!(again, Verdict::Sound(again) if again.pile.frames == bake.pile.frames);
            return if same { Ok(()) } else { Err(TestCaseError::fail("a second run differs")) };
        }
        Ok(())
    });
    if let Err(TestError::Fail(why, recipe)) = outcome {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sweep");
        let path = sweep::file::write(&recipe, &folder).expect("the folder can be written");
        panic!("{why}: {recipe:?}; replay with: cairn bake {} -o out.glb", path.display());
    }
}

/// What a failure is written as is the scene that failed.
#[test]
fn a_random_scene_replays_from_its_file() {
    use proptest::strategy::{Strategy, ValueTree};
    let mut runner = TestRunner::deterministic();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("replay");
    let mut replayed = 0;
    while replayed < 3 {
        let recipe = sweep::recipe::recipe().new_tree(&mut runner).expect("nothing is filtered out").current();
        let Ok(Verdict::Sound(bake)) = sweep::run(&recipe) else { continue };
        let path = sweep::file::write(&recipe, &folder).expect("the folder can be written");
        let tree = cairn_wire::scene_file::SceneTree::load(&path).expect("a sound scene file");
        let job = cairn_job::Job::read(&tree.to_message()).expect("sound models");
        let again = cairn_core::bake(&job.scene, &job.params, &mut cairn_input::observer::Silent).expect("it bakes");
        assert!(recipe.control.is_some() || again.pile.bodies.len() == bake.pile.bodies.len());
        let apart =
            |(a, b): (&cairn_geometry::pose::Pose, &cairn_geometry::pose::Pose)| a.translation.distance(b.translation);
        // Files have single precision: the beginning is the same, as far as that goes.
        let largest = bake.pile.frames[0].iter().zip(&again.pile.frames[0]).map(apart).fold(0.0, f64::max);
        assert!(recipe.control.is_some() || largest < 1e-5 * recipe.size, "{largest} m apart in the beginning");
        replayed += 1;
    }
}
