//! The decision on all effects of a bake, made once, from the scene, the user's switches and the props' shapes.

use super::table::ROWS;
use super::{Decision, Effect, EffectDefinition, EffectInputs, EffectName, ForcedBy};
use crate::check::CheckedScene;
use crate::extremes;
use cairn_engine::shape::{ShapeKind, ShapeSummary};
use cairn_input::params::{ControlMode, Params, Physics, Switch};
use cairn_input::scene::Scene;

/// The decided effects: the stages of a bake obey these.
#[derive(Clone, Debug, PartialEq)]
pub struct Resolved {
    /// One for each [`EffectName`], in that order.
    pub effects: Vec<Effect>,
    /// The engine's settings for release and hold: contacts as stiff as the masses ask for, and the substeps that those
    /// need.
    pub physics: Physics,
    /// Heaviest body of the pile over the lightest.
    pub mass_ratio: f64,
    /// Smallest thickness that a body may have, in d.
    pub thickness: f64,
    /// Some prop has several convex parts.
    pub compounds: bool,
    /// The most that a glue joint carries, in weights of the median prop; 0: nothing is glued.
    pub glue_bound: f64,
}

impl Resolved {
    /// `summaries`: one per prop.
    pub fn new(scene: &Scene, params: &Params, checked: &CheckedScene, summaries: &[ShapeSummary]) -> Resolved {
        let mass_ratio = extremes::mass_ratio(scene, params, |prop| summaries[prop].mass);
        let thickness = extremes::least_thickness(scene, params, |prop| summaries[prop].thickness) / checked.diameter;
        let stiffened = extremes::stiffened(&params.physics, mass_ratio, thickness);
        let physics = extremes::calmed(&stiffened, thickness, checked.characteristic_time(params));
        let fills = scene.is_filled(params);
        let glue_bound = scene.glue_bound(params);
        let inputs = EffectInputs {
            scene,
            params,
            engine: &params.physics.switches,
            effects: &params.effects,
            checked,
            summaries,
            fills,
            control: if glue_bound > 0.0 { ControlMode::Off } else { params.control.mode },
            glue_bound,
            physics: &physics,
            mass_ratio,
            stiffens: stiffened != params.physics,
        };
        Resolved {
            effects: ROWS.iter().map(|row| effect(row, &inputs)).collect(),
            mass_ratio,
            thickness,
            glue_bound,
            compounds: summaries.iter().any(|prop| prop.kind == ShapeKind::Parts),
            physics,
        }
    }

    pub fn is_on(&self, name: EffectName) -> bool {
        self.effects[name as usize].on
    }
}

fn effect(row: &EffectDefinition, inputs: &EffectInputs) -> Effect {
    let (switch, word) = match row.switch {
        ForcedBy::Never => (None, Switch::Auto),
        ForcedBy::ByValue(field) => (Some(field), Switch::Auto),
        ForcedBy::By(field, word) => (Some(field), word(inputs)),
    };
    let field = switch.unwrap_or_default();
    let (on, reason) = match ((row.decide)(inputs), word) {
        (Decision::Useless(why), _) | (Decision::No(why), Switch::Auto) => (false, why),
        (Decision::Yes(why), Switch::Auto) => (true, why),
        (_, Switch::On) => (true, format!("switched on by {field}")),
        (_, Switch::Off) => (false, format!("switched off by {field}")),
    };
    Effect { name: row.name, on, reason, switch: switch.map(str::to_owned), counters: row.counts.to_vec() }
}
