//! Choosing again: from known dots, and at another price.

use super::piles::{KINDS, random};
use super::{OPTIONS, dots};
use cairn_core::equilibrium::glue::{self, GlueOptions};
use std::ops::ControlFlow;

/// Friction is lost at the first tenth of the bodies.
#[test]
fn known_dots_save_work_and_mostly_stay() {
    let (mut iterations, mut stayed, mut all) = ([0, 0], 0, 0);
    for seed in 0..KINDS * 4 {
        let mut pile = random(seed);
        let before = pile.place(&OPTIONS);
        let slippery = pile.bodies.len() / 10;
        pile.contacts.iter_mut().filter(|c| c.body < slippery).for_each(|c| c.friction = 0.0);
        let anew = pile.place(&OPTIONS);
        let mut going = || ControlFlow::Continue(());
        let again = glue::place_again(&pile.problem(), &OPTIONS, &before.dots, &mut going).expect("a valid pile");
        pile.certify(&again, &OPTIONS, &format!("pile {seed}"));
        iterations = [iterations[0] + anew.iterations, iterations[1] + again.iterations];
        let (before, again) = (dots(&before), dots(&again));
        stayed += before.iter().filter(|touch| again.contains(touch)).count();
        all += before.len();
    }
    println!("iterations anew and again: {iterations:?}; {stayed} of {all} dots stayed");
    assert!(iterations[1] < iterations[0] * 4 / 5 && stayed > all * 4 / 5, "{iterations:?}, {stayed} of {all}");
}

#[test]
fn dear_normal_forces_are_fewer_and_need_more_dots() {
    let (mut presses, mut counts) = (Vec::new(), Vec::new());
    for normal_price in [0.02, 0.3, 1.0] {
        let options = GlueOptions { normal_price, ..OPTIONS };
        let (mut press, mut count) = (0.0, 0);
        for seed in 0..KINDS * 2 {
            let pile = random(seed);
            let placed = pile.place(&options);
            pile.certify(&placed, &options, &format!("pile {seed} at {normal_price}"));
            let weight: f64 = pile.bodies.iter().map(|b| b.mass * 9.81).sum();
            press += pile.pressure(&placed) / weight;
            count += placed.dots.len();
        }
        presses.push(press);
        counts.push(count);
    }
    println!("pressure {presses:.1?} weights, dots {counts:?}");
    assert!(presses.is_sorted_by(|a, b| a > b) && counts.is_sorted(), "{presses:?} {counts:?}");
}
