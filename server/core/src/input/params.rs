//! Every parameter of a bake: meaning, unit, range, default and why. The one home of defaults.
//!
//! Lengths called *relative* are in units of `d`, the median prop diameter (bounding sphere), or of
//! a prop's thickness where said so; times called *natural* are in units of `t = sqrt(d / g)`. A pile
//! of 1 cm props and one of 1 m props therefore take the same steps (Hsu & Keyser 2012, Table 1, holds for one size).

mod fill;
mod presets;
mod ranges;
mod switches;

pub use fill::{Fill, FillMethod, FillTraits, Layout, Mixture, SortBy};
pub use switches::{ControlSwitches, PhysicsSwitches, Switch};

/// The parameters of a bake. [`Params::new`] gives an accuracy preset's; every field may be changed.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Params {
    /// Seeds every random choice. Default 1.
    pub seed: u64,
    /// The preset that the rest was derived from.
    pub accuracy: Accuracy,
    /// Gravity along -Y, m/s^2, 0.01 to 1000. Default 9.81.
    pub gravity: f64,
    /// Whether there is a ground. Default: yes.
    pub ground: bool,
    /// Friction of the ground, 0 to 2. Default 0.7.
    pub ground_friction: f64,
    /// Height of the ground, metres. `None`: the control mesh's lowest point.
    pub ground_height: Option<f64>,
    pub physics: Physics,
    pub base: Base,
    pub fill: Fill,
    pub release: Release,
    pub glue: Glue,
    pub control: Control,
    pub hold: Hold,
    pub output: Output,
    pub report: Figures,
    /// Steps are watched, and taken again where they fail.
    pub guard: Switch,
}

/// A named, complete set of parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Accuracy {
    /// Hsu & Keyser's Table 1, literal and in SI.
    Paper,
    Draft,
    Preview,
    Standard,
    Fine,
    Reference,
}

impl Accuracy {
    /// From the quickest to the most accurate; the paper's setting stands beside them.
    pub const LADDER: [Accuracy; 5] =
        [Accuracy::Draft, Accuracy::Preview, Accuracy::Standard, Accuracy::Fine, Accuracy::Reference];
}

/// How the engine steps.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Physics {
    /// One step. Default 0.05 natural times (1/63 s for a prop of 1 m).
    pub step: Time,
    /// Solver substeps per step, 1 to 64. More hold higher stacks; cost grows in proportion.
    pub substeps: u32,
    /// Contact spring frequency, per natural time, for bodies a tenth as thick as wide; see [`Physics::stiffness`].
    /// Stiffer sinks less, and holds fewer bodies.
    pub contact_frequency: f64,
    /// Contact spring damping ratio. Below 10, loaded piles creep.
    pub contact_damping_ratio: f64,
    pub friction_model: FrictionModel,
    /// Rolling and spinning resistance of the props that are round, as a share of the radius on which they roll, 0 to 1. Default
    /// 0.02: wood on wood. Props that are not round have none, and cost nothing.
    pub rolling_resistance: f64,
    /// Deviation allowed between a prop's mesh and its collision shape, relative to the prop's
    /// bounding diameter, 0.001 to 0.5. The shape also leaves out corners that add at most a tenth to its deviation, or half of
    /// this share of the prop's thickness.
    pub shape_tolerance: f64,
    /// Convex parts that a nonconvex prop may be split into, 1 to 64.
    pub max_parts: u32,
    pub switches: PhysicsSwitches,
}

/// The thickness, in d, that `contact_frequency` is meant for, and the largest factor for thinner bodies.
const THIN: (f64, f64) = (0.1, 5.0);
/// A contact spring is stable up to this share of the substeps' rate.
const STABLE_PER_SUBSTEP: f64 = 0.25;
/// A stack of such springs is calm up to this share: beyond it, a tall one bobs for ever and walks, until it falls.
const CALM_PER_SUBSTEP: f64 = 0.14;
/// As the range of `substeps`.
const MOST_SUBSTEPS: u32 = 64;

impl Physics {
    /// The frequency of the contact springs, per natural time, where the thinnest body has this thickness (in d). A body sinks in
    /// by g / omega^2: thin ones are given stiffer springs, so that it is the same share of their thickness.
    pub fn stiffness(&self, thickness: f64) -> f64 {
        self.contact_frequency * (THIN.0 / thickness).sqrt().clamp(1.0, THIN.1)
    }

