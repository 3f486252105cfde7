//! Settings of the engine, each with its reason. Lengths in d, times in characteristic times (see [`Units`]).

use super::manifold::{ContactLooks, Manifolds, SOLVED};
use super::units::Units;
use cairn_geometry::contact::{CARRYING_GAP, REAL_CONTACT};
use cairn_input::params::{FrictionModel, Physics, Switch, USUAL_THICKNESS};
use rapier3d::prelude::{IntegrationParameters, NarrowPhase, PhysicsWorld, RigidBody, SpringCoefficients, Vector};
use std::sync::Arc;

/// Contacts are predicted up to this distance where the thinnest body is [`USUAL_THICKNESS`] thick: the engine's own
/// choice for objects of its unit size. A slow body moves no farther in a step.
pub const PREDICTION: f64 = 0.02;
/// Where the thinnest body is thinner, contacts are predicted up to this many times as far: the rim of a plate that
/// turns over is soon on its other side.
const FARTHER: f64 = 2.5;
/// The engine's length unit, in smallest thicknesses. The boxes by which the engine (rapier 0.36.1) finds pairs are
/// larger than the bodies by 0.04 units, so by a tenth of that thickness: with less, they are rebuilt too often; with
/// more, the engine keeps pairs that are far apart.
const LENGTH_UNIT: f64 = 2.5;
/// Top speed at which overlapping bodies are pushed apart: slower than a fall from one diameter, so that nothing
/// bursts. So the energy that a step may gain is bounded, too.
pub const PUSH_OUT_SPEED: f64 = 0.35;
/// An island sleeps when all its bodies have been slower than this for [`SLEEP_TIME`].
const SLEEP_SPEED: f64 = 0.03;
/// See [`SLEEP_SPEED`]; characteristic times. Bodies that creep are looked for twice in it.
const SLEEP_TIME: f64 = 1.5;
/// A nail is a spring of this natural frequency, critically damped: the engine's rigid default spikes by three orders
/// of magnitude over the load and breaks nails that carry nothing.
const NAIL_FREQUENCY: f64 = 64.0;
/// Step while overlaps are removed, characteristic times: about half of an overlap goes in one.
const PROJECTION_STEP: f64 = 0.05;

/// The engine, empty. `thickness`: the smallest of any body, engine units. `compounds`: some body has several parts.
/// And what counts its looks at contacts.
pub fn engine(units: Units, physics: &Physics, thickness: f64, compounds: bool) -> (PhysicsWorld, Arc<ContactLooks>) {
    let manifolds = Manifolds::new(SOLVED);
    let looks = manifolds.looks();
    let narrow_phase = NarrowPhase::with_query_dispatcher(manifolds);
    let mut engine = PhysicsWorld { gravity: Vector::NEG_Y, narrow_phase, ..PhysicsWorld::new() };
    engine.set_thread_pool(threads());
    let step = units.duration(physics.step);
    let p = &mut engine.integration_parameters;
    p.dt = step as f32;
    set_contacts(p, physics, thickness, step);
    // The engine multiplies its normalized lengths by its length unit.
    let unit = (LENGTH_UNIT * thickness).min(1.0);
    p.length_unit = unit as f32;
    p.normalized_allowed_linear_error = (CARRYING_GAP / unit) as f32;
    p.warmstart_joints = true;
    p.normalized_prediction_distance = (prediction(thickness) / unit) as f32;
    p.normalized_max_corrective_velocity = (PUSH_OUT_SPEED / unit) as f32;
    // The engine's own top speed, a fall from 80,000 diameters.
    p.normalized_max_linear_velocity /= unit as f32;
    if physics.switches.continuous_collision == Switch::Off {
        p.max_ccd_substeps = 0;
    }
    p.normalized_contact_recycle_distance = ((REAL_CONTACT * thickness).min(CARRYING_GAP) / unit) as f32;
    // Clustering picks other points of a compound from step to step, which rocks the compound forever.
    p.contact_clustering = !compounds;
    p.friction_model = match physics.friction_model {
        FrictionModel::Simplified => rapier3d::prelude::FrictionModel::Simplified,
        FrictionModel::Coulomb => rapier3d::prelude::FrictionModel::Coulomb,
    };
    (engine, looks)
}

/// The same engine again, but for its scratch memory.
pub fn copy(engine: &PhysicsWorld) -> PhysicsWorld {
    let mut copy = PhysicsWorld {
        gravity: engine.gravity,
        integration_parameters: engine.integration_parameters,
        islands: engine.islands.clone(),
        broad_phase: engine.broad_phase.clone(),
        narrow_phase: engine.narrow_phase.clone(),
        bodies: engine.bodies.clone(),
        colliders: engine.colliders.clone(),
        impulse_joints: engine.impulse_joints.clone(),
        multibody_joints: engine.multibody_joints.clone(),
        soft_bodies: engine.soft_bodies.clone(),
        ccd_solver: engine.ccd_solver.clone(),
        ..PhysicsWorld::new()
    };
    copy.set_thread_pool(threads());
    copy
}

/// Distance up to which contacts are predicted. `thickness`: the smallest of any body; engine units.
fn prediction(thickness: f64) -> f64 {
    PREDICTION * (USUAL_THICKNESS / thickness).clamp(1.0, FARTHER)
}

/// As many threads as the caller has, for one world alone: within a step the engine's threads wait for each other, so
/// that two worlds that share them may wait forever. `None`: the caller's thread does all the work.
fn threads() -> Option<Arc<rayon::ThreadPool>> {
    let count = rayon::current_num_threads();
    let several = (count > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(count));
    several.and_then(|pool| pool.build().ok()).map(Arc::new)
}

/// How stiff contacts are, and the substeps that they need. `thickness`: the smallest of any body, engine units;
/// `step`: characteristic times.
pub fn set_contacts(p: &mut IntegrationParameters, physics: &Physics, thickness: f64, step: f64) {
    let frequency = physics.stiffness(thickness);
    p.num_solver_iterations = physics.substeps_for(frequency, step) as usize;
    set_softness(p, frequency, physics.contact_damping_ratio);
}

fn set_softness(p: &mut IntegrationParameters, frequency: f64, damping_ratio: f64) {
    let softness = SpringCoefficients { natural_frequency: frequency as f32, damping_ratio: damping_ratio as f32 };
    p.contact_softness = softness;
    p.static_contact_softness = softness;
}

/// Settings under which each step is a projection that removes overlaps.
pub fn set_projection(p: &mut IntegrationParameters) {
    // The engine's own contacts with the ground: stiff, and overdamped. With fewer substeps than its own, bodies
    // between others are pushed too far.
    let engine = IntegrationParameters::default();
    p.contact_softness = engine.static_contact_softness;
    p.static_contact_softness = engine.static_contact_softness;
    p.num_solver_iterations = engine.num_solver_iterations;
    p.dt = PROJECTION_STEP as f32;
}

/// When a body may fall asleep. `length_unit`: the engine's.
pub fn set_sleep(body: &mut RigidBody, length_unit: f32) {
    let activation = body.activation_mut();
    activation.normalized_linear_threshold = SLEEP_SPEED as f32 / length_unit;
    activation.time_until_sleep = SLEEP_TIME as f32;
}

/// The spring that a nail is.
pub fn nail_softness() -> SpringCoefficients<f32> {
    SpringCoefficients { natural_frequency: NAIL_FREQUENCY as f32, damping_ratio: 1.0 }
}
