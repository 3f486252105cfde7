//! The splitting method against Clarabel, and against greedy removal.

use super::piles::{KINDS, random};
use super::{OPTIONS, Pile, joints};
use cairn_statics::glue::interior_point;

const PILES: u64 = KINDS * 6;

#[test]
fn about_as_few_dots_as_clarabel() {
    let (mut sums, mut presses, mut bad) = ([0, 0], [0.0, 0.0], Vec::new());
    for seed in 0..PILES {
        let pile = random(seed);
        let (placed, judge) = (pile.place(&OPTIONS), pile.place_by_clarabel(&OPTIONS));
        let what = format!("pile {seed} of {} bodies", pile.bodies.len());
        let (ours, theirs) = (placed.joints.len(), judge.joints.len());
        println!("{what}: {ours} joints, {theirs} by Clarabel; balanced by a cone program: {}", placed.by_cone_program);
        pile.certify(&placed, &OPTIONS, &what);
        pile.certify(&judge, &OPTIONS, &format!("{what}, by Clarabel"));
        if ours as f64 > (1.15 * theirs as f64).max(theirs as f64 + 1.0) {
            bad.push(seed);
        }
        sums = [sums[0] + ours, sums[1] + theirs];
        let weight: f64 = pile.bodies.iter().map(|b| b.mass * 9.81).sum();
        presses = [presses[0] + pile.pressure(&placed) / weight, presses[1] + pile.pressure(&judge) / weight];
    }
    println!("in all {} joints, {} by Clarabel; pressure {presses:.1?} weights", sums[0], sums[1]);
    assert!(bad.is_empty(), "many more than by Clarabel: {bad:?}");
}

/// The normal forces may rise by so much, in sum, where a joint goes: what would wedge instead keeps it.
const WEDGE: f64 = 1.2;

/// Joints that go one after the other while the rest still balances the pile.
fn removable(pile: &Pile, mut kept: Vec<usize>) -> usize {
    let at = |joints: &[usize]| {
        let placed = interior_point::place_at(&pile.problem(), &OPTIONS, joints).expect("a valid pile");
        (placed.stands(), pile.pressure(&placed))
    };
    let (all, most) = (kept.len(), at(&kept).1 * WEDGE);
    for site in kept.clone() {
        let without: Vec<usize> = kept.iter().copied().filter(|t| *t != site).collect();
        let (stands, presses) = at(&without);
        if stands && presses <= most {
            kept = without;
        }
    }
    all - kept.len()
}

#[test]
fn few_dots_can_be_removed() {
    let (mut sums, mut bad) = ([0, 0, 0], Vec::new());
    for seed in 0..PILES {
        let pile = random(seed);
        let (chosen, judge) = (joints(&pile.place(&OPTIONS)), joints(&pile.place_by_clarabel(&OPTIONS)));
        let all = chosen.len();
        let (found, of_judge) = (removable(&pile, chosen), removable(&pile, judge));
        println!("pile {seed}: {found} of {all} joints can be removed, {of_judge} of Clarabel's");
        // Where Clarabel's choice is as poor, the reweighting is to blame.
        if found as f64 > (0.2 * all as f64).max(1.0).max(of_judge as f64) {
            bad.push(seed);
        }
        sums = [sums[0] + all, sums[1] + found, sums[2] + of_judge];
    }
    println!("in all {} of {} joints can be removed, {} of Clarabel's", sums[1], sums[0], sums[2]);
    assert!(bad.is_empty(), "many can be removed: {bad:?}");
    assert!(sums[1] * 10 <= sums[0], "{sums:?}");
}
