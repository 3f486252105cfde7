//! The gap between two convex polyhedra, seen along the normal of their contact.
//!
//! It is a convex function over the plane across the normal, linear between its corners: those of either polyhedron
//! over or under a facet of the other, and the crossings of their edges. All of these that are near enough are
//! candidates for points of the contact.

use super::polyhedron::Polyhedron;
use super::separation::ConvexPair;
use super::{ContactCandidate, ContactFrame};
use crate::shape::{HullEdge, LANES, PlaneLanes, dot, eight, flat, greater, greatest, heights};
use cairn_geometry::SINGLE_ROUNDING;
use rapier3d::parry::shape::PackedFeatureId;
use rapier3d::prelude::*;
use wide::f32x8;

/// Facets steeper than this, cosine, take no part: a shape that touches one touches its edges as well.
const STEEP: f32 = 0.1;

/// Points that are less deep than this share of the deepest one are no candidates.
const DEEPER: f32 = 0.5;

/// Memory of [`corners`], kept from pair to pair.
#[derive(Default)]
pub(super) struct GapScratch {
    sides: [Side; 2],
    crossed: EdgeLanes,
    candidates: Vec<ContactCandidate>,
}

/// What a polyhedron turns to the other one.
#[derive(Default)]
struct Side {
    heights: Vec<f32x8>,
    /// Corners that are near enough to the outermost one.
    near: Vec<u32>,
    /// Cosines between the facets' normals and the direction to the other polyhedron.
    facing: Vec<f32x8>,
    /// Edges of facing facets with a corner that is near.
    edges: Vec<SideEdge>,
    /// Facets of these edges: their numbers, and their planes over the cosine.
    facets: Vec<u32>,
    is_known: Vec<bool>,
    slopes: Vec<PlaneLanes>,
}

/// In the contact's frame.
#[derive(Clone, Copy)]
struct SideEdge {
    from: Vector,
    along: Vector,
    number: u32,
}

impl Side {
    /// `direction`: to the other polyhedron. Returns the height of the outermost corner along it.
    fn look(&mut self, of: &Polyhedron, direction: Vector) -> f32 {
        self.facing.clear();
        self.facing.extend(of.planes.iter().map(|plane| dot(&plane.normal, direction)));
        heights(of.lanes, direction * of.scale, &mut self.heights)
    }

    fn find_near(&mut self, of: &Polyhedron, least: f32) {
        self.near.clear();
        for (number, heights) in self.heights.iter().enumerate() {
            let mut left = heights.simd_ge(f32x8::splat(least)).to_bitmask();
            while left != 0 {
                let i = number * LANES + left.trailing_zeros() as usize;
                left &= left - 1;
                if i < of.corners.len() {
                    self.near.push(i as u32);
                }
            }
        }
    }

    fn find_edges(&mut self, of: &Polyhedron, least: f32, to_frame: impl Fn(Vector) -> Vector) {
        self.edges.clear();
        self.facets.clear();
        self.is_known.clear();
        self.is_known.resize(of.facets, false);
        let Side { heights, facing, near, edges, facets, is_known, .. } = self;
        let mut see = |number: u32| {
            let HullEdge { corners, facets: around } = &of.edges[number as usize];
            let mut is_facing = false;
            for &f in around {
                if flat(facing, f as usize) >= STEEP {
                    is_facing = true;
                    if !is_known[f as usize] {
                        is_known[f as usize] = true;
                        facets.push(f);
                    }
                }
            }
            if is_facing {
                let [from, to] = corners.map(|i| to_frame(of.corner(i as usize)));
                edges.push(SideEdge { from, along: to - from, number });
            }
        };
        match of.around {
            None => {
                let is_near = |e: &HullEdge| e.corners.iter().any(|&i| flat(heights, i as usize) >= least);
                (0..).zip(of.edges).filter(|(_, e)| is_near(e)).for_each(|(number, _)| see(number));
            }
            Some(around) => {
                for &i in near.iter() {
                    for &number in around.corners.of(i as usize) {
                        let [from, to] = of.edges[number as usize].corners;
                        let other = if from == i { to } else { from };
                        // Once, from the first of two.
                        if i < other || flat(heights, other as usize) < least {
                            see(number);
                        }
                    }
                }
            }
        }
    }

    /// The facets of the edges, each plane divided by its cosine: the distance from it is then the way to it.
    fn find_facets(&mut self, of: &Polyhedron) {
        self.slopes.clear();
        for numbers in self.facets.chunks(LANES) {
            let factor = eight(numbers, |&f| 1.0 / flat(&self.facing, f as usize));
            let normal = [0, 1, 2].map(|axis| eight(numbers, |&f| of.normal(f as usize)[axis]) * factor);
            let offset = eight(numbers, |&f| of.offset(f as usize)) * factor;
            self.slopes.push(PlaneLanes { normal, offset });
        }
    }

