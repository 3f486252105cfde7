//! How a mesh's triangles are connected: open or closed, in how many parts, facing outward or inward.
//!
//! Two triangles are neighbours if they share an edge, that is, both points of it: meshes split at seams of texture or
//! normals must be welded before. Bit-exact welding is done here; [`weld`] does it within a tolerance.

mod double;
mod flat;
mod holes;
mod orient;
mod repair;
#[cfg(test)]
mod tests;

use glam::DVec3;

use crate::mesh::TriMesh;
use crate::weld::merged;
pub use flat::{Flat, drop_flat};
pub use holes::{Holes, close_holes};
pub use orient::oriented;
pub use repair::Repair;

/// A good tolerance for [`weld`], relative to the diagonal: the error of single precision at a point of a model that
/// stands a few times its own size from the origin. Parts modelled apart stay apart.
pub const WELD_TOLERANCE: f64 = 1e-6;

/// The findings of [`inspect`], after welding equal points and leaving out triangles with two equal corners.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Topology {
    pub triangles: usize,
    /// Edges of one triangle: the rims of holes.
    pub boundary_edges: usize,
    /// Edges of three or more triangles.
    pub nonmanifold_edges: usize,
    /// Edges of two triangles that face opposite sides of the surface.
    pub misoriented_edges: usize,
    /// Edges along which not as many triangles run one way as the other.
    pub unbalanced_edges: usize,
    /// Parts that share no edge.
    pub components: usize,
    /// m^3: negative for a mesh that is inside out, meaningless unless `closed` and consistently oriented.
    pub signed_volume: f64,
    /// m^2.
    pub area: f64,
    /// There are triangles, and an even number of them meets at every edge: the surface parts space into inside and
    /// outside. Says nothing about which side faces outward, or whether any volume is inside.
    pub closed: bool,
    /// Metres, of the axis-aligned box around the triangles.
    pub diagonal: f64,
}

impl Topology {
    /// Every winding number is whole, so that the mesh bounds a solid: also where parts touch along edges or faces.
    pub fn bounds_a_solid(&self) -> bool {
        self.closed && self.unbalanced_edges == 0
    }

    /// Closed, without edges of more than two triangles, and facing one way throughout.
    pub fn is_watertight(&self) -> bool {
        self.closed && self.nonmanifold_edges == 0 && self.misoriented_edges == 0
    }
}

/// Inspects a mesh as it is, after bit-exact welding.
pub fn inspect(mesh: &TriMesh) -> Topology {
    let mesh = weld(mesh, 0.0);
    let edges = Edges::new(&mesh.triangles);
    let mut topology = Topology { triangles: mesh.triangles.len(), ..Topology::default() };
    let mut parts = DisjointSets::new(mesh.triangles.len());
    let mut odd = 0;
    for edge in edges.iter() {
        match edge {
            [_] => topology.boundary_edges += 1,
            [a, b] => topology.misoriented_edges += usize::from(a.forward == b.forward),
            _ => topology.nonmanifold_edges += 1,
        }
        odd += edge.len() % 2;
        topology.unbalanced_edges += usize::from(2 * edge.iter().filter(|side| side.forward).count() != edge.len());
        edge.iter().for_each(|side| parts.join(edge[0].face as usize, side.face as usize));
    }
    topology.components = parts.count();
    topology.signed_volume = mesh.signed_volume();
    topology.area = (0..mesh.triangles.len()).map(|i| area(mesh.corners(i))).sum();
    topology.closed = odd == 0 && !mesh.triangles.is_empty();
    topology.diagonal = diagonal(&mesh);
    topology
}

