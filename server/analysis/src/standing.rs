//! Which bodies stand: forces that balance all at once, or those that miss support.

use super::own::Own;
use super::part::Part;
use super::{Going, PileContacts};
use cairn_engine::world::BodyId;
use cairn_input::error::Error;
use cairn_statics::global::{GlobalBody, GlobalContact};
use cairn_statics::local::{Analyser, LocalProblem, Verdict};
use glam::DVec3;

/// A body falls that misses at least this share of what the one that misses most does, of all or, in a large pile, of
/// those around it; in its weight, and more than nothing.
const SHARE_OF_MOST: f64 = 0.5;
const LEAST_MISSING: f64 = 1e-3;

/// The bodies that stand, with their forces.
pub struct Found {
    /// Shape `[body]`.
    pub falls: Vec<bool>,
    /// What forces leave unbalanced when it was found to fall, in its weight; 0 for one that stands. Shape `[body]`.
    pub missing: Vec<f64>,
    /// Balance the bodies that stand. Shape `[contact]`.
    pub forces: Vec<DVec3>,
    /// Sum over those, by substitution.
    pub imbalance: f64,
    /// The share of each contact's friction within which the forces are. Shape `[contact]`.
    pub shares: Vec<f64>,
    pub programs: u64,
}

/// A body that needs nearly the cautious share of friction while its neighbours are held gets all that it needs, and
/// this much more.
const SPARE_FRICTION: f64 = 1.15;

/// Looks for the bodies that stand. Those that miss support are left out, then those that rested on them, until the
/// others stand. `share`: the forces are to be within this share of friction, where a pile can be balanced by such;
/// where it cannot, bodies that need more get it, then all.
pub fn of(pile: &PileContacts, own: &[Own], share: f64, going: &mut Going) -> Result<Found, Error> {
    let count = pile.bodies.len();
    let mut found = Found {
        falls: vec![false; count],
        missing: vec![0.0; count],
        forces: vec![DVec3::ZERO; pile.contacts.len()],
        imbalance: 0.0,
        shares: vec![share; pile.contacts.len()],
        programs: 0,
    };
    let need = |body: usize| SPARE_FRICTION * own[body].friction.unwrap_or(1.0);
    let needed: Vec<f64> =
        pile.contacts.iter().map(|c| need(c.body).max(c.other.map_or(0.0, need)).clamp(share, 1.0)).collect();
    let halfway: Vec<f64> = needed.iter().map(|need| need.max((1.0 + share) / 2.0)).collect();
    let mut steps = vec![found.shares.clone(), needed, halfway, vec![1.0; pile.contacts.len()]];
    // The same shares again would end in the same way.
    steps.dedup();
    let mut last = loop {
        going.on(0.05)?;
        found.leave_out_alone(pile);
        let part = Part::new(pile, &found.falls, |_| 1.0);
        if part.bodies.is_empty() {
            return Ok(found);
        }
        if let Some(forces) = found.balance(&part, going)? {
            break forces;
        }
        found.programs += 1;
        let missing = part.missing(LEAST_MISSING, going)?;
        found.leave_out(&part, &missing);
    };
    let mut shares = steps.pop().unwrap_or_default();
    // What a body needs even while its neighbours are held, the whole needs.
    let suffices = |step: &[f64]| {
        let needs =
            |body: usize, at: usize| !found.falls[body] && own[body].friction.is_some_and(|need| need > step[at]);
        let contact =
            |(at, c): (usize, &GlobalContact)| needs(c.body, at) || c.other.is_some_and(|other| needs(other, at));
        !pile.contacts.iter().enumerate().any(contact)
    };
    steps.retain(|step| suffices(step));
    for step in steps {
        going.on(0.05)?;
        let part = Part::new(pile, &found.falls, |at| step[at]);
        if let Some(forces) = found.balance(&part, going)? {
            (last, shares) = (forces, step);
            break;
        }
    }
    // Forces that load all contacts alike leave room for what comes next.
    let part = Part::new(pile, &found.falls, |at| shares[at]);
    found.programs += 1;
    let even = part.balance(&part.no_load(), true, going)?;
    let (forces, imbalance) = even.unwrap_or(last);
    part.contacts.iter().zip(&forces).for_each(|(&at, &force)| found.forces[at] = force);
    (found.imbalance, found.shares) = (imbalance, shares);
    Ok(found)
}

impl Found {
    /// Forces that balance a part, and what they leave; `None` where none were found.
    fn balance(&mut self, part: &Part, going: &mut Going) -> Result<Option<(Vec<DVec3>, f64)>, Error> {
        self.programs += 1;
        let forces = part.balance(&part.no_load(), false, going)?;
        if forces.is_some() || part.is_large() {
            return Ok(forces);
        }
        let limit = part.bears()?;
        Ok(limit.reaches(1.0).then_some((limit.forces, limit.imbalance)))
    }

    /// Bodies that fall even while those that are left are held, and then those that rested on them.
    fn leave_out_alone(&mut self, pile: &PileContacts) {
        for (body, residual) in fall_alone(pile, &mut self.falls) {
            self.missing[body] = residual;
        }
    }

    /// Those that miss most of a part's bodies, or of those around them where the part is large.
    fn leave_out(&mut self, part: &Part, missing: &[f64]) {
        let all = missing.iter().copied().fold(0.0, f64::max);
        let mut around = vec![all; missing.len()];
        if part.is_large() {
            around = missing.to_vec();
            for _ in 0..RINGS {
                let inner = around.clone();
                for site in &part.sites {
                    let Some(other) = site.other else { continue };
                    around[site.body] = around[site.body].max(inner[other]);
                    around[other] = around[other].max(inner[site.body]);
                }
            }
        }
        for (k, &missing) in missing.iter().enumerate() {
            let least = (SHARE_OF_MOST * around[k]).max(LEAST_MISSING.min(all));
            if missing >= least {
                (self.falls[part.bodies[k]], self.missing[part.bodies[k]]) = (true, missing);
            }
        }
    }
}

/// Neighbours of neighbours, so many times, are around a body.
const RINGS: usize = 3;

/// Bodies that fall even while those that are left are held, and those that rested on such; by their names.
pub fn falling_alone(pile: &PileContacts) -> Vec<BodyId> {
    let mut falls = vec![false; pile.bodies.len()];
    fall_alone(pile, &mut falls);
    pile.named(&falls)
}

/// Adds these to the bodies that fall, shape `[body]`; what each misses, in its weight.
fn fall_alone(pile: &PileContacts, falls: &mut [bool]) -> Vec<(usize, f64)> {
    let mut analyser = Analyser::new();
    let mut found = Vec::new();
    loop {
        let before = found.len();
        let touching = pile.touching(falls);
        for (body, contacts) in touching.iter().enumerate() {
            if falls[body] {
                continue;
            }
            let GlobalBody { mass, center_of_mass, radius } = pile.bodies[body];
            let problem = LocalProblem { contacts, mass, center_of_mass, radius, gravity: DVec3::NEG_Y };
            match analyser.analyse(&problem, &Default::default()) {
                Ok(Verdict::Unstable { residual, .. }) if residual >= LEAST_MISSING => {
                    falls[body] = true;
                    found.push((body, residual));
                }
                _ => (),
            }
        }
        if found.len() == before {
            return found;
        }
    }
}
