//! The bodies of one attempt at a layout, of which single ones go.
//!
//! A body that leaves its place, tips or moves need not cost the layout: it goes, with all that rests on it.

use crate::Library;
use crate::arrange::Start;
use crate::draw::Drawn;
use crate::settle::Rejection;
use cairn_engine::world::{BodyId, ContactPair, Insertion, PairSide, World};
use cairn_geometry::contact::REAL_CONTACT;
use std::collections::{BTreeMap, BTreeSet};

/// At most this share of the bodies that began may be taken away or leave.
const MOST_AWAY: f64 = 0.5;
/// One body rests on another if their contact's normal has a larger share of the vertical than this.
const CARRIES: f64 = 0.05;

/// The bodies of an attempt.
pub struct Pile<'a> {
    pub library: &'a Library,
    pub drawn: &'a Drawn,
    pub world: World,
    /// Where each body began. Shape `[body of the world]`.
    pub starts: Vec<Start>,
    /// Bodies that are gone because of a fault, by reason.
    pub away: BTreeMap<Rejection, u32>,
}

impl Pile<'_> {
    pub fn new<'a>(library: &'a Library, drawn: &'a Drawn, starts: &[Start]) -> Pile<'a> {
        let world = library.places[drawn.place].world.clone();
        let mut pile = Pile { library, drawn, world, starts: Vec::new(), away: BTreeMap::new() };
        pile.add(starts);
        pile
    }

    /// Puts bodies into the world.
    pub fn add(&mut self, starts: &[Start]) {
        for start in starts {
            let prop = &self.library.scene().props[start.prop];
            let body = Insertion {
                prop: start.prop,
                scale: start.scale,
                pose: self.world.units.pose_to_engine(&start.pose),
                friction: prop.friction,
                restitution: prop.restitution,
            };
            // A shape that the engine refuses is refused with the catalogue.
            if self.world.insert(&self.library.shapes[start.prop], &body).is_ok() {
                self.starts.push(*start);
            }
        }
    }

    /// A body as it lies now.
    pub fn start_now(&self, id: BodyId) -> Start {
        Start { pose: self.world.units.pose_to_si(&self.world.pose(id)), ..self.starts[id] }
    }

    /// Whether fewer bodies are there than the catalogue asks for.
    pub fn lacks(&self) -> bool {
        self.count() < self.drawn.range[0]
    }

    /// Takes bodies that have left the place out of the world.
    pub fn forget_left(&mut self) -> Result<(), Rejection> {
        let surfaces = &self.library.places[self.drawn.place].surfaces;
        let lowest = self.world.units.height_to_engine(surfaces.lowest);
        let has_left = |id: &BodyId| self.world.pose(*id).translation.y < lowest;
        let left: Vec<BodyId> = self.world.present().filter(has_left).collect();
        for &id in &left {
            self.world.remove(id);
            *self.away.entry(Rejection::NotContained).or_default() += 1;
        }
        if left.is_empty() { Ok(()) } else { self.check(Rejection::NotContained) }
    }

    /// Takes bodies away, and all that rests on them; returns whether they touched any that stays.
    pub fn take_away(&mut self, faults: &[(BodyId, Rejection)]) -> Result<bool, Rejection> {
        let Some(&(_, last)) = faults.last() else { return Ok(false) };
        let pairs = self.world.contact_pairs(REAL_CONTACT);
        let mut gone: BTreeMap<BodyId, Rejection> = BTreeMap::new();
        let mut open: Vec<(BodyId, Rejection)> = faults.iter().rev().copied().collect();
        while let Some((id, why)) = open.pop() {
            if gone.contains_key(&id) {
                continue;
            }
            gone.insert(id, why);
            open.extend(resting_on(id, &pairs).map(|other| (other, why)));
        }
        let touched = self.remove(&gone.keys().copied().collect(), &pairs);
        for &why in gone.values() {
            *self.away.entry(why).or_default() += 1;
        }
        self.check(last)?;
        Ok(touched)
    }

    /// Takes bodies away until as many are left, the last drawn first: those that touch no other body and, unless
    /// `only_lone`, those that carry none. Returns whether they touched any that stays.
    pub fn take_spare(&mut self, left: usize, only_lone: bool) -> bool {
        let mut more = self.count().saturating_sub(left);
        if more == 0 {
            return false;
        }
        let pairs = self.world.contact_pairs(REAL_CONTACT);
        let touches = |id: BodyId| pairs.iter().any(|pair| others(pair, id).is_some());
        let is_target = |id: BodyId| Some(self.starts[id].drawn) == self.drawn.target;
        let ids: Vec<BodyId> = self.world.present().filter(|&id| !is_target(id)).collect();
        let lone = ids.iter().rev().copied().filter(|&id| !touches(id));
        let mut spare: BTreeSet<BodyId> = lone.take(more).collect();
        more -= spare.len();
        if !only_lone {
            let carries = |id: BodyId| resting_on(id, &pairs).next().is_some();
            spare.extend(ids.iter().rev().copied().filter(|&id| touches(id) && !carries(id)).take(more));
        }
        self.remove(&spare, &pairs)
    }

    /// The body that is looked for, in the order of those that are there.
    pub fn target(&self) -> Option<usize> {
        let target = self.drawn.target?;
        self.world.present().position(|id| self.starts[id].drawn == target)
    }

    /// Bodies that are there.
    pub fn count(&self) -> usize {
        self.world.present().count()
    }

    /// Whether fewer bodies rest on `a` than on `b`, or as many and `a` was drawn later.
    pub fn carries_less(&self, a: BodyId, b: BodyId, pairs: &[ContactPair]) -> bool {
        let carried = |id: BodyId| resting_on(id, pairs).count();
        let is_target = |id: BodyId| Some(self.starts[id].drawn) == self.drawn.target;
        (is_target(a), carried(a), self.starts[b].drawn) < (is_target(b), carried(b), self.starts[a].drawn)
    }

    fn remove(&mut self, gone: &BTreeSet<BodyId>, pairs: &[ContactPair]) -> bool {
        let is_between = |pair: &ContactPair| match pair.b {
            PairSide::Body(b) => gone.contains(&pair.a) != gone.contains(&b),
            _ => false,
        };
        gone.iter().for_each(|&id| self.world.remove(id));
        pairs.iter().any(is_between)
    }

    /// Whether not too many have gone, and the target is there.
    fn check(&self, why: Rejection) -> Result<(), Rejection> {
        let away: u32 = self.away.values().sum();
        let is_enough = f64::from(away) <= MOST_AWAY * self.starts.len() as f64;
        if is_enough && self.drawn.target.is_some() == self.target().is_some() { Ok(()) } else { Err(why) }
    }
}

