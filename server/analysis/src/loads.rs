//! What each body carries, and what rests on it.

use super::PileContacts;
use glam::DVec3;
use std::collections::BTreeSet;

/// A body carries another if it lifts it by more than this share of its weight.
const LIFTS: f64 = 0.01;

/// The loads that forces show.
pub struct Loads {
    /// Sum of what others press down on it, engine units. Shape `[body]`.
    pub down: Vec<f64>,
    /// Bodies that it carries directly, ascending. Shape `[body]`.
    pub carries: Vec<Vec<usize>>,
}

impl Loads {
    /// The bodies that it carries, directly or through others, ascending.
    pub fn rests_on(&self, body: usize) -> Vec<usize> {
        let (mut found, mut open) = (BTreeSet::new(), self.carries[body].clone());
        while let Some(next) = open.pop() {
            if next != body && found.insert(next) {
                open.extend(&self.carries[next]);
            }
        }
        found.into_iter().collect()
    }
}

/// From the forces of the contacts, shape `[contact]`.
pub fn of(pile: &PileContacts, forces: &[DVec3]) -> Loads {
    let count = pile.bodies.len();
    let mut loads = Loads { down: vec![0.0; count], carries: vec![Vec::new(); count] };
    for (contacts, _) in &pile.pairs {
        let first = &pile.contacts[contacts.start];
        let Some(other) = first.other else { continue };
        let lift: f64 = forces[contacts.clone()].iter().map(|f| f.y).sum();
        let (above, below) = if lift > 0.0 { (first.body, other) } else { (other, first.body) };
        loads.down[below] += lift.abs();
        if lift.abs() > LIFTS * pile.bodies[above].mass {
            loads.carries[below].push(above);
        }
    }
    loads.carries.iter_mut().for_each(|carries| carries.sort_unstable());
    loads
}
