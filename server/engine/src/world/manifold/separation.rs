//! The direction along which two convex polyhedra are farthest apart, or overlap least: of all faces' normals and all
//! directions across an edge of each, as the separating axis theorem has it (Gottschalk, Lin and Manocha 1996; on the
//! Gauss map: Gregorius 2013).
//!
//! Most candidates need no look. A *witness*, a point of one polyhedron, bounds the distance along each normal of the
//! other from above; so only the normal with the highest bound is measured, which yields the next witness, until no
//! bound is above what was measured. An edge's candidates are bounded by its two faces in the same way.

use super::polyhedron::Polyhedron;
use super::{APART, NEAR};
use crate::shape::{HullEdge, LANES, greater, greatest, position};
use rapier3d::prelude::*;
use wide::f32x8;

/// A direction between two edges is taken instead of a face's normal if it is better by this, engine units: among
/// nearly flat faces, its noise would turn the normal from step to step.
const EDGE_IS_BETTER: f32 = 0.1 * NEAR;
/// Edges are parallel where the sine of the angle between them, squared, is below this.
const PARALLEL: f32 = 1e-6;

/// Two polyhedra.
pub(super) struct ConvexPair<'a> {
    pub shapes: [Polyhedron<'a>; 2],
    /// Turns the second one's frame into the first one's, and back.
    turns: [Mat3; 2],
    /// The origin of the second one's frame in the first one's, and the other way round.
    shifts: [Vector; 2],
}

/// What a search found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Separation {
    /// From the first polyhedron to the second; unit, in the frame of the first.
    pub direction: Vector,
    /// Between them along it; negative where they overlap.
    pub distance: f32,
}

/// Bounds of the distances along the normals of one polyhedron, lane by lane.
#[derive(Default)]
struct Bounds {
    upper: Vec<f32x8>,
    /// For each witness a bit for each face whose edges it does not rule out alone, in words.
    marks: Vec<u64>,
    witnesses: usize,
}

/// Memory of a search, kept from pair to pair.
#[derive(Default)]
pub(super) struct Search {
    bounds: [Bounds; 2],
    edges: [Vec<SeenEdge>; 2],
}

/// An edge as its arc on the Gauss map, from one face's normal to the other's, in the first one's frame.
struct SeenEdge {
    normals: [Vector; 2],
    /// From its first corner to its second: along the first normal across the second.
    along: Vector,
    from: Vector,
}

/// Lanes whose bits fill a word.
const WORD: usize = u64::BITS as usize / LANES;

impl Bounds {
    fn begin(&mut self, planes: usize) {
        self.upper.clear();
        self.upper.resize(planes, f32x8::splat(f32::INFINITY));
        self.marks.clear();
        self.witnesses = 0;
    }

    /// Adds a point of the other polyhedron, in this one's frame. `floor`: what is not above it matters no more.
    /// Returns the face with the highest bound.
    fn add(&mut self, of: &Polyhedron, p: Vector, floor: f32) -> (usize, f32) {
        self.witnesses += 1;
        let floor = f32x8::splat(floor);
        let mut best = f32x8::splat(f32::NEG_INFINITY);
        for (word, planes) in of.planes.chunks(WORD).enumerate() {
            let mut marks = 0;
            for (k, plane) in planes.iter().enumerate() {
                let number = word * WORD + k;
                let distance = plane.distances(p, of.scale);
                let upper = self.upper[number].fast_min(distance);
                self.upper[number] = upper;
                best = greater(upper, best);
                marks |= u64::from(distance.simd_gt(floor).to_bitmask()) << (k * LANES);
            }
            self.marks.push(marks);
        }
        let best = greatest(best);
        (position(&self.upper, best), best)
    }

