//! Which bodies stand: forces that balance all at once, or those that miss support.

use super::own::Own;
use super::{Going, PileContacts};
use crate::error::Error;
use cairn_statics::global::{self, GlobalBody, GlobalContact, GlobalProblem, Objective};
use cairn_statics::limit::{self, Accuracy, Limit, LimitProblem, Load};
use glam::DVec3;

/// A body falls that misses at least this share of what the one that misses most does, in its weight, and more than
/// nothing.
const AS_MUCH: f64 = 0.5;
const SOMETHING: f64 = 1e-3;

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

/// A pile without some of its bodies.
pub struct Part {
    /// Index in the whole pile. Shape `[body of the part]`, `[contact of the part]`.
    pub bodies: Vec<usize>,
    pub contacts: Vec<usize>,
    pub part_bodies: Vec<GlobalBody>,
    pub part_contacts: Vec<GlobalContact>,
}

impl Part {
    /// What is left without the bodies that are `gone`, shape `[body]`; `share`: of the friction of a contact, by its
    /// index.
    pub fn new(pile: &PileContacts, gone: &[bool], share: impl Fn(usize) -> f64) -> Part {
        let bodies: Vec<usize> = (0..gone.len()).filter(|&body| !gone[body]).collect();
        let number = |body: usize| bodies.binary_search(&body).ok();
        let is_left = |c: &GlobalContact| !gone[c.body] && c.other.is_none_or(|other| !gone[other]);
        let contacts: Vec<usize> = (0..pile.contacts.len()).filter(|&at| is_left(&pile.contacts[at])).collect();
        let contact = |&at: &usize| {
            let c = pile.contacts[at];
            GlobalContact {
                body: number(c.body).unwrap_or_default(),
                other: c.other.and_then(number),
                friction: c.friction * share(at),
                ..c
            }
        };
        Part {
            part_bodies: bodies.iter().map(|&body| pile.bodies[body]).collect(),
            part_contacts: contacts.iter().map(contact).collect(),
            bodies,
            contacts,
        }
    }

    /// The share of gravity that the contacts can bear: 1 if the part stands.
    pub fn bears(&self) -> Result<Limit, Error> {
        let dead = vec![Load::default(); self.part_bodies.len()];
        let live = limit::weights(&self.part_bodies, DVec3::NEG_Y);
        self.limit(&dead, &live, 1.0)
    }

    pub fn limit(&self, dead: &[Load], live: &[Load], most: f64) -> Result<Limit, Error> {
        let (bodies, contacts) = (&*self.part_bodies, &*self.part_contacts);
        let problem = LimitProblem { bodies, contacts, gravity: 1.0, dead, live, most, accuracy: Accuracy::Fine };
        limit::find(&problem).map_err(|error| Error::Internal(error.to_string()))
    }
}

/// A body that needs nearly the cautious share of friction while its neighbours are held gets all that it needs, and
/// this much more.
const MORE: f64 = 1.15;

/// Looks for the bodies that stand. Those that miss support are left out, then those that rested on them, until the
/// others stand. `share`: the forces are to be within this share of friction, where a pile can be balanced by such;
/// where it cannot, needy bodies get more, then all.
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
    let need = |body: usize| MORE * own[body].friction.unwrap_or(1.0);
    let needy: Vec<f64> =
        pile.contacts.iter().map(|c| need(c.body).max(c.other.map_or(0.0, need)).clamp(share, 1.0)).collect();
    let halfway: Vec<f64> = needy.iter().map(|need| need.max((1.0 + share) / 2.0)).collect();
    let steps = [found.shares.clone(), needy, halfway, vec![1.0; pile.contacts.len()]];
    let mut step = 0;
    loop {
        going.on(0.05)?;
        let shares = &steps[step];
        let part = Part::new(pile, &found.falls, |at| shares[at]);
        if part.bodies.is_empty() {
            return Ok(found);
        }
        found.programs += 1;
        let limit = part.bears()?;
        if limit.reaches(1.0) {
            // Forces that load all contacts alike leave room for what comes next.
            found.programs += 1;
            let rest =
                GlobalProblem { bodies: &part.part_bodies, contacts: &part.part_contacts, gravity: DVec3::NEG_Y };
            let even = limit::evenly(&rest).map_err(|error| Error::Internal(error.to_string()))?;
            let (forces, imbalance) = even.unwrap_or((limit.forces, limit.imbalance));
            part.contacts.iter().zip(&forces).for_each(|(&at, &force)| found.forces[at] = force);
            (found.imbalance, found.shares) = (imbalance, shares.clone());
            return Ok(found);
        }
        if step + 1 < steps.len() {
            step += 1;
            // The same shares again would end in the same way.
            while step + 1 < steps.len() && steps[step] == steps[step - 1] {
                step += 1;
            }
            continue;
        }
        found.programs += 1;
        let rest = GlobalProblem { bodies: &part.part_bodies, contacts: &part.part_contacts, gravity: DVec3::NEG_Y };
        let balance = global::analyse(&rest, Objective::SumOfNorms { sharpen: 2 })
            .map_err(|error| Error::Internal(error.to_string()))?;
        let most = balance.imbalance.iter().copied().fold(0.0, f64::max);
        let least = (AS_MUCH * most).max(SOMETHING.min(most));
        for (k, &missing) in balance.imbalance.iter().enumerate().filter(|(_, missing)| **missing >= least) {
            (found.falls[part.bodies[k]], found.missing[part.bodies[k]]) = (true, missing);
        }
        step = 0;
    }
}
