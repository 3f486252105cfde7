//! Estimates of the cost and accuracy of a bake before it runs: a model fitted on measured bakes.
//!
//! For each stage a power law: its CPU time is a product of powers of the numbers that decide it ([`Workload`]). The
//! example `fit_estimate` fits the exponents to measured bakes and prints how far the model is from them.

mod goal;
mod model;

pub use goal::{Choice, Expected, Goal, TOLERANCE};
pub use model::{CALIBRATION_SECONDS, GLUED_RELEASE};

/// The fitted exponents of fill, glue, and release and hold.
pub const LAWS: [CostExponents; 3] = [model::FILL, model::GLUE, model::RELEASE_AND_HOLD];

use crate::check::CheckedScene;
use crate::effects::EffectName;
use crate::{packing, plan};
use cairn_engine::shape::Shape;
use cairn_input::params::{Accuracy, ControlMode, FrictionModel, Params, Switch};
use cairn_input::scene::{Prop, Scene};

/// The expected cost and accuracy of a bake.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Estimate {
    pub accuracy: Accuracy,
    pub bodies: usize,
    /// Nine of ten bakes have as many, from and to.
    pub body_range: [usize; 2],
    /// CPU seconds of the whole bake.
    pub cpu_seconds: f64,
    /// CPU seconds of the fill.
    pub fill_seconds: f64,
    /// CPU seconds of placing glue and of the proof; 0 where nothing is glued.
    pub glue_seconds: f64,
    /// Glue joints, more or less: shapes that hang over need several times as many as shapes that stand almost by
    /// themselves. 0 where nothing is glued, and where the strength is bounded: there bakes differ too much for an
    /// estimate.
    pub glue_dots: f64,
    /// Expected `kept_shape`, with the glue that is set: of ten bakes, five are below the second, and eight between the
    /// first and the third. `None` without a fill, and where the control holds the pile to the end.
    pub kept_shape: Option<[f64; 3]>,
    /// CPU seconds of release and hold; the rest is for shapes and measures.
    pub release_seconds: f64,
    /// Nine of ten bakes take between `cpu_seconds` / `factor` and `cpu_seconds` * `factor`. Larger where the number of
    /// bodies is not known.
    pub factor: f64,
    /// Expected `visible_depth_p95_rel`, as the study of the presets found it.
    pub overlap_rel: f64,
    /// The same in metres: of these props' thickness.
    pub overlap: f64,
    /// Nine of ten bakes overlap by no more, m.
    pub most_overlap: f64,
    /// Expected share of the bodies that moves once all are released, without control or glue.
    pub imbalance: f64,
    /// Expected distance of the shape's IoU from that of `reference`.
    pub shape_error: f64,
    /// Expected error of how fast bodies slide, relative.
    pub speed_error: f64,
}

/// The part of a bake that runs on all of its threads (Amdahl's law): two take two thirds of the time of one.
const PARALLEL: f64 = 0.66;

impl Estimate {
    /// Expected seconds from start to result with this number of threads, each on a core of its own.
    pub fn wall_seconds(&self, threads: usize) -> f64 {
        self.cpu_seconds * (1.0 - PARALLEL + PARALLEL / threads.max(1) as f64)
    }

    /// The share of the CPU time that an effect will take where it is on; `None` for effects that are part of others.
    pub fn share(&self, effect: EffectName) -> Option<f64> {
        let seconds = match effect {
            EffectName::Fill => self.fill_seconds,
            EffectName::Glue => self.glue_seconds,
            EffectName::Control => model::CONTROL_SHARE * self.release_seconds,
            _ => return None,
        };
        Some(seconds / self.cpu_seconds)
    }
}

