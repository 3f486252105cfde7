//! Looks at the motion of a pile for what no one would believe: bodies in the air that do not fall as they should,
//! bodies that fall although nothing touched them after they had stood, and energy out of nothing.

use crate::hanging::Hanging;
use cairn_engine::world::{BodyId, ClusterId, PairSide, REST_SPEED, Role, World};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// A body that has been at rest for this long stands, s; of large bodies, which begin to fall slowly, for this many
/// characteristic times.
const STANDING: f64 = 1.0;
const STANDING_TIMES: f64 = 2.0;
/// A body that stood has fallen once it is this much lower, d.
const FALLEN: f64 = 0.1;

/// What was seen so far.
#[derive(Debug, Default)]
pub struct Motion {
    /// Largest deviation from free fall of a body that touched nothing, as a share of gravity.
    pub ballistic_error: f64,
    /// Bodies that stood for [`STANDING`] and then fell untouched.
    pub second_collapse: u64,
    /// Bodies that stood still in the air.
    pub hanging: Hanging,
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
    /// Characteristic times at rest, and untouched by what moves.
    rested: f64,
    /// The same, since something last hit the pile.
    stood: f64,
    /// It moved in the latest step.
    moves: bool,
    /// It began to move untouched after it had stood: its height then.
    left_at: Option<f64>,
}

impl Standing {
    /// It may fall although it has stood.
    fn expect_fall(&mut self) {
        (self.stood, self.left_at) = (0.0, None);
    }
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
        let standing = (STANDING / world.units.time).max(STANDING_TIMES);
        self.stands.resize(world.bodies().len(), Standing::default());
        let touched = self.touched(world);
        let mut leaving = BTreeMap::new();
        for id in world.present() {
            let stand = &mut self.stands[id];
            let is_released = matches!(world.bodies()[id].role, Role::Free | Role::Frozen);
            let rests = is_released && world.speed(id) < REST_SPEED;
            let height = world.pose(id).translation.y;
            stand.moves = !rests;
            if rests && !touched[id] {
                stand.rested += world.step_length();
                stand.stood += world.step_length();
            } else {
                if stand.stood >= standing && !touched[id] {
                    leaving.insert(id, height);
                }
                (stand.rested, stand.stood) = (0.0, 0.0);
            }
            if rests {
                stand.left_at = None;
            } else if stand.left_at.is_some_and(|from| from - height > FALLEN) {
                stand.left_at = None;
                self.second_collapse += 1;
            }
        }
        self.excuse(world, &touched, &mut leaving);
        leaving.into_iter().for_each(|(id, height)| self.stands[id].left_at = Some(height));
    }

    /// Takes out of `leaving` the bodies that leave since what they stood on was touched, and went.
    fn excuse(&self, world: &World, touched: &[bool], leaving: &mut BTreeMap<BodyId, f64>) {
        let mut left = leaving.len() + 1;
        while leaving.len() < left {
            left = leaving.len();
            let goes = |side: PairSide| match side {
                PairSide::Body(b) => {
                    let stand = &self.stands[b];
                    !leaving.contains_key(&b) && (touched[b] || stand.moves && stand.left_at.is_none())
                }
                PairSide::Moving => true,
                PairSide::Ground | PairSide::Scenery => false,
            };
            let excused: Vec<BodyId> = leaving.keys().copied().filter(|&id| world.touched_by(id).any(goes)).collect();
            for id in &excused {
                leaving.remove(id);
            }
        }
    }

    /// Bodies on which something presses that has moved for at least two steps, and what is glued to them. Shape
    /// `[body]`.
    fn touched(&self, world: &World) -> Vec<bool> {
        let mut touched = vec![false; self.stands.len()];
        for id in world.present() {
            let moves = self.stands[id].moves && world.speed(id) >= REST_SPEED && world.bodies()[id].role == Role::Free;
            if !moves && !world.scenery_moves() {
                continue;
            }
            for side in world.pressed_by(id) {
                match side {
                    PairSide::Body(b) if moves => touched[b] = true,
                    PairSide::Moving => touched[id] = true,
                    _ => {}
                }
            }
        }
        let shaken: BTreeSet<ClusterId> =
            world.present().filter(|&id| touched[id]).filter_map(|id| world.cluster_of(id)).collect();
        if shaken.is_empty() {
            return touched;
        }
        for id in world.present().filter(|&id| world.cluster_of(id).is_some_and(|cluster| shaken.contains(&cluster))) {
            touched[id] = true;
        }
        touched
    }

    /// How long each body has been at rest, untouched by what moves, characteristic times. Shape `[body]`; may be
    /// shorter.
    pub fn rested(&self) -> Vec<f64> {
        self.stands.iter().map(|stand| stand.rested).collect()
    }

    /// Something hits the pile, or it is asked to move: what has stood until now may fall.
    pub fn expect_collapse(&mut self) {
        self.stands.iter_mut().for_each(Standing::expect_fall);
    }

    /// What held these bodies broke under their load: they may fall.
    pub fn expect_falls(&mut self, ids: impl IntoIterator<Item = BodyId>) {
        ids.into_iter().for_each(|id| self.stands.get_mut(id).into_iter().for_each(Standing::expect_fall));
    }

    /// The body is about to be hit.
    pub fn disturb(&mut self, id: BodyId) {
        if let Some(stand) = self.stands.get_mut(id) {
            *stand = Standing::default();
        }
    }

    /// The most by which the mechanical energy grew over its value at the beginning, in weights of the pile times d.
    pub fn energy_growth(&self, world: &World) -> f64 {
        let weight: f64 = world.present().map(|id| world.bodies()[id].mass).sum();
        self.growth / weight.max(f64::MIN_POSITIVE)
    }
}