    /// Calls `found` for each edge that no witness rules out: for each of them, one of its two faces is marked.
    fn edges<'e>(&self, of: &Polyhedron<'e>, mut found: impl FnMut(&'e HullEdge)) {
        let words = self.marks.len() / self.witnesses;
        let is_marked = |witness: usize, face: u32| {
            let face = face as usize;
            self.marks[witness * words + face / u64::BITS as usize] >> (face % u64::BITS as usize) & 1 == 1
        };
        let is_open =
            |e: &HullEdge| (0..self.witnesses).all(|w| is_marked(w, e.facets[0]) || is_marked(w, e.facets[1]));
        let Some(around) = of.around else {
            return of.edges.iter().filter(|e| is_open(e)).for_each(found);
        };
        // By the witness that leaves fewest.
        let count = |w: &usize| self.marks[w * words..(w + 1) * words].iter().map(|m| m.count_ones()).sum::<u32>();
        let fewest = (0..self.witnesses).min_by_key(count).unwrap_or(0);
        for (word, &marks) in self.marks[fewest * words..(fewest + 1) * words].iter().enumerate() {
            let mut left = marks;
            while left != 0 {
                let face = word * u64::BITS as usize + left.trailing_zeros() as usize;
                left &= left - 1;
                if face >= of.facets {
                    break;
                }
                for &number in around.facets.of(face) {
                    let edge = &of.edges[number as usize];
                    let [f, g] = edge.facets;
                    let other = if f as usize == face { g } else { f };
                    // Once, from the first of two.
                    if (face <= other as usize || !is_marked(fewest, other)) && is_open(edge) {
                        found(edge);
                    }
                }
            }
        }
    }
}

