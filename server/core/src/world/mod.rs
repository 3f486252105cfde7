//! The only owner of the physics world: bodies, stepping, contacts, nails.
//!
//! Everything in here is in engine units: length d (the median prop diameter), time sqrt(d / g), mass that of the
//! median prop; gravity is then 1 and the engine sees the same numbers for a pile of rice as for one of logs.
//! [`Units`] is the one place of the conversion.

mod bobbing;
mod bodies;
mod clusters;
mod contacts;
mod creep;
mod depenetration;
mod guarded;
mod hits;
mod loads;
mod manifold;
mod motion;
mod nails;
mod rolling;
mod scenery;
mod units;

use crate::geometry::pose::Pose;
use crate::input::params::{FrictionModel, Physics, Switch};
use glam::{DQuat, DVec3};
use rapier3d::math::{Pose as EnginePose, Vector};
use rapier3d::prelude::*;
use std::sync::Arc;

pub use clusters::ClusterId;
pub use contacts::{Claims, ContactPair, ContactPoint, PairSide};
pub use guarded::{Energy, Snapshot};
pub use hits::ComingHit;
use manifold::{Manifolds, SOLVED};
pub use motion::{FrictionExcess, Momentum};
pub use nails::NailId;
pub use scenery::MovingId;
pub use units::Units;

/// A wall of a container.
#[derive(Clone, Copy, Debug)]
pub struct WallId(ColliderHandle);

/// Index of a body, in the order of insertion; never reused.
pub type BodyId = usize;

/// What a body is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Not yet released: it stays where it is.
    Waiting,
    /// Simulated.
    Free,
    /// Held still by the control until a verdict frees it.
    Frozen,
    /// Placed by hand, and to stay: others may rest on it.
    Pinned,
    /// Glued to the ground or to scenery, by itself or through others.
    Anchored,
    /// Taken out.
    Gone,
}

impl Role {
    /// It carries others like the ground, until someone takes that away.
    pub fn stands(self) -> bool {
        matches!(self, Role::Pinned | Role::Anchored)
    }
}

/// One body; lengths, masses in engine units.
#[derive(Clone, Debug)]
pub struct WorldBody {
    pub prop: usize,
    /// Scale of the prop.
    pub scale: f64,
    pub role: Role,
    pub mass: f64,
    /// Of the sphere about the centre of mass.
    pub radius: f64,
    /// Smallest extent.
    pub thickness: f64,
    /// Product of the two smaller extents: the area of its smallest face.
    pub face_area: f64,
    pub friction: f64,
    id: BodyId,
    /// What moves it: its own rigid body, or its cluster's.
    handle: RigidBodyHandle,
    own: RigidBodyHandle,
    collider: ColliderHandle,
    /// Of the collider on the body's own rigid body.
    place: EnginePose,
    /// On what moves it.
    offset: EnginePose,
    cluster: Option<ClusterId>,
}

/// What effects have done so far: bodies, summed over the steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct WorldCounters {
    /// Bodies that the engine moved.
    pub awake_body_steps: u64,
    /// Pairs of near boxes that the engine kept.
    pub pair_steps: u64,
    /// Bodies whose contacts were found a step ahead.
    pub speculative_body_steps: u64,
    /// Bodies swept along their way.
    pub ccd_body_steps: u64,
    /// Bodies braked by their resistance to rolling.
    pub rolling_body_steps: u64,
    /// Looks at a body that moved on the spot, and so was let fall asleep.
    pub rocking_looks: u64,
    /// Times that a pile that bobbed was given more substeps.
    pub calmed: u64,
}

/// How a body enters the world.
#[derive(Clone, Copy, Debug)]
pub struct Insertion {
    pub prop: usize,
    pub scale: f64,
    /// Engine units.
    pub pose: Pose,
    pub friction: f64,
    pub restitution: f64,
}

/// Bodies, ground, scenery and the engine that moves them.
pub struct World {
    pub units: Units,
    engine: PhysicsWorld,
    bodies: Vec<WorldBody>,
    nails: nails::Nails,
    clusters: Vec<Option<clusters::Cluster>>,
    moving: Vec<scenery::Moving>,
    marks: creep::Marks,
    bobbing: bobbing::Bobbing,
    rolling: rolling::Rolling,
    ccd: Switch,
    /// Steps taken.
    pub steps: u64,
    pub counters: WorldCounters,
}

