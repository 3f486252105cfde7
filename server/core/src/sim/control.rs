//! The control cycle (paper, 3): local equilibrium analysis, candidates, and what is held until the next cycle.

mod impact;
mod state;
mod tally;

pub use tally::{LocalProblem, Tally};

use crate::equilibrium::{
    Analyser, Candidacy, CandidateRules, Contact, FrictionLaw, FrictionReserve, Options, Problem, Solver, Spread,
};
use crate::geometry::contact;
use crate::geometry::region::DistanceGrid;
use crate::input::params::{self, ContactSelection, Control as ControlParams, ControlMode, FrictionCone, Neighbours};
use crate::world::{BodyId, Role, Side, Touch, World};
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};

/// The control and its memory: which bodies were certified in the latest cycle.
pub struct Control<'a> {
    params: &'a ControlParams,
    /// Force per mass at which a nail breaks, in weights.
    break_limit: f64,
    /// Bodies whose centre of mass is outside are never controlled; `None`: the control acts everywhere.
    region: Option<&'a DistanceGrid>,
    analyser: Analyser,
    rng: Pcg64Mcg,
    pub tally: Tally,
    /// Shape `[body]`: passed the latest analysis and candidate rules.
    certified: Vec<bool>,
    /// The touches of the latest cycle, and the bodies that stood still since. Shape `[body]`.
    touches: Vec<Touch>,
    still: Vec<bool>,
    /// Bodies whose hold has broken. Ordered, so that nothing depends on the order of a hash map.
    strained: BTreeMap<BodyId, Strain>,
    /// Set late in the hold: bodies outside the region are damped, too, and fast ones by this much.
    quiet: Option<f64>,
    /// Whether something may hit the pile: only then hits are looked for.
    pub watches_hits: bool,
    /// Bodies let go for a hit, and the first cycle that may hold them again.
    shaken: BTreeMap<BodyId, u64>,
    /// Bodies that were dropped or thrown: not damped while they touch nothing.
    dropped: BTreeSet<BodyId>,
    /// Bodies placed by hand that may overlap: not held before they have come apart.
    placed: BTreeSet<BodyId>,
    /// It has ended for good.
    ended: bool,
    region_tests: Cell<u64>,
}

/// A body whose hold broke under its load is squeezed between its neighbours: holding it again at once would only
/// break again and rattle for ever. It stays free for a while, each time twice as long, so that the squeeze can ease,
/// and after the last attempt for good.
#[derive(Clone, Copy, Debug)]
struct Strain {
    breaks: u32,
    /// The first cycle that may hold it again.
    free_until: u64,
}

impl Strain {
    const ATTEMPTS: u32 = 4;

    fn again(before: Option<&Strain>, cycle: u64) -> Strain {
        let breaks = before.map_or(1, |s| s.breaks + 1);
        let free_until = if breaks < Strain::ATTEMPTS { cycle + (1 << breaks) } else { u64::MAX };
        Strain { breaks, free_until }
    }
}

/// The paper's kappa is an impulse per kg over this time (s): its step.
const KAPPA_TIME: f64 = 1.0 / 240.0;
/// A centre of mass this far outside the region (in d) still counts as inside, as in `inside_fraction`.
const REGION_TOLERANCE: f64 = 0.1;

/// Late in the hold slow bodies are damped this much more. What lacks support still falls, at 1/20 of d per natural time:
/// five times what counts as rest.
const LATE_DAMPING: f64 = 3.0;

