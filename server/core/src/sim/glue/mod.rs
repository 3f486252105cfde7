//! Glue: dots that join bodies of a pile, or a body and what stands still. Bodies joined by dots move as one; what is joined to the
//! ground stands. A dot that carries more than it can breaks, and what it joined parts.

mod cluster;
mod problem;

pub use problem::Sites;

use super::policy::Policy;
use crate::geometry::pose::Pose;
use crate::world::{BodyId, Role, World};
use cluster::{Group, Wrench};
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;

/// A glued touch. Engine units.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Dot {
    pub a: BodyId,
    /// The other body; `None`: the ground or scenery.
    pub b: Option<BodyId>,
    /// Where it is at the beginning, and the normal of the touch there, into `a`.
    pub point: DVec3,
    pub normal: DVec3,
    /// A moment counts as the force that causes it at this distance.
    pub arm: f64,
    /// Friction of the touch, and how far its contact points are from its middle; `None`: a peg, whose ends do not touch.
    pub contact: Option<(f64, f64)>,
    /// What it carries in the certified equilibrium beside the contacts, on `a`.
    pub force: DVec3,
    pub moment: DVec3,
    /// It breaks beyond this |(force, moment / arm)|; infinite: it never does.
    pub limit: f64,
    pub is_broken: bool,
}

impl Dot {
    /// What it joins: one body or two.
    pub fn bodies(&self) -> impl Iterator<Item = BodyId> + use<> {
        [Some(self.a), self.b].into_iter().flatten()
    }

    /// |(force, moment / arm)| of the certified equilibrium.
    pub fn load(&self) -> f64 {
        self.norm(self.force, self.moment)
    }

    fn norm(&self, force: DVec3, moment: DVec3) -> f64 {
        (force.length_squared() + (moment / self.arm).length_squared()).sqrt()
    }

    /// What it carries of all that passes through the touch: the contact itself takes what presses the two together, the friction
    /// of that, and what tilts them within its points.
    fn load_of(&self, force: DVec3, moment: DVec3) -> f64 {
        let Some((friction, spread)) = self.contact else { return self.norm(force, moment) };
        let press = force.dot(self.normal).max(0.0);
        let less = |v: DVec3, by: f64| v * (1.0 - by / v.length().max(by).max(f64::MIN_POSITIVE));
        let (pull, twist) = (force.dot(self.normal).min(0.0) * self.normal, moment.dot(self.normal) * self.normal);
        let (shear, tilt) = (force - force.dot(self.normal) * self.normal, moment - twist);
        let force = pull + less(shear, friction * press);
        self.norm(force, less(tilt, press * spread) + less(twist, friction * press * spread))
    }
}

/// What the glue has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GlueTally {
    pub broken: u64,
    /// Clusters at the beginning: bodies joined to each other.
    pub clusters: u64,
    /// Bodies in the largest of them.
    pub cluster_max: usize,
    /// Loads of clusters that were computed.
    pub looks: u64,
}

/// The glue of a pile.
#[derive(Default)]
pub struct Glue {
    pub dots: Vec<Dot>,
    pub tally: GlueTally,
    /// Bodies joined by whole dots, by their first.
    groups: BTreeMap<BodyId, Group>,
    /// Where its bodies were when they were glued.
    homes: BTreeMap<BodyId, Pose>,
    breaks: bool,
    /// Engine time since the last body was let go.
    settled: f64,
    /// What contacts and weight do to each body, averaged over about [`USED_TO`]. The fill squeezed the pile, and stiff clusters bear
    /// that on: it is no load. A hit comes faster.
    calm: BTreeMap<BodyId, Wrench>,
}

/// For so long after the last body was let go, natural times, the pile settles, and no dot breaks.
const SETTLING: f64 = 2.0;
/// Time in which bodies get used to what contacts do to them, natural times.
const USED_TO: f64 = 1.0;

impl Glue {
    /// Glues the bodies of a world as they stand. `breaks`: dots may break.
    pub fn new(dots: Vec<Dot>, breaks: bool, world: &mut World, policy: &mut Policy) -> Glue {
        let mut glue = Glue { dots, breaks, ..Glue::default() };
        let ids: Vec<BodyId> = glue.dots.iter().flat_map(Dot::bodies).collect();
        glue.homes = ids.iter().map(|&id| (id, world.pose(id))).collect();
        glue.join(&ids, world, policy);
        let sizes: Vec<usize> = glue.clusters().map(<[BodyId]>::len).filter(|&bodies| bodies > 1).collect();
        glue.tally.clusters = sizes.len() as u64;
        glue.tally.cluster_max = sizes.into_iter().max().unwrap_or(0);
        glue
    }

