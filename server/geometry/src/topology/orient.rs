//! Turns triangles until a mesh faces outward, and removes second copies.

use glam::DVec3;

use super::double::drop_doubles;
use super::{DisjointSets, Edges, Repair, area, drop_flat, weld};
use crate::TOLERANCE;
use crate::mesh::{TriMesh, bounds, box_holds, solid_angle};

/// Triangles that the search for cavities may look at: seconds of one core. Beyond, all parts count as solids.
const MOST_CAVITY_WORK: usize = 200_000_000;

/// The same surface, consistently oriented and facing outward, points welded bit-exactly.
///
/// - Doubled triangles become single, also back to back, unless that opens the surface (an inner wall, a fin).
/// - Triangles of no area are merged with those beside them.
/// - Orientation is spread over edges of two triangles; most of the area keeps its side.
/// - A closed part faces outward (positive volume), unless it is a cavity: it lies inside another closed part, and
///   the file had the two facing opposite ways. One that faces the same way as the part around it is a solid too.
/// - An open part faces outward as if a fan from the middle of its rim closed it; a flat one stays as it was.
pub fn oriented(mesh: &TriMesh) -> (TriMesh, Repair) {
    let mut repair = Repair::default();
    let mut result = weld(mesh, 0.0);
    repair.degenerate = mesh.triangles.len() - result.triangles.len();
    drop_doubles(&mut result, &mut repair);
    repair.flat = drop_flat(&mut result);
    if repair != Repair::default() {
        result = weld(&result, 0.0); // drops the points of removed triangles
    }

    let edges = Edges::new(&result.triangles);
    let turn = spread(&result, &edges, &mut repair);
    turn_over(&mut result, &turn);
    repair.turned = turn.iter().filter(|&&t| t).count();

    let parts = parts(&result, &edges);
    let outward = outward(&result, &parts, &mut repair);
    repair.inside_out = outward.iter().filter(|&&inward| inward).count();
    for (part, turn) in parts.iter().zip(outward) {
        if turn {
            part.faces.iter().for_each(|&f| result.triangles[f].swap(1, 2));
        }
    }
    (result, repair)
}

fn turn_over(mesh: &mut TriMesh, turn: &[bool]) {
    for (triangle, _) in mesh.triangles.iter_mut().zip(turn).filter(|(_, turn)| **turn) {
        triangle.swap(1, 2);
    }
}

/// Which triangles to turn, so that any two alone at an edge agree.
fn spread(mesh: &TriMesh, edges: &Edges, repair: &mut Repair) -> Vec<bool> {
    let count = mesh.triangles.len();
    // Neighbours over edges of two triangles, and whether they agree already.
    let mut neighbours: Vec<[(u32, bool); 3]> = vec![[(u32::MAX, true); 3]; count];
    for edge in edges.iter() {
        if let [a, b] = edge {
            let agree = a.forward != b.forward;
            for (from, to) in [(a.face, b.face), (b.face, a.face)] {
                let free = neighbours[from as usize].iter_mut().find(|n| n.0 == u32::MAX);
                if let Some(free) = free {
                    *free = (to, agree);
                }
            }
        }
    }
    let mut turn: Vec<Option<bool>> = vec![None; count];
    let mut clashes = 0;
    for start in 0..count {
        if turn[start].is_some() {
            continue;
        }
        turn[start] = Some(false);
        let mut patch = vec![start];
        let mut next = 0;
        while let Some(&face) = patch.get(next) {
            next += 1;
            let turned = turn[face] == Some(true);
            for &(neighbour, agree) in neighbours[face].iter().filter(|n| n.0 != u32::MAX) {
                // One of two that agree turns with the other; one of two that do not, without it.
                let wanted = turned == agree;
                let neighbour = neighbour as usize;
                match turn[neighbour] {
                    None => {
                        turn[neighbour] = Some(wanted);
                        patch.push(neighbour);
                    }
                    Some(found) => clashes += usize::from(found != wanted),
                }
            }
        }
        let area_of = |wanted: bool| -> f64 {
            patch.iter().filter(|&&f| turn[f] == Some(wanted)).map(|&f| area(mesh.corners(f))).sum()
        };
        if area_of(true) > area_of(false) {
            patch.iter().for_each(|&f| turn[f] = turn[f].map(|t| !t));
        }
    }
    repair.unorientable = clashes / 2; // each is met from both sides
    turn.into_iter().map(|t| t == Some(true)).collect()
}