impl<'a> Control<'a> {
    /// `region` in engine units.
    pub fn new(params: &'a ControlParams, gravity: f64, seed: u64, region: Option<&'a DistanceGrid>) -> Control<'a> {
        Control {
            params,
            break_limit: params.kappa / KAPPA_TIME / gravity,
            region,
            analyser: Analyser::new(),
            rng: Pcg64Mcg::seed_from_u64(seed),
            tally: Tally::default(),
            certified: Vec::new(),
            touches: Vec::new(),
            still: Vec::new(),
            strained: BTreeMap::new(),
            quiet: None,
            watches_hits: false,
            shaken: BTreeMap::new(),
            dropped: BTreeSet::new(),
            placed: BTreeSet::new(),
            ended: false,
            region_tests: Cell::new(0),
        }
    }

    pub fn is_on(&self) -> bool {
        self.params.mode != ControlMode::Off && !self.ended
    }

    /// Whether a cycle is due before this step of the release.
    pub fn is_due(&self, step: u64) -> bool {
        self.is_on() && step.is_multiple_of(u64::from(self.params.period))
    }

    /// From now on slow bodies are damped outside the region, too, and more than before; what moves fast is damped by
    /// `damping`.
    pub fn quieten(&mut self, damping: f64) {
        self.quiet = Some(damping);
    }

    /// Ends that again.
    pub fn unquieten(&mut self) {
        self.quiet = None;
    }

    /// A body falls or flies in.
    pub fn drop_in(&mut self, id: BodyId) {
        self.dropped.insert(id);
    }

    /// A body was placed by hand, maybe into another one.
    pub fn place(&mut self, id: BodyId) {
        self.placed.insert(id);
    }

    /// Ends the control: nothing is held, nailed, damped or slippery any more.
    pub fn end(&mut self, world: &mut World) {
        self.ended = true;
        world.pull_all_nails();
        for id in world.present().collect::<Vec<_>>() {
            if world.bodies()[id].role == Role::Held {
                world.set_role(id, Role::Free);
            }
            world.set_slippery(id, false);
        }
    }

    /// How often it was asked whether a body is inside the region.
    pub fn region_tests(&self) -> u64 {
        self.region_tests.get()
    }

    /// Bodies that passed the latest cycle.
    pub fn certified(&self) -> &[bool] {
        &self.certified
    }

    /// The local problems that a cycle would now pose, of all released bodies with contacts: for tools that compare
    /// solvers on real piles.
    pub fn local_problems(&self, world: &World) -> Vec<LocalProblem> {
        let touches = world.touches(self.params.contact_tolerance);
        let contacts = self.contacts(world, &touches).into_iter().enumerate();
        let released = |id: BodyId| matches!(world.bodies()[id].role, Role::Free | Role::Held);
        contacts
            .filter(|(id, contacts)| released(*id) && !contacts.is_empty())
            .map(|(id, contacts)| {
                let body = &world.bodies()[id];
                let center_of_mass = world.pose(id).translation;
                LocalProblem { body: id, contacts, center_of_mass, radius: body.radius, face_area: body.face_area }
            })
            .collect()
    }

    /// One cycle: everything that was held is judged anew.
    pub fn cycle(&mut self, world: &mut World) {
        self.tally.cycles += 1;
        world.pull_all_nails();
        let mut touches = world.touches_since(self.params.contact_tolerance, &self.touches, &self.still);
        // A body held across a wider gap would count as hanging, however thick it is.
        touches.iter_mut().for_each(|t| t.points.retain(|p| p.gap <= contact::CARRYING_GAP));
        touches.retain(|t| !t.points.is_empty());
        let barred = self.barred(world, &touches);
        self.certified = self.candidates(world, &touches, &barred);
        let hanging = self.hanging(world, &touches);
        hanging.iter().for_each(|&id| self.certified[id] = false);
        match self.params.mode {
            ControlMode::Off => {}
            ControlMode::Nails => self.nail(world, &touches),
            ControlMode::Hold => self.hold(world, &touches),
        }
        self.damp(world, &touches);
        self.unjam(world, &hanging);
        self.touches = touches;
        if !self.params.switches.kept_verdicts.is_on(true) {
            return;
        }
        let stands = |role: Role| matches!(role, Role::Held | Role::Waiting | Role::Kept);
        self.still = world.bodies().iter().map(|b| stands(b.role)).collect();
    }

    /// A waiting body is let go: it may move now, and counts as a support.
    pub fn release(&mut self, id: BodyId) {
        self.stir(id);
    }

    fn stir(&mut self, id: BodyId) {
        if let Some(still) = self.still.get_mut(id) {
            *still = false;
        }
    }

    /// After each step: what carries more than kappa allows lets go.
    pub fn after_step(&mut self, world: &mut World) {
        if !self.is_on() || !self.params.switches.breaking.is_on(true) {
            return;
        }
        self.tally.break_checks += 1;
        match self.params.mode {
            ControlMode::Off => {}
            ControlMode::Nails => {
                let (broken, load) = world.break_nails(self.break_limit);
                self.tally.nails_broken += broken as u64;
                self.tally.nail_load_max = self.tally.nail_load_max.max(load);
            }
            ControlMode::Hold => {
                for id in world.overloaded(self.break_limit) {
                    world.set_role(id, Role::Free);
                    self.stir(id);
                    self.tally.holds_broken += 1;
                    let strain = Strain::again(self.strained.get(&id), self.tally.cycles);
                    self.strained.insert(id, strain);
                }
            }
        }
    }

    /// Bodies that stand still and touch nothing that moved, appeared or began to carry since their last verdict: it
    /// still holds. Shape `[body]`.
    fn settled(&self, world: &World, touches: &[Touch]) -> Vec<bool> {
        let calm = |id: BodyId| self.still.get(id).copied().unwrap_or(false);
        let held = |id: BodyId| calm(id) && world.bodies()[id].role == Role::Held;
        let mut settled: Vec<bool> = (0..world.bodies().len()).map(held).collect();
        for t in touches {
            if let Side::Body(b) = t.b {
                settled[t.a] &= calm(b);
                settled[b] &= calm(t.a);
            }
        }
        for t in &self.touches {
            // What has gone away carried, too.
            if let Side::Body(b) = t.b {
                settled[t.a] &= calm(b) && world.is_present(b);
                settled[b] &= calm(t.a) && world.is_present(t.a);
            }
        }
        settled
    }

    /// Section 3.1 to 3.3: which bodies may be held. Shape `[body]`.
    fn candidates(&mut self, world: &World, touches: &[Touch], barred: &[bool]) -> Vec<bool> {
        let settled = self.settled(world, touches);
        let contacts = self.contacts(world, touches);
        let mut passed = vec![false; world.bodies().len()];
        for (id, contacts) in contacts.iter().enumerate() {
            if barred.get(id).is_some_and(|&barred| barred) {
                continue;
            }
            if world.bodies()[id].role == Role::Kept {
                passed[id] = true;
                continue;
            }
            if settled[id] {
                self.tally.settled += 1;
                passed[id] = self.certified[id];
                continue;
            }
            let body = &world.bodies()[id];
            let released = matches!(body.role, Role::Free | Role::Held);
            let slow = body.role == Role::Held || world.speed(id) < self.params.speed;
            if !released || !slow || contacts.is_empty() || !self.is_inside(world, id) {
                continue;
            }
            let problem = Problem {
                contacts,
                mass: 1.0,
                center_of_mass: world.pose(id).translation,
                radius: body.radius,
                gravity: DVec3::NEG_Y,
            };
            passed[id] = self.judge(&problem, body.face_area, world.units.length);
        }
        passed
    }

    fn is_inside(&self, world: &World, id: BodyId) -> bool {
        let Some(region) = self.region else { return true };
        self.region_tests.set(self.region_tests.get() + 1);
        region.signed_distance(world.pose(id).translation) <= REGION_TOLERANCE
    }

    /// The selected contacts of each body. Shape `[body][contact]`, engine units.
    fn contacts(&self, world: &World, touches: &[Touch]) -> Vec<Vec<Contact>> {
        let mut contacts = vec![Vec::new(); world.bodies().len()];
        let supports = |side: Side| match side {
            // A body that waits may be touched, but supports nothing: it will be gone from there.
            Side::Body(id) => world.bodies()[id].role != Role::Waiting,
            Side::Ground | Side::Scenery => true,
            Side::Moving => false,
        };
        let selected = |normal: DVec3| self.params.selection == ContactSelection::All || normal.y > 0.0;
        for t in touches {
            for p in &t.points {
                if supports(t.b) && selected(p.normal) {
                    contacts[t.a].push(Contact { point: p.point, normal: p.normal, friction: t.friction });
                }
                if let Side::Body(b) = t.b
                    && supports(Side::Body(t.a))
                    && selected(-p.normal)
                {
                    contacts[b].push(Contact { point: p.point, normal: -p.normal, friction: t.friction });
                }
            }
        }
        contacts
    }

    /// Analysis and candidate rules for one body.
    fn judge(&mut self, problem: &Problem, face_area: f64, length: f64) -> bool {
        let friction_law = match self.params.friction_cone {
            FrictionCone::Pyramid => FrictionLaw::PAPER,
            FrictionCone::Cone => FrictionLaw::Cone,
        };
        let reserve = match self.params.friction_reserve {
            params::FrictionReserve::Paper => FrictionReserve::Paper,
            params::FrictionReserve::Sharp => FrictionReserve::Sharp,
        };
        let spread = match self.params.spread {
            params::Spread::Paper(alpha) => Spread::Paper(alpha / (length * length)),
            params::Spread::Relative(share) => Spread::Relative { share, area: face_area },
        };
        let rules = CandidateRules { reserve, kinetic_ratio: self.params.kinetic_ratio, spread, contacts: 3 };
        let options = Options { friction_law, solver: Solver::Fast, margin: false };
        self.tally.analyses += 1;
        // The contacts come from finite poses and the parameters are validated: an error would be a fault of ours, and
        // then nothing is held.
        let Ok(candidacy) = self.analyser.candidate(problem, &options, &rules) else {
            debug_assert!(false, "contacts of a checked world");
            return false;
        };
        if candidacy.is_stable() {
            self.tally.stable += 1;
        } else {
            self.tally.unstable += 1;
        }
        let passed = candidacy == Candidacy::Candidate;
        self.tally.candidates += u64::from(passed);
        passed
    }

    /// Whether everything that each body touches is a candidate, too (S_c a subset of C).
    fn surrounded(&self, world: &World, touches: &[Touch]) -> Vec<bool> {
        let mut all = self.certified.clone();
        for t in touches {
            if let Side::Body(b) = t.b {
                for (x, y) in [(t.a, b), (b, t.a)] {
                    all[x] &= self.certified[y];
                }
            }
        }
        debug_assert_eq!(all.len(), world.bodies().len());
        all
    }

    fn nail(&mut self, world: &mut World, touches: &[Touch]) {
        let closed = match self.params.neighbours {
            Neighbours::All => self.surrounded(world, touches),
            Neighbours::Either => self.certified.clone(),
        };
        let most = self.params.nails_per_body;
        let mut driven = vec![0u32; world.bodies().len()];
        for t in touches {
            let (nailed, other) = match t.b {
                Side::Body(b) => (self.certified[t.a] && self.certified[b] && (closed[t.a] || closed[b]), Some(b)),
                Side::Ground | Side::Scenery => (closed[t.a], None),
                Side::Moving => continue,
            };
            let room = driven[t.a] < most && other.is_none_or(|b| driven[b] < most);
            if nailed && room {
                driven[t.a] += 1;
                if let Some(b) = other {
                    driven[b] += 1;
                }
                let p = &t.points[self.rng.random_range(0..t.points.len())];
                world.drive_nail(t.a, other, p.point, p.normal);
                self.tally.nails_driven += 1;
            }
        }
        self.tally.nails_peak = self.tally.nails_peak.max(world.nail_count() as u64);
    }

    fn hold(&mut self, world: &mut World, touches: &[Touch]) {
        let held = match self.params.neighbours {
            Neighbours::All => self.surrounded(world, touches),
            Neighbours::Either => self.certified.clone(),
        };
        let strained = |id: &BodyId| {
            self.strained.get(id).is_some_and(|s| self.tally.cycles < s.free_until) || self.is_shaken(*id)
        };
        for (id, hold) in held.iter().enumerate().map(|(id, &hold)| (id, hold && !strained(&id))) {
            match world.bodies()[id].role {
                Role::Free | Role::Held => world.set_role(id, if hold { Role::Held } else { Role::Free }),
                Role::Waiting | Role::Kept | Role::Gone => {}
            }
        }
        self.tally.held_peak = self.tally.held_peak.max(world.count(Role::Held) as u64);
    }

    /// Slow bodies that no chain of contacts from below joins to the ground. They are jammed between their sides, as no
    /// pile that fell into place would have it: the fill squeezed them in there.
    fn hanging(&self, world: &World, touches: &[Touch]) -> Vec<BodyId> {
        let waits = |id: BodyId| world.bodies()[id].role == Role::Waiting;
        let released = |t: &&Touch| !waits(t.a) && !matches!(t.b, Side::Body(b) if waits(b));
        let contacts: Vec<_> = touches.iter().filter(released).flat_map(|t| t.measured(world)).collect();
        let slow = |id: BodyId| {
            let free = world.bodies()[id].role == Role::Free && world.speed(id) < self.params.speed;
            (free || world.bodies()[id].role == Role::Held) && self.is_inside(world, id)
        };
        let slow: Vec<bool> = (0..world.bodies().len()).map(slow).collect();
        // Engine units: d is 1.
        contact::hanging(&slow, &contacts, 1.0)
    }

    /// Without friction what hangs slips down onto what is below.
    fn unjam(&mut self, world: &mut World, hanging: &[BodyId]) {
        self.tally.unjammed += hanging.len() as u64;
        for id in world.present().collect::<Vec<_>>() {
            world.set_slippery(id, hanging.binary_search(&id).is_ok());
        }
    }

    /// Slow bodies that are not certified lose speed, so that near contacts close gently and rest can be certified;
    /// a falling body falls.
    fn damp(&self, world: &mut World, touches: &[Touch]) {
        if self.params.damping == 0.0 {
            return;
        }
        let flying = self.flying(touches);
        for id in 0..world.bodies().len() {
            if world.bodies()[id].role == Role::Free && (self.quiet.is_some() || self.is_inside(world, id)) {
                let slow = world.speed(id) < self.params.speed;
                if self.is_shaken(id) || flying.contains(&id) {
                    world.set_damping(id, 0.0);
                    continue;
                }
                let slowly = if self.quiet.is_some() { LATE_DAMPING } else { 1.0 } * self.params.damping;
                world.set_damping(id, if slow { slowly } else { self.quiet.unwrap_or(0.0) });
            }
        }
    }
}