    /// How far it is from `p` to the surface of this polyhedron, against the direction in which it faces, and the facet
    /// there; negative for a point behind it. `None`: farther than `most`, or the way leads past it.
    fn way_from(&self, of: &Polyhedron, p: Vector, most: f32) -> Option<(f32, u32)> {
        let ways = self.slopes.iter().map(|slopes| slopes.distances(p, 1.0));
        let way = greatest(ways.clone().fold(f32x8::splat(f32::NEG_INFINITY), greater));
        if way > most || way == f32::NEG_INFINITY {
            return None;
        }
        // The point there is inside of all planes, up to rounding.
        let (far, rounding) = (f32x8::splat(way), f32x8::splat(SINGLE_ROUNDING));
        let is_out = |(plane, facing): (&PlaneLanes, &f32x8)| {
            (plane.distances(p, of.scale) - far * *facing).simd_gt(rounding).any()
        };
        let is_past = of.planes.iter().zip(&self.facing).any(is_out);
        if is_past {
            return None;
        }
        let number = ways.enumerate().find_map(|(k, ways)| {
            let bits = ways.simd_eq(far).to_bitmask();
            (bits != 0).then(|| k * LANES + bits.trailing_zeros() as usize)
        })?;
        Some((way, self.facets[number.min(self.facets.len() - 1)]))
    }
}

/// Edges number by number across the normal.
#[derive(Default)]
struct EdgeLanes {
    /// Where they begin, and how far they go, along both axes.
    lanes: Vec<[f32x8; 4]>,
    count: usize,
}

impl EdgeLanes {
    fn fill(&mut self, edges: &[SideEdge]) {
        self.lanes.clear();
        self.count = edges.len();
        self.lanes.extend(edges.chunks(LANES).map(|edges| {
            [
                eight(edges, |e| e.from.x),
                eight(edges, |e| e.from.y),
                eight(edges, |e| e.along.x),
                eight(edges, |e| e.along.y),
            ]
        }));
    }

    /// Calls `found` for each edge that `edge` crosses.
    fn crossed_by(&self, edge: &SideEdge, mut found: impl FnMut(usize)) {
        let [from_x, from_y, along_x, along_y] =
            [edge.from.x, edge.from.y, edge.along.x, edge.along.y].map(f32x8::splat);
        for (number, &[x, y, u, v]) in self.lanes.iter().enumerate() {
            let (wx, wy) = (from_x - x, from_y - y);
            let area = along_x * v - along_y * u;
            // Times the square of the area: most do not cross, and need no division.
            let whole = area * area;
            let s = (u * wy - v * wx) * area;
            let t = (along_x * wy - along_y * wx) * area;
            let zero = f32x8::ZERO;
            let crossed = s.simd_ge(zero) & t.simd_ge(zero) & whole.simd_ge(s) & whole.simd_ge(t) & whole.simd_gt(zero);
            let mut left = crossed.to_bitmask();
            while left != 0 {
                let k = number * LANES + left.trailing_zeros() as usize;
                left &= left - 1;
                if k < self.count {
                    found(k);
                }
            }
        }
    }
}

impl SideEdge {
    /// The crossing with an edge that this one crosses: the point on each.
    fn crossing(&self, other: &SideEdge) -> [Vector; 2] {
        let (u, v, w) = (self.along.truncate(), other.along.truncate(), (self.from - other.from).truncate());
        let area = u.perp_dot(v);
        [self.from + self.along * (v.perp_dot(w) / area), other.from + other.along * (u.perp_dot(w) / area)]
    }
}

/// The corners of the gap between two polyhedra, as far as it is no wider than `prediction`. `frame`: of the contact,
/// which is that of the first one, turned.
pub(super) fn corners<'a>(
    frame: &ContactFrame,
    pair: &ConvexPair,
    prediction: f32,
    scratch: &'a mut GapScratch,
) -> &'a mut Vec<ContactCandidate> {
    let GapScratch { sides: [first, second], crossed, candidates } = scratch;
    candidates.clear();
    let [a, b] = &pair.shapes;
    let normal = frame.normal();
    let back = pair.turned_to_second(normal);
    let tops = [first.look(a, normal), second.look(b, -back)];
    // Along the normal, from the outermost point of the first to that of the second.
    let least = pair.origin_of_second().dot(normal) - tops[1] - tops[0];
    if least > prediction {
        return candidates;
    }
    // Of what overlaps, the deeper half is enough: where it is deep, nothing rests.
    let most = prediction + DEEPER * least.min(0.0);
    let reach = most - least;
    first.find_near(a, tops[0] - reach);
    second.find_near(b, tops[1] - reach);
    let to_frame = frame.axes.transpose();
    first.find_edges(a, tops[0] - reach, |p| to_frame * p);
    second.find_edges(b, tops[1] - reach, |q| to_frame * pair.to_first(q));
    first.find_facets(a);
    second.find_facets(b);
    for &i in &first.near {
        let p = a.corner(i as usize);
        if let Some((way, facet)) = second.way_from(b, pair.to_second(p), most) {
            let at = to_frame * p;
            let features = [PackedFeatureId::vertex(i), PackedFeatureId::face(facet)];
            candidates.push(ContactCandidate { at: [at, at + Vector::Z * way], features });
        }
    }
    for &i in &second.near {
        let q = pair.to_first(b.corner(i as usize));
        if let Some((way, facet)) = first.way_from(a, q, most) {
            let at = to_frame * q;
            let features = [PackedFeatureId::face(facet), PackedFeatureId::vertex(i)];
            candidates.push(ContactCandidate { at: [at - Vector::Z * way, at], features });
        }
    }
    crossed.fill(&second.edges);
    for e in &first.edges {
        crossed.crossed_by(e, |number| {
            let other = &second.edges[number];
            let at = e.crossing(other);
            if at[1].z - at[0].z <= most {
                let features = [e.number, other.number].map(PackedFeatureId::edge);
                candidates.push(ContactCandidate { at, features });
            }
        });
    }
    candidates
}