/// Colliders tell what they are by their user data: these, or [`FIRST_BODY`] plus a body's index.
const GROUND: u128 = 0;
const SCENERY: u128 = 1;
const CONTAINER: u128 = 2;
const FIRST_BODY: u128 = 3;
/// Plus the index of a piece of moving scenery: above all bodies.
const FIRST_MOVING: u128 = 1 << 64;

/// Contacts are predicted up to this distance, d: the engine's own choice for objects of its unit size.
const PREDICTION: f64 = 0.02;
/// [`PREDICTION`] holds where the thinnest body is this thick, d.
const USUAL_THICKNESS: f64 = 0.1;
/// Where the thinnest body is thinner, contacts are predicted up to this many times as far: the rim of a plate that turns over is soon on its other side.
const FARTHER: f64 = 2.5;
/// Boxes by which the engine finds pairs are larger than the bodies by this share of the smallest thickness: less, and they are made
/// anew too often; more, and it keeps pairs that are far apart.
const BOX_MARGIN: f64 = 0.1;
/// What the engine (rapier 0.36.1) adds to them itself, in its length unit.
const ENGINE_MARGIN: f64 = 0.04;
/// Overlap that is left as it is, d: the engine's own choice for objects of its unit size.
const ALLOWED_OVERLAP: f64 = 0.005;
/// Fastest that overlapping bodies are pushed apart; slower than a fall from one diameter, so that nothing bursts.
const PUSH_OUT_SPEED: f64 = 0.35;
/// No body may be faster: a fall from 5,000 diameters.
const MAX_SPEED: f64 = 100.0;
/// Contacts are kept unchanged until a pair has moved by this share of the smallest thickness: more is fiction at the
/// time of a verdict, less lets small towers creep.
const RECYCLE_SHARE: f64 = 0.05;
/// Upper bound of that distance, d: a body would hover above what it seems to rest on.
const MAX_RECYCLE: f64 = 1.0 / 200.0;

/// Distance up to which contacts are predicted. `thickness`: the smallest of any body; engine units.
fn prediction(thickness: f64) -> f64 {
    PREDICTION * (USUAL_THICKNESS / thickness).clamp(1.0, FARTHER)
}

/// As many threads as the caller has, for one world alone: within a step the engine's threads wait for each other, so that two
/// worlds that share them may wait for ever. `None`: the caller's thread does it all.
fn threads() -> Option<Arc<rayon::ThreadPool>> {
    let count = rayon::current_num_threads();
    let several = (count > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(count));
    several.and_then(|pool| pool.build().ok()).map(Arc::new)
}

impl World {
    /// An empty world. `thickness`: the smallest of any body, engine units. `compounds`: some body has several parts.
    pub fn new(units: Units, physics: &Physics, thickness: f64, compounds: bool) -> World {
        let narrow_phase = NarrowPhase::with_query_dispatcher(Manifolds { most: SOLVED });
        let mut engine = PhysicsWorld { gravity: Vector::NEG_Y, narrow_phase, ..PhysicsWorld::new() };
        engine.set_thread_pool(threads());
        let frequency = physics.stiffness(thickness);
        let softness = SpringCoefficients {
            natural_frequency: frequency as f32,
            damping_ratio: physics.contact_damping_ratio as f32,
        };
        let p = &mut engine.integration_parameters;
        p.dt = units.duration(physics.step) as f32;
        p.num_solver_iterations = physics.substeps_for(frequency, units.duration(physics.step)) as usize;
        p.contact_softness = softness;
        p.static_contact_softness = softness;
        // All other lengths are given in d.
        let unit = (BOX_MARGIN * thickness / ENGINE_MARGIN).min(1.0);
        p.length_unit = unit as f32;
        p.normalized_allowed_linear_error = (ALLOWED_OVERLAP / unit) as f32;
        p.warmstart_joints = true;
        p.normalized_prediction_distance = (prediction(thickness) / unit) as f32;
        p.normalized_max_corrective_velocity = (PUSH_OUT_SPEED / unit) as f32;
        p.normalized_max_linear_velocity = (MAX_SPEED / unit) as f32;
        if physics.switches.continuous_collision == Switch::Off {
            p.max_ccd_substeps = 0;
        }
        p.normalized_contact_recycle_distance = ((RECYCLE_SHARE * thickness).min(MAX_RECYCLE) / unit) as f32;
        // Clustering picks other points of a compound from step to step, which rocks it for ever.
        p.contact_clustering = !compounds;
        p.friction_model = match physics.friction_model {
            FrictionModel::Simplified => rapier3d::prelude::FrictionModel::Simplified,
            FrictionModel::Coulomb => rapier3d::prelude::FrictionModel::Coulomb,
        };
        World {
            units,
            engine,
            bodies: Vec::new(),
            nails: nails::Nails::default(),
            clusters: Vec::new(),
            moving: Vec::new(),
            marks: creep::Marks::default(),
            bobbing: bobbing::Bobbing::default(),
            rolling: rolling::Rolling::new(physics),
            ccd: physics.switches.continuous_collision,
            steps: 0,
            counters: WorldCounters::default(),
        }
    }

