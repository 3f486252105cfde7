//! Making the tree.

use super::{Bvh, Multipole, Node};
use crate::geometry::mesh::bounds;
use glam::{DMat3, DVec3};
use std::sync::OnceLock;

/// Triangles in a leaf. Fewer make the tree deeper, more raise the price of a visit to a leaf.
const LEAF: usize = 4;

impl Bvh {
    /// `triangles`, shape `[m]`, are the corners and the name of each triangle.
    pub fn new(triangles: Vec<(u32, [DVec3; 3])>) -> Bvh {
        let mut items: Vec<Item> = triangles.into_iter().map(|(name, t)| Item::new(name, t)).collect();
        let (mut nodes, mut far) = (Vec::with_capacity(items.len()), Vec::with_capacity(items.len()));
        if !items.is_empty() {
            let count = items.len();
            split(&mut nodes, &mut far, &mut items, 0, count);
        }
        let reach = |node: &Node| node.lo.abs().max(node.hi.abs()).max_element();
        Bvh {
            extent: nodes.first().map_or(0.0, reach),
            nodes,
            far,
            order: items.iter().map(|i| i.name).collect(),
            planes: OnceLock::new(),
            corners: items.into_iter().map(|i| i.corners).collect(),
        }
    }
}

impl Multipole {
    fn of_triangles(items: &[Item], lo: DVec3, hi: DVec3) -> Multipole {
        let area: f64 = items.iter().map(|i| i.area_normal.length()).sum();
        let weighted: DVec3 = items.iter().map(|i| i.centroid * i.area_normal.length()).sum();
        let centre = if area > 0.0 { weighted / area } else { (lo + hi) / 2.0 };
        let moment = items.iter().fold(DMat3::ZERO, |m, i| m + outer(i.centroid - centre, i.area_normal));
        let radius =
            items.iter().flat_map(|i| i.corners).map(|p| p.distance_squared(centre)).fold(0.0, f64::max).sqrt();
        Multipole { area, centre, radius, normal: items.iter().map(|i| i.area_normal).sum(), moment }
    }

    fn of_children(a: &Multipole, b: &Multipole, lo: DVec3, hi: DVec3) -> Multipole {
        let area = a.area + b.area;
        let centre = if area > 0.0 { (a.centre * a.area + b.centre * b.area) / area } else { (lo + hi) / 2.0 };
        let moved = |m: &Multipole| m.moment + outer(m.centre - centre, m.normal);
        let reach = |m: &Multipole| m.centre.distance(centre) + m.radius;
        let corner = (centre - lo).max(hi - centre).length();
        Multipole {
            area,
            centre,
            radius: reach(a).max(reach(b)).min(corner),
            normal: a.normal + b.normal,
            moment: moved(a) + moved(b),
        }
    }
}

/// A triangle before it has its place in the tree.
struct Item {
    name: u32,
    corners: [DVec3; 3],
    centroid: DVec3,
    area_normal: DVec3,
}

impl Item {
    fn new(name: u32, corners: [DVec3; 3]) -> Item {
        let [a, b, c] = corners;
        Item { name, corners, centroid: (a + b + c) / 3.0, area_normal: (b - a).cross(c - a) / 2.0 }
    }
}

/// Appends the tree of `items`, whose first one has place `first`, and returns its root.
fn split(nodes: &mut Vec<Node>, fars: &mut Vec<Multipole>, items: &mut [Item], first: usize, count: usize) -> usize {
    let (lo, hi) = bounds(items.iter().flat_map(|i| i.corners));
    let at = nodes.len();
    if count <= LEAF {
        fars.push(Multipole::of_triangles(items, lo, hi));
        nodes.push(Node { lo, hi, first: first as u32, count: count as u32 });
        return at;
    }
    let (clo, chi) = bounds(items.iter().map(|i| i.centroid));
    let axis = (chi - clo).max_position();
    let half = count / 2;
    // The name breaks ties, so that equal input gives an equal tree.
    let key = |i: &Item| (i.centroid[axis], i.name);
    items.select_nth_unstable_by(half, |a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
    });
    fars.push(Multipole::of_triangles(&[], lo, hi));
    nodes.push(Node { lo, hi, first: 0, count: 0 });
    let (left, right) = items.split_at_mut(half);
    let a = split(nodes, fars, left, first, half);
    let b = split(nodes, fars, right, first + half, count - half);
    fars[at] = Multipole::of_children(&fars[a], &fars[b], lo, hi);
    nodes[at].first = b as u32;
    at
}

/// The matrix whose product with x is a (b . x).
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
