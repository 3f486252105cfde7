//! What a bake simulates: decided here, once, from the scene, the user's word and the props' shapes.

use super::EffectName;
use crate::input::params::{Accuracy, ControlMode, FrictionModel, Params, Physics, ReleaseOrder, Switch};
use crate::input::scene::Scene;
use crate::prepare::check::CheckedScene;
use crate::prepare::container;
use crate::prepare::extremes;
use crate::prepare::shape::{ShapeKind, ShapeSummary};
use std::collections::{BTreeMap, BTreeSet};
use strum::VariantArray;

/// The effects as they will be: what the stages of a bake obey.
#[derive(Clone, Debug, PartialEq)]
pub struct Resolved {
    on: BTreeSet<EffectName>,
    /// The user's word, where there is one that counts.
    words: BTreeMap<EffectName, Switch>,
    /// The engine's settings for release and hold: contacts as stiff as the masses ask for, and the substeps that those need.
    pub physics: Physics,
    /// Heaviest body of the pile over the lightest.
    pub mass_ratio: f64,
    /// Smallest thickness that a body may have, in d.
    pub thickness: f64,
    /// Some prop has several convex parts.
    pub compounds: bool,
    /// The most that a dot of glue carries, in weights of the median prop; 0: nothing is glued.
    pub glue_bound: f64,
}

impl Resolved {
    /// `summaries`: one per prop.
    pub fn new(scene: &Scene, params: &Params, checked: &CheckedScene, summaries: &[ShapeSummary]) -> Resolved {
        let mass_ratio = extremes::mass_ratio(scene, params, |prop| summaries[prop].mass);
        let thickness = extremes::least_thickness(scene, params, |prop| summaries[prop].thickness) / checked.diameter;
        let natural_time = (checked.diameter / params.gravity).sqrt();
        let stiffened = extremes::stiffened(&params.physics, mass_ratio, thickness);
        let physics = extremes::calmed(&stiffened, thickness, natural_time);
        let case = Case { scene, params, checked, summaries, is_stiff: stiffened != params.physics };
        let is_on = |&&name: &&EffectName| case.word(name).is_on(case.calls_for(name));
        let words = EffectName::VARIANTS.iter().map(|&name| (name, case.word(name)));
        Resolved {
            on: EffectName::VARIANTS.iter().filter(is_on).copied().collect(),
            words: words.filter(|(_, word)| *word != Switch::Auto).collect(),
            physics,
            mass_ratio,
            thickness,
            glue_bound: params.glue_bound(scene.is_filled(params)),
            compounds: summaries.iter().any(|summary| summary.kind == ShapeKind::Parts),
        }
    }

    pub fn is_on(&self, name: EffectName) -> bool {
        self.on.contains(&name)
    }

    /// The user's word on an effect.
    pub fn word(&self, name: EffectName) -> Switch {
        self.words.get(&name).copied().unwrap_or_default()
    }
}

/// What the decisions rest on.
struct Case<'a> {
    scene: &'a Scene,
    params: &'a Params,
    checked: &'a CheckedScene,
    summaries: &'a [ShapeSummary],
    is_stiff: bool,
}

