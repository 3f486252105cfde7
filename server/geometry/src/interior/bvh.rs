//! A box tree over triangles: nearest point and generalised winding number, both in f64.
//!
//! The winding number follows Barill et al., "Fast winding numbers for soups and clouds" (2018): a far node is
//! replaced by its dipole (their Eq. 8) and the next term of the Taylor series (their Eq. 9).

mod build;

use crate::mesh::solid_angle;
use crate::tree::{BoxTree, Node, STACK};
use glam::{DAffine3, DMat3, DVec3};
use std::ops::ControlFlow;
use std::sync::OnceLock;

/// What rounding does to the distance of a point from a triangle's plane is far below this, as a share of the largest
/// coordinate.
const PLANE_SLACK: f64 = 1e-9;
/// A triangle is flat if twice its area is below this share of its longest edge squared: its normal has rounding errors
/// of up to 1e-16 / `FLAT`.
const FLAT: f64 = 1e-5;

pub struct Bvh {
    /// Its things are the mesh's triangles.
    tree: BoxTree,
    /// Shape `[m][3]`, in the tree's order, metres.
    corners: Vec<[DVec3; 3]>,
    /// Shape `[m]`, in the tree's order; made for the first nearest point that is asked for.
    planes: OnceLock<Vec<Plane>>,
    /// Of each node.
    far: Vec<Multipole>,
    /// No coordinate of a corner is farther from 0, metres.
    extent: f64,
}

/// Where `normal . x = offset`. The normal of a triangle that is nearly flat is 0: no point counts as apart from it.
struct Plane {
    normal: DVec3,
    offset: f64,
}

/// A node seen from afar.
struct Multipole {
    area: f64,
    /// Centre of the area.
    centre: DVec3,
    /// No point of the node is farther from `centre`.
    radius: f64,
    /// Sum of area times normal, N.
    normal: DVec3,
    /// Sum of area times (centroid - centre) (outer product) normal, M.
    moment: DMat3,
}

/// The closest point of the surface to a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    pub point: DVec3,
    pub squared: f64,
    /// Place in the tree's order: a good first guess for a query nearby.
    pub place: u32,
}

impl Bvh {
    /// The name of the triangle at a place in the tree's order.
    pub fn name(&self, place: u32) -> u32 {
        self.tree.order[place as usize]
    }

    /// Shape `[m][3]`, metres, in the tree's order.
    pub fn triangles(&self) -> &[[DVec3; 3]] {
        &self.corners
    }

    /// The closest point of any triangle. `guess` is the place of a triangle that is likely near.
    /// `None` when there is no triangle.
    pub fn nearest(&self, p: DVec3, guess: u32) -> Option<NearestPoint> {
        let last = (self.corners.len() as u32).checked_sub(1)?;
        Some(self.nearer(p, self.hit(p, guess.min(last))))
    }

    /// The closest point of any triangle, where one is nearer than `reach`.
    pub fn nearest_within(&self, p: DVec3, reach: f64) -> Option<NearestPoint> {
        let none = NearestPoint { point: p, squared: reach * reach, place: u32::MAX };
        (!self.corners.is_empty()).then(|| self.nearer(p, none)).filter(|found| found.place != none.place)
    }

