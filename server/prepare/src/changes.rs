//! What is new around a pile, compared with an earlier one: places of the surfaces that only one of the two has.
//!
//! Triangles that both have to the bit, in single precision, are no change. Of the others, only places count that are
//! farther than a small tolerance from the other surface: a mesh may be divided into other triangles and lie where it
//! lay.

use crate::surroundings::placed;
use cairn_geometry::interior::Bvh;
use cairn_geometry::mesh::{TriMesh, bounds, boxes_meet};
use cairn_input::earlier::EarlierPile;
use cairn_input::scene::Scene;
use glam::{DVec3, IVec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Surfaces that are no farther apart than this are one, d: far less than a body moves unseen.
const TOLERANCE: f64 = 0.02;
/// Distance of the places at which surfaces are compared, d, and at least this share of the box that is looked at: its
/// work is bounded, however small the props are, and whatever an earlier result holds.
const SPACING: f64 = 0.25;
const FINEST: f64 = 1.0 / 200.0;

/// Places of surfaces that only one of two scenes has. SI.
pub struct Changes {
    /// The places, by cells of this edge, m, which is no less than the reach.
    cells: BTreeMap<[i32; 3], Vec<DVec3>>,
    edge: f64,
    /// m.
    reach: f64,
    /// Below this height, the ground is near that moved.
    near_ground: f64,
}

impl Changes {
    /// Compares a scene with an earlier pile. `ground`: height of its ground, m; `diameter`: d, m.
    pub fn new(earlier: &EarlierPile, scene: &Scene, ground: Option<f64>, diameter: f64) -> Changes {
        let reach = earlier.reach * diameter;
        let mut scenery = TriMesh::default();
        scene.statics.iter().for_each(|model| scenery.append(&placed(model)));
        // Bodies beyond the new shape do not stay, whatever is there.
        let own = scene.control.as_ref().map_or(&scenery, |model| &model.mesh);
        let (mut all, mut spacing) = (Vec::new(), SPACING * diameter);
        if !earlier.shape.points.is_empty() && !own.points.is_empty() {
            let (low, high) = own.bounds();
            let area = (low - reach, high + reach);
            spacing = spacing.max(FINEST * (high - low).max_element());
            let places = |old, new| places(old, new, area, diameter, spacing);
            if let Some(control) = &scene.control {
                all = places(&earlier.shape, &control.mesh);
            }
            all.extend(places(&earlier.scenery, &scenery));
        }
        let mut cells: BTreeMap<[i32; 3], Vec<DVec3>> = BTreeMap::new();
        // Cells of a width that is never 0. Between places that are far apart, more is near.
        let edge = reach.max(spacing);
        let reach = if spacing > SPACING * diameter { edge } else { reach };
        all.into_iter().for_each(|p| cells.entry(cell(p, edge)).or_default().push(p));
        let near_ground = match (earlier.ground, ground) {
            (Some(a), Some(b)) if (a - b).abs() <= TOLERANCE * diameter => f64::NEG_INFINITY,
            (None, None) => f64::NEG_INFINITY,
            (a, b) => a.into_iter().chain(b).fold(f64::NEG_INFINITY, f64::max) + reach,
        };
        Changes { cells, edge, reach, near_ground }
    }

    /// Whether nothing is new.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty() && self.near_ground == f64::NEG_INFINITY
    }

    /// Whether a point, m, is within the reach of what is new.
    pub fn is_near(&self, p: DVec3) -> bool {
        if p.y < self.near_ground {
            return true;
        }
        let [x, y, z] = cell(p, self.edge);
        let near = |at: [i32; 3]| {
            let places = self.cells.get(&at);
            places.is_some_and(|places| places.iter().any(|q| q.distance_squared(p) <= self.reach * self.reach))
        };
        (-1..=1).any(|i| (-1..=1).any(|j| (-1..=1).any(|k| near([x + i, y + j, z + k]))))
    }
}

fn cell(p: DVec3, edge: f64) -> [i32; 3] {
    let IVec3 { x, y, z } = (p / edge).floor().as_ivec3();
    [x, y, z]
}

/// The places of two surfaces in a box that are not on the other one.
fn places(old: &TriMesh, new: &TriMesh, area: (DVec3, DVec3), diameter: f64, spacing: f64) -> Vec<DVec3> {
    let triangles = |mesh: &TriMesh| -> Vec<[DVec3; 3]> {
        let single = |p: DVec3| p.as_vec3().as_dvec3();
        let all = (0..mesh.triangles.len()).map(|i| mesh.corners(i).map(single));
        all.filter(|&t| meets(t, area)).collect()
    };
    let (old, new) = (triangles(old), triangles(new));
    let mut both = only(&old, &new, area, diameter, spacing);
    both.extend(only(&new, &old, area, diameter, spacing));
    both
}

fn meets(triangle: [DVec3; 3], area: (DVec3, DVec3)) -> bool {
    boxes_meet(bounds(triangle.into_iter()), area, DVec3::ZERO)
}

