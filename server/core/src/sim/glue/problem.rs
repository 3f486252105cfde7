//! Where a pile could be glued: the problem of [`cairn_statics::glue`], from what its bodies touch.

use super::Dot;
use crate::geometry::region::DistanceGrid;
use crate::sim::control;
use crate::sim::whole::{self, REAL_CONTACT};
use crate::world::{BodyId, ContactPair, PairSide, Role, World};
use cairn_statics::global::{GlobalBody, GlobalContact};
use cairn_statics::glue::{GluePlacement, GlueProblem, GlueSite};
use glam::DVec3;
use std::collections::BTreeSet;

/// A dot carries moments as if by forces this far apart, as a share of the smaller body's radius.
const ARM: f64 = 0.25;
/// What is this near to the ground, in its thickness, may be glued to it without touching it: a peg. So may what touches nothing else be
/// to what is near it.
const PEG: f64 = 0.5;
/// What even that does not join to the ground may be glued to what is joined across gaps of this many thicknesses, the narrowest first;
/// but not across gaps wider than this, d.
const BRIDGES: [f64; 3] = [1.0, 2.0, 4.0];
const WIDEST: f64 = 0.75;

/// The bodies of a pile and their touches. Engine units.
pub struct Sites {
    /// The bodies that can be held at all, rising.
    pub ids: Vec<BodyId>,
    /// Bodies that no chain of touches joins to the ground, rising: no glue holds them.
    pub apart: Vec<BodyId>,
    /// What each touch is between: a body, and another or what stands still. Shape `[touch]`.
    pub between: Vec<(BodyId, PairSide)>,
    /// Normal of each touch, into its body. Shape `[touch]`.
    pub normals: Vec<DVec3>,
    /// Friction of each touch, and how far its contact points are from their middle; `None`: a peg. Shape `[touch]`.
    pub patches: Vec<Option<(f64, f64)>>,
    /// Gap of each touch that is a bridge; 0 of all others. Shape `[touch]`.
    pub gaps: Vec<f64>,
    /// How far the two are pressed into each other, in the thinner one's thickness. Shape `[touch]`.
    pub depths: Vec<f64>,
    /// By body, how often it moved though it should not have: once, twice or more.
    distrust: Vec<u8>,
    /// By body, which price its normal forces have.
    levels: Vec<usize>,
    bodies: Vec<GlobalBody>,
    contacts: Vec<GlobalContact>,
    touches: Vec<GlueSite>,
}

impl Sites {
    /// `region`: where the glue acts; `None`: everywhere. `anchors`: bodies may be glued to what stands still.
    pub fn new(world: &World, region: Option<&DistanceGrid>, anchors: bool) -> Sites {
        let is_inside = |id: BodyId| region.is_none_or(|region| control::is_inside(region, world, id));
        let is_held = |id: BodyId| world.bodies()[id].role != Role::Pinned && is_inside(id);
        let inside: Vec<bool> = (0..world.bodies().len()).map(|id| world.is_present(id) && is_held(id)).collect();
        let mut touches = world.contact_pairs(REAL_CONTACT);
        touches.retain(|touch| touch.b != PairSide::Moving);
        let carrying = touches.len();
        if anchors {
            add_new(&mut touches, world.static_contact_pairs(PEG));
        }
        let mut joined = joined_by(world, &inside, &touches);
        let is_apart = |joined: &[bool], id: BodyId| inside[id] && !joined[id];
        if anchors && (0..inside.len()).any(|id| is_apart(&joined, id)) {
            let bridges = |touch: &ContactPair| match touch.b {
                PairSide::Body(b) => is_apart(&joined, touch.a) || is_apart(&joined, b),
                _ => false,
            };
            let mut near = world.contact_pairs(PEG);
            near.retain(bridges);
            add_new(&mut touches, near);
            joined = joined_by(world, &inside, &touches);
        }
        let pegs = touches.len();
        if anchors {
            bridge(world, &inside, &mut touches, &mut joined);
        }
        let ids: Vec<BodyId> = (0..inside.len()).filter(|&id| joined[id]).collect();
        let body = |&id: &BodyId| {
            let b = &world.bodies()[id];
            GlobalBody { mass: b.mass, center_of_mass: world.pose(id).translation, radius: b.radius }
        };
        let mut sites = Sites {
            apart: (0..inside.len()).filter(|&id| inside[id] && !joined[id]).collect(),
            bodies: ids.iter().map(body).collect(),
            distrust: vec![0; ids.len()],
            levels: vec![0; ids.len()],
            between: Vec::new(),
            normals: Vec::new(),
            patches: Vec::new(),
            gaps: Vec::new(),
            depths: Vec::new(),
            contacts: Vec::new(),
            touches: Vec::new(),
            ids,
        };
        let pinned = |id: BodyId| world.is_present(id) && world.bodies()[id].role == Role::Pinned;
        for (k, touch) in touches.iter().enumerate() {
            // What is neither in the pile nor stands still carries nothing here.
            let stands = |id: BodyId| joined[id] || pinned(id);
            if stands(touch.a) && !matches!(touch.b, PairSide::Body(b) if !stands(b)) {
                sites.add(touch, touch.depth() / world.pair_thickness(touch), k < carrying, k >= pegs, anchors);
            }
        }
        sites
    }

