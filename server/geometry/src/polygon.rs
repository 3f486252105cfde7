//! Polygons that are flat, or nearly so, as triangles.

use crate::SINGLE_PRECISION;
use earcut::Earcut;
use glam::DVec3;
use std::collections::HashMap;

/// Ears of polygons with more corners would take too long: these are cut as fans.
const MOST_CORNERS: usize = 100_000;

/// The plane nearest to a polygon.
pub struct Plane {
    pub middle: DVec3,
    /// Unit length; 0 for a polygon that encloses no area.
    pub normal: DVec3,
    /// What the polygon encloses in its plane.
    pub area: f64,
}

impl Plane {
    /// Newell's: the normal is the sum of the areas that the polygon encloses along each axis.
    pub fn of(points: &[DVec3]) -> Plane {
        let middle = points.iter().sum::<DVec3>() / points.len() as f64;
        let pairs = points.iter().zip(points.iter().cycle().skip(1));
        let normal: DVec3 = pairs.map(|(&a, &b)| (a - middle).cross(b - middle)).sum();
        Plane { middle, normal: normal.normalize_or_zero(), area: normal.length() / 2.0 }
    }

    pub fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.middle)
    }

    /// Ears of the polygon that it is in its plane, which face as it does. They lack corners that lie on edges; where
    /// the polygon crosses itself, they are of no use.
    pub fn ears(&self, points: &[DVec3]) -> Vec<[u32; 3]> {
        let (u, v) = self.normal.try_normalize().unwrap_or(DVec3::Y).any_orthonormal_pair();
        let flat: Vec<[f64; 2]> = points.iter().map(|&p| [u.dot(p - self.middle), v.dot(p - self.middle)]).collect();
        let mut ears: Vec<u32> = Vec::new();
        Earcut::new().earcut(flat.iter().copied(), &[], &mut ears);
        let twice = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|corner| flat[corner as usize]);
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        };
        let mut ears: Vec<[u32; 3]> = ears.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        // All ears face the same side.
        if ears.iter().map(twice).sum::<f64>() < 0.0 {
            ears.iter_mut().for_each(|t| t.swap(1, 2));
        }
        ears
    }
}

/// The triangles of a polygon, as places in the list of its corners, all of which they have. They face as it does: a
/// fan around its first corner where that covers it and no more, else ears. Where it crosses itself, the fan.
pub fn triangles(points: &[DVec3]) -> Vec<[u32; 3]> {
    let fan: Vec<[u32; 3]> = (1..points.len().saturating_sub(1) as u32).map(|k| [0, k, k + 1]).collect();
    if points.len() < 4 || points.len() > MOST_CORNERS {
        return fan;
    }
    let plane = Plane::of(points);
    let along = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|corner| points[corner as usize]);
        (b - a).cross(c - a).dot(plane.normal) / 2.0
    };
    let rounding = SINGLE_PRECISION * plane.area;
    if fan.iter().all(|t| along(t) >= -rounding) {
        return fan;
    }
    let ears = plane.ears(points);
    let covered: f64 = ears.iter().map(|t| along(t).abs()).sum();
    if (covered - plane.area).abs() > rounding * points.len() as f64 {
        return fan;
    }
    with_corners_on_edges(ears, points.len() as u32).unwrap_or(fan)
}