    /// Groups of bodies joined by whole dots, each rising.
    pub fn clusters(&self) -> impl Iterator<Item = &[BodyId]> {
        self.groups.values().map(|group| &group.members[..])
    }

    /// How a dot's first body has turned since it was glued, and where the dot is now.
    pub fn place_of(&self, dot: &Dot, world: &World) -> (DQuat, DVec3) {
        let home = self.homes.get(&dot.a).filter(|_| world.is_present(dot.a));
        let Some(home) = home else { return (DQuat::IDENTITY, dot.point) };
        let now = world.pose(dot.a);
        let turn = now.rotation * home.rotation.inverse();
        (turn, now.translation + turn * (dot.point - home.translation))
    }

    /// After a step: dots that carry too much break. Returns the bodies that may move now.
    pub fn break_overloaded(&mut self, world: &mut World, policy: &mut Policy) -> Vec<BodyId> {
        if self.groups.is_empty() {
            return Vec::new();
        }
        // Whoever was taken out of the world takes its dots along.
        let gone = |dot: &Dot| dot.bodies().any(|id| !world.is_present(id));
        let mut broken: Vec<usize> =
            (0..self.dots.len()).filter(|&k| !self.dots[k].is_broken && gone(&self.dots[k])).collect();
        let waits = world.present().any(|id| world.bodies()[id].role == Role::Waiting);
        self.settled = if waits { 0.0 } else { self.settled + world.step_length() };
        if self.breaks && self.settled > SETTLING {
            for group in self.groups.values_mut() {
                self.tally.looks += u64::from(group.overloaded(world, &self.dots, &self.calm, &mut broken));
            }
        }
        if self.breaks {
            self.calm_down(world);
        }
        if broken.is_empty() {
            return Vec::new();
        }
        self.tally.broken += broken.len() as u64;
        let mut loose: Vec<BodyId> = Vec::new();
        for &k in &broken {
            self.dots[k].is_broken = true;
            for id in self.dots[k].bodies() {
                loose.extend(self.part(id, world));
            }
        }
        loose.sort_unstable();
        loose.dedup();
        loose.retain(|&id| world.is_present(id));
        // What no longer hangs on the ground may move.
        for &id in &loose {
            if world.bodies()[id].role == Role::Anchored {
                policy.release(world, id);
            }
        }
        self.join(&loose, world, policy);
        loose
    }

    /// What contacts do to the bodies becomes, little by little, what they are used to.
    fn calm_down(&mut self, world: &World) {
        let share = if self.settled > SETTLING { (world.step_length() / USED_TO).min(1.0) } else { 1.0 };
        for (id, (force, moment)) in self.groups.values().filter(|g| g.is_awake(world)).flat_map(|g| g.suffered(world))
        {
            let (f, m) = self.calm.entry(id).or_insert((force, moment));
            *f += (force - *f) * share;
            *m += (moment - *m) * share;
        }
    }

    /// All of it dissolves.
    pub fn end(&mut self, world: &mut World, policy: &mut Policy) {
        for id in self.groups.keys().copied().collect::<Vec<_>>() {
            for id in self.part(id, world) {
                if world.is_present(id) && world.bodies()[id].role == Role::Anchored {
                    policy.release(world, id);
                }
            }
        }
        self.breaks = false;
    }

    /// Takes the group of a body apart. Returns its bodies.
    fn part(&mut self, id: BodyId, world: &mut World) -> Vec<BodyId> {
        let of = self.groups.iter().find(|(_, group)| group.members.binary_search(&id).is_ok());
        let Some(first) = of.map(|(&first, _)| first) else { return Vec::new() };
        let Some(group) = self.groups.remove(&first) else { return Vec::new() };
        let cluster = group.members.iter().filter(|&&id| world.is_present(id)).find_map(|&id| world.cluster_of(id));
        if let Some(cluster) = cluster {
            world.unglue(cluster);
        }
        group.members
    }

    /// Joins these bodies by the whole dots between them.
    fn join(&mut self, ids: &[BodyId], world: &mut World, policy: &mut Policy) {
        for group in cluster::groups(ids, &self.dots, &self.homes) {
            if let [first, _, ..] = group.members[..] {
                let roles = group.members.iter().map(|&id| world.bodies()[id].role);
                let waits = roles.clone().any(|role| role == Role::Waiting);
                // A cluster waits or moves as a whole.
                for &id in &group.members {
                    if waits { Policy::wait(world, id) } else { policy.release(world, id) }
                }
                world.glue(&group.members);
                if group.is_anchored {
                    Policy::anchor(world, first);
                }
            } else if let Some(&only) = group.members.first().filter(|_| group.is_anchored) {
                Policy::anchor(world, only);
            } else {
                continue;
            }
            self.groups.insert(group.members[0], group);
        }
    }
}
