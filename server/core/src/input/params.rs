//! Every parameter of a bake: meaning, unit, range, default and why. The one home of defaults.
//!
//! Lengths called *relative* are in units of `d`, the median prop diameter (bounding sphere), or of
//! a prop's thickness where said so; times called *natural* are in units of `t = sqrt(d / g)`. A pile
//! of 1 cm props and one of 1 m props therefore take the same steps (method.md, Parameters).

mod switches;

pub use switches::{ControlSwitches, PhysicsSwitches, Switch};

use crate::error::Problem;

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
    pub control: Control,
    pub hold: Hold,
    pub output: Output,
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
    /// bounding diameter, 0.001 to 0.5.
    pub shape_tolerance: f64,
    /// Convex parts that a nonconvex prop may be split into, 1 to 64.
    pub max_parts: u32,
    pub switches: PhysicsSwitches,
}

/// The thickness, in d, that `contact_frequency` is meant for, and the largest factor for thinner bodies.
const THIN: (f64, f64) = (0.1, 5.0);
/// A contact spring is stable up to this share of the substeps' rate, and stiff up to it.
const FREQUENCY_PER_SUBSTEP: f64 = 0.25;
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
        self.substeps.max(((frequency * step / FREQUENCY_PER_SUBSTEP).ceil() as u32).min(MOST_SUBSTEPS))
    }
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
pub struct Fill {
    pub method: FillMethod,
    /// Friction between props while filling, 0 to 2: it decides the density (0 packs densest).
    pub friction: f64,
    /// Number of bodies wanted; `None` fills until full.
    pub count: Option<u32>,
    /// Upper bound on bodies, 1 to 100000. Reaching it is told.
    pub max_bodies: u32,
    /// A round (`insert`) or a batch (`pour`) that adds less than this share of the bodies means full.
    pub full_below: f64,
    /// Settling in the closed container after the last prop, natural times.
    pub settle: f64,
    /// A body may stick out of the control mesh by this much, relative to d; beyond it is removed.
    pub protrusion: f64,
    /// A body may overlap another by this share of the thinner one's thickness; beyond it is removed.
    pub overlap: f64,
    /// The walls of a control mesh that is finer than the props need may be this far from it, relative to d, 0 to 0.5;
    /// 0: they are as they were modelled. Default 0.02.
    pub wall_tolerance: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum FillMethod {
    /// Grown at free places inside the closed container.
    Insert,
    /// Dropped through the opening (Cho et al. 2007).
    Pour,
    /// Not at all: the control mesh only says where the control acts.
    Off,
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
    /// The control ends gently: at `until`, or when the pile is at rest.
    pub stand: bool,
    pub switches: ControlSwitches,
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

impl Params {
    /// The preset's complete parameters.
    pub fn new(accuracy: Accuracy) -> Params {
        let mut params = Params {
            seed: 1,
            accuracy,
            gravity: 9.81,
            ground: true,
            ground_friction: 0.7,
            ground_height: None,
            physics: Physics {
                step: Time::Natural(0.05),
                substeps: 8,
                contact_frequency: 22.0,
                contact_damping_ratio: 10.0,
                friction_model: FrictionModel::Simplified,
                rolling_resistance: 0.02,
                shape_tolerance: 0.04,
                max_parts: 12,
                switches: PhysicsSwitches::default(),
            },
            guard: Switch::Auto,
            base: Base { height: 0.02 },
            fill: Fill {
                method: FillMethod::Insert,
                friction: 0.0,
                count: None,
                max_bodies: 20_000,
                full_below: 0.004,
                settle: 2.2,
                protrusion: 0.05,
                overlap: 0.25,
                wall_tolerance: 0.02,
            },
            release: Release { layer: 0.5, interval: Time::Natural(1.0), damping: 0.0, order: ReleaseOrder::BottomUp },
            control: Control {
                mode: ControlMode::Freeze,
                period: 5,
                selection: ContactSelection::Conservative,
                friction_reserve: FrictionReserve::Sharp,
                friction_cone: FrictionCone::Cone,
                kinetic_ratio: 6.0 / 7.0,
                contact_tolerance: 0.05,
                spread: Spread::Relative(0.05),
                neighbours: Neighbours::Either,
                speed: 0.1,
                damping: 6.4,
                kappa: 5.0,
                nails_per_body: 1,
                until: None,
                stand: false,
                switches: ControlSwitches::default(),
            },
            hold: Hold { patience: 120.0, least: 0.0 },
            output: Output {
                fps: 24.0,
                frames: None,
                free_standing: false,
                free_pour: false,
                keeps_frames: Switch::Auto,
            },
        };
        match accuracy {
            Accuracy::Standard => {}
            Accuracy::Draft => {
                params.physics.substeps = 4;
                params.physics.contact_frequency = 10.0;
            }
            Accuracy::Preview => {
                params.physics.substeps = 6;
                params.physics.contact_frequency = 15.0;
            }
            Accuracy::Fine => {
                params.physics.substeps = 16;
                params.physics.contact_frequency = 30.0;
                params.physics.friction_model = FrictionModel::Coulomb;
                params.physics.shape_tolerance = 0.02;
                params.fill.wall_tolerance = 0.006;
                params.physics.max_parts = 24;
            }
            Accuracy::Reference => {
                params.physics.substeps = 32;
                params.physics.contact_frequency = 30.0;
                params.physics.friction_model = FrictionModel::Coulomb;
                params.physics.shape_tolerance = 0.01;
                params.fill.wall_tolerance = 0.002;
                params.physics.max_parts = 48;
            }
            Accuracy::Paper => {
                params.physics.step = Time::Seconds(1.0 / 240.0);
                params.physics.rolling_resistance = 0.0;
                params.fill.method = FillMethod::Pour;
                params.fill.friction = 0.7;
                params.control = Control {
                    mode: ControlMode::Nails,
                    period: 20,
                    friction_reserve: FrictionReserve::Paper,
                    friction_cone: FrictionCone::Pyramid,
                    spread: Spread::Paper(0.5),
                    neighbours: Neighbours::All,
                    speed: f64::INFINITY,
                    damping: 0.0,
                    nails_per_body: 1000,
                    ..params.control
                };
            }
        }
        params
    }

    /// The engine's settings for the fill: half the substeps, since nothing has to balance there, and
    /// nothing has to stop rolling.
    pub fn fill_physics(&self) -> Physics {
        Physics { substeps: self.physics.substeps.div_ceil(2), rolling_resistance: 0.0, ..self.physics.clone() }
    }

    /// What is out of range, and what to give instead.
    pub fn problems(&self) -> Vec<Problem> {
        let time = |t: Time| match t {
            Time::Natural(t) | Time::Seconds(t) => t,
        };
        let spread = match self.control.spread {
            Spread::Paper(alpha) => alpha,
            Spread::Relative(share) => share,
        };
        let ranges = [
            ("gravity", self.gravity, 0.01, 1000.0),
            ("ground_friction", self.ground_friction, 0.0, 2.0),
            ("ground_height", self.ground_height.unwrap_or(0.0), -1e6, 1e6),
            ("physics.step", time(self.physics.step), 1e-6, 1.0),
            ("physics.substeps", f64::from(self.physics.substeps), 1.0, 64.0),
            ("physics.contact_frequency", self.physics.contact_frequency, 1.0, 1000.0),
            ("physics.contact_damping_ratio", self.physics.contact_damping_ratio, 0.1, 100.0),
            ("physics.rolling_resistance", self.physics.rolling_resistance, 0.0, 1.0),
            ("physics.shape_tolerance", self.physics.shape_tolerance, 0.001, 0.5),
            ("physics.max_parts", f64::from(self.physics.max_parts), 1.0, 64.0),
            ("base.height", self.base.height, 0.001, 0.5),
            ("fill.friction", self.fill.friction, 0.0, 2.0),
            ("fill.count", f64::from(self.fill.count.unwrap_or(1)), 1.0, 100_000.0),
            ("fill.max_bodies", f64::from(self.fill.max_bodies), 1.0, 100_000.0),
            ("fill.full_below", self.fill.full_below, 0.0, 0.5),
            ("fill.settle", self.fill.settle, 0.0, 1000.0),
            ("fill.protrusion", self.fill.protrusion, 0.0, 1.0),
            ("fill.overlap", self.fill.overlap, 0.01, 1.0),
            ("fill.wall_tolerance", self.fill.wall_tolerance, 0.0, 0.5),
            ("release.layer", self.release.layer, 0.01, 1000.0),
            ("release.interval", time(self.release.interval), 0.0, 1000.0),
            ("release.damping", self.release.damping, 0.0, 100.0),
            ("control.period", f64::from(self.control.period), 1.0, 1000.0),
            ("control.kinetic_ratio", self.control.kinetic_ratio, 0.0, 1.0),
            ("control.contact_tolerance", self.control.contact_tolerance, 0.0, 1.0),
            ("control.spread", spread, 0.0, 1e6),
            ("control.damping", self.control.damping, 0.0, 100.0),
            ("control.kappa", self.control.kappa, 0.0, 1e9),
            ("control.nails_per_body", f64::from(self.control.nails_per_body), 1.0, 1000.0),
            ("control.until", self.control.until.unwrap_or(0.0), 0.0, 100_000.0),
            ("hold.patience", self.hold.patience, 0.0, 100_000.0),
            ("hold.least_seconds", self.hold.least, 0.0, 100_000.0),
            ("output.fps", self.output.fps, 1.0, 1000.0),
            ("output.frames", f64::from(self.output.frames.unwrap_or(0)), 0.0, 100_000.0),
        ];
        let bad = ranges.into_iter().filter(|(_, value, lo, hi)| !(lo..=hi).contains(&value));
        let told =
            |(name, value, lo, hi)| Problem::new(name, format!("{name}: {value} is out of range; give {lo} to {hi}"));
        let mut problems: Vec<Problem> = bad.map(told).collect();
        if self.control.speed.is_nan() || self.control.speed <= 0.0 {
            let text = format!("control.speed: {} is out of range; give a speed above 0", self.control.speed);
            problems.push(Problem::new("control.speed", text));
        }
        problems
    }
}