/// The ears with the corners that they lack, which lie on the polygon's edges: those between two that an ear has are
/// joined to its third corner. `None` where an edge has no ear.
fn with_corners_on_edges(mut ears: Vec<[u32; 3]>, count: u32) -> Option<Vec<[u32; 3]>> {
    let mut taken = vec![false; count as usize];
    ears.iter().flatten().for_each(|&corner| taken[corner as usize] = true);
    let kept: Vec<u32> = (0..count).filter(|&corner| taken[corner as usize]).collect();
    let edges = |t: [u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let mut owner: HashMap<[u32; 2], usize> = HashMap::new();
    for (i, &ear) in ears.iter().enumerate() {
        owner.extend(edges(ear).map(|edge| (edge, i)));
    }
    for (&from, &to) in kept.iter().zip(kept.iter().cycle().skip(1)) {
        let lacking: Vec<u32> =
            (1..count).map(|step| (from + step) % count).take_while(|&corner| corner != to).collect();
        if lacking.is_empty() {
            continue;
        }
        let ear = *owner.get(&[from, to])?;
        let apex = *ears[ear].iter().find(|&&corner| corner != from && corner != to)?;
        let line: Vec<u32> = std::iter::once(from).chain(lacking).chain([to]).collect();
        for (n, pair) in line.windows(2).enumerate() {
            let part = [pair[0], pair[1], apex];
            let place = if n == 0 { ear } else { ears.len() };
            if n == 0 {
                ears[ear] = part
            } else {
                ears.push(part)
            }
            owner.extend(edges(part).map(|edge| (edge, place)));
        }
    }
    Some(ears)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec2};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;
    use std::f64::consts::TAU;

    fn area([a, b, c]: [DVec3; 3]) -> DVec3 {
        (b - a).cross(c - a) / 2.0
    }

    /// Holds the triangles of a polygon against it: they face as it does, cover it once, have all of its corners, and
    /// leave no gap between them nor at its edges.
    fn check(case: &str, points: &[DVec3]) {
        let plane = Plane::of(points);
        let found = triangles(points);
        assert_eq!(found.len(), points.len() - 2, "{case}");
        let areas: Vec<f64> = found.iter().map(|t| area(t.map(|i| points[i as usize])).dot(plane.normal)).collect();
        assert!(areas.iter().all(|area| *area >= -1e-9 * plane.area), "{case}: {areas:?}");
        let sum: f64 = areas.iter().sum();
        assert!((sum / plane.area - 1.0).abs() < 1e-6, "{case}: {sum} of {}", plane.area);
        let mut open: HashMap<[u32; 2], i32> = HashMap::new();
        for t in &found {
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                *open.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
        let count = points.len() as u32;
        for ([a, b], side) in open {
            let is_rim = (a + 1) % count == b || (b + 1) % count == a;
            assert_eq!(side != 0, is_rim, "{case}: the edge from {a} to {b}");
        }
    }

    fn flat(points: &[[f64; 2]]) -> Vec<DVec3> {
        points.iter().map(|&p| DVec2::from_array(p).extend(0.0)).collect()
    }

    #[test]
    fn a_notch_is_left_open() {
        let l = [[10.0, 0.0], [10.0, 3.0], [3.0, 3.0], [3.0, 10.0], [0.0, 10.0], [0.0, 0.0]];
        for first in 0..6 {
            let mut turned = l;
            turned.rotate_left(first);
            check(&format!("L from {first}"), &flat(&turned));
            turned.reverse();
            check(&format!("L from {first}, backward"), &flat(&turned));
        }
        check("arrow head", &flat(&[[0.0, 0.0], [2.0, 3.0], [0.0, 1.0], [-2.0, 3.0]]));
        check("arrow head from its side", &flat(&[[2.0, 3.0], [0.0, 1.0], [-2.0, 3.0], [0.0, 0.0]]));
    }

    #[test]
    fn corners_on_edges_stay() {
        let rim = [
            [10.0, 0.0],
            [10.0, 3.0],
            [6.0, 3.0],
            [3.0, 3.0],
            [3.0, 7.0],
            [3.0, 10.0],
            [0.0, 10.0],
            [0.0, 0.0],
            [4.0, 0.0],
            [7.0, 0.0],
        ];
        for first in 0..rim.len() {
            let mut turned = rim;
            turned.rotate_left(first);
            check(&format!("L from {first}"), &flat(&turned));
        }
    }

    #[test]
    fn random_polygons_are_covered_once() {
        for seed in 0..300 {
            let mut random = Pcg64::seed_from_u64(seed);
            let count = random.random_range(4..40_u32);
            // Around a middle that sees all corners: it crosses itself nowhere.
            let turn = DQuat::from_scaled_axis(DVec3::from_array([(); 3].map(|()| random.random_range(-3.0..3.0))));
            let points: Vec<DVec3> = (0..count)
                .map(|k| {
                    let (angle, radius) = (f64::from(k) / f64::from(count) * TAU, random.random_range(0.1..1.0));
                    turn * DVec3::new(radius * angle.cos(), radius * angle.sin(), 5.0)
                })
                .collect();
            check(&format!("polygon {seed}"), &points);
        }
    }

    #[test]
    fn what_crosses_itself_has_a_fan() {
        let bow = flat(&[[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 1.0]]);
        assert_eq!(triangles(&bow).len(), 2);
        assert!(triangles(&bow[..2]).is_empty() && triangles(&[DVec3::ZERO; 5]).len() == 3);
    }
}