    /// The substeps that contacts of this frequency need in a step of this length, natural times, and at least `substeps`.
    pub fn substeps_for(&self, frequency: f64, step: f64) -> u32 {
        self.substeps.max(substeps(frequency * step / STABLE_PER_SUBSTEP))
    }

    /// The same for a pile that is to stand.
    pub fn calm_substeps_for(&self, frequency: f64, step: f64) -> u32 {
        self.substeps.max(substeps(frequency * step / CALM_PER_SUBSTEP))
    }
}

fn substeps(needed: f64) -> u32 {
    (needed.ceil() as u32).min(MOST_SUBSTEPS)
}

/// A duration in one of the two clocks.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Time {
    /// Multiples of sqrt(d / g): follows the props' size.
    Natural(f64),
    /// Seconds, whatever the size.
    Seconds(f64),
}

impl Time {
    /// In seconds, given the natural time.
    pub fn seconds(self, natural_time: f64) -> f64 {
        match self {
            Time::Natural(t) => t * natural_time,
            Time::Seconds(s) => s,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum FrictionModel {
    /// One friction constraint per contact patch, and a twist.
    Simplified,
    /// One friction constraint per contact point.
    Coulomb,
}

/// How the control mesh stands on the ground.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Base {
    /// Faces within this height above the ground count as the base, as a share of the control mesh's height,
    /// 0.001 to 0.5. Default 0.02.
    pub height: f64,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Release {
    /// Height of a layer, relative to d.
    pub layer: f64,
    /// From one layer's release to the next.
    pub interval: Time,
    /// Linear and angular damping of every released body, per natural time. Default 0.
    pub damping: f64,
    pub order: ReleaseOrder,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum ReleaseOrder {
    BottomUp,
    TopDown,
    /// All layers together, at frame 0.
    AtOnce,
}

/// Dots that join bodies where friction cannot carry them.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Glue {
    pub mode: GlueMode,
    /// The most that a dot carries in the equilibrium for which it is placed, in weights of the median prop; `None`: as `mode` says.
    pub strength: Option<f64>,
    /// Friction counts by this factor where dots are placed, 0.05 to 1. Default 0.5: at 1, piles balance on paper by wedging, and fall.
    pub friction_factor: f64,
    /// What a normal force costs there, against a dot's force as 1, 0 to 1. Default 0.02: at 0, bodies wedge each other.
    pub normal_price: f64,
    /// Rounds in which dots that carry little are made dearer, 2 to 7: fewer are sooner done, and leave more dots. Default 7.
    pub rounds: u32,
    /// Whether bodies may be glued to the ground and to scenery. On: all that touch it are.
    pub anchor: Switch,
    /// A dot breaks beyond this many times its load of the beginning, 1 to 1e6. Default 4.
    pub breaking: f64,
    /// Whether the glued pile is let go before, to see that it stands. On: tilted, too. Off: not at all. Auto: on but at
    /// `draft`.
    pub proof: Switch,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum GlueMode {
    /// As modelled where a control mesh is filled and bodies are held, natural else and for `paper`.
    Auto,
    /// Nothing is glued.
    Natural,
    /// Dots of bounded strength: what they cannot carry falls.
    Tacky,
    /// Dots of any strength: the pile keeps its shape.
    AsModelled,
}

/// Strength of a dot where `tacky` is not given another, in weights of the median prop.
const TACKY: f64 = 5.0;

impl Params {
    /// The most that a dot of glue carries, in weights of the median prop: 0 where nothing is glued. `fills`: a control mesh is filled.
    pub fn glue_bound(&self, fills: bool) -> f64 {
        self.glue.bound(fills && self.control.mode == ControlMode::Freeze)
    }
}

impl Glue {
    /// The most that a dot carries, in weights of the median prop: 0 where nothing is glued. `fills`: a control mesh is filled, and
    /// the pile is held meanwhile.
    fn bound(&self, fills: bool) -> f64 {
        match self.mode {
            GlueMode::Natural => 0.0,
            GlueMode::Auto if self.strength.is_none() && !fills => 0.0,
            GlueMode::Auto | GlueMode::AsModelled => self.strength.unwrap_or(f64::INFINITY),
            GlueMode::Tacky => self.strength.unwrap_or(TACKY),
        }
    }
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Control {
    pub mode: ControlMode,
    /// Steps of one control cycle, 1 to 1000.
    pub period: u32,
    pub selection: ContactSelection,
    pub friction_reserve: FrictionReserve,
    pub friction_cone: FrictionCone,
    /// mu_k / mu_s, 0 to 1. Default 6/7 (Table 1).
    pub kinetic_ratio: f64,
    /// Gap up to which two bodies count as touching, as a share of the thinner one's thickness.
    pub contact_tolerance: f64,
    pub spread: Spread,
    pub neighbours: Neighbours,
    /// A candidate is held only below this speed, in d per natural time.
    pub speed: f64,
    /// Linear and angular damping of released bodies that are not held, per natural time.
    pub damping: f64,
    /// A nail breaks when the impulse it transmits in 1/240 s exceeds this, N s per kg of the lighter body
    /// (paper: 5).
    pub kappa: f64,
    /// Nails that a body may have at most, 1 to 1000. Default 1: more over-determine a pile of rigid bodies, and it creeps. The
    /// preset `paper` nails every pair.
    pub nails_per_body: u32,
    /// When the control ends, s after frame 0; `None`: with the bake.
    pub until: Option<f64>,
    /// The control ends gently: at `until`, or when the pile is at rest. Auto: where a control mesh is filled and nothing is glued.
    pub stand: Switch,
    pub switches: ControlSwitches,
}

/// The paper's kappa is an impulse per kg over this time (s): its step.
const KAPPA_TIME: f64 = 1.0 / 240.0;

impl Control {
    /// Force per mass at which a support breaks, in weights.
    pub fn break_limit(&self, gravity: f64) -> f64 {
        self.kappa / KAPPA_TIME / gravity
    }
}

/// What is done with the bodies that may be held until the next verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum ControlMode {
    Off,
    /// The paper's: a breakable constraint between each pair.
    Nails,
    /// `hold` in a scene file: a frozen body takes no part in the solver until its next verdict.
    Freeze,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum ContactSelection {
    /// Only contacts whose normal points upward (paper, 3.2).
    Conservative,
    All,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum FrictionReserve {
    /// The solver's forces are tested against mu_k (Eq. 5, literal).
    Paper,
    /// Forces exist that satisfy mu_k.
    Sharp,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum FrictionCone {
    /// The paper's four-sided pyramid (Eq. 2, 4).
    Pyramid,
    /// sqrt(ft1^2 + ft2^2) <= mu fn.
    Cone,
}

/// How far apart a candidate's contacts must be.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Spread {
    /// Eq. 6 with alpha in m^2, in the order of the contacts.
    Paper(f64),
    /// The area of the contacts' convex hull, as a share of the body's own smallest face area
    /// (the product of its two smallest extents).
    Relative(f64),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Neighbours {
    /// A body is held when all that it touches are candidates (S_c a subset of C).
    All,
    /// A pair is held when both are candidates.
    Either,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Hold {
    /// Longest time from the last release, drop or impact until the pile is declared restless, natural times.
    pub patience: f64,
    /// The bake goes on for at least this long after that, s, even if the pile rests before. Default 0.
    pub least: f64,
}

/// What the report measures of the finished pile.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Figures {
    /// Shape against the control mesh. Auto: wherever there is one.
    pub shape: Switch,
    /// Silhouettes and top surface; with `shape` only. Auto: not at `draft`.
    pub pictures: Switch,
    /// `unsupported_fraction`. Auto: from `standard` on, where nothing is glued.
    pub support: Switch,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Output {
    /// Frames per second, 1 to 1000. Default 24.
    pub fps: f64,
    /// Frames after frame 0; `None`: until the pile is at rest.
    pub frames: Option<u32>,
    /// Also measure `free_standing_fraction` and what the engine leaves unbalanced (a further simulation).
    pub free_standing: bool,
    /// Also measure `free_pour_fraction`, per prop by weight (a further simulation).
    pub free_pour: bool,
    /// Off: the result is the final pose alone.
    pub keeps_frames: Switch,
}
