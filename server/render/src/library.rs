//! The meshes, materials and pictures of a file, made ready for rays.

use super::RenderFault;
use super::nodes::PlacedMesh;
use super::texture::{Material, Picture};
use cairn_geometry::rays::{RaySoup, Triangle};
use cairn_gltf::document::{Triangles, reference};
use cairn_gltf::{Document, Resolver};
use glam::{DAffine3, DQuat, DVec2, DVec3, Vec2, Vec3, Vec3A};
use std::collections::BTreeMap;

/// Triangles of all meshes together, each counted once however often it is seen.
const MOST_TRIANGLES: usize = 30_000_000;

/// All triangles of one mesh, moved and scaled into the cube from -1 to 1: single precision is then good enough for
/// any unit and place.
pub struct Mesh {
    pub soup: RaySoup,
    /// Of each triangle, in its order there.
    pub surfaces: Vec<FaceAttributes>,
    /// Bounds of the moved points.
    pub bounds: [DVec3; 2],
    /// The outermost of the moved points in many directions.
    pub outline: Vec<DVec3>,
    /// From the cube to the mesh's own frame.
    pub from_cube: DAffine3,
}

/// The attributes of a triangle's corners, and its material.
#[derive(Clone, Copy)]
pub struct FaceAttributes {
    /// Normals of the corners; zero where the file gives none.
    pub normals: [Vec3; 3],
    pub coordinates: [Vec2; 3],
    /// Index into the materials.
    pub material: usize,
}

/// Meshes, materials and pictures of one file.
#[derive(Default)]
pub struct Library {
    pub meshes: BTreeMap<usize, Mesh>,
    pub materials: Vec<Material>,
    pub pictures: BTreeMap<usize, Picture>,
}

impl Library {
    /// Everything that `placed` refers to.
    pub fn read(document: &Document, placed: &[PlacedMesh], resolve: &Resolver) -> Result<Library, RenderFault> {
        let mut library = Library::default();
        for index in 0..document.array("materials").len() {
            let material = Material::read(document, index).unwrap_or_else(|| Material::fallback(index));
            library.materials.push(material);
        }
        let mut budget = MOST_TRIANGLES;
        for mesh in placed.iter().map(|p| p.mesh) {
            if !library.meshes.contains_key(&mesh) {
                let read = library.mesh(document, mesh, &mut budget)?;
                library.meshes.insert(mesh, read);
            }
        }
        for texture in library.materials.iter_mut().filter_map(|m| m.texture.as_ref()) {
            if !library.pictures.contains_key(&texture.picture)
                && let Some(picture) = Picture::read(document, texture.picture, resolve)
            {
                library.pictures.insert(texture.picture, picture);
            }
        }
        Ok(library)
    }

    fn mesh(&mut self, document: &Document, index: usize, budget: &mut usize) -> Result<Mesh, RenderFault> {
        let (mut triangles, mut surfaces) = (Vec::new(), Vec::new());
        for primitive in document.primitives(index)? {
            let material = match reference(primitive, "material") {
                Some(material) if material < self.materials.len() => material,
                _ => {
                    self.materials.push(Material::fallback(index));
                    self.materials.len() - 1
                }
            };
            let set = self.materials[material].texture.as_ref().map(|t| t.set);
            let primitive = Triangles::read(document, index, primitive)?;
            let coordinates = set.map(|set| primitive.vectors::<2>(&format!("TEXCOORD_{set}"))).transpose()?.flatten();
            let normals = primitive.vectors::<3>("NORMAL")?;
            let normal = |i: usize| normals.as_ref().map_or(Vec3::ZERO, |n| DVec3::from(n[i]).as_vec3());
            let coordinate = |i: usize| coordinates.as_ref().map_or(Vec2::ZERO, |c| DVec2::from(c[i]).as_vec2());
            *budget = budget.checked_sub(primitive.corners.len()).ok_or(RenderFault::TooLarge)?;
            for &corners in &primitive.corners {
                triangles.push(corners.map(|i| primitive.points[i]));
                surfaces.push(FaceAttributes {
                    normals: corners.map(normal),
                    coordinates: corners.map(coordinate),
                    material,
                });
            }
        }
        Ok(Mesh::new(triangles, surfaces))
    }
}

impl Mesh {
    fn new(triangles: Vec<[DVec3; 3]>, surfaces: Vec<FaceAttributes>) -> Mesh {
        let low = triangles.iter().flatten().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = triangles.iter().flatten().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        let (centre, half) =
            if low.is_finite() { ((low + high) / 2.0, (high - low) / 2.0) } else { Default::default() };
        let size = half.max_element().max(f64::MIN_POSITIVE);
        let moved = |p: DVec3| ((p - centre) / size).as_vec3a();
        let triangles: Vec<Triangle> = triangles.into_iter().map(|corners| Triangle(corners.map(moved))).collect();
        let soup = RaySoup::new(&triangles);
        Mesh {
            outline: outline(&triangles),
            surfaces: soup.order().iter().map(|&i| surfaces[i as usize]).collect(),
            soup,
            bounds: [-half / size, half / size],
            from_cube: DAffine3::from_scale_rotation_translation(DVec3::splat(size), DQuat::IDENTITY, centre),
        }
    }
}

/// For each of many evenly spread directions, the point that is furthest out.
fn outline(triangles: &[Triangle]) -> Vec<DVec3> {
    const DIRECTIONS: u32 = 64;
    let golden = std::f32::consts::PI * (3.0 - 5.0f32.sqrt());
    let furthest = |i: u32| {
        let up = 1.0 - (2 * i + 1) as f32 / DIRECTIONS as f32;
        let (sin, cos) = libm::sincosf(golden * i as f32);
        let out = (1.0 - up * up).sqrt();
        let direction = Vec3A::new(out * cos, up, out * sin);
        let points = triangles.iter().flat_map(|triangle| triangle.0);
        points.max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction))).map(|p| p.as_dvec3())
    };
    let mut points: Vec<DVec3> = (0..DIRECTIONS).filter_map(furthest).collect();
    points.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).unwrap_or(std::cmp::Ordering::Equal));
    points.dedup();
    points
}
