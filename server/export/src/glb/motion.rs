//! The animation of a result.

use super::super::copy::GlbOutput;
use super::super::tracks::{self, Track};
use cairn_core::report::bake::BakedPile;
use cairn_geometry::pose::Pose;
use cairn_gltf::document::Object;
use serde_json::json;
use std::collections::BTreeMap;

/// The animation `pile`: per body and piece of moving scenery a translation and a rotation channel, without those that
/// never change; per body that appears later a scale channel.
pub fn animate(bake: &BakedPile, pile: usize, moving: &[(usize, usize)], out: &mut GlbOutput) {
    let mut keys = Keys::default();
    for body in 0..bake.bodies.len() {
        let node = pile + 1 + body;
        keys.add_motion(node, || (0..bake.frames.len()).map(|frame| bake.pivot_pose(frame, body)));
        if let Some(track) = tracks::appearance(&bake.bodies[body]) {
            keys.add(node, "scale", &track);
        }
    }
    for &(piece, node) in moving {
        keys.add_motion(node, || bake.scenery[piece].iter().copied());
    }
    if !keys.channels.is_empty() {
        keys.write(bake.fps, out);
    }
}

/// The key data of all channels. One buffer view each for times, translations and rotations.
#[derive(Default)]
pub struct Keys {
    /// Sets of keyed frames, shared by all channels that have the same.
    frame_sets: BTreeMap<Vec<u32>, usize>,
    channels: Vec<AnimationChannelOut>,
    /// Values of channels with 3 and with 4 components, little-endian.
    values: [Vec<u8>; 2],
}

struct AnimationChannelOut {
    node: usize,
    path: &'static str,
    frame_set: usize,
    /// Into the values of its kind.
    byte_offset: usize,
    count: usize,
}

impl Keys {
    pub fn add_motion<P: Iterator<Item = Pose>>(&mut self, node: usize, poses: impl Fn() -> P) {
        if let Some(track) = tracks::thin(&tracks::translations(poses())) {
            self.add(node, "translation", &track);
        }
        if let Some(track) = tracks::thin(&tracks::rotations(poses())) {
            self.add(node, "rotation", &track);
        }
    }

    pub fn add<const N: usize>(&mut self, node: usize, path: &'static str, track: &Track<N>) {
        let next = self.frame_sets.len();
        let frame_set = *self.frame_sets.entry(track.frames.clone()).or_insert(next);
        let values = &mut self.values[N - 3];
        let channel =
            AnimationChannelOut { node, path, frame_set, byte_offset: values.len(), count: track.values.len() };
        values.extend(track.values.iter().flatten().flat_map(|v| v.to_le_bytes()));
        self.channels.push(channel);
    }

    pub fn write(self, fps: f64, out: &mut GlbOutput) {
        let mut sets: Vec<(usize, Vec<u32>)> = self.frame_sets.into_iter().map(|(f, n)| (n, f)).collect();
        sets.sort();
        let time = |frame: u32| (f64::from(frame) / fps) as f32;
        let bytes: Vec<u8> = sets.iter().flat_map(|(_, f)| f).flat_map(|&f| time(f).to_le_bytes()).collect();
        let view = out.push_view(&bytes, Object::new());
        let mut offset = 0;
        let inputs: Vec<usize> = (sets.iter())
            .map(|(_, frames)| {
                let accessor = json!({
                    "bufferView": view, "byteOffset": offset, "componentType": 5126, "type": "SCALAR",
                    "count": frames.len(), "min": [time(frames[0])], "max": [time(frames[frames.len() - 1])],
                });
                offset += 4 * frames.len();
                out.push("accessors", accessor)
            })
            .collect();
        let views = self.values.map(|bytes| (!bytes.is_empty()).then(|| out.push_view(&bytes, Object::new())));
        let mut samplers = Vec::new();
        let mut channels = Vec::new();
        for channel in self.channels {
            let (view, kind) = if channel.path == "rotation" { (views[1], "VEC4") } else { (views[0], "VEC3") };
            let output = out.push(
                "accessors",
                json!({
                    "bufferView": view, "byteOffset": channel.byte_offset, "componentType": 5126, "type": kind,
                    "count": channel.count,
                }),
            );
            let target = json!({ "node": channel.node, "path": channel.path });
            channels.push(json!({ "sampler": samplers.len(), "target": target }));
            let input = inputs[channel.frame_set];
            let interpolation = if channel.path == "scale" { "STEP" } else { "LINEAR" };
            samplers.push(json!({ "input": input, "output": output, "interpolation": interpolation }));
        }
        out.push("animations", json!({ "name": "pile", "channels": channels, "samplers": samplers }));
    }
}
