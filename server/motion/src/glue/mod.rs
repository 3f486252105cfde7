//! Glue at run time: joints between bodies of a pile, or between a body and its fixed surroundings. Joined bodies are a
//! cluster and move as one; clusters joined to the ground are fixed. An overloaded joint breaks, and its cluster parts.

mod cluster;
pub mod sites;

use super::policy::Policy;
use cairn_engine::invariants;
use cairn_engine::world::{BodyId, Role, World};
use cairn_geometry::pose::Pose;
use cluster::{BodyLoad, Cluster};
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;

/// A glue joint. Engine units.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Joint {
    pub a: BodyId,
    /// The other body; `None`: the ground or scenery.
    pub b: Option<BodyId>,
    /// Its place at the beginning, and the contact normal there, into `a`.
    pub point: DVec3,
    pub normal: DVec3,
    /// A moment counts as the force that causes it at this distance.
    pub arm: f64,
    /// Friction of the contact, and the mean distance of its points from its middle; `None`: a peg, whose ends do not
    /// touch.
    pub contact: Option<(f64, f64)>,
    /// Its force and moment in the certified equilibrium beside the contacts, on `a`.
    pub force: DVec3,
    pub moment: DVec3,
    /// It breaks beyond this |(force, moment / arm)|; infinite: it never does.
    pub limit: f64,
    pub is_broken: bool,
}

impl Joint {
    /// The one or two bodies that it joins.
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

    /// Its share of the load between the two bodies: the contact itself carries compression, the friction of that, and
    /// tilting moments within its points.
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

/// Counts of the glue.
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
pub struct PileGlue {
    pub joints: Vec<Joint>,
    pub tally: GlueTally,
    /// Clusters of bodies joined by unbroken joints, by lowest body id.
    clusters: BTreeMap<BodyId, Cluster>,
    /// Poses of the bodies when they were glued.
    homes: BTreeMap<BodyId, Pose>,
    breaks: bool,
    /// Engine time since the last body was released.
    settled: f64,
    /// Force and moment of contacts and weight on each body, averaged over about [`USED_TO`]. The fill squeezed the
    /// pile, and stiff clusters keep that squeeze: it is no load. A hit comes faster.
    calm: BTreeMap<BodyId, BodyLoad>,
}

/// Time after the last release in which the pile settles and no joint breaks, characteristic times.
const SETTLING: f64 = 2.0;
/// Time over which the load on a body is averaged, characteristic times.
const USED_TO: f64 = 1.0;

impl PileGlue {
    /// Glues the bodies of a world as they stand. `breaks`: joints may break.
    pub fn new(joints: Vec<Joint>, breaks: bool, world: &mut World, policy: &mut Policy) -> PileGlue {
        let mut glue = PileGlue { joints, breaks, ..PileGlue::default() };
        let ids: Vec<BodyId> = glue.joints.iter().flat_map(Joint::bodies).collect();
        glue.homes = ids.iter().map(|&id| (id, world.pose(id))).collect();
        glue.join(&ids, world, policy);
        glue.validate(world);
        let sizes: Vec<usize> = glue.clusters().map(<[BodyId]>::len).filter(|&bodies| bodies > 1).collect();
        glue.tally.clusters = sizes.len() as u64;
        glue.tally.cluster_max = sizes.into_iter().max().unwrap_or(0);
        glue
    }

    /// Clusters of bodies joined by unbroken joints, each ascending.
    pub fn clusters(&self) -> impl Iterator<Item = &[BodyId]> {
        self.clusters.values().map(|cluster| &cluster.members[..])
    }

    /// Rotation of a joint's first body since it was glued, and the present place of the joint.
    pub fn place_of(&self, joint: &Joint, world: &World) -> (DQuat, DVec3) {
        let home = self.homes.get(&joint.a).filter(|_| world.is_present(joint.a));
        let Some(home) = home else { return (DQuat::IDENTITY, joint.point) };
        let now = world.pose(joint.a);
        let turn = now.rotation * home.rotation.inverse();
        (turn, now.translation + turn * (joint.point - home.translation))
    }

    /// After a step: overloaded joints break. Returns the bodies that may move now.
    pub fn break_overloaded(&mut self, world: &mut World, policy: &mut Policy) -> Vec<BodyId> {
        if self.clusters.is_empty() {
            return Vec::new();
        }
        // Joints of a body that left the world are gone, too.
        let gone = |joint: &Joint| joint.bodies().any(|id| !world.is_present(id));
        let mut broken: Vec<usize> =
            (0..self.joints.len()).filter(|&k| !self.joints[k].is_broken && gone(&self.joints[k])).collect();
        let waits = world.present().any(|id| world.bodies()[id].role == Role::Waiting);
        self.settled = if waits { 0.0 } else { self.settled + world.step_length() };
        if self.breaks && self.settled > SETTLING {
            for cluster in self.clusters.values_mut() {
                self.tally.looks += u64::from(cluster.overloaded(world, &self.joints, &self.calm, &mut broken));
            }
        }
        if self.breaks {
            self.calm_down(world);
        }
        if broken.is_empty() { Vec::new() } else { self.break_joints(&broken, world, policy) }
    }

