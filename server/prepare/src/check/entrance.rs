//! Checks of an entrance: nothing else may happen while bodies come in.

use super::Findings;
use cairn_input::params::{Entrance, EntranceKind, EntranceOrder, Params};
use cairn_input::scene::Scene;

/// Bound on the frames of a result, as the schema states it for `output.frames`.
const MOST_FRAMES: f64 = 1e5;

/// What does not go together with an entrance.
pub fn check(scene: &Scene, params: &Params, found: &mut Findings) {
    let entrance = &params.entrance;
    if entrance.kind == EntranceKind::None {
        return;
    }
    let mut refuse = |field: String| {
        let text = format!(
            "{field}: bodies come into the finished pile (entrance), and nothing else may happen; leave one of both out"
        );
        found.problem(field, text);
    };
    for (i, body) in scene.bodies.iter().enumerate() {
        if !body.is_stacked() || body.pinned_until.is_some() {
            refuse(format!("bodies.{i}"));
        }
    }
    for (i, model) in scene.statics.iter().enumerate() {
        if !model.keys.is_empty() {
            refuse(format!("statics.{i}.keyframes"));
        }
    }
    if !scene.emitters.is_empty() {
        refuse("emitters".into());
    }
    if !scene.removals.is_empty() {
        refuse("remove".into());
    }
    if scene.collapse.is_some() {
        refuse("collapse".into());
    }
    if params.control.until.is_some() {
        refuse("control.until".into());
    }
    if params.output.frames.is_some() {
        let text = "output.frames: entrance.start and entrance.duration decide how many frames there are; leave it out";
        found.problem("output.frames", text);
    }
    places(entrance, found);
    let frames = (entrance.start + entrance.duration) * params.output.fps;
    if frames > MOST_FRAMES {
        let text =
            format!("entrance.duration: {frames:.0} frames are too many; give a shorter time or lower output.fps");
        found.problem("entrance.duration", text);
    }
}

/// Where bodies come from, and the line that they follow.
fn places(entrance: &Entrance, found: &mut Findings) {
    if !entrance.source.is_empty() {
        if entrance.source.len() != 3 {
            let text = format!("entrance.source: a place has 3 numbers, not {}; give x, y, z", entrance.source.len());
            found.problem("entrance.source", text);
        }
        if !matches!(entrance.kind, EntranceKind::Pour | EntranceKind::Throw) {
            let text = "entrance.source: bodies come from one place only where they pour or are thrown; leave it out, \
                        or set entrance.kind to \"pour\" or \"throw\"";
            found.problem("entrance.source", text);
        }
    }
    if !entrance.curve.is_empty() {
        if !entrance.curve.len().is_multiple_of(3) || entrance.curve.len() < 6 {
            let text = format!(
                "entrance.curve: {} numbers are no line; give x, y, z of two points or more",
                entrance.curve.len()
            );
            found.problem("entrance.curve", text);
        }
        if entrance.order != EntranceOrder::Along {
            let text = "entrance.curve: only the order along follows a line; set entrance.order to \"along\", or leave \
                        the line out";
            found.problem("entrance.curve", text);
        }
    }
}
