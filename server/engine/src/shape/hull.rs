//! A convex polyhedron, with facets that are flat.
//!
//! The engine's own merges faces whose normals differ by up to a degree and a half, and forgets the corners between
//! them: a point of such a face may be off by a hundredth of the prop, which is more than a thin prop's thickness.

use super::facets::{EdgesAround, Facet, HullEdge, edges, facets};
use super::lanes::{CornerLanes, PlaneLanes, aabb, lanes, outermost, plane_lanes};
use cairn_geometry::hull::convex_hull;
use rapier3d::math::{Pose, Vector};
use rapier3d::parry::bounding_volume::{Aabb, BoundingSphere};
use rapier3d::parry::mass_properties::MassProperties;
use rapier3d::parry::query::{PointProjection, PointQuery, Ray, RayCast, RayIntersection};
use rapier3d::parry::shape::{
    ConvexPolyhedron, FeatureId, PolygonalFeatureMap, Shape, ShapeType, SupportMap, TypedShape,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, OnceLock};

/// The convex hull of some points, at some size: hulls of all sizes share what is in them.
#[derive(Clone, Debug)]
pub struct Hull {
    unit: Arc<UnitHull>,
    scale: f32,
    solid: Arc<Solid>,
}

/// A hull as the engine has it: made when it is asked for.
#[derive(Debug, Default)]
struct Solid {
    polyhedron: OnceLock<ConvexPolyhedron>,
    /// Of density 1: each sweep of continuous collision asks for it again.
    mass: OnceLock<MassProperties>,
}

/// A hull at the size of the points that it was made from.
#[derive(Debug)]
struct UnitHull {
    solid: ConvexPolyhedron,
    /// The same points, for the search of the outermost one.
    lanes: Vec<CornerLanes>,
    facets: Vec<Facet>,
    /// Those of the facets.
    planes: Vec<PlaneLanes>,
    edges: Vec<HullEdge>,
    around: EdgesAround,
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
        let around = EdgesAround::new(&edges, solid.points().len(), facets.len());
        let unit = UnitHull { lanes, planes, solid, facets, edges, around };
        Some(Hull { unit: Arc::new(unit), scale: 1.0, solid: Arc::default() })
    }

    /// The same hull, `factor` times as large, without a search.
    pub fn scaled(&self, factor: f32) -> Hull {
        Hull { unit: self.unit.clone(), scale: self.scale * factor, solid: Arc::default() }
    }

    /// As the engine has it.
    fn solid(&self) -> &ConvexPolyhedron {
        let unit = &self.unit.solid;
        if self.scale == 1.0 {
            return unit;
        }
        self.solid
            .polyhedron
            .get_or_init(|| unit.clone().scaled(Vector::splat(self.scale)).unwrap_or_else(|| unit.clone()))
    }

    pub fn points(&self) -> &[Vector] {
        self.solid().points()
    }

    pub fn facets(&self) -> &[Facet] {
        &self.unit.facets
    }

    pub fn edges(&self) -> &[HullEdge] {
        &self.unit.edges
    }

    pub fn around(&self) -> &EdgesAround {
        &self.unit.around
    }

    /// How much larger it is than its corners and planes, which it shares.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    pub fn unit_points(&self) -> &[Vector] {
        self.unit.solid.points()
    }

    pub fn unit_lanes(&self) -> &[CornerLanes] {
        &self.unit.lanes
    }

    pub fn unit_planes(&self) -> &[PlaneLanes] {
        &self.unit.planes
    }
}

/// Each is as far out as its facet's outermost corner.
fn planes(facets: &[Facet], points: &[Vector]) -> Vec<PlaneLanes> {
    let of = |facet: &Facet| {
        let height = |&i: &u32| points[i as usize].dot(facet.normal);
        (facet.normal, facet.corners.iter().map(height).fold(f32::NEG_INFINITY, f32::max))
    };
    plane_lanes(&facets.iter().map(of).collect::<Vec<_>>())
}

impl SupportMap for Hull {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let number = outermost(&self.unit.lanes, direction);
        // The last chunk is filled up with the last point.
        self.unit_points()[number.min(self.unit_points().len() - 1)] * self.scale
    }
}

impl PointQuery for Hull {
    fn project_local_point(&self, point: Vector, solid: bool) -> PointProjection {
        self.solid().project_local_point(point, solid)
    }

    fn project_local_point_and_get_feature(&self, point: Vector) -> (PointProjection, FeatureId) {
        self.solid().project_local_point_and_get_feature(point)
    }
}

impl RayCast for Hull {
    fn cast_local_ray_and_get_normal(&self, ray: &Ray, far: f32, solid: bool) -> Option<RayIntersection> {
        self.solid().cast_local_ray_and_get_normal(ray, far, solid)
    }
}

impl Shape for Hull {
    fn compute_local_aabb(&self) -> Aabb {
        {
            let Aabb { mins, maxs } = self.unit.solid.compute_local_aabb();
            Aabb::new(mins * self.scale, maxs * self.scale)
        }
    }

    fn compute_local_bounding_sphere(&self) -> BoundingSphere {
        {
            let unit = self.unit.solid.compute_local_bounding_sphere();
            BoundingSphere::new(unit.center * self.scale, unit.radius * self.scale)
        }
    }

    fn compute_aabb(&self, position: &Pose) -> Aabb {
        aabb(&self.unit.lanes, self.scale, position)
    }

    fn clone_dyn(&self) -> Box<dyn Shape> {
        Box::new(self.clone())
    }

    fn scale_dyn(&self, scale: Vector, _: u32) -> Option<Box<dyn Shape>> {
        let scaled: Vec<Vector> = self.points().iter().map(|&p| p * scale).collect();
        Some(Box::new(Hull::new(&scaled)?))
    }

    fn mass_properties(&self, density: f32) -> MassProperties {
        if density != 1.0 {
            return self.solid().mass_properties(density);
        }
        *self.solid.mass.get_or_init(|| self.solid().mass_properties(density))
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
        TypedShape::ConvexPolyhedron(self.solid())
    }

    fn ccd_thickness(&self) -> f32 {
        self.unit.solid.ccd_thickness() * self.scale
    }

    fn ccd_angular_thickness(&self) -> f32 {
        self.unit.solid.ccd_angular_thickness()
    }

    fn as_support_map(&self) -> Option<&dyn SupportMap> {
        Some(self)
    }

    fn as_polygonal_feature_map(&self) -> Option<(&dyn PolygonalFeatureMap, f32)> {
        self.solid().as_polygonal_feature_map()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::SINGLE_ROUNDING;
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
                assert_eq!(hull.local_support_point(direction), hull.solid().local_support_point(direction));
                let place = Pose::from_parts(direction * 7.0, Quat::from_scaled_axis(direction * 3.0));
                let (own, theirs) = (hull.compute_aabb(&place), hull.solid().compute_aabb(&place));
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
