//! Closing the holes of a surface that an artist would call closed: small ones, such as those in the foot of a scan,
//! and those with a flat rim, such as a vessel without its lid or a hill without its underside.

use super::{Edges, area, diagonal};
use crate::mesh::TriMesh;
use crate::polygon::Plane;
use glam::DVec3;
use std::collections::BTreeMap;

/// A hole is small up to this width, relative to the mesh's diagonal, whatever the shape of its rim.
const SMALL: f64 = 0.2;
/// A rim is flat if it leaves its plane by no more than this, relative to the hole's width.
const FLAT: f64 = 0.05;

/// The result of [`close_holes`] in figures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Holes {
    pub count: usize,
    /// Of the widest hole, m.
    pub width: f64,
    /// Largest distance of a rim from its plane, m: the possible error of the new faces.
    pub deviation: f64,
    /// Of the new faces, as a share of the whole surface.
    pub area: f64,
}

impl Holes {
    /// One sentence for a person.
    pub fn describe(&self) -> String {
        let holes = if self.count == 1 { "1 hole was".to_owned() } else { format!("{} holes were", self.count) };
        format!(
            "{holes} closed: the widest is {:.3} m across, rims are up to {:.4} m from flat, and the new faces are \
             {:.1} % of the surface",
            self.width,
            self.deviation,
            100.0 * self.area
        )
    }
}

/// The mesh with its holes closed; `None` if one is neither small nor flat, or is no ring. Points must be welded, and
/// triangles must face one way.
pub fn close_holes(mesh: &TriMesh) -> Option<(TriMesh, Holes)> {
    let diagonal = diagonal(mesh);
    let mut closed = mesh.clone();
    let mut holes = Holes::default();
    let before = mesh.triangles.len();
    for rim in rims(mesh)? {
        let points: Vec<DVec3> = rim.iter().map(|&v| mesh.points[v as usize]).collect();
        let plane = Plane::of(&points);
        let width = 2.0 * points.iter().map(|p| p.distance(plane.middle)).fold(0.0, f64::max);
        let deviation = points.iter().map(|&p| plane.height(p).abs()).fold(0.0, f64::max);
        if width > SMALL * diagonal && deviation > FLAT * width {
            return None;
        }
        holes.count += 1;
        holes.width = holes.width.max(width);
        holes.deviation = holes.deviation.max(deviation);
        cover(&mut closed, &rim, &plane, &points);
    }
    let area_of = |from: usize| (from..closed.triangles.len()).map(|i| area(closed.corners(i))).sum::<f64>();
    holes.area = area_of(before) / area_of(0).max(f64::MIN_POSITIVE);
    Some((closed, holes))
}

/// The rims of all holes, each as new faces have to run around it; `None` if one does not come back to where it began.
fn rims(mesh: &TriMesh) -> Option<Vec<Vec<u32>>> {
    let edges = Edges::new(&mesh.triangles);
    let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for edge in edges.iter() {
        if let [side] = edge {
            // Against the direction of the face.
            let [low, high] = side.edge;
            let (from, to) = if side.forward { (high, low) } else { (low, high) };
            next.entry(from).or_default().push(to);
        }
    }
    let mut rims = Vec::new();
    while let Some((&start, _)) = next.first_key_value() {
        let mut path = vec![start];
        while let Some(&at) = path.last() {
            let Some(to) = next.get_mut(&at).and_then(Vec::pop) else {
                // All that began here came back.
                if path.len() == 1 {
                    break;
                }
                return None;
            };
            if next[&at].is_empty() {
                next.remove(&at);
            }
            // Where the path meets itself, a ring is complete: two holes may share a corner.
            match path.iter().position(|&v| v == to) {
                Some(begin) => {
                    rims.push(path[begin..].to_vec());
                    path.truncate(begin + 1);
                }
                None => path.push(to),
            }
        }
    }
    Some(rims)
}

/// Faces within a rim: ears of the polygon that it is in its plane; a fan from its middle where it crosses itself
/// there.
fn cover(mesh: &mut TriMesh, rim: &[u32], plane: &Plane, points: &[DVec3]) {
    let ears = plane.ears(points);
    if ears.len() == rim.len() - 2 {
        mesh.triangles.extend(ears.into_iter().map(|ear| ear.map(|corner| rim[corner as usize])));
    } else {
        let middle = mesh.points.len() as u32;
        mesh.points.push(plane.middle);
        let pairs = rim.iter().zip(rim.iter().cycle().skip(1));
        mesh.triangles.extend(pairs.map(|(&a, &b)| [a, b, middle]));
    }
}
