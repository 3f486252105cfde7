//! rapier with its default parameters, but for step and iterations. Friction of a pair: the mean.

use crate::format::{PeerBody, PeerScene, PeerScenery, PeerShape, PeerSolid};
use crate::{Engine, Pace};
use anyhow::Context;
use rapier3d::math::{Pose, Rotation};
use rapier3d::prelude::*;

pub struct Rapier {
    world: PhysicsWorld,
    bodies: Vec<RigidBodyHandle>,
}

fn vector(v: [f64; 3]) -> Vector {
    Vector::new(v[0] as f32, v[1] as f32, v[2] as f32)
}

fn solid(shape: &PeerShape) -> anyhow::Result<SharedShape> {
    Ok(match &shape.solid {
        PeerSolid::Box(half) => SharedShape::cuboid(half[0] as f32, half[1] as f32, half[2] as f32),
        PeerSolid::Ball(radius) => SharedShape::ball(*radius as f32),
        PeerSolid::Hulls(parts) => {
            let hull = |part: &Vec<[f64; 3]>| {
                let points: Vec<Vector> = part.iter().map(|&p| vector(p)).collect();
                SharedShape::convex_hull(&points).map(|hull| (Pose::IDENTITY, hull))
            };
            SharedShape::compound(parts.iter().map(hull).collect::<Option<_>>().context("a part without volume")?)
        }
    })
}

impl Rapier {
    pub fn new(scene: &PeerScene, pace: &Pace) -> anyhow::Result<Rapier> {
        let mut world = PhysicsWorld::new();
        world.gravity = vector([0.0, -scene.gravity, 0.0]);
        world.integration_parameters.dt = pace.step as f32;
        world.integration_parameters.num_solver_iterations = pace.iterations as usize;
        let friction = scene.friction as f32;
        let ground = ColliderBuilder::halfspace(rapier3d::na::Unit::new_unchecked(Vector::Y));
        world.insert_collider(ground.translation(vector([0.0, scene.ground, 0.0])).friction(friction), None);
        let solids = scene.shapes.iter().map(solid).collect::<anyhow::Result<Vec<_>>>()?;
        let pose =
            |b: &PeerBody| Pose::from_parts(vector(b.position), Rotation::from_array(b.rotation.map(|x| x as f32)));
        for PeerScenery { place, velocity } in &scene.scenery {
            let rigid = match velocity {
                [0.0, 0.0, 0.0] => RigidBodyBuilder::fixed(),
                v => RigidBodyBuilder::kinematic_velocity_based().linvel(vector(*v)),
            };
            let collider = ColliderBuilder::new(solids[place.shape].clone()).friction(friction);
            world.insert(rigid.pose(pose(place)), collider);
        }
        let mut bodies = Vec::new();
        for body in &scene.bodies {
            let shape = &scene.shapes[body.shape];
            let mass = MassProperties::with_principal_inertia_frame(
                Vector::ZERO,
                shape.mass as f32,
                vector(shape.inertia),
                Rotation::IDENTITY,
            );
            let rigid = RigidBodyBuilder::dynamic().pose(pose(body)).additional_mass_properties(mass);
            let collider = ColliderBuilder::new(solids[body.shape].clone()).density(0.0).friction(friction);
            bodies.push(world.insert(rigid, collider).0);
        }
        for launch in &scene.launched {
            let body = &mut world.bodies[bodies[launch.body]];
            body.set_linvel(vector(launch.velocity), true);
            body.set_angvel(vector(launch.angular_velocity), true);
        }
        Ok(Rapier { world, bodies })
    }
}

impl Engine for Rapier {
    fn step(&mut self) {
        self.world.step();
    }

    fn pose(&self, body: usize) -> ([f64; 3], [f64; 4]) {
        let at = self.world.bodies[self.bodies[body]].position();
        (at.translation.to_array().map(f64::from), at.rotation.to_array().map(f64::from))
    }
}
