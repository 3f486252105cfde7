//! The smallest rectangle around points in a plane.

use glam::DVec2;
use std::f64::consts::FRAC_PI_2;

/// The turn about Y, as seen in X and Z, that lays the longer edge of the smallest rectangle around these points along
/// X, and the rectangle's edges, the longer one first. It has an edge along one of the convex hull's (Freeman & Shapira
/// 1975).
pub fn smallest_rectangle(points: &[DVec2]) -> (f64, DVec2) {
    let hull = convex_hull(points);
    let edges = |turn: f64| {
        let (sin, cos) = (libm::sin(turn), libm::cos(turn));
        let span = |axis: DVec2| {
            let at = || hull.iter().map(|p| p.dot(axis));
            at().fold(f64::NEG_INFINITY, f64::max) - at().fold(f64::INFINITY, f64::min)
        };
        DVec2::new(span(DVec2::new(cos, sin)), span(DVec2::new(-sin, cos)))
    };
    let mut best = (0.0, edges(0.0));
    for i in 0..hull.len() {
        let edge = hull[(i + 1) % hull.len()] - hull[i];
        let turn = libm::atan2(edge.y, edge.x);
        let size = edges(turn);
        if size.x * size.y < best.1.x * best.1.y * (1.0 - 1e-6) {
            best = (turn, size);
        }
    }
    let (turn, size) = best;
    if size.x >= size.y { (turn, size) } else { (turn + FRAC_PI_2, DVec2::new(size.y, size.x)) }
}

/// Counter-clockwise (Andrew's monotone chain).
pub fn convex_hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let chain = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while chain.len() >= 2
                && (chain[chain.len() - 1] - chain[chain.len() - 2]).perp_dot(p - chain[chain.len() - 1]) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut sorted.iter().copied());
    hull.extend(chain(&mut sorted.iter().rev().copied()));
    if hull.is_empty() { sorted.first().copied().into_iter().collect() } else { hull }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn the_smallest_rectangle_has_the_longer_edge_along_x() {
        for angle in [0.0, 0.4, 1.2, 2.5, -0.7_f64] {
            let turned = |p: DVec2| {
                let q = DQuat::from_rotation_y(angle) * DVec3::new(p.x, 0.0, p.y);
                DVec2::new(q.x, q.z)
            };
            let corners = [[2.0, 0.5], [-2.0, 0.5], [-2.0, -0.5], [2.0, -0.5]].map(|p| turned(DVec2::from_array(p)));
            let (turn, edges) = smallest_rectangle(&corners);
            assert!((edges - DVec2::new(4.0, 1.0)).length() < 1e-9, "{angle}: {edges}");
            for p in corners {
                let back = DQuat::from_rotation_y(turn) * DVec3::new(p.x, 0.0, p.y);
                assert!((back.x.abs() - 2.0).abs() < 1e-9 && (back.z.abs() - 0.5).abs() < 1e-9, "{angle}: {back}");
            }
        }
    }
}
