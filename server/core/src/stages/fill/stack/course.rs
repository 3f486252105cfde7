//! Layers of one kind, where several kinds are stacked.

use super::Filling;
use super::field::{Footprint, Spot};
use rand::RngExt;

/// A layer of one kind: what is laid beside each other is equally high, and carries what comes on top of it.
pub struct Course {
    pub prop: usize,
    pub height: f64,
}

impl Course {
    /// Whether such a place is in a layer above this one.
    pub fn is_below(&self, footprint: &Footprint, spot: &Spot) -> bool {
        spot.height > self.height + footprint.height / 2.0
    }
}

/// The kind that is laid next, the tidier the likelier: that of the course or, for a new one, what there is too little of. `None`: any,
/// by weight.
pub fn kind(filling: &mut Filling, course: Option<&Course>) -> Option<usize> {
    let drawn: Vec<(usize, f64)> =
        filling.among.iter().map(|&i| (i, filling.scene.props[i].weight)).filter(|(_, weight)| *weight > 0.0).collect();
    if drawn.len() < 2 || !filling.rng.random_bool(filling.params.fill.order) {
        return None;
    }
    if let Some(course) = course.filter(|course| drawn.iter().any(|(i, _)| *i == course.prop)) {
        return Some(course.prop);
    }
    let mut there = vec![0.0; filling.scene.props.len()];
    filling.loose().for_each(|id| there[filling.world.bodies()[id].prop] += 1.0);
    drawn.into_iter().min_by(|a, b| (there[a.0] / a.1).total_cmp(&(there[b.0] / b.1))).map(|(i, _)| i)
}