    /// The closest point of any triangle, or `best` where none is nearer. There is a triangle.
    fn nearer(&self, p: DVec3, mut best: NearestPoint) -> NearestPoint {
        let planes = self.planes.get_or_init(|| self.corners.iter().map(Plane::of).collect());
        // Far beyond what rounding does to the distance from a plane.
        let slack = PLANE_SLACK * (self.extent + p.abs().max_element());
        let mut stack = [(0u32, 0.0f64); STACK];
        stack[0] = (0, self.tree.nodes[0].squared_distance(p));
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (at, bound) = stack[depth];
            if bound >= best.squared {
                continue;
            }
            let node = &self.tree.nodes[at as usize];
            if node.count > 0 {
                for place in node.first..node.first + node.count {
                    let apart = planes[place as usize].distance(p) - slack;
                    if apart > 0.0 && apart * apart >= best.squared {
                        continue;
                    }
                    let hit = self.hit(p, place);
                    if hit.squared < best.squared {
                        best = hit;
                    }
                }
                continue;
            }
            let (left, right) = (at + 1, node.first);
            let a = (left, self.tree.nodes[left as usize].squared_distance(p));
            let b = (right, self.tree.nodes[right as usize].squared_distance(p));
            let (near, far) = if a.1 <= b.1 { (a, b) } else { (b, a) };
            stack[depth] = far;
            stack[depth + 1] = near;
            depth += 2;
        }
        best
    }

    fn hit(&self, p: DVec3, place: u32) -> NearestPoint {
        let point = closest_on_triangle(p, &self.corners[place as usize]);
        NearestPoint { point, squared: p.distance_squared(point), place }
    }

    /// Visits every triangle in boxes that `enter` lets pass, until `triangle` returns false; whether it never did.
    pub fn visit(&self, enter: impl Fn(DVec3, DVec3) -> bool, mut triangle: impl FnMut([DVec3; 3]) -> bool) -> bool {
        self.visit_named(enter, |_, corners| triangle(corners))
    }

    /// Visits the places of every two triangles, one of each tree, whose boxes are no farther apart than the reach; the
    /// visitor may shorten the reach. `map`: from the other tree's frame to this one's.
    pub fn visit_pairs(
        &self,
        other: &Bvh,
        map: &DAffine3,
        mut reach: f64,
        mut pair: impl FnMut([u32; 2], f64) -> ControlFlow<(), f64>,
    ) {
        if self.tree.nodes.is_empty() || other.tree.nodes.is_empty() {
            return;
        }
        let bend = map.matrix3;
        let spread = DMat3::from_cols(bend.x_axis.abs(), bend.y_axis.abs(), bend.z_axis.abs());
        let apart = |a: &Node, b: &Node| {
            let (middle, half) = (map.transform_point3((b.lo + b.hi) / 2.0), spread * ((b.hi - b.lo) / 2.0));
            (a.lo - middle - half).max(middle - half - a.hi).max(DVec3::ZERO).length_squared()
        };
        let mut stack = vec![([0u32; 2], apart(&self.tree.nodes[0], &other.tree.nodes[0]))];
        while let Some(([at, beside], bound)) = stack.pop() {
            if bound > reach * reach {
                continue;
            }
            let (a, b) = (&self.tree.nodes[at as usize], &other.tree.nodes[beside as usize]);
            if a.count > 0 && b.count > 0 {
                for i in a.first..a.first + a.count {
                    for j in b.first..b.first + b.count {
                        match pair([i, j], reach) {
                            ControlFlow::Continue(shorter) => reach = shorter,
                            ControlFlow::Break(()) => return,
                        }
                    }
                }
                continue;
            }
            let size = |n: &Node| (n.hi - n.lo).length_squared();
            let splits_own = b.count > 0 || a.count == 0 && size(a) >= size(b) * bend.x_axis.length_squared();
            let next = match splits_own {
                true => [[at + 1, beside], [a.first, beside]],
                false => [[at, beside + 1], [at, b.first]],
            };
            let mut next =
                next.map(|[i, j]| ([i, j], apart(&self.tree.nodes[i as usize], &other.tree.nodes[j as usize])));
            // The nearer one is looked at first.
            next.sort_by(|x, y| y.1.total_cmp(&x.1));
            stack.extend(next);
        }
    }

    /// Heights at which the vertical line through X and Z meets triangles, each with the triangle's name; ascending.
    pub fn column(&self, x: f64, z: f64) -> Vec<(f64, u32)> {
        let mut met = Vec::new();
        let enter = |lo: DVec3, hi: DVec3| lo.x <= x && x <= hi.x && lo.z <= z && z <= hi.z;
        self.visit_named(enter, |name, [a, b, c]| {
            let flat = |p: DVec3, q: DVec3| (p.x - x) * (q.z - z) - (p.z - z) * (q.x - x);
            let (u, v, w) = (flat(b, c), flat(c, a), flat(a, b));
            let area = u + v + w;
            if area != 0.0 && (u.min(v).min(w) >= 0.0 || u.max(v).max(w) <= 0.0) {
                met.push(((u * a.y + v * b.y + w * c.y) / area, name));
            }
            true
        });
        met.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        met
    }

    /// Whether the line from one point to another meets a triangle.
    pub fn is_between(&self, from: DVec3, to: DVec3) -> bool {
        self.between(from, to).is_some()
    }

    /// The name of a triangle that the line from one point to another meets.
    pub fn between(&self, from: DVec3, to: DVec3) -> Option<u32> {
        let way = to - from;
        let (low, high) = (from.min(to), from.max(to));
        let enter = |lo: DVec3, hi: DVec3| lo.cmple(high).all() && hi.cmpge(low).all();
        let mut met = None;
        self.visit_named(enter, |name, [a, b, c]| {
            // Moeller & Trumbore 1997.
            let (ab, ac) = (b - a, c - a);
            let across = way.cross(ac);
            let (area, start) = (ab.dot(across), from - a);
            let (u, up) = (start.dot(across) / area, start.cross(ab));
            let (v, along) = (way.dot(up) / area, ac.dot(up) / area);
            let misses = area == 0.0 || u < 0.0 || v < 0.0 || u + v > 1.0 || !(0.0..=1.0).contains(&along);
            met = (!misses).then_some(name);
            misses
        });
        met
    }

    /// As `visit`, with the triangle's name.
    fn visit_named(
        &self,
        enter: impl Fn(DVec3, DVec3) -> bool,
        mut triangle: impl FnMut(u32, [DVec3; 3]) -> bool,
    ) -> bool {
        let mut stack = [0u32; STACK];
        let mut depth = usize::from(!self.tree.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let at = stack[depth];
            let node = &self.tree.nodes[at as usize];
            if !enter(node.lo, node.hi) {
                continue;
            }
            if node.count == 0 {
                stack[depth] = node.first;
                stack[depth + 1] = at + 1;
                depth += 2;
                continue;
            }
            let mut leaf = node.first as usize..(node.first + node.count) as usize;
            if !leaf.all(|place| triangle(self.tree.order[place], self.corners[place])) {
                return false;
            }
        }
        true
    }

    /// Generalised winding number. A node farther than `accuracy` times its radius is approximated;
    /// infinity gives the exact sum.
    pub fn winding_number(&self, p: DVec3, accuracy: f64) -> f64 {
        if self.tree.nodes.is_empty() {
            return 0.0;
        }
        let mut sum = 0.0;
        let mut stack = [0u32; STACK];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let at = stack[depth];
            let (node, far) = (&self.tree.nodes[at as usize], &self.far[at as usize]);
            let r = far.centre - p;
            // Written so that an infinite accuracy and a zero radius still mean "exact".
            if r.length() / accuracy > far.radius {
                sum += far.solid_angle(r);
            } else if node.count > 0 {
                let leaf = node.first as usize..(node.first + node.count) as usize;
                sum += self.corners[leaf].iter().map(|t| solid_angle(p, t)).sum::<f64>();
            } else {
                stack[depth] = node.first;
                stack[depth + 1] = at + 1;
                depth += 2;
            }
        }
        sum / (4.0 * std::f64::consts::PI)
    }
}

