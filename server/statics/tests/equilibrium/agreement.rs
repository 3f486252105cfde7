//! The fast solver against Clarabel over generated problems; every verdict's proof is substituted again here.
//!
//! Where Clarabel leaves a problem open, the analyser falls back to the fast solver, which would agree with itself.
//! Such a problem is no agreement: it is counted, the count is asserted, and the verdict rests on its proof alone.
//!
//! The small sample runs with the tests. The full one:
//!
//! ```text
//! CAIRN_CASES=1000000 cargo test --release -p cairn-statics --test equilibrium agreement_full -- --ignored --nocapture
//! ```
//!
//! `CAIRN_FIRST` sets the first seed, so that the run may be cut into pieces.

use crate::generator::{self, Case};
use cairn_statics::local::*;
use glam::{DQuat, DVec3};

/// Nearer to the boundary than this Clarabel gives no decision, or an arbitrary one: gravity tilted by so many radians,
/// the centre of mass moved by so many radii, friction changed by this share, or a residual of so many mg.
const BAND: f64 = 1e-5;

#[derive(Debug, Default)]
struct Tally {
    /// Clarabel decided, and the fast solver alike.
    agree: u64,
    differ_in_band: u64,
    differ_outside_band: u64,
    /// Clarabel gave no decision.
    open_in_band: u64,
    open_outside_band: u64,
    stable: u64,
    unstable: u64,
    uncertified: u64,
}

/// Substitutes the proof into the problem as it was given, in its own units.
fn assert_proof(case: &Case, law: FrictionLaw, verdict: &Verdict, seed: u64) {
    let up = -case.gravity.normalize();
    let levers = case.contacts.iter().map(|c| ((c.point - case.center_of_mass) / case.radius, c));
    match *verdict {
        Verdict::Stable { forces, residual, .. } => {
            let (mut force, mut torque, mut total) = (-up, DVec3::ZERO, 0.0);
            for ((r, c), f) in levers.zip(forces) {
                force += *f;
                torque += r.cross(*f);
                let normal = f.dot(c.normal);
                let tangential = (*f - normal * c.normal).length();
                let mu = if law == FrictionLaw::PAPER { c.friction * 2f64.sqrt() } else { c.friction };
                assert!(normal >= -PROOF_TOLERANCE, "seed {seed}: tension");
                assert!(tangential <= mu * normal + PROOF_TOLERANCE * (1.0 + normal), "seed {seed}: friction");
                total += normal;
            }
            let left = (force.length_squared() + torque.length_squared()).sqrt();
            assert!(left <= STABLE_RESIDUAL + 2.0 * FORCE_ROUNDING * total, "seed {seed}: {left:e} of {total:e}");
            assert!((left - residual).abs() <= STABLE_RESIDUAL + FORCE_ROUNDING * total, "seed {seed}");
        }
        Verdict::Unstable { certificate: z, residual } => {
            assert!((z.force.length_squared() + z.torque.length_squared() - 1.0).abs() < 1e-12, "seed {seed}");
            assert!((z.force.dot(up) - residual).abs() < 1e-12 && residual > STABLE_RESIDUAL, "seed {seed}");
            for (r, c) in levers {
                let v = z.force + z.torque.cross(r);
                let tangential = v - v.dot(c.normal) * c.normal;
                // The pyramid's polygon holds the circle, so that the circle's work bounds it from below.
                let work = v.dot(c.normal) + c.friction * tangential.length();
                assert!(work <= PROOF_TOLERANCE + 1e-12, "seed {seed}: work {work:e}");
                assert!(work * EXCLUDED_FORCE <= residual + 1e-9, "seed {seed}: work {work:e} of {residual:e}");
            }
        }
    }
}

/// Does a change of the size of the band turn the verdict?
fn in_band(case: &Case, options: &Options, analyser: &mut Analyser) -> bool {
    let mut turns = |changed: &Case, stable: bool| {
        analyser.analyse(&changed.problem(), options).expect("a generated case is valid").is_stable() != stable
    };
    let stable = !turns(case, true);
    let (e1, e2) = case.gravity.normalize().any_orthonormal_pair();
    let directions = [e1, -e1, e2, -e2];
    let tilted = directions.map(|d| Case { gravity: DQuat::from_axis_angle(d, BAND) * case.gravity, ..case.clone() });
    let moved =
        directions.map(|d| Case { center_of_mass: case.center_of_mass + BAND * case.radius * d, ..case.clone() });
    let rubbed = [1.0 - BAND, 1.0 + BAND].map(|factor| {
        let contacts = case.contacts.iter().map(|c| LocalContact { friction: c.friction * factor, ..*c }).collect();
        Case { contacts, ..case.clone() }
    });
    tilted.iter().chain(&moved).chain(&rubbed).any(|c| turns(c, stable))
}

