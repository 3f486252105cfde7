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
    if params.control.until.is_some() {
        refuse("control.until".into());
    }
    if params.output.frames.is_some() {
        let text = "output.frames: entrance.start and entrance.duration decide how many frames there are; leave it out";
        found.problem("output.frames", text);
    }
    let frames = (entrance.start + entrance.duration) * params.output.fps;
    if frames > MOST_FRAMES {
        let text =
            format!("entrance.duration: {frames:.0} frames are too many; give a shorter time or lower output.fps");
        found.problem("entrance.duration", text);
    }
}