impl Node {
    fn squared_distance(&self, p: DVec3) -> f64 {
        (self.lo - p).max(p - self.hi).max(DVec3::ZERO).length_squared()
    }
}

impl Plane {
    fn of(&[a, b, c]: &[DVec3; 3]) -> Plane {
        let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        let across = (b - a).cross(c - a);
        let double = across.length();
        if double.is_normal() && double > FLAT * longest {
            let normal = across / double;
            return Plane { normal, offset: normal.dot(a) };
        }
        Plane { normal: DVec3::ZERO, offset: 0.0 }
    }

    fn distance(&self, p: DVec3) -> f64 {
        (self.normal.dot(p) - self.offset).abs()
    }
}

impl Multipole {
    /// Solid angle seen from the origin of `r`, the vector to the centre.
    fn solid_angle(&self, r: DVec3) -> f64 {
        let square = r.length_squared();
        let cube = square * square.sqrt();
        let m = &self.moment;
        let trace = m.x_axis.x + m.y_axis.y + m.z_axis.z;
        (self.normal.dot(r) + trace - 3.0 * r.dot(*m * r) / square) / cube
    }
}

/// Ericson, "Real-Time Collision Detection" (2005), 5.1.5; flat triangles fall back to their edges.
pub fn closest_on_triangle(p: DVec3, &[a, b, c]: &[DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let face = va + vb + vc;
    if va > 0.0 && vb > 0.0 && vc > 0.0 && face.is_normal() {
        return a + ab * (vb / face) + ac * (vc / face);
    }
    let on_edges = [closest_on_segment(p, a, b), closest_on_segment(p, b, c), closest_on_segment(p, c, a)];
    let nearer = |x: DVec3, y: DVec3| if p.distance_squared(y) < p.distance_squared(x) { y } else { x };
    nearer(nearer(on_edges[0], on_edges[1]), on_edges[2])
}

fn closest_on_segment(p: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let ab = b - a;
    let square = ab.length_squared();
    if square > 0.0 { a + ab * ((p - a).dot(ab) / square).clamp(0.0, 1.0) } else { a }
}
