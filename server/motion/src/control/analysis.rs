//! Which bodies may be held: local equilibrium and candidate rules (paper, 3.1 to 3.3). Verdicts of the previous cycle
//! are kept where nothing has changed.

use super::counters::{BodyProblem, ControlCounters};
use super::eligibility::Eligibility;
use cairn_engine::world::{BodyId, ContactPair, PairSide, Role, World};
use cairn_geometry::contact;
use cairn_geometry::pose::Pose;
use cairn_input::params::{self, ContactSelection, Control as ControlParams, FrictionCone};
use cairn_statics::local::{
    Analyser, Candidacy, CandidateRules, FrictionLaw, LocalContact, LocalProblem, Options, ReserveRule, Solver,
    SpreadRule,
};
use glam::DVec3;
use rayon::prelude::*;

/// Bodies that one thread judges in one piece.
const SHARE: usize = 64;
/// A pair's contacts are taken from the previous cycle while no point of either body has moved by more than this share
/// of the gap across which they may touch.
const RECYCLED: f64 = 0.1;
/// Distinct contacts that a candidate needs (paper, 3.3).
const LEAST_CONTACTS: usize = 3;

/// The analysis, and its memory of the latest cycle.
pub struct Analysis<'a> {
    params: &'a ControlParams,
    options: Options,
    /// Verdicts that left the solver without a proof within its tolerances.
    undecided: u64,
    /// Verdicts are kept where nothing that they depend on has changed.
    keeps_verdicts: bool,
    /// Passed the latest analysis and candidate rules. Shape `[body]`.
    pub candidates: Vec<bool>,
    /// Contact pairs of the latest cycle.
    pub pairs: Vec<ContactPair>,
    /// Bodies that have not moved since. Shape `[body]`.
    unmoved: Vec<bool>,
    /// Pose of each body when its pairs were last computed. Shape `[body]`.
    seen: Vec<Pose>,
}

