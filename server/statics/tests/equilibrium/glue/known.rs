//! Piles whose answer is known.

use super::piles::{Block, cantilever, of_blocks};
use super::{GRAVITY, OPTIONS, Pile, joints};
use cairn_statics::glue::{GlueOptions, GluePlacement};
use glam::DVec3;

const FOOT: [DVec3; 4] =
    [DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 0.0, -0.5), DVec3::new(0.5, 0.0, 0.5), DVec3::new(-0.5, 0.0, 0.5)];

const NONE: [usize; 0] = [];

/// The joints' touches of a pile that stands.
fn glued(pile: &Pile, what: &str) -> Vec<usize> {
    let placed = pile.place(&OPTIONS);
    pile.certify(&placed, &OPTIONS, what);
    assert!(placed.fallen.is_empty(), "{what}");
    assert!(
        placed.at_least <= placed.joints.len(),
        "{what}: {} joints, at least {}",
        placed.joints.len(),
        placed.at_least
    );
    joints(&placed)
}

/// What glue of bounded strength makes of a pile that cannot stand; glue without bound drops nothing, and says so.
fn fallen(pile: &Pile, what: &str) -> GluePlacement {
    let free = pile.place(&OPTIONS);
    pile.check_forces(&free, &OPTIONS, what);
    assert!(!free.stands() && free.fallen.is_empty() && free.imbalance.is_finite(), "{what}");
    let options = GlueOptions { strength: Some(1e6), ..OPTIONS };
    let placed = pile.place(&options);
    pile.certify(&placed, &options, what);
    placed
}

fn cube(x: f64, y: f64) -> Block {
    Block { center: DVec3::new(x, y + 0.5, 0.0), half: DVec3::splat(0.5), mass: 1.0 }
}

#[test]
fn one_body() {
    assert_eq!(glued(&of_blocks(&[cube(0.0, 0.0)], false, 0.5), "on the ground"), NONE);
    assert_eq!(glued(&of_blocks(&[cube(0.0, 0.0)], false, 0.0), "on ice"), NONE);
    for (x, expected) in [(0.0, vec![]), (0.2, vec![0]), (1e-2, vec![0])] {
        for friction in [0.0, 0.6] {
            let mut pile = Pile::new();
            pile.body(1.0, DVec3::Y, 1.0);
            pile.site(0, None, &[DVec3::X * x], DVec3::Y, friction);
            assert_eq!(glued(&pile, "on a point"), expected, "{x} beside");
        }
    }
    let mut hanging = Pile::new();
    hanging.body(3.0, DVec3::ZERO, 1.0);
    hanging.site(0, None, &FOOT, DVec3::NEG_Y, 0.5);
    assert_eq!(glued(&hanging, "under a ceiling"), [0]);
}

/// What hangs has a joint of its own, and one joint serves two.
#[test]
fn dots_that_no_choice_can_spare() {
    let least = |pile: &Pile| pile.place(&OPTIONS).at_least;
    assert_eq!(least(&of_blocks(&[cube(0.0, 0.0), cube(0.3, 1.0)], false, 0.5)), 0, "a stack");
    assert_eq!(least(&of_blocks(&[cube(0.0, 0.0), cube(0.7, 1.0)], false, 0.5)), 1, "over the edge");
    let mut hanging = Pile::new();
    for k in 0..5 {
        hanging.body(1.0, DVec3::new(3.0 * k as f64, -0.5, 0.0), 1.0);
        hanging.site(k, None, &FOOT.map(|p| p + DVec3::X * 3.0 * k as f64), DVec3::NEG_Y, 0.5);
    }
    assert_eq!(least(&hanging), 5, "side by side below a ceiling");
    let mut chain = Pile::new();
    for k in 0..5 {
        chain.body(1.0, DVec3::Y * (-0.5 - k as f64), 1.0);
        chain.site(k, k.checked_sub(1), &FOOT.map(|p| p - DVec3::Y * k as f64), DVec3::NEG_Y, 0.5);
    }
    assert_eq!(glued(&chain, "a chain").len(), 5);
    assert_eq!(least(&chain), 1, "one below the other: each could push the one above");
}

#[test]
fn a_slope_needs_glue_beyond_the_reduced_friction() {
    for (mu, expected) in [(0.45, vec![0]), (0.55, vec![])] {
        let mut pile = Pile::new();
        pile.body(1.0, DVec3::Y * 0.2, 0.7);
        pile.site(0, None, &FOOT, DVec3::Y, mu);
        // Gravity leans by a slope of 0.25; friction counts by half.
        pile.gravity = DVec3::new(0.25, -1.0, 0.0) * 9.81;
        assert_eq!(glued(&pile, "on a slope"), expected, "friction {mu}");
    }
}

#[test]
fn a_peg_without_contacts_is_glued() {
    let mut pile = Pile::new();
    pile.body(1.0, DVec3::Y, 1.0);
    pile.peg(0, None, DVec3::new(0.3, 0.1, 0.0));
    assert_eq!(glued(&pile, "a peg"), [0]);
    // A peg between touches that carry.
    let mut pile = Pile::new();
    pile.body(1.0, DVec3::Y * 0.5, 1.0);
    pile.body(1.0, DVec3::new(2.0, 0.5, 0.0), 1.0);
    pile.body(1.0, DVec3::Y * 1.5, 1.0);
    pile.site(0, None, &FOOT, DVec3::Y, 0.5);
    pile.peg(1, None, DVec3::X * 2.0);
    pile.site(2, Some(0), &FOOT.map(|p| p + DVec3::Y), DVec3::Y, 0.5);
    assert_eq!(glued(&pile, "a peg between sites"), [1]);
}

