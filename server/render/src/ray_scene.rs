//! All surfaces that rays can meet: instances of meshes in a tree of their own.
//!
//! Unit space is the world moved and scaled so that the camera's subject lies around the origin within radius 1:
//! one set of tolerances fits piles of any size.

use super::library::{FaceAttributes, Library, Mesh};
use super::nodes::PlacedMesh;
use cairn_geometry::Boxed;
use cairn_geometry::rays::{Ray, RayTree};
use glam::{Affine3A, DAffine3, DVec3, Mat3A, Vec3, Vec3A};

/// Single precision's error of a point in unit space, generously.
const ROUNDING: f32 = 1e-5;

/// Instances, and the tree above them.
pub struct RayScene<'a> {
    /// In the order of the tree's leaves.
    instances: Vec<MeshInstance<'a>>,
    tree: RayTree,
}

struct MeshInstance<'a> {
    mesh: &'a Mesh,
    to_cube: Affine3A,
    /// Takes normals of the mesh to unit space.
    normals: Mat3A,
    /// Number of the body, in the order of the file.
    number: usize,
}

/// The point where a ray hits a surface.
pub struct SurfaceHit<'a> {
    pub distance: f32,
    pub surface: &'a FaceAttributes,
    /// Unit, facing the ray.
    pub facet: Vec3,
    /// Unit, between the corners' normals where there are some; on the facet's side.
    pub normal: Vec3,
    /// Shares of the three corners.
    pub shares: Vec3,
    pub number: usize,
}

impl<'a> RayScene<'a> {
    /// The meshes of `library` at `placed`; `to_unit` takes the world to unit space. Meshes without volume have no
    /// inverse transform and are left out.
    pub fn new(library: &'a Library, placed: &[PlacedMesh], to_unit: DAffine3) -> RayScene<'a> {
        let mut instances = Vec::new();
        let mut boxes = Vec::new();
        for (number, placed) in placed.iter().enumerate() {
            let mesh = &library.meshes[&placed.mesh];
            let to_mesh = to_unit * placed.world;
            let map = to_mesh * mesh.from_cube;
            let volume = map.matrix3.determinant();
            if mesh.soup.triangles.is_empty() || !map.is_finite() || !volume.is_normal() {
                continue;
            }
            boxes.push(InstanceBox { name: instances.len() as u32, bounds: bounds(mesh, &map) });
            let inverse = map.inverse();
            instances.push(MeshInstance {
                mesh,
                to_cube: Affine3A::from_mat3_translation(inverse.matrix3.as_mat3(), inverse.translation.as_vec3()),
                normals: to_mesh.matrix3.inverse().transpose().as_mat3().into(),
                number,
            });
        }
        let tree = RayTree::new(&mut boxes);
        let mut slots: Vec<Option<MeshInstance>> = instances.into_iter().map(Some).collect();
        let instances = tree.order().iter().filter_map(|&i| slots[i as usize].take()).collect();
        RayScene { instances, tree }
    }

    pub fn is_empty(&self) -> bool {
        self.instances.is_empty()
    }

    /// The first surface on a ray, nearer than `reach`.
    pub fn first(&self, origin: Vec3, direction: Vec3, reach: f32) -> Option<SurfaceHit<'a>> {
        let mut best: Option<(usize, usize, Ray, f32)> = None;
        let ray = Ray::new(origin.into(), direction.into());
        self.tree.along(&ray, reach, |i, reach| {
            let (local, stretch) = self.instances[i].localise(&ray);
            let Some((triangle, distance)) = self.instances[i].mesh.soup.first(&local, reach * stretch) else {
                return reach;
            };
            let distance = distance / stretch;
            best = Some((i, triangle, local, distance));
            distance
        });
        let (i, triangle, local, distance) = best?;
        Some(self.instances[i].describe(triangle, &local, distance, direction))
    }

    /// Whether a ray meets nothing.
    pub fn is_clear(&self, origin: Vec3, direction: Vec3) -> bool {
        let mut clear = true;
        let ray = Ray::new(origin.into(), direction.into());
        self.tree.along(&ray, f32::INFINITY, |i, reach| {
            clear = self.instances[i].mesh.soup.is_clear(&self.instances[i].localise(&ray).0);
            if clear { reach } else { -1.0 }
        });
        clear
    }

    /// Calls `visit` for every surface on a ray, in no particular order.
    pub fn all(&self, origin: Vec3, direction: Vec3, reach: f32, mut visit: impl FnMut(SurfaceHit<'a>)) {
        let ray = Ray::new(origin.into(), direction.into());
        self.tree.along(&ray, reach, |i, reach| {
            let instance = &self.instances[i];
            let (local, stretch) = instance.localise(&ray);
            instance.mesh.soup.all(&local, reach * stretch, |triangle, distance| {
                visit(instance.describe(triangle, &local, distance / stretch, direction));
            });
            reach
        });
    }
}

struct InstanceBox {
    name: u32,
    bounds: (DVec3, DVec3),
}

impl Boxed for InstanceBox {
    fn name(&self) -> u32 {
        self.name
    }

    fn bounds(&self) -> (DVec3, DVec3) {
        self.bounds
    }
}

impl<'a> MeshInstance<'a> {
    /// A ray in the mesh's cube, with a unit direction; distances there are `stretch` times as long.
    #[inline]
    fn localise(&self, ray: &Ray) -> (Ray, f32) {
        let direction = self.to_cube.transform_vector3a(ray.direction);
        let stretch = direction.length();
        (Ray::new(self.to_cube.transform_point3a(ray.origin), direction / stretch), stretch)
    }