impl<'a> Analysis<'a> {
    pub fn new(params: &'a ControlParams, keeps_verdicts: bool) -> Analysis<'a> {
        let friction_law = match params.friction_cone {
            FrictionCone::Pyramid => FrictionLaw::PAPER,
            FrictionCone::Cone => FrictionLaw::Cone,
        };
        Analysis {
            params,
            options: Options { friction_law, solver: Solver::Fast, margin: false },
            undecided: 0,
            keeps_verdicts,
            candidates: Vec::new(),
            pairs: Vec::new(),
            unmoved: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// A body may move from now on: verdicts that depend on it are computed again.
    pub fn mark_moved(&mut self, id: BodyId) {
        if let Some(unmoved) = self.unmoved.get_mut(id) {
            *unmoved = false;
        }
    }

    /// The contact pairs now. Those of bodies that are, up to [`RECYCLED`], where they were are not computed again.
    pub fn contact_pairs(&mut self, world: &World) -> Vec<ContactPair> {
        let tolerance = self.params.contact_tolerance;
        let near = |(id, seen): (BodyId, &Pose)| {
            let body = &world.bodies()[id];
            world.is_present(id) && seen.moved(&world.pose(id), body.radius) <= RECYCLED * tolerance * body.thickness
        };
        let still: Vec<bool> = self.seen.iter().enumerate().map(near).collect();
        let pairs = carrying(world.contact_pairs_since(tolerance, &self.pairs, &still));
        self.seen.resize(world.bodies().len(), Pose::IDENTITY);
        for id in world.present().filter(|&id| !still.get(id).is_some_and(|&still| still)) {
            self.seen[id] = world.pose(id);
        }
        pairs
    }

    /// At the end of a cycle: remembers the state that the verdicts depend on.
    pub fn remember(&mut self, world: &World, pairs: Vec<ContactPair>) {
        self.pairs = pairs;
        if self.keeps_verdicts {
            let stands = |role: Role| matches!(role, Role::Frozen | Role::Waiting | Role::Pinned);
            self.unmoved = world.bodies().iter().map(|b| stands(b.role)).collect();
        }
    }

    /// Bodies that are frozen and touch nothing that moved, appeared or began to carry since their last verdict: it
    /// still holds. Shape `[body]`.
    fn unchanged(&self, world: &World, pairs: &[ContactPair]) -> Vec<bool> {
        let unmoved = |id: BodyId| self.unmoved.get(id).copied().unwrap_or(false);
        let frozen = |id: BodyId| unmoved(id) && world.bodies()[id].role == Role::Frozen;
        let mut unchanged: Vec<bool> = (0..world.bodies().len()).map(frozen).collect();
        for t in pairs {
            if let PairSide::Body(b) = t.b {
                unchanged[t.a] &= unmoved(b);
                unchanged[b] &= unmoved(t.a);
            }
        }
        for t in &self.pairs {
            // A body that is gone carried, too.
            if let PairSide::Body(b) = t.b {
                unchanged[t.a] &= unmoved(b) && world.is_present(b);
                unchanged[b] &= unmoved(t.a) && world.is_present(t.a);
            }
        }
        unchanged
    }

    /// Judges all bodies but the barred ones (shape `[body]`; may be shorter), and remembers which passed.
    pub fn judge_all(
        &mut self,
        world: &World,
        pairs: &[ContactPair],
        barred: &[bool],
        eligibility: &Eligibility,
        counters: &mut ControlCounters,
    ) {
        let unchanged = self.unchanged(world, pairs);
        let contacts = contacts(world, pairs, self.params.selection);
        let mut passed = vec![false; world.bodies().len()];
        let mut asked = Vec::new();
        for id in 0..contacts.len() {
            if barred.get(id).is_some_and(|&barred| barred) {
                continue;
            }
            let body = &world.bodies()[id];
            if body.role == Role::Pinned {
                passed[id] = true;
                continue;
            }
            if unchanged[id] {
                counters.verdicts_kept += 1;
                passed[id] = self.candidates[id];
                continue;
            }
            let released = matches!(body.role, Role::Free | Role::Frozen);
            let slow = body.role == Role::Frozen || world.speed(id) < self.params.speed;
            if released && slow && !contacts[id].is_empty() && eligibility.is_inside(world, id) {
                asked.push(id);
            }
        }
        let verdicts = self.verdicts(world, &asked, &contacts);
        for (id, verdict) in asked.into_iter().zip(verdicts) {
            counters.analyses += 1;
            let Some(verdict) = verdict else { continue };
            match verdict.is_stable() {
                true => counters.stable += 1,
                false => counters.unstable += 1,
            }
            passed[id] = verdict == Candidacy::Candidate;
            counters.candidates += u64::from(passed[id]);
        }
        self.candidates = passed;
    }

    /// Verdicts on these bodies, in their order, on all threads. `contacts`: shape `[body][contact]`.
    fn verdicts(&mut self, world: &World, asked: &[BodyId], contacts: &[Vec<LocalContact>]) -> Vec<Option<Candidacy>> {
        let (options, rules) = (&self.options, self.rules(world.units.length));
        let judge = |analyser: &mut Analyser, &id: &BodyId| {
            let body = &world.bodies()[id];
            let problem = LocalProblem {
                contacts: &contacts[id],
                mass: 1.0,
                center_of_mass: world.pose(id).translation,
                radius: body.radius,
                gravity: DVec3::NEG_Y,
            };
            let candidacy = analyser.candidate(&problem, options, &rules.of(body.face_area));
            // The contacts come from finite poses and the parameters are validated: an error would be a programmer's,
            // and then nothing is held.
            debug_assert!(candidacy.is_ok(), "contacts of a checked world");
            candidacy.ok()
        };
        let shares = asked.par_chunks(SHARE).map(|ids| {
            let mut analyser = Analyser::new();
            let verdicts: Vec<Option<Candidacy>> = ids.iter().map(|id| judge(&mut analyser, id)).collect();
            (verdicts, analyser.counters().uncertified)
        });
        let shares: Vec<(Vec<Option<Candidacy>>, u64)> = shares.collect();
        self.undecided += shares.iter().map(|(_, undecided)| undecided).sum::<u64>();
        shares.into_iter().flat_map(|(verdicts, _)| verdicts).collect()
    }

    /// The candidate rules in engine units. `length`: meters per engine unit.
    fn rules(&self, length: f64) -> Rules {
        let reserve = match self.params.friction_reserve {
            params::FrictionReserve::Paper => ReserveRule::Paper,
            params::FrictionReserve::Sharp => ReserveRule::Sharp,
        };
        let (spread, of_face) = match self.params.spread {
            params::Spread::Area(alpha) => (SpreadRule::Paper(alpha / (length * length)), None),
            params::Spread::Relative(share) => (SpreadRule::Relative { share, area: 0.0 }, Some(share)),
        };
        let kinetic_ratio = self.params.kinetic_ratio;
        Rules { all: CandidateRules { reserve, kinetic_ratio, spread, contacts: LEAST_CONTACTS }, of_face }
    }

    /// Verdicts that left the solver without a proof within its tolerances.
    pub fn undecided(&self) -> u64 {
        self.undecided
    }

    /// The local problems that a cycle would now pose, of all released bodies with contacts: for tools that compare
    /// solvers on real piles.
    pub fn problems(&self, world: &World) -> Vec<BodyProblem> {
        let pairs = carrying(world.contact_pairs(self.params.contact_tolerance));
        let contacts = contacts(world, &pairs, self.params.selection).into_iter().enumerate();
        let released = |id: BodyId| matches!(world.bodies()[id].role, Role::Free | Role::Frozen);
        contacts
            .filter(|(id, contacts)| released(*id) && !contacts.is_empty())
            .map(|(id, contacts)| {
                let body = &world.bodies()[id];
                let center_of_mass = world.pose(id).translation;
                BodyProblem { body: id, contacts, center_of_mass, radius: body.radius, face_area: body.face_area }
            })
            .collect()
    }
}

/// The candidate rules of a cycle.
struct Rules {
    all: CandidateRules,
    /// The spread needed, as a share of a body's smallest face; `None`: the same for all bodies.
    of_face: Option<f64>,
}

impl Rules {
    /// For a body with this smallest face.
    fn of(&self, area: f64) -> CandidateRules {
        let spread = self.of_face.map_or(self.all.spread, |share| SpreadRule::Relative { share, area });
        CandidateRules { spread, ..self.all }
    }
}

/// Without the contacts that are too wide to carry: a body held across one would count as hanging, however thick it is.
fn carrying(mut pairs: Vec<ContactPair>) -> Vec<ContactPair> {
    pairs.iter_mut().for_each(|t| t.points.retain(|p| p.gap <= contact::CARRYING_GAP));
    pairs.retain(|t| !t.points.is_empty());
    pairs
}

/// The selected contacts of each body (paper, 3.2). Shape `[body][contact]`, engine units.
fn contacts(world: &World, pairs: &[ContactPair], selection: ContactSelection) -> Vec<Vec<LocalContact>> {
    let mut contacts = vec![Vec::new(); world.bodies().len()];
    let supports = |side: PairSide| match side {
        // A waiting body may have contacts, but supports nothing: it will leave its place.
        PairSide::Body(id) => world.bodies()[id].role != Role::Waiting,
        PairSide::Ground | PairSide::Scenery => true,
        PairSide::Moving => false,
    };
    let selected = |normal: DVec3| selection == ContactSelection::All || normal.y > 0.0;
    for t in pairs {
        for p in &t.points {
            if supports(t.b) && selected(p.normal) {
                contacts[t.a].push(LocalContact { point: p.point, normal: p.normal, friction: t.friction });
            }
            if let PairSide::Body(b) = t.b
                && supports(PairSide::Body(t.a))
                && selected(-p.normal)
            {
                contacts[b].push(LocalContact { point: p.point, normal: -p.normal, friction: t.friction });
            }
        }
    }
    contacts
}
