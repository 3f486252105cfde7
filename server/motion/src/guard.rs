//! The guard watches for states that physics forbids: bodies faster than anything in the scene could make them, energy
//! out of nothing, bodies that fell through the ground, bodies deep in each other. It takes such a step again in
//! smaller ones; what energy nothing gave even so, in one step or little by little, it takes out of the motion; bodies
//! that this does not help are set aside by name; and when too many are, the bake ends with an error. Each action is
//! counted and reported.

use cairn_engine::world::{BodyId, Energy, PUSH_OUT_SPEED, Role, Snapshot, Units, World};
use cairn_input::error::Error;
use cairn_input::error::SceneProblem;
use cairn_input::params::Params;
use cairn_input::scene::{Scene, StaticModel};
use cairn_prepare::effects::{EffectName, Resolved};
use std::collections::BTreeSet;

/// Actions of the guard.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Actions {
    /// Steps watched.
    pub steps: u64,
    /// Steps taken again in smaller ones.
    pub retries: u64,
    /// Steps after which energy was taken out of the motion, since it came from nothing.
    pub braked: u64,
    /// Bodies sank deep into each other.
    pub sinks: bool,
    /// Times that the contacts were stiffened for a while, because of that.
    pub stiffened: u64,
    /// Bodies set aside, each with the reason.
    pub aside: Vec<(BodyId, AsideReason)>,
}

/// The reason for which a body was set aside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AsideReason {
    NotFinite,
    TooFast,
    BelowGround,
}

impl AsideReason {
    pub const ALL: [AsideReason; 3] = [AsideReason::NotFinite, AsideReason::TooFast, AsideReason::BelowGround];

    /// The predicate of a sentence about the bodies.
    pub fn description(self) -> &'static str {
        match self {
            AsideReason::NotFinite => "became numerically unstable",
            AsideReason::TooFast => "became faster than anything in the scene could make them",
            AsideReason::BelowGround => "fell through the ground",
        }
    }
}

/// A step that failed is taken again in this many.
const RETRY_PARTS: u32 = 8;
/// Energy is checked every this many steps: it takes longer than all other checks, and a burst goes on.
const ENERGY_PERIOD: u64 = 4;
/// Steps retried in a row before the guard gives up on a gain of energy that finer steps do not cure.
const MOST_RETRIES_IN_A_ROW: u32 = 4;
/// The guard accepts gains of energy for this many steps once it has given up: a scene that needs a finer step
/// everywhere would take eight times as long.
const REST_STEPS: u64 = 40;
/// Energy that may be gained in a step, as a share of the kinetic energy before it: an error of integration.
const ENERGY_SHARE: f64 = 0.1;
/// Energy that may be gained since it was least, however many steps that takes, as a share of the kinetic energy: an
/// error of integration; and for each unit of mass, units of g d: bodies that overlap are pushed apart, and are lifted.
const MOST_GAIN: f64 = 0.05;
const MOST_LIFT: f64 = PUSH_OUT_SPEED * PUSH_OUT_SPEED;
/// Kinetic energy for each unit of mass of bodies that are pushed apart: what moves no faster is parted or settles.
const PARTED: f64 = PUSH_OUT_SPEED * PUSH_OUT_SPEED / 2.0;
/// Pushed apart, bodies get as fast as by a fall from this many d.
const PUSH_OUT_FALL: f64 = 1.0;
/// A body is too fast beyond this many times the speed of a fall from the highest place (hard cases: 2); a body that
/// bounces hands a light one more, and so does a heavy one that squeezes it out sideways like a pip. By turning it may
/// be this many times as fast again: a light rod that a heavy body hits at its end.
const SPEED_FACTOR: f64 = 2.0;
const BOUNCE_FACTOR: f64 = 4.0;
/// Heavy and light, by their masses' ratio.
const SQUEEZING: f64 = 100.0;
/// Overlaps are looked for every this many steps: they grow slowly, and each look goes over all contacts.
const DEPTH_PERIOD: u64 = 8;
/// Bodies are deep in each other beyond this share of the thinner one's thickness.
const DEEP: f64 = 0.5;
/// Up to this many new pairs, as a share of the bodies, leave a large pile undisturbed.
const FEW_DEEP: f64 = 1e-4;
/// Factor on contact stiffness and substeps for a while, if bodies are deep in each other.
const STIFFER: u32 = 2;
/// Contacts stay stiffer for this many steps.
const STIFF_STEPS: u64 = 80;
/// Contacts are stiffened at most this often: bodies that are deep after that are reported, not parted.
const MOST_STIFFENINGS: u64 = 4;
/// More bodies than this share (and than three) set aside, and there is no pile left to speak of.
const MOST_ASIDE: f64 = 0.2;

