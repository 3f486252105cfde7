//! Triangles by material: read, placed, simplified, and put in an order that graphics cards like.

use super::PackError;
use cairn_geometry::mesh::TriMesh;
use cairn_gltf::Document;
use cairn_gltf::document::{DocumentError, Triangles, reference};
use cairn_render::nodes::PlacedMesh;
use glam::{DAffine3, DMat3, DVec3};
use meshoptimizer_rs::{
    Attributes, Positions, SimplifyOptions, SimplifySettings, VertexFlags, Workspace, optimize_vertex_cache,
    simplify_with_attributes,
};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Attributes that a pack keeps.
const KEPT: [&str; 4] = ["POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0"];
/// Numbers of a vertex besides its position that count in a simplification, and what an error of 1 in each weighs,
/// in sizes of the mesh: a normal of three, texture coordinates of two.
const WEIGHTS: [f32; 5] = [0.01, 0.01, 0.01, 0.1, 0.1];

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    pub position: [f32; 3],
    pub normal: [f32; 3],
    pub coordinates: [f32; 2],
    pub color: [f32; 4],
    /// The body that it belongs to.
    pub body: u32,
}

#[derive(Clone, Debug, Default)]
pub struct Surface {
    pub vertices: Vec<Vertex>,
    pub triangles: Vec<[u32; 3]>,
    pub has_coordinates: bool,
    pub has_colors: bool,
}

/// The surface of each material; `None`: without one.
#[derive(Clone, Debug, Default)]
pub struct Surfaces(pub BTreeMap<Option<usize>, Surface>);

impl Surfaces {
    /// The meshes of a body, in its own frame. Attributes that are not kept are added to `dropped`.
    pub fn read(
        document: &Document,
        placed: &[PlacedMesh],
        dropped: &mut BTreeSet<String>,
    ) -> Result<Surfaces, PackError> {
        let mut all = Surfaces::default();
        for PlacedMesh { mesh, world, .. } in placed {
            for primitive in document.primitives(*mesh)? {
                let names = primitive.get("attributes").and_then(Value::as_object).into_iter().flatten();
                dropped.extend(names.map(|(name, _)| name).filter(|name| !KEPT.contains(&name.as_str())).cloned());
                if primitive.contains_key("targets") {
                    dropped.insert("morph targets".into());
                }
                let read = Triangles::read(document, *mesh, primitive)?;
                let material = reference(primitive, "material").filter(|at| *at < document.array("materials").len());
                let part = Surface::read(&read)?;
                all.0.entry(material).or_default().append(&part, world, 0);
            }
        }
        all.0.retain(|_, surface| !surface.triangles.is_empty());
        all.0.values_mut().for_each(Surface::share_vertices);
        Ok(all)
    }

