//! A convex polyhedron, with facets that are flat.
//!
//! The engine's own merges faces whose normals differ by up to a degree and a half, and forgets the corners between
//! them: a point of such a face may be off by a hundredth of the prop, which is more than a thin prop's thickness.

use super::lanes::{CornerLanes, PlaneLanes, aabb, lanes, outermost, plane_lanes};
use cairn_geometry::SINGLE_ROUNDING;
use cairn_geometry::hull::convex_hull;
use rapier3d::math::{Pose, Vector};
use rapier3d::parry::bounding_volume::{Aabb, BoundingSphere};
use rapier3d::parry::mass_properties::MassProperties;
use rapier3d::parry::query::{PointProjection, PointQuery, Ray, RayCast, RayIntersection};
use rapier3d::parry::shape::{
    ConvexPolyhedron, FeatureId, PolygonalFeatureMap, Shape, ShapeType, SupportMap, TypedShape,
};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// The convex hull of some points.
#[derive(Clone, Debug)]
pub struct Hull {
    solid: ConvexPolyhedron,
    /// The same points, for the search of the outermost one.
    lanes: Arc<[CornerLanes]>,
    facets: Arc<[Facet]>,
    /// Those of the facets.
    planes: Arc<[PlaneLanes]>,
    edges: Arc<[HullEdge]>,
    around: Arc<EdgesAround>,
}

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

impl Hull {
    /// `None` where the geometry library finds no hull: too few points, or some that are not finite.
    pub fn new(points: &[Vector]) -> Option<Hull> {
        // The library panics on some dirty points.
        let hull = || {
            let (points, triangles) = convex_hull(points)?;
            Some((facets(&points, &triangles), ConvexPolyhedron::from_convex_mesh(points, &triangles)?))
        };
        let (facets, solid) = catch_unwind(AssertUnwindSafe(hull)).ok()??;
        let edges = edges(&facets);
        let (lanes, planes) = (lanes(solid.points()), planes(&facets, solid.points()));
        let numbered = || (0..).zip(&edges);
        let around = EdgesAround {
            corners: Incidence::new(
                solid.points().len(),
                numbered().flat_map(|(k, e): (u32, &HullEdge)| e.corners.map(|i| (i, k))),
            ),
            facets: Incidence::new(
                facets.len(),
                numbered().flat_map(|(k, e): (u32, &HullEdge)| e.facets.map(|f| (f, k))),
            ),
        };
        Some(Hull { lanes, planes, solid, facets: facets.into(), edges: edges.into(), around: around.into() })
    }

    /// The same hull, `factor` times as large, without a search.
    pub fn scaled(&self, factor: f32) -> Hull {
        let solid = self.solid.clone().scaled(Vector::splat(factor)).unwrap_or_else(|| self.solid.clone());
        let (lanes, planes) = (lanes(solid.points()), planes(&self.facets, solid.points()));
        Hull { lanes, planes, solid, ..self.clone() }
    }

    pub fn points(&self) -> &[Vector] {
        self.solid.points()
    }

    pub fn facets(&self) -> &[Facet] {
        &self.facets
    }

    pub fn edges(&self) -> &[HullEdge] {
        &self.edges
    }

    pub fn around(&self) -> &EdgesAround {
        &self.around
    }

    pub fn lanes(&self) -> &[CornerLanes] {
        &self.lanes
    }

    pub fn planes(&self) -> &[PlaneLanes] {
        &self.planes
    }
}

/// Each is as far out as its facet's outermost corner.
fn planes(facets: &[Facet], points: &[Vector]) -> Arc<[PlaneLanes]> {
    let of = |facet: &Facet| {
        let height = |&i: &u32| points[i as usize].dot(facet.normal);
        (facet.normal, facet.corners.iter().map(height).fold(f32::NEG_INFINITY, f32::max))
    };
    plane_lanes(&facets.iter().map(of).collect::<Vec<_>>())
}