pub struct Guard {
    watches: bool,
    /// The name of the step's field.
    step_field: &'static str,
    pub actions: Actions,
    /// Height of the ground, engine units.
    ground: f64,
    speed_factor: f64,
    /// Highest place that a body has come from, above the ground, d.
    highest: f64,
    /// Fastest that a body was thrown or that scenery moves, d per characteristic time.
    thrown: f64,
    /// Bodies seen so far.
    known: usize,
    /// Retries in a row, and the step until which a gain of energy is accepted.
    in_a_row: u32,
    resting_until: u64,
    /// Energy gained since it was least; `None`: the pile is pushed, so that it may gain some.
    gain: Option<f64>,
    /// Pairs that were deep in each other at two looks in a row: placed so, or met with stiffer contacts already.
    deep: BTreeSet<(BodyId, Option<BodyId>)>,
    /// Those of the latest look.
    latest: BTreeSet<(BodyId, Option<BodyId>)>,
    stiff_until: Option<u64>,
    step: u64,
    /// The bodies before the current step.
    before: Snapshot,
}

impl Guard {
    /// `ground`: its height, engine units.
    pub fn new(scene: &Scene, params: &Params, resolved: &Resolved, units: Units, ground: f64) -> Guard {
        let bounces = resolved.is_on(EffectName::Restitution);
        let scenery = scene.statics.iter().map(scenery_speed).fold(0.0, f64::max);
        let emitted = scene.emitters.iter().map(|e| e.velocity.length()).fold(0.0, f64::max);
        let launched = scene.bodies.iter().map(|b| b.velocity.length()).fold(0.0, f64::max);
        Guard {
            watches: resolved.is_on(EffectName::Guard),
            step_field: params.physics.step.step_field(),
            actions: Actions::default(),
            ground,
            speed_factor: if bounces || resolved.mass_ratio > SQUEEZING { BOUNCE_FACTOR } else { SPEED_FACTOR },
            highest: 0.0,
            thrown: scenery.max(emitted).max(launched) * units.time / units.length,
            known: 0,
            in_a_row: 0,
            resting_until: 0,
            gain: Some(0.0),
            deep: BTreeSet::new(),
            latest: BTreeSet::new(),
            stiff_until: None,
            step: 0,
            before: Snapshot::default(),
        }
    }

    /// One step of the world. Its faults are in [`Guard::actions`].
    pub fn step(&mut self, world: &mut World) -> Result<(), Error> {
        if !self.watches {
            self.unwatched(world);
            return Ok(());
        }
        self.actions.steps += 1;
        // The engine does not know the inertia of a new body before its first step.
        let watched = !self.take_in_new(world) && world.nail_count() == 0 && !world.scenery_moves();
        let checks_energy = watched && self.step >= self.resting_until && self.step.is_multiple_of(ENERGY_PERIOD);
        world.snapshot(&mut self.before);
        let energy = (checks_energy || watched && self.gain.is_some()).then(|| world.energy_of(&self.before));
        let mut lost = world.step();
        let has_gained = checks_energy && energy.is_some_and(|energy| self.gained(world, energy));
        if has_gained || !self.faults(world).is_empty() {
            self.actions.retries += 1;
            self.in_a_row += 1;
            lost.extend(world.retry_step(&self.before, RETRY_PARTS));
            if self.in_a_row == MOST_RETRIES_IN_A_ROW {
                (self.in_a_row, self.resting_until) = (0, self.step + REST_STEPS);
            }
        } else if checks_energy {
            self.in_a_row = 0;
        }
        if let Some(energy) = energy {
            self.take_what_nothing_gave(world, energy);
        }
        let unstable = lost.iter().map(|&id| (id, AsideReason::NotFinite));
        let faults: Vec<(BodyId, AsideReason)> = unstable.chain(self.faults(world)).collect();
        faults.iter().filter(|f| f.1 != AsideReason::NotFinite).for_each(|f| world.remove(f.0));
        self.actions.aside.extend(&faults);
        self.look_for_overlaps(world);
        self.step += 1;
        self.end_if_hopeless(world)
    }

    /// A step without the guard's checks: only bodies that the engine itself gives up are set aside.
    fn unwatched(&mut self, world: &mut World) {
        let lost = world.step();
        self.actions.aside.extend(lost.into_iter().map(|id| (id, AsideReason::NotFinite)));
    }

    /// Takes the bodies that came since the last step into account. Returns whether any did.
    fn take_in_new(&mut self, world: &World) -> bool {
        let new = self.known..world.bodies().len();
        self.known = new.end;
        for id in new.clone().filter(|&id| world.is_present(id)) {
            self.highest = self.highest.max(world.pose(id).translation.y - self.ground);
        }
        !new.is_empty()
    }

    /// Top speed that a body can have, d per characteristic time.
    fn most_speed(&self) -> f64 {
        self.speed_factor * ((2.0 * (self.highest + PUSH_OUT_FALL)).sqrt() + self.thrown)
    }

    /// The bodies gained energy in the step without a cause.
    fn gained(&self, world: &World, before: Energy) -> bool {
        let after = world.energy_of(&self.before);
        after.whole - before.whole > ENERGY_SHARE * before.kinetic + PUSH_OUT_SPEED * world.step_length() * before.mass
    }

