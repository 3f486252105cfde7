//! What contacts cannot carry: the splitting method against Clarabel's count and bound.

use super::Pile;
use super::piles::{KINDS, cantilever, random};
use cairn_statics::global::{GlobalProblem, Objective, analyse};
use cairn_statics::glue;
use glam::DVec3;
use std::ops::ControlFlow;

/// A body lacks support if it misses more than this, in its weight.
const ENOUGH: f64 = 0.1;

fn missing(pile: &Pile) -> Vec<f64> {
    glue::missing(&pile.problem(), ENOUGH, &mut || ControlFlow::Continue(())).expect("a valid pile").0
}

fn count(missing: &[f64]) -> usize {
    missing.iter().filter(|e| **e > ENOUGH).count()
}

#[test]
fn it_finds_as_many_as_clarabel() {
    let (mut ours, mut theirs, mut worst) = (0, 0, 0);
    for seed in 0..KINDS * 6 {
        let pile = random(seed);
        let found = missing(&pile);
        let problem = GlobalProblem { bodies: &pile.bodies, contacts: &pile.contacts, gravity: pile.gravity };
        let judge = analyse(&problem, Objective::SumOfNorms { sharpen: 2 }).expect("a valid pile");
        let (mine, judged) = (count(&found), count(&judge.imbalance));
        let total: f64 = found.iter().sum();
        println!(
            "pile {seed}: {mine} of {} lack support, {judged} by Clarabel; {total:.3}, at least {:.3}",
            found.len(),
            judge.bound
        );
        assert!(
            total >= judge.bound * (1.0 - 1e-6) - 1e-9,
            "pile {seed}: {total} is less than is possible: {}",
            judge.bound
        );
        (ours, theirs, worst) = (ours + mine, theirs + judged, worst.max(mine.abs_diff(judged)));
    }
    println!("in all {ours}, {theirs} by Clarabel");
    assert!(theirs > 20, "some piles lack support");
    assert!(worst <= 2 && ours.abs_diff(theirs) * 20 <= theirs, "{ours} of {theirs}, {worst} apart");
}

#[test]
fn what_floats_misses_its_weight_and_nothing_else_does() {
    let mut pile = cantilever(1);
    pile.sites.clear();
    pile.contacts.clear();
    let stands = pile.body(3.0, DVec3::new(5.0, 0.5, 0.0), 0.9);
    let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(x, z)| DVec3::new(5.0 + x, 0.0, z));
    pile.site(stands, None, &corners, DVec3::Y, 0.5);
    let found = missing(&pile);
    assert!((found[0] - 1.0).abs() < 1e-6 && found[stands] < 1e-3, "{found:?}");
}