fn compare(law: FrictionLaw, seeds: std::ops::Range<u64>) -> Tally {
    let fast_options = Options { friction_law: law, ..Options::default() };
    let slow_options = Options { solver: Solver::Clarabel, ..fast_options };
    let (mut fast, mut slow, mut probe) = (Analyser::new(), Analyser::new(), Analyser::new());
    let mut tally = Tally::default();
    for seed in seeds {
        let case = generator::case(seed);
        let verdict = fast.analyse(&case.problem(), &fast_options).expect("a generated case is valid");
        assert_proof(&case, law, &verdict, seed);
        let stable = verdict.is_stable();
        let near = matches!(verdict, Verdict::Unstable { residual, .. } if residual < BAND);
        let open = slow.counters().clarabel_open;
        let reference = slow.analyse(&case.problem(), &slow_options).expect("a generated case is valid").is_stable();
        let open = slow.counters().clarabel_open > open;
        let mut is_in_band = || near || in_band(&case, &fast_options, &mut probe);
        let count = match (open, reference == stable) {
            (false, true) => &mut tally.agree,
            (false, false) if is_in_band() => &mut tally.differ_in_band,
            (false, false) => &mut tally.differ_outside_band,
            (true, _) if is_in_band() => &mut tally.open_in_band,
            (true, _) => &mut tally.open_outside_band,
        };
        *count += 1;
        if open || reference != stable {
            println!("{law:?} seed {seed}: stable {stable}, Clarabel {reference}, open {open}");
        }
    }
    (tally.stable, tally.unstable) = (fast.counters().stable, fast.counters().unstable);
    tally.uncertified = fast.counters().uncertified + fast.counters().fast_open;
    tally
}

fn run(cases: u64, law: FrictionLaw) -> Tally {
    let first = std::env::var("CAIRN_FIRST").ok().and_then(|s| s.parse().ok()).unwrap_or(0);
    let tally = compare(law, first..first + cases);
    println!("{law:?}: {tally:?}");
    assert_eq!((tally.differ_in_band, tally.differ_outside_band, tally.uncertified), (0, 0, 0));
    let open = tally.open_in_band + tally.open_outside_band;
    assert_eq!(tally.agree + open, cases);
    tally
}

/// One of these problems is beyond Clarabel: 34 contacts without friction that push to and fro along one direction. Its
/// multipliers stop short of a certificate; the fast solver's passes substitution.
#[test]
fn agreement_of_a_sample() {
    for law in [FrictionLaw::Cone, FrictionLaw::PAPER] {
        let tally = run(5000, law);
        assert_eq!((tally.open_in_band, tally.open_outside_band), (0, 1), "{law:?}");
    }
}

#[test]
#[ignore = "a million problems through Clarabel take a quarter of an hour"]
fn agreement_full() {
    let cases = std::env::var("CAIRN_CASES").ok().and_then(|s| s.parse().ok()).unwrap_or(1_000_000);
    for law in [FrictionLaw::Cone, FrictionLaw::PAPER] {
        let tally = run(cases, law);
        // One in ten thousand is open to Clarabel, most of them without friction.
        assert!(tally.open_in_band + tally.open_outside_band <= 10 + cases / 5000, "{law:?}: {tally:?}");
    }
}

/// Without Clarabel a million is a matter of seconds: no verdict leaves without its proof, in any friction law.
#[test]
fn every_verdict_is_proved() {
    for law in [FrictionLaw::Cone, FrictionLaw::PAPER, FrictionLaw::Pyramid { sides: 8, fit: Fit::Inscribed }] {
        let mut analyser = Analyser::new();
        let options = Options { friction_law: law, ..Options::default() };
        for seed in 0..200_000 {
            let case = generator::case(seed);
            let verdict = analyser.analyse(&case.problem(), &options).expect("a generated case is valid");
            if law != (FrictionLaw::Pyramid { sides: 8, fit: Fit::Inscribed }) {
                assert_proof(&case, law, &verdict, seed);
            }
        }
        assert_eq!((analyser.counters().fast_open, analyser.counters().uncertified), (0, 0), "{law:?}");
    }
}