    /// From now on the pile is pushed: no energy is taken out of its motion. What topples over an edge has little more
    /// than it needs for that.
    pub fn expect_pushes(&mut self) {
        self.gain = None;
    }

    /// Takes the energy out of the motion that was gained without a cause, in this step or little by little. What is
    /// lost in between is friction's, and does not come back.
    fn take_what_nothing_gave(&mut self, world: &mut World, before: Energy) {
        let Some(gain) = &mut self.gain else { return };
        let after = world.energy_of(&self.before);
        if after.kinetic < PARTED * after.mass {
            *gain = 0.0;
            return;
        }
        *gain = (*gain + after.whole - before.whole).max(0.0);
        let excess = *gain - MOST_GAIN * after.kinetic - MOST_LIFT * after.mass;
        if excess > 0.0 {
            self.actions.braked += 1;
            *gain -= world.take_energy(&self.before, excess);
        }
    }

    /// Bodies at impossible places or speeds.
    fn faults(&self, world: &World) -> Vec<(BodyId, AsideReason)> {
        let most = self.most_speed();
        // A body placed below the ground is moving up.
        let runaway = world.runaway_bodies(most, SPEED_FACTOR * most, self.ground, PUSH_OUT_SPEED);
        let fault = |(id, too_fast)| (id, if too_fast { AsideReason::TooFast } else { AsideReason::BelowGround });
        runaway.into_iter().map(fault).collect()
    }

    /// Bodies that sink into each other meet stiffer contacts for a while.
    fn look_for_overlaps(&mut self, world: &mut World) {
        if self.stiff_until.is_some_and(|until| self.step >= until) {
            self.stiff_until = None;
            world.unstiffen(STIFFER);
        }
        if !self.step.is_multiple_of(DEPTH_PERIOD) {
            return;
        }
        let deep: BTreeSet<_> = world.deep_pairs(DEEP).into_iter().collect();
        // A hard fall is over by the next look.
        let stays: BTreeSet<_> = deep.intersection(&self.latest).copied().collect();
        let new = stays.difference(&self.deep).count();
        let new = if self.step > DEPTH_PERIOD { new } else { 0 };
        self.actions.sinks |= new > 0;
        let are_many = new as f64 > FEW_DEEP * world.bodies().len() as f64;
        self.deep.extend(stays);
        self.latest = deep;
        if are_many && self.stiff_until.is_none() && self.actions.stiffened < MOST_STIFFENINGS {
            self.actions.stiffened += 1;
            self.stiff_until = Some(self.step + STIFF_STEPS);
            world.stiffen(STIFFER);
        }
    }

    fn end_if_hopeless(&self, world: &World) -> Result<(), Error> {
        let (aside, bodies) = (self.actions.aside.len(), world.bodies().len());
        if aside <= 3 || aside as f64 <= MOST_ASIDE * bodies as f64 {
            return Ok(());
        }
        let text = format!(
            "the simulation does not stay stable: {}; raise physics.substeps, lower {}, or bring the bodies' \
             sizes and masses nearer to each other",
            describe_aside(&self.actions.aside, |id| id.to_string()).join("; "),
            self.step_field
        );
        Err(Error::Invalid(vec![SceneProblem::new("physics.substeps", text)]))
    }

    /// Pairs that were found deep in each other and still are, of bodies that are there.
    pub fn still_deep(&self, world: &World) -> usize {
        let there = |id: BodyId| !matches!(world.bodies()[id].role, Role::Gone);
        let deep = world.deep_pairs(DEEP);
        deep.iter().filter(|(a, b)| there(*a) && b.is_none_or(there)).count()
    }
}

/// A sentence for each reason for which bodies were set aside.
pub fn describe_aside(aside: &[(BodyId, AsideReason)], name: impl Fn(BodyId) -> String) -> Vec<String> {
    /// This many are named.
    const NAMED: usize = 8;
    let sentence = |fault: AsideReason| {
        let all: Vec<BodyId> = aside.iter().filter(|a| a.1 == fault).map(|a| a.0).collect();
        let names: Vec<String> = all.iter().take(NAMED).map(|&id| name(id)).collect();
        let more = if all.len() > NAMED { ", ..." } else { "" };
        let count = all.len();
        let (names, what) = (names.join(", "), fault.description());
        (count > 0).then(|| match count {
            1 => format!("body {names} {what}"),
            _ => format!("bodies {names}{more} ({count} in all) {what}"),
        })
    };
    AsideReason::ALL.into_iter().filter_map(sentence).collect()
}

/// Top speed of any point of moving scenery, m/s.
fn scenery_speed(model: &StaticModel) -> f64 {
    let reach = model.model.mesh.points.iter().map(|p| p.length()).fold(0.0, f64::max);
    let speed = |pair: &[cairn_input::scene::Keyframe]| {
        let (a, b) = (&pair[0].pose, &pair[1].pose);
        let turned = a.rotation.normalize().angle_between(b.rotation.normalize()) * reach;
        (a.translation.distance(b.translation) + turned) / (pair[1].time - pair[0].time)
    };
    model.keys.windows(2).map(speed).fold(0.0, f64::max)
}
