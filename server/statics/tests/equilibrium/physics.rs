//! The local analysis against statics that a textbook solves.

use crate::generator::{self, Case, rng, rotation};
use cairn_statics::local::*;
use glam::{DQuat, DVec3};
use std::f64::consts::{PI, SQRT_2, TAU};

pub fn stable(case: &Case, options: &Options) -> bool {
    Analyser::new().analyse(&case.problem(), options).expect("a valid case").is_stable()
}

fn cone() -> Options {
    Options::default()
}

fn pyramid(sides: u32, fit: Fit) -> Options {
    Options { friction_law: FrictionLaw::Pyramid { sides, fit }, ..Options::default() }
}

pub fn body(contacts: Vec<LocalContact>, center_of_mass: DVec3) -> Case {
    Case { contacts, mass: 2.0, center_of_mass, radius: 1.0, gravity: DVec3::new(0.0, -9.81, 0.0) }
}

/// A unit cube's bottom corners on the plane y = 0.
pub fn block(friction: f64) -> Case {
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
    let contacts = corners.map(|[x, z]| LocalContact { point: DVec3::new(x, 0.0, z), normal: DVec3::Y, friction });
    body(contacts.to_vec(), DVec3::new(0.0, 0.5, 0.0))
}

/// The block on a plane that falls by `angle` toward `azimuth`: gravity turns instead. The block is low, so that it
/// slides before it tips.
fn on_slope(friction: f64, angle: f64, azimuth: f64) -> Case {
    let mut case = block(friction);
    case.center_of_mass.y = 0.05;
    let (s, c) = angle.sin_cos();
    case.gravity = 9.81 * DVec3::new(s * azimuth.cos(), -c, s * azimuth.sin());
    case
}

#[test]
fn a_block_slips_at_the_friction_angle_in_every_azimuth() {
    for mu in [0.05f64, 0.7, 1.0, 1.5] {
        for k in 0..72 {
            let azimuth = TAU * f64::from(k) / 72.0;
            assert!(stable(&on_slope(mu, mu.atan() - 1e-7, azimuth), &cone()), "mu {mu}, azimuth {azimuth}");
            assert!(!stable(&on_slope(mu, mu.atan() + 1e-7, azimuth), &cone()), "mu {mu}, azimuth {azimuth}");
        }
    }
    assert!(stable(&on_slope(0.0, 0.0, 0.0), &cone()));
    assert!(!stable(&on_slope(0.0, 1e-9, 0.3), &cone()));
}

/// The tangent of the angle at which the block slips, by bisection, over mu.
fn slip(mu: f64, azimuth: f64, options: &Options) -> f64 {
    let (mut low, mut high) = (0.0, 1.5);
    for _ in 0..40 {
        let angle = (low + high) / 2.0;
        if stable(&on_slope(mu, angle, azimuth), options) { low = angle } else { high = angle }
    }
    low.tan() / mu
}

#[test]
fn the_pyramid_errs_by_up_to_its_corners() {
    let over = |options: &Options| {
        let slips = (0..48).map(|k| slip(0.4, TAU * f64::from(k) / 48.0, options));
        slips.fold((f64::INFINITY, 0.0f64), |(least, most), s| (least.min(s), most.max(s)))
    };
    let close = |a: f64, b: f64| (a - b).abs() < 1e-6;
    let (least, most) = over(&cone());
    assert!(close(least, 1.0) && close(most, 1.0), "cone {least} {most}");
    let (least, most) = over(&pyramid(4, Fit::Circumscribed));
    assert!(close(least, 1.0) && close(most, SQRT_2), "circumscribed {least} {most}");
    let (least, most) = over(&pyramid(4, Fit::Inscribed));
    assert!(close(least, 1.0 / SQRT_2) && close(most, 1.0), "inscribed {least} {most}");
    let (least, most) = over(&pyramid(16, Fit::Circumscribed));
    assert!(least > 0.999_999 && most < 1.0 / (PI / 16.0).cos() + 1e-6, "16 sides {least} {most}");
}

