//! Jolt with its default settings, but for the velocity iterations; on the caller's thread alone. Friction of a pair:
//! the root of the product. Its C interface takes no inertia: that of the shape counts, with a density that gives the
//! mass. In problems with a known answer, nothing damps, corners are sharp, and gyroscopic forces are on.

use crate::format::{PeerBody, PeerScene, PeerScenery, PeerShape, PeerSolid};
use crate::{Engine, Pace};
use anyhow::{anyhow, ensure};
use joltc_sys::*;
use rolt::{
    BroadPhaseLayer, BroadPhaseLayerInterface, ObjectLayer, ObjectLayerPairFilter, ObjectVsBroadPhaseLayerFilter,
    PhysicsSystem,
};
use std::ffi::CStr;
use std::ptr::null_mut;

// Its own packages leave out the library of C++.
#[link(name = "stdc++")]
unsafe extern "C" {}

pub struct Jolt {
    system: PhysicsSystem,
    bodies: Vec<JPC_BodyID>,
    step: f32,
    scratch: *mut JPC_TempAllocatorImpl,
    jobs: *mut JPC_JobSystemThreadPool,
}

/// Half the edge of the ground's block, m, and half its depth.
const GROUND: (f32, f32) = (100.0, 1.0);
/// Bytes of scratch memory.
const SCRATCH: u32 = 256 << 20;
/// Pairs and contacts that it has room for.
const PAIRS: u32 = 1 << 17;

/// One layer for what stands still and one for what moves.
struct Layers;

const STILL: u16 = 0;
const MOVING: u16 = 1;

impl BroadPhaseLayerInterface for Layers {
    fn get_num_broad_phase_layers(&self) -> u32 {
        2
    }

    fn get_broad_phase_layer(&self, layer: ObjectLayer) -> BroadPhaseLayer {
        BroadPhaseLayer::new(layer.raw() as u8)
    }
}

impl ObjectVsBroadPhaseLayerFilter for Layers {
    fn should_collide(&self, a: ObjectLayer, b: BroadPhaseLayer) -> bool {
        a.raw() == MOVING || b.raw() == MOVING as u8
    }
}

impl ObjectLayerPairFilter for Layers {
    fn should_collide(&self, a: ObjectLayer, b: ObjectLayer) -> bool {
        a.raw() == MOVING || b.raw() == MOVING
    }
}

fn vector(v: [f64; 3]) -> JPC_Vec3 {
    let [x, y, z] = v.map(|x| x as f32);
    JPC_Vec3 { x, y, z, _w: z }
}

/// Calls one of Jolt's makers of shapes.
fn made(make: impl FnOnce(&mut *mut JPC_Shape, &mut *mut JPC_String) -> bool) -> anyhow::Result<*mut JPC_Shape> {
    let (mut shape, mut fault) = (null_mut(), null_mut());
    match make(&mut shape, &mut fault) {
        true => Ok(shape),
        // SAFETY: it failed, so that there is a text.
        false => Err(anyhow!("{}", unsafe { CStr::from_ptr(JPC_String_c_str(fault)) }.to_string_lossy())),
    }
}

fn block(half: [f64; 3], density: f32, sharp: bool) -> anyhow::Result<*mut JPC_Shape> {
    let usual = JPC_BoxShapeSettings::default();
    let least = half.iter().fold(f64::INFINITY, |a, &b| a.min(b)) as f32;
    let settings = JPC_BoxShapeSettings {
        HalfExtent: vector(half),
        Density: density,
        ConvexRadius: if sharp { 0.0 } else { usual.ConvexRadius.min(least / 2.0) },
        ..usual
    };
    // SAFETY: it reads the settings and writes the two.
    made(|shape, fault| unsafe { JPC_BoxShapeSettings_Create(&settings, shape, fault) })
}

/// The shape of a body whose parts have this density.
fn solid(shape: &PeerShape, density: f32, sharp: bool) -> anyhow::Result<*mut JPC_Shape> {
    let parts = match &shape.solid {
        PeerSolid::Box(half) => return block(*half, density, sharp),
        PeerSolid::Ball(radius) => {
            let settings = JPC_SphereShapeSettings { Radius: *radius as f32, Density: density, ..Default::default() };
            // SAFETY: it reads the settings and writes the two.
            return made(|shape, fault| unsafe { JPC_SphereShapeSettings_Create(&settings, shape, fault) });
        }
        PeerSolid::Hulls(parts) => parts,
    };
    let mut hulls = Vec::new();
    for part in parts {
        let points: Vec<JPC_Vec3> = part.iter().map(|&p| vector(p)).collect();
        let mut settings = JPC_ConvexHullShapeSettings {
            Points: points.as_ptr(),
            PointsLen: points.len(),
            Density: density,
            ..Default::default()
        };
        if sharp {
            settings.MaxConvexRadius = 0.0;
        }
        // SAFETY: the points outlive the call.
        let hull = made(|shape, fault| unsafe { JPC_ConvexHullShapeSettings_Create(&settings, shape, fault) })?;
        hulls.push(JPC_SubShapeSettings { Shape: hull, ..Default::default() });
    }
    let settings =
        JPC_StaticCompoundShapeSettings { SubShapes: hulls.as_ptr(), SubShapesLen: hulls.len(), ..Default::default() };
    // SAFETY: the hulls outlive the call, and Jolt counts who uses them.
    made(|shape, fault| unsafe { JPC_StaticCompoundShapeSettings_Create(&settings, shape, fault) })
}

