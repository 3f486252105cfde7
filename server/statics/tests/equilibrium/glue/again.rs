//! Choosing again: from known joints, and at another price.

use super::piles::{KINDS, random};
use super::{OPTIONS, joints};
use cairn_statics::glue::{self, GlueOptions};
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
        let fresh = pile.place(&OPTIONS);
        let mut going = || ControlFlow::Continue(());
        let again = glue::place_again(&pile.problem(), &OPTIONS, &before.joints, &mut going).expect("a valid pile");
        pile.certify(&again, &OPTIONS, &format!("pile {seed}"));
        iterations = [iterations[0] + fresh.iterations, iterations[1] + again.iterations];
        let (before, again) = (joints(&before), joints(&again));
        stayed += before.iter().filter(|site| again.contains(site)).count();
        all += before.len();
    }
    println!("iterations from no joints, and from known ones: {iterations:?}; {stayed} of {all} joints stayed");
    assert!(iterations[1] < iterations[0] * 4 / 5 && stayed > all * 4 / 5, "{iterations:?}, {stayed} of {all}");
}

#[test]
fn fewer_rounds_are_sooner_done_and_leave_more_dots() {
    let (mut iterations, mut counts) = (Vec::new(), Vec::new());
    for rounds in [glue::LEAST_ROUNDS, 4, glue::MOST_ROUNDS] {
        let options = GlueOptions { rounds, ..OPTIONS };
        let (mut sum, mut count) = (0, 0);
        for seed in 0..KINDS * 4 {
            let pile = random(seed);
            let placed = pile.place(&options);
            pile.certify(&placed, &options, &format!("pile {seed}, {rounds} rounds"));
            (sum, count) = (sum + placed.iterations, count + placed.joints.len());
        }
        iterations.push(sum);
        counts.push(count);
    }
    println!("iterations {iterations:?}, joints {counts:?}");
    assert!(iterations.is_sorted_by(|a, b| a < b) && counts[2] < counts[0], "{iterations:?} {counts:?}");
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
            count += placed.joints.len();
        }
        presses.push(press);
        counts.push(count);
    }
    println!("pressure {presses:.1?} weights, joints {counts:?}");
    assert!(presses.is_sorted_by(|a, b| a > b) && counts.is_sorted(), "{presses:?} {counts:?}");
}

/// A price of all touches is the price that is asked for; one of a part of them acts there.
#[test]
fn touches_may_have_a_price_of_their_own() {
    let expensive = GlueOptions { normal_price: 1.0, ..OPTIONS };
    let (mut press, mut everywhere) = ([0.0, 0.0], 0.0);
    for seed in 0..KINDS * 2 {
        let pile = random(seed);
        let weight: f64 = pile.bodies.iter().map(|b| b.mass * 9.81).sum();
        let priced = |which: &dyn Fn(usize) -> bool| {
            let mut pile = random(seed);
            pile.sites.iter_mut().filter(|t| which(t.body)).for_each(|t| t.normal_price = expensive.normal_price);
            let placed = pile.place(&OPTIONS);
            pile.certify(&placed, &OPTIONS, &format!("pile {seed}"));
            placed
        };
        assert_eq!(priced(&|_| true), pile.place(&expensive), "pile {seed}");
        let half = priced(&|body| 2 * body < pile.bodies.len());
        press[0] += pile.pressure(&pile.place(&OPTIONS)) / weight;
        press[1] += pile.pressure(&half) / weight;
        everywhere += pile.pressure(&pile.place(&expensive)) / weight;
    }
    println!("pressure {press:.1?} weights, {everywhere:.1} where all is expensive");
    assert!(press[1] < press[0] && press[1] > everywhere, "{press:?} {everywhere}");
}
