//! The sites of a pile that could be glued: its contact pairs, pegs and bridges as the sites of
//! [`cairn_statics::glue`].

use super::Joint;
use crate::control;
use cairn_analysis::assembly::{self, Assembly};
use cairn_engine::world::{BodyId, ContactPair, PairSide, Role, SOLVED, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::interior::DistanceGrid;
use cairn_statics::global::GlobalContact;
use cairn_statics::glue::{GlueJoint, GluePlacement, GlueProblem, GlueSite};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// A joint carries moments as if by forces this far apart, as a share of the smaller body's radius. The value of the
/// first study of glue, kept by all later ones. Guards against moments that cost nothing.
const ARM: f64 = 0.25;
/// Bodies this near to the ground, in their thickness, may be glued to it without touching it: a peg. So may bodies
/// that touch nothing else be to bodies near them. Balls, tori and knots touch the ground nowhere: without pegs the
/// problem is empty.
const PEG: f64 = 0.5;
/// Bodies that even a peg does not join to the ground may be glued across gaps of this many thicknesses, the narrowest
/// first; but not across gaps wider than [`WIDEST`]. Guards against narrow places that the fill left empty, such as the
/// top of a leg.
const BRIDGES: [f64; 3] = [1.0, 2.0, 4.0];
/// Widest gap of a bridge, d, however thick the bodies are.
const WIDEST: f64 = 0.75;

/// A joint that an earlier pile had between two bodies, or, with `None`, between one and the fixed surroundings. Engine
/// units.
#[derive(Clone, Copy, Debug)]
pub struct KnownJoint {
    pub bodies: (BodyId, Option<BodyId>),
    /// On the first one.
    pub force: DVec3,
    pub moment: DVec3,
}

/// The glue of an earlier pile, as far as its bodies are there again.
#[derive(Clone, Debug, Default)]
pub struct KnownGlue {
    pub joints: Vec<KnownJoint>,
    /// Bodies that have only bodies of the earlier pile near them: the glue among them stays.
    pub still: BTreeSet<BodyId>,
    /// The bodies are nearly all that there are: the search starts from the joints.
    pub is_start: bool,
}

/// The bodies of a pile and the sites between them. Engine units.
#[derive(Clone)]
pub struct Sites {
    /// The bodies that can be held, and their contacts in the order of the sites.
    pub assembly: Assembly,
    /// Bodies that no chain of sites joins to the ground, ascending: no glue holds them.
    pub unreachable: Vec<BodyId>,
    /// The two sides of each site: a body, and another body or the fixed surroundings. Shape `[site]`.
    pub between: Vec<(BodyId, PairSide)>,
    /// Normal of each site, into its body. Shape `[site]`.
    pub normals: Vec<DVec3>,
    /// Friction of each contact pair, and the mean distance of its points from their middle; `None`: a peg. Shape
    /// `[site]`.
    pub patches: Vec<Option<(f64, f64)>>,
    /// Gap of each bridge; 0 of all other sites. Shape `[site]`.
    pub gaps: Vec<f64>,
    /// Overlap of the two bodies, in the thickness of the thinner one's material. Shape `[site]`.
    pub depths: Vec<f64>,
    /// Number of trials in which each body moved, 2 at most. Shape `[body]`.
    discounts: Vec<u8>,
    /// Index of the price of each body's normal forces. Shape `[body]`.
    levels: Vec<usize>,
    sites: Vec<GlueSite>,
}

impl Sites {
    /// `region`: the glue acts inside it; `None`: everywhere. `anchors`: bodies may be glued to the fixed surroundings.
    /// `standing`: bodies that need no glue, and that touch none that does.
    pub fn new(world: &World, region: Option<&DistanceGrid>, anchors: bool, standing: &BTreeSet<BodyId>) -> Sites {
        Sites::with_known(world, region, anchors, standing, &[])
    }

    /// The same, and sites for joints that an earlier pile had: as that settled, bodies that are glued may have parted
    /// a little.
    pub fn with_known(
        world: &World,
        region: Option<&DistanceGrid>,
        anchors: bool,
        standing: &BTreeSet<BodyId>,
        known: &[KnownJoint],
    ) -> Sites {
        let is_inside = |id: BodyId| region.is_none_or(|region| control::is_inside(region, world, id));
        let is_held = |id: BodyId| world.bodies()[id].role != Role::Pinned && !standing.contains(&id) && is_inside(id);
        let inside: Vec<bool> = (0..world.bodies().len()).map(|id| world.is_present(id) && is_held(id)).collect();
        let mut pairs = world.contact_pairs(REAL_CONTACT);
        pairs.retain(|pair| pair.b != PairSide::Moving);
        let carrying = pairs.len();
        if anchors {
            add_new(&mut pairs, world.static_contact_pairs(PEG));
        }
        let mut joined = joined_by(world, &inside, &pairs);
        let is_apart = |joined: &[bool], id: BodyId| inside[id] && !joined[id];
        if anchors && (0..inside.len()).any(|id| is_apart(&joined, id)) {
            let bridges = |pair: &ContactPair| match pair.b {
                PairSide::Body(b) => is_apart(&joined, pair.a) || is_apart(&joined, b),
                _ => false,
            };
            let mut near = world.contact_pairs(PEG);
            near.retain(bridges);
            add_new(&mut pairs, near);
            joined = joined_by(world, &inside, &pairs);
        }
        if !known.is_empty() {
            let between = known.iter().filter_map(|joint| Some((joint.bodies.0, joint.bodies.1?)));
            let between: BTreeSet<(BodyId, BodyId)> = between.flat_map(|(a, b)| [(a, b), (b, a)]).collect();
            let mut near = world.contact_pairs(PEG);
            near.retain(|pair| matches!(pair.b, PairSide::Body(b) if between.contains(&(pair.a, b))));
            add_new(&mut pairs, near);
        }
        let pegs = pairs.len();
        if anchors {
            bridge(world, &inside, &mut pairs, &mut joined);
        }
        let assembly = Assembly::new(world, |id| joined[id]);
        let mut sites = Sites {
            unreachable: (0..inside.len()).filter(|&id| inside[id] && !joined[id]).collect(),
            discounts: vec![0; assembly.ids.len()],
            levels: vec![0; assembly.ids.len()],
            between: Vec::new(),
            normals: Vec::new(),
            patches: Vec::new(),
            gaps: Vec::new(),
            depths: Vec::new(),
            sites: Vec::new(),
            assembly,
        };
        let pinned = |id: BodyId| world.is_present(id) && world.bodies()[id].role == Role::Pinned;
        for (k, pair) in pairs.iter().enumerate() {
            // Bodies that are neither in the pile nor fixed carry nothing here.
            let stands = |id: BodyId| joined[id] || pinned(id);
            if stands(pair.a) && !matches!(pair.b, PairSide::Body(b) if !stands(b)) {
                sites.add(pair, pair.depth() / world.pair_wall(pair), k < carrying, k >= pegs, anchors);
            }
        }
        sites
    }

    /// Joints at these sites, as far as there are such: the two bodies of each, `None` for the fixed surroundings, and
    /// force and moment on the first.
    pub fn known(&self, joints: &[KnownJoint]) -> Vec<GlueJoint> {
        let between = self.between.iter().enumerate().map(|(site, &(a, b))| {
            let b = if let PairSide::Body(b) = b { Some(b) } else { None };
            ((a, b), site)
        });
        let sites: BTreeMap<(BodyId, Option<BodyId>), usize> = between.collect();
        let found = joints.iter().filter_map(|&KnownJoint { bodies: (a, b), force, moment }| {
            let own = sites.get(&(a, b)).map(|&site| GlueJoint { site, force, moment });
            let other = || b.and_then(|b| sites.get(&(b, Some(a))));
            let other = || other().map(|&site| GlueJoint { site, force: -force, moment: -moment });
            own.or_else(other).filter(|joint| self.sites[joint.site].may_glue)
        });
        let found: BTreeMap<usize, GlueJoint> = found.map(|joint| (joint.site, joint)).collect();
        found.into_values().collect()
    }

    /// Those of these joints' sites that are between these bodies, or between one of them and the fixed surroundings.
    pub fn among(&self, bodies: &BTreeSet<BodyId>, joints: &[GlueJoint]) -> BTreeSet<usize> {
        let is_among = |site: &usize| {
            let (a, b) = self.between[*site];
            bodies.contains(&a) && !matches!(b, PairSide::Body(b) if !bodies.contains(&b))
        };
        joints.iter().map(|joint| joint.site).filter(is_among).collect()
    }

    /// These bodies moved although friction should have held them: their friction no longer counts. Bodies that moved
    /// even so are held by glue alone: their contacts no longer count. Returns whether that changes anything.
    pub fn discount_friction(&mut self, moved: &BTreeSet<BodyId>) -> bool {
        let before = self.discounts.clone();
        for body in moved.iter().filter_map(|&id| self.assembly.index(id)) {
            self.discounts[body] = (self.discounts[body] + 1).min(2);
        }
        let discounts = &self.discounts;
        let of = |c: &GlobalContact| discounts[c.body].max(c.other.map_or(0, |other| discounts[other]));
        let mut kept = Vec::with_capacity(self.assembly.contacts.len());
        for site in &mut self.sites {
            let own = &self.assembly.contacts[site.contacts.clone()];
            let begin = kept.len();
            kept.extend(
                own.iter()
                    .filter(|c| of(c) < 2)
                    .map(|c| GlobalContact { friction: if of(c) > 0 { 0.0 } else { c.friction }, ..*c }),
            );
            site.contacts = begin..kept.len();
        }
        self.assembly.contacts = kept;
        self.discounts != before
    }

    /// Normal forces of these bodies, or of all, get the next of these prices. Returns whether that changes anything.
    pub fn raise_normal_price(&mut self, which: Option<&BTreeSet<BodyId>>, prices: &[f64]) -> bool {
        let before = self.levels.clone();
        for (body, level) in self.levels.iter_mut().enumerate() {
            if which.is_none_or(|which| which.contains(&self.assembly.ids[body])) {
                *level = (*level + 1).min(prices.len() - 1);
            }
        }
        let level = |body: usize| self.levels[body];
        for site in &mut self.sites {
            site.normal_price = prices[level(site.body).max(site.other.map_or(0, level))];
        }
        self.levels != before
    }

    /// The highest price of a normal force.
    pub fn highest_price(&self) -> f64 {
        self.sites.iter().map(|site| site.normal_price).fold(0.0, f64::max)
    }

    pub fn is_highest_price(&self, prices: &[f64]) -> bool {
        self.levels.iter().all(|level| level + 1 == prices.len())
    }

    pub fn problem(&self, gravity: DVec3) -> GlueProblem<'_> {
        let Assembly { bodies, contacts, .. } = &self.assembly;
        GlueProblem { bodies, contacts, sites: &self.sites, gravity }
    }

    /// The number of contact pairs, and of the placement's pegs and bridges.
    pub fn real_with(&self, placement: &GluePlacement) -> usize {
        let made = placement.joints.iter().filter(|joint| !self.is_real(joint.site)).count();
        (0..self.sites.len()).filter(|&site| self.is_real(site)).count() + made
    }

    /// The site is a contact pair, not a peg or a bridge.
    pub fn is_real(&self, site: usize) -> bool {
        self.patches[site].is_some()
    }

    /// A joint at this site that carries a force and a moment, engine units. It breaks beyond `breaking` times that,
    /// and at `least_limit` at least.
    pub fn joint(&self, index: usize, force: DVec3, moment: DVec3, least_limit: f64, breaking: f64) -> Joint {
        let site = &self.sites[index];
        let mut joint = Joint {
            a: self.assembly.ids[site.body],
            b: site.other.map(|other| self.assembly.ids[other]),
            point: site.center,
            normal: self.normals[index],
            arm: site.arm,
            contact: self.patches[index],
            force,
            moment,
            limit: 0.0,
            is_broken: false,
        };
        joint.limit = least_limit.max(breaking * joint.load());
        joint
    }

    fn add(&mut self, pair: &ContactPair, depth: f64, carries: bool, bridges: bool, anchors: bool) {
        let contacts = self.assembly.contacts_of(pair);
        let Some(first) = contacts.first().copied() else { return };
        let GlobalContact { body, other, .. } = first;
        let count = contacts.len() as f64;
        let center = contacts.iter().map(|c| c.point).sum::<DVec3>() / count;
        let normal = contacts.iter().map(|c| c.normal).sum::<DVec3>().normalize_or(DVec3::Y);
        let id = self.assembly.ids[body];
        let ends = if id == pair.a { (id, pair.b) } else { (id, PairSide::Body(pair.a)) };
        let far = contacts.iter().map(|c| c.point.distance(center)).sum::<f64>() / count;
        self.patches.push(carries.then_some((pair.friction, far)));
        self.gaps.push(if bridges { narrowest(pair) } else { 0.0 });
        self.depths.push(depth);
        let contacts = self.assembly.add(if carries { few(contacts) } else { Vec::new() });
        let radius = |body: usize| self.assembly.bodies[body].radius;
        self.sites.push(GlueSite {
            center,
            arm: ARM * other.map_or(f64::INFINITY, radius).min(radius(body)),
            may_glue: other.is_some() || anchors,
            ..assembly::site(&first, contacts)
        });
        self.between.push(ends);
        self.normals.push(normal);
    }
}

