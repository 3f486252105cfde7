//! Box3D with its default world, but for the substeps; one worker. Friction of a pair: the root of the product.

use crate::format::{PeerBody, PeerScene, PeerScenery, PeerShape, PeerSolid};
use crate::{Engine, Pace};
use anyhow::ensure;
use box3d_sys::*;

pub struct Box3d {
    world: b3WorldId,
    bodies: Vec<b3BodyId>,
    step: f32,
    substeps: i32,
}

/// Half the edge of the ground's block, m, and half its depth.
const GROUND: (f32, f32) = (100.0, 1.0);

fn vector(v: [f64; 3]) -> b3Vec3 {
    b3Vec3 { x: v[0] as f32, y: v[1] as f32, z: v[2] as f32 }
}

/// A body's definition at its place.
fn body_def(place: &PeerBody, kind: b3BodyType) -> b3BodyDef {
    // SAFETY: a plain call.
    let mut def = unsafe { b3DefaultBodyDef() };
    def.type_ = kind;
    def.position = vector(place.position);
    let [x, y, z, w] = place.rotation;
    def.rotation = b3Quat { v: vector([x, y, z]), s: w as f32 };
    def
}

/// Gives a body its solid.
///
/// # Safety
/// The body must be there.
unsafe fn solid(id: b3BodyId, surface: &b3ShapeDef, shape: &PeerShape) -> anyhow::Result<()> {
    // SAFETY: definitions and hulls outlive the calls.
    unsafe {
        match &shape.solid {
            PeerSolid::Box(half) => {
                let hull = b3MakeBoxHull(half[0] as f32, half[1] as f32, half[2] as f32);
                b3CreateHullShape(id, surface, &hull.base);
            }
            PeerSolid::Ball(radius) => {
                let ball = b3Sphere { center: vector([0.0; 3]), radius: *radius as f32 };
                b3CreateSphereShape(id, surface, &ball);
            }
            PeerSolid::Hulls(parts) => {
                for part in parts {
                    let points: Vec<b3Vec3> = part.iter().map(|&p| vector(p)).collect();
                    let hull = b3CreateHull(points.as_ptr(), points.len() as i32, points.len() as i32);
                    ensure!(!hull.is_null(), "Box3D takes a part for no hull");
                    b3CreateHullShape(id, surface, hull);
                    b3DestroyHull(hull);
                }
            }
        }
    }
    Ok(())
}

impl Box3d {
    pub fn new(scene: &PeerScene, pace: &Pace) -> anyhow::Result<Box3d> {
        // SAFETY: plain calls of the library, with definitions that it filled itself; what it returns is not freed
        // before the process ends.
        unsafe {
            let mut def = b3DefaultWorldDef();
            def.gravity = vector([0.0, -scene.gravity, 0.0]);
            def.workerCount = 1;
            let world = b3CreateWorld(&def);
            let mut surface = b3DefaultShapeDef();
            surface.baseMaterial.friction = scene.friction as f32;

            let mut ground = b3DefaultBodyDef();
            ground.position = vector([0.0, scene.ground - f64::from(GROUND.1), 0.0]);
            let block = b3MakeBoxHull(GROUND.0, GROUND.1, GROUND.0);
            b3CreateHullShape(b3CreateBody(world, &ground), &surface, &block.base);

            for PeerScenery { place, velocity } in &scene.scenery {
                let kind = match velocity {
                    [0.0, 0.0, 0.0] => b3BodyType_b3_staticBody,
                    _ => b3BodyType_b3_kinematicBody,
                };
                let mut def = body_def(place, kind);
                def.linearVelocity = vector(*velocity);
                solid(b3CreateBody(world, &def), &surface, &scene.shapes[place.shape])?;
            }

            surface.updateBodyMass = false;
            let mut bodies = Vec::new();
            for body in &scene.bodies {
                let shape = &scene.shapes[body.shape];
                let id = b3CreateBody(world, &body_def(body, b3BodyType_b3_dynamicBody));
                solid(id, &surface, shape)?;
                let [x, y, z] = shape.inertia;
                let inertia =
                    b3Matrix3 { cx: vector([x, 0.0, 0.0]), cy: vector([0.0, y, 0.0]), cz: vector([0.0, 0.0, z]) };
                b3Body_SetMassData(id, b3MassData { mass: shape.mass as f32, center: vector([0.0; 3]), inertia });
                bodies.push(id);
            }
            for launch in &scene.launched {
                b3Body_SetLinearVelocity(bodies[launch.body], vector(launch.velocity));
                b3Body_SetAngularVelocity(bodies[launch.body], vector(launch.angular_velocity));
            }
            Ok(Box3d { world, bodies, step: pace.step as f32, substeps: pace.iterations as i32 })
        }
    }
}

impl Engine for Box3d {
    fn step(&mut self) {
        // SAFETY: the world lives as long as the process.
        unsafe { b3World_Step(self.world, self.step, self.substeps) }
    }

    fn pose(&self, body: usize) -> ([f64; 3], [f64; 4]) {
        // SAFETY: bodies are never removed.
        let (p, q) = unsafe { (b3Body_GetPosition(self.bodies[body]), b3Body_GetRotation(self.bodies[body])) };
        ([p.x, p.y, p.z].map(f64::from), [q.v.x, q.v.y, q.v.z, q.s].map(f64::from))
    }
}