/// The numbers that decide the cost of a bake.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Workload {
    pub bodies: f64,
    /// Those of them that the fill places.
    pub filled: f64,
    /// Corners of a body's collision shape, over all parts, 1 for a ball; mean over the bodies.
    pub corners: f64,
    /// Convex parts of a body; mean over the bodies.
    pub parts: f64,
    /// Cube of a body's diameter over its volume; mean over the bodies. Slender bodies touch more others.
    pub slenderness: f64,
    /// Triangles of the container.
    pub walls: f64,
    /// Characteristic times of release and hold.
    pub times: f64,
    /// Steps per characteristic time.
    pub step_rate: f64,
    pub substeps: f64,
    /// CPU time of a fill of this accuracy / that of one at `standard`.
    #[serde(default = "usual", rename = "fill_care")]
    pub fill_cost_factor: f64,
    /// The same of glue and its proof.
    #[serde(default = "usual")]
    pub glue_cost_factor: f64,
    /// Each contact point has a friction force of its own.
    pub coulomb: bool,
    /// The pile is glued where friction does not carry it.
    #[serde(default)]
    pub glued: bool,
    /// Volume of the control mesh over the mean volume of a prop, and the features that decide how densely they pack; 0
    /// without a fill.
    #[serde(default)]
    pub room: f64,
    #[serde(default)]
    pub packing: packing::Weights,
    /// Share of the bodies whose collision shape is a box, nearly a box, or a ball: what overlaps there is seen.
    #[serde(default)]
    pub primitive: f64,
}

fn usual() -> f64 {
    1.0
}

/// A convex prop that fills this share of its box lies face to face, without a gap, as boxes do.
const NEARLY_A_BOX: f64 = 0.9;

/// The factors of the power laws.
pub const FEATURES: [&str; 10] =
    ["1", "bodies", "corners", "parts", "slenderness", "walls", "times", "step_rate", "substeps", "coulomb"];
/// An exponent for each of the features.
pub type CostExponents = [f64; FEATURES.len()];

impl Workload {
    /// Of a checked scene, with its collision shapes: how many parts a prop needs is known only once it has been split.
    pub fn of(scene: &Scene, params: &Params, checked: &CheckedScene, shapes: &[Shape]) -> Workload {
        let characteristic_time = checked.characteristic_time(params);
        let filled = plan::filled_bodies(scene, params, checked);
        let mut mean = [0.0; 4];
        let all: f64 = checked.shares.iter().sum();
        for ((shape, size), share) in shapes.iter().zip(&checked.sizes).zip(&checked.shares) {
            let (parts, corners) = (shape.solid.parts() as f64, shape.solid.corners() as f64);
            let slenderness = size.diameter.powi(3) / size.volume;
            let is_nearly_a_box =
                shape.solid.parts() == 1 && size.hull_volume >= NEARLY_A_BOX * size.extents.element_product();
            let primitive = f64::from(u8::from(shape.report.kind.is_primitive() || is_nearly_a_box));
            for (sum, value) in mean.iter_mut().zip([parts, corners, slenderness, primitive]) {
                *sum += share / all * value;
            }
        }
        let [parts, corners, slenderness, primitive] = mean;
        let step_rate = characteristic_time / params.physics.step.seconds(characteristic_time);
        let container = checked.filled(scene, params);
        let (room, packing) =
            container.map_or(Default::default(), |c| plan::room(c, checked).load(scene, &checked.sizes));
        Workload {
            bodies: (filled + scene.added_bodies()) as f64,
            filled: filled as f64,
            corners,
            parts,
            slenderness,
            walls: container.map_or(0.0, |c| c.mesh.triangles.len() as f64),
            times: plan::release_steps(scene, params, checked) / step_rate,
            step_rate,
            substeps: f64::from(params.physics.substeps),
            fill_cost_factor: params.accuracy.traits().fill_cost_factor,
            glue_cost_factor: params.accuracy.traits().glue_cost_factor,
            coulomb: params.physics.friction_model == FrictionModel::Coulomb,
            glued: scene.glue_bound(params) > 0.0,
            room,
            packing,
            primitive,
        }
    }