#[test]
fn two_points_carry_a_body_whose_centre_is_above_their_line() {
    let touch = |x: f64| LocalContact { point: DVec3::new(x, 0.0, 0.0), normal: DVec3::Y, friction: 0.5 };
    let at = |x: f64, z: f64| body(vec![touch(-0.5), touch(0.5)], DVec3::new(x, 0.3, z));
    assert!(stable(&at(0.2, 0.0), &cone()));
    assert!(!stable(&at(0.2, 1e-8), &cone()), "it rolls over the line");
    assert!(!stable(&at(0.5 + 1e-8, 0.0), &cone()), "it tips over the end");
    let balanced = at(0.0, 0.0);
    let mut analyser = Analyser::new();
    let Verdict::Stable { forces, margin, .. } =
        analyser.analyse(&balanced.problem(), &Options { margin: true, ..cone() }).expect("a valid case")
    else {
        panic!("it stands")
    };
    assert!((forces[0].y - 0.5).abs() < 1e-12 && (forces[1].y - 0.5).abs() < 1e-12);
    assert_eq!(margin, Some(0.0), "the least push rolls it");
}

/// A ladder of length 2 at angle `a` to the ground, friction `mu` on the ground and none on the wall, stands iff
/// mu >= cot(a)/2. Two points at each end keep it from rolling.
#[test]
fn a_ladder_against_a_smooth_wall() {
    let ladder = |a: f64, mu: f64| {
        let (s, c) = a.sin_cos();
        let contacts = [-0.2, 0.2].into_iter().flat_map(|z| {
            [
                LocalContact { point: DVec3::new(2.0 * c, 0.0, z), normal: DVec3::Y, friction: mu },
                LocalContact { point: DVec3::new(0.0, 2.0 * s, z), normal: DVec3::X, friction: 0.0 },
            ]
        });
        body(contacts.collect(), DVec3::new(c, s, 0.0))
    };
    for mu in [0.2f64, 0.5, 0.9] {
        let limit = (0.5 / mu).atan();
        assert!(stable(&ladder(limit + 1e-8, mu), &cone()), "mu {mu}");
        assert!(!stable(&ladder(limit - 1e-8, mu), &cone()), "mu {mu}");
    }
}

/// A wedge that narrows upward between two walls that lean by `alpha`: it jams iff mu >= tan(alpha), with forces as
/// large as it takes.
#[test]
fn a_wedge_jams_within_its_friction_angle() {
    let jammed = |alpha: f64, mu: f64| {
        let (s, c) = alpha.sin_cos();
        let side = |x: f64, z: f64| LocalContact {
            point: DVec3::new(0.3 * x, 0.0, z),
            normal: DVec3::new(-x * c, -s, 0.0),
            friction: mu,
        };
        body(vec![side(-1.0, 0.2), side(1.0, 0.2), side(-1.0, -0.2), side(1.0, -0.2)], DVec3::ZERO)
    };
    for alpha in [0.05f64, 0.3, 0.8] {
        assert!(stable(&jammed(alpha, alpha.tan() + 1e-4), &cone()), "alpha {alpha}");
        assert!(!stable(&jammed(alpha, alpha.tan() - 1e-4), &cone()), "alpha {alpha}");
    }
}