#[test]
fn two_bodies() {
    let on_top = of_blocks(&[cube(0.0, 0.0), cube(0.3, 1.0)], false, 0.5);
    assert_eq!(glued(&on_top, "one on the other"), NONE);
    let over_the_edge = of_blocks(&[cube(0.0, 0.0), cube(0.7, 1.0)], false, 0.5);
    assert_eq!(glued(&over_the_edge, "over the edge"), [1]);
    // Hangs below one that rests on a table; the table carries both.
    let mut hanging = Pile::new();
    hanging.body(1.0, DVec3::Y * 0.5, 1.0);
    hanging.body(0.5, DVec3::Y * -0.5, 1.0);
    hanging.site(0, None, &FOOT, DVec3::Y, 0.5);
    hanging.site(1, Some(0), &FOOT.map(|p| p * 0.5), DVec3::NEG_Y, 0.5);
    assert_eq!(glued(&hanging, "one hangs"), [1]);
    let pile = hanging.place(&OPTIONS);
    let pull = pile.joints[0].force + pile.forces[4..].iter().sum::<DVec3>();
    assert!((pull + 0.5 * GRAVITY).length() < 1e-4, "{pull}");
}

/// Cubes in a row from a wall: the joint beyond which m cubes hang carries m weights, and the moment m^2/2 weights.
#[test]
fn a_cantilever_has_a_dot_in_every_joint() {
    for count in [1, 2, 5, 10, 20] {
        let pile = cantilever(count);
        let placed = pile.place(&OPTIONS);
        pile.certify(&placed, &OPTIONS, "cantilever");
        assert_eq!(joints(&placed), (0..count).collect::<Vec<_>>());
        let weight = 2.0 * GRAVITY.length();
        for joint in &placed.joints {
            let hang = (count - joint.site) as f64;
            let contacts = pile.sites[joint.site].contacts.clone();
            // Moments about the joint: what the joint carries in all, contacts beside the joint.
            let center = pile.sites[joint.site].center;
            let beside = contacts.map(|c| (pile.contacts[c].point - center).cross(placed.forces[c]));
            let moment = (joint.moment + beside.sum::<DVec3>()) / weight;
            let exact = DVec3::Z * (hang * hang / 2.0);
            assert!((moment - exact).length() < 1e-3 * (1.0 + exact.length()), "{hang} hang: {moment}, not {exact}");
        }
        // Where the edge below presses, the joint also pulls at a lever of half a cube.
        let arm = pile.sites[0].arm;
        let loads: Vec<f64> =
            placed.joints.iter().map(|joint| joint.force.length().hypot(joint.moment.length() / arm)).collect();
        let least = (count * count) as f64 / 2.0 * weight / arm.hypot(0.5);
        let most = 1.2 * least + count as f64 * weight;
        assert!((0.99 * least..most).contains(&loads[0]), "{count} cubes: {} of {least}", loads[0]);
        assert!(loads.is_sorted_by(|a, b| a > b), "{loads:?}");
    }
}

#[test]
fn disconnected_parts_do_not_disturb_each_other() {
    let parts = [of_blocks(&[cube(0.0, 0.0), cube(0.7, 1.0)], false, 0.5), of_blocks(&[cube(9.0, 0.0)], false, 0.5)];
    let both = of_blocks(&[cube(0.0, 0.0), cube(0.7, 1.0), cube(9.0, 0.0)], false, 0.5);
    assert_eq!(glued(&parts[1], "alone"), NONE);
    assert_eq!(glued(&both, "both"), glued(&parts[0], "alone"));
}

/// A ball on a point spans three directions of six: balance without glue is no matter of the others.
#[test]
fn few_directions_spoil_nothing() {
    let mut pile = of_blocks(&[cube(0.0, 0.0), cube(0.7, 1.0), cube(1.4, 2.0)], false, 0.5);
    for (k, beside) in [0.0, 0.1].into_iter().enumerate() {
        let x = 9.0 + k as f64;
        let ball = pile.body(1.0, DVec3::new(x, 1.0, 0.0), 0.5);
        pile.site(ball, None, &[DVec3::new(x + beside, 0.5, 0.0)], DVec3::Y, 0.5);
        pile.sites.last_mut().expect("just added").may_glue = false;
    }
    let placed = fallen(&pile, "beside balls");
    assert_eq!((joints(&placed), placed.fallen), (vec![0, 1, 2], vec![4]));
}

/// What nothing joins to the ground cannot stand; all else does.
#[test]
fn a_floating_body_falls_and_spoils_nothing() {
    let mut pile = of_blocks(&[cube(0.0, 0.0), cube(0.7, 1.0), cube(1.4, 2.0)], false, 0.5);
    pile.body(1.0, DVec3::Y * 9.0, 1.0);
    let placed = fallen(&pile, "beside a floating body");
    assert_eq!((joints(&placed), placed.fallen), (vec![0, 1, 2], vec![3]));
}

/// What only a forbidden joint could hold falls.
#[test]
fn forbidden_touches_are_not_glued() {
    let mut pile = of_blocks(&[cube(0.0, 0.0), cube(0.7, 1.0)], false, 0.5);
    pile.sites[1].may_glue = false;
    let placed = fallen(&pile, "forbidden");
    assert_eq!((joints(&placed), placed.fallen), (vec![], vec![1]));
}