    /// A mesh without material that shows its facets.
    pub fn of(mesh: &TriMesh) -> Surfaces {
        let mut surface = Surface::default();
        for number in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(number);
            let normal = (b - a).cross(c - a).normalize_or(DVec3::Y).as_vec3().to_array();
            let first = surface.vertices.len() as u32;
            let vertex = |point: DVec3| Vertex {
                position: point.as_vec3().to_array(),
                normal,
                coordinates: [0.0; 2],
                color: [1.0; 4],
                body: 0,
            };
            surface.vertices.extend([a, b, c].map(vertex));
            surface.triangles.push([first, first + 1, first + 2]);
        }
        Surfaces(BTreeMap::from([(None, surface)]))
    }

    pub fn triangles(&self) -> usize {
        self.0.values().map(|surface| surface.triangles.len()).sum()
    }

    pub fn vertices(&self) -> usize {
        self.0.values().map(|surface| surface.vertices.len()).sum()
    }

    /// Adds the surfaces of a body where it is.
    pub fn append(&mut self, body: &Surfaces, place: &DAffine3, number: u32) {
        for (material, surface) in &body.0 {
            self.0.entry(*material).or_default().append(surface, place, number);
        }
    }

    /// Fewer triangles, by an error of at most `error` in the surfaces' unit. The library bounds the mean error.
    pub fn simplified(&self, error: f64) -> Surfaces {
        Surfaces(self.0.iter().map(|(material, surface)| (*material, surface.simplified(error))).collect())
    }

    /// All corners and triangles, without attributes.
    pub fn bare(&self) -> (Vec<[f32; 3]>, Vec<u32>) {
        let (mut points, mut corners) = (Vec::new(), Vec::new());
        for surface in self.0.values() {
            let first = points.len() as u32;
            points.extend(surface.vertices.iter().map(|vertex| vertex.position));
            corners.extend(surface.triangles.as_flattened().iter().map(|corner| corner + first));
        }
        (points, corners)
    }

    /// Keeps some triangles, in the order of [`Surfaces::bare`].
    pub fn retain(&mut self, keep: &[bool]) {
        let mut at = keep.iter();
        for surface in self.0.values_mut() {
            surface.triangles.retain(|_| *at.next().unwrap_or(&true));
        }
        self.0.retain(|_, surface| !surface.triangles.is_empty());
        self.0.values_mut().for_each(Surface::tidy);
    }
}

impl Surface {
    fn read(read: &Triangles) -> Result<Surface, DocumentError> {
        let normals = read.vectors::<3>("NORMAL")?;
        let coordinates = read.vectors::<2>("TEXCOORD_0")?;
        let rgb = |colors: Vec<[f64; 3]>| colors.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect();
        // An accessor of fewer components is refused as one of four.
        let colors = match read.vectors::<4>("COLOR_0") {
            Ok(colors) => colors,
            Err(_) => read.vectors::<3>("COLOR_0")?.map(rgb),
        };
        let mut surface =
            Surface { has_coordinates: coordinates.is_some(), has_colors: colors.is_some(), ..Surface::default() };
        let single = |value: f64| value as f32;
        let vertex = |i: usize, normal: [f64; 3]| Vertex {
            position: read.points[i].as_vec3().to_array(),
            normal: normal.map(single),
            coordinates: coordinates.as_ref().map_or([0.0; 2], |all| all[i].map(single)),
            color: colors.as_ref().map_or([1.0; 4], |all| all[i].map(single)),
            body: 0,
        };
        if let Some(normals) = &normals {
            surface.vertices = (0..read.points.len()).map(|i| vertex(i, normals[i])).collect();
            let corners = |corners: &[usize; 3]| corners.map(|i| i as u32);
            surface.triangles = read.corners.iter().map(corners).collect();
            return Ok(surface);
        }
        // Without normals, glTF shows the facets.
        for corners in &read.corners {
            let [a, b, c] = corners.map(|i| read.points[i]);
            let normal = (b - a).cross(c - a).normalize_or(DVec3::Y).to_array();
            let first = surface.vertices.len() as u32;
            surface.vertices.extend(corners.map(|i| vertex(i, normal)));
            surface.triangles.push([first, first + 1, first + 2]);
        }
        Ok(surface)
    }

    fn append(&mut self, other: &Surface, place: &DAffine3, body: u32) {
        let turn: DMat3 = place.matrix3.inverse().transpose();
        let is_mirrored = place.matrix3.determinant() < 0.0;
        let first = self.vertices.len() as u32;
        self.has_coordinates |= other.has_coordinates;
        self.has_colors |= other.has_colors;
        self.vertices.extend(other.vertices.iter().map(|vertex| {
            let normal = turn * DVec3::from(vertex.normal.map(f64::from));
            Vertex {
                position: place.transform_point3(DVec3::from(vertex.position.map(f64::from))).as_vec3().to_array(),
                normal: normal.normalize_or(DVec3::Y).as_vec3().to_array(),
                body,
                ..*vertex
            }
        }));
        let corners = |&[a, b, c]: &[u32; 3]| if is_mirrored { [a, c, b] } else { [a, b, c] }.map(|i| i + first);
        self.triangles.extend(other.triangles.iter().map(corners));
    }

