//! Synthetic bakes and source files.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use cairn_core::report::bake::{BakedBody, BakedPile, BakedSolid, BakedWorld};
use cairn_engine::shape::Solid;
use cairn_export::{ExportError, ExportScene, Format};
use cairn_geometry::pose::Pose;
use glam::{DMat4, DQuat, DVec3};
use serde_json::{Value, json};

/// For sources that need no other file.
pub fn no_files(uri: &str) -> Result<Vec<u8>, String> {
    Err(format!("{uri}: there are no other files"))
}

/// A pile of bodies (prop, scale) with the given poses.
pub fn pile_of(bodies: &[(usize, f64)], frames: Vec<Vec<Pose>>) -> BakedPile {
    let body = |(number, &(prop, scale))| BakedBody {
        prop,
        number,
        scale,
        first_frame: 0,
        mass_factor: 1.0,
        is_pinned: false,
    };
    let bodies: Vec<BakedBody> = bodies.iter().enumerate().map(body).collect();
    let ball = BakedSolid {
        pivot: DVec3::ZERO,
        center: DVec3::ZERO,
        mass: 1.0,
        inertia: (DVec3::ONE, DQuat::IDENTITY),
        friction: 0.7,
        restitution: 0.0,
        solid: Solid::Ball { center: DVec3::ZERO, radius: 0.5 },
    };
    let solids = vec![ball; bodies.iter().map(|body| body.prop + 1).max().unwrap_or(0)];
    let world = BakedWorld { gravity: 9.81, ground: Some(0.0), ground_friction: 0.7, diameter: 1.0 };
    BakedPile { fps: 24.0, bodies, filled: 0, frames, scenery: Vec::new(), glue: None, solids, world }
}

/// The center of mass of a prop that lies far from its origin, in its own frame.
pub const FAR: DVec3 = DVec3::new(100.0, 0.0, 0.0);

/// A body of such a prop: its center moves evenly along x, by 1 m per frame, while it turns.
pub fn far_from_its_origin(frames: usize) -> BakedPile {
    let pose = |frame: usize| {
        let rotation = DQuat::from_rotation_y(0.4 * frame as f64);
        Pose { translation: DVec3::X * frame as f64 - rotation * FAR, rotation }
    };
    let frames = (0..frames).map(|frame| vec![pose(frame)]).collect();
    let mut pile = pile_of(&[(0, 1.0)], frames);
    pile.solids[0].pivot = FAR;
    pile
}

/// Bodies that fall and spin, each its own way; every second quaternion has the other sign.
pub fn tumbling(bodies: usize, frames: usize) -> Vec<Vec<Pose>> {
    let pose = |frame: usize, body: usize| {
        let (t, b) = (frame as f64 / 24.0, body as f64 + 1.0);
        let axis = DVec3::new(1.0, b, 0.5 * b).normalize();
        let sign = if frame % 2 == 1 { -1.0 } else { 1.0 };
        Pose {
            translation: DVec3::new(b - t * b * 0.1, 3.0 - 0.4 * t * t, -0.3 * b + 0.2 * t),
            rotation: DQuat::from_axis_angle(axis, b + 4.0 * t) * sign,
        }
    };
    (0..frames).map(|frame| (0..bodies).map(|body| pose(frame, body)).collect()).collect()
}

/// A picture of one pixel.
pub const PNG: &[u8] = &[
    0x89, b'P', b'N', b'G', 13, 10, 26, 10, 0, 0, 0, 13, b'I', b'H', b'D', b'R', 0, 0, 0, 1, 0, 0, 0, 1, 8, 2, 0, 0, 0,
    0x90, 0x77, 0x53, 0xde, 0, 0, 0, 12, b'I', b'D', b'A', b'T', 8, 0xd7, 0x63, 0xf8, 0xcf, 0xc0, 0, 0, 3, 1, 1, 0,
    0x18, 0xdd, 0x8d, 0xb0, 0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82,
];

/// One triangle with texture coordinates: 36 bytes of positions, 24 of coordinates, 6 of indices.
fn triangle_bytes() -> Vec<u8> {
    let floats: [f32; 15] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 1.];
    let mut bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0].iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// A single painted mesh at the origin, without its buffer and image.
fn painted() -> Value {
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "Cube", "mesh": 0 }],
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 1 },
        ] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3, "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 0, "byteOffset": 36, "componentType": 5126, "type": "VEC2", "count": 3 },
            { "bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 3 },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 60 },
            { "buffer": 0, "byteOffset": 60, "byteLength": 6 },
        ],
        "materials": [{ "name": "unused" }, {
            "name": "paint",
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 1 } },
            "extensions": { "KHR_materials_clearcoat": { "clearcoatTexture": { "index": 1, "texCoord": 0 } } },
        }],
        "textures": [{ "source": 0 }, { "source": 1, "sampler": 0 }],
        "samplers": [{ "wrapS": 33071 }],
        "images": [{ "uri": "unused.png" }],
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_clearcoat"],
        "extensionsRequired": ["KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "sun" }] } },
    })
}

