//! Looks at the motion of a pile for what no one would believe: bodies in the air that do not fall as they should,
//! bodies that fall although nothing touched them after they had stood, and energy out of nothing.

use crate::world::{PairSide, REST_SPEED, Role, World};
use glam::DVec3;

/// A body that has been at rest for this long stands, s.
const STANDING: f64 = 1.0;
/// A body that stood has fallen once it is this much lower, d.
const FALLEN: f64 = 0.1;

/// What was seen so far.
#[derive(Debug, Default)]
pub struct Motion {
    /// Largest deviation from free fall of a body that touched nothing, as a share of gravity.
    pub ballistic_error: f64,
    /// Bodies that stood for [`STANDING`] and then fell untouched.
    pub second_collapse: u64,
    /// Velocities before the step. Shape `[body]`.
    before: Vec<Option<DVec3>>,
    /// Shape `[body]`.
    stands: Vec<Standing>,
    /// Mechanical energy at the beginning, and the most that it grew since; m g d.
    energy: Option<f64>,
    growth: f64,
}

/// How long a body has stood.
#[derive(Clone, Copy, Debug, Default)]
struct Standing {
    /// Characteristic times at rest.
    rested: f64,
    /// It began to move untouched after it had stood: its height then.
    left_at: Option<f64>,
}

impl Motion {
    /// Before the engine's step.
    pub fn before_step(&mut self, world: &World) {
        self.before = world.free_velocities();
        self.energy.get_or_insert_with(|| world.mechanical_energy());
    }

    /// After the engine's step.
    pub fn after_step(&mut self, world: &World) {
        self.ballistic_error = self.ballistic_error.max(world.ballistic_error(&self.before));
        let began = self.energy.unwrap_or_default();
        self.growth = self.growth.max(world.mechanical_energy() - began);
        let standing = STANDING / world.units.time;
        let old = self.stands.clone();
        self.stands.resize(world.bodies().len(), Standing::default());
        // A body that moved in the step before, too.
        let moves = |side: PairSide| match side {
            PairSide::Body(b) => {
                world.bodies()[b].role == Role::Free && old.get(b).is_none_or(|standing| standing.rested == 0.0)
            }
            PairSide::Moving => true,
            PairSide::Ground | PairSide::Scenery => false,
        };
        for id in world.present() {
            let stand = &mut self.stands[id];
            let is_released = matches!(world.bodies()[id].role, Role::Free | Role::Frozen);
            if is_released && world.speed(id) < REST_SPEED {
                *stand = Standing { rested: stand.rested + world.step_length(), left_at: None };
                continue;
            }
            let height = world.pose(id).translation.y;
            if stand.rested >= standing && !world.pressed_by(id).any(moves) {
                stand.left_at = Some(height);
            }
            stand.rested = 0.0;
            if stand.left_at.is_some_and(|from| from - height > FALLEN) {
                stand.left_at = None;
                self.second_collapse += 1;
            }
        }
    }

    /// Something hits the pile, or it is asked to move: what has stood until now may fall.
    pub fn expect_collapse(&mut self) {
        self.stands.clear();
    }

    /// The most by which the mechanical energy grew over its value at the beginning, in weights of the pile times d.
    pub fn energy_growth(&self, world: &World) -> f64 {
        let weight: f64 = world.present().map(|id| world.bodies()[id].mass).sum();
        self.growth / weight.max(f64::MIN_POSITIVE)
    }
}