    /// These bodies moved though friction should have held them: theirs counts no more. What moved even so is held by glue alone: what
    /// it touches carries it no more. Returns whether that changes anything.
    pub fn distrust(&mut self, moved: &BTreeSet<BodyId>) -> bool {
        let index = |id: &BodyId| self.ids.binary_search(id).ok();
        let before = self.distrust.clone();
        for body in moved.iter().filter_map(index) {
            self.distrust[body] = (self.distrust[body] + 1).min(2);
        }
        let distrust = &self.distrust;
        let of = |c: &GlobalContact| distrust[c.body].max(c.other.map_or(0, |other| distrust[other]));
        let mut kept = Vec::with_capacity(self.contacts.len());
        for touch in &mut self.touches {
            let own = &self.contacts[touch.contacts.clone()];
            let begin = kept.len();
            kept.extend(
                own.iter()
                    .filter(|c| of(c) < 2)
                    .map(|c| GlobalContact { friction: if of(c) > 0 { 0.0 } else { c.friction }, ..*c }),
            );
            touch.contacts = begin..kept.len();
        }
        self.contacts = kept;
        self.distrust != before
    }

    /// Normal forces of these bodies, or of all, take the next of these prices. Returns whether that changes anything.
    pub fn make_dearer(&mut self, which: Option<&BTreeSet<BodyId>>, prices: &[f64]) -> bool {
        let before = self.levels.clone();
        for (body, level) in self.levels.iter_mut().enumerate() {
            if which.is_none_or(|which| which.contains(&self.ids[body])) {
                *level = (*level + 1).min(prices.len() - 1);
            }
        }
        let level = |body: usize| self.levels[body];
        for touch in &mut self.touches {
            touch.normal_price = prices[level(touch.body).max(touch.other.map_or(0, level))];
        }
        self.levels != before
    }

    /// The highest of its normal prices.
    pub fn dearest(&self) -> f64 {
        self.touches.iter().map(|touch| touch.normal_price).fold(0.0, f64::max)
    }

    pub fn is_dearest(&self, prices: &[f64]) -> bool {
        self.levels.iter().all(|level| level + 1 == prices.len())
    }

    pub fn problem(&self, gravity: DVec3) -> GlueProblem<'_> {
        GlueProblem { bodies: &self.bodies, contacts: &self.contacts, sites: &self.touches, gravity }
    }

    /// Touches, and those that glue makes where there are none: pegs and bridges.
    pub fn real_with(&self, placement: &GluePlacement) -> usize {
        let made = placement.joints.iter().filter(|dot| !self.is_real(dot.site)).count();
        (0..self.touches.len()).filter(|&touch| self.is_real(touch)).count() + made
    }

    /// Whether the two touch; no peg and no bridge.
    pub fn is_real(&self, touch: usize) -> bool {
        self.patches[touch].is_some()
    }

    /// A dot at this touch that carries a force and a moment, engine units. It breaks beyond `breaking` times that, and at `least_limit`
    /// at least.
    pub fn dot(&self, touch: usize, force: DVec3, moment: DVec3, least_limit: f64, breaking: f64) -> Dot {
        let site = &self.touches[touch];
        let mut dot = Dot {
            a: self.ids[site.body],
            b: site.other.map(|other| self.ids[other]),
            point: site.center,
            normal: self.normals[touch],
            arm: site.arm,
            contact: self.patches[touch],
            force,
            moment,
            limit: 0.0,
            is_broken: false,
        };
        dot.limit = least_limit.max(breaking * dot.load());
        dot
    }

    fn add(&mut self, touch: &ContactPair, depth: f64, carries: bool, bridges: bool, anchors: bool) {
        let index = |id: BodyId| self.ids.binary_search(&id).ok();
        let Some(mut contacts) = whole::contacts(touch, &index).map(|all| all.collect::<Vec<_>>()) else { return };
        let Some(&GlobalContact { body, other, .. }) = contacts.first() else { return };
        let count = contacts.len() as f64;
        let center = contacts.iter().map(|c| c.point).sum::<DVec3>() / count;
        let normal = contacts.iter().map(|c| c.normal).sum::<DVec3>().normalize_or(DVec3::Y);
        let ends =
            if self.ids[body] == touch.a { (touch.a, touch.b) } else { (self.ids[body], PairSide::Body(touch.a)) };
        let far = contacts.iter().map(|c| c.point.distance(center)).sum::<f64>() / count;
        self.patches.push(carries.then_some((touch.friction, far)));
        self.gaps.push(if bridges { narrowest(touch) } else { 0.0 });
        self.depths.push(depth);
        contacts = few(contacts);
        if !carries {
            contacts.clear();
        }
        let radius = |body: usize| self.bodies[body].radius;
        let begin = self.contacts.len();
        self.contacts.append(&mut contacts);
        self.touches.push(GlueSite {
            body,
            other,
            contacts: begin..self.contacts.len(),
            center,
            arm: ARM * other.map_or(f64::INFINITY, radius).min(radius(body)),
            may_glue: other.is_some() || anchors,
            normal_price: 0.0,
        });
        self.between.push(ends);
        self.normals.push(normal);
    }
}

