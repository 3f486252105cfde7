//! Reads accessors of any component type, sparse ones included, into floats or indices. Checked throughout.

use crate::model::document::{Document, DocumentError, reference};
use serde_json::{Map, Value};

/// Elements that one accessor may have: beyond any picture's need, and a bound on what a few bytes of JSON can ask for.
const MOST_ELEMENTS: usize = 1 << 26;

/// How the components of an accessor are stored.
#[derive(Clone, Copy)]
struct Layout {
    component: u64,
    normalized: bool,
    components: usize,
}

impl Layout {
    fn component_size(self) -> usize {
        match self.component {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            _ => 4,
        }
    }

    fn read(self, bytes: &[u8]) -> f64 {
        let scaled = |value: f64, most: f64| if self.normalized { (value / most).max(-1.0) } else { value };
        let two = || [bytes[0], bytes[1]];
        let four = || [bytes[0], bytes[1], bytes[2], bytes[3]];
        match self.component {
            5120 => scaled(f64::from(bytes[0] as i8), 127.0),
            5121 => scaled(f64::from(bytes[0]), 255.0),
            5122 => scaled(f64::from(i16::from_le_bytes(two())), 32767.0),
            5123 => scaled(f64::from(u16::from_le_bytes(two())), 65535.0),
            5125 => f64::from(u32::from_le_bytes(four())),
            _ => f64::from(f32::from_le_bytes(four())),
        }
    }
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
    let accessor = document.get("accessors", index)?;
    let components = match accessor.get("type").and_then(Value::as_str) {
        Some("SCALAR") => 1,
        Some("VEC2") => 2,
        Some("VEC3") => 3,
        Some("VEC4") => 4,
        _ => return Err(malformed("is no list of vectors")),
    };
    if components < N {
        return Err(malformed("has too few components"));
    }
    let layout = Layout {
        component: component_type(accessor).ok_or_else(|| malformed("has no known component type"))?,
        normalized: scaled && accessor.get("normalized").and_then(Value::as_bool).unwrap_or(false),
        components,
    };
    let count = reference(accessor, "count").ok_or_else(|| malformed("has no count"))?;
    if count > MOST_ELEMENTS {
        return Err(malformed("has too many elements"));
    }
    let mut values = match reference(accessor, "bufferView") {
        Some(view) => elements(document, view, accessor, layout, count)?,
        None => vec![[0.0; N]; count],
    };
    if let Some(sparse) = accessor.get("sparse").and_then(Value::as_object) {
        overlay(document, index, sparse, layout, &mut values)?;
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

fn component_type(object: &Map<String, Value>) -> Option<u64> {
    object.get("componentType").and_then(Value::as_u64).filter(|c| [5120, 5121, 5122, 5123, 5125, 5126].contains(c))
}

/// `count` elements from `object`'s place in a view.
fn elements<const N: usize>(
    document: &Document,
    view: usize,
    object: &Map<String, Value>,
    layout: Layout,
    count: usize,
) -> Result<Vec<[f64; N]>, DocumentError> {
    let bytes = document.view(view)?;
    let step = layout.component_size();
    let size = step * layout.components;
    let stride = reference(document.get("bufferViews", view)?, "byteStride").unwrap_or(size).max(size);
    let start = reference(object, "byteOffset").unwrap_or(0);
    let short = || DocumentError::malformed("bufferViews", view, "is shorter than its accessor");
    let length = count.saturating_sub(1).checked_mul(stride).and_then(|l| l.checked_add(size)).ok_or_else(short)?;
    if count == 0 {
        return Ok(Vec::new());
    }
    let end = start.checked_add(length).ok_or_else(short)?;
    let bytes = bytes.get(start..end).ok_or_else(short)?;
    let element = |i: usize| std::array::from_fn(|c| layout.read(&bytes[i * stride + c * step..]));
    Ok((0..count).map(element).collect())
}

/// Replaces the elements that a sparse accessor lists.
fn overlay<const N: usize>(
    document: &Document,
    index: usize,
    sparse: &Map<String, Value>,
    layout: Layout,
    values: &mut [[f64; N]],
) -> Result<(), DocumentError> {
    let malformed = |problem: &str| DocumentError::malformed("accessors", index, problem);
    let part = |name: &str| sparse.get(name).and_then(Value::as_object).ok_or_else(|| malformed("has a broken sparse"));
    let count = reference(sparse, "count").filter(|&c| c <= values.len());
    let count = count.ok_or_else(|| malformed("has a broken sparse count"))?;
    let view = |object| reference(object, "bufferView").ok_or_else(|| malformed("has a sparse part without data"));
    let (places, replacements) = (part("indices")?, part("values")?);
    let component = component_type(places).ok_or_else(|| malformed("has sparse indices of no known type"))?;
    let places_layout = Layout { component, normalized: false, components: 1 };
    let places: Vec<[f64; 1]> = elements(document, view(places)?, places, places_layout, count)?;
    let replacements: Vec<[f64; N]> = elements(document, view(replacements)?, replacements, layout, count)?;
    for ([place], replacement) in places.into_iter().zip(replacements) {
        let slot = values.get_mut(place as usize).ok_or_else(|| malformed("has a sparse index out of range"))?;
        *slot = replacement;
    }
    Ok(())
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
