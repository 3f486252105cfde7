//! What spins and tumbles must not gain energy.

use super::engines::Engine;
use super::scenes::{block, disc, prop};
use super::{Extent, Outcome, all};
use cairn_engine::shape::{Shape, Size};
use cairn_engine::world::{Insertion, Units, World};
use cairn_geometry::pose::Pose;
use cairn_input::params::{Accuracy, Params, Time};
use cairn_input::scene::Prop;
use glam::{DQuat, DVec3};
use rapier3d::math::Pose as EnginePose;
use rapier3d::prelude::*;

const SECONDS: f64 = 60.0;

/// One body, thrown.
struct Thrown {
    prop: Prop,
    pose: Pose,
    angular_velocity: DVec3,
    gravity: f64,
    /// Standard's own where not given.
    step: Option<Time>,
    /// Height of the centre of mass at rest, below which no potential energy counts, m.
    lowest: f64,
}

pub fn spin(engine: Engine, _: Extent) -> Outcome {
    growth(
        engine,
        &Thrown {
            prop: prop("disk", disc(0.1, 0.02), 0.3),
            pose: Pose { translation: DVec3::Y * 0.1, rotation: DQuat::from_rotation_x(1.4) },
            angular_velocity: DVec3::Y * 30.0,
            gravity: 9.81,
            step: None,
            lowest: 0.01,
        },
    )
}

/// Gravity is what scales the characteristic time: a world without it steps in seconds.
pub fn zero_g(engine: Engine, _: Extent) -> Outcome {
    growth(
        engine,
        &Thrown {
            prop: prop("brick", block(DVec3::new(0.4, 0.2, 0.1)), 0.3),
            pose: Pose { translation: DVec3::Y * 1e3, rotation: DQuat::IDENTITY },
            angular_velocity: DVec3::new(0.1, 6.0, 0.1),
            gravity: 1e-9,
            step: Some(Time::Seconds(1.0 / 60.0)),
            lowest: 0.0,
        },
    )
}

/// Largest rise of the energy above its beginning, as a share of that.
fn growth(engine: Engine, thrown: &Thrown) -> Outcome {
    let mut params = Params::new(Accuracy::Standard);
    params.physics.step = thrown.step.unwrap_or(params.physics.step);
    let size = Size::of(&thrown.prop.model.mesh);
    let shape = Shape::new(&thrown.prop, size, &params.physics).expect("a prop with volume");
    let energies = match engine {
        Engine::Plain => plain(thrown, &shape),
        _ => own(thrown, &shape, &params),
    };
    let most = energies.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let gained = 100.0 * (most - energies[0]) / energies[0];
    all([(format!("gains {gained:.3} % in {SECONDS} s"), gained < 0.5)])
}

/// In units of the engine.
fn own(thrown: &Thrown, shape: &Shape, params: &Params) -> Vec<f64> {
    let units = Units::new(shape.size.diameter, shape.mass, thrown.gravity);
    let mut world = World::new(units, &params.physics, shape.thickness() / units.length, false);
    world.add_ground(0.0, 0.3);
    let pose = units.pose_to_engine(&shape.body_pose(&thrown.pose, 1.0));
    let insertion = Insertion { prop: 0, scale: 1.0, pose, friction: thrown.prop.friction, restitution: 0.0 };
    let id = world.insert(shape, &insertion).expect("a prop with volume");
    world.launch(id, DVec3::ZERO, thrown.angular_velocity);
    let ground = thrown.lowest / units.length;
    let steps = (SECONDS / (world.step_length() * units.time)).ceil() as usize;
    let energy = |world: &World| world.mechanical_energy() - ground;
    let heavy = thrown.gravity > 1e-6;
    // The engine knows the inertia from its first step on.
    let mut energies = Vec::new();
    for _ in 0..steps {
        world.step();
        energies.push(if heavy { energy(&world) } else { world.kinetic_energy() });
    }
    energies
}

/// In SI.
fn plain(thrown: &Thrown, shape: &Shape) -> Vec<f64> {
    let mut world = PhysicsWorld { gravity: Vector::NEG_Y * thrown.gravity as f32, ..PhysicsWorld::new() };
    world.insert_collider(ColliderBuilder::halfspace(rapier3d::na::Unit::new_unchecked(Vector::Y)).friction(0.3), None);
    let pose = shape.body_pose(&thrown.pose, 1.0);
    let rigid = RigidBodyBuilder::dynamic()
        .pose(EnginePose::from_parts(pose.translation.as_vec3(), pose.rotation.as_quat()))
        .angvel(thrown.angular_velocity.as_vec3())
        .additional_mass_properties(shape.mass_properties(1.0, 1.0, 1.0));
    let (place, solid) = shape.collider(1.0).expect("a prop with volume");
    let collider = ColliderBuilder::new(solid).position(place).density(0.0).friction(thrown.prop.friction as f32);
    let (handle, _) = world.insert(rigid, collider);
    let energy = |world: &PhysicsWorld| {
        let body = &world.bodies[handle];
        let height = f64::from(body.translation().y) - thrown.lowest;
        f64::from(body.kinetic_energy()) + shape.mass * thrown.gravity * height
    };
    let mut energies = Vec::new();
    for _ in 0..(SECONDS * 60.0) as usize {
        world.step();
        energies.push(energy(&world));
    }
    energies
}