    /// Logarithms of the numbers, in the order of [`FEATURES`].
    pub fn features(&self) -> CostExponents {
        [
            1.0,
            libm::log(self.bodies),
            libm::log(self.corners),
            libm::log(self.parts),
            libm::log(self.slenderness),
            libm::log(1.0 + self.walls),
            libm::log(self.times.max(1.0)),
            libm::log(self.step_rate),
            libm::log(self.substeps),
            f64::from(u8::from(self.coulomb)),
        ]
    }

    /// Expected CPU seconds of fill, of glue, of release and hold, and of shapes and measures, on the machine that the
    /// model was fitted on.
    pub fn stage_seconds(&self) -> [f64; 4] {
        let features = self.features();
        let law = |weights: &CostExponents| libm::exp(features.iter().zip(weights).map(|(f, w)| f * w).sum::<f64>());
        let fill = if self.filled > 0.0 { law(&model::FILL) * self.fill_cost_factor } else { 0.0 };
        let glue = if self.glued { law(&model::GLUE) * self.glue_cost_factor } else { 0.0 };
        let release = law(&model::RELEASE_AND_HOLD) * if self.glued { model::GLUED_RELEASE } else { 1.0 };
        [fill, glue, release, law(&model::MEASURE)]
    }

    /// The sum of [`Workload::stage_seconds`].
    pub fn cpu_seconds(&self) -> f64 {
        self.stage_seconds().iter().sum()
    }
}

/// The estimate for a checked scene. `machine`: from `calibrate` of the room `core`.
pub fn of(scene: &Scene, params: &Params, checked: &CheckedScene, shapes: &[Shape], machine: f64) -> Estimate {
    let traits = params.accuracy.traits();
    let [imbalance, shape_error] = traits.expected_errors;
    let workload = Workload::of(scene, params, checked, shapes);
    let range = plan::body_range(scene, params, checked);
    // The laws are nearly proportional to the number of bodies, whose usual range is within their own factor.
    let (low, high) = (range.low as f64, range.high as f64);
    let spread = (high / workload.bodies).max(workload.bodies / low.max(1.0));
    let unknown = if range.mixed.is_some() { spread } else { spread / packing::FACTOR }.max(1.0);
    let [own, holding] = traits.overlaps;
    let mixed = |n: usize| workload.primitive * own[n] + (1.0 - workload.primitive) * holding[n];
    let [overlap_rel, most_overlap_rel] = [mixed(0), mixed(1)];
    let [fill_seconds, glue_seconds, release_seconds, rest] = workload.stage_seconds().map(|seconds| machine * seconds);
    let thickness = |((shape, prop), share): ((&Shape, &Prop), &f64)| {
        share * shape.thickness() * (prop.scale[0] + prop.scale[1]) / 2.0
    };
    // A pile that the control holds to the end keeps its shape, glued or not.
    let held = params.control.mode != ControlMode::Off && params.control.stand == Switch::Off;
    let bound = scene.glue_bound(params);
    let kept = model::expected_kept_shape(bound);
    let joints_per_body = traits.glue_joints_factor * model::DOTS_PER_BODY;
    let all: f64 = checked.shares.iter().sum();
    let thickness = shapes.iter().zip(&scene.props).zip(&checked.shares).map(thickness).sum::<f64>() / all;
    Estimate {
        accuracy: params.accuracy,
        bodies: workload.bodies as usize,
        body_range: [range.low, range.high],
        cpu_seconds: fill_seconds + glue_seconds + release_seconds + rest,
        fill_seconds,
        glue_seconds,
        glue_dots: if bound.is_infinite() { joints_per_body * workload.bodies } else { 0.0 },
        kept_shape: (scene.is_filled(params) && !held).then_some(kept),
        release_seconds,
        factor: model::FACTOR * unknown,
        overlap_rel,
        overlap: overlap_rel * thickness,
        most_overlap: most_overlap_rel * thickness,
        imbalance,
        shape_error,
        speed_error: traits.speed_error,
    }
}
