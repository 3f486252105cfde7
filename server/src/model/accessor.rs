//! Reads accessors of any component type, sparse ones included, into floats or indices. Checked throughout.

use crate::model::document::{Document, DocumentError, reference};
use cairn_core::asset::number;
use gltf::accessor::DataType;
use gltf::json::accessor::sparse::Sparse;
use gltf::json::buffer::View;
use gltf::json::validation::{Checked::Valid, USize64};
use gltf::json::{Accessor, Index};

/// Elements that one accessor may have: beyond any picture's need, and a bound on what a few bytes of JSON can ask for.
const MOST_ELEMENTS: usize = 1 << 26;

/// The members of an accessor that are read.
const READ: [&str; 7] = ["bufferView", "byteOffset", "componentType", "count", "normalized", "sparse", "type"];

/// How the elements of an accessor are stored.
#[derive(Clone, Copy)]
struct Layout {
    component: DataType,
    normalized: bool,
    components: usize,
}

/// Vectors of `N` components. The accessor may have more; what it has less is an error.
pub fn vectors<const N: usize>(document: &Document, index: usize) -> Result<Vec<[f64; N]>, DocumentError> {
    read(document, index, true)
}

/// The least and the largest of each of `N` components, as an accessor's `min` and `max` tell them: integers as they are
/// stored. `None` if there are no elements.
pub fn bounds<const N: usize>(document: &Document, index: usize) -> Result<Option<[[f64; N]; 2]>, DocumentError> {
    let wider = |[low, high]: [[f64; N]; 2], value: [f64; N]| {
        [std::array::from_fn(|i| low[i].min(value[i])), std::array::from_fn(|i| high[i].max(value[i]))]
    };
    let values = read(document, index, false)?;
    Ok(values.first().map(|&first| values.iter().copied().fold([first; 2], wider)))
}

/// `scaled`: whether integers that the accessor calls normalised become fractions of one.
fn read<const N: usize>(document: &Document, index: usize, scaled: bool) -> Result<Vec<[f64; N]>, DocumentError> {
    let malformed = |problem: &str| DocumentError::malformed("accessors", index, problem);
    let mut accessor = document.get("accessors", index)?.clone();
    accessor.retain(|member, _| READ.contains(&member.as_str())); // a fault in any other does not matter
    let accessor: Accessor = serde_json::from_value(accessor.into()).map_err(|error| malformed(&error.to_string()))?;
    let (Valid(component), Valid(shape)) = (accessor.component_type, accessor.type_) else {
        return Err(malformed("is of no known type"));
    };
    let layout =
        Layout { component: component.0, normalized: scaled && accessor.normalized, components: shape.multiplicity() };
    if layout.components < N {
        return Err(malformed("has too few components"));
    }
    let count = usize::try_from(accessor.count.0).ok().filter(|&count| count <= MOST_ELEMENTS);
    let count = count.ok_or_else(|| malformed("has too many elements"))?;
    let mut values = match accessor.buffer_view {
        Some(view) => elements(document, view, accessor.byte_offset.unwrap_or_default(), layout, count)?,
        None => vec![[0.0; N]; count],
    };
    if let Some(Sparse { count: USize64(most), indices, values: others, .. }) = accessor.sparse {
        let most = usize::try_from(most).ok().filter(|&most| most <= count);
        let most = most.ok_or_else(|| malformed("has a broken sparse count"))?;
        let Valid(component) = indices.component_type else {
            return Err(malformed("has sparse indices of no known type"));
        };
        let places = Layout { component: component.0, normalized: false, components: 1 };
        let places: Vec<[f64; 1]> = elements(document, indices.buffer_view, indices.byte_offset, places, most)?;
        let others: Vec<[f64; N]> = elements(document, others.buffer_view, others.byte_offset, layout, most)?;
        for ([place], other) in places.into_iter().zip(others) {
            *values.get_mut(place as usize).ok_or_else(|| malformed("has a sparse index out of range"))? = other;
        }
    }
    if values.iter().flatten().any(|v| !v.is_finite()) {
        return Err(malformed("holds a number that is not finite"));
    }
    Ok(values)
}

/// Indices of vertices.
pub fn indices(document: &Document, index: usize) -> Result<Vec<u32>, DocumentError> {
    Ok(vectors::<1>(document, index)?.into_iter().map(|[i]| i as u32).collect())
}

/// `count` elements from `offset` on in a view.
fn elements<const N: usize>(
    document: &Document,
    view: Index<View>,
    offset: USize64,
    layout: Layout,
    count: usize,
) -> Result<Vec<[f64; N]>, DocumentError> {
    let bytes = document.view(view.value())?;
    let step = layout.component.size();
    let size = step * layout.components;
    let stride = reference(document.get("bufferViews", view.value())?, "byteStride").unwrap_or(size).max(size);
    let short = || DocumentError::malformed("bufferViews", view.value(), "is shorter than its accessor");
    let length = count.saturating_sub(1).checked_mul(stride).and_then(|l| l.checked_add(size)).ok_or_else(short)?;
    if count == 0 {
        return Ok(Vec::new());
    }
    let start = usize::try_from(offset.0).map_err(|_| short())?;
    let end = start.checked_add(length).ok_or_else(short)?;
    let bytes = bytes.get(start..end).ok_or_else(short)?;
    let number = |at: usize| number(layout.component, layout.normalized, &bytes[at..]);
    Ok((0..count).map(|i| std::array::from_fn(|c| number(i * stride + c * step))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(accessor: &str) -> Document {
        // Bytes 0 to 7, then the floats 1 and 2.
        let json = format!(
            r#"{{ "accessors": [{accessor}],
                "bufferViews": [{{ "buffer": 0, "byteLength": 8 }}, {{ "buffer": 0, "byteOffset": 8, "byteLength": 8 }}],
                "buffers": [{{ "byteLength": 16, "uri": "data:;base64,AAECAwQFBgcAAIA/AAAAQA==" }}] }}"#
        );
        Document::parse(json.as_bytes(), &|uri| Err(uri.into())).unwrap()
    }

    #[test]
    fn strided_normalised_bytes() {
        let mut file = document(
            r#"{ "bufferView": 0, "byteOffset": 1, "componentType": 5121, "type": "VEC2", "count": 3, "normalized": true }"#,
        );
        let packed = vectors::<2>(&file, 0).unwrap();
        assert_eq!(packed, [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]].map(|v| v.map(|x| x / 255.0)));
        assert_eq!(vectors::<1>(&file, 0).unwrap().len(), 3);
        assert!(vectors::<3>(&file, 0).is_err());
        file = document(r#"{ "bufferView": 0, "componentType": 5122, "type": "VEC2", "count": 3 }"#);
        assert!(vectors::<2>(&file, 0).is_err(), "one element too many");
    }

    #[test]
    fn sparse_values_over_nothing() {
        let file = document(
            r#"{ "componentType": 5126, "type": "SCALAR", "count": 6, "sparse": { "count": 2,
                "indices": { "bufferView": 0, "byteOffset": 2, "componentType": 5121 },
                "values": { "bufferView": 1 } } }"#,
        );
        assert_eq!(vectors::<1>(&file, 0).unwrap(), [[0.0], [0.0], [1.0], [2.0], [0.0], [0.0]]);
        assert_eq!(indices(&file, 0).unwrap(), [0, 0, 1, 2, 0, 0]);
    }
}