/// A GLB with an embedded picture.
pub fn textured_cube() -> Vec<u8> {
    let mut json = painted();
    let mut bin = triangle_bytes();
    let offset = bin.len();
    bin.extend_from_slice(PNG);
    json["bufferViews"].as_array_mut().unwrap().push(json!({
        "buffer": 0, "byteOffset": offset, "byteLength": PNG.len(),
    }));
    json["images"].as_array_mut().unwrap().push(json!({ "bufferView": 2, "mimeType": "image/png" }));
    json["buffers"] = json!([{ "byteLength": bin.len() }]);
    glb(&json, bin)
}

/// A `.gltf` and its `cube.bin`; its picture `lost.png` stands apart.
pub fn separate() -> (Vec<u8>, Vec<u8>) {
    let (mut json, bin) = (painted(), triangle_bytes());
    json["images"].as_array_mut().unwrap().push(json!({ "uri": "lost.png" }));
    json["buffers"] = json!([{ "byteLength": bin.len(), "uri": "cube.bin" }]);
    (json.to_string().into_bytes(), bin)
}

fn glb(json: &Value, mut bin: Vec<u8>) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    bin.resize(bin.len().next_multiple_of(4), 0);
    let word = |n: usize| (n as u32).to_le_bytes();
    let total = 28 + json.len() + bin.len();
    [b"glTF", &word(2)[..], &word(total), &word(json.len()), b"JSON", &json, &word(bin.len()), b"BIN\0", &bin].concat()
}

/// A kit of one mesh used twice, with rotated, scaled, mirrored and sheared frames, and a lamp without a mesh.
pub fn kit_json() -> Value {
    let mut json = painted();
    let bin = triangle_bytes();
    let uri = format!("data:application/octet-stream;base64,{}", BASE64_STANDARD.encode(&bin));
    json["buffers"] = json!([{ "byteLength": bin.len(), "uri": uri }]);
    json["images"].as_array_mut().unwrap().push(json!({
        "uri": format!("data:image/png;base64,{}", BASE64_STANDARD.encode(PNG)),
    }));
    let h = std::f64::consts::FRAC_1_SQRT_2;
    json["nodes"] = json!([
        {
            "name": "Root", "children": [1, 2, 4], "translation": [1, 2, 3],
            "rotation": [0, h, 0, h], "scale": [2, 1, 0.5],
        },
        { "name": "Wheel", "mesh": 0, "rotation": [h, 0, 0, h], "translation": [0, 0, 5] },
        { "name": "Arm", "children": [3], "matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 1, 0, 4, 5, 6, 1] },
        { "name": "Mirrored", "mesh": 0, "scale": [-1, 1, 3], "translation": [7, 0, 0] },
        { "name": "lamp", "extensions": { "KHR_lights_punctual": { "light": 0 } } },
    ]);
    json
}

pub fn kit() -> Vec<u8> {
    kit_json().to_string().into_bytes()
}

/// The kit's nodes with a mesh: the path of names to each, and its world transform.
pub fn kit_nodes() -> Vec<(&'static [&'static str], DMat4)> {
    let h = std::f64::consts::FRAC_1_SQRT_2;
    let root = DMat4::from_scale_rotation_translation(
        DVec3::new(2.0, 1.0, 0.5),
        DQuat::from_xyzw(0.0, h, 0.0, h),
        DVec3::new(1.0, 2.0, 3.0),
    );
    let wheel = DMat4::from_rotation_translation(DQuat::from_xyzw(h, 0.0, 0.0, h), DVec3::new(0.0, 0.0, 5.0));
    let arm = DMat4::from_cols_array(&[0., 2., 0., 0., -2., 0., 0., 0., 0., 0., 1., 0., 4., 5., 6., 1.]);
    let mirrored = DMat4::from_translation(DVec3::X * 7.0) * DMat4::from_scale(DVec3::new(-1.0, 1.0, 3.0));
    vec![(&["Root", "Wheel"], root * wheel), (&["Root", "Arm", "Mirrored"], root * arm * mirrored)]
}

/// The bytes of a result's own file.
pub fn encode(format: Format, pile: &BakedPile, scene: &ExportScene) -> Result<Vec<u8>, ExportError> {
    cairn_export::encode(format, pile, scene).map(|encoded| encoded.bytes)
}
