//! Decoders of compressed geometry: Draco streams (KHR_draco_mesh_compression) and meshopt views
//! (EXT_meshopt_compression, KHR_meshopt_compression).
//!
//! A few bytes can stand for millions of triangles, so the caller says how much may come out.

use draco_core::DataType;
use draco_core::decode_limits::DecodeLimits;
use draco_core::decoder_buffer::DecoderBuffer;
use draco_core::geometry_attribute::PointAttribute;
use draco_core::geometry_indices::PointIndex;
use draco_core::mesh::Mesh;
use draco_core::mesh_decoder::MeshDecoder;
use draco_gltf::meshopt::{MeshoptFilter, MeshoptMode, decode_buffer_view};
use gltf::json::accessor::ComponentType;
use serde_json::{Map, Value};

/// The extension of a primitive whose data is a Draco stream.
pub const DRACO: &str = "KHR_draco_mesh_compression";

/// The extensions of a buffer view whose data is a meshopt stream. The second is the first with one more version of the
/// vertex stream and one more filter.
pub const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Draco streams of one file that may turn out to be broken before no more are tried: decoding a broken one may take as
/// long as decoding a sound one, and its length does not say how long.
pub(crate) const MOST_BROKEN: u32 = 8;

/// Vertices to a triangle, at most: where no two triangles share one.
pub(crate) const CORNERS: u64 = 3;

/// A decoded Draco mesh.
pub struct DracoMesh {
    mesh: Mesh,
}

/// One attribute of a Draco mesh, a value per vertex.
pub struct Attribute {
    /// Numbers of a value: 3 for a `VEC3`.
    pub components: usize,
    pub component_type: ComponentType,
    /// Little-endian, without gaps: shape `[vertices][components]`.
    pub bytes: Vec<u8>,
}

impl DracoMesh {
    /// Decodes a stream within these limits. An error is the reason, as a sentence.
    pub fn decode(stream: &[u8], most_triangles: u64, most_bytes: u64) -> Result<DracoMesh, String> {
        let limits = DecodeLimits::default()
            .with_max_faces(most_triangles)
            .with_max_points(most_triangles.saturating_mul(CORNERS))
            .with_max_decoded_bytes(most_bytes);
        let mut mesh = Mesh::new();
        let mut buffer = DecoderBuffer::new(stream).with_limits(limits);
        MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|error| error.to_string())?;
        Ok(DracoMesh { mesh })
    }

    pub fn vertices(&self) -> usize {
        self.mesh.num_points()
    }

    /// Three vertices of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = u32> {
        self.mesh.faces().iter().flatten().map(|point| point.0)
    }

    /// The attribute of that unique id. Its numbers are as the file's accessor says, or floats.
    pub fn attribute(&self, id: u32) -> Option<Attribute> {
        let attribute = self.mesh.attribute_by_unique_id(id)?;
        let components = usize::from(attribute.num_components());
        match component_type(attribute.data_type()) {
            Some(component_type) => {
                let bytes = raw(attribute, self.vertices())?;
                Some(Attribute { components, component_type, bytes })
            }
            None => {
                let values = attribute.read_f32s(self.vertices(), components);
                let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
                Some(Attribute { components, component_type: ComponentType::F32, bytes })
            }
        }
    }

    /// Bytes of all that was decoded.
    pub fn bytes(&self) -> u64 {
        let corners = 3 * size_of::<u32>() * self.mesh.num_faces();
        let attributes = (0..self.mesh.num_attributes()).map(|i| {
            let attribute = self.mesh.attribute(i);
            let width = usize::from(attribute.num_components()) * attribute.data_type().byte_length();
            width.max(1) * self.vertices()
        });
        (corners + attributes.sum::<usize>()) as u64
    }
}

/// A type that accessors can have.
fn component_type(of: DataType) -> Option<ComponentType> {
    match of {
        DataType::Int8 => Some(ComponentType::I8),
        DataType::Uint8 => Some(ComponentType::U8),
        DataType::Int16 => Some(ComponentType::I16),
        DataType::Uint16 => Some(ComponentType::U16),
        DataType::Uint32 => Some(ComponentType::U32),
        DataType::Float32 => Some(ComponentType::F32),
        _ => None,
    }
}

/// The values of an attribute as they are stored, one for each vertex; `None` if one of them is not there.
fn raw(attribute: &PointAttribute, vertices: usize) -> Option<Vec<u8>> {
    let width = usize::from(attribute.num_components()) * attribute.data_type().byte_length();
    let stride = usize::try_from(attribute.byte_stride()).ok()?;
    let data = attribute.buffer().data();
    let mut bytes = Vec::with_capacity(width.checked_mul(vertices)?);
    for vertex in 0..u32::try_from(vertices).ok()? {
        let start = (attribute.mapped_index(PointIndex(vertex)).0 as usize).checked_mul(stride)?;
        bytes.extend_from_slice(data.get(start..start.checked_add(width)?)?);
    }
    Some(bytes)
}

/// The members of a meshopt view's extension.
#[derive(Clone, Copy, Debug)]
pub struct Meshopt<'a> {
    /// Elements.
    pub count: u64,
    /// Bytes of an element: 1 to 256.
    pub stride: u64,
    /// `ATTRIBUTES`, `TRIANGLES` or `INDICES`.
    pub mode: &'a str,
    /// `NONE`, `OCTAHEDRAL`, `QUATERNION`, `EXPONENTIAL` or `COLOR`.
    pub filter: &'a str,
}

impl<'a> Meshopt<'a> {
    /// The members of a view's extension; `None` if one is missing.
    pub fn read(extension: &'a Map<String, Value>) -> Option<Meshopt<'a>> {
        let number = |key: &str| extension.get(key).and_then(Value::as_u64);
        let word = |key: &str| extension.get(key).and_then(Value::as_str);
        let filter = word("filter").unwrap_or("NONE");
        Some(Meshopt { count: number("count")?, stride: number("byteStride")?, mode: word("mode")?, filter })
    }

    /// Bytes of the decoded view.
    pub fn bytes(&self) -> u64 {
        self.count.saturating_mul(self.stride)
    }

    /// The decoded view, or why there is none. It takes [`Meshopt::bytes`], which the caller bounds first.
    pub fn decode(&self, stream: &[u8]) -> Result<Vec<u8>, String> {
        // Its messages begin with the extension's name, which the problem states already.
        let clean = |error: draco_gltf::GltfError| {
            let text = error.to_string();
            text.rsplit(MESHOPT[0]).next().unwrap_or_default().trim_start_matches([':', ' ']).to_owned()
        };
        let mode = MeshoptMode::from_name(self.mode).map_err(clean)?;
        let filter = MeshoptFilter::from_name(self.filter).map_err(clean)?;
        let size = usize::try_from(self.bytes()).map_err(|_| "it is too large".to_owned())?;
        if !(1..=256).contains(&self.stride) {
            return Err(format!("its byteStride of {} is not 1 to 256", self.stride));
        }
        let mut plain = vec![0; size];
        decode_buffer_view(&mut plain, stream, mode, filter, self.count as usize, self.stride as usize)
            .map_err(clean)?;
        Ok(plain)
    }
}