/// Adds bridges from what is joined to what is not, and marks what they join.
fn bridge(world: &World, inside: &[bool], touches: &mut Vec<ContactPair>, joined: &mut Vec<bool>) {
    let is_apart = |joined: &[bool], id: BodyId| inside[id] && !joined[id];
    for reach in BRIDGES {
        if !(0..inside.len()).any(|id| is_apart(joined, id)) {
            return;
        }
        let mut near = world.contact_pairs(reach);
        near.retain(|touch| narrowest(touch) <= WIDEST);
        // What is joined by one bridge may carry the next.
        loop {
            let joins = |touch: &&ContactPair| match touch.b {
                PairSide::Body(b) => is_apart(joined, touch.a) && joined[b] || is_apart(joined, b) && joined[touch.a],
                PairSide::Ground | PairSide::Scenery => is_apart(joined, touch.a),
                PairSide::Moving => false,
            };
            let bridges: Vec<ContactPair> = near.iter().filter(joins).cloned().collect();
            if bridges.is_empty() {
                break;
            }
            add_new(touches, bridges);
            *joined = joined_by(world, inside, touches);
        }
    }
}

fn narrowest(touch: &ContactPair) -> f64 {
    touch.points.iter().map(|p| p.gap).fold(f64::INFINITY, f64::min)
}

/// Adds those of pairs that are not among them yet.
fn add_new(touches: &mut Vec<ContactPair>, near: Vec<ContactPair>) {
    let known: BTreeSet<(BodyId, PairSide)> = touches.iter().map(|touch| (touch.a, touch.b)).collect();
    touches.extend(near.into_iter().filter(|touch| !known.contains(&(touch.a, touch.b))));
}

/// Points of a patch that are kept: those that reach farthest.
const KEPT: usize = 4;
/// Contacts whose normals differ by less than this are one patch, 1 - cosine.
const ONE_PATCH: f64 = 1e-3;

/// Of each patch, the points between which all the others are, or nearly: more of them bear nothing that those do not.
fn few(contacts: Vec<GlobalContact>) -> Vec<GlobalContact> {
    let mut patches: Vec<Vec<GlobalContact>> = Vec::new();
    for contact in contacts {
        let of_one = |patch: &&mut Vec<GlobalContact>| patch[0].normal.dot(contact.normal) > 1.0 - ONE_PATCH;
        match patches.iter_mut().find(of_one) {
            Some(patch) => patch.push(contact),
            None => patches.push(vec![contact]),
        }
    }
    let spread = |patch: Vec<GlobalContact>| {
        if patch.len() <= KEPT {
            return patch;
        }
        let middle = patch.iter().map(|c| c.point).sum::<DVec3>() / patch.len() as f64;
        let farthest = |from: &[DVec3]| {
            let far =
                |c: &GlobalContact| from.iter().map(|p| p.distance_squared(c.point)).fold(f64::INFINITY, f64::min);
            patch.iter().copied().reduce(|a, b| if far(&b) > far(&a) { b } else { a })
        };
        let mut kept: Vec<GlobalContact> = farthest(&[middle]).into_iter().collect();
        while kept.len() < KEPT {
            let points: Vec<DVec3> = kept.iter().map(|c| c.point).collect();
            kept.extend(farthest(&points));
        }
        kept
    };
    patches.into_iter().flat_map(spread).collect()
}

/// Bodies that chains of touches join to what stands still. Shape `[body]`.
fn joined_by(world: &World, inside: &[bool], touches: &[ContactPair]) -> Vec<bool> {
    let mut beside = vec![Vec::new(); inside.len()];
    let mut front = Vec::new();
    let is_pinned = |id: BodyId| world.is_present(id) && world.bodies()[id].role == Role::Pinned;
    for touch in touches {
        match touch.b {
            PairSide::Body(b) if is_pinned(b) => front.push(touch.a),
            PairSide::Body(b) if is_pinned(touch.a) => front.push(b),
            PairSide::Body(b) => {
                beside[touch.a].push(b);
                beside[b].push(touch.a);
            }
            PairSide::Ground | PairSide::Scenery => front.push(touch.a),
            PairSide::Moving => {}
        }
    }
    let mut joined = vec![false; inside.len()];
    while let Some(id) = front.pop() {
        if inside[id] && !std::mem::replace(&mut joined[id], true) {
            front.extend(&beside[id]);
        }
    }
    joined
}
