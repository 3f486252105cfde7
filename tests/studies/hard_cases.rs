//! Runs the hard cases and prints them as a table: `cargo study hard_cases --
//! [--full] [--judged] [ROW ...]`.
//!
//! Every row is run by Cairn as it is delivered, by Cairn without control, and by rapier with its default parameters.
//! Without `--full`, some rows are shorter or smaller, as in the tests.

#[path = "../hard/rows/mod.rs"]
mod rows;

use cairn_engine::world::{Insertion, Units, World};
use cairn_input::observer::Silent;
use cairn_motion::guard::Guard;
use clap::Parser;
use rows::engines::Engine;
use rows::{Extent, Row};
use std::panic::{AssertUnwindSafe, catch_unwind};

#[derive(Parser)]
struct Args {
    /// Every row in the size that it names.
    #[arg(long)]
    full: bool,
    /// Only by the engines that must pass
    #[arg(long)]
    judged: bool,
    /// Instead, what the guard costs where it has nothing to do: CPU time of guarded steps over that of plain ones.
    #[arg(long)]
    guard_cost: bool,
    /// Only these rows.
    rows: Vec<String>,
}

fn main() {
    let args = Args::parse();
    if args.guard_cost {
        return guard_cost();
    }
    let extent = if args.full { Extent::Full } else { Extent::Short };
    println!("| row | passes when | Cairn | without control | plain rapier |");
    println!("| --- | --- | --- | --- | --- |");
    for row in rows::ROWS.iter().filter(|row| args.rows.is_empty() || args.rows.iter().any(|name| name == row.name)) {
        let cells =
            [Engine::Cairn, Engine::Uncontrolled, Engine::Plain].map(|engine| cell(row, engine, extent, args.judged));
        println!("| `{}` | {} | {} |", row.name, row.passes_when, cells.join(" | "));
    }
}

fn cell(row: &Row, engine: Engine, extent: Extent, judged: bool) -> String {
    let wanted = if judged { row.judged } else { row.shown };
    if !wanted.contains(&engine) {
        return String::new();
    }
    let Ok(outcome) = catch_unwind(AssertUnwindSafe(|| (row.run)(engine, extent))) else {
        return "**fails**: panics".into();
    };
    let verdict = match (outcome.passed, row.miss(engine, extent)) {
        (true, _) => "passes".into(),
        (false, Some(why)) => format!("**fails**, as is known ({why})"),
        (false, None) => "**fails**".into(),
    };
    format!("{verdict}: {}", outcome.summary)
}

/// Sticks that fall into a heap and come to rest: the same steps by the world alone and under the guard, in turn.
fn guard_cost() {
    const STEPS: usize = 200;
    const ROUNDS: usize = 7;
    let stick = rows::scenes::prop("stick", rows::scenes::block(glam::DVec3::new(0.5, 0.05, 0.05)), 0.7);
    let scene = rows::scenes::placed(stick, rows::scenes::cloud(600, 12, 0.6, 1));
    let params = rows::engines::params(Engine::Uncontrolled, 1.0);
    let checked = cairn_prepare::check::run(&scene, &params).expect("a sound scene");
    let shapes = cairn_engine::shape::run(&scene, &params, &checked.sizes, &mut Silent).expect("props with volume");
    let units = Units::new(checked.diameter, shapes[0].mass, params.gravity);
    let world = || {
        let mut world = World::new(units, &params.physics, shapes[0].thickness() / units.length, false);
        world.add_ground(0.0, 0.7);
        for given in &scene.bodies {
            let pose = units.pose_to_engine(&given.pose);
            let body = Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 };
            world.insert(&shapes[0], &body).expect("a prop with volume");
        }
        world
    };
    let summaries: Vec<_> = shapes.iter().map(|shape| shape.summary()).collect();
    let resolved = cairn_prepare::effects::Resolved::new(&scene, &params, &checked, &summaries);
    let mut ratios = Vec::new();
    for _ in 0..ROUNDS {
        let (mut plain, mut guarded) = (world(), world());
        let mut guard = Guard::new(&scene, &params, &resolved, units, 0.0);
        let (mut by_plain, mut by_guard) = (0.0, 0.0);
        for _ in 0..STEPS {
            by_plain += cpu(|| drop(plain.step()));
            by_guard += cpu(|| drop(guard.step(&mut guarded)));
        }
        let actions = &guard.actions;
        assert!(actions.retries == 0 && actions.stiffened == 0, "the guard has nothing to do here: {actions:?}");
        ratios.push(by_guard / by_plain);
    }
    ratios.sort_by(f64::total_cmp);
    println!(
        "guarded over plain steps, median of {ROUNDS}: {:.4} ({:.4} to {:.4})",
        ratios[ROUNDS / 2],
        ratios[0],
        ratios[ROUNDS - 1]
    );
}

/// CPU seconds of this process.
fn cpu(work: impl FnOnce()) -> f64 {
    let clock = cpu_time::ProcessTime::now();
    work();
    clock.elapsed().as_secs_f64()
}
