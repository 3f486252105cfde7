//! Layers of one kind, where several kinds are stacked.

use super::field::{Footprint, Spot};
use crate::fill::filling::Filling;
use rand::RngExt;

/// A layer of one kind: its bodies lie beside each other, are equally high, and carry the next layer.
pub struct Course {
    pub prop: usize,
    pub height: f64,
}

impl Course {
    /// Such a place is in a layer above this one.
    pub fn is_below(&self, footprint: &Footprint, spot: &Spot) -> bool {
        spot.height > self.height + footprint.height / 2.0
    }
}

/// The kind that is laid next, one of `props`; the tidier the pile, the likelier: that of the course or, for a new one,
/// the kind that is missing most. `None`: any, by weight.
pub fn kind(filling: &mut Filling, props: &[usize], course: Option<&Course>) -> Option<usize> {
    let task = filling.task;
    if props.len() < 2 || !filling.rng.random_bool(task.params.fill.order) {
        return None;
    }
    if let Some(course) = course.filter(|course| props.contains(&course.prop)) {
        return Some(course.prop);
    }
    let mut there = vec![0.0; task.scene.props.len()];
    filling.world.loose().for_each(|id| there[filling.world.body(id).prop] += 1.0);
    let share = |i: usize| there[i] / task.scene.props[i].weight;
    props.iter().copied().min_by(|&a, &b| share(a).total_cmp(&share(b)))
}
