//! Bodies joined by dots, and what their dots carry.

use super::Dot;
use crate::equilibrium::global::GlobalBody;
use crate::equilibrium::glue::{GlueTouch, Loads};
use crate::geometry::pose::Pose;
use crate::world::{BodyId, Role, World};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// A group of bodies joined by whole dots.
pub struct Group {
    /// Rising.
    pub members: Vec<BodyId>,
    /// Some dot joins it to what stands still.
    pub is_anchored: bool,
    /// Its dots, by their numbers.
    dots: Vec<usize>,
    /// Where its first was when it was glued: the frame of the dots, and of `loads`, is the world's of that time.
    then: Pose,
    /// Made when it is first asked.
    loads: Option<Loads>,
}

/// The groups that whole dots make of these bodies, in order of their first. `homes`: where each was when it was glued.
pub fn groups(ids: &[BodyId], dots: &[Dot], homes: &BTreeMap<BodyId, Pose>) -> Vec<Group> {
    let among: BTreeSet<BodyId> = ids.iter().copied().collect();
    let mut of: BTreeMap<BodyId, Vec<usize>> = among.iter().map(|&id| (id, Vec::new())).collect();
    for (k, dot) in dots.iter().enumerate().filter(|(_, dot)| !dot.is_broken) {
        if among.contains(&dot.a) && dot.b.is_none_or(|b| among.contains(&b)) {
            [Some(dot.a), dot.b].into_iter().flatten().for_each(|id| of.entry(id).or_default().push(k));
        }
    }
    let mut seen = BTreeSet::new();
    let mut groups = Vec::new();
    for &first in &among {
        let (mut members, mut joints, mut front) = (BTreeSet::new(), BTreeSet::new(), vec![first]);
        while let Some(id) = front.pop() {
            if !seen.insert(id) {
                continue;
            }
            members.insert(id);
            for &k in &of[&id] {
                joints.insert(k);
                front.extend([Some(dots[k].a), dots[k].b].into_iter().flatten());
            }
        }
        if !joints.is_empty() {
            groups.push(Group {
                is_anchored: joints.iter().any(|&k| dots[k].b.is_none()),
                then: homes[&first],
                members: members.into_iter().collect(),
                dots: joints.into_iter().collect(),
                loads: None,
            });
        }
    }
    groups
}

impl Group {
    /// Adds the dots that carry more than they can. Returns whether the loads had to be computed.
    pub fn overloaded(&mut self, world: &World, dots: &[Dot], broken: &mut Vec<usize>) -> bool {
        let first = self.members[0];
        let moves = match world.bodies()[first].role {
            Role::Free => world.is_awake(first),
            Role::Anchored => true,
            Role::Waiting | Role::Frozen | Role::Pinned | Role::Gone => false,
        };
        let weakest = self.dots.iter().map(|&k| dots[k].limit).fold(f64::INFINITY, f64::min);
        if !moves || weakest == f64::INFINITY {
            return false;
        }
        let wanted = self.wanted(world);
        let arm = self.dots.iter().map(|&k| dots[k].arm).fold(f64::INFINITY, f64::min);
        // No dot carries more than all that the bodies ask for, with the longest lever that there is.
        let (_, radius, _) = world.carried(first);
        let most: f64 = wanted.iter().map(|(f, m)| f.length() * (1.0 + 2.0 * radius / arm) + m.length() / arm).sum();
        if most <= weakest {
            return false;
        }
        // Back to the frame in which the dots were placed.
        let turn = self.then.rotation * world.pose(first).rotation.inverse();
        let wanted: Vec<(DVec3, DVec3)> = wanted.iter().map(|&(f, m)| (turn * f, turn * m)).collect();
        if self.loads.is_none() {
            self.loads = self.make_loads(world, dots);
        }
        let Some(loads) = &mut self.loads else { return false };
        for (carried, &k) in loads.carry(&wanted).iter().zip(&self.dots) {
            if dots[k].load_of(carried.force, carried.moment) > dots[k].limit {
                broken.push(k);
            }
        }
        true
    }

    /// The force and the moment that its dots must give each body, beside contacts and gravity, so that it moves with the others.
    fn wanted(&self, world: &World) -> Vec<(DVec3, DVec3)> {
        let members = || self.members.iter().copied();
        let mass = |id: BodyId| world.bodies()[id].mass;
        // Gravity is 1 downward.
        let weight = |id: BodyId| DVec3::NEG_Y * mass(id);
        let loads: Vec<(DVec3, DVec3)> = members().map(|id| world.load_on(id)).collect();
        let mut wanted: Vec<(DVec3, DVec3)> =
            members().zip(&loads).map(|(id, &(force, moment))| (-force - weight(id), -moment)).collect();
        if self.is_anchored {
            return wanted;
        }
        let (total, center) = (members().map(mass).sum::<f64>(), world.carried_center(self.members[0]));
        let arm = |id: BodyId| world.pose(id).translation - center;
        let force: DVec3 = wanted.iter().map(|(force, _)| -force).sum();
        let moment: DVec3 = members().zip(&wanted).map(|(id, &(f, m))| -m - arm(id).cross(f)).sum();
        let inertia = members().map(|id| world.inertia_about(id, center)).reduce(|a, b| a + b).unwrap_or_default();
        let (acceleration, spin) = (force / total, inertia.inverse() * moment);
        if !spin.is_finite() {
            return wanted;
        }
        for (id, (f, m)) in members().zip(&mut wanted) {
            *f += (acceleration + spin.cross(arm(id))) * mass(id);
            *m += world.inertia(id) * spin;
        }
        wanted
    }

    fn make_loads(&self, world: &World, dots: &[Dot]) -> Option<Loads> {
        let first = self.members[0];
        let now = world.pose(first);
        let back = |point: DVec3| {
            self.then.translation + self.then.rotation * (now.rotation.inverse() * (point - now.translation))
        };
        let body = |&id: &BodyId| {
            let b = &world.bodies()[id];
            GlobalBody { mass: b.mass, center_of_mass: back(world.pose(id).translation), radius: b.radius }
        };
        let index = |id: BodyId| self.members.binary_search(&id).ok();
        let touch = |&k: &usize| {
            let Dot { a, b, point, arm, .. } = dots[k];
            Some(GlueTouch { body: index(a)?, other: b.and_then(index), contacts: 0..0, center: point, arm, may: true })
        };
        let touches = self.dots.iter().map(touch).collect::<Option<Vec<_>>>()?;
        Loads::new(self.members.iter().map(body).collect(), touches, DVec3::NEG_Y).ok()
    }
}