    fn describe(&self, triangle: usize, local: &Ray, distance: f32, direction: Vec3) -> SurfaceHit<'a> {
        let (triangle, surface) = (&self.mesh.soup.triangles[triangle], &self.mesh.surfaces[triangle]);
        let shares = triangle.shares(local);
        let world = |normal: Vec3A| Vec3::from(self.normals * normal).normalize_or_zero();
        let towards = |normal: Vec3, side: Vec3| if normal.dot(side) < 0.0 { -normal } else { normal };
        let [a, b, c] = triangle.0;
        let facet = towards(world((b - a).cross(c - a)), -direction);
        let [a, b, c] = surface.normals;
        let between = towards(world((a * shares.x + b * shares.y + c * shares.z).into()), facet);
        let normal = if between == Vec3::ZERO { facet } else { between };
        SurfaceHit { distance, surface, facet, normal, shares, number: self.number }
    }
}

/// The box around a mesh in unit space: around all its points, unless these are too many to visit for every body.
fn bounds(mesh: &Mesh, map: &DAffine3) -> (DVec3, DVec3) {
    const MANY: usize = 50_000;
    let around = |points: &mut dyn Iterator<Item = DVec3>| {
        points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    };
    let (low, high) = if mesh.soup.triangles.len() > MANY {
        around(&mut corners(mesh.bounds).into_iter().map(|p| map.transform_point3(p)))
    } else {
        around(&mut mesh.soup.triangles.iter().flat_map(|t| t.0).map(|p| map.transform_point3(p.as_dvec3())))
    };
    // Rounding must not cut anything off: triangles are met in single precision.
    (low - f64::from(ROUNDING), high + f64::from(ROUNDING))
}

/// The corners of a box.
fn corners([low, high]: [DVec3; 2]) -> [DVec3; 8] {
    std::array::from_fn(|i| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { high[axis] } else { low[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_gltf::Document;
    use glam::{DQuat, EulerRot};

    /// Distance along a unit direction to a triangle.
    fn distance([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
        let (e1, e2) = (b - a, c - a);
        let p = direction.cross(e2);
        let det = e1.dot(p);
        let offset = origin - a;
        let q = offset.cross(e1);
        let (u, v, t) = (offset.dot(p) / det, direction.dot(q) / det, e2.dot(q) / det);
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
    }

    #[test]
    fn rays_meet_what_is_first_of_all_triangles() {
        let bytes = include_bytes!("../../../examples/assets/banana.glb");
        let resolve = |uri: &str| Err(uri.to_string());
        let document = Document::parse(bytes, &resolve).unwrap();
        let wave = |i: usize, k: f64| (i as f64 * k).sin();
        let placed: Vec<PlacedMesh> = (0..40)
            .map(|i| {
                let turn = DQuat::from_euler(EulerRot::XYZ, wave(i, 1.1) * 3.0, wave(i, 2.3), wave(i, 0.7) * 3.0);
                let scale = DVec3::new(2.0 + wave(i, 1.0), 2.0, if i % 3 == 0 { -2.0 } else { 1.0 });
                let place = DVec3::new(wave(i, 1.7), wave(i, 2.9), wave(i, 0.4)) * 0.5;
                let world = DAffine3::from_scale_rotation_translation(scale, turn, place);
                PlacedMesh { mesh: 0, world, in_pile: true, body: None }
            })
            .collect();
        let library = Library::read(&document, &placed, &resolve).unwrap();
        let mesh = &library.meshes[&0];
        let world: Vec<[DVec3; 3]> = placed
            .iter()
            .flat_map(|p| {
                let map = p.world * mesh.from_cube;
                mesh.soup.triangles.iter().map(move |t| t.0.map(|v| map.transform_point3(v.as_dvec3())))
            })
            .collect();
        let scene = RayScene::new(&library, &placed, DAffine3::IDENTITY);
        let mut met = 0;
        for i in 0..600 {
            let origin = DVec3::new(wave(i, 1.3), wave(i, 3.1), wave(i, 0.9)) * 2.0;
            let towards = DVec3::new(wave(i, 5.3), wave(i, 4.1), wave(i, 2.2)) * 0.4;
            let direction = (towards - origin).normalize();
            let (from, to) = (origin.as_vec3(), direction.as_vec3());
            let expected = world.iter().filter_map(|t| distance(*t, origin, direction)).reduce(f64::min);
            let found = scene.first(from, to, f32::INFINITY).map(|hit| f64::from(hit.distance));
            match (expected, found) {
                (Some(expected), Some(found)) => assert!((expected - found).abs() < 1e-4, "{expected} {found}"),
                (expected, found) => assert_eq!(expected.is_some(), found.is_some()),
            }
            assert_eq!(scene.is_clear(from, to), expected.is_none());
            if let Some(distance) = expected {
                met += 1;
                let mut nearest = f32::INFINITY;
                scene.all(from, to, f32::INFINITY, |hit| nearest = nearest.min(hit.distance));
                assert!((f64::from(nearest) - distance).abs() < 1e-4);
                // A reach that ends before the surface, by more or less than rounding.
                for share in [0.5, 0.999_999] {
                    assert!(
                        scene.first(from, to, (distance * share) as f32).is_none_or(|h| h.distance <= distance as f32)
                    );
                }
            }
        }
        assert!(met > 200, "only {met} rays met anything");
    }
}
