//! The parts of a bake, over small named scenes. README.md beside this file describes the rows.

#[path = "../../tests/studies/piles/mod.rs"]
mod piles;

use cairn_analysis::pile_equilibrium::PileEquilibrium;
use cairn_core::cache::NoCache;
use cairn_export::Format;
use cairn_geometry::contact::REAL_CONTACT;
use cairn_input::observer::{Observer, Progress, Silent, Stage};
use cairn_input::params::ControlMode;
use cairn_motion::control::BodyProblem;
use cairn_motion::glue::sites::Sites;
use cairn_motion::step::Simulation;
use cairn_statics::global::{self, Objective};
use cairn_statics::glue::{self, GlueOptions, MOST_ROUNDS};
use cairn_statics::local::{Analyser, Options};
use criterion::measurement::WallTime;
use criterion::{BatchSize, BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use piles::Full;
use std::collections::BTreeSet;
use std::hint::black_box;
use std::ops::ControlFlow;
use std::time::Duration;

type Group<'a> = BenchmarkGroup<'a, WallTime>;

/// Boxes, flat boxes, and props of several hulls.
const SCENES: [&str; 3] = ["sticks", "books", "bananas"];

fn parts(c: &mut Criterion) {
    for name in SCENES {
        // The control acts where nothing is glued.
        let mut full = piles::small(name, &["glue=natural"]).and_then(Full::filled).expect("a sound scene");
        let mut group = c.benchmark_group(name);
        group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
        fill(&mut group, &full);
        standing(&mut group, &full);
        glue(&mut group, &full);
        steps(&mut group, &full, "release_held");
        full.job.params.control.mode = ControlMode::Off;
        steps(&mut group, &full, "release_off");
        writing(&mut group, &full);
    }
}

/// Counts the steps.
struct Steps(u64);

impl Observer for Steps {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        self.0 += 1;
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        0.0
    }
}

/// A whole fill.
fn fill(group: &mut Group, full: &Full) {
    let fill = |steps: &mut Steps| {
        cairn_core::fill_container(&full.job.scene, &full.job.params, &mut NoCache, steps).expect("it fills")
    };
    let mut steps = Steps(0);
    fill(&mut steps);
    group.throughput(Throughput::Elements(steps.0));
    group.bench_function("fill", |b| b.iter(|| fill(&mut Steps(0))));
}

/// The pile, all released, after so many steps.
fn moved(full: &Full, steps: u32) -> Simulation<'_> {
    let mut sim = full.turn_over().expect("it can be turned over");
    for id in sim.pile.world.present().collect::<Vec<_>>() {
        sim.pile.release(id);
    }
    advance(&mut sim, steps);
    sim
}

fn advance(sim: &mut Simulation, steps: u32) {
    for _ in 0..steps {
        sim.advance(&mut Silent, Stage::Release, |_| 0.0).expect("it moves");
    }
}

/// What is asked of a pile as it stands.
fn standing(group: &mut Group, full: &Full) {
    let period = full.job.params.control.period;
    let sim = moved(full, 3 * period);
    let world = &sim.pile.world;
    group.throughput(Throughput::Elements(world.present().count() as u64));
    group.bench_function("contacts", |b| b.iter(|| world.contact_pairs(black_box(REAL_CONTACT))));
    let problems = sim.pile.control.local_problems(world);
    group.bench_function("local", |b| {
        let mut analyser = Analyser::new();
        b.iter(|| {
            let stable = |body: &&BodyProblem| {
                analyser.analyse(&body.problem(), &Options::default()).expect("a valid body").is_stable()
            };
            problems.iter().filter(stable).count()
        })
    });
    let equilibrium = PileEquilibrium::new(world, REAL_CONTACT);
    group.bench_function("global", |b| {
        b.iter(|| global::analyse(&equilibrium.assembly.problem(), Objective::default()).expect("a valid pile").total)
    });
    group.bench_function("cycle", |b| {
        b.iter_batched_ref(
            || moved(full, period),
            |sim| sim.pile.control.cycle(&mut sim.pile.world, &mut sim.pile.policy, &sim.pile.motion.rested()),
            BatchSize::PerIteration,
        )
    });
}

/// Dots for the pile right after turning over.
fn glue(group: &mut Group, full: &Full) {
    let sim = full.turn_over().expect("it can be turned over");
    let sites = Sites::new(&sim.pile.world, None, true, &BTreeSet::new());
    let problem = sites.problem(DVec3::NEG_Y);
    let options = GlueOptions { friction_factor: 0.5, normal_price: 0.02, strength: None, rounds: MOST_ROUNDS };
    group.bench_function("glue", |b| {
        let mut going = || ControlFlow::Continue(());
        b.iter(|| glue::place(&problem, &options, &mut going).expect("a valid pile").joints.len())
    });
}

/// As many steps of the release as there are from one cycle of the control to the next.
fn steps(group: &mut Group, full: &Full, name: &str) {
    let period = full.job.params.control.period;
    group.throughput(Throughput::Elements(u64::from(period)));
    group.bench_function(name, |b| {
        b.iter_batched_ref(|| moved(full, period), |sim| advance(sim, period), BatchSize::PerIteration)
    });
}

/// A result of 100 frames in each kind of format.
fn writing(group: &mut Group, full: &Full) {
    let mut params = full.job.params.clone();
    params.output.frames = Some(100);
    let bake = cairn_core::bake(&full.job.scene, &params, &mut Silent).expect("it bakes");
    let origin = serde_json::Value::Null;
    let scene = full.job.export_scene(&origin, Some(&bake.report.measures));
    group.throughput(Throughput::Elements((bake.pile.frames.len() * bake.pile.bodies.len()) as u64));
    for (name, format) in [("glb", Format::Glb), ("usdc", Format::Usdc), ("json", Format::Json)] {
        group.bench_function(name, |b| {
            b.iter(|| cairn_export::encode(format, &bake.pile, &scene).expect("it can be written"))
        });
    }
}

criterion_group!(benches, parts);
criterion_main!(benches);