    /// One vertex for all that are equal.
    fn share_vertices(&mut self) {
        let mut known: BTreeMap<[u32; 12], u32> = BTreeMap::new();
        let mut vertices = Vec::new();
        let mut place = |vertex: &Vertex| {
            let Vertex { position: [x, y, z], normal: [nx, ny, nz], coordinates: [u, v], color: [r, g, b, a], .. } =
                *vertex;
            // -0 and 0 are the same.
            let key = [x, y, z, nx, ny, nz, u, v, r, g, b, a].map(|value| (value + 0.0).to_bits());
            *known.entry(key).or_insert_with(|| {
                vertices.push(*vertex);
                (vertices.len() - 1) as u32
            })
        };
        let to: Vec<u32> = self.vertices.iter().map(&mut place).collect();
        self.triangles.iter_mut().for_each(|corners| *corners = corners.map(|corner| to[corner as usize]));
        self.vertices = vertices;
        self.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    }

    fn simplified(&self, error: f64) -> Surface {
        let positions: Vec<[f32; 3]> = self.vertices.iter().map(|vertex| vertex.position).collect();
        let attributes: Vec<f32> =
            (self.vertices.iter()).flat_map(|vertex| vertex.normal.into_iter().chain(vertex.coordinates)).collect();
        let corners = self.triangles.as_flattened();
        // Beyond the library's bounds of work and memory, the mesh stays as it is: that only costs triangles.
        let simplify = || {
            let view = Attributes::from_interleaved(&attributes, positions.len(), WEIGHTS.len(), WEIGHTS.len(), 0)?;
            let settings = SimplifySettings {
                target_index_count: 0,
                target_error: error as f32,
                options: SimplifyOptions::ERROR_ABSOLUTE | SimplifyOptions::PERMISSIVE,
            };
            let flags = self.protected();
            let workspace = &mut Workspace::default();
            let points = Positions::from_packed(&positions);
            simplify_with_attributes(corners, points, view, &WEIGHTS, Some(&flags), settings, workspace)
        };
        let Ok(found) = simplify() else { return self.clone() };
        if found.indices.is_empty() {
            return self.clone();
        }
        let mut fewer = Surface { triangles: found.indices.as_chunks().0.to_vec(), ..self.clone() };
        fewer.tidy();
        fewer
    }

    /// Flags of vertices: those on a seam of the texture stay there. Edges of shading are no seams.
    fn protected(&self) -> Vec<VertexFlags> {
        let mut coordinates: BTreeMap<[u32; 3], ([f32; 2], bool)> = BTreeMap::new();
        let place = |vertex: &Vertex| vertex.position.map(|value| (value + 0.0).to_bits());
        for vertex in &self.vertices {
            let (first, differs) = coordinates.entry(place(vertex)).or_insert((vertex.coordinates, false));
            *differs |= *first != vertex.coordinates;
        }
        let flag =
            |vertex: &Vertex| if coordinates[&place(vertex)].1 { VertexFlags::PROTECT } else { VertexFlags::EMPTY };
        self.vertices.iter().map(flag).collect()
    }

    /// Puts triangles in the order of the vertex cache and vertices in that of their first use; drops unused ones.
    pub fn tidy(&mut self) {
        let ordered =
            optimize_vertex_cache(self.triangles.as_flattened(), self.vertices.len(), &mut Workspace::default());
        if let Ok(ordered) = ordered {
            self.triangles = ordered.as_chunks().0.to_vec();
        }
        let mut to = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::new();
        for corner in self.triangles.as_flattened_mut() {
            let new = &mut to[*corner as usize];
            if *new == u32::MAX {
                *new = vertices.len() as u32;
                vertices.push(self.vertices[*corner as usize]);
            }
            *corner = *new;
        }
        self.vertices = vertices;
    }
}
