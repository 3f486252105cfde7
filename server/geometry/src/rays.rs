//! What rays meet, in single precision, for pictures: boxes in a tree, and soups of triangles in these boxes.
//!
//! A ray meets a triangle as in Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection" (1997).

use super::tree::{BoxTree, Boxed, STACK};
use glam::{DVec3, Vec3, Vec3A};

/// From a point in a direction, which need not be a unit vector.
#[derive(Clone, Copy)]
pub struct Ray {
    pub origin: Vec3A,
    pub direction: Vec3A,
    inverse: Vec3A,
}

/// A tree of boxes, made for rays.
pub struct RayTree {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

/// As in [`BoxTree`].
struct Node {
    lo: Vec3A,
    hi: Vec3A,
    first: u32,
    count: u32,
}

/// Triangles, and the tree above them.
pub struct RaySoup {
    /// In the order of the tree.
    pub triangles: Vec<Triangle>,
    tree: RayTree,
}

/// Corners.
#[derive(Clone, Copy)]
pub struct Triangle(pub [Vec3A; 3]);

impl Ray {
    pub fn new(origin: Vec3A, direction: Vec3A) -> Ray {
        // A direction along a face of a box divides by zero: infinity, of a sign that does not matter.
        Ray { origin, direction, inverse: direction.recip() }
    }

    /// Where the ray enters a box, if it does before `reach`. Both in lengths of the direction.
    #[inline(always)]
    fn enters(&self, node: &Node, reach: f32) -> Option<f32> {
        let (a, b) = ((node.lo - self.origin) * self.inverse, (node.hi - self.origin) * self.inverse);
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element().min(reach);
        (near <= far).then_some(near)
    }
}

impl RayTree {
    /// Puts the things into the order of the tree.
    pub fn new(things: &mut [impl Boxed]) -> RayTree {
        let tree = BoxTree::new(things);
        let single = |node: &super::tree::Node| {
            let (lo, hi) = (node.lo.as_vec3a(), node.hi.as_vec3a());
            Node { lo, hi, first: node.first, count: node.count }
        };
        RayTree { nodes: tree.nodes.iter().map(single).collect(), order: tree.order }
    }

    /// Shape `[n]`: the name of the thing at each place of the tree's order.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Visits the places of the things whose boxes a ray meets, nearer boxes first. `meet` gets how far the ray
    /// reaches, and returns how far it reaches from then on; a reach below 0 ends the walk.
    #[inline(always)]
    pub fn along(&self, ray: &Ray, mut reach: f32, mut meet: impl FnMut(usize, f32) -> f32) {
        let Some(mut node) = self.nodes.first().filter(|root| ray.enters(root, reach).is_some()) else { return };
        let mut at = 0;
        let mut stack = [(0u32, 0.0f32); STACK];
        let mut depth = 0;
        loop {
            if node.count == 0 {
                let (left, right) = (at + 1, node.first);
                let a = ray.enters(&self.nodes[left as usize], reach);
                let b = ray.enters(&self.nodes[right as usize], reach);
                let next = match (a, b) {
                    (Some(a), Some(b)) => {
                        let (near, far) = if a <= b { (left, (right, b)) } else { (right, (left, a)) };
                        stack[depth] = far;
                        depth += 1;
                        Some(near)
                    }
                    (Some(_), None) => Some(left),
                    (None, Some(_)) => Some(right),
                    (None, None) => None,
                };
                if let Some(next) = next {
                    (at, node) = (next, &self.nodes[next as usize]);
                    continue;
                }
            } else {
                for place in node.first..node.first + node.count {
                    reach = meet(place as usize, reach);
                    if reach < 0.0 {
                        return;
                    }
                }
            }
            at = loop {
                if depth == 0 {
                    return;
                }
                depth -= 1;
                let (next, near) = stack[depth];
                if near <= reach {
                    break next;
                }
            };
            node = &self.nodes[at as usize];
        }
    }
}

impl RaySoup {
    pub fn new(triangles: &[Triangle]) -> RaySoup {
        let named = |(i, &triangle): (usize, &Triangle)| Named { name: i as u32, triangle };
        let mut named: Vec<Named> = triangles.iter().enumerate().map(named).collect();
        let tree = RayTree::new(&mut named);
        RaySoup { triangles: named.into_iter().map(|named| named.triangle).collect(), tree }
    }

    /// Shape `[m]`: the number of each triangle as it was given.
    pub fn order(&self) -> &[u32] {
        self.tree.order()
    }

    /// The first triangle on a ray, nearer than `reach` lengths of its direction, and how far that is.
    pub fn first(&self, ray: &Ray, reach: f32) -> Option<(usize, f32)> {
        let mut best = None;
        self.tree.along(ray, reach, |place, reach| {
            let distance = self.triangles[place].distance(ray);
            if distance >= reach {
                return reach;
            }
            best = Some((place, distance));
            distance
        });
        best
    }

    /// Whether a ray meets no triangle.
    pub fn is_clear(&self, ray: &Ray) -> bool {
        let mut clear = true;
        self.tree.along(ray, f32::INFINITY, |place, reach| {
            clear = self.triangles[place].distance(ray) == f32::INFINITY;
            if clear { reach } else { -1.0 }
        });
        clear
    }

    /// Calls `visit` for every triangle on a ray that is nearer than `reach`, with the distance, in no particular
    /// order.
    pub fn all(&self, ray: &Ray, reach: f32, mut visit: impl FnMut(usize, f32)) {
        self.tree.along(ray, reach, |place, reach| {
            let distance = self.triangles[place].distance(ray);
            if distance < reach {
                visit(place, distance);
            }
            reach
        });
    }
}

impl Triangle {
    /// How far along the ray it meets the triangle, from either side, in lengths of its direction; infinity where it
    /// does not, or only before its origin.
    #[inline(always)]
    pub fn distance(&self, ray: &Ray) -> f32 {
        let (e1, e2) = self.edges();
        let normal = e1.cross(e2);
        let to = self.0[0] - ray.origin;
        let across = ray.direction.cross(to);
        let inverse = 1.0 / normal.dot(ray.direction);
        let (u, v) = (across.dot(e2) * inverse, across.dot(e1) * inverse);
        let distance = normal.dot(to) * inverse;
        let meets = u >= 0.0 && v >= 0.0 && 1.0 - u - v >= 0.0 && distance >= 0.0;
        if meets { distance } else { f32::INFINITY }
    }

    /// Barycentric coordinates of the point where a ray meets the triangle.
    pub fn shares(&self, ray: &Ray) -> Vec3 {
        let (e1, e2) = self.edges();
        let across = ray.direction.cross(self.0[0] - ray.origin);
        let det = e1.cross(e2).dot(ray.direction);
        let (u, v) = (across.dot(e2) / det, across.dot(e1) / det);
        let shares = Vec3::new(1.0 - u - v, u, v);
        if shares.is_finite() { shares } else { Vec3::splat(1.0 / 3.0) }
    }

    #[inline(always)]
    fn edges(&self) -> (Vec3A, Vec3A) {
        let [a, b, c] = self.0;
        (a - b, c - a)
    }
}

struct Named {
    name: u32,
    triangle: Triangle,
}

impl Boxed for Named {
    fn name(&self) -> u32 {
        self.name
    }

    fn bounds(&self) -> (DVec3, DVec3) {
        let [a, b, c] = self.triangle.0;
        (a.min(b).min(c).as_dvec3(), a.max(b).max(c).as_dvec3())
    }
}
