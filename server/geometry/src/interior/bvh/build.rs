//! Making the tree.

use super::{Bvh, Multipole, Node};
use crate::mesh::bounds;
use crate::tree::{BoxTree, Boxed};
use glam::{DMat3, DVec3};
use std::sync::OnceLock;

impl Bvh {
    /// `triangles`, shape `[m]`, are the corners and the name of each triangle.
    pub fn new(triangles: Vec<(u32, [DVec3; 3])>) -> Bvh {
        let mut items: Vec<Item> = triangles.into_iter().map(|(name, t)| Item::new(name, t)).collect();
        let tree = BoxTree::new(&mut items);
        let reach = |node: &Node| node.lo.abs().max(node.hi.abs()).max_element();
        Bvh {
            extent: tree.nodes.first().map_or(0.0, reach),
            far: multipoles(&tree, &items),
            tree,
            planes: OnceLock::new(),
            corners: items.into_iter().map(|i| i.corners).collect(),
        }
    }
}

/// Of each node. `items` are in the order of the tree.
fn multipoles(tree: &BoxTree, items: &[Item]) -> Vec<Multipole> {
    // Children stand behind their parents, so that this goes from the last node to the first.
    let mut far: Vec<Multipole> = Vec::with_capacity(tree.nodes.len());
    for (at, node) in tree.nodes.iter().enumerate().rev() {
        let of = |child: usize| &far[tree.nodes.len() - 1 - child];
        let own = if node.count > 0 {
            let leaf = node.first as usize..(node.first + node.count) as usize;
            Multipole::of_triangles(&items[leaf], node.lo, node.hi)
        } else {
            Multipole::of_children(of(at + 1), of(node.first as usize), node.lo, node.hi)
        };
        far.push(own);
    }
    far.reverse();
    far
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

impl Boxed for Item {
    fn name(&self) -> u32 {
        self.name
    }

    fn bounds(&self) -> (DVec3, DVec3) {
        bounds(self.corners.into_iter())
    }

    fn centre(&self) -> DVec3 {
        self.centroid
    }
}

impl Item {
    fn new(name: u32, corners: [DVec3; 3]) -> Item {
        let [a, b, c] = corners;
        Item { name, corners, centroid: (a + b + c) / 3.0, area_normal: (b - a).cross(c - a) / 2.0 }
    }
}

/// The matrix whose product with x is a (b . x).
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
