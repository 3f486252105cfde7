//! The physics world: the only owner of the engine.
//!
//! [`World`] holds the engine (rapier) and, beside it, a record of each body: its role, its size, and which rigid body
//! of the engine carries it. A body alone is carried by its own rigid body; bodies that are glued to each other by that
//! of their cluster:
//!
//! ```text
//!   bodies      0      1      2      3        records: role, size, friction
//!               |      |       \    /
//!   carriers   own    own     cluster         rigid bodies of the engine: pose, velocity, type
//!               |      |       /    \
//!   colliders   0      1      2      3        shapes; the user data names the owner
//! ```
//!
//! Everything in here is in engine units: length d (the median prop diameter), time sqrt(d / g) (the characteristic
//! time), mass that of the median prop. Gravity is then 1, and the engine sees the same numbers for a pile of rice as
//! for one of logs. [`Units`] is the one place of the conversion.
//!
//! One step ([`World::step`]), in this order:
//!
//! 1. Continuous collision is set for each free body by its speed (`corrections::ccd`); what rides on scenery that
//!    turns gets new contacts (`corrections::turning`).
//! 2. The engine takes its step: contacts, solver, poses.
//! 3. Bodies that became non-finite are removed.
//! 4. Resistance to rolling, and that of contacts to slow motion, brake bodies by the forces of the step
//!    (`corrections::rolling`, `corrections::resistance`).
//! 5. Bodies that creep are kept from falling asleep (`corrections::creep`).
//! 6. A pile that bobs gets more substeps (`corrections::bobbing`).
//! 7. The invariants are checked, in debug builds and tests (`validation`).
//!
//! What other rooms ask of a world, by the module that answers (lowest first; none imports one above it):
//!
//! - `units`, `colliders` (their owners), `manifold` (contact points of convex polyhedra), `settings` of the
//!   engine
//! - `bodies`: records, poses, velocities, and the changes that a body may undergo
//! - `corrections`: additions to the engine's step; they know the engine and the bodies, not the world
//! - `scenery`: ground, container, scenery
//! - `contacts`: contact pairs, free places, coming hits
//! - `joints`: clusters and nails
//! - `lifecycle`: how bodies come and go
//! - `validation`: the invariants
//! - `stepping`: the step, the retry of a step with smaller steps, depenetration
//! - `queries`: loads, energy, friction, faults

mod any_engine;
mod bodies;
mod colliders;
mod contacts;
mod corrections;
mod joints;
mod lifecycle;
mod manifold;
mod queries;
mod scenery;
mod settings;
mod stepping;
mod units;
mod validation;

use cairn_input::params::{Physics, Switch};
use corrections::{bobbing::Bobbing, creep::Creep, rolling::Rolling, turning::Turning};
use manifold::ContactLooks;
use rapier3d::prelude::PhysicsWorld;
use std::sync::Arc;

pub use bodies::{BodySize, ClusterId, Insertion, Momentum, Resistance, Role, WorldBody};
pub use colliders::{BodyId, MovingId};
pub use contacts::{ComingHit, ContactPair, ContactPoint, PairSide, ReservedPlaces};
pub use corrections::WorldCounters;
pub use joints::nails::NailId;
pub use manifold::{Manifolds, SOLVED};
pub use queries::{FrictionExcess, Obstacle};
pub use scenery::WallId;
pub use settings::PUSH_OUT_SPEED;
pub use stepping::{DEEPEST, Energy, Snapshot};
pub use units::Units;

/// A body slower than this is at rest, in d per characteristic time, that is in units of sqrt(g d): 1 %. A pile whose
/// mean speed is lower does not bob: no one sees it.
pub const REST_SPEED: f64 = 0.01;

/// Bodies, ground, scenery and the engine that moves them.
pub struct World {
    pub units: Units,
    engine: PhysicsWorld,
    bodies: bodies::Bodies,
    nails: joints::nails::NailJoints,
    moving: Vec<scenery::MovingPiece>,
    /// Number of pieces of scenery that stand still.
    still_pieces: usize,
    ccd: Switch,
    rolling: Rolling,
    creep: Creep,
    bobbing: Bobbing,
    turning: Turning,
    /// See [`World::judge_meshes`].
    judges_meshes: bool,
    /// Of all bodies.
    most_skin: f64,
    /// Steps taken.
    pub steps: u64,
    pub counters: WorldCounters,
    /// A copy counts in the same place.
    looks: Arc<ContactLooks>,
}

/// A copy goes on as the world itself would.
impl Clone for World {
    fn clone(&self) -> World {
        World {
            engine: settings::copy(&self.engine),
            bodies: self.bodies.clone(),
            nails: self.nails.clone(),
            moving: self.moving.clone(),
            rolling: self.rolling.clone(),
            creep: self.creep.clone(),
            bobbing: self.bobbing.clone(),
            turning: self.turning.clone(),
            looks: self.looks.clone(),
            ..*self
        }
    }
}

impl World {
    /// An empty world. `thickness`: the smallest of any body, engine units. `compounds`: some body has several parts.
    pub fn new(units: Units, physics: &Physics, thickness: f64, compounds: bool) -> World {
        let (engine, looks) = settings::engine(units, physics, thickness, compounds);
        World {
            units,
            engine,
            looks,
            bodies: bodies::Bodies::default(),
            nails: joints::nails::NailJoints::default(),
            moving: Vec::new(),
            still_pieces: 0,
            ccd: physics.switches.continuous_collision,
            rolling: Rolling::new(physics),
            creep: Creep::default(),
            bobbing: Bobbing::default(),
            turning: Turning::default(),
            judges_meshes: false,
            most_skin: 0.0,
            steps: 0,
            counters: WorldCounters::default(),
        }
    }

    /// Characteristic times.
    pub fn step_length(&self) -> f64 {
        self.engine.integration_parameters.dt as f64
    }
}
