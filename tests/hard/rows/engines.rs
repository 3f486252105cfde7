//! The two that a case is run by: Cairn as it is delivered, and rapier with its default parameters.

use cairn_core::bake;
use cairn_core::report::Report;
use cairn_engine::shape;
use cairn_engine::shape::Shape;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, ControlMode, Params, ReleaseOrder};
use cairn_input::scene::{PlacedBody, Scene};
use cairn_prepare::check;
use glam::DVec3;
use rapier3d::math::Pose as EnginePose;
use rapier3d::prelude::*;

/// Frames per second of every motion.
pub const FPS: f64 = 60.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// `cairn bake` at accuracy `standard`.
    Cairn,
    /// The same with `control = "off"`.
    Uncontrolled,
    /// rapier with its default parameters, steps of 1/60 s, in metres; the same collision shapes.
    Plain,
}

/// What a scene did. Bodies in the order of the scene, whatever their start.
pub struct Motion {
    /// Shape `[frame][body]`, SI, from the props' own frames.
    pub frames: Vec<Vec<Pose>>,
    /// Of a bake.
    pub report: Option<Report>,
}

/// Parameters of a case.
pub fn params(engine: Engine, seconds: f64) -> Params {
    let mut params = Params::new(Accuracy::Standard);
    params.ground_friction = 0.7;
    params.release.order = ReleaseOrder::AtOnce;
    // A pile at rest is simulated all the same: what creeps must show.
    params.hold.least_seconds = seconds;
    params.output.fps = FPS;
    params.output.frames = Some((seconds * FPS).round() as u32);
    if engine == Engine::Uncontrolled {
        params.control.mode = ControlMode::Off;
    }
    params
}

/// Runs a scene of bodies placed by hand.
pub fn run(engine: Engine, scene: &Scene, seconds: f64) -> Motion {
    let params = params(engine, seconds);
    match engine {
        Engine::Plain => plain(scene, &params, seconds),
        _ => baked(scene, &params),
    }
}

/// Bakes a scene.
pub fn baked(scene: &Scene, params: &Params) -> Motion {
    let bake = bake(scene, params, &mut Silent).unwrap_or_else(|e| panic!("a case must bake: {e}"));
    Motion { frames: bake.pile.frames, report: Some(bake.report) }
}

fn shapes(scene: &Scene, params: &Params) -> Vec<Shape> {
    let checked = check::run(scene, params).expect("a sound case");
    shape::run(scene, params, &checked.sizes, &mut Silent).expect("props with volume")
}

fn engine_pose(pose: &Pose) -> EnginePose {
    EnginePose::from_parts(pose.translation.as_vec3(), pose.rotation.as_quat())
}

/// The same bodies in rapier as it comes.
fn plain(scene: &Scene, params: &Params, seconds: f64) -> Motion {
    let shapes = shapes(scene, params);
    let mut world = PhysicsWorld::new();
    let ground = ColliderBuilder::halfspace(rapier3d::na::Unit::new_unchecked(Vector::Y));
    world.insert_collider(ground.friction(params.ground_friction as f32), None);
    let mut moving = Vec::new();
    for model in &scene.statics {
        let points = model.model.mesh.points.iter().map(|p| p.as_vec3()).collect();
        let mesh = ColliderBuilder::trimesh(points, model.model.mesh.triangles.clone()).expect("a sound mesh");
        let rigid = match model.keys.is_empty() {
            true => RigidBodyBuilder::fixed(),
            false => RigidBodyBuilder::kinematic_position_based().pose(engine_pose(&model.pose_at(0.0))),
        };
        let (handle, _) = world.insert(rigid, mesh.friction(model.friction as f32));
        moving.push(handle);
    }
    let mut handles: Vec<Option<RigidBodyHandle>> = vec![None; scene.bodies.len()];
    let mut frames = Vec::new();
    for step in 0..=(seconds * FPS).round() as u32 {
        let time = f64::from(step) / FPS;
        for (handle, given) in handles.iter_mut().zip(&scene.bodies).filter(|(h, g)| h.is_none() && g.start <= time) {
            *handle = Some(insert(&mut world, scene, &shapes, given));
        }
        let pose = |(handle, given): (&Option<RigidBodyHandle>, &PlacedBody)| match handle {
            Some(handle) => {
                let at = world.bodies[*handle].position();
                let body = Pose { translation: at.translation.as_dvec3(), rotation: at.rotation.as_dquat() };
                shapes[given.prop].prop_pose(&body, given.scale)
            }
            None => given.pose,
        };
        frames.push(handles.iter().zip(&scene.bodies).map(pose).collect());
        for (&handle, model) in moving.iter().zip(&scene.statics).filter(|(_, m)| !m.keys.is_empty()) {
            world.bodies[handle].set_next_kinematic_position(engine_pose(&model.pose_at(time + 1.0 / FPS)));
        }
        world.step();
    }
    Motion { frames, report: None }
}

