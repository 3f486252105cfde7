//! Triangles that are there twice: the copies that a clean surface keeps.

use std::collections::HashMap;

use super::{DisjointSets, Edges, Repair};
use crate::mesh::TriMesh;

/// Removes triangles that share all three corners with another, whichever way they face, where that leaves the
/// surface at least as closed:
///
/// - Of three or more, pairs go: the number at each edge stays odd or even.
/// - A part of doubled triangles alone (a mesh exported twice, a double-sided sheet) becomes single.
/// - Doubled triangles elsewhere become single if most edges at the rim of their patch have an odd number of triangles
///   now; if not, as at an inner wall or a fin, both stay, which encloses nothing.
pub(super) fn drop_doubles(mesh: &mut TriMesh, repair: &mut Repair) {
    let mut keep = vec![true; mesh.triangles.len()];
    let pairs = pairs(&mesh.triangles, &mut keep);
    if pairs.is_empty() && keep.iter().all(|&k| k) {
        return;
    }
    let mut kept = keep.iter();
    let edges = Edges::of(mesh.triangles.iter().enumerate().filter(|_| *kept.next().unwrap_or(&true)));
    let mut second = vec![false; mesh.triangles.len()];
    let mut doubled = vec![false; mesh.triangles.len()];
    for &[a, b] in &pairs {
        second[b] = true;
        (doubled[a], doubled[b]) = (true, true);
    }

    // Parts of the surface, and patches of doubled triangles in them.
    let (mut parts, mut patches) = (DisjointSets::new(mesh.triangles.len()), DisjointSets::new(mesh.triangles.len()));
    for edge in edges.iter() {
        edge.iter().for_each(|side| parts.join(edge[0].face as usize, side.face as usize));
        let mut here = edge.iter().map(|side| side.face as usize).filter(|&f| doubled[f]);
        if let Some(first) = here.next() {
            here.for_each(|face| patches.join(first, face));
        }
    }
    let mut whole = vec![true; mesh.triangles.len()];
    for face in (0..mesh.triangles.len()).filter(|&f| keep[f] && !doubled[f]) {
        whole[parts.find(face)] = false;
    }
    // By patch: edges whose parity would change, and how many of them are odd now.
    let mut rims: HashMap<usize, [usize; 2]> = HashMap::new();
    for edge in edges.iter() {
        let mut going = edge.iter().filter(|side| second[side.face as usize]);
        if let Some(first) = going.next()
            && going.count() % 2 == 0
        {
            let rim = rims.entry(patches.find(first.face as usize)).or_default();
            *rim = [rim[0] + 1, rim[1] + edge.len() % 2];
        }
    }
    for &[a, b] in &pairs {
        let [rim, odd] = rims.get(&patches.find(a)).copied().unwrap_or_default();
        if whole[parts.find(a)] || 2 * odd > rim {
            keep[b] = false;
        }
    }
    repair.duplicates = keep.iter().filter(|&&k| !k).count();
    let mut kept = keep.iter();
    mesh.triangles.retain(|_| *kept.next().unwrap_or(&true));
}

/// Pairs of triangles with the same corners; of more than two, superfluous pairs lose their `keep`.
fn pairs(triangles: &[[u32; 3]], keep: &mut [bool]) -> Vec<[usize; 2]> {
    let key = |(face, &corners): (usize, &[u32; 3])| {
        let mut sorted = corners;
        sorted.sort_unstable();
        (sorted, face)
    };
    let mut keys: Vec<_> = triangles.iter().enumerate().map(key).collect();
    keys.sort_unstable();
    let mut pairs = Vec::new();
    for same in keys.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1) {
        let stay = if same.len() % 2 == 1 { 1 } else { 2 };
        same[stay..].iter().for_each(|&(_, face)| keep[face] = false);
        if stay == 2 {
            pairs.push([same[0].1, same[1].1]);
        }
    }
    pairs
}