    /// Breaks these joints. Returns the bodies that may move now.
    pub fn break_joints(&mut self, broken: &[usize], world: &mut World, policy: &mut Policy) -> Vec<BodyId> {
        self.tally.broken += broken.len() as u64;
        let mut loose: Vec<BodyId> = Vec::new();
        for &k in broken {
            self.joints[k].is_broken = true;
            for id in self.joints[k].bodies() {
                loose.extend(self.part(id, world));
            }
        }
        loose.sort_unstable();
        loose.dedup();
        loose.retain(|&id| world.is_present(id));
        // Bodies that are no longer anchored may move.
        for &id in &loose {
            if world.bodies()[id].role == Role::Anchored {
                policy.release(world, id);
            }
        }
        self.join(&loose, world, policy);
        self.validate(world);
        loose
    }

    /// Where invariants are checked: every joint's bodies exist; clusters are disjoint, and every whole joint is within
    /// one; the bodies of a cluster are one in the world; and a cluster is anchored where a joint of it leads to the
    /// fixed surroundings.
    fn validate(&self, world: &World) {
        if !invariants::are_checked() {
            return;
        }
        let mut of = BTreeMap::new();
        for (first, cluster) in &self.clusters {
            assert_eq!(Some(first), cluster.members.first(), "a cluster goes by its first body");
            assert!(cluster.members.is_sorted_by(|a, b| a < b), "members ascend: {:?}", cluster.members);
            for &id in &cluster.members {
                assert!(of.insert(id, *first).is_none(), "body {id} is in two clusters");
            }
            let anchors = cluster.joints.iter().any(|&k| self.joints[k].b.is_none());
            assert_eq!(anchors, cluster.is_anchored, "cluster {first}");
            assert!(!anchors || world.bodies()[*first].role == Role::Anchored, "cluster {first} is anchored");
            if let [one, .., last] = cluster.members[..] {
                let merged = world.cluster_of(one);
                assert!(merged.is_some() && merged == world.cluster_of(last), "cluster {first} moves as one");
            }
        }
        for joint in &self.joints {
            assert!(joint.bodies().all(|id| id < world.bodies().len()), "a joint of no body: {joint:?}");
            let is_in_one = joint.b.is_none_or(|b| of.get(&joint.a) == of.get(&b)) && of.contains_key(&joint.a);
            assert!(joint.is_broken || is_in_one, "a whole joint between clusters: {joint:?}");
        }
    }

    /// Updates the averaged loads.
    fn calm_down(&mut self, world: &World) {
        let share = if self.settled > SETTLING { (world.step_length() / USED_TO).min(1.0) } else { 1.0 };
        for (id, (force, moment)) in
            self.clusters.values().filter(|g| g.is_awake(world)).flat_map(|g| g.suffered(world))
        {
            let (f, m) = self.calm.entry(id).or_insert((force, moment));
            *f += (force - *f) * share;
            *m += (moment - *m) * share;
        }
    }

    /// Dissolves all clusters.
    pub fn end(&mut self, world: &mut World, policy: &mut Policy) {
        for id in self.clusters.keys().copied().collect::<Vec<_>>() {
            for id in self.part(id, world) {
                if world.is_present(id) && world.bodies()[id].role == Role::Anchored {
                    policy.release(world, id);
                }
            }
        }
        self.breaks = false;
    }

    /// Takes the cluster of a body apart. Returns its bodies.
    fn part(&mut self, id: BodyId, world: &mut World) -> Vec<BodyId> {
        let of = self.clusters.iter().find(|(_, cluster)| cluster.members.binary_search(&id).is_ok());
        let Some(first) = of.map(|(&first, _)| first) else { return Vec::new() };
        let Some(cluster) = self.clusters.remove(&first) else { return Vec::new() };
        let merged = cluster.members.iter().filter(|&&id| world.is_present(id)).find_map(|&id| world.cluster_of(id));
        if let Some(merged) = merged {
            world.unglue(merged);
        }
        cluster.members
    }

    /// Joins these bodies by the unbroken joints between them.
    fn join(&mut self, ids: &[BodyId], world: &mut World, policy: &mut Policy) {
        for cluster in cluster::clusters(ids, &self.joints, &self.homes) {
            if let [first, _, ..] = cluster.members[..] {
                let roles = cluster.members.iter().map(|&id| world.bodies()[id].role);
                let waits = roles.clone().any(|role| role == Role::Waiting);
                // A cluster waits or moves as a whole.
                for &id in &cluster.members {
                    if waits { Policy::wait(world, id) } else { policy.release(world, id) }
                }
                world.glue(&cluster.members);
                if cluster.is_anchored {
                    Policy::anchor(world, first);
                }
            } else if let Some(&only) = cluster.members.first().filter(|_| cluster.is_anchored) {
                Policy::anchor(world, only);
            } else {
                continue;
            }
            self.clusters.insert(cluster.members[0], cluster);
        }
    }
}
