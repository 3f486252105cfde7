//! Boxes along the axes.

use super::layer::vector;
use glam::{DAffine3, DVec3};
use openusd::gf;

/// A box along the axes; empty at first.
#[derive(Clone, Copy)]
pub struct BoundingBox {
    low: DVec3,
    high: DVec3,
}

impl Default for BoundingBox {
    fn default() -> Self {
        BoundingBox { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY }
    }
}

impl BoundingBox {
    pub fn add(&mut self, point: DVec3) {
        self.low = self.low.min(point);
        self.high = self.high.max(point);
    }

    /// Takes in another box, moved.
    pub fn join(&mut self, other: &BoundingBox, by: DAffine3) {
        if other.is_empty() {
            return;
        }
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { other.low[axis] } else { other.high[axis] };
            self.add(by.transform_point3(DVec3::new(pick(0), pick(1), pick(2))));
        }
    }

    /// Whether nothing is in it.
    pub fn is_empty(&self) -> bool {
        self.low.x > self.high.x
    }

    /// The attribute `extent` of a prim.
    pub fn extent(&self) -> Vec<gf::Vec3f> {
        if self.is_empty() { vec![gf::Vec3f::from([0.0; 3]); 2] } else { vec![vector(self.low), vector(self.high)] }
    }
}
