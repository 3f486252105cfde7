//! The triangles of a primitive, in whichever form the file stores them.

use glam::DVec3;
use serde_json::Value;

use super::{Document, DocumentError, Object, reference};
use crate::compressed::DRACO;

/// Triangles that share their vertices.
pub struct Triangles<'a> {
    document: &'a Document<'a>,
    attributes: Option<&'a Object>,
    pub points: Vec<DVec3>,
    /// Indices into the points, and into every attribute.
    pub corners: Vec<[usize; 3]>,
}

impl<'a> Triangles<'a> {
    /// A primitive of the mesh of that index. One of points or lines has no corners.
    pub fn read(document: &'a Document<'a>, mesh: usize, json: &'a Object) -> Result<Triangles<'a>, DocumentError> {
        let malformed = |problem: &str| DocumentError::malformed("meshes", mesh, problem);
        if json.get("extensions").is_some_and(|extensions| extensions.get(DRACO).is_some()) {
            return Err(malformed("has compressed data that cannot be decoded"));
        }
        let attributes = json.get("attributes").and_then(Value::as_object);
        let positions = attributes.and_then(|a| reference(a, "POSITION"));
        let positions = positions.ok_or_else(|| malformed("has a primitive without positions"))?;
        let points: Vec<DVec3> = document.vectors::<3>(positions)?.into_iter().map(DVec3::from).collect();
        let count = points.len();
        let order: Vec<usize> = match reference(json, "indices") {
            Some(indices) => document.indices(indices)?,
            None => (0..count).collect(),
        };
        if order.iter().any(|&i| i >= count) {
            return Err(malformed("has an index out of range"));
        }
        let corners = match json.get("mode").and_then(Value::as_u64).unwrap_or(4) {
            4 => order.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
            5 => {
                let strip =
                    |(i, w): (usize, &[usize])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
                order.windows(3).enumerate().map(strip).collect()
            }
            6 if !order.is_empty() => order[1..].windows(2).map(|w| [order[0], w[0], w[1]]).collect(),
            _ => Vec::new(),
        };
        Ok(Triangles { document, attributes, points, corners })
    }

    /// An attribute with a value for each point; `None` if there is none.
    pub fn vectors<const N: usize>(&self, name: &str) -> Result<Option<Vec<[f64; N]>>, DocumentError> {
        let Some(index) = self.attributes.and_then(|a| reference(a, name)) else { return Ok(None) };
        let values = self.document.vectors::<N>(index)?;
        Ok((values.len() == self.points.len()).then_some(values))
    }
}
