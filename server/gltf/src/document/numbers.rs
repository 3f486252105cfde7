//! The numbers of a document's accessors, of any component type, as [`Elements`] reads them.

use gltf::accessor::DataType;
use gltf::json::accessor::sparse;
use gltf::json::validation::{Checked::Valid, USize64};
use gltf::json::{self, Index};

use super::{Document, DocumentError, reference};
use crate::accessor::{Elements, Sparse, Strided};
use crate::buffer::BufferView;
use crate::problem::ProblemKind;

/// Elements that one accessor may have: beyond any picture's need, and a bound on what a few bytes of JSON can ask for.
const MOST_ELEMENTS: u64 = 1 << 26;

/// The members of an accessor that are read.
const READ: [&str; 7] = ["bufferView", "byteOffset", "componentType", "count", "normalized", "sparse", "type"];

impl Document<'_> {
    /// Vectors of `N` components. The accessor may have more components, but not fewer.
    pub fn vectors<const N: usize>(&self, accessor: usize) -> Result<Vec<[f64; N]>, DocumentError> {
        finite(accessor, &self.elements(accessor, N)?)
    }

    /// Indices of vertices.
    pub fn indices(&self, accessor: usize) -> Result<Vec<usize>, DocumentError> {
        Ok(self.vectors::<1>(accessor)?.into_iter().map(|[i]| i as usize).collect())
    }

    /// The least and the largest of each of `N` components, as an accessor states them in `min` and `max`: integers as
    /// they are stored. `None` if there are no elements.
    pub fn bounds<const N: usize>(&self, accessor: usize) -> Result<Option<[[f64; N]; 2]>, DocumentError> {
        let wider = |[low, high]: [[f64; N]; 2], value: [f64; N]| {
            [std::array::from_fn(|i| low[i].min(value[i])), std::array::from_fn(|i| high[i].max(value[i]))]
        };
        let stored = Elements { normalized: false, ..self.elements(accessor, N)? };
        let values = finite(accessor, &stored)?;
        Ok(values.first().map(|&first| values.iter().copied().fold([first; 2], wider)))
    }

    /// An accessor of at least this number of components.
    fn elements(&self, index: usize, components: usize) -> Result<Elements<'_>, DocumentError> {
        let malformed = |problem: &str| DocumentError::malformed("accessors", index, problem);
        let broken = |what: ProblemKind| malformed(&what.to_string());
        let mut accessor = self.get("accessors", index)?.clone();
        accessor.retain(|member, _| READ.contains(&member.as_str())); // a fault in any other does not matter
        let accessor: json::Accessor =
            serde_json::from_value(accessor.into()).map_err(|error| malformed(&error.to_string()))?;
        let (Valid(component), Valid(shape)) = (accessor.component_type, accessor.type_) else {
            return Err(malformed("is of no known type"));
        };
        let (component, count) = (component.0, accessor.count.0);
        if shape.multiplicity() < components {
            return Err(malformed("has too few components"));
        }
        if count > MOST_ELEMENTS {
            return Err(malformed("has too many elements"));
        }
        let size = shape.multiplicity() * component.size();
        let offset = accessor.byte_offset.unwrap_or_default();
        let base = accessor.buffer_view.map(|view| self.strided(view, offset, count, size)).transpose()?;
        let sparse = match accessor.sparse {
            Some(sparse::Sparse { count: USize64(few), indices, values, .. }) => {
                let few = Sparse::check_count(few, count).map_err(broken)?;
                let Valid(type_) = indices.component_type else {
                    return Err(malformed("has sparse indices of no known type"));
                };
                let type_: DataType = type_.0;
                let places = self.strided(indices.buffer_view, indices.byte_offset, few, type_.size())?;
                let values = self.strided(values.buffer_view, values.byte_offset, few, size)?;
                Some(Sparse::new((places, type_), values, few, count, false).map_err(broken)?)
            }
            None => None,
        };
        Ok(Elements { count, component, normalized: accessor.normalized, base, sparse })
    }

    /// `count` elements of `size` bytes from `offset` on in a view. A stride that is too small is not believed.
    fn strided(
        &self,
        view: Index<json::buffer::View>,
        offset: USize64,
        count: u64,
        size: usize,
    ) -> Result<Strided<'_>, DocumentError> {
        let index = view.value();
        let stride = reference(self.get("bufferViews", index)?, "byteStride").map(|stride| stride.max(size) as u64);
        let view = BufferView::in_place(self.view(index)?, stride);
        let broken = |what: ProblemKind| DocumentError::malformed("bufferViews", index, what.to_string());
        Strided::new(view, offset.0, count, size).map_err(broken)
    }
}

/// All elements, if every number is finite.
fn finite<const N: usize>(index: usize, elements: &Elements<'_>) -> Result<Vec<[f64; N]>, DocumentError> {
    let values: Vec<[f64; N]> = (0..elements.count).map(|i| elements.numbers(i)).collect();
    if values.iter().flatten().any(|v| !v.is_finite()) {
        return Err(DocumentError::malformed("accessors", index, "holds a number that is not finite"));
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(accessor: &str) -> Document<'static> {
        // Bytes 0 to 7, then the floats 1 and 2.
        let json = format!(
            r#"{{ "accessors": [{accessor}],
                "bufferViews": [{{ "buffer": 0, "byteLength": 8 }},
                    {{ "buffer": 0, "byteOffset": 8, "byteLength": 8 }}],
                "buffers": [{{ "byteLength": 16, "uri": "data:;base64,AAECAwQFBgcAAIA/AAAAQA==" }}] }}"#
        );
        Document::parse(json.leak().as_bytes(), &|uri| Err(uri.into())).unwrap()
    }

    #[test]
    fn strided_normalised_bytes() {
        let mut file = document(
            r#"{ "bufferView": 0, "byteOffset": 1, "componentType": 5121, "type": "VEC2", "count": 3,
                "normalized": true }"#,
        );
        let packed = file.vectors::<2>(0).unwrap();
        assert_eq!(packed, [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]].map(|v| v.map(|x| x / 255.0)));
        assert_eq!(file.vectors::<1>(0).unwrap().len(), 3);
        assert!(file.vectors::<3>(0).is_err());
        file = document(r#"{ "bufferView": 0, "componentType": 5122, "type": "VEC2", "count": 3 }"#);
        assert!(file.vectors::<2>(0).is_err(), "one element too many");
    }

    #[test]
    fn sparse_values_over_nothing() {
        let file = document(
            r#"{ "componentType": 5126, "type": "SCALAR", "count": 6, "sparse": { "count": 2,
                "indices": { "bufferView": 0, "byteOffset": 2, "componentType": 5121 },
                "values": { "bufferView": 1 } } }"#,
        );
        assert_eq!(file.vectors::<1>(0).unwrap(), [[0.0], [0.0], [1.0], [2.0], [0.0], [0.0]]);
        assert_eq!(file.indices(0).unwrap(), [0, 0, 1, 2, 0, 0]);
    }
}