impl<'a> ConvexPair<'a> {
    pub fn new(pos12: &Pose, shapes: [Polyhedron<'a>; 2]) -> ConvexPair<'a> {
        let turn = Mat3::from_quat(pos12.rotation);
        let back = turn.transpose();
        let shift = pos12.translation;
        ConvexPair { shapes, turns: [turn, back], shifts: [shift, -(back * shift)] }
    }

    /// A point of the second polyhedron in the frame of the first.
    pub fn to_first(&self, p: Vector) -> Vector {
        self.turns[0] * p + self.shifts[0]
    }

    /// A point of the first polyhedron in the frame of the second.
    pub fn to_second(&self, p: Vector) -> Vector {
        self.turns[1] * p + self.shifts[1]
    }

    pub fn origin_of_second(&self) -> Vector {
        self.shifts[0]
    }

    /// A direction of the first one's frame in that of the second.
    pub fn turned_to_second(&self, direction: Vector) -> Vector {
        self.turns[1] * direction
    }

    /// From the middle of the first to that of the second.
    fn between_middles(&self) -> Vector {
        let [a, b] = &self.shapes;
        (self.to_first(b.middle()) - a.middle()).normalize_or(Vector::Y)
    }

    /// The outermost points along a direction: of the first along it, of the second against it; in the first one's
    /// frame.
    fn outermost(&self, direction: Vector) -> [Vector; 2] {
        let [a, b] = &self.shapes;
        [a.outermost(direction), self.to_first(b.outermost(-self.turned_to_second(direction)))]
    }

    /// Distance along a direction from the first to the second.
    pub fn distance_along(&self, direction: Vector) -> f32 {
        let [a, b] = &self.shapes;
        let back = self.turned_to_second(direction);
        self.shifts[0].dot(direction) - b.top(-back) - a.top(direction)
    }

    /// The best direction of all; one along which they are farther apart than `prediction`, as soon as there is one.
    /// `guess`: a direction to begin with, unit; that of the last step saves most of the search.
    pub fn separation(&self, prediction: f32, guess: Option<Vector>, search: &mut Search) -> Separation {
        let direction = guess.unwrap_or_else(|| self.between_middles());
        let [p, q] = self.outermost(direction);
        let guessed = Separation { direction, distance: (q - p).dot(direction) };
        if guessed.distance > prediction {
            return guessed;
        }
        let witnesses = [q, self.to_second(p)];
        let mut best = Separation { direction, distance: f32::NEG_INFINITY };
        for (side, (witness, bounds)) in witnesses.into_iter().zip(&mut search.bounds).enumerate() {
            self.faces(side, witness, prediction, guessed.distance, bounds, &mut best);
            if best.distance > prediction {
                return best;
            }
        }
        self.edges(prediction, search, &mut best);
        if best.distance < guessed.distance - APART {
            // The nearest are two corners: no plane of either polyhedron is across the shortest way between them.
            return guessed;
        }
        best
    }

    /// Of the normals of one polyhedron's faces, the best. `witness`: a point of the other, in its frame; `floor`: a
    /// distance that some direction is known to have.
    fn faces(
        &self,
        side: usize,
        witness: Vector,
        prediction: f32,
        floor: f32,
        bounds: &mut Bounds,
        best: &mut Separation,
    ) {
        let (of, other) = (&self.shapes[side], &self.shapes[1 - side]);
        let floor = |best: f32| best.max(floor).min(0.0) - APART;
        bounds.begin(of.planes.len());
        let mut next = bounds.add(of, witness, floor(best.distance));
        // Each face is measured once; what is not finite ends it.
        for _ in 0..of.facets {
            let (facet, upper) = next;
            let may_be_better = upper > best.distance + APART;
            if !may_be_better {
                return;
            }
            let normal = of.normal(facet);
            // From the other one's frame into this one's, and back.
            let (turn, back, shift) = (self.turns[side], self.turns[1 - side], self.shifts[side]);
            let far = turn * other.outermost(-(back * normal)) + shift;
            let distance = far.dot(normal) - of.offset(facet);
            if distance > best.distance + APART {
                let direction = if side == 0 { normal } else { -(self.turns[0] * normal) };
                *best = Separation { direction, distance };
                if distance > prediction {
                    return;
                }
            }
            let bounds_more = distance < upper;
            if !bounds_more {
                return;
            }
            next = bounds.add(of, far, floor(best.distance));
        }
    }

    /// Of the directions across an edge of each, the best, where it is better than the best face.
    fn edges(&self, prediction: f32, search: &mut Search, best: &mut Separation) {
        let [first, second] = &mut search.edges;
        for (side, seen) in [&mut *first, &mut *second].into_iter().enumerate() {
            let of = &self.shapes[side];
            seen.clear();
            search.bounds[side].edges(of, |edge| {
                let [from, to] = edge.corners.map(|i| of.corner(i as usize));
                let normals = edge.facets.map(|f| of.normal(f as usize));
                seen.push(match side {
                    0 => SeenEdge { normals, along: to - from, from },
                    // From the other side.
                    _ => SeenEdge {
                        normals: normals.map(|n| -(self.turns[0] * n)),
                        along: self.turns[0] * (to - from),
                        from: self.to_first(from),
                    },
                });
            });
        }
        let mut found = Separation { direction: best.direction, distance: best.distance + EDGE_IS_BETTER };
        let mut is_found = false;
        for e in &*first {
            let [a, b] = e.normals;
            for f in &*second {
                let [c, d] = f.normals;
                // Whether the two arcs cross: the ends of each on both sides of the other's great circle, and on the
                // same half of the sphere.
                let (c_of_e, d_of_e) = (c.dot(e.along), d.dot(e.along));
                if c_of_e * d_of_e >= 0.0 {
                    continue;
                }
                let (a_of_f, b_of_f) = (a.dot(f.along), b.dot(f.along));
                if a_of_f * b_of_f >= 0.0 {
                    continue;
                }
                let across = e.along.cross(f.along);
                let square = across.length_squared();
                if square <= PARALLEL * e.along.length_squared() * f.along.length_squared() {
                    continue;
                }
                let across = across * (1.0 / square.sqrt());
                let direction = if across.dot(a + b) < 0.0 { -across } else { across };
                if direction.dot(c + d) <= 0.0 {
                    continue;
                }
                let distance = (f.from - e.from).dot(direction);
                if distance > found.distance {
                    (found, is_found) = (Separation { direction, distance }, true);
                    if distance > prediction {
                        break;
                    }
                }
            }
        }
        if is_found {
            // By its own certificate.
            let distance = self.distance_along(found.direction);
            if distance > best.distance + EDGE_IS_BETTER {
                *best = Separation { distance, ..found };
            }
        }
    }
}
