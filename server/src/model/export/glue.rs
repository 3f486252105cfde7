//! The glue of a pile, as results tell it: SI, where the bodies are at the last frame.

use cairn_core::report::{BakedGlue, BakedGlueDot};
use serde_json::{Map, Value, json};

/// Below this name, a node's extras have what Cairn tells of it.
pub const KEY: &str = "cairn";

/// All of it.
pub fn whole(glue: &BakedGlue) -> Value {
    let dot = |dot: &BakedGlueDot| {
        json!({
            "bodies": [dot.body, dot.other], "point": dot.point, "normal": dot.normal, "force": dot.force,
            "moment": dot.moment, "broken": dot.is_broken,
        })
    };
    let dots: Vec<Value> = glue.dots.iter().map(dot).collect();
    json!({ "dots": dots, "clusters": glue.clusters, "anchored": glue.anchored })
}

/// What it does to each of so many bodies; `None` where it holds none.
pub fn of_bodies(glue: Option<&BakedGlue>, bodies: usize) -> Vec<Option<Value>> {
    let mut told = vec![None; bodies];
    let Some(glue) = glue else { return told };
    let clusters = glue.clusters.iter().enumerate().flat_map(|(k, members)| members.iter().map(move |&id| (id, k)));
    for (id, cluster) in clusters {
        told[id] = Some(json!({ "cluster": cluster, "anchored": false }));
    }
    for &id in &glue.anchored {
        let cluster = told[id].as_ref().map_or(Value::Null, |told| told["cluster"].clone());
        told[id] = Some(json!({ "cluster": cluster, "anchored": true }));
    }
    told
}

/// Adds it to a node's own extras. Where those are no object, they stand beside it as `value`.
pub fn add_to(node: &mut Map<String, Value>, told: Value) {
    let mut extras = match node.remove("extras") {
        Some(Value::Object(extras)) => extras,
        Some(value) => Map::from_iter([("value".to_string(), value)]),
        None => Map::new(),
    };
    extras.insert(KEY.into(), told);
    node.insert("extras".into(), extras.into());
}