/// One point for all that are equal, or nearer than `tolerance` times the diagonal to the first of their kind;
/// triangles left with two equal corners, and points left without triangles, go. With `tolerance` 0, only bit-equal
/// points (and 0 and -0) are one. The order of points and triangles stays, so a mesh without fault comes back as it is.
///
/// A point joins the first point within reach, not the nearest, so that the result does not depend on chance; a row of
/// points each within reach of the next does not collapse into one.
pub fn weld(mesh: &TriMesh, tolerance: f64) -> TriMesh {
    let (numbers, points) = merged(&mesh.points, tolerance * diagonal(mesh));
    let mut triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(|v| numbers[v as usize])).collect();
    triangles.retain(|&[a, b, c]| a != b && b != c && c != a);

    let mut used = vec![false; points.len()];
    triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    let before = |count: &mut u32, &used: &bool| {
        *count += u32::from(used);
        Some(count.saturating_sub(1))
    };
    let numbers: Vec<u32> = used.iter().scan(0, before).collect();
    triangles.iter_mut().for_each(|t| *t = t.map(|v| numbers[v as usize]));
    let points = points.into_iter().zip(used).filter_map(|(p, used)| used.then_some(p)).collect();
    TriMesh { points, triangles }
}

/// The parts of a welded mesh that share no edge, in the order of their first triangles. All have all of the points.
pub fn parts(mesh: &TriMesh) -> Vec<Vec<[u32; 3]>> {
    let mut sets = DisjointSets::new(mesh.triangles.len());
    for edge in Edges::new(&mesh.triangles).iter() {
        edge.iter().for_each(|side| sets.join(edge[0].face as usize, side.face as usize));
    }
    let mut numbers = std::collections::HashMap::new();
    let mut parts: Vec<Vec<[u32; 3]>> = Vec::new();
    for (face, &triangle) in mesh.triangles.iter().enumerate() {
        let number = *numbers.entry(sets.find(face)).or_insert(parts.len());
        match parts.get_mut(number) {
            Some(part) => part.push(triangle),
            None => parts.push(vec![triangle]),
        }
    }
    parts
}

fn area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

fn diagonal(mesh: &TriMesh) -> f64 {
    let (low, high) = mesh.bounds();
    if mesh.points.is_empty() { 0.0 } else { low.distance(high) }
}

/// One triangle's side of an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    /// The edge: its points, the smaller number first.
    edge: [u32; 2],
    face: u32,
    /// Does the triangle run from the smaller to the larger number?
    forward: bool,
}

/// All sides of all triangles, those of one edge together.
struct Edges(Vec<HalfEdge>);

impl Edges {
    fn new(triangles: &[[u32; 3]]) -> Edges {
        Edges::of(triangles.iter().enumerate())
    }

    /// Of some triangles, with their numbers.
    fn of<'t>(triangles: impl Iterator<Item = (usize, &'t [u32; 3])>) -> Edges {
        let mut sides = Vec::with_capacity(3 * triangles.size_hint().1.unwrap_or(0));
        for (face, &[a, b, c]) in triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                sides.push(HalfEdge { edge: [from.min(to), from.max(to)], face: face as u32, forward: from < to });
            }
        }
        sides.sort_unstable();
        Edges(sides)
    }

    fn iter(&self) -> impl Iterator<Item = &[HalfEdge]> {
        self.0.chunk_by(|a, b| a.edge == b.edge)
    }
}

/// Disjoint sets of numbered triangles, bodies, ... (union-find).
pub struct DisjointSets(Vec<u32>);

impl DisjointSets {
    pub fn new(count: usize) -> DisjointSets {
        DisjointSets((0..count as u32).collect())
    }

    pub fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] as usize != i {
            self.0[i] = self.0[self.0[i] as usize];
            i = self.0[i] as usize;
        }
        i
    }

    /// The smallest member names the set, so that names do not depend on the order of joining.
    pub fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }

    fn count(&self) -> usize {
        self.0.iter().enumerate().filter(|&(i, &p)| i == p as usize).count()
    }

    /// The set of each triangle, numbered from 0 in the order of first appearance, and how many sets there are.
    fn numbered(mut self) -> (Vec<usize>, usize) {
        let mut numbers = vec![usize::MAX; self.0.len()];
        let mut count = 0;
        for i in 0..self.0.len() {
            let name = self.find(i);
            if numbers[name] == usize::MAX {
                numbers[name] = count;
                count += 1;
            }
            numbers[i] = numbers[name];
        }
        (numbers, count)
    }
}