fn insert(world: &mut PhysicsWorld, scene: &Scene, shapes: &[Shape], given: &PlacedBody) -> RigidBodyHandle {
    let (shape, prop) = (&shapes[given.prop], &scene.props[given.prop]);
    let kg = shape.mass * given.scale.powi(3);
    let rigid = RigidBodyBuilder::dynamic()
        .pose(engine_pose(&shape.body_pose(&given.pose, given.scale)))
        .linvel(given.velocity.as_vec3())
        .angvel(given.angular_velocity.as_vec3())
        .additional_mass_properties(shape.mass_properties(given.scale, 1.0, given.mass.unwrap_or(kg) / kg));
    let (place, solid) = shape.collider(given.scale).expect("a prop with volume");
    let collider = ColliderBuilder::new(solid).position(place).density(0.0);
    world.insert(rigid, collider.friction(prop.friction as f32).restitution(prop.restitution as f32)).0
}

impl Motion {
    pub fn first(&self) -> &[Pose] {
        &self.frames[0]
    }

    pub fn last(&self) -> &[Pose] {
        self.frames.last().expect("frame 0 is there")
    }

    pub fn place(&self, frame: usize, body: usize) -> DVec3 {
        self.frames[frame][body].translation
    }

    /// Speed of each body's origin between two frames, m/s. Shape `[body]`.
    pub fn speeds(&self, frame: usize) -> Vec<f64> {
        let pairs = self.frames[frame - 1].iter().zip(&self.frames[frame]);
        pairs.map(|(a, b)| a.translation.distance(b.translation) * FPS).collect()
    }

    /// Largest speed of any body's origin, m/s.
    pub fn top_speed(&self) -> f64 {
        (1..self.frames.len()).flat_map(|frame| self.speeds(frame)).fold(0.0, f64::max)
    }

    /// Largest displacement of any body's origin between two frames, m.
    pub fn drift(&self, from: usize, to: usize) -> f64 {
        let pairs = self.frames[from].iter().zip(&self.frames[to]);
        pairs.map(|(a, b)| a.translation.distance(b.translation)).fold(0.0, f64::max)
    }

    pub fn is_finite(&self) -> bool {
        self.frames.iter().flatten().all(|p| p.translation.is_finite() && p.rotation.is_finite())
    }

    /// A figure of the report; NaN where there is none, which passes no comparison.
    pub fn figure(&self, name: &str) -> f64 {
        let value = |report: &Report| report.measures.get(name).copied().flatten();
        self.report.as_ref().and_then(value).unwrap_or(f64::NAN)
    }

    /// A count of the report; 0 where the engine writes none.
    pub fn count(&self, name: &str) -> u64 {
        let count = |report: &Report| *report.counts.get(name).unwrap_or_else(|| panic!("no count {name}"));
        self.report.as_ref().map_or(0, count)
    }

    /// Bodies that the guard set aside or that were taken out of the fill, by the report's own count: in the frames,
    /// such a body stays at its last pose.
    pub fn lost(&self) -> u64 {
        ["bodies_lost", "removed_escaped", "removed_overlapping", "removed_sticking_out"]
            .iter()
            .map(|name| self.count(name))
            .sum()
    }
}
