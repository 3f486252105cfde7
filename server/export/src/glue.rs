//! The glue of a pile as results have it: SI units, poses of the last frame.

use cairn_core::report::{BakedGlue, BakedGlueDot};
use cairn_gltf::document::Object;
use serde_json::{Value, json};

/// The key of Cairn's entries in a node's extras.
pub const KEY: &str = "cairn";

/// The glue of the whole pile.
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

/// The cluster and the anchoring of a body.
#[derive(Clone, Copy, Default, PartialEq)]
pub struct GlueMembership {
    /// The number of its cluster.
    pub cluster: Option<usize>,
    pub anchored: bool,
}

impl GlueMembership {
    /// The membership of each of the `bodies` bodies.
    pub fn all(glue: &BakedGlue, bodies: usize) -> Vec<GlueMembership> {
        let mut held = vec![GlueMembership::default(); bodies];
        for (number, members) in glue.clusters.iter().enumerate() {
            members.iter().for_each(|&body| held[body].cluster = Some(number));
        }
        glue.anchored.iter().for_each(|&body| held[body].anchored = true);
        held
    }

    /// Adds the membership to the extras of the body's node, unless the body is free. Extras that are not an object are
    /// kept as the member `value`.
    pub fn add_to(self, node: &mut Object) {
        if self == GlueMembership::default() {
            return;
        }
        let mut extras = match node.remove("extras") {
            Some(Value::Object(extras)) => extras,
            Some(value) => Object::from_iter([("value".to_string(), value)]),
            None => Object::new(),
        };
        extras.insert(KEY.into(), json!({ "cluster": self.cluster, "anchored": self.anchored }));
        node.insert("extras".into(), extras.into());
    }
}
