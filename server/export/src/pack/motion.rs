//! The pile in motion, as games take it: a skeleton with a clip, or textures that hold the pose of each body in each
//! frame, read by a vertex shader.
//!
//! `motion.positions.exr` and `motion.rotations.exr` are of 32-bit floats. A column is a frame, a row is a body; from
//! body [`ROWS`] on, they go on beside, as many columns further. Row 0 is at the top. Positions have X, Y, Z in metres
//! and, as alpha, the scale, which is 0 before the body appears; rotations have a unit quaternion X, Y, Z, W, in the
//! half space of the frame before. `motion.glb` is the pile at rest; `TEXCOORD_1` is the middle of the body's first
//! texel. A shader takes each vertex back from the pose of the last frame, and to that of the frame shown.

use super::file::{GltfFile, Looks};
use super::pile::{BodyPose, PackedPile};
use super::still;
use super::surface::{Surfaces, Vertex};
use super::{MotionLayout, PackError, PackedFile};
use crate::glb::motion::Keys;
use crate::tracks::Track;
use cairn_geometry::pose::Pose;
use cairn_gltf::document::Object;
use exr::prelude::{Encoding, Image, Layer, LayerAttributes, SpecificChannels, Vec2, WritableImage};
use glam::DAffine3;
use serde_json::json;
use std::io::Cursor;

/// Rows of a texture, at most.
const ROWS: usize = 4096;
/// Columns of a texture, at most: what graphics cards bear.
const COLUMNS: usize = 16384;
/// Joints of a skeleton, at most: their numbers have 16 bits.
const MOST_JOINTS: usize = 65_535;

/// The layout of the textures, or why there are none.
pub fn layout(pile: &PackedPile) -> Result<MotionLayout, String> {
    let (frames, bodies) = (pile.frames.len(), pile.bodies.len());
    let rows = bodies.min(ROWS);
    let width = frames * bodies.div_ceil(ROWS);
    if width > COLUMNS {
        return Err(format!(
            "the motion is left out: {bodies} bodies in {frames} frames need a texture {width} texels wide, and \
             graphics cards take {COLUMNS}; bake fewer frames"
        ));
    }
    Ok(MotionLayout { fps: pile.fps, frames, bodies, width, height: rows, rows })
}

/// The two textures, and the mesh that they move.
pub fn textures(
    pile: &PackedPile,
    layout: &MotionLayout,
    looks: &Looks,
    is_compressed: bool,
) -> Result<Vec<PackedFile>, PackError> {
    let frames = &pile.frames;
    let texel = |x: usize, y: usize| frames[x % layout.frames].get(y + x / layout.frames * layout.rows);
    let positions = |pose: &BodyPose| {
        let [x, y, z] = pose.translation.as_vec3().to_array();
        [x, y, z, pose.scale as f32]
    };
    let rotations = |pose: &BodyPose| pose.rotation.as_quat().to_array();
    let write = |of: &(dyn Fn(&BodyPose) -> [f32; 4] + Sync)| picture(layout, |x, y| texel(x, y).map_or([0.0; 4], of));
    let mut file = GltfFile::new(looks, is_compressed);
    let surfaces = still::at_rest(pile, still::first_error(pile));
    let mut addresses = |file: &mut GltfFile, vertices: &[Vertex], attributes: &mut Object| {
        let values: Vec<[f32; 2]> = vertices.iter().map(|vertex| layout.address(vertex.body as usize)).collect();
        attributes.insert("TEXCOORD_1".into(), json!(file.floats(&values, false)?));
        Ok(())
    };
    let mesh = file.mesh("pile_motion", &with_coordinates(&surfaces), &mut addresses)?;
    let node = file.out.push("nodes", json!({ "name": "pile_motion", "mesh": mesh }));
    let top = file.out.push("nodes", json!({ "name": "pile", "children": [node] }));
    let mut packed = PackedFile::new("motion.glb", "mesh that textures move", file.finish(&[top])?);
    (packed.triangles, packed.vertices, packed.draws) = (surfaces.triangles(), surfaces.vertices(), surfaces.0.len());
    Ok(vec![
        packed,
        PackedFile::new("motion.positions.exr", "positions by frame and body", write(&positions)?),
        PackedFile::new("motion.rotations.exr", "rotations by frame and body", write(&rotations)?),
    ])
}

/// A second set of texture coordinates needs a first one.
fn with_coordinates(surfaces: &Surfaces) -> Surfaces {
    let mut all = surfaces.clone();
    all.0.values_mut().for_each(|surface| surface.has_coordinates = true);
    all
}