/// Adds bridges from joined bodies to those that are not, and marks the bodies that they join.
fn bridge(world: &World, inside: &[bool], pairs: &mut Vec<ContactPair>, joined: &mut Vec<bool>) {
    let is_apart = |joined: &[bool], id: BodyId| inside[id] && !joined[id];
    for reach in BRIDGES {
        if !(0..inside.len()).any(|id| is_apart(joined, id)) {
            return;
        }
        let mut near = world.contact_pairs(reach);
        near.retain(|pair| narrowest(pair) <= WIDEST);
        // A body joined by one bridge may carry the next.
        loop {
            let joins = |pair: &&ContactPair| match pair.b {
                PairSide::Body(b) => is_apart(joined, pair.a) && joined[b] || is_apart(joined, b) && joined[pair.a],
                PairSide::Ground | PairSide::Scenery => is_apart(joined, pair.a),
                PairSide::Moving => false,
            };
            let bridges: Vec<ContactPair> = near.iter().filter(joins).cloned().collect();
            if bridges.is_empty() {
                break;
            }
            add_new(pairs, bridges);
            *joined = joined_by(world, inside, pairs);
        }
    }
}

fn narrowest(pair: &ContactPair) -> f64 {
    pair.points.iter().map(|p| p.gap).fold(f64::INFINITY, f64::min)
}

