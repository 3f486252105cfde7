//! Local equilibrium: our solver and Clarabel over the same bodies, in one run. benches/README.md has the table.

#[path = "../statics/tests/equilibrium/generator.rs"]
#[allow(dead_code)]
mod generator;
#[path = "../statics/tests/equilibrium/wall.rs"]
mod wall;

use cairn_statics::global::{GlobalProblem, Objective, analyse};
use cairn_statics::local::{Analyser, FrictionLaw, LocalProblem, Options, Solver, Verdict};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use generator::{Case, case_of, rng};
use glam::DVec3;
use std::hint::black_box;
use std::time::Duration;

/// Bodies per contact count. One iteration analyses the next of them, so that the times are means over all.
const BODIES: usize = 256;

/// The mixture of the agreement tests: every kind of contact set, about two in five bodies stable.
fn mixed(n: usize) -> Vec<Case> {
    let rng = &mut rng(n as u64);
    (0..BODIES).map(|_| case_of(rng, n)).collect()
}

/// What a standing pile is made of: bodies that are stable.
fn standing(n: usize) -> Vec<Case> {
    let rng = &mut rng(1000 + n as u64);
    let mut analyser = Analyser::new();
    let mut cases = Vec::new();
    while cases.len() < BODIES {
        let case = case_of(rng, n);
        if analyser.analyse(&case.problem(), &Options::default()).expect("a generated case is valid").is_stable() {
            cases.push(case);
        }
    }
    cases
}

fn local(c: &mut Criterion) {
    let fast = Options::default();
    let pyramid = Options { friction_law: FrictionLaw::PAPER, ..fast };
    let reference = Options { solver: Solver::Clarabel, ..fast };
    let rows = [
        ("cone", fast),
        ("pyramid", pyramid),
        ("cone_margin", Options { margin: true, ..fast }),
        ("pyramid_margin", Options { margin: true, ..pyramid }),
        ("clarabel_cone", reference),
        ("clarabel_pyramid", Options { friction_law: FrictionLaw::PAPER, ..reference }),
    ];
    for (set, make) in [("mixed", mixed as fn(usize) -> Vec<Case>), ("standing", standing)] {
        let mut group = c.benchmark_group(set);
        group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2)).sample_size(20);
        for n in [4, 8, 16, 32, 64] {
            let cases = make(n);
            for (name, options) in rows {
                let mut analyser = Analyser::new();
                let mut next = cases.iter().cycle();
                group.bench_function(BenchmarkId::new(name, n), |b| {
                    b.iter(|| {
                        let case = next.next().expect("there are cases");
                        black_box(analyser.analyse(&case.problem(), &options)).expect("a case is valid").is_stable()
                    })
                });
            }
            if set == "standing" {
                warm(&mut group, n, &cases);
            }
        }
    }
}

/// From the forces of the cycle before, after every contact has moved by a thousandth of the radius.
fn warm(group: &mut criterion::BenchmarkGroup<'_, criterion::measurement::WallTime>, n: usize, cases: &[Case]) {
    let mut analyser = Analyser::new();
    let options = Options::default();
    let rng = &mut rng(7);
    let before: Vec<(Case, Vec<DVec3>)> = cases
        .iter()
        .filter_map(|case| match analyser.analyse(&case.problem(), &options) {
            Ok(Verdict::Stable { forces, .. }) => {
                let mut moved = case.clone();
                for c in &mut moved.contacts {
                    c.point += 1e-3 * case.radius * generator::unit(rng);
                }
                Some((moved, forces.to_vec()))
            }
            _ => None,
        })
        .collect();
    let mut next = before.iter().cycle();
    group.bench_function(BenchmarkId::new("cone_warm", n), |b| {
        b.iter(|| {
            let (case, last) = next.next().expect("there are cases");
            black_box(analyser.analyse_from(&case.problem(), &options, last)).expect("a case is valid").is_stable()
        })
    });
}

/// A wall of bricks: all bricks one by one, and all at once.
fn global(c: &mut Criterion) {
    let mut group = c.benchmark_group("wall");
    group.sample_size(10).measurement_time(Duration::from_secs(5));
    for courses in [4, 20] {
        let (bodies, contacts) = wall::wall(courses, 50);
        let gravity = DVec3::NEG_Y * 9.81;
        let touching: Vec<_> = (0..bodies.len()).map(|k| wall::contacts_of(k, &contacts)).collect();
        let mut analyser = Analyser::new();
        group.bench_function(BenchmarkId::new("local", bodies.len()), |b| {
            b.iter(|| {
                let stable = bodies.iter().zip(&touching).filter(|(body, contacts)| {
                    let (mass, center_of_mass, radius) = (body.mass, body.center_of_mass, body.radius);
                    let problem = LocalProblem { contacts, mass, center_of_mass, radius, gravity };
                    analyser.analyse(&problem, &Options::default()).expect("a valid brick").is_stable()
                });
                stable.count()
            })
        });
        let pile = GlobalProblem { bodies: &bodies, contacts: &contacts, gravity };
        for (name, objective) in
            [("least_squares", Objective::LeastSquares), ("sum_of_norms", Objective::SumOfNorms { sharpen: 0 })]
        {
            group.bench_function(BenchmarkId::new(name, bodies.len()), |b| {
                b.iter(|| analyse(&pile, objective).expect("a valid wall").total)
            });
        }
    }
}

criterion_group!(benches, local, global);
criterion_main!(benches);