impl MotionLayout {
    /// The middle of a body's first texel, as texture coordinates; V is 0 at the top, as in glTF.
    fn address(&self, body: usize) -> [f32; 2] {
        let (column, row) = (body / self.rows * self.frames, body % self.rows);
        [((column as f64 + 0.5) / self.width as f64) as f32, ((row as f64 + 0.5) / self.height as f64) as f32]
    }
}

/// An EXR of floats, compressed without loss.
fn picture(layout: &MotionLayout, of: impl Fn(usize, usize) -> [f32; 4] + Sync) -> Result<Vec<u8>, PackError> {
    let texel = |Vec2(x, y): Vec2<usize>| <(f32, f32, f32, f32)>::from(of(x, y));
    let encoding = Encoding::SMALL_LOSSLESS;
    let size = (layout.width, layout.height);
    let layer = Layer::new(size, LayerAttributes::default(), encoding, SpecificChannels::rgba(texel));
    let mut bytes = Cursor::new(Vec::new());
    let written = Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes);
    written.map_err(|error| PackError::Io(std::io::Error::other(error.to_string())))?;
    Ok(bytes.into_inner())
}

/// The pile as a mesh with a skeleton: a joint for each body below the joint `pile`, and one clip. `None`: too many.
pub fn skinned(pile: &PackedPile, looks: &Looks, is_compressed: bool) -> Result<Option<PackedFile>, PackError> {
    if pile.bodies.len() > MOST_JOINTS {
        return Ok(None);
    }
    let mut file = GltfFile::new(looks, is_compressed);
    let surfaces = still::at_rest(pile, still::first_error(pile));
    let mut joints = |file: &mut GltfFile, vertices: &[Vertex], attributes: &mut Object| {
        attributes.insert("JOINTS_0".into(), json!(file.joints(vertices)?));
        let whole = vec![[1.0, 0.0, 0.0, 0.0]; vertices.len()];
        attributes.insert("WEIGHTS_0".into(), json!(file.floats(&whole, false)?));
        Ok(())
    };
    let mesh = file.mesh("pile_skinned", &surfaces, &mut joints)?;
    // Joints are the first nodes, so that body `i` is node `i`.
    let mut nodes = Vec::new();
    for (body, pose) in pile.bodies.iter().zip(pile.rest()) {
        let scale = [pose.scale as f32; 3];
        let node = json!({
            "name": body.name, "translation": pose.translation.as_vec3().to_array(),
            "rotation": pose.rotation.normalize().as_quat().to_array(), "scale": scale,
        });
        nodes.push(file.out.push("nodes", node));
    }
    let root = file.out.push("nodes", json!({ "name": "pile", "children": nodes }));
    let inverse: Vec<[f32; 16]> = pile.rest().iter().map(|pose| columns(&pose.affine().inverse())).collect();
    let bytes: Vec<u8> = inverse.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    let view = file.out.push_view(&bytes, Object::new());
    let matrices = json!({ "bufferView": view, "componentType": 5126, "type": "MAT4", "count": inverse.len() });
    let matrices = file.out.push("accessors", matrices);
    let skin = json!({ "name": "pile", "joints": nodes, "skeleton": root, "inverseBindMatrices": matrices });
    let skin = file.out.push("skins", skin);
    let shown = file.out.push("nodes", json!({ "name": "pile_skinned", "mesh": mesh, "skin": skin }));
    let mut keys = Keys::default();
    for body in 0..pile.bodies.len() {
        let poses = || pile.frames.iter().map(|poses| &poses[body]);
        let pose = |pose: &BodyPose| Pose { translation: pose.translation, rotation: pose.rotation };
        keys.add_motion(body, || poses().map(pose));
        let scale = pile.rest()[body].scale as f32;
        let absent = poses().take_while(|pose| pose.scale == 0.0).count();
        if absent > 0 {
            let track = Track { frames: vec![0, absent as u32], values: vec![[0.0; 3], [scale; 3]] };
            keys.add(body, "scale", &track);
        }
    }
    keys.write(pile.fps, &mut file.out);
    let mut packed = PackedFile::new("skinned.glb", "skeleton and clip", file.finish(&[root, shown])?);
    (packed.triangles, packed.vertices, packed.draws) = (surfaces.triangles(), surfaces.vertices(), surfaces.0.len());
    Ok(Some(packed))
}

fn columns(affine: &DAffine3) -> [f32; 16] {
    glam::DMat4::from(*affine).as_mat4().to_cols_array()
}