impl Case<'_> {
    /// Whether the scene and its parameters call for an effect.
    fn calls_for(&self, name: EffectName) -> bool {
        let Case { scene, params, checked, summaries, is_stiff } = *self;
        let glues = self.glues();
        // What is glued stands without being held.
        let is_controlled = params.control.mode != ControlMode::Off && !glues;
        let freezes = is_controlled && params.control.mode == ControlMode::Freeze;
        let fill = scene.is_filled(params);
        match name {
            EffectName::Primitives => summaries.iter().any(|n| matches!(n.kind, ShapeKind::Box | ShapeKind::Ball)),
            EffectName::Decomposition => summaries.iter().any(|n| n.kind == ShapeKind::Parts),
            EffectName::Fill | EffectName::TurnOver => fill,
            EffectName::Core => checked.core.is_some(),
            EffectName::Depenetration => fill && params.fill.residual_overlap < 1.0,
            EffectName::WallSimplification => {
                let closed = checked.control.as_ref().filter(|_| fill && params.fill.wall_tolerance > 0.0);
                closed.is_some_and(|closed| container::has_fine_walls(&closed.topology, checked.diameter))
            }
            EffectName::Glue => glues,
            EffectName::GlueProof => glues && params.glue.proof.is_on(params.accuracy != Accuracy::Draft),
            EffectName::StagedRelease => params.release.order != ReleaseOrder::AtOnce && !glues,
            EffectName::Scenery => !scene.statics.is_empty(),
            EffectName::Bodies => !scene.bodies.is_empty(),
            EffectName::Emitters => !scene.emitters.is_empty(),
            EffectName::FrictionPerPoint => params.physics.friction_model == FrictionModel::Coulomb,
            EffectName::Restitution => scene.props.iter().any(|prop| prop.restitution > 0.0),
            EffectName::RollingResistance => {
                params.physics.rolling_resistance > 0.0 && checked.sizes.iter().any(|size| size.round.is_some())
            }
            EffectName::StiffContacts => is_stiff,
            EffectName::ContinuousCollision
            | EffectName::Guard
            | EffectName::SameOnAllMachines
            | EffectName::Frames => true,
            EffectName::Control | EffectName::Analysis => is_controlled,
            EffectName::Breaking => is_controlled || glues && scene.something_hits(),
            EffectName::KeptVerdicts => freezes,
            EffectName::Region => (is_controlled || glues) && scene.target().is_some(),
            EffectName::Nails => is_controlled && params.control.mode == ControlMode::Nails,
            EffectName::Impact => freezes && scene.something_hits(),
            // What is to happen later needs the control until then.
            EffectName::Stand => freezes && fill && params.control.until.is_none() && !scene.something_hits(),
            EffectName::ShapeFigures => scene.target().is_some(),
            EffectName::PictureFigures => scene.target().is_some() && params.accuracy != Accuracy::Draft,
            EffectName::SupportFigures => {
                let is_rough = matches!(params.accuracy, Accuracy::Draft | Accuracy::Preview);
                !glues && !is_rough || params.output.free_standing
            }
            EffectName::FreeStanding => params.output.free_standing,
            EffectName::FreePour => params.output.free_pour,
        }
    }

    fn glues(&self) -> bool {
        self.params.glue_bound(self.scene.is_filled(self.params)) > 0.0
    }

    /// The user's word on an effect. What nothing is controlled or held for stays off, whatever it is forced to.
    fn word(&self, name: EffectName) -> Switch {
        let Case { scene, params, .. } = *self;
        let (physics, control) = (&params.physics.switches, &params.control.switches);
        let freezes = params.control.mode == ControlMode::Freeze && !self.glues();
        match name {
            EffectName::KeptVerdicts | EffectName::Impact if !freezes => Switch::Auto,
            EffectName::Region if scene.target().is_none() => Switch::Auto,
            EffectName::ShapeFigures if scene.target().is_none() => Switch::Auto,
            EffectName::ShapeFigures => params.report.shape,
            EffectName::PictureFigures if scene.target().is_none() => Switch::Auto,
            EffectName::PictureFigures if params.report.shape == Switch::Off => Switch::Off,
            EffectName::PictureFigures => params.report.pictures,
            EffectName::SupportFigures => params.report.support,
            EffectName::Region | EffectName::Breaking if params.control.mode == ControlMode::Off && !self.glues() => {
                Switch::Auto
            }
            EffectName::Primitives => physics.primitives,
            EffectName::Decomposition => physics.decomposition,
            EffectName::ContinuousCollision => physics.continuous_collision,
            EffectName::Restitution => physics.restitution,
            EffectName::RollingResistance => physics.rolling_resistance,
            EffectName::StiffContacts => physics.stiff_contacts,
            EffectName::Guard => params.guard,
            EffectName::KeptVerdicts => control.kept_verdicts,
            EffectName::Region => control.region,
            EffectName::Breaking => control.breaking,
            EffectName::Impact => control.impact,
            EffectName::Stand if params.control.mode == ControlMode::Off || self.glues() => Switch::Auto,
            EffectName::Stand => params.control.stand,
            EffectName::Frames => params.output.keeps_frames,
            // These have parameters of their own, or follow from the scene alone.
            EffectName::Fill
            | EffectName::Core
            | EffectName::WallSimplification
            | EffectName::Depenetration
            | EffectName::TurnOver
            | EffectName::Glue
            | EffectName::GlueProof
            | EffectName::StagedRelease
            | EffectName::Scenery
            | EffectName::Bodies
            | EffectName::Emitters
            | EffectName::FrictionPerPoint
            | EffectName::SameOnAllMachines
            | EffectName::Control
            | EffectName::Analysis
            | EffectName::Nails
            | EffectName::FreeStanding
            | EffectName::FreePour => Switch::Auto,
        }
    }
}
