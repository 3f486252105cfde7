//! The rules that make a body in equilibrium a candidate.

use crate::generator::rng;
use crate::physics::{block, body};
use cairn_statics::local::candidate::{hull_area, triangles};
use cairn_statics::local::*;
use glam::DVec3;
use rand::seq::SliceRandom;

const RULES: CandidateRules = CandidateRules {
    reserve: ReserveRule::Sharp,
    kinetic_ratio: 6.0 / 7.0,
    spread: SpreadRule::Relative { share: 0.1, area: 1.0 },
    contacts: 3,
};

fn judge(case: &crate::generator::Case, rules: &CandidateRules) -> Candidacy {
    Analyser::new().candidate(&case.problem(), &Options::default(), rules).expect("a valid case")
}

fn on_slope(tangent: f64) -> crate::generator::Case {
    let mut case = block(0.7);
    case.center_of_mass.y = 0.05;
    case.gravity = DVec3::new(tangent, -1.0, 0.0);
    case
}

#[test]
fn each_rule_refuses_by_name() {
    assert_eq!(judge(&block(0.7), &RULES), Candidacy::Candidate);
    assert_eq!(judge(&on_slope(0.59), &RULES), Candidacy::Candidate);
    assert_eq!(judge(&on_slope(0.61), &RULES), Candidacy::NoReserve);
    assert_eq!(judge(&on_slope(0.71), &RULES), Candidacy::Unstable);
    let mut two = block(0.7);
    two.contacts = vec![two.contacts[0], two.contacts[2], two.contacts[0], two.contacts[2]];
    assert_eq!(judge(&two, &RULES), Candidacy::FewContacts, "four contacts, two places");
    let line = [-0.5, 0.0, 0.5].map(|x| LocalContact { point: DVec3::X * x, normal: DVec3::Y, friction: 0.7 });
    assert_eq!(judge(&body(line.to_vec(), DVec3::Y * 0.5), &RULES), Candidacy::NoSpread);
    let mut weightless = block(0.7);
    weightless.gravity = DVec3::ZERO;
    assert_eq!(judge(&weightless, &RULES), Candidacy::Weightless);
}

#[test]
fn the_paper_tests_the_solvers_forces() {
    let paper = CandidateRules { reserve: ReserveRule::Paper, spread: SpreadRule::Paper(0.5), ..RULES };
    assert_eq!(judge(&block(0.7), &paper), Candidacy::Candidate);
    assert_eq!(judge(&on_slope(0.71), &paper), Candidacy::Unstable);
    assert_eq!(judge(&on_slope(0.65), &paper), Candidacy::NoReserve);
    let strict = CandidateRules { spread: SpreadRule::Paper(1.01), ..paper };
    assert_eq!(judge(&block(0.7), &strict), Candidacy::NoSpread);
}

/// Whatever the paper's reading accepts, the sharp one does: the forces that passed the test are the proof.
#[test]
fn the_sharp_reserve_accepts_what_the_literal_one_does() {
    let paper = CandidateRules { reserve: ReserveRule::Paper, ..RULES };
    let options = Options { friction_law: FrictionLaw::PAPER, ..Options::default() };
    let (mut literal, mut sharp) = (0, 0);
    let mut analyser = Analyser::new();
    for seed in 0..3000 {
        let case = crate::generator::case(seed);
        let a = analyser.candidate(&case.problem(), &options, &paper).expect("a valid case");
        let b = analyser.candidate(&case.problem(), &options, &RULES).expect("a valid case");
        literal += u32::from(a.is_stable() && a != Candidacy::NoReserve);
        sharp += u32::from(b.is_stable() && b != Candidacy::NoReserve);
        assert!(b != Candidacy::NoReserve || a == Candidacy::NoReserve, "seed {seed}: {a:?} {b:?}");
    }
    assert!(literal < sharp, "{literal} {sharp}");
}

#[test]
fn spread_is_eq_6_for_three_points_and_the_hull_for_a_plane() {
    let square = block(0.7);
    assert!((triangles(&square.problem()) - 1.0).abs() < 1e-12);
    let mut points: Vec<DVec3> = square.contacts.iter().map(|c| c.point).collect();
    assert!((hull_area(&mut points) - 1.0).abs() < 1e-12);
    let mut three = points[..3].to_vec();
    let area = hull_area(&mut three);
    let case = body(square.contacts[..3].to_vec(), DVec3::Y);
    assert!((area - triangles(&case.problem())).abs() < 1e-12);
    assert_eq!(hull_area(&mut []), 0.0);
    assert_eq!(hull_area(&mut [DVec3::X]), 0.0);
    assert_eq!(hull_area(&mut [DVec3::X, DVec3::X]), 0.0);
    assert!(hull_area(&mut [DVec3::X, DVec3::Y, 0.5 * (DVec3::X + DVec3::Y)]) < 1e-15);
}

/// The paper's own counterexample to Eq. 6: four points, the third beside the second.
#[test]
fn spread_does_not_depend_on_order() {
    let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1e-9], [0.0, 1.0]].map(|[x, z]| DVec3::new(x, 0.0, z));
    let contacts = points.map(|point| LocalContact { point, normal: DVec3::Y, friction: 0.7 });
    // In this order Eq. 6 still sees the last triangle; in the next it does not.
    let mut order = [contacts[0], contacts[3], contacts[1], contacts[2]];
    let rng = &mut rng(2);
    let mut previous: Option<f64> = None;
    for _ in 0..50 {
        order.shuffle(rng);
        let mut points: Vec<DVec3> = order.iter().map(|c| c.point).collect();
        let area = hull_area(&mut points);
        assert!((area - 0.5).abs() < 1e-8);
        assert!(previous.is_none_or(|p| p == area), "bit for bit");
        previous = Some(area);
    }
}