/// Half-width w over a centre at height h: slides at mu, tips at w/h.
#[test]
fn the_margin_is_the_push_that_slides_or_tips() {
    let margin = |mu: f64, height: f64| {
        let mut case = block(mu);
        case.center_of_mass.y = height;
        let options = Options { margin: true, ..cone() };
        match Analyser::new().analyse(&case.problem(), &options).expect("a valid case") {
            Verdict::Stable { margin, .. } => margin.expect("asked for"),
            Verdict::Unstable { .. } => panic!("a block on a table stands"),
        }
    };
    // A square's nearest side is at most pi/6 away from one of the six azimuths.
    let slack = 1.0 - 1.01 * margin::SLACK;
    let within = |m: f64, exact: f64| m >= slack * exact && m <= exact / (PI / 6.0).cos() + 1e-9;
    assert!((slack * 0.3..0.3 + 1e-6).contains(&margin(0.3, 0.5)), "slides: {}", margin(0.3, 0.5));
    assert!(within(margin(0.9, 1.0), 0.5), "tips: {}", margin(0.9, 1.0));
    assert_eq!(margin(2.0, 0.1), margin::MOST_PUSH);
    assert_eq!(margin(0.0, 0.5), 0.0);
}

#[test]
fn repeated_and_collinear_contacts_change_nothing() {
    let rng = &mut rng(5);
    for seed in 0..2000 {
        let once = generator::case(seed);
        let mut thrice = once.clone();
        thrice.contacts = once.contacts.iter().flat_map(|c| [*c; 3]).collect();
        let options =
            Options { friction_law: if seed % 2 == 0 { FrictionLaw::Cone } else { FrictionLaw::PAPER }, ..cone() };
        assert_eq!(stable(&once, &options), stable(&thrice, &options), "seed {seed}");
    }
    // Points along an edge: only the outer two matter.
    for _ in 0..200 {
        let center = DVec3::new(generator::unit(rng).x * 0.8, 0.4, 0.0);
        let touch = |x: f64| LocalContact { point: DVec3::new(x, 0.0, 0.0), normal: DVec3::Y, friction: 0.5 };
        let line = body((0..9).map(|k| touch(f64::from(k) / 8.0 - 0.5)).collect(), center);
        let ends = body(vec![touch(-0.5), touch(0.5)], center);
        assert_eq!(stable(&line, &cone()), stable(&ends, &cone()), "{center}");
        assert_eq!(stable(&line, &cone()), center.x.abs() <= 0.5, "{center}");
    }
}

#[test]
fn the_rank_of_degenerate_contacts_is_told() {
    let touch =
        |x: f64, z: f64, friction: f64| LocalContact { point: DVec3::new(x, 0.0, z), normal: DVec3::Y, friction };
    let rank = |contacts: &[LocalContact]| {
        Analyser::new().rank(&body(contacts.to_vec(), DVec3::Y * 0.3).problem()).expect("a valid case")
    };
    assert_eq!(rank(&[]), 0);
    assert_eq!(rank(&[touch(0.1, 0.0, 0.0)]), 1);
    assert_eq!(rank(&[touch(0.1, 0.0, 0.5); 3]), 3, "one point, three times");
    let line: Vec<LocalContact> = (0..7).map(|k| touch(f64::from(k) / 7.0, 0.0, 0.5)).collect();
    assert_eq!(rank(&line), 5, "nothing resists turning about the line");
    assert_eq!(rank(&block(0.0).contacts), 3, "a smooth plane: height, pitch and roll");
    assert_eq!(rank(&block(0.5).contacts), 6);
}

/// The centre of mass just inside or outside a support polygon whose geometry is exact, in any attitude and unit.
#[test]
fn the_boundary_is_right_from_a_thousandth_to_a_billionth() {
    let rng = &mut rng(11);
    let mut analyser = Analyser::new();
    for options in [cone(), pyramid(4, Fit::Circumscribed), pyramid(6, Fit::Inscribed)] {
        for trial in 0..400 {
            let q = rotation(rng);
            let (length, mass) = (10f64.powi(trial % 10 - 6), 10f64.powi(trial % 13 - 6));
            for power in 3..=9 {
                let d = 10f64.powi(-power);
                for (offset, expected) in [(-d, true), (d, false)] {
                    let mut case = block(0.6);
                    let along = f64::from(trial) / 400.0 * 0.9 - 0.45;
                    case.center_of_mass = match trial % 4 {
                        0 => DVec3::new(0.5 + offset, 0.5, along),
                        1 => DVec3::new(along, 0.5, -0.5 - offset),
                        2 => DVec3::new(-0.5 - offset, 0.1, along),
                        // Over a corner.
                        _ => DVec3::new(0.5 + offset, 0.9, 0.5 + offset),
                    };
                    let case = case.turned(q).in_units(length, mass, 1.0);
                    let verdict = analyser.analyse(&case.problem(), &options).expect("a valid case");
                    assert_eq!(verdict.is_stable(), expected, "trial {trial}, {offset:e}: {verdict:?}");
                }
            }
        }
    }
    assert_eq!((analyser.counters().fast_open, analyser.counters().uncertified), (0, 0));
}

