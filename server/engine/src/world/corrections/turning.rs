//! Contacts of what turns together.
//!
//! The engine keeps the contacts of a pair that does not move against each other, and with them the arms from the
//! centers of mass, in the world's axes, until the pair has turned by eleven degrees. So on scenery that turns, a
//! contact moves where it moved that long ago, and friction carries all that rides there outward, by some millimeters
//! a radian at any speed. The contacts of such pairs are found again in each step.
//!
//! The arms still stay for one step, in which friction leads bodies along a tangent: with an angular velocity w at an
//! arm r, outward by w^2 r dt^2 / 2. They are put back by that. And since the tangent changes from step to step all at
//! once, one substep would have to do what friction can do in all of them: so the velocity of what rides is led to the
//! new tangent before the step, and a force pulls that out of it evenly during the step. Both together give no
//! momentum, and it slides where w^2 r is more than friction holds.

use crate::world::bodies::Bodies;
use rapier3d::prelude::*;

/// A body rides on scenery that turns if its velocity there, and its angular velocity, are those of the scenery up to
/// this share.
const RIDES: f32 = 0.25;

/// What the engine never keeps the contacts of: what a hook may change. There is none that does.
const RENEWED: ActiveHooks = ActiveHooks::MODIFY_SOLVER_CONTACTS;

/// A piece whose own velocity changes by more than this share in a step is jerked, and does not turn about an axis.
const JERK: f32 = 0.25;

/// Scenery that turns in this step.
#[derive(Clone, Copy)]
pub struct TurningPiece {
    pub body: RigidBodyHandle,
    pub collider: ColliderHandle,
    pub angular_velocity: Vector,
}

impl TurningPiece {
    /// By how much the velocity of its center of mass changes with the next step.
    fn change(&self, engine: &PhysicsWorld) -> Vector {
        let rigid = &engine.bodies[self.body];
        let next = rigid.next_position().transform_point(rigid.local_center_of_mass());
        let velocity = (next - rigid.center_of_mass()) / engine.integration_parameters.dt;
        let change = velocity - rigid.linvel();
        if change.length() < JERK * velocity.length() { change } else { Vector::ZERO }
    }

    fn carries(&self, engine: &PhysicsWorld, rigid: &RigidBody) -> bool {
        let own = self.angular_velocity.length();
        if !rigid.is_dynamic() || (rigid.angvel() - self.angular_velocity).length() > RIDES * own {
            return false;
        }
        let arm = rigid.center_of_mass() - engine.bodies[self.body].center_of_mass();
        let there = engine.bodies[self.body].linvel() + self.angular_velocity.cross(arm);
        (rigid.linvel() - there).length() < RIDES * self.angular_velocity.cross(arm).length()
    }
}

/// A body that rides on scenery that turns, in one step.
pub struct Rider {
    body: RigidBodyHandle,
    piece: TurningPiece,
    /// Its acceleration about the piece's center of mass.
    inward: Vector,
    /// Of its velocity, in the step.
    change: Vector,
}

/// Scenery that turns, and what rides on it.
#[derive(Clone, Default)]
pub struct Turning {
    pieces: Vec<TurningPiece>,
}

impl Turning {
    /// Before a step: the contacts of these pieces and of what rides on them will be found again. `all`: the colliders
    /// of all pieces.
    pub fn renew_contacts(
        &mut self,
        pieces: Vec<TurningPiece>,
        all: impl Iterator<Item = ColliderHandle>,
        engine: &mut PhysicsWorld,
        bodies: &Bodies,
    ) {
        let before = std::mem::replace(&mut self.pieces, pieces);
        if before.is_empty() && self.pieces.is_empty() {
            return;
        }
        for collider in all {
            set_renewed(&mut engine.colliders, collider, self.pieces.iter().any(|piece| piece.collider == collider));
        }
        for body in bodies.as_slice() {
            let rides = match engine.bodies.get(body.carrier) {
                Some(rigid) => self.pieces.iter().any(|piece| piece.carries(engine, rigid)),
                None => false,
            };
            set_renewed(&mut engine.colliders, body.collider, rides);
        }
    }

    /// Before a step: leads what rides on the pieces to the new tangent.
    pub fn lead(&self, engine: &mut PhysicsWorld, bodies: &Bodies) -> Vec<Rider> {
        let mut riders = Vec::new();
        if self.pieces.is_empty() {
            return riders;
        }
        let dt = engine.integration_parameters.dt;
        for (id, body) in bodies.free().filter(|&(id, _)| bodies.leads(id)) {
            let rigid = &engine.bodies[body.carrier];
            let Some(&piece) = self.pieces.iter().find(|piece| piece.carries(engine, rigid)) else { continue };
            let mut pairs = bodies
                .glued_with(id)
                .iter()
                .flat_map(|&member| engine.narrow_phase.contact_pairs_with(bodies[member].collider));
            if pairs.any(|pair| pair.total_impulse_magnitude() > 0.0) {
                let arm = rigid.center_of_mass() - engine.bodies[piece.body].center_of_mass();
                let inward = piece.angular_velocity.cross(piece.angular_velocity.cross(arm));
                riders.push(Rider { body: body.carrier, piece, inward, change: inward * dt + piece.change(engine) });
            }
        }
        for rider in &riders {
            if let Some(rigid) = engine.bodies.get_mut(rider.body) {
                rigid.set_linvel(rigid.linvel() + rider.change, false);
                rigid.add_force(-rider.change * (rigid.mass() / dt), false);
            }
        }
        riders
    }

    /// After the step: puts back what still rides on them.
    pub fn put_back(&self, engine: &mut PhysicsWorld, riders: &[Rider]) {
        let dt = engine.integration_parameters.dt;
        for Rider { body, piece, inward, .. } in riders {
            let still = engine.bodies.get(*body).is_some_and(|rigid| piece.carries(engine, rigid));
            let Some(rigid) = engine.bodies.get_mut(*body) else { continue };
            rigid.reset_forces(false);
            let place = rigid.translation() + *inward * (dt * dt / 2.0);
            if still && place.is_finite() {
                rigid.set_translation(place, false);
            }
        }
    }
}

fn set_renewed(colliders: &mut ColliderSet, handle: ColliderHandle, is_renewed: bool) {
    let hooks = if is_renewed { RENEWED } else { ActiveHooks::empty() };
    if colliders.get(handle).is_some_and(|collider| collider.active_hooks() != hooks)
        && let Some(collider) = colliders.get_mut(handle)
    {
        collider.set_active_hooks(hooks);
    }
}
