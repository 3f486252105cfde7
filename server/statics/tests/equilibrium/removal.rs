//! What stands without a body, against what anybody can see.

use crate::wall::face;
use cairn_statics::global::{GlobalBody, GlobalContact, GlobalProblem};
use cairn_statics::limit::{self, Accuracy, LimitProblem, Load};
use cairn_statics::removal::{Outcome, Removals};
use glam::DVec3;
use std::ops::ControlFlow;

const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

/// The share of friction that a safe removal may use.
const SHARE: f64 = 0.8;

fn balanced(bodies: &[GlobalBody], contacts: &[GlobalContact]) -> Vec<DVec3> {
    let contacts: Vec<GlobalContact> =
        contacts.iter().map(|c| GlobalContact { friction: SHARE * c.friction, ..*c }).collect();
    let contacts = &contacts;
    let (dead, live) = (vec![Load::default(); bodies.len()], limit::weights(bodies, GRAVITY));
    let gravity = GRAVITY.length();
    let limit = limit::find(&LimitProblem {
        bodies,
        contacts,
        gravity,
        dead: &dead,
        live: &live,
        most: 1.0,
        accuracy: Accuracy::Fine,
    });
    let limit = limit.expect("a valid pile");
    assert!(limit.reaches(1.0), "{:?}", limit.stands_to);
    limit.forces
}

fn without(bodies: &[GlobalBody], contacts: &[GlobalContact], body: usize) -> Outcome {
    let pile = GlobalProblem { bodies, contacts, gravity: GRAVITY };
    let mut removals = Removals::new(pile, balanced(bodies, contacts), vec![SHARE; contacts.len()]);
    removals.without(body, &mut || ControlFlow::Continue(())).expect("a valid pile")
}

fn is_safe(outcome: &Outcome) -> bool {
    matches!(outcome, Outcome::Safe { .. })
}

/// A plank on three posts: one of the outer ones is needed, the middle one is not.
#[test]
fn a_plank_on_three_posts() {
    let post = |x: f64| GlobalBody { mass: 1.0, center_of_mass: DVec3::new(x, 0.5, 0.0), radius: 0.6 };
    let plank = GlobalBody { mass: 2.0, center_of_mass: DVec3::new(0.0, 1.1, 0.0), radius: 1.2 };
    let bodies = [post(-1.0), post(0.0), post(1.0), plank];
    let feet = [-1.0, 0.0, 1.0].map(|x: f64| [x - 0.1, x + 0.1]);
    let contacts: Vec<GlobalContact> = (0..3)
        .flat_map(|k| [face(k, None, feet[k], 0.0, 0.2, 0.7), face(3, Some(k), feet[k], 1.0, 0.2, 0.7)].concat())
        .collect();
    let outcomes: Vec<Outcome> = (0..4).map(|body| without(&bodies, &contacts, body)).collect();
    // Without an end, the plank still rests on the middle, with its middle between both: nothing falls.
    assert!(outcomes.iter().all(is_safe), "{outcomes:?}");
    let off = GlobalBody { center_of_mass: DVec3::new(0.3, 1.1, 0.0), ..plank };
    let bodies = [bodies[0], bodies[1], bodies[2], off];
    let outcomes: Vec<Outcome> = (0..4).map(|body| without(&bodies, &contacts, body)).collect();
    assert!(is_safe(&outcomes[0]) && is_safe(&outcomes[1]) && is_safe(&outcomes[3]), "{outcomes:?}");
    assert_eq!(outcomes[2], Outcome::Falls { moving: vec![3] });
}

/// Courses of bricks, each with one less than the one below, half a brick to the right of it.
pub fn stair(courses: usize, bricks: usize, friction: f64) -> (Vec<GlobalBody>, Vec<GlobalContact>) {
    let (mut bodies, mut contacts) = (Vec::new(), Vec::new());
    for row in 0..courses {
        for k in 0..bricks - row {
            let (x, y, index) = (k as f64 + row as f64 / 2.0, row as f64 * 0.3, bodies.len());
            bodies.push(GlobalBody { mass: 1.0, center_of_mass: DVec3::new(x, y + 0.15, 0.0), radius: 0.6 });
            if row == 0 {
                contacts.extend(face(index, None, [x - 0.45, x + 0.45], y, 0.25, friction));
                continue;
            }
            let below = index - (bricks - row + 1);
            contacts.extend(face(index, Some(below), [x - 0.45, x - 0.05], y, 0.25, friction));
            contacts.extend(face(index, Some(below + 1), [x + 0.05, x + 0.45], y, 0.25, friction));
        }
    }
    (bodies, contacts)
}

/// A brick at the end of the lowest of two courses carries one that hangs over without it; with a third course on its
/// other half, that one is held down.
#[test]
fn bricks_of_a_stair() {
    let (bodies, contacts) = stair(2, 3, 0.7);
    assert!((3..5).all(|top| is_safe(&without(&bodies, &contacts, top))));
    assert_eq!(without(&bodies, &contacts, 0), Outcome::Falls { moving: vec![3] });
    let (bodies, contacts) = stair(3, 3, 0.7);
    assert!(is_safe(&without(&bodies, &contacts, 0)));
    // Without the middle one, both above lean inwards, and the top one keeps them apart: by friction of 2/3 (a moment
    // of 1 at .05 and 1/2 at .1, against 1/2 at .3), which is more than the cautious share of .7.
    assert_eq!(without(&bodies, &contacts, 1), Outcome::Open);
    let (bodies, contacts) = stair(3, 3, 0.6);
    assert_eq!(without(&bodies, &contacts, 1), Outcome::Falls { moving: vec![3, 4, 5] });
    let (bodies, contacts) = stair(3, 3, 0.9);
    assert!(is_safe(&without(&bodies, &contacts, 1)));
}

/// Taken in the order of safety, everything comes apart, and the forces balance what is left after each step.
#[test]
fn a_stair_comes_apart() {
    let (bodies, contacts) = stair(3, 3, 0.7);
    let pile = GlobalProblem { bodies: &bodies, contacts: &contacts, gravity: GRAVITY };
    let mut removals = Removals::new(pile, balanced(&bodies, &contacts), vec![SHARE; contacts.len()]);
    for body in (0..bodies.len()).rev() {
        let outcome = removals.without(body, &mut || ControlFlow::Continue(()));
        let Ok(Outcome::Safe { forces }) = outcome else { panic!("{body}: {outcome:?}") };
        removals.take(body, &forces);
        for left in 0..body {
            let sum: DVec3 = contacts
                .iter()
                .zip(removals.forces())
                .map(|(c, f)| match c {
                    c if c.body == left => *f,
                    c if c.other == Some(left) => -*f,
                    _ => DVec3::ZERO,
                })
                .sum();
            assert!((sum + GRAVITY).length() < 1e-4, "{left} without {body}: {sum}");
        }
    }
}
