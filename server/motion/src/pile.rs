//! A pile in release or hold: its world, its bodies, and actions on it from outside.

use super::carried::Carried;
use super::control::PileControl;
use super::glue::PileGlue;
use super::instance::Instance;
use super::motion::Motion;
use super::policy::Policy;
use super::record::Recorder;
use super::withdrawal::Withdrawal;
use cairn_engine::shape::Shape;
use cairn_engine::world::{BodyId, Insertion, World};
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::params::Params;
use cairn_input::scene::{PlacedBody, Scene};

pub use cairn_engine::world::REST_SPEED;

/// Counts of release and hold so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PileCounters {
    pub layers: u64,
    /// Bodies released before their layer.
    pub released_early: u64,
    /// Bodies of a pile that is to be glued that came down until they touched another one, and those left out.
    pub hovering_lowered: u64,
    pub hovering_left_out: u64,
    pub bouncing_bodies: u64,
    pub bodies_emitted: u64,
    /// Awake bodies, summed over the steps.
    pub active_body_steps: u64,
}

/// A pile, its control and the frames so far.
pub struct Pile<'a> {
    pub world: World,
    pub policy: Policy,
    pub control: PileControl<'a>,
    pub glue: PileGlue,
    pub withdrawal: Withdrawal,
    pub motion: Motion,
    /// What carries the bodies that do not move.
    pub carried: Carried,
    pub recorder: Recorder,
    /// Steps since turning over.
    pub step: u64,
    /// Step of the latest release, drop, move or end of the control.
    pub latest_event: u64,
    /// In the order of insertion.
    pub instances: Vec<Instance>,
    /// Place of each body of the fill in the fill's list: bodies that would hover are left out. Shape `[body]`; bodies
    /// that the scene adds come behind them.
    pub places: Vec<usize>,
    pub counters: PileCounters,
    /// Warnings, one sentence each.
    pub notes: Vec<String>,
    pub scene: &'a Scene,
    pub shapes: &'a [Shape],
    params: &'a Params,
    /// Bodies have the restitution of their props; `false`: none.
    bounces: bool,
}

impl<'a> Pile<'a> {
    /// No bodies yet. The world has its ground and its fixed scenery.
    pub fn new(
        world: World,
        scene: &'a Scene,
        shapes: &'a [Shape],
        control: PileControl<'a>,
        recorder: Recorder,
        params: &'a Params,
        bounces: bool,
    ) -> Pile<'a> {
        Pile {
            world,
            policy: Policy::new(params.release.resistance),
            control,
            glue: PileGlue::default(),
            withdrawal: Withdrawal::default(),
            motion: Motion::default(),
            carried: Carried::default(),
            recorder,
            step: 0,
            latest_event: 0,
            instances: Vec::new(),
            places: Vec::new(),
            counters: PileCounters::default(),
            notes: Vec::new(),
            scene,
            shapes,
            params,
            bounces,
        }
    }

    /// Adds a free body.
    pub fn insert(&mut self, body: Instance) -> Result<BodyId, Error> {
        let prop = &self.scene.props[body.prop];
        let (friction, restitution) = (prop.friction, if self.bounces { prop.restitution } else { 0.0 });
        self.counters.bouncing_bodies += u64::from(restitution > 0.0);
        let insertion = Insertion { prop: body.prop, scale: body.scale, pose: body.pose, friction, restitution };
        let id = self.world.insert(&self.shapes[body.prop], &insertion).map_err(Error::Internal)?;
        self.policy.join(id);
        self.instances.push(body);
        self.recorder.expect();
        Ok(id)
    }

    /// Adds a body placed by hand, free and at rest.
    pub fn place(&mut self, placed: &PlacedBody) -> Result<BodyId, Error> {
        let shape = &self.shapes[placed.prop];
        let pose = self.world.units.pose_to_engine(&shape.body_pose(&placed.pose, placed.scale));
        let id = self.insert(Instance { prop: placed.prop, scale: placed.scale, pose })?;
        if let Some(kg) = placed.mass {
            self.world.set_mass(id, shape, kg);
        }
        Ok(id)
    }

    /// A recorded frame in SI, from the props' own frames. Shape `[body]`.
    pub fn prop_frame(&self, number: usize) -> impl Iterator<Item = Pose> {
        let units = self.world.units;
        let frame = self.recorder.frames[number].iter().zip(&self.instances);
        frame.map(move |(pose, b)| self.shapes[b.prop].prop_pose(&units.pose_to_si(pose), b.scale))
    }

    /// Releases a waiting or pinned body.
    pub fn release(&mut self, id: BodyId) {
        self.control.release(id);
        self.policy.release(&mut self.world, id);
    }

    /// Something moves the pile from outside: it must come to rest again.
    pub fn disturb(&mut self) {
        self.latest_event = self.step;
        self.recorder.disturb();
    }

    /// The pile begins to come down: its control ends, and what has stood may fall.
    pub fn begin_collapse(&mut self) {
        self.end_control(false);
        let whole: Vec<usize> = (0..self.glue.joints.len()).filter(|&k| !self.glue.joints[k].is_broken).collect();
        self.glue.break_joints(&whole, &mut self.world, &mut self.policy);
        // Contacts between bodies that were one.
        self.world.zero_step();
    }

    /// Breaks these joints of what holds the pile. The bodies that they held are free.
    pub fn break_joints(&mut self, glue: &mut PileGlue, joints: &[usize]) {
        if joints.is_empty() {
            return;
        }
        let loose = glue.break_joints(joints, &mut self.world, &mut self.policy);
        loose.iter().for_each(|&id| self.control.release(id));
        self.motion.expect_falls(loose);
        self.disturb();
    }

    /// The control is withdrawn, after `lag` characteristic times: the bake is done once the pile stands by itself. The
    /// withdrawal rises as fast as the release.
    pub fn withdraw_control(&mut self, lag: f64) {
        self.latest_event = self.step;
        let release = &self.params.release;
        let (step_length, interval) = (self.world.step_length(), self.world.units.duration(release.interval));
        let speed = release.layer / interval.max(step_length);
        self.policy.set_quiet(0.0);
        let begin = self.step + (lag / step_length).round() as u64;
        self.control.withdraw_below(f64::NEG_INFINITY);
        self.withdrawal.begin(begin, &self.world, speed);
    }

    /// The control ends and glue is gone. `withdraws`: the control is withdrawn; otherwise it ends at once.
    pub fn end_control(&mut self, withdraws: bool) {
        self.disturb();
        self.motion.expect_collapse();
        self.glue.end(&mut self.world, &mut self.policy);
        if withdraws {
            self.withdraw_control(0.0);
        } else {
            self.control.end(&mut self.world, &mut self.policy);
            self.policy.set_quiet(0.0);
        }
    }
}
