//! A pile without some of its bodies, as problems of statics.

use super::{Going, PileContacts, assembly};
use cairn_input::error::Error;
use cairn_statics::global::{self, BALANCED, GlobalBody, GlobalContact, GlobalProblem, Objective};
use cairn_statics::glue::{self, GlueError, GlueProblem, GlueSite};
use cairn_statics::limit::{self, Accuracy, Limit, LimitProblem, Load};
use glam::DVec3;

/// With more pairs that touch, the splitting method is much faster than a cone program.
pub const LARGE: usize = 400;
/// The square of the pairs, times cone programs of the whole: a few seconds.
const WORK: usize = 8_000_000;

/// What is left of a pile.
pub struct Part {
    /// Index in the whole pile. Shape `[body of the part]`, `[contact of the part]`.
    pub bodies: Vec<usize>,
    pub contacts: Vec<usize>,
    pub part_bodies: Vec<GlobalBody>,
    pub part_contacts: Vec<GlobalContact>,
    /// Pairs that touch, none of which may be glued.
    pub sites: Vec<GlueSite>,
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
        let part_contacts: Vec<GlobalContact> = contacts.iter().map(contact).collect();
        Part {
            part_bodies: bodies.iter().map(|&body| pile.bodies[body]).collect(),
            sites: sites(&part_contacts),
            part_contacts,
            bodies,
            contacts,
        }
    }

    /// Besides its weight. Shape `[body of the part]`.
    pub fn no_load(&self) -> Vec<Load> {
        vec![Load::default(); self.part_bodies.len()]
    }

    /// The share of gravity that the contacts can bear: 1 if the part stands.
    pub fn bears(&self) -> Result<Limit, Error> {
        let dead = self.no_load();
        let live = limit::weights(&self.part_bodies, DVec3::NEG_Y);
        self.limit(&dead, &live, 1.0)
    }

    /// Whether the splitting method has to do, where there is one.
    pub fn is_large(&self) -> bool {
        self.sites.len() > LARGE
    }

    /// The number of cone programs of the whole part that an analysis has time for.
    pub fn affordable(&self) -> usize {
        WORK / (self.sites.len() * self.sites.len()).max(1)
    }

    /// Forces that balance the part under its weight and these loads, and what they leave unbalanced, where such are
    /// found without a cone program. Shape `[body of the part]`.
    /// `is_even`: see [`glue::balance_contacts`].
    pub fn balance(
        &self,
        loads: &[Load],
        is_even: bool,
        going: &mut Going,
    ) -> Result<Option<(Vec<DVec3>, f64)>, Error> {
        let found = glue::balance_contacts(&self.problem(), loads, is_even, &mut || going.flow_on());
        let found = found.map_err(internal)?;
        Ok(Some(found).filter(|(_, imbalance)| *imbalance <= BALANCED))
    }

    /// What the best forces leave of each body, in its weight.
    pub fn missing(&self, enough: f64, going: &mut Going) -> Result<Vec<f64>, Error> {
        if self.is_large() {
            return glue::missing(&self.problem(), enough, &mut || going.flow_on())
                .map(|(all, _)| all)
                .map_err(internal);
        }
        let rest = GlobalProblem { bodies: &self.part_bodies, contacts: &self.part_contacts, gravity: DVec3::NEG_Y };
        let balance = global::analyse(&rest, Objective::SumOfNorms { sharpen: 2 });
        balance.map(|balance| balance.imbalance).map_err(|error| internal(error.into()))
    }

    fn problem(&self) -> GlueProblem<'_> {
        let Part { part_bodies: bodies, part_contacts: contacts, sites, .. } = self;
        GlueProblem { bodies, contacts, sites, gravity: DVec3::NEG_Y }
    }

    pub fn limit(&self, dead: &[Load], live: &[Load], most: f64) -> Result<Limit, Error> {
        let (bodies, contacts) = (&*self.part_bodies, &*self.part_contacts);
        let problem = LimitProblem { bodies, contacts, gravity: 1.0, dead, live, most, accuracy: Accuracy::Fine };
        limit::find(&problem).map_err(|error| internal(error.into()))
    }
}

/// The sites of contacts that are in the order of their pairs.
fn sites(contacts: &[GlobalContact]) -> Vec<GlueSite> {
    let same = |a: &GlobalContact, b: &GlobalContact| (a.body, a.other) == (b.body, b.other);
    let mut from = 0;
    let site = |pair: &[GlobalContact]| {
        let contacts = from..from + pair.len();
        from = contacts.end;
        assembly::site(&pair[0], contacts)
    };
    contacts.chunk_by(same).map(site).collect()
}

fn internal(error: GlueError) -> Error {
    match error {
        GlueError::Cancelled => Error::Cancelled,
        error => Error::Internal(error.to_string()),
    }
}
