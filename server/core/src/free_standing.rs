//! The motion of a pile by physics alone: all bodies released and awake, without nails, holds, control or damping.

use cairn_engine::world::{BodyId, FrictionExcess, Momentum, World};
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Progress, Stage, observe};
use cairn_motion::pile::Pile;
use std::collections::BTreeMap;

/// Time for which physics alone moves the bodies, s.
const TIME: f64 = 5.0;
/// The engine's forces are judged in this last share of the time, when falling bodies have fallen.
const JUDGED: f64 = 0.2;
/// A body that moved less than this in the judged time rests, in d.
const RESTING: f64 = 0.01;
/// Contact patches that carry less than this share of the median prop's weight are not tested for friction.
const LEAST_LOAD: f64 = 0.01;

/// Motion and forces of the bodies.
pub struct FreeStanding {
    /// Steps simulated.
    pub steps: u64,
    pub figures: BTreeMap<&'static str, Option<f64>>,
}

/// `free_standing_fraction`, and how exactly the engine balances bodies at rest: `equilibrium_residual_max` and `_p95`,
/// `friction_violation_max` and `_mean` (weighted by the force that Coulomb's law allows), `energy_gain_rel`.
pub fn run(pile: &mut Pile, observer: &mut dyn Observer) -> Result<FreeStanding, Error> {
    let Pile { world, policy, control, .. } = pile;
    control.end(world, policy);
    let ids: Vec<BodyId> = world.present().filter(|&id| !world.bodies()[id].role.stands()).collect();
    let before = poses(world, &ids);
    policy.leave_to_physics(world);
    let steps = (TIME / world.units.time / world.step_length()).ceil() as u64;
    let judged = steps - (JUDGED * steps as f64).ceil() as u64;
    let (mut imbalance, mut at) = (Imbalance::new(world, &ids), before.clone());
    for k in 0..steps {
        if k == judged {
            (imbalance, at) = (Imbalance::new(world, &ids), poses(world, &ids));
        }
        world.step();
        if k >= judged {
            imbalance.add(world, &ids);
        }
        let fraction = 0.8 + 0.2 * k as f64 / steps as f64;
        let bodies = ids.len();
        let progress =
            Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0, frames: 0 };
        observe(observer, &progress)?;
    }
    let after = poses(world, &ids);
    let moved = |from: &[Pose], k: usize| from[k].translation.distance(after[k].translation);
    let stood = (0..ids.len()).filter(|&k| moved(&before, k) < 0.1).count();
    let resting: Vec<bool> = (0..ids.len()).map(|k| moved(&at, k) < RESTING).collect();
    let mut figures = imbalance.figures(&resting);
    figures.insert("free_standing_fraction", Some(stood as f64 / ids.len().max(1) as f64));
    Ok(FreeStanding { steps, figures })
}

fn poses(world: &World, ids: &[BodyId]) -> Vec<Pose> {
    ids.iter().map(|&id| world.pose(id)).collect()
}

/// Forces that the engine leaves unbalanced, over some steps.
struct Imbalance {
    momentum: Vec<Momentum>,
    /// Sum over steps of the squared residual. Shape `[body]`, (mg)^2.
    squares: Vec<f64>,
    steps: u64,
    friction: FrictionExcess,
    energy: f64,
    /// Sum of all increases of the mechanical energy.
    gain: f64,
    weight: f64,
}

impl Imbalance {
    fn new(world: &World, ids: &[BodyId]) -> Imbalance {
        Imbalance {
            momentum: ids.iter().map(|&id| world.momentum(id)).collect(),
            squares: vec![0.0; ids.len()],
            steps: 0,
            friction: FrictionExcess::default(),
            energy: world.mechanical_energy(),
            gain: 0.0,
            weight: ids.iter().map(|&id| world.bodies()[id].mass).sum(),
        }
    }

    /// After a step. An unbalanced force is a change of momentum.
    fn add(&mut self, world: &World, ids: &[BodyId]) {
        let dt = world.step_length();
        for (k, &id) in ids.iter().enumerate().filter(|&(_, &id)| world.is_present(id)) {
            let (body, now) = (&world.bodies()[id], world.momentum(id));
            let force = (now.linear - self.momentum[k].linear) / (dt * body.mass);
            let torque = (now.angular - self.momentum[k].angular) / (dt * body.mass * body.radius);
            self.squares[k] += force.length_squared() + torque.length_squared();
            self.momentum[k] = now;
        }
        let friction = world.friction_excess(LEAST_LOAD);
        self.friction.max = self.friction.max.max(friction.max);
        self.friction.excess += friction.excess;
        self.friction.limit += friction.limit;
        let energy = world.mechanical_energy();
        self.gain += (energy - self.energy).max(0.0);
        self.energy = energy;
        self.steps += 1;
    }

    fn figures(&self, resting: &[bool]) -> BTreeMap<&'static str, Option<f64>> {
        let root_mean = |(_, sum): (&bool, &f64)| (sum / self.steps.max(1) as f64).sqrt();
        let mut residuals: Vec<f64> = resting.iter().zip(&self.squares).filter(|pair| *pair.0).map(root_mean).collect();
        residuals.sort_by(f64::total_cmp);
        let p95 = residuals.get((residuals.len() * 95).div_ceil(100).saturating_sub(1));
        BTreeMap::from([
            ("equilibrium_residual_p95", p95.copied()),
            ("equilibrium_residual_max", residuals.last().copied()),
            ("friction_violation_max", Some(self.friction.max)),
            ("friction_violation_mean", Some(self.friction.excess / self.friction.limit.max(f64::MIN_POSITIVE))),
            ("energy_gain_rel", Some(self.gain / self.weight.max(f64::MIN_POSITIVE))),
        ])
    }
}
