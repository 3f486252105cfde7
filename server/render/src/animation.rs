//! The first animation of a file, evaluated at a moment.

use cairn_gltf::Document;
use cairn_gltf::document::{DocumentError, LocalTransform, unit};
use glam::{DQuat, DVec4};
use gltf::animation::{Interpolation, Property};
use gltf::json::animation as json;
use gltf::json::validation::Checked::{Invalid, Valid};
use serde_json::{Value, from_value};
use std::collections::BTreeMap;

struct SampledChannel {
    node: usize,
    path: Property,
    interpolation: Interpolation,
    /// Accessors.
    input: usize,
    output: usize,
}

/// Length of the animation, seconds.
pub fn duration(document: &Document) -> Result<f64, DocumentError> {
    let mut inputs: Vec<usize> = channels(document).iter().map(|c| c.input).collect();
    inputs.sort_unstable();
    inputs.dedup();
    let mut end: f64 = 0.0;
    for input in inputs {
        end = document.vectors::<1>(input)?.last().map_or(end, |[t]| end.max(*t));
    }
    Ok(end)
}

/// Sets the animated nodes' transforms to those at a moment.
pub fn apply(document: &Document, seconds: f64, locals: &mut [LocalTransform]) -> Result<(), DocumentError> {
    Motion::read(document)?.apply(seconds, locals);
    Ok(())
}

/// The keys of all channels, read once.
pub struct Motion {
    tracks: Vec<KeyTrack>,
    /// Keyed moments, by their accessors.
    inputs: BTreeMap<usize, Vec<f64>>,
}

struct KeyTrack {
    channel: SampledChannel,
    /// Those of three components have a zero behind.
    keys: Vec<DVec4>,
}

impl Motion {
    pub fn read(document: &Document) -> Result<Motion, DocumentError> {
        let mut inputs: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        let mut tracks = Vec::new();
        let nodes = document.array("nodes").len();
        for channel in channels(document).into_iter().filter(|channel| channel.node < nodes) {
            if let std::collections::btree_map::Entry::Vacant(slot) = inputs.entry(channel.input) {
                slot.insert(document.vectors::<1>(channel.input)?.into_iter().map(|[t]| t).collect());
            }
            let times = inputs[&channel.input].len();
            if times == 0 {
                continue;
            }
            let keys = match channel.path {
                Property::Rotation => keys::<4>(document, channel.output)?,
                _ => keys::<3>(document, channel.output)?,
            };
            if keys.len() < times * channel.values_per_key() {
                return Err(DocumentError::malformed("accessors", channel.output, "has fewer keys than its times"));
            }
            tracks.push(KeyTrack { channel, keys });
        }
        Ok(Motion { tracks, inputs })
    }

    /// Sets the animated nodes' transforms to those at a moment.
    pub fn apply(&self, seconds: f64, locals: &mut [LocalTransform]) {
        for track in &self.tracks {
            let Some(local) = locals.get_mut(track.channel.node) else { continue };
            let value = track.value(&self.inputs[&track.channel.input], seconds);
            match track.channel.path {
                Property::Translation => local.translation = value.truncate(),
                Property::Scale => local.scale = value.truncate(),
                _ => local.rotation = unit(DQuat::from_vec4(value)),
            }
        }
    }
}

fn keys<const N: usize>(document: &Document, output: usize) -> Result<Vec<DVec4>, DocumentError> {
    let wide = |key: [f64; N]| DVec4::from_array(std::array::from_fn(|c| key.get(c).copied().unwrap_or(0.0)));
    Ok(document.vectors::<N>(output)?.into_iter().map(wide).collect())
}

impl SampledChannel {
    fn values_per_key(&self) -> usize {
        if matches!(self.interpolation, Interpolation::CubicSpline) { 3 } else { 1 }
    }
}

impl KeyTrack {
    /// The value at a moment.
    fn value(&self, times: &[f64], seconds: f64) -> DVec4 {
        let per_key = self.channel.values_per_key();
        let key = |i: usize| self.keys[i];
        let next = times.partition_point(|&t| t <= seconds);
        let before = next.saturating_sub(1);
        if next == 0 || next == times.len() {
            return key(if per_key == 3 { 3 * before + 1 } else { before });
        }
        let span = times[next] - times[before];
        let share = if span > 0.0 { (seconds - times[before]) / span } else { 0.0 };
        match self.channel.interpolation {
            Interpolation::Step => key(before),
            Interpolation::Linear if matches!(self.channel.path, Property::Rotation) => {
                let [from, to] = [before, next].map(|i| unit(DQuat::from_vec4(key(i))));
                DVec4::from(from.slerp(to, share))
            }
            Interpolation::Linear => key(before).lerp(key(next), share),
            Interpolation::CubicSpline => {
                let (s2, s3) = (share * share, share * share * share);
                key(3 * before + 1) * (2.0 * s3 - 3.0 * s2 + 1.0)
                    + key(3 * before + 2) * (span * (s3 - 2.0 * s2 + share))
                    + key(3 * next + 1) * (3.0 * s2 - 2.0 * s3)
                    + key(3 * next) * (span * (s3 - s2))
            }
        }
    }
}

/// The channels that move, turn or scale a node.
fn channels(document: &Document) -> Vec<SampledChannel> {
    let Some(animation) = document.array("animations").first() else { return Vec::new() };
    let list = |key: &str| animation.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let samplers = list("samplers");
    let read = |channel: &Value| -> Option<SampledChannel> {
        let json::Channel { sampler, target, .. } = from_value(channel.clone()).ok()?;
        let sampler: json::Sampler = from_value(samplers.get(sampler.value())?.clone()).ok()?;
        let Valid(path @ (Property::Translation | Property::Rotation | Property::Scale)) = target.path else {
            return None;
        };
        let interpolation = match sampler.interpolation {
            Valid(interpolation) => interpolation,
            Invalid => Interpolation::Linear,
        };
        let (input, output) = (sampler.input.value(), sampler.output.value());
        Some(SampledChannel { node: target.node.value(), path, interpolation, input, output })
    };
    list("channels").iter().filter_map(read).collect()
}