/// The density at which the parts together have the body's mass.
fn density(shape: &PeerShape) -> anyhow::Result<f32> {
    let volume: f64 = match &shape.solid {
        PeerSolid::Box(half) => 8.0 * half.iter().product::<f64>(),
        PeerSolid::Ball(radius) => 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3),
        PeerSolid::Hulls(parts) => parts.iter().map(|part| rapier_volume(part)).sum(),
    };
    ensure!(volume > 0.0, "a shape without volume");
    Ok((shape.mass / volume) as f32)
}

fn rapier_volume(part: &[[f64; 3]]) -> f64 {
    use rapier3d::prelude::{SharedShape, Vector};
    let points: Vec<Vector> = part.iter().map(|p| Vector::from_array(p.map(|x| x as f32))).collect();
    SharedShape::convex_hull(&points).map_or(0.0, |hull| f64::from(hull.mass_properties(1.0).mass()))
}

impl Jolt {
    pub fn new(scene: &PeerScene, pace: &Pace) -> anyhow::Result<Jolt> {
        ensure!(scene.gravity == 9.81, "its C interface leaves gravity at 9.81 m/s^2");
        rolt::register_default_allocator();
        rolt::factory_init();
        rolt::register_types();
        let mut system = PhysicsSystem::new();
        system.init(1 << 16, 0, PAIRS, PAIRS, Layers, Layers, Layers);
        let bodies = system.body_interface().as_raw();
        let add = |settings: &JPC_BodyCreationSettings, activation| {
            // SAFETY: the settings name a shape that was made.
            unsafe { JPC_BodyInterface_CreateAndAddBody(bodies, settings, activation) }
        };
        let still = JPC_BodyCreationSettings {
            Position: vector([0.0, scene.ground - f64::from(GROUND.1), 0.0]),
            MotionType: JPC_MOTION_TYPE_STATIC,
            ObjectLayer: STILL,
            Friction: scene.friction as f32,
            Shape: block([GROUND.0, GROUND.1, GROUND.0].map(f64::from), 1.0, scene.exact)?,
            ..Default::default()
        };
        add(&still, JPC_ACTIVATION_DONT_ACTIVATE);
        let solids =
            scene.shapes.iter().map(|s| solid(s, density(s)?, scene.exact)).collect::<anyhow::Result<Vec<_>>>()?;
        let placed = |body: &PeerBody| {
            let [x, y, z, w] = body.rotation.map(|x| x as f32);
            JPC_BodyCreationSettings {
                Position: vector(body.position),
                Rotation: JPC_Quat { x, y, z, w },
                Friction: scene.friction as f32,
                Shape: solids[body.shape],
                ..Default::default()
            }
        };
        for PeerScenery { place, velocity } in &scene.scenery {
            let (kind, layer) = match velocity {
                [0.0, 0.0, 0.0] => (JPC_MOTION_TYPE_STATIC, STILL),
                _ => (JPC_MOTION_TYPE_KINEMATIC, MOVING),
            };
            let settings = JPC_BodyCreationSettings {
                MotionType: kind,
                ObjectLayer: layer,
                LinearVelocity: vector(*velocity),
                ..placed(place)
            };
            add(&settings, JPC_ACTIVATION_ACTIVATE);
        }
        let body = |(id, body): (usize, &PeerBody)| {
            let mut settings = JPC_BodyCreationSettings {
                MotionType: JPC_MOTION_TYPE_DYNAMIC,
                ObjectLayer: MOVING,
                NumVelocityStepsOverride: pace.iterations,
                ..placed(body)
            };
            if let Some(launch) = scene.launched.iter().find(|launch| launch.body == id) {
                settings.LinearVelocity = vector(launch.velocity);
                settings.AngularVelocity = vector(launch.angular_velocity);
            }
            if scene.exact {
                (settings.LinearDamping, settings.AngularDamping) = (0.0, 0.0);
                settings.ApplyGyroscopicForce = true;
            }
            add(&settings, JPC_ACTIVATION_ACTIVATE)
        };
        let bodies = scene.bodies.iter().enumerate().map(body).collect();
        system.optimize_broad_phase();
        // SAFETY: they live as long as the process.
        let (scratch, jobs) = unsafe {
            let jobs = JPC_JobSystemThreadPool_new3(JPC_MAX_PHYSICS_JOBS as u32, JPC_MAX_PHYSICS_BARRIERS as u32, 0);
            (JPC_TempAllocatorImpl_new(SCRATCH), jobs)
        };
        Ok(Jolt { system, bodies, step: pace.step as f32, scratch, jobs })
    }
}

impl Engine for Jolt {
    fn step(&mut self) {
        // SAFETY: allocator and jobs are there.
        unsafe { self.system.update(self.step, 1, self.scratch, self.jobs) }
    }

    fn pose(&self, body: usize) -> ([f64; 3], [f64; 4]) {
        let bodies = self.system.body_interface().as_raw();
        // SAFETY: bodies are never removed.
        let (p, q) = unsafe {
            let id = self.bodies[body];
            (JPC_BodyInterface_GetPosition(bodies, id), JPC_BodyInterface_GetRotation(bodies, id))
        };
        ([p.x, p.y, p.z].map(f64::from), [q.x, q.y, q.z, q.w].map(f64::from))
    }
}
