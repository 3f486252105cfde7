//! Why each effect is on or off, in a sentence for a person.

use super::{EffectName, Resolved};
use crate::input::params::{ControlMode, FillMethod, FrictionCone, FrictionModel, GlueMode, Params, ReleaseOrder};
use crate::input::scene::Scene;
use crate::prepare::check::CheckedScene;
use crate::prepare::container;
use crate::prepare::shape::{ShapeKind, ShapeSummary};

/// What the sentences tell of.
pub struct Reasons<'a> {
    pub scene: &'a Scene,
    pub params: &'a Params,
    pub checked: &'a CheckedScene,
    /// One per prop.
    pub summaries: &'a [ShapeSummary],
    pub resolved: &'a Resolved,
}

impl Reasons<'_> {
    /// Why the scene calls for an effect, or does not.
    pub fn of(&self, name: EffectName) -> String {
        match name {
            EffectName::Primitives => self.listed_props("box or ball: ", "no prop is a box or a ball", |i| {
                matches!(self.summaries[i].kind, ShapeKind::Box | ShapeKind::Ball)
            }),
            EffectName::Decomposition => self.decomposition(),
            EffectName::Fill => self.fill().into(),
            EffectName::Core => self.core(),
            EffectName::WallSimplification => self.walls(),
            EffectName::Depenetration => self.depenetration(),
            EffectName::TurnOver if self.resolved.is_on(name) => "the container is filled upside down".into(),
            EffectName::TurnOver => "there is no fill".into(),
            EffectName::Glue => self.glue(),
            EffectName::GlueProof => match self.resolved.is_on(name) {
                true => "the glued pile is let go first, to see that it stands".into(),
                false => "nothing is glued, or it is not let go at this accuracy".into(),
            },
            EffectName::Scenery => self.scenery(),
            EffectName::Bodies => match self.scene.bodies.len() {
                0 => "no body is placed by hand".into(),
                n => format!("placed by hand: {n}"),
            },
            EffectName::Emitters => match self.scene.emitters.len() {
                0 => "there is no emitter".into(),
                n => format!("where bodies appear: {n}"),
            },
            EffectName::ContinuousCollision => {
                "whatever moves by more than half of its thickness in a step is swept along its way, while it does; of several \
                 parts, its contacts are found a step ahead"
                    .into()
            }
            EffectName::FrictionPerPoint => match self.params.physics.friction_model {
                FrictionModel::Simplified => "one friction force per contact patch is enough at this accuracy".into(),
                FrictionModel::Coulomb => "one friction force per contact point".into(),
            },
            EffectName::Restitution => {
                self.listed_props("bounces: ", "no prop bounces", |i| self.scene.props[i].restitution > 0.0)
            }
            EffectName::RollingResistance => self.rolling(),
            EffectName::StiffContacts => self.stiffness(),
            EffectName::Guard => "every step is watched, which costs less than one in a hundred".into(),
            EffectName::SameOnAllMachines => "the engine's arithmetic is the same on every processor".into(),
            EffectName::Control | EffectName::Analysis | EffectName::StagedRelease | EffectName::KeptVerdicts
                if self.resolved.is_on(EffectName::Glue) =>
            {
                "what is glued stands without being held, and is let go at once".into()
            }
            EffectName::StagedRelease => self.release().into(),
            EffectName::Control
            | EffectName::Analysis
            | EffectName::KeptVerdicts
            | EffectName::Region
            | EffectName::Nails
            | EffectName::Breaking
            | EffectName::Impact
            | EffectName::Stand => self.control(name),
            EffectName::Frames => {
                format!("{} per second; without them, the result is the final pose", self.params.output.fps)
            }
            EffectName::ShapeFigures | EffectName::PictureFigures if self.scene.target().is_none() => {
                "there is no control mesh to compare with".into()
            }
            EffectName::ShapeFigures => "the pile is compared with the control mesh".into(),
            EffectName::PictureFigures => match self.resolved.is_on(name) {
                true => "the pile is compared with the control mesh as a camera sees them".into(),
                false => "not at this accuracy, unless asked for".into(),
            },
            EffectName::SupportFigures => match self.resolved.is_on(name) {
                true => "the contacts of the whole pile are weighed at the end".into(),
                false if self.resolved.is_on(EffectName::Glue) => "the glue is certified already".into(),
                false => "not at this accuracy, unless asked for".into(),
            },
            EffectName::FreeStanding | EffectName::FreePour => match self.resolved.is_on(name) {
                true => "asked for: a further simulation".into(),
                false => "only on request: it is a further simulation".into(),
            },
        }
    }

    /// The names of the props of a kind, after `some`; or `none`.
    fn listed_props(&self, some: &str, none: &str, is: impl Fn(usize) -> bool) -> String {
        let props = self.scene.props.iter().enumerate().filter(|(i, _)| is(*i));
        let names: Vec<&str> = props.map(|(_, prop)| &*prop.model.name).collect();
        if names.is_empty() { none.into() } else { format!("{some}{}", listed(&names)) }
    }

    fn decomposition(&self) -> String {
        let split = |i: usize| self.summaries[i].kind == ShapeKind::Parts;
        let most = format!("; at most {} parts each", self.params.physics.max_parts);
        let some = self.listed_props("nonconvex: ", "", split);
        if some.is_empty() { "one convex shape is near enough to each prop".into() } else { some + &most }
    }

    fn fill(&self) -> &'static str {
        match self.params.fill.method {
            _ if self.scene.control.is_none() => "there is no control mesh",
            FillMethod::Insert => "props grow at free places inside the closed container",
            FillMethod::Pour => "props are dropped through the container's opening",
            FillMethod::Stack => "props are laid down one by one, each as low as it can lie",
            FillMethod::Off => "switched off by the scene",
        }
    }

    fn core(&self) -> String {
        match self.params.fill.shell {
            _ if self.scene.control.is_none() => "there is no control mesh".into(),
            None => "props fill all of the control mesh".into(),
            Some(shell) if self.resolved.is_on(EffectName::Core) => {
                format!("props lie no deeper than {shell} d below the control mesh's surface")
            }
            Some(shell) => format!("no place of the control mesh is deeper than {shell} d"),
        }
    }

    fn walls(&self) -> String {
        let tolerance = self.params.fill.wall_tolerance;
        let closed = self.checked.control.as_ref().filter(|_| self.resolved.is_on(EffectName::Fill));
        match closed.map(|closed| container::has_fine_walls(&closed.topology, self.checked.diameter)) {
            None => "there is no fill".into(),
            Some(false) => "the control mesh is not finer than the props need".into(),
            Some(true) if tolerance == 0.0 => "fill.wall_tolerance is 0".into(),
            Some(true) => {
                format!("the container's walls may be finer than the props need: within {tolerance} d of it")
            }
        }
    }

    fn depenetration(&self) -> String {
        match self.params.fill.residual_overlap {
            _ if !self.resolved.is_on(EffectName::Fill) => "there is no fill".into(),
            1.0 => "what the fill leaves overlapping stays so".into(),
            share => format!("what the fill leaves overlapping by more than {}% is parted", share * 100.0),
        }
    }

    fn glue(&self) -> String {
        match self.resolved.glue_bound {
            0.0 if self.params.glue.mode == GlueMode::Natural => "the pile is to be natural".into(),
            0.0 => "nothing is filled, or the glue has no strength".into(),
            f64::INFINITY => {
                "the pile is to stand as modelled: bodies are glued where friction cannot carry them".into()
            }
            bound => format!("bodies are glued where that takes at most {bound} weights; what needs more falls"),
        }
    }

    fn release(&self) -> &'static str {
        match self.params.release.order {
            ReleaseOrder::BottomUp => "layers are let go from the bottom to the top",
            ReleaseOrder::TopDown => "layers are let go from the top to the bottom",
            ReleaseOrder::AtOnce => "everything is let go at frame 0",
        }
    }

    fn scenery(&self) -> String {
        let moving = self.scene.statics.iter().filter(|m| !m.keys.is_empty()).count();
        match self.scene.statics.len() {
            0 => "there is no geometry besides the ground".into(),
            n => format!("geometry besides the ground: {n}, of which {moving} moving"),
        }
    }

    fn rolling(&self) -> String {
        let resistance = self.params.physics.rolling_resistance;
        let is_round = |i: usize| self.checked.sizes[i].round.is_some();
        match self.listed_props("round: ", "", is_round) {
            names if names.is_empty() => "no prop is round".into(),
            _ if resistance == 0.0 => "physics.rolling_resistance is 0".into(),
            names => format!("{names}; rolling resistance {resistance}"),
        }
    }

    fn stiffness(&self) -> String {
        let Resolved { physics, mass_ratio: ratio, .. } = self.resolved;
        match self.resolved.is_on(EffectName::StiffContacts) {
            true => format!(
                "the masses of the pile differ by {ratio:.0}:1: contact frequency {:.0}, {} substeps",
                physics.contact_frequency, physics.substeps
            ),
            false if *ratio < 1.5 => "the bodies of the pile have about the same mass".into(),
            false => format!("the masses of the pile differ by {ratio:.0}:1, which the contacts carry as they are"),
        }
    }

    /// What keeps the shape.
    fn control(&self, name: EffectName) -> String {
        let control = &self.params.control;
        let mode = control.mode;
        let freezes = mode == ControlMode::Freeze;
        let holding = match mode {
            ControlMode::Off => "switched off by the scene",
            ControlMode::Nails => "certified pairs are nailed together until the next verdict",
            ControlMode::Freeze => "certified bodies are held until the next verdict",
        };
        match name {
            EffectName::Nails if freezes => "bodies are held, not nailed".into(),
            EffectName::Control | EffectName::Nails => holding.into(),
            EffectName::Stand if self.resolved.is_on(name) => {
                "once the pile rests, the control ends gently: what is delivered stands by itself".into()
            }
            EffectName::Stand => "nothing is filled and held to the end, or it is held on purpose".into(),
            _ if mode == ControlMode::Off => "nothing is controlled".into(),
            EffectName::KeptVerdicts | EffectName::Impact if !freezes => "nothing is held".into(),
            EffectName::KeptVerdicts => "a verdict holds until something that it rests on changes".into(),
            EffectName::Impact if self.scene.something_hits() => {
                "something flies, falls or moves, or kept bodies are let go".into()
            }
            EffectName::Impact => "nothing flies in, falls or moves".into(),
            EffectName::Region if self.scene.target().is_some() => "bodies outside are never controlled".into(),
            EffectName::Region => "no region, no test: the control acts everywhere".into(),
            EffectName::Breaking => format!("what carries more than kappa = {} N s per kg lets go", control.kappa),
            _ => match control.friction_cone {
                FrictionCone::Pyramid => "four-sided friction pyramid, as in the paper".into(),
                FrictionCone::Cone => "exact friction cone".into(),
            },
        }
    }
}

/// "a, b and 3 more".
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 3;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    match names.len().checked_sub(SHOWN) {
        None | Some(0) => shown,
        Some(more) => format!("{shown} and {more} more"),
    }
}
