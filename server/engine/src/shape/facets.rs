//! The facets and edges of a hull, from its triangles.

use cairn_geometry::SINGLE_ROUNDING;
use rapier3d::math::Vector;
use std::collections::BTreeMap;

/// Which edges meet at each corner, and which are around each facet.
#[derive(Clone, Debug)]
pub struct EdgesAround {
    pub corners: Incidence,
    pub facets: Incidence,
}

/// For each of some things, those of others that touch it.
#[derive(Clone, Debug)]
pub struct Incidence {
    /// Where the list of each thing begins; one more ends the last.
    begins: Vec<u32>,
    lists: Vec<u32>,
}

impl EdgesAround {
    pub(super) fn new(edges: &[HullEdge], corners: usize, facets: usize) -> EdgesAround {
        let numbered = || (0..).zip(edges);
        EdgesAround {
            corners: Incidence::new(corners, numbered().flat_map(|(k, e): (u32, &HullEdge)| e.corners.map(|i| (i, k)))),
            facets: Incidence::new(facets, numbered().flat_map(|(k, e): (u32, &HullEdge)| e.facets.map(|f| (f, k)))),
        }
    }
}

impl Incidence {
    /// `pairs`: of a thing below `count` and of what touches it.
    fn new(count: usize, pairs: impl Iterator<Item = (u32, u32)>) -> Incidence {
        let mut lists = vec![Vec::new(); count];
        pairs.for_each(|(thing, other)| lists[thing as usize].push(other));
        let ends = lists.iter().scan(0, |end, list: &Vec<u32>| {
            *end += list.len() as u32;
            Some(*end)
        });
        Incidence { begins: std::iter::once(0).chain(ends).collect(), lists: lists.concat() }
    }

    pub fn of(&self, thing: usize) -> &[u32] {
        &self.lists[self.begins[thing] as usize..self.begins[thing + 1] as usize]
    }
}

/// A convex polygon of the surface.
#[derive(Clone, Debug)]
pub struct Facet {
    /// Indices of its corners, counterclockwise from outside.
    pub corners: Vec<u32>,
    /// Unit, outwards.
    pub normal: Vector,
}

/// An edge between two facets. Indices; the corners are in the order in which the first facet has them.
#[derive(Clone, Copy, Debug)]
pub struct HullEdge {
    pub corners: [u32; 2],
    pub facets: [u32; 2],
}

/// Merges triangles that lie in one plane, from the largest on.
pub(super) fn facets(points: &[Vector], triangles: &[[u32; 3]]) -> Vec<Facet> {
    let at = |i: u32| points[i as usize];
    let area = |t: &[u32; 3]| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0]));
    let center = points.iter().sum::<Vector>() / points.len() as f32;
    let size = points.iter().map(|p| p.distance(center)).fold(0.0, f32::max);
    let mut beyond: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for (i, t) in triangles.iter().enumerate() {
        beyond.extend((0..3).map(|k| ([t[(k + 1) % 3], t[k]], i)));
    }
    let mut order: Vec<usize> = (0..triangles.len()).collect();
    order.sort_by(|&i, &j| area(&triangles[j]).length_squared().total_cmp(&area(&triangles[i]).length_squared()));
    let mut taken = vec![false; triangles.len()];
    let mut facets = Vec::new();
    for seed in order {
        let Some(normal) = area(&triangles[seed]).try_normalize().filter(|_| !taken[seed]) else { continue };
        let origin = at(triangles[seed][0]);
        // Triangles are of one facet if their corners are in its plane, up to rounding.
        let is_flat = |t: &[u32; 3]| t.iter().all(|&i| (at(i) - origin).dot(normal).abs() <= SINGLE_ROUNDING * size);
        taken[seed] = true;
        let (mut group, mut looked) = (vec![seed], 0);
        while let Some(&i) = group.get(looked) {
            looked += 1;
            let t = triangles[i];
            for k in 0..3 {
                let Some(&next) = beyond.get(&[t[k], t[(k + 1) % 3]]) else { continue };
                if !taken[next] && is_flat(&triangles[next]) {
                    taken[next] = true;
                    group.push(next);
                }
            }
        }
        let polygons = match outline(group.iter().map(|&i| triangles[i])) {
            Some(corners) => vec![(corners, normal)],
            None => {
                let single = |&i: &usize| Some((triangles[i].to_vec(), area(&triangles[i]).try_normalize()?));
                group.iter().filter_map(single).collect()
            }
        };
        for (corners, normal) in polygons {
            facets.push(Facet { corners, normal });
        }
    }
    facets
}

pub(super) fn edges(facets: &[Facet]) -> Vec<HullEdge> {
    let mut facet_of: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for (k, facet) in facets.iter().enumerate() {
        let around = facet.corners.iter().zip(facet.corners.iter().cycle().skip(1));
        facet_of.extend(around.map(|(&i, &j)| ([i, j], k as u32)));
    }
    let mut edges = Vec::new();
    for (&[i, j], &facet) in &facet_of {
        let twin = facet_of.get(&[j, i]).copied();
        if i < j || twin.is_none() {
            edges.push(HullEdge { corners: [i, j], facets: [facet, twin.unwrap_or(facet)] });
        }
    }
    edges
}

/// The corners around a group of triangles; `None` where they are not one loop.
fn outline(triangles: impl Iterator<Item = [u32; 3]>) -> Option<Vec<u32>> {
    let mut border: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for t in triangles {
        for k in 0..3 {
            let (from, to) = (t[k], t[(k + 1) % 3]);
            match border.get_mut(&to).and_then(|next| Some((next.iter().position(|&n| n == from)?, next))) {
                Some((shared, next)) => drop(next.swap_remove(shared)),
                None => border.entry(from).or_default().push(to),
            }
        }
    }
    border.retain(|_, next| !next.is_empty());
    let first = *border.keys().next()?;
    let mut corners = vec![first];
    while let [next] = border.get(corners.last()?)?[..] {
        if next == first {
            return (corners.len() == border.len()).then_some(corners);
        }
        if corners.len() == border.len() {
            return None;
        }
        corners.push(next);
    }
    None
}
