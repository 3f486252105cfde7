//! The instances of an instancer, each a node with its prototype below it; and the channels of what moves.

use super::super::text;
use super::values::{quaternions, unit, vectors};
use super::{Converter, Inherited, Samples};
use cairn_gltf::document::Object;
use openusd::sdf::{ListOp, Path, Value};
use serde_json::json;
use std::collections::HashSet;

/// Instances, times the times at which they come and go.
const MOST_SEEN: usize = 100_000_000;

impl Converter<'_> {
    /// A node for each instance that is seen.
    pub(super) fn instances(&mut self, prim: &Path, inherited: &Inherited, level: usize) -> Result<Vec<usize>, String> {
        let wrong = |what: &str| format!("{}: {what}", prim.as_str());
        let prototypes = self.stage.targets(prim, "prototypes");
        let Some(Value::IntVec(indices)) = self.value(prim, "protoIndices") else {
            return Err(wrong("it has no protoIndices"));
        };
        let count = indices.len();
        let mut positions = self.samples(prim, "positions", vectors).ok_or_else(|| wrong("it has no positions"))?;
        let rotations = (self.samples(prim, "orientationsf", quaternions))
            .or_else(|| self.samples(prim, "orientations", quaternions));
        let mut rotations = rotations.filter(|samples| !samples[0].1.is_empty()).unwrap_or_default();
        let scales = self.samples(prim, "scales", vectors);
        let mut scales = scales.filter(|samples| !samples[0].1.is_empty()).unwrap_or_default();
        let has_all = positions.iter().chain(&scales).take(1).all(|(_, all)| all.len() == count)
            && scales.iter().take(1).all(|(_, all)| all.len() == count)
            && rotations.iter().take(1).all(|(_, all)| all.len() == count);
        if !has_all {
            return Err(wrong("its lists are of different lengths"));
        }
        let before = positions.len() + scales.len() + rotations.len();
        positions.retain(|(_, all)| all.len() == count);
        scales.retain(|(_, all)| all.len() == count);
        rotations.retain(|(_, all)| all.len() == count);
        if positions.len() + scales.len() + rotations.len() < before {
            self.note("its instances come and go, which is left out: those of the start are shown", prim);
        }
        let seen = self.instances_seen(prim, count);
        let of = |samples: &Samples<Vec<[f32; 3]>>, i: usize| -> Samples<[f32; 3]> {
            samples.iter().map(|(time, all)| (*time, all[i])).collect()
        };
        let mut nodes = Vec::with_capacity(count);
        for (i, index) in indices.into_iter().enumerate() {
            let prototype = usize::try_from(index).ok().and_then(|index| prototypes.get(index));
            let prototype = prototype.ok_or_else(|| wrong("protoIndices name a prototype that it does not have"))?;
            let own: Samples<bool> = seen.iter().map(|(time, all)| (*time, all[i])).collect();
            if own.iter().all(|(_, is_seen)| !is_seen) {
                continue;
            }
            let name = format!("{}.{i:04}", prototype.name().unwrap_or_default());
            // What does not depend on the prims above it is in its place below the instance.
            let below = self.prototype(&prototype.clone(), inherited, level + 1)?;
            let mut node = Object::from_iter([("name".to_owned(), json!(name))]);
            let place = self.node(serde_json::Value::Null)?;
            let sizes = shown_sizes(of(&scales, i), &own);
            for (part, samples, interpolation) in
                [("translation", of(&positions, i), "LINEAR"), ("scale", sizes, "STEP")]
            {
                if let Some((_, first)) = samples.first() {
                    node.insert(part.into(), json!(first));
                    self.channel(place, part, interpolation, &samples);
                }
            }
            let turns: Samples<[f32; 4]> = rotations.iter().map(|(time, all)| (*time, unit(all[i]))).collect();
            if let Some((_, first)) = turns.first() {
                node.insert("rotation".into(), json!(first));
                self.channel(place, "rotation", "LINEAR", &turns);
            }
            if !below.is_empty() {
                node.insert("children".into(), json!(below));
            }
            self.out.set("nodes", place, node);
            nodes.push(place);
        }
        Ok(nodes)
    }

    /// Which instances are seen, at the times at which that changes: those that are neither inactive nor invisible. In
    /// results of ours, scales say the same.
    fn instances_seen(&mut self, prim: &Path, count: usize) -> Samples<Vec<bool>> {
        let start = self.clock[0];
        let numbers = |value: Value| match value {
            Value::Int64Vec(all) => Some(all),
            _ => None,
        };
        let inactive = self.inactive(prim);
        let ids = self.value(prim, "ids").and_then(numbers).filter(|ids| ids.len() == count);
        let ids = ids.unwrap_or_else(|| (0..count as i64).collect());
        let own = self.is_ours(prim).then(Samples::new);
        let hidden = own.or_else(|| self.samples(prim, "invisibleIds", numbers));
        let mut hidden = hidden.unwrap_or_default();
        if hidden.is_empty() {
            hidden.push((start, Vec::new()));
        }
        if hidden.len().saturating_mul(count) > MOST_SEEN {
            self.note("its instances come and go, which is left out: those of the start are shown", prim);
            hidden.truncate(1);
        }
        let seen = |hidden: Vec<i64>| {
            let hidden: HashSet<i64> = hidden.into_iter().collect();
            ids.iter().map(|id| !hidden.contains(id) && !inactive.contains(id)).collect()
        };
        hidden.into_iter().map(|(time, hidden)| (time, seen(hidden))).collect()
    }

    /// The instances that are switched off for good: a list that layers edit.
    fn inactive(&self, prim: &Path) -> HashSet<i64> {
        const LIST: &str = "inactiveIds";
        let mut list = match self.field(prim, LIST) {
            Some(Value::Int64ListOp(list)) => list,
            Some(Value::Int64Vec(all)) => ListOp::explicit(all),
            _ => ListOp::default(),
        };
        for edit in text::edits() {
            let Some(Value::Int64Vec(all)) = self.field(prim, &text::edit_of(edit, LIST)) else { continue };
            if edit == "delete" { list.deleted_items.extend(all) } else { list.appended_items.extend(all) }
        }
        let deleted: HashSet<i64> = list.deleted_items.into_iter().collect();
        let all = [list.explicit_items, list.added_items, list.prepended_items, list.appended_items];
        all.into_iter().flatten().filter(|id| !deleted.contains(id)).collect()
    }

    /// A channel of the animation, where anything changes.
    pub(super) fn channel<const N: usize>(&mut self, node: usize, path: &str, how: &str, samples: &Samples<[f32; N]>) {
        if samples.iter().all(|(_, value)| *value == samples[0].1) {
            return;
        }
        let [start, _, rate] = self.clock;
        let seconds: Vec<f32> = samples.iter().map(|(time, _)| ((time - start) / rate) as f32).collect();
        let key: Vec<u64> = samples.iter().map(|(time, _)| time.to_bits()).collect();
        let input = match self.times.get(&key) {
            Some(input) => *input,
            None => {
                let input = self.numbers(&seconds, 1, Some([&seconds[..1], &seconds[seconds.len() - 1..]]));
                self.times.insert(key, input);
                input
            }
        };
        let values: Vec<f32> = samples.iter().flat_map(|(_, value)| *value).collect();
        let output = self.numbers(&values, N, None);
        self.channels.push(json!({ "sampler": self.samplers.len(), "target": { "node": node, "path": path } }));
        self.samplers.push(json!({ "input": input, "output": output, "interpolation": how }));
    }
}

/// The sizes of an instance that is seen at times: where it is not, it has none.
fn shown_sizes(scales: Samples<[f32; 3]>, seen: &Samples<bool>) -> Samples<[f32; 3]> {
    if seen.iter().all(|(_, is_seen)| *is_seen) {
        return scales;
    }
    let mut times: Vec<f64> = scales.iter().map(|one| one.0).chain(seen.iter().map(|one| one.0)).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let (mut scales, mut seen) = (scales.into_iter().peekable(), seen.iter().peekable());
    let (mut scale, mut is_seen) = ([1.0; 3], true);
    let mut sizes = Vec::with_capacity(times.len());
    for time in times {
        while let Some((_, next)) = scales.next_if(|one| one.0 <= time) {
            scale = next;
        }
        while let Some((_, next)) = seen.next_if(|one| one.0 <= time) {
            is_seen = *next;
        }
        sizes.push((time, if is_seen { scale } else { [0.0; 3] }));
    }
    sizes
}