/// Merges triangles that lie in one plane, from the largest on.
fn facets(points: &[Vector], triangles: &[[u32; 3]]) -> Vec<Facet> {
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

fn edges(facets: &[Facet]) -> Vec<HullEdge> {
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

impl SupportMap for Hull {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let number = outermost(&self.lanes, direction);
        // The last chunk is filled up with the last point.
        self.points()[number.min(self.points().len() - 1)]
    }
}

impl PointQuery for Hull {
    fn project_local_point(&self, point: Vector, solid: bool) -> PointProjection {
        self.solid.project_local_point(point, solid)
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        self.solid.project_local_point_and_get_feature(point)
    }
}

impl RayCast for Hull {
    fn cast_local_ray_and_get_normal(&self, ray: &Ray, far: f32, solid: bool) -> Option<RayIntersection> {
        self.solid.cast_local_ray_and_get_normal(ray, far, solid)
    }
}

impl Shape for Hull {
    fn compute_local_aabb(&self) -> Aabb {
        self.solid.compute_local_aabb()
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        self.solid.compute_local_bounding_sphere()
    }

    fn compute_aabb(&self, position: &Pose) -> Aabb {
        aabb(&self.lanes, position)
    }

    fn clone_dyn(&self) -> Box<dyn Shape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, scale: Vector, _: u32) -> Option<Box<dyn Shape>> {
        let scaled: Vec<Vector> = self.points().iter().map(|&p| p * scale).collect();
        Some(Box::new(Hull::new(&scaled)?))
    }

    fn mass_properties(&self, density: f32) -> MassProperties {
        self.solid.mass_properties(density)
    }

    fn is_convex(&self) -> bool {
        true
    }

    fn shape_type(&self) -> ShapeType {
        ShapeType::Custom
    }

    /// For continuous collision detection: the engine sweeps its own polyhedra many times faster than shapes unknown to
    /// it.
    fn as_typed_shape(&self) -> TypedShape<'_> {
        TypedShape::ConvexPolyhedron(&self.solid)
    }

    fn ccd_thickness(&self) -> f32 {
        self.solid.ccd_thickness()
    }

    fn ccd_angular_thickness(&self) -> f32 {
        self.solid.ccd_angular_thickness()
    }

    fn as_support_map(&self) -> Option<&dyn SupportMap> {
        Some(self)
    }

    fn as_polygonal_feature_map(&self) -> Option<(&dyn PolygonalFeatureMap, f32)> {
        self.solid.as_polygonal_feature_map()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    /// A plate whose top is a ridge along z, this high.
    fn roof(ridge: f32) -> Hull {
        let end = |z: f32| {
            [(-1.0, 0.0), (-1.0, 0.1), (0.0, 0.1 + ridge), (1.0, 0.1), (1.0, 0.0)].map(|(x, y)| Vector::new(x, y, z))
        };
        Hull::new(&[end(-0.5), end(0.5)].concat()).expect("it has a volume")
    }

    #[test]
    fn a_ridge_of_one_degree_parts_two_facets() {
        assert_eq!(roof(0.01).facets().len(), 7);
        assert_eq!(roof(0.00005).facets().len(), 6, "flat enough");
    }

    #[test]
    fn facets_close_the_surface() {
        let turn = |k: u32| f32::sin_cos(k as f32 * 0.37);
        let stone: Vec<Vector> = (0..40).map(|k| Vector::new(turn(k).0, turn(3 * k).1, turn(7 * k + 1).0)).collect();
        let disc: Vec<Vector> = (0..34u32)
            .map(|k| {
                let (x, z) = f32::sin_cos((k / 2) as f32 / 17.0 * std::f32::consts::TAU);
                Vector::new(x, if k % 2 == 0 { 0.0 } else { 0.05 }, z)
            })
            .collect();
        for (points, facets) in [(stone, None), (disc, Some(19))] {
            let hull = Hull::new(&points).expect("it has a volume");
            assert_eq!(hull.points().len() + hull.facets().len(), hull.edges().len() + 2, "Euler");
            assert!(facets.is_none_or(|n| n == hull.facets().len()), "{}", hull.facets().len());
            for facet in hull.facets() {
                let at = |i: &u32| hull.points()[*i as usize].dot(facet.normal);
                let height = at(&facet.corners[0]);
                assert!(facet.corners.iter().all(|i| (at(i) - height).abs() < 3.0 * SINGLE_ROUNDING));
                assert!((0..hull.points().len() as u32).all(|i| at(&i) < height + 3.0 * SINGLE_ROUNDING));
            }
        }
    }

    #[test]
    fn a_scaled_hull_is_the_hull_of_scaled_points() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 0.9, 0.0], [0.1, 0.2, 0.7], [0.8, 0.7, 0.6]];
        let at = |factor: f32| points.map(|p| Vector::from(p) * factor);
        let (scaled, direct) = (Hull::new(&at(1.0)).unwrap().scaled(0.25), Hull::new(&at(0.25)).unwrap());
        assert_eq!(scaled.points(), direct.points());
        let facets = |hull: &Hull| hull.facets().iter().map(|f| f.corners.clone()).collect::<Vec<_>>();
        assert_eq!(facets(&scaled), facets(&direct));
        let direction = Vector::new(0.3, -0.5, 0.8);
        assert_eq!(scaled.local_support_point(direction), direct.local_support_point(direction));
        assert!((scaled.mass_properties(1.0).mass() - direct.mass_properties(1.0).mass()).abs() < 1e-6);
    }

    #[test]
    fn outermost_points_and_boxes_are_the_engines() {
        let turn = |k: u32| f32::sin_cos(k as f32 * 0.37);
        for count in [4, 7, 8, 9, 40] {
            let points: Vec<Vector> =
                (0..count).map(|k| Vector::new(turn(k).0, turn(3 * k + 1).1, turn(7 * k + 1).0)).collect();
            let hull = Hull::new(&points).expect("it has a volume");
            for k in 0..200 {
                let direction = Vector::new(turn(11 * k).0, turn(5 * k).1, turn(2 * k).0);
                assert_eq!(hull.local_support_point(direction), hull.solid.local_support_point(direction));
                let place = Pose::from_parts(direction * 7.0, Quat::from_scaled_axis(direction * 3.0));
                let (own, theirs) = (hull.compute_aabb(&place), hull.solid.compute_aabb(&place));
                assert_eq!((own.mins, own.maxs), (theirs.mins, theirs.maxs));
            }
        }
    }

    #[test]
    fn points_without_a_volume_have_no_hull() {
        assert!(Hull::new(&[]).is_none());
        assert!(Hull::new(&[Vector::NAN; 5]).is_none());
    }
}
