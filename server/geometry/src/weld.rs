//! Points that are one point: bit-exact welding, or within a reach, in the order of first appearance.

use glam::DVec3;
use std::collections::HashMap;

/// The points without those that are equal to an earlier one, or within `reach` (m, 0: none) of it; and for each given
/// point the number of the one that stands for it.
pub fn merged(points: &[DVec3], reach: f64) -> (Vec<u32>, Vec<DVec3>) {
    let mut welder = Welder::default();
    let numbers = match reach > 0.0 {
        true => snap(points, reach).into_iter().map(|p| welder.insert(p)).collect(),
        false => points.iter().map(|&p| welder.insert(p)).collect(),
    };
    (numbers, welder.points)
}

/// Each point moved onto the first one within `reach` of it.
fn snap(points: &[DVec3], reach: f64) -> Vec<DVec3> {
    // Points by cell of side `reach`: all points within reach lie in the cells around. Floored reals as keys have no
    // range to overflow.
    let mut cells: HashMap<[u64; 3], Vec<DVec3>> = HashMap::new();
    let key = |cell: DVec3| (cell + 0.0).to_array().map(f64::to_bits);
    let near = |cells: &HashMap<[u64; 3], Vec<DVec3>>, cell: DVec3, p: DVec3| {
        (0..27).find_map(|k| {
            let step = DVec3::new(f64::from(k % 3), f64::from(k / 3 % 3), f64::from(k / 9)) - 1.0;
            cells.get(&key(cell + step))?.iter().find(|q| q.distance_squared(p) <= reach * reach).copied()
        })
    };
    let place = |&p: &DVec3| {
        let cell = (p / reach).floor();
        near(&cells, cell, p).unwrap_or_else(|| {
            cells.entry(key(cell)).or_default().push(p);
            p
        })
    };
    points.iter().map(place).collect()
}

/// A set of points that gives each a number. An open table of indices keeps it at 8 bytes a point beside the
/// points themselves, and its numbers depend on nothing but the order of insertion.
#[derive(Default)]
pub struct Welder {
    points: Vec<DVec3>,
    /// In each slot the number of a point, plus 1; 0 in a free one.
    table: Vec<u32>,
}

impl Welder {
    /// The number of `point`; -0 and 0 are one.
    pub fn insert(&mut self, point: DVec3) -> u32 {
        let point = point + 0.0;
        if 2 * (self.points.len() + 1) > self.table.len() {
            self.grow();
        }
        let slot = self.slot(point);
        if self.table[slot] == 0 {
            assert!(self.points.len() < u32::MAX as usize, "more points than a u32 can number");
            self.points.push(point);
            self.table[slot] = self.points.len() as u32;
        }
        self.table[slot] - 1
    }

    pub fn into_points(self) -> Vec<DVec3> {
        self.points
    }

    /// The place of `point`, or the free place for it.
    fn slot(&self, point: DVec3) -> usize {
        let mask = self.table.len() - 1;
        let mut slot = hash(point) as usize & mask;
        loop {
            match self.table[slot] {
                0 => return slot,
                number if self.points[number as usize - 1] == point => return slot,
                _ => slot = (slot + 1) & mask,
            }
        }
    }

    fn grow(&mut self) {
        self.table = vec![0; (2 * self.table.len()).max(64)];
        for index in 0..self.points.len() {
            let slot = self.slot(self.points[index]);
            self.table[slot] = index as u32 + 1;
        }
    }
}

/// Mixes the bits of three coordinates (the finaliser of SplitMix64 after each).
fn hash(point: DVec3) -> u64 {
    point.to_array().iter().fold(0, |state: u64, x| {
        let mut z = (state ^ x.to_bits()).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_points_get_one_number_in_order_of_appearance() {
        let mut welder = Welder::default();
        for i in 0..1000 {
            assert_eq!(welder.insert(DVec3::new(f64::from(i) * 0.1, 1.0, 0.0)), i as u32);
        }
        assert_eq!(welder.insert(DVec3::new(0.0, 1.0, -0.0)), 0);
        assert_eq!(welder.insert(DVec3::new(f64::from(7) * 0.1, 1.0, 0.0)), 7);
        assert_eq!(welder.into_points().len(), 1000);
    }
}
