//! Clusters of joined bodies, and the loads of their joints.

use super::Joint;
use cairn_analysis::assembly;
use cairn_engine::world::{BodyId, Role, World};
use cairn_geometry::pose::Pose;
use cairn_statics::global::GlobalBody;
use cairn_statics::glue::{GlueSite, Loads};
use glam::{DQuat, DVec3};
use std::collections::{BTreeMap, BTreeSet};

/// A force, and a moment.
pub type BodyLoad = (DVec3, DVec3);

/// A cluster of bodies joined by unbroken joints.
pub struct Cluster {
    /// Ascending.
    pub members: Vec<BodyId>,
    /// Some joint joins it to the fixed surroundings.
    pub is_anchored: bool,
    /// Its joints, by their numbers.
    pub joints: Vec<usize>,
    /// Pose of its first body when it was glued. The frame of the joints and of `loads` is the world's of that time.
    then: Pose,
    /// Made at first use.
    loads: Option<Loads>,
}

/// The clusters of these bodies by unbroken joints, by lowest body id. `homes`: poses of the bodies when they were
/// glued.
pub fn clusters(ids: &[BodyId], joints: &[Joint], homes: &BTreeMap<BodyId, Pose>) -> Vec<Cluster> {
    let among: BTreeSet<BodyId> = ids.iter().copied().collect();
    let mut of: BTreeMap<BodyId, Vec<usize>> = among.iter().map(|&id| (id, Vec::new())).collect();
    for (k, joint) in joints.iter().enumerate().filter(|(_, joint)| !joint.is_broken) {
        if among.contains(&joint.a) && joint.b.is_none_or(|b| among.contains(&b)) {
            joint.bodies().for_each(|id| of.entry(id).or_default().push(k));
        }
    }
    let mut seen = BTreeSet::new();
    let mut clusters = Vec::new();
    for &first in &among {
        let (mut members, mut own, mut front) = (BTreeSet::new(), BTreeSet::new(), vec![first]);
        while let Some(id) = front.pop() {
            if !seen.insert(id) {
                continue;
            }
            members.insert(id);
            for &k in &of[&id] {
                own.insert(k);
                front.extend(joints[k].bodies());
            }
        }
        if !own.is_empty() {
            clusters.push(Cluster {
                is_anchored: own.iter().any(|&k| joints[k].b.is_none()),
                then: homes[&first],
                members: members.into_iter().collect(),
                joints: own.into_iter().collect(),
                loads: None,
            });
        }
    }
    clusters
}

impl Cluster {
    /// Whether contacts may change its loads.
    pub fn is_awake(&self, world: &World) -> bool {
        match world.bodies()[self.members[0]].role {
            Role::Free => world.is_awake(self.members[0]),
            Role::Anchored => true,
            Role::Waiting | Role::Frozen | Role::Pinned | Role::Gone => false,
        }
    }

    /// Adds the joints that are overloaded beyond the averaged load. `calm`: averaged force and moment of contacts and
    /// weight per body. Returns whether the loads had to be computed.
    pub fn overloaded(
        &mut self,
        world: &World,
        joints: &[Joint],
        calm: &BTreeMap<BodyId, BodyLoad>,
        broken: &mut Vec<usize>,
    ) -> bool {
        if !self.is_awake(world) {
            return false;
        }
        let first = self.members[0];
        let less = |(f, m): BodyLoad, calm: Option<&BodyLoad>| calm.map_or((f, m), |(g, n)| (f - *g, m - *n));
        let sudden: Vec<BodyLoad> = self.suffered(world).map(|(id, load)| less(load, calm.get(&id))).collect();
        let arm = self.joints.iter().map(|&k| joints[k].arm).fold(f64::INFINITY, f64::min);
        let weakest = self.joints.iter().map(|&k| joints[k].limit).fold(f64::INFINITY, f64::min);
        // No joint carries more than twice all loads on the bodies at the longest lever.
        let radius = world.carried(first).radius;
        let most: f64 = sudden.iter().map(|(f, m)| f.length() * (1.0 + 2.0 * radius / arm) + m.length() / arm).sum();
        if 2.0 * most <= weakest {
            return false;
        }
        let wanted = self.wanted(world, &sudden);
        if self.loads.is_none() {
            self.loads = self.make_loads(world, joints);
        }
        let Some(loads) = &mut self.loads else { return false };
        for (carried, &k) in loads.carry(&wanted).iter().zip(&self.joints) {
            if joints[k].load_of(carried.force, carried.moment) > joints[k].limit {
                broken.push(k);
            }
        }
        true
    }

    /// Force and moment about its centre of mass that contacts and gravity give each body, in the frame of the joints.
    pub fn suffered<'w>(&'w self, world: &'w World) -> impl Iterator<Item = (BodyId, BodyLoad)> + 'w {
        let turn = self.turn(world);
        self.members.iter().map(move |&id| {
            let (force, moment) = world.load_on(id);
            // Gravity is 1 downward.
            (id, (turn * (force + DVec3::NEG_Y * world.bodies()[id].mass), turn * moment))
        })
    }

    /// From the world as it is to the frame of the joints.
    fn turn(&self, world: &World) -> DQuat {
        self.then.rotation * world.pose(self.members[0]).rotation.inverse()
    }

    /// Force and moment that the joints must give each body, so that it moves with the others under its other loads.
    fn wanted(&self, world: &World, suffered: &[BodyLoad]) -> Vec<BodyLoad> {
        let mut wanted: Vec<BodyLoad> = suffered.iter().map(|&(f, m)| (-f, -m)).collect();
        if self.is_anchored {
            return wanted;
        }
        let turn = self.turn(world);
        let members = || self.members.iter().copied();
        let mass = |id: BodyId| world.bodies()[id].mass;
        let (total, center) = (members().map(mass).sum::<f64>(), world.carried_center(self.members[0]));
        let arm = |id: BodyId| turn * (world.pose(id).translation - center);
        let force: DVec3 = suffered.iter().map(|(force, _)| *force).sum();
        let moment: DVec3 = members().zip(suffered).map(|(id, &(f, m))| m + arm(id).cross(f)).sum();
        let inertia = members().map(|id| world.inertia_about(id, center)).reduce(|a, b| a + b).unwrap_or_default();
        let (acceleration, spin) = (force / total, turn * (inertia.inverse() * (turn.inverse() * moment)));
        if !spin.is_finite() {
            return wanted;
        }
        for (id, (f, m)) in members().zip(&mut wanted) {
            *f += (acceleration + spin.cross(arm(id))) * mass(id);
            *m += turn * (world.inertia(id) * (turn.inverse() * spin));
        }
        wanted
    }

    fn make_loads(&self, world: &World, joints: &[Joint]) -> Option<Loads> {
        let first = self.members[0];
        let now = world.pose(first);
        let back = |point: DVec3| {
            self.then.translation + self.then.rotation * (now.rotation.inverse() * (point - now.translation))
        };
        let body = |&id: &BodyId| {
            let body = assembly::body(world, id);
            GlobalBody { center_of_mass: back(body.center_of_mass), ..body }
        };
        let index = |id: BodyId| self.members.binary_search(&id).ok();
        let site = |&k: &usize| {
            let Joint { a, b, point, arm, .. } = joints[k];
            Some(GlueSite {
                body: index(a)?,
                other: b.and_then(index),
                contacts: 0..0,
                center: point,
                arm,
                may_glue: true,
                normal_price: 0.0,
            })
        };
        let sites = self.joints.iter().map(site).collect::<Option<Vec<_>>>()?;
        Loads::new(self.members.iter().map(body).collect(), sites, DVec3::NEG_Y).ok()
    }
}
