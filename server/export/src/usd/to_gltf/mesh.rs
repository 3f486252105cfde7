//! Meshes of a stage: their faces as triangles, but for those that are holes, with normals and the first texture
//! coordinates.

use super::Converter;
use super::values::{rows, vectors};
use cairn_geometry::polygon;
use cairn_gltf::document::Object;
use glam::DVec3;
use openusd::sdf::{Path, Value};
use serde_json::json;
use std::collections::{HashMap, HashSet};

/// Names under which programs write the first texture coordinates.
const COORDINATES: [&str; 3] = ["primvars:st", "primvars:UVMap", "primvars:map1"];

/// The faces of a mesh as triangles.
#[derive(Default)]
struct Faces {
    /// Corners of triangles, as places in the list of the mesh's corners.
    corners: Vec<usize>,
    /// The face of each of them.
    faces: Vec<usize>,
}

/// Values of the corners of triangles.
struct CornerValues {
    name: &'static str,
    width: usize,
    values: Vec<f32>,
}

impl Converter<'_> {
    /// A mesh, read once for each material that it is shown with.
    pub(super) fn mesh(&mut self, prim: &Path, material: Option<&Path>) -> Result<Option<usize>, String> {
        let key = format!("{} {}", prim.as_str(), material.map_or("", Path::as_str));
        if let Some(known) = self.meshes.get(&key) {
            return Ok(*known);
        }
        let mesh = self.new_mesh(prim, material)?;
        self.meshes.insert(key, mesh);
        Ok(mesh)
    }

    fn new_mesh(&mut self, prim: &Path, material: Option<&Path>) -> Result<Option<usize>, String> {
        let wrong = |what: &str| format!("{}: {what}", prim.as_str());
        let Some(points) = self.value(prim, "points").and_then(vectors) else { return Ok(None) };
        let (Some(Value::IntVec(counts)), Some(Value::IntVec(corners))) =
            (self.value(prim, "faceVertexCounts"), self.value(prim, "faceVertexIndices"))
        else {
            return Err(wrong("it has no faces"));
        };
        let [points_bytes, corner_bytes] = [size_of::<[f32; 3]>() * points.len(), size_of::<i32>() * corners.len()];
        self.take_mesh_bytes(points_bytes + corner_bytes + size_of::<i32>() * counts.len())?;
        if self.token(prim, "subdivisionScheme").is_none_or(|scheme| scheme != "none") {
            self.note("its subdivision is not applied: the pile is made of the cages", prim);
        }
        if !self.stage.targets(prim, "skel:skeleton").is_empty() {
            self.note("its skeleton is left out: meshes have their rest pose", prim);
        }
        let mirrored = self.token(prim, "orientation").is_some_and(|orientation| orientation == "leftHanded");
        let holes: HashSet<usize> = match self.value(prim, "holeIndices") {
            Some(Value::IntVec(faces)) => faces.into_iter().filter_map(|face| usize::try_from(face).ok()).collect(),
            _ => HashSet::new(),
        };
        let point = |corner: i32| usize::try_from(corner).ok().and_then(|index| points.get(index));
        let (mut all, mut begin) = (Faces::default(), 0);
        let mut positions = Vec::with_capacity(3 * corners.len());
        for (face, count) in counts.iter().enumerate() {
            let count = usize::try_from(*count).map_err(|_| wrong("a face has less than no corners"))?;
            let end = begin + count;
            if end > corners.len() {
                return Err(wrong("its faces have more corners than faceVertexIndices"));
            }
            let own: Option<Vec<[f32; 3]>> = corners[begin..end].iter().map(|&corner| point(corner).copied()).collect();
            let own = own.ok_or_else(|| wrong("a corner is none of its points"))?;
            let places: Vec<DVec3> = own.iter().map(|p| DVec3::from(p.map(f64::from))).collect();
            let triangles = if holes.contains(&face) { Vec::new() } else { polygon::triangles(&places) };
            for [first, second, third] in triangles.into_iter().map(|t| t.map(|corner| corner as usize)) {
                let [second, third] = if mirrored { [third, second] } else { [second, third] };
                for corner in [first, second, third] {
                    all.corners.push(begin + corner);
                    positions.extend(own[corner]);
                }
                all.faces.extend([face; 3]);
            }
            begin = end;
        }
        if positions.is_empty() {
            return Ok(None);
        }
        let mut values = vec![CornerValues { name: "POSITION", width: 3, values: positions }];
        values.extend(self.decoration(prim, ["primvars:normals", "normals"], ("NORMAL", 3), &all, &corners));
        values.extend(self.decoration(prim, COORDINATES, ("TEXCOORD_0", 2), &all, &corners));
        let primitives: Vec<_> = (self.by_material(prim, material, counts.len()).into_iter())
            .filter_map(|(material, faces)| self.primitive(&values, &all, faces.as_deref(), material.as_ref()))
            .collect();
        Ok(Some(self.out.push("meshes", json!({ "primitives": primitives }))))
    }

    /// The materials of a mesh, each with the faces that have it; `None`: all.
    fn by_material(
        &self,
        prim: &Path,
        material: Option<&Path>,
        count: usize,
    ) -> Vec<(Option<Path>, Option<Vec<bool>>)> {
        let mut left = vec![true; count];
        let mut subsets = Vec::new();
        for child in self.stage.children(prim) {
            let Some(bound) = self.binding(&child).filter(|_| self.kind(&child) == "GeomSubset") else { continue };
            let Some(Value::IntVec(indices)) = self.value(&child, "indices") else { continue };
            let mut own = vec![false; count];
            for index in indices.into_iter().filter_map(|index| usize::try_from(index).ok()) {
                if let Some(is_left) = left.get_mut(index) {
                    own[index] = std::mem::take(is_left);
                }
            }
            subsets.push((Some(bound), Some(own)));
        }
        if subsets.is_empty() {
            return vec![(material.cloned(), None)];
        }
        subsets.push((material.cloned(), Some(left)));
        subsets
    }

    /// What decorates a mesh; what cannot be read is left out.
    fn decoration<const N: usize>(
        &self,
        prim: &Path,
        names: [&str; N],
        (target, width): (&'static str, usize),
        all: &Faces,
        corners: &[i32],
    ) -> Option<CornerValues> {
        let (name, values) = names.into_iter().find_map(|name| Some((name, self.value(prim, name).and_then(rows)?)))?;
        let values = match self.value(prim, &format!("{name}:indices")) {
            Some(Value::IntVec(indices)) => {
                let value = |index: i32| usize::try_from(index).ok().and_then(|index| values.get(index)).cloned();
                indices.into_iter().map(value).collect::<Option<Vec<_>>>()?
            }
            _ => values,
        };
        let path = prim.append_property(name).ok()?;
        let of = super::stage::token(self.field(&path, "interpolation"));
        let at = |n: usize| match of.as_deref() {
            Some("uniform") => Some(all.faces[n]),
            Some("faceVarying") => Some(all.corners[n]),
            Some("constant") => Some(0),
            _ => usize::try_from(corners[all.corners[n]]).ok(),
        };
        let each = (0..all.corners.len()).map(|n| values.get(at(n)?));
        let mut values: Vec<f32> = each.collect::<Option<Vec<_>>>()?.into_iter().flatten().copied().collect();
        if target == "TEXCOORD_0" {
            values.chunks_exact_mut(2).for_each(|at| at[1] = 1.0 - at[1]);
        }
        (values.len() == width * all.corners.len()).then_some(CornerValues { name: target, width, values })
    }

    /// The triangles of some faces, in which equal corners are one vertex.
    fn primitive(
        &mut self,
        values: &[CornerValues],
        all: &Faces,
        faces: Option<&[bool]>,
        material: Option<&Path>,
    ) -> Option<serde_json::Value> {
        let (mut known, mut indices, mut vertices) = (HashMap::new(), Vec::new(), Vec::new());
        for (n, face) in all.faces.iter().enumerate() {
            if faces.is_some_and(|faces| !faces[*face]) {
                continue;
            }
            let at = |one: &CornerValues| one.values[one.width * n..one.width * (n + 1)].to_vec();
            let key: Vec<u32> = values.iter().flat_map(at).map(f32::to_bits).collect();
            let next = vertices.len() as u32;
            let index = *known.entry(key).or_insert(next);
            if index == next {
                vertices.push(n);
            }
            indices.push(index);
        }
        if indices.is_empty() {
            return None;
        }
        let mut attributes = Object::new();
        for one in values {
            let flat: Vec<f32> =
                vertices.iter().flat_map(|n| &one.values[one.width * n..one.width * (n + 1)]).copied().collect();
            let bounds = (one.name == "POSITION").then(|| bounds(&flat));
            let bounds = bounds.as_ref().map(|[low, high]| [&low[..], &high[..]]);
            attributes.insert(one.name.into(), json!(self.numbers(&flat, one.width, bounds)));
        }
        let bytes: Vec<u8> = indices.iter().flat_map(|index| index.to_le_bytes()).collect();
        let view = self.out.push_view(&bytes, Object::new());
        let accessor = json!({ "bufferView": view, "componentType": 5125, "type": "SCALAR", "count": indices.len() });
        let indices = self.out.push("accessors", accessor);
        let mut primitive = json!({ "attributes": attributes, "indices": indices });
        if let Some(material) = material.and_then(|material| self.material(material)) {
            primitive["material"] = json!(material);
        }
        Some(primitive)
    }
}

/// The least and the greatest of points.
fn bounds(points: &[f32]) -> [[f32; 3]; 2] {
    points.chunks_exact(3).fold([[f32::MAX; 3], [f32::MIN; 3]], |[low, high], p| {
        let bound = |of: [f32; 3], by: fn(f32, f32) -> f32| std::array::from_fn(|axis| by(of[axis], p[axis]));
        [bound(low, f32::min), bound(high, f32::max)]
    })
}