/// Adds the pairs of `near` that are not in `pairs` yet.
fn add_new(pairs: &mut Vec<ContactPair>, near: Vec<ContactPair>) {
    let known: BTreeSet<(BodyId, PairSide)> = pairs.iter().map(|pair| (pair.a, pair.b)).collect();
    pairs.extend(near.into_iter().filter(|pair| !known.contains(&(pair.a, pair.b))));
}

/// Contacts whose normals differ by less than this are one patch, 1 - cosine.
const ONE_PATCH: f64 = 1e-3;

/// The outermost points of each patch, as many as the engine solves: the points between them would carry nothing that
/// these do not.
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
        if patch.len() <= SOLVED {
            return patch;
        }
        let middle = patch.iter().map(|c| c.point).sum::<DVec3>() / patch.len() as f64;
        let farthest = |from: &[DVec3]| {
            let far =
                |c: &GlobalContact| from.iter().map(|p| p.distance_squared(c.point)).fold(f64::INFINITY, f64::min);
            patch.iter().copied().reduce(|a, b| if far(&b) > far(&a) { b } else { a })
        };
        let mut kept: Vec<GlobalContact> = farthest(&[middle]).into_iter().collect();
        while kept.len() < SOLVED {
            let points: Vec<DVec3> = kept.iter().map(|c| c.point).collect();
            kept.extend(farthest(&points));
        }
        kept
    };
    patches.into_iter().flat_map(spread).collect()
}

/// Bodies that chains of sites join to the fixed surroundings. Shape `[body]`.
fn joined_by(world: &World, inside: &[bool], pairs: &[ContactPair]) -> Vec<bool> {
    let mut beside = vec![Vec::new(); inside.len()];
    let mut front = Vec::new();
    let is_pinned = |id: BodyId| world.is_present(id) && world.bodies()[id].role == Role::Pinned;
    for pair in pairs {
        match pair.b {
            PairSide::Body(b) if is_pinned(b) => front.push(pair.a),
            PairSide::Body(b) if is_pinned(pair.a) => front.push(b),
            PairSide::Body(b) => {
                beside[pair.a].push(b);
                beside[b].push(pair.a);
            }
            PairSide::Ground | PairSide::Scenery => front.push(pair.a),
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