/// The places of the first surface that are not on the second.
fn only(these: &[[DVec3; 3]], others: &[[DVec3; 3]], area: (DVec3, DVec3), diameter: f64, spacing: f64) -> Vec<DVec3> {
    let known: BTreeSet<[u32; 9]> = others.iter().map(name).collect();
    let changed: Vec<[DVec3; 3]> = these.iter().filter(|t| !known.contains(&name(t))).copied().collect();
    if changed.is_empty() {
        return Vec::new();
    }
    let tree = Bvh::new(others.iter().enumerate().map(|(i, t)| (i as u32, *t)).collect());
    let most = (TOLERANCE * diameter).powi(2);
    let found = changed.par_iter().map(|triangle| {
        let mut places = sampled(*triangle, area, spacing);
        places.retain(|&p| tree.nearest(p, 0).is_none_or(|hit| hit.squared > most));
        places
    });
    found.collect::<Vec<_>>().concat()
}

/// A triangle by the bits of its corners, whichever comes first.
fn name(corners: &[DVec3; 3]) -> [u32; 9] {
    // 0 and -0 are one place.
    let bits = |p: DVec3| (p.as_vec3() + 0.0).to_array().map(f32::to_bits);
    let [a, b, c] = corners.map(bits);
    let turns = [[a, b, c], [b, c, a], [c, a, b]];
    let [a, b, c] = *turns.iter().min().expect("there are three");
    let mut name = [0; 9];
    name[..3].copy_from_slice(&a);
    name[3..6].copy_from_slice(&b);
    name[6..].copy_from_slice(&c);
    name
}

/// Places of a triangle, about this far apart at most.
fn sampled(triangle: [DVec3; 3], area: (DVec3, DVec3), spacing: f64) -> Vec<DVec3> {
    let (mut open, mut places) = (vec![triangle], Vec::new());
    while let Some([a, b, c]) = open.pop() {
        if !meets([a, b, c], area) {
            continue;
        }
        // The longest edge comes first.
        let edges = [(a.distance(b), [a, b, c]), (b.distance(c), [b, c, a]), (c.distance(a), [c, a, b])];
        let (length, [p, q, r]) =
            edges.into_iter().fold(edges[0], |one, other| if other.0 > one.0 { other } else { one });
        if length <= spacing {
            places.push((a + b + c) / 3.0);
        } else {
            let middle = (p + q) / 2.0;
            open.extend([[p, middle, r], [middle, q, r]]);
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_input::scene::Model;

    /// A box between two corners, its faces in so many strips.
    fn slab(low: DVec3, high: DVec3) -> TriMesh {
        let corner = |i: u32| {
            let pick = |bit: u32, low: f64, high: f64| if i >> bit & 1 == 0 { low } else { high };
            DVec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        TriMesh { points: (0..8).map(corner).collect(), triangles }
    }

    fn changes(old: TriMesh, new: TriMesh) -> Changes {
        let earlier = EarlierPile { shape: old, ground: Some(0.0), reach: 3.0, ..EarlierPile::default() };
        let scene = Scene { control: Some(Model::new("shape", new)), ..Scene::default() };
        Changes::new(&earlier, &scene, Some(0.0), 0.1)
    }

    #[test]
    fn another_division_of_the_same_surface_is_no_change() {
        let whole = slab(DVec3::ZERO, DVec3::ONE);
        assert!(changes(whole.clone(), whole.clone()).is_empty());
        let mut divided = whole.clone();
        let [a, b, c] = divided.triangles[0];
        divided.points.push((divided.points[a as usize] + divided.points[b as usize]) / 2.0);
        divided.triangles[0] = [a, 8, c];
        divided.triangles.push([8, b, c]);
        assert!(changes(whole, divided).is_empty());
    }

    #[test]
    fn only_places_near_the_moved_face_are_near_the_change() {
        let (whole, longer) = (slab(DVec3::ZERO, DVec3::ONE), slab(DVec3::ZERO, DVec3::new(1.1, 1.0, 1.0)));
        let changes = changes(whole, longer);
        assert!(changes.is_near(DVec3::new(0.75, 0.5, 0.5)));
        assert!(!changes.is_near(DVec3::new(0.65, 0.5, 0.5)));
        assert!(!changes.is_near(DVec3::new(0.1, 0.1, 0.9)));
    }

    #[test]
    fn what_lies_far_away_costs_nothing() {
        // An earlier shape of any size, and props of a billionth of it.
        let whole = slab(DVec3::ZERO, DVec3::ONE);
        let mut far = whole.clone();
        far.points.extend([DVec3::ZERO, DVec3::X, DVec3::Z].map(|p| 1e30 * p));
        far.triangles.push([8, 9, 10]);
        assert!(!changes(far, whole.clone()).is_empty(), "its plane goes through the shape");
        let high = slab(DVec3::splat(1e20), DVec3::splat(2e20));
        let earlier = EarlierPile { shape: high, ground: Some(0.0), reach: 1.0, ..EarlierPile::default() };
        let scene = Scene { control: Some(Model::new("shape", whole)), ..Scene::default() };
        let places: usize = Changes::new(&earlier, &scene, Some(0.0), 1e-9).cells.values().map(Vec::len).sum();
        assert!((100_000..5_000_000).contains(&places), "{places}");
    }

    #[test]
    fn a_ground_that_moved_is_near_what_is_low() {
        let shape = slab(DVec3::ZERO, DVec3::ONE);
        let earlier = EarlierPile { shape: shape.clone(), ground: Some(0.0), reach: 3.0, ..EarlierPile::default() };
        let scene = Scene { control: Some(Model::new("shape", shape)), ..Scene::default() };
        let changes = Changes::new(&earlier, &scene, Some(-0.5), 0.1);
        assert!(changes.is_near(DVec3::new(0.5, 0.25, 0.5)) && !changes.is_near(DVec3::new(0.5, 0.35, 0.5)));
    }
}
