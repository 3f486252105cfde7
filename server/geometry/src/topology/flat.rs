//! Triangles whose corners lie on a line: of no area, but they may hold a surface together.
//!
//! Triangulated polygons leave them where a corner lies on a side. To drop one would open the surface there; instead
//! the neighbour at its longest side is split at the corner between, and covers the same ground.

use std::collections::HashMap;

use glam::DVec3;

use crate::ROUNDING;
use crate::mesh::TriMesh;

/// The triangles of no area that [`drop_flat`] found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flat {
    /// Removed, the neighbour being split in two.
    pub folded: usize,
    /// Removed, having no neighbour at the longest side.
    pub dropped: usize,
    /// Left, because their removal would tear or knot the surface.
    pub left: usize,
}

/// Removes triangles of no area (points must be welded) without opening the surface.
pub fn drop_flat(mesh: &mut TriMesh) -> Flat {
    let mut result = Flat::default();
    let mut waiting: Vec<usize> = (0..mesh.triangles.len()).filter(|&i| is_flat(mesh.corners(i))).collect();
    if waiting.is_empty() {
        return result;
    }
    let mut surface = EdgeFaces::new(mesh);
    // One may wait for another, so passes go on while each removes some.
    loop {
        let before = waiting.len();
        waiting.retain(|&face| {
            let folded = surface.remove_flat(mesh, face);
            result.folded += usize::from(folded == Some(true));
            result.dropped += usize::from(folded == Some(false));
            folded.is_none()
        });
        if waiting.is_empty() || waiting.len() == before {
            break;
        }
    }
    result.left = waiting.len();
    let mut gone = surface.gone.iter();
    mesh.triangles.retain(|_| !gone.next().unwrap_or(&false));
    result
}

/// Whether the height over the longest side is all rounding. Slivers of single precision are wider and stay.
fn is_flat([a, b, c]: [DVec3; 3]) -> bool {
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    (b - a).cross(c - a).length() <= ROUNDING * longest
}

/// The triangles at each edge.
struct EdgeFaces {
    edges: HashMap<[u32; 2], Vec<usize>>,
    gone: Vec<bool>,
}

fn key(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [key(a, b), key(b, c), key(c, a)]
}

impl EdgeFaces {
    fn new(mesh: &TriMesh) -> EdgeFaces {
        let mut surface = EdgeFaces { edges: HashMap::new(), gone: vec![false; mesh.triangles.len()] };
        mesh.triangles.iter().enumerate().for_each(|(face, &t)| surface.link(face, t));
        surface
    }

    fn link(&mut self, face: usize, triangle: [u32; 3]) {
        sides(triangle).iter().for_each(|&side| self.edges.entry(side).or_default().push(face));
    }

    fn unlink(&mut self, face: usize, triangle: [u32; 3]) {
        for side in sides(triangle) {
            self.edges.entry(side).or_default().retain(|&f| f != face);
        }
    }

    /// Removes a flat triangle: `Some(true)` by splitting its neighbour, `Some(false)` alone, `None` not yet.
    fn remove_flat(&mut self, mesh: &mut TriMesh, face: usize) -> Option<bool> {
        let flat = mesh.triangles[face];
        // The longest side, from x to y, and the corner between.
        let length = |k: usize| mesh.points[flat[k] as usize].distance_squared(mesh.points[flat[(k + 1) % 3] as usize]);
        let k = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
        let (end_1, end_2, between) = (flat[k], flat[(k + 1) % 3], flat[(k + 2) % 3]);
        let at_side = self.edges.get(&key(end_1, end_2)).map_or(&[][..], Vec::as_slice);
        let neighbour = match *at_side {
            [_] => {
                self.unlink(face, flat);
                self.gone[face] = true;
                return Some(false);
            }
            [a, b] if a == face => b,
            [a, _] => a,
            _ => return None,
        };
        let triangle = mesh.triangles[neighbour];
        let k = (0..3).find(|&k| key(triangle[k], triangle[(k + 1) % 3]) == key(end_1, end_2))?;
        let (x, y, top) = (triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]);
        let halves = [[x, between, top], [between, y, top]];
        let flat_half = |t: &[u32; 3]| is_flat(t.map(|v| mesh.points[v as usize]));
        let taken = self.edges.get(&key(between, top)).is_some_and(|faces| !faces.is_empty());
        if top == between || taken || halves.iter().any(flat_half) {
            return None;
        }
        // The two places are taken again, so that nothing else is renumbered; neither is flat now.
        self.unlink(face, flat);
        self.unlink(neighbour, triangle);
        for (place, half) in [neighbour, face].into_iter().zip(halves) {
            mesh.triangles[place] = half;
            self.link(place, half);
        }
        Some(true)
    }
}
