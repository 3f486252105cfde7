//! Checks of an entrance: nothing else may happen while bodies come in.

use super::Findings;
use crate::input::params::{EntranceKind, Params};
use crate::input::scene::Scene;

/// Bound on the frames of a result, as the schema states it for `output.frames`.
const MOST_FRAMES: f64 = 1e5;

/// What does not go together with an entrance.
pub fn check(scene: &Scene, params: &Params, found: &mut Findings) {
    let entrance = &params.entrance;
    if entrance.kind == EntranceKind::None {
        return;
    }
    let mut refuse = |field: String, why: &str| {
        let text = format!("{field}: {why}; leave it out, or leave entrance out");
        found.problem(field, text);
    };
    let pile = "bodies come into the finished pile (entrance), and nothing else may happen";
    for (i, body) in scene.bodies.iter().enumerate() {
        if !body.is_stacked() || body.pinned_until.is_some() {
            refuse(format!("bodies.{i}"), pile);
        }
    }
    for (i, model) in scene.statics.iter().enumerate() {
        if !model.keys.is_empty() {
            refuse(format!("statics.{i}.keyframes"), pile);
        }
    }
    if !scene.emitters.is_empty() {
        refuse("emitters".into(), pile);
    }
    if !scene.removals.is_empty() {
        refuse("remove".into(), pile);
    }
    if params.control.until.is_some() {
        refuse("control.until".into(), pile);
    }
    if params.output.frames.is_some() {
        refuse("output.frames".into(), "entrance.start and entrance.duration decide how many frames there are");
    }
    let frames = (entrance.start + entrance.duration) * params.output.fps;
    if frames > MOST_FRAMES {
        let text = format!("entrance.duration: more than {MOST_FRAMES} frames; give less, or fewer output.fps");
        found.problem("entrance.duration", text);
    }
}