    /// Each contact point has a friction force of its own.
    pub fn has_friction_per_point(&self) -> bool {
        self.engine.integration_parameters.friction_model == rapier3d::prelude::FrictionModel::Coulomb
    }

    pub fn bodies(&self) -> &[WorldBody] {
        &self.bodies
    }

    /// Velocity of the centre of mass, engine units.
    pub fn velocity(&self, id: BodyId) -> DVec3 {
        let rigid = &self.engine.bodies[self.bodies[id].handle];
        if self.bodies[id].cluster.is_none() {
            return rigid.linvel().as_dvec3();
        }
        let arm = self.engine_pose(id).translation - rigid.translation();
        (rigid.linvel() + rigid.angvel().cross(arm)).as_dvec3()
    }

    pub fn angular_velocity(&self, id: BodyId) -> DVec3 {
        self.engine.bodies[self.bodies[id].handle].angvel().as_dvec3()
    }

    /// Bodies that are still there, rising.
    pub fn present(&self) -> impl Iterator<Item = BodyId> + '_ {
        (0..self.bodies.len()).filter(|&i| self.bodies[i].role != Role::Gone)
    }

    pub fn is_present(&self, id: BodyId) -> bool {
        self.bodies[id].role != Role::Gone
    }

    pub fn remove(&mut self, id: BodyId) {
        self.nails.forget(id);
        // Those that it was glued to go on by themselves.
        if let Some(cluster) = self.bodies[id].cluster {
            self.unglue(cluster);
        }
        self.engine.remove_body(self.bodies[id].own);
        self.bodies[id].role = Role::Gone;
    }

    /// Which way gravity points, and how strong it is; 1 downward in a new world.
    pub fn set_gravity(&mut self, gravity: DVec3) {
        self.engine.gravity = gravity.as_vec3();
        self.engine.wake_up_all(true);
    }

    pub fn pose(&self, id: BodyId) -> Pose {
        from_engine(&self.engine_pose(id))
    }

    fn engine_pose(&self, id: BodyId) -> EnginePose {
        let body = &self.bodies[id];
        let carrier = self.engine.bodies[body.handle].position();
        if body.cluster.is_some() { *carrier * body.offset } else { *carrier }
    }

    pub fn step_length(&self) -> f64 {
        self.engine.integration_parameters.dt as f64
    }

    /// One step. Returns the bodies whose state became non-finite and that the engine set aside.
    pub fn step(&mut self) -> Vec<BodyId> {
        self.watch_fast_ones();
        self.engine.step();
        self.steps += 1;
        self.counters.awake_body_steps += self.engine.islands.num_active_bodies() as u64;
        self.counters.pair_steps += self.engine.narrow_phase.contact_graph().raw_graph().raw_edges().len() as u64;
        let broken = self.engine.quarantine().bodies().to_vec();
        let ids: Vec<BodyId> = (0..self.bodies.len())
            .filter(|&i| self.bodies[i].role != Role::Gone && broken.contains(&self.bodies[i].handle))
            .collect();
        for &id in &ids {
            self.remove(id);
        }
        self.resist_rolling();
        self.keep_awake_what_creeps();
        self.calm_bobbing();
        ids
    }
}

fn to_engine(pose: &Pose) -> EnginePose {
    EnginePose::from_parts(pose.translation.as_vec3(), pose.rotation.as_quat())
}

fn from_engine(pose: &EnginePose) -> Pose {
    let q: DQuat = pose.rotation.as_dquat();
    Pose { translation: pose.translation.as_dvec3(), rotation: q.normalize() }
}