/// From 1 um to 1 km and from 1e-6 to 1e6 kg: the same verdict, and the same forces by mg.
#[test]
fn units_do_not_matter() {
    let mut analyser = Analyser::new();
    let mut forces_of = |case: &Case, options: &Options| match analyser.analyse(&case.problem(), options) {
        Ok(Verdict::Stable { forces, .. }) => Some(forces.to_vec()),
        Ok(Verdict::Unstable { .. }) => None,
        Err(e) => panic!("{e}"),
    };
    for seed in 0..500 {
        let case = generator::case(seed);
        let case = case.in_units(1.0 / case.radius, 1.0 / case.mass, 9.81 / case.gravity.length());
        for options in [cone(), pyramid(4, Fit::Circumscribed)] {
            let known = forces_of(&case, &options);
            for (length, mass) in [(1e-6, 1e-6), (1e-6, 1e6), (1e3, 1e-6), (1e3, 1e6), (0.3, 7.0)] {
                let same = forces_of(&case.in_units(length, mass, 1.0), &options);
                match (&known, &same) {
                    (None, None) => (),
                    (Some(a), Some(b)) => {
                        let total: f64 = a.iter().map(|f| f.length()).sum();
                        let apart = a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
                        assert!(apart <= 1e-6 * total, "seed {seed}: {apart:e} of {total:e}");
                    }
                    _ => panic!("seed {seed}: the verdict depends on the unit"),
                }
            }
        }
    }
}

/// An analyser that has seen a thousand other bodies answers bit for bit like a new one.
#[test]
fn what_came_before_does_not_matter() {
    let options = Options { margin: true, ..cone() };
    let mut used = Analyser::new();
    for seed in 0..1000 {
        let case = generator::case(seed);
        let mut new = Analyser::new();
        let (a, b) = (new.analyse(&case.problem(), &options), used.analyse(&case.problem(), &options));
        assert_eq!(a, b, "seed {seed}");
    }
}

#[test]
fn remembered_forces_change_no_verdict() {
    let rng = &mut rng(3);
    let (mut analyser, mut warm) = (Analyser::new(), Analyser::new());
    for seed in 0..20_000 {
        let case = generator::case(seed);
        let last: Vec<DVec3> = match analyser.analyse(&case.problem(), &cone()).expect("a valid case") {
            Verdict::Stable { forces, .. } => forces.to_vec(),
            Verdict::Unstable { .. } => case.contacts.iter().map(|_| generator::unit(rng)).collect(),
        };
        let mut moved = case.clone();
        moved.center_of_mass += 1e-3 * moved.radius * generator::unit(rng);
        moved.gravity = DQuat::from_axis_angle(generator::unit(rng), 1e-3) * moved.gravity;
        let cold = analyser.analyse(&moved.problem(), &cone()).expect("a valid case").is_stable();
        let again = warm.analyse_from(&moved.problem(), &cone(), &last).expect("a valid case").is_stable();
        assert_eq!(cold, again, "seed {seed}");
    }
    assert_eq!((warm.counters().fast_open, warm.counters().uncertified), (0, 0));
}