/// Connected triangles, and the volume that they enclose.
struct MeshPart {
    faces: Vec<usize>,
    low: DVec3,
    high: DVec3,
    closed: bool,
    /// m^3; for an open part, as if a fan from the middle of its rim closed it.
    volume: f64,
}

fn parts(mesh: &TriMesh, edges: &Edges) -> Vec<MeshPart> {
    let mut sets = DisjointSets::new(mesh.triangles.len());
    for edge in edges.iter() {
        edge.iter().for_each(|side| sets.join(edge[0].face as usize, side.face as usize));
    }
    let (number, count) = sets.numbered();
    let mut faces: Vec<Vec<usize>> = vec![Vec::new(); count];
    number.iter().enumerate().for_each(|(face, &n)| faces[n].push(face));
    // Points at rims, with their number: edges at which an odd number of triangles meets.
    let mut rims = vec![(DVec3::ZERO, 0.0); count];
    for edge in edges.iter().filter(|edge| edge.len() % 2 == 1) {
        let rim = &mut rims[number[edge[0].face as usize]];
        for v in edge[0].edge {
            *rim = (rim.0 + mesh.points[v as usize], rim.1 + 1.0);
        }
    }
    let part = |(faces, (sum, n)): (Vec<usize>, (DVec3, f64))| {
        let (low, high) = bounds(faces.iter().flat_map(|&f| mesh.corners(f)));
        let origin = if n > 0.0 { sum / n } else { low };
        let volume = mesh.volume_about(origin, faces.iter().copied());
        MeshPart { faces, low, high, closed: n == 0.0, volume }
    };
    faces.into_iter().zip(rims).map(part).collect()
}

/// The parts to turn as a whole. Shape `[part]`.
fn outward(mesh: &TriMesh, parts: &[MeshPart], repair: &mut Repair) -> Vec<bool> {
    // Else the part has no inside.
    let solid = |p: &MeshPart| p.volume.abs() > TOLERANCE * p.low.distance(p.high).powi(3);
    // Largest first: a containing part is oriented before the parts inside it.
    let mut order: Vec<usize> = (0..parts.len()).filter(|&i| parts[i].closed && solid(&parts[i])).collect();
    order.sort_by(|&a, &b| parts[b].volume.abs().total_cmp(&parts[a].volume.abs()).then(a.cmp(&b)));

    let holds = |outer: &MeshPart, inner: &MeshPart| box_holds((outer.low, outer.high), (inner.low, inner.high));
    let mut work = 0usize;
    let mut faces_inward = vec![false; parts.len()];
    for (rank, &inner) in order.iter().enumerate() {
        // From the smallest of the larger ones: the first that holds it is the innermost.
        let container = order[..rank].iter().rev().find(|&&outer| {
            work += 1;
            if work > MOST_CAVITY_WORK || !holds(&parts[outer], &parts[inner]) {
                return false;
            }
            work += 3 * parts[outer].faces.len();
            contains(mesh, &parts[outer], &parts[inner])
        });
        if let Some(&outer) = container {
            let opposite = (parts[inner].volume < 0.0) != (parts[outer].volume < 0.0);
            faces_inward[inner] = opposite && !faces_inward[outer];
        }
    }
    if work > MOST_CAVITY_WORK {
        repair.cavities_not_sought = true;
        faces_inward.fill(false);
    }
    repair.cavities = faces_inward.iter().filter(|&&inward| inward).count();
    parts.iter().zip(faces_inward).map(|(p, inward)| solid(p) && (p.volume < 0.0) != inward).collect()
}

/// Is `inner` inside the closed surface `outer`? Three of its points must be: parts that merely cross are apart.
fn contains(mesh: &TriMesh, outer: &MeshPart, inner: &MeshPart) -> bool {
    let n = inner.faces.len();
    [0, n / 2, n - 1].iter().all(|&k| {
        let [a, b, c] = mesh.corners(inner.faces[k]);
        winding(mesh, outer, (a + b + c) / 3.0).abs() > 0.5
    })
}

/// Winding number of a surface around a point.
fn winding(mesh: &TriMesh, part: &MeshPart, point: DVec3) -> f64 {
    let angle = |&face: &usize| solid_angle(point, &mesh.corners(face));
    part.faces.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}
