//! glTF 2.0 and GLB bytes in, one mesh out.
//!
//! `cairn-gltf` reads geometry and nothing else: a missing picture or a broken animation does not matter.
//! Here its triangles become one welded mesh. Everything that stands in the way is reported at once, with its place and
//! a remedy. No input panics, leaves the file's folder, or takes more time and memory than the [`Limits`] say: every
//! count is held against the bytes that are there before it is used.

#[cfg(test)]
mod tests;

use std::panic::{AssertUnwindSafe, catch_unwind};

use cairn_gltf::log::{Log, Logged};
pub use cairn_gltf::{AssetProblem, Limits, ProblemKind, Source};
use cairn_gltf::{Geometry, Primitive};
use glam::{DAffine3, DMat3, DVec3};

use cairn_geometry::mesh::TriMesh;
use cairn_geometry::topology::{Flat, drop_flat, weld};
use cairn_geometry::weld::Welder;

/// Metres from the origin beyond which a point is taken for a mistake: the sun is nearer.
const FARTHEST: f64 = 1e12;

/// The mesh of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Asset {
    /// Metres, glTF axes. Equal points are one point, every point is used, and there is at least one triangle. None has
    /// two equal corners; one whose corners lie on a line is merged with its neighbour, where that does not tear the
    /// surface.
    ///
    /// A whole file stands in its scene's frame. A chosen node stands in a frame with the node's own origin and the
    /// world's axes: the rotation and scale of all that is above the node are applied, the translation is not.
    pub mesh: TriMesh,
    /// The linear part (rotation, scale, shear) of the chosen node's world transform, already applied to `mesh`.
    /// Identity for a whole file.
    pub linear: DMat3,
    /// Where the chosen node's origin is in the world, m; zero for a whole file.
    pub origin: DVec3,
    /// Number of the chosen node in the file.
    pub root: Option<usize>,
    /// Triangles left out because they have no area.
    pub degenerate: usize,
    /// A node with a skin shows one of the meshes. Skins are not applied.
    pub is_skinned: bool,
    /// Deviations from the file's content, one sentence each.
    pub notes: Vec<String>,
}

/// Reads `source`, or reports everything that is wrong with it.
pub fn read(source: &Source<'_>) -> Result<Asset, Vec<AssetProblem>> {
    guarded(Log::new(source.name), |log| read_with(source, log))
}

/// A fault of this reader must cost one file, not the process. None is known.
fn guarded(mut log: Log, read: impl FnOnce(&mut Log) -> Logged<Asset>) -> Result<Asset, Vec<AssetProblem>> {
    match catch_unwind(AssertUnwindSafe(|| read(&mut log))) {
        Ok(Ok(asset)) if !log.any() => return Ok(asset),
        Ok(_) => {}
        Err(panic) => {
            let message = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
            let message = message.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            log.refuse("", ProblemKind::Internal { message });
        }
    }
    Err(log.into_problems())
}

fn read_with(source: &Source<'_>, log: &mut Log) -> Logged<Asset> {
    let Geometry { parts, root, linear, origin, why_empty, is_skinned, unread } = Geometry::open(source, log)?;
    let (mut welder, mut mesh, mut degenerate) = (Welder::default(), TriMesh::default(), 0);
    for (primitive, maps) in parts {
        degenerate += add(&primitive, &maps, &mut welder, &mut mesh, log);
    }
    mesh.points = welder.into_points();
    let repeated = drop_repeats(&mut mesh.triangles);
    if repeated > 0 {
        log.note("triangles that are there more than twice, facing the same way, are left out", &repeated.to_string());
    }
    unread.check(log);
    let flat = drop_flat(&mut mesh);
    degenerate += flat.dropped;
    if degenerate > 0 {
        let all = degenerate + mesh.triangles.len();
        log.note("triangles of no area are left out", &format!("{degenerate} of {all}"));
        mesh = weld(&mesh, 0.0); // their points go too
    }
    note_flat(&flat, log);
    if mesh.triangles.is_empty() && !log.any() {
        let all = (degenerate > 0).then(|| format!("every triangle ({degenerate}) has no area"));
        return Err(log.refuse("", ProblemKind::NoTriangles { why: all.or(why_empty) }));
    }
    Ok(Asset { mesh, linear, origin, root, degenerate, is_skinned, notes: log.notes() })
}

/// Of triangles with the same corners that face the same way, keeps one where their number is odd, and two where it is
/// even, as the repair of surfaces does later. What looks at each triangle that a ray meets would otherwise take a
/// minute for a file of a megabyte. Gives how many are gone.
fn drop_repeats(triangles: &mut Vec<[u32; 3]>) -> usize {
    let key = |(face, &[a, b, c]): (usize, &[u32; 3])| {
        let turned = [[a, b, c], [b, c, a], [c, a, b]].into_iter().min();
        (turned.unwrap_or_default(), face)
    };
    let mut keys: Vec<([u32; 3], usize)> = triangles.iter().enumerate().map(key).collect();
    keys.sort_unstable();
    let mut gone = vec![false; triangles.len()];
    for same in keys.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 2) {
        same[2 - same.len() % 2..].iter().for_each(|(_, face)| gone[*face] = true);
    }
    let before = triangles.len();
    let mut each = gone.into_iter();
    triangles.retain(|_| !each.next().unwrap_or_default());
    before - triangles.len()
}

/// Notes about triangles of no area that were not left out.
fn note_flat(flat: &Flat, log: &mut Log) {
    if flat.folded > 0 {
        log.note("triangles of no area are merged with those beside them", &flat.folded.to_string());
    }
    if flat.left > 0 {
        log.note("triangles of no area could not be taken away and stay", &flat.left.to_string());
    }
}

/// Adds a primitive to the mesh, once for each of `maps`, and gives how many triangles have two equal corners: these
/// are left out.
fn add(primitive: &Primitive<'_>, maps: &[DAffine3], welder: &mut Welder, mesh: &mut TriMesh, log: &mut Log) -> usize {
    let Ok(triangles) = primitive.triangles(log) else { return 0 };
    let Primitive { positions, place, .. } = primitive;
    let mut degenerate = 0;
    // Welded numbers by vertex; without the memory if few of many vertices are used.
    const UNKNOWN: u32 = u32::MAX;
    let remember = positions.count <= 8 * triangles.len() as u64 + 1024;
    let mut numbers = vec![UNKNOWN; if remember { positions.count as usize } else { 0 }];
    for map in maps {
        let mirrored = map.matrix3.determinant() < 0.0;
        numbers.fill(UNKNOWN);
        for &triangle in &triangles {
            let mut welded = [0; 3];
            for (corner, vertex) in welded.iter_mut().zip(triangle) {
                if let Some(&number) = numbers.get(vertex as usize)
                    && number != UNKNOWN
                {
                    *corner = number;
                    continue;
                }
                let point = map.transform_point3(positions.vector(u64::from(vertex)));
                if !point.is_finite() || point.abs().max_element() > FARTHEST {
                    let (vertex, value) = (u64::from(vertex), point.to_string());
                    log.refuse(place.clone(), ProblemKind::TooFar { vertex, value, limit: FARTHEST });
                    return degenerate;
                }
                *corner = welder.insert(point);
                if let Some(number) = numbers.get_mut(vertex as usize) {
                    *number = *corner;
                }
            }
            let [a, b, c] = welded;
            if a == b || b == c || c == a {
                degenerate += 1;
            } else {
                mesh.triangles.push(if mirrored { [a, c, b] } else { [a, b, c] });
            }
        }
    }
    degenerate
}
