//! Bodies joined by dots, and what their dots carry.

use super::Dot;
use crate::geometry::pose::Pose;
use crate::world::{BodyId, Role, World};
use cairn_statics::global::GlobalBody;
use cairn_statics::glue::{GlueSite, Loads};
use glam::{DQuat, DVec3};
use std::collections::{BTreeMap, BTreeSet};

/// A force, and a moment.
pub type Wrench = (DVec3, DVec3);

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
            dot.bodies().for_each(|id| of.entry(id).or_default().push(k));
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
                front.extend(dots[k].bodies());
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
    /// Whether contacts do anything new to it.
    pub fn is_awake(&self, world: &World) -> bool {
        match world.bodies()[self.members[0]].role {
            Role::Free => world.is_awake(self.members[0]),
            Role::Anchored => true,
            Role::Waiting | Role::Frozen | Role::Pinned | Role::Gone => false,
        }
    }

    /// Adds the dots that carry too much beside what they are used to. `calm`: what contacts and weight do to each body, averaged.
    /// Returns whether the loads had to be computed.
    pub fn overloaded(
        &mut self,
        world: &World,
        dots: &[Dot],
        calm: &BTreeMap<BodyId, Wrench>,
        broken: &mut Vec<usize>,
    ) -> bool {
        if !self.is_awake(world) {
            return false;
        }
        let first = self.members[0];
        let less = |(f, m): Wrench, calm: Option<&Wrench>| calm.map_or((f, m), |(g, n)| (f - *g, m - *n));
        let news: Vec<Wrench> = self.suffered(world).map(|(id, wrench)| less(wrench, calm.get(&id))).collect();
        let arm = self.dots.iter().map(|&k| dots[k].arm).fold(f64::INFINITY, f64::min);
        let weakest = self.dots.iter().map(|&k| dots[k].limit).fold(f64::INFINITY, f64::min);
        // No dot carries more than all that happens to the bodies, twice, with the longest lever that there is.
        let radius = world.carried(first).radius;
        let most: f64 = news.iter().map(|(f, m)| f.length() * (1.0 + 2.0 * radius / arm) + m.length() / arm).sum();
        if 2.0 * most <= weakest {
            return false;
        }
        let wanted = self.wanted(world, &news);
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

    /// Force and moment about its centre of mass that contacts and gravity give each body, in the frame of the dots.
    pub fn suffered<'w>(&'w self, world: &'w World) -> impl Iterator<Item = (BodyId, Wrench)> + 'w {
        let turn = self.turn(world);
        self.members.iter().map(move |&id| {
            let (force, moment) = world.load_on(id);
            // Gravity is 1 downward.
            (id, (turn * (force + DVec3::NEG_Y * world.bodies()[id].mass), turn * moment))
        })
    }

    /// From the world as it is to the frame of the dots.
    fn turn(&self, world: &World) -> DQuat {
        self.then.rotation * world.pose(self.members[0]).rotation.inverse()
    }

    /// The force and the moment that its dots must give each body, so that it moves with the others for all that it suffers.
    fn wanted(&self, world: &World, suffered: &[Wrench]) -> Vec<Wrench> {
        let mut wanted: Vec<Wrench> = suffered.iter().map(|&(f, m)| (-f, -m)).collect();
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
        let touches = self.dots.iter().map(touch).collect::<Option<Vec<_>>>()?;
        Loads::new(self.members.iter().map(body).collect(), touches, DVec3::NEG_Y).ok()
    }
}
