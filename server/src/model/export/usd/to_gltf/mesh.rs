//! Meshes of a stage: their faces as triangles, with normals and the first texture coordinates.

use super::Converter;
use super::values::{rows, vectors};
use cairn_gltf::document::Object;
use openusd::sdf::{FieldKey, Path, Value};
use serde_json::json;

impl Converter<'_> {
    /// A mesh, read once for each material that it is shown with.
    pub(super) fn mesh(&mut self, prim: &Path, material: Option<&Path>) -> Result<Option<usize>, String> {
        let key = format!("{} {}", prim.as_str(), material.map_or("", Path::as_str));
        if let Some(known) = self.meshes.get(&key) {
            return Ok(Some(*known));
        }
        let wrong = |what: &str| format!("{}: {what}", prim.as_str());
        let Some(points) = self.samples(prim, "points", vectors).map(|mut samples| samples.swap_remove(0).1) else {
            return Ok(None);
        };
        let (Some(Value::IntVec(counts)), Some(Value::IntVec(corners))) =
            (self.value(prim, "faceVertexCounts"), self.value(prim, "faceVertexIndices"))
        else {
            return Err(wrong("it has no faces"));
        };
        let mirrored = self.token(prim, "orientation").is_some_and(|orientation| orientation == "leftHanded");
        // Corners of triangles, and the face of each triangle.
        let (mut triangles, mut faces, mut begin) = (Vec::new(), Vec::new(), 0);
        for (face, count) in counts.into_iter().enumerate() {
            let count = usize::try_from(count).map_err(|_| wrong("a face has less than no corners"))?;
            let end = begin + count;
            if end > corners.len() {
                return Err(wrong("its faces have more corners than faceVertexIndices"));
            }
            for k in begin + 1..end.saturating_sub(1) {
                let [second, third] = if mirrored { [k + 1, k] } else { [k, k + 1] };
                triangles.extend([begin, second, third]);
                faces.extend([face; 3]);
            }
            begin = end;
        }
        let mut position = Vec::with_capacity(3 * triangles.len());
        for &corner in &triangles {
            let point = usize::try_from(corners[corner]).ok().and_then(|index| points.get(index));
            position.extend(*point.ok_or_else(|| wrong("a corner is none of its points"))?);
        }
        if position.is_empty() {
            return Ok(None);
        }
        let (low, high) = position.chunks_exact(3).fold(([f32::MAX; 3], [f32::MIN; 3]), |(low, high), p| {
            let bound = |of: [f32; 3], by: fn(f32, f32) -> f32| std::array::from_fn(|axis| by(of[axis], p[axis]));
            (bound(low, f32::min), bound(high, f32::max))
        });
        let spread = |values: &[Vec<f32>], of: Option<String>| -> Option<Vec<f32>> {
            let at = |n: usize| match of.as_deref() {
                Some("uniform") => Some(faces[n]),
                Some("faceVarying") => Some(triangles[n]),
                Some("constant") => Some(0),
                _ => usize::try_from(corners[triangles[n]]).ok(),
            };
            let each = (0..triangles.len()).map(|n| values.get(at(n)?));
            Some(each.collect::<Option<Vec<_>>>()?.into_iter().flatten().copied().collect())
        };
        let mut attributes = Object::new();
        attributes.insert("POSITION".into(), json!(self.numbers(&position, 3, Some([&low, &high]))));
        for (name, target, width) in [("normals", "NORMAL", 3), ("primvars:st", "TEXCOORD_0", 2)] {
            let Some(path) = prim.append_property(name).ok() else { continue };
            let Some(values) = self.field(&path, FieldKey::Default.as_str()).and_then(rows) else { continue };
            let indexed = prim.append_property(format!("{name}:indices")).ok();
            let indexed = indexed.and_then(|path| self.field(&path, FieldKey::Default.as_str()));
            let values = match indexed {
                Some(Value::IntVec(indices)) => {
                    let value = |index: i32| usize::try_from(index).ok().and_then(|index| values.get(index)).cloned();
                    indices.into_iter().map(value).collect::<Option<Vec<_>>>().unwrap_or_default()
                }
                _ => values,
            };
            let of = match self.field(&path, "interpolation") {
                Some(Value::Token(of)) => Some(of.as_str().to_owned()),
                _ => None,
            };
            if let Some(mut flat) = spread(&values, of).filter(|flat| flat.len() == width * triangles.len()) {
                if width == 2 {
                    flat.chunks_exact_mut(2).for_each(|at| at[1] = 1.0 - at[1]);
                }
                let place = self.numbers(&flat, width, None);
                attributes.insert(target.into(), json!(place));
            }
        }
        let mut primitive = json!({ "attributes": attributes });
        if let Some(material) = material.and_then(|material| self.material(material)) {
            primitive["material"] = json!(material);
        }
        let mesh = self.out.push("meshes", json!({ "primitives": [primitive] }));
        self.meshes.insert(key, mesh);
        Ok(Some(mesh))
    }
}
