//! Taking out bodies that left the container, stick out, overlap or are too many; and parting those that stay.

use super::Filling;
use super::progress::{LAST, report};
use cairn_engine::shape::corners;
use cairn_engine::world::{BodyId, DEEPEST};
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use std::collections::{BTreeMap, BTreeSet};

/// Rounds of removing bodies that stick out or overlap, and settling again.
const CLEANUP_ROUNDS: usize = 4;
/// Settling after each of them, characteristic times.
const CLEANUP_SETTLE: f64 = 0.5;
/// In the end, no body reaches deeper into scenery than this, in its thickness.
const CUTS: f64 = 0.05;
/// Most steps of depenetration: bodies that overlap after them are locked in.
const MOST_DEPENETRATION: u64 = 120;

/// Rounds of taking out what is locked in: by these multiples of the overlap that may remain.
const LOCKED: [f64; 5] = [8.0, 4.0, 2.0, 1.0, 1.0];

impl Filling<'_> {
    /// Distance of the farthest corner of a body outside the container, engine units.
    fn protrusion(&self, id: BodyId) -> f64 {
        let (placed, container) = (self.world.instance(id), self.task.container);
        corners(&self.task.shapes[placed.prop], placed.scale / self.task.units.length, &placed.pose)
            .map(|p| container.shell().signed_distance(p).max(container.base - p.y))
            .fold(0.0, f64::max)
    }

    /// Whether a body has scenery through its middle, or a corner deeper in solid scenery than `limit` of its
    /// thickness.
    fn is_in_scenery(&self, id: BodyId, limit: f64) -> bool {
        let (placed, container) = (self.world.instance(id), self.task.container);
        let (shape, size) = (&self.task.shapes[placed.prop], placed.scale / self.task.units.length);
        if container.distance.signed_distance(placed.pose.translation) < -self.world.body(id).radius {
            return false;
        }
        let most = limit * self.world.body(id).thickness;
        container.pierced(shape, size, &placed.pose).is_some()
            || corners(shape, size, &placed.pose).any(|p| container.depth_in_scenery(p) > most)
    }

    /// Takes out bodies from `first` on, which are equally new, until `limit` bodies are left: some from everywhere go.
    pub fn cut_to(&mut self, limit: usize, first: BodyId) {
        let beyond = self.world.loose().count().saturating_sub(limit);
        let new: Vec<BodyId> = self.world.loose().filter(|&id| id >= first).collect();
        let beyond = beyond.min(new.len());
        (0..beyond).for_each(|i| self.world.remove(new[i * new.len() / beyond]));
    }

    /// Gives bodies that grew beyond their size their own size. Returns whether there were any.
    pub fn shrink_overgrown(&mut self) -> bool {
        let overgrown = std::mem::take(&mut self.overgrown);
        for &(id, scale) in &overgrown {
            if !self.world.is_present(id) {
                continue;
            }
            let shape = &self.task.shapes[self.world.body(id).prop];
            self.world.rescale(id, shape, scale);
        }
        !overgrown.is_empty()
    }

    /// Takes out bodies that left the container.
    pub fn remove_escaped(&mut self) {
        let (outside, container) = (self.task.params.fill.outside(), self.task.container);
        for id in self.world.loose().collect::<Vec<_>>() {
            let center = self.world.pose(id).translation;
            let is_inside = container.distance.signed_distance(center) <= outside && center.y > container.base;
            if !is_inside || container.is_solid_at(center) {
                self.world.remove(id);
                self.removed.escaped += 1;
            }
        }
    }

    /// Takes out bodies that stick out or overlap, until none does.
    pub fn clean_up(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        let fill = &self.task.params.fill;
        for round in 0.. {
            self.remove_escaped();
            let most = fill.protrusion + fill.outside();
            let out = self.world.loose().filter(|&id| self.protrusion(id) > most).collect::<Vec<_>>();
            self.removed.sticking_out += out.len();
            out.iter().for_each(|&id| self.world.remove(id));
            let pairs = self.world.overlapping(fill.overlap);
            let overlapping = self.remove_overlapping(pairs, 0);
            self.removed.overlapping += overlapping;
            let cutting = self.remove_cutting(fill.overlap);
            self.removed.cutting += cutting;
            if (out.is_empty() && overlapping == 0 && cutting == 0) || round == CLEANUP_ROUNDS {
                break;
            }
            self.settle(CLEANUP_SETTLE, observer)?;
        }
        Ok(())
    }

    /// Takes out bodies that reach into scenery by more than `limit` of their thickness. Returns the count.
    pub fn remove_cutting(&mut self, limit: f64) -> usize {
        if self.task.container.scenery().is_empty() {
            return 0;
        }
        let mut cutting = self.world.cutting_scenery(limit);
        // The engine finds no contact where a long body has gone far through a face, nor where the parts of one lie on
        // both sides of a sheet.
        let deep = self.world.loose().filter(|id| !cutting.contains(id) && self.is_in_scenery(*id, limit));
        let deep: Vec<BodyId> = deep.collect();
        cutting.extend(deep);
        cutting.iter().for_each(|&id| self.world.remove(id));
        cutting.len()
    }

    /// Takes out bodies that are in the place of scenery which was not there when they came.
    pub fn remove_from_scenery(&mut self) {
        if !self.task.container.scenery().is_empty() {
            self.remove_escaped();
            self.removed.cutting += self.remove_cutting(self.task.params.fill.overlap);
        }
    }

    /// Takes out bodies that still reach into scenery, after all that could part them from it, until none does.
    pub fn clear_scenery(&mut self, observer: &mut dyn Observer) -> Result<(), Error> {
        for _ in 0..CLEANUP_ROUNDS {
            self.remove_escaped();
            let cutting = self.remove_cutting(CUTS);
            self.removed.cutting += cutting;
            if cutting == 0 {
                break;
            }
            self.settle(CLEANUP_SETTLE, observer)?;
        }
        Ok(())
    }

    /// Parts bodies that still overlap. Returns the steps that this took.
    pub fn depenetrate(&mut self, observer: &mut dyn Observer) -> Result<u64, Error> {
        let residual = self.task.params.fill.residual_overlap;
        if residual >= 1.0 {
            return Ok(0);
        }
        let bodies = self.world.loose().count();
        let going = |step| report(bodies, LAST, observer).map(|()| step < MOST_DEPENETRATION);
        self.world.depenetrate(residual, going)
    }

    /// Takes out bodies that are locked in: those that no step of depenetration parts, since the container is fuller
    /// than full there. What is left is parted in the room that they leave; so those that overlap most go first.
    /// Returns the steps that this took.
    pub fn free_locked(&mut self, observer: &mut dyn Observer) -> Result<u64, Error> {
        let fill = &self.task.params.fill;
        let mut steps = 0;
        if fill.residual_overlap >= 1.0 {
            return Ok(steps);
        }
        for coarser in LOCKED {
            let most = fill.overlap.min(coarser * DEEPEST * fill.residual_overlap);
            let pairs = self.world.overlapping(most);
            let locked = self.remove_overlapping(pairs, 0);
            self.removed.overlapping += locked;
            if locked > 0 {
                steps += self.depenetrate(observer)?;
            }
        }
        Ok(steps)
    }

    /// Parts bodies in scenery that was fuller than full, which has room for that only now that it is open, and takes
    /// out those that this presses into it. Returns the steps that this took.
    pub fn part_in_scenery(&mut self, observer: &mut dyn Observer) -> Result<u64, Error> {
        // What may overlap more deeply than it may cut scenery would be pressed into that.
        let is_coarse = self.task.params.fill.residual_overlap * DEEPEST > CUTS;
        if self.task.container.scenery().is_empty() || is_coarse {
            return Ok(0);
        }
        let steps = self.depenetrate(observer)?;
        if steps > 0 {
            self.removed.cutting += self.remove_cutting(CUTS);
        }
        Ok(steps)
    }

    /// Takes out bodies from `first` on until none of these pairs is left: those in most pairs first. Bodies of near
    /// ids are near in space: of those in equally many pairs, bodies from everywhere go. Returns the count.
    pub fn remove_overlapping(&mut self, pairs: Vec<(BodyId, BodyId)>, first: BodyId) -> usize {
        let may_go = |id: BodyId| id >= first && self.world.is_loose(id);
        let mut others = BTreeMap::<BodyId, Vec<BodyId>>::new();
        for (a, b) in pairs.into_iter().flat_map(|(a, b)| [(a, b), (b, a)]) {
            others.entry(a).or_default().push(b);
        }
        let mut count: BTreeMap<BodyId, usize> = others.iter().map(|(&id, others)| (id, others.len())).collect();
        let key = |pairs: usize, id: BodyId| (pairs, id.reverse_bits());
        let mut order: BTreeSet<(usize, usize)> =
            count.iter().filter(|(id, _)| may_go(**id)).map(|(&id, &n)| key(n, id)).collect();
        let mut removed = 0;
        while let Some((1.., reversed)) = order.pop_last() {
            let worst = reversed.reverse_bits();
            self.world.remove(worst);
            removed += 1;
            for other in others.remove(&worst).unwrap_or_default() {
                let Some(n) = count.get_mut(&other).filter(|_| others.contains_key(&other)) else { continue };
                if order.remove(&key(*n, other)) {
                    order.insert(key(*n - 1, other));
                }
                *n -= 1;
            }
        }
        removed
    }
}