/// The other body of a contact of a body.
fn others(pair: &ContactPair, id: BodyId) -> Option<BodyId> {
    match pair.b {
        PairSide::Body(b) if pair.a == id => Some(b),
        PairSide::Body(b) if b == id => Some(pair.a),
        _ => None,
    }
}

/// Bodies that a body carries a part of.
pub fn resting_on(id: BodyId, pairs: &[ContactPair]) -> impl Iterator<Item = BodyId> + '_ {
    pairs.iter().filter_map(move |pair| {
        let other = others(pair, id)?;
        // The normals are into `a`.
        let sign = if pair.a == id { -1.0 } else { 1.0 };
        pair.points.iter().any(|point| sign * point.normal.y > CARRIES).then_some(other)
    })
}

/// All bodies that rest on a body, directly or through others; not itself.
pub fn all_resting_on(id: BodyId, pairs: &[ContactPair]) -> BTreeSet<BodyId> {
    let mut found = BTreeSet::new();
    let mut open = vec![id];
    while let Some(next) = open.pop() {
        open.extend(resting_on(next, pairs).filter(|&other| other != id && found.insert(other)));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrange;
    use crate::draw::{draw, draw_more, numbers};
    use crate::example::library;
    use cairn_engine::shape::corners;
    use cairn_geometry::mesh::bounds;
    use cairn_geometry::pose::Pose;
    use glam::{DQuat, DVec3};

    /// Three bricks on each other, number 0 at the bottom, and eight that touch nothing.
    fn pile<'a>(library: &'a Library, drawn: &'a Drawn) -> Pile<'a> {
        let (low, high) = bounds(corners(&library.shapes[0], 1.0, &Pose::IDENTITY));
        let size = high - low;
        let start = |drawn: usize, at: DVec3| {
            let pose = Pose { translation: at * size * 1.0001, rotation: DQuat::IDENTITY };
            Start { drawn, prop: 0, scale: 1.0, pose }
        };
        let stack = (0..3).map(|k| start(k, DVec3::new(0.0, 2.0 + k as f64, 0.0)));
        let aside = (3..11).map(|k| start(k, DVec3::new(0.0, 3.0 * k as f64, 0.0)));
        let mut pile = Pile::new(library, drawn, &stack.chain(aside).collect::<Vec<_>>());
        pile.world.zero_step();
        pile
    }

    #[test]
    fn what_rests_on_a_body_goes_with_it() {
        let library = library("");
        let drawn = Drawn { range: [2, 20], ..draw(&library, 0, &mut numbers(1, 0, 0)) };
        let mut whole = pile(&library, &drawn);
        let pairs = whole.world.contact_pairs(REAL_CONTACT);
        assert_eq!(all_resting_on(0, &pairs), BTreeSet::from([1, 2]));
        assert_eq!(all_resting_on(2, &pairs), BTreeSet::new());
        assert_eq!(whole.take_away(&[(0, Rejection::Tips)]), Ok(false), "all that it touched is gone");
        assert_eq!((whole.count(), &whole.away), (8, &BTreeMap::from([(Rejection::Tips, 3)])));
        let mut top = pile(&library, &drawn);
        assert_eq!(top.take_away(&[(2, Rejection::Drift)]), Ok(true), "one that it lay on is there");
        assert_eq!((top.count(), top.away[&Rejection::Drift]), (10, 1));
        assert_eq!(top.take_away(&[(3, Rejection::Drift), (4, Rejection::Drift)]), Ok(false));
        assert_eq!(top.take_away(&[(5, Rejection::Tips), (6, Rejection::Tips)]), Ok(false));
        assert_eq!(top.take_away(&[(7, Rejection::Tips)]), Err(Rejection::Tips), "too many");
    }

    /// What takes the place of others begins beside or above those that are there.
    #[test]
    fn more_bodies_find_room_among_others() {
        let library = library("");
        let mut rng = numbers(1, 0, 0);
        let drawn = Drawn { range: [2, 20], ..draw(&library, 0, &mut rng) };
        let mut pile = Pile::new(&library, &drawn, &arrange::arrange(&library, &drawn, &mut rng));
        let before = pile.count();
        let more = arrange::add(&pile, &draw_more(&library, 8, &mut rng), &mut rng);
        assert_eq!(more.iter().map(|start| start.drawn).collect::<Vec<_>>(), (before..before + 8).collect::<Vec<_>>());
        pile.add(&more);
        pile.world.zero_step();
        assert_eq!((pile.count(), pile.starts.len()), (before + 8, before + 8));
        assert_eq!(crate::proof::overlap(&pile.world), 0.0);
    }

    #[test]
    fn too_few_bodies_and_a_lost_target_are_no_layout() {
        let library = library("target = { label = \"brick\" }");
        let drawn = Drawn { range: [11, 20], target: Some(4), ..draw(&library, 0, &mut numbers(1, 0, 0)) };
        let mut few = pile(&library, &drawn);
        assert!(!few.lacks());
        assert_eq!(few.take_away(&[(3, Rejection::Tips)]), Ok(false));
        assert!(few.lacks(), "others may take its place");
        assert_eq!(pile(&library, &drawn).take_away(&[(4, Rejection::Tips)]), Err(Rejection::Tips));
    }

    #[test]
    fn those_that_touch_no_other_are_spared_last_and_go_first() {
        let library = library("");
        let drawn = Drawn { range: [2, 20], target: Some(10), ..draw(&library, 0, &mut numbers(1, 0, 0)) };
        let mut pile = pile(&library, &drawn);
        assert!(!pile.take_spare(6, true));
        let left: Vec<BodyId> = pile.world.present().collect();
        assert_eq!(left, [0, 1, 2, 3, 4, 10], "the last drawn, but not the target");
        assert!(!pile.take_spare(3, true));
        assert_eq!(pile.count(), 4, "the stack stays, and the target");
        assert!(pile.take_spare(3, false), "the top of the stack goes");
        assert!(!pile.world.is_present(2) && pile.away.is_empty());
    }
}
