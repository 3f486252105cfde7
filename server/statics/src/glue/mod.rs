//! Where a pile must be glued to stand: the sparsest set of contact pairs that may also pull.
//!
//! Friction carries a heap; it carries no overhang, no ball on a point and no arm. A *glue joint* at a *site*, a pair
//! of bodies that touch, transmits any force and any moment. This module chooses few joints such that every body of the
//! pile is in equilibrium **with safety**: only a share of friction counts, and normal forces have a price, since an
//! equilibrium that wedges exists on paper alone.
//!
//! # Formulation
//!
//! The unknowns are the contact forces f_c of [`crate::global`] and, per site t, the joint's wrench g_t = (force,
//! moment / arm) at the middle of the site:
//!
//! ```text
//! minimise    sum_t w_t |g_t|  +  sum_c price_c fn_c         (a group lasso over sites)
//! such that   every body is balanced, |ft_c| <= factor mu fn_c
//! ```
//!
//! The first solve has w = 1; each round then reweights by w_t = e / (|g_t| + e), so that a joint that carries little
//! comes to carry nothing (Candes, Wakin & Boyd 2008). The price falls by e too, or a joint would soon cost less than
//! the normal force that replaces it. In the end, joints that carry next to nothing are dropped. To find the fewest
//! joints is NP-hard: this finds few; [`GluePlacement::at_least`] is a bound.
//!
//! The strength of the glue bounds |g_t|. Where no balance is found within it, even with all joints that any round
//! chose, some bodies fall: those that miss most support where all allowed sites are glued (`falls.rs`).
//! [`GluePlacement::fallen`] names them, and the other bodies are balanced without them.
//!
//! # Method
//!
//! `admm.rs` solves the rounds: projection onto balance, projection onto the friction cones and shrinkage of the
//! joints in turn (ADMM; Boyd et al. 2011), the former by preconditioned conjugate gradients. Its choice of joints
//! settles long before its forces balance; so `certificate.rs` balances the chosen joints, to [`BALANCED`] by
//! substitution, with Clarabel where that fails.

mod admm;
mod bound;
mod certificate;
mod factor;
mod falls;
pub mod interior_point;
mod loads;
mod missing;
mod program;
mod rebalance;

use crate::global::{BALANCED, GlobalBody, GlobalContact};
use admm::{Admm, GlueWeights};
use certificate::Balanced;
use glam::DVec3;
pub use loads::Loads;
pub use missing::missing;
use program::{GlueForces, GlueProgram};
pub use rebalance::{balance as balance_contacts, rebalance};
use std::collections::BTreeSet;
use std::iter;
use std::ops::{ControlFlow, Range};

/// A pair of bodies that could be glued, or a body and the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct GlueSite {
    /// Index of the body that the contacts' normals point into.
    pub body: usize,
    /// The other body; `None` for the ground and scenery.
    pub other: Option<usize>,
    /// Its contacts among the pile's; none where the two are near each other without touching.
    pub contacts: Range<usize>,
    /// Place of the joint.
    pub center: DVec3,
    /// A moment counts as the force that causes it at this distance, > 0.
    pub arm: f64,
    /// It may be glued.
    pub may_glue: bool,
    /// Minimum price of its normal forces, relative to a joint force (1); >= 0.
    pub normal_price: f64,
}

/// The pile. Any consistent unit system.
#[derive(Clone, Copy, Debug)]
pub struct GlueProblem<'a> {
    pub bodies: &'a [GlobalBody],
    /// In the order of the sites.
    pub contacts: &'a [GlobalContact],
    pub sites: &'a [GlueSite],
    pub gravity: DVec3,
}

/// Safety, and strength of the glue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlueOptions {
    /// Friction counts by this factor, 0 to 1.
    pub friction_factor: f64,
    /// Price of a normal force, relative to a joint force (1); a site may have a higher one.
    pub normal_price: f64,
    /// The most that a joint may carry, as |(force, moment / arm)|; a force. `None`: no bound.
    pub strength: Option<f64>,
    /// Rounds of reweighting, [`LEAST_ROUNDS`] to [`MOST_ROUNDS`]: fewer find somewhat more joints in less time.
    pub rounds: usize,
}

/// A glued site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlueJoint {
    /// Index among the sites.
    pub site: usize,
    /// On the site's body, at its center; the reverse on the other.
    pub force: DVec3,
    pub moment: DVec3,
}

/// The chosen joints, with the forces that prove them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GluePlacement {
    /// By site, ascending.
    pub joints: Vec<GlueJoint>,
    /// Lower bound on the number of joints; it may not be reachable.
    pub at_least: usize,
    /// Bodies that glue of this strength at the allowed sites cannot hold, ascending.
    pub fallen: Vec<usize>,
    /// Contact forces that balance the remaining bodies together with the joints. Shape `[contact]`.
    pub forces: Vec<DVec3>,
    /// Their imbalance, by substitution: sum over the bodies that stand, each relative to its weight; per thousand
    /// bodies where there are more.
    pub imbalance: f64,
    /// Clarabel balanced the chosen joints, since the splitting method could not.
    pub by_cone_program: bool,
    /// Rounds of the splitting method.
    pub iterations: u64,
}

impl GluePlacement {
    /// Every body that has not fallen is in equilibrium.
    pub fn stands(&self) -> bool {
        self.imbalance <= BALANCED
    }
}

/// The reason for which there is no placement.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GlueError {
    #[error(transparent)]
    Problem(#[from] crate::global::GlobalProblemError),
    #[error("site {0}: a body does not exist, or both are the same")]
    SiteBodies(usize),
    #[error("site {0}: its contacts must follow those of the site before, and join its two bodies")]
    SiteContacts(usize),
    #[error("site {0}: the center is not finite, or too far from its bodies")]
    SiteCenter(usize),
    #[error("site {0}: the arm must be finite and above 0")]
    SiteArm(usize),
    #[error("site {0}: the price must be finite and at least 0")]
    SitePrice(usize),
    #[error("contact {0} belongs to no site")]
    Contact(usize),
    #[error("the friction factor, the price or the strength is negative or not a number")]
    Options,
    #[error("cancelled")]
    Cancelled,
}

/// The e of each round of reweighting, in weights of the lighter body.
const ROUNDS: [f64; 7] = [0.3, 0.1, 0.05, 0.03, 0.02, 0.01, 0.005];
/// Most rounds of reweighting.
pub const MOST_ROUNDS: usize = ROUNDS.len();
/// Fewest rounds. If they find no balance, all rounds run.
pub const LEAST_ROUNDS: usize = 2;
/// A pile of more bodies gets [`LEAST_ROUNDS`] alone, to bound the time.
const LARGE: usize = 4000;
/// Rounds that are left out where joints are known.
const KNOWN: usize = 3;
/// A force less than this is none, in weights of the lighter body: its joint is dropped.
const NOTHING: f64 = 1e-4;
/// The share below which a part matters little. A projection may leave this share of the imbalance. A correction stalls
/// if it lowers the imbalance by less. A force that lost more of its correction at its bound is only this share as
/// movable in the next one. A body lacks a joint if its imbalance is at least this share of the largest one.
const MINOR: f64 = 0.1;
/// Joints are chosen for a friction that is smaller still, by this factor: that leaves the certificate the room which
/// it needs.
const TIGHT: f64 = 0.985;
/// Where a choice does not balance, further joints are sought at this share of the price of normal forces. Chosen
/// joints are balanced to this share of [`admm::NEAR`].
const REPAIR_SHARE: f64 = 0.25;
/// In a pile of more bodies, more joints are tried before the cone program, which takes longer than all other steps
/// together.
const CONE_PROGRAM_FIRST: usize = 400;
/// Friction counts in full, normal forces are free, and glue is not bounded.
const UNBOUNDED: GlueOptions =
    GlueOptions { friction_factor: 1.0, normal_price: 0.0, strength: None, rounds: MOST_ROUNDS };
/// Called between iterations; `Break` cancels.
pub type Going<'a> = dyn FnMut() -> ControlFlow<()> + 'a;

/// Chooses the joints.
pub fn place(pile: &GlueProblem, options: &GlueOptions, going: &mut Going) -> Result<GluePlacement, GlueError> {
    place_again(pile, options, &[], going)
}

/// Chooses again, starting from joints at the same sites, after contacts have changed in places: faster than [`place`],
/// and most joints elsewhere stay.
pub fn place_again(
    pile: &GlueProblem,
    options: &GlueOptions,
    known: &[GlueJoint],
    going: &mut Going,
) -> Result<GluePlacement, GlueError> {
    let choice = choose(pile, options, known, going)?;
    certify(pile, options, known, &choice, going)
}

/// Joints that are chosen, but not balanced yet: their forces are near balance.
#[derive(Clone, Debug, Default)]
pub struct GlueChoice {
    /// By site, ascending.
    pub joints: Vec<GlueJoint>,
    /// The sites that each round glues, ascending; the last round first.
    rounds: Vec<Vec<usize>>,
    state: GlueForces,
    pub iterations: u64,
}

/// Chooses the joints of a pile whose glue has no bound, without a certificate: [`certify`] gives that, which takes
/// longer than the choice.
pub fn choose(
    pile: &GlueProblem,
    options: &GlueOptions,
    known: &[GlueJoint],
    going: &mut Going,
) -> Result<GlueChoice, GlueError> {
    let rounds = options.rounds.clamp(LEAST_ROUNDS, most_rounds(pile));
    let fallen = vec![false; pile.bodies.len()];
    let tight = GlueProgram::new(pile, &options.tight(), &fallen)?;
    let allowed = tight.allowed_sites();
    let mut admm = Admm::new(&tight, &allowed, false);
    let rounds = run_rounds(&mut admm, known, rounds, going)?;
    let chosen = rounds.first().map_or(&[][..], Vec::as_slice);
    Ok(GlueChoice {
        joints: chosen.iter().map(|&site| tight.joint(site, &admm.state)).collect(),
        iterations: admm.iterations,
        state: admm.state,
        rounds,
    })
}

/// Balances a choice, and proves it; joints are added where it does not balance. Where no glue of this strength holds
/// some bodies, they fall, and the joints of the others are chosen again, as are all where a choice in few rounds does
/// not balance.
pub fn certify(
    pile: &GlueProblem,
    options: &GlueOptions,
    known: &[GlueJoint],
    choice: &GlueChoice,
    going: &mut Going,
) -> Result<GluePlacement, GlueError> {
    let mut fallen = vec![false; pile.bodies.len()];
    let most_rounds = most_rounds(pile);
    let (mut iterations, mut rounds) = (choice.iterations, options.rounds.clamp(LEAST_ROUNDS, most_rounds));
    let mut choice = Some(choice);
    loop {
        let program = GlueProgram::new(pile, options, &fallen)?;
        let tight = GlueProgram::new(pile, &options.tight(), &fallen)?;
        let allowed = tight.allowed_sites();
        let mut admm = Admm::new(&tight, &allowed, false);
        let balanced = match choice.take() {
            Some(choice) => {
                admm.take(choice.state.clone());
                balance(&program, &mut admm, &choice.rounds, going)?
            }
            None => {
                let chosen = run_rounds(&mut admm, known, rounds, going)?;
                balance(&program, &mut admm, &chosen, going)?
            }
        };
        iterations += admm.iterations + balanced.iterations;
        if balanced.imbalance > BALANCED && rounds < most_rounds {
            rounds = most_rounds;
            continue;
        }
        if options.strength.is_some() && balanced.imbalance > BALANCED {
            let worst = certificate::worst(&program, &balanced.state);
            let fall = falls::fall(pile, &options.tight(), &mut fallen, worst, going)?;
            iterations += fall.iterations;
            if fall.any {
                continue;
            }
        }
        return Ok(GluePlacement {
            joints: balanced.sites.iter().map(|&site| program.joint(site, &balanced.state)).collect(),
            at_least: bound::at_least(pile, options, &fallen),
            fallen: (0..fallen.len()).filter(|&body| fallen[body]).collect(),
            forces: program.forces(&balanced.state),
            imbalance: balanced.imbalance,
            by_cone_program: balanced.by_cone_program,
            iterations,
        });
    }
}

fn most_rounds(pile: &GlueProblem) -> usize {
    if pile.bodies.len() <= LARGE { MOST_ROUNDS } else { LEAST_ROUNDS }
}

impl GlueOptions {
    fn tight(&self) -> GlueOptions {
        GlueOptions { friction_factor: self.friction_factor * TIGHT, ..*self }
    }
}

/// The sites that each round glues, ascending; the last round first.
fn run_rounds(
    admm: &mut Admm,
    known: &[GlueJoint],
    rounds: usize,
    going: &mut Going,
) -> Result<Vec<Vec<usize>>, GlueError> {
    let bodies = admm.program.target.len();
    let mut weights = GlueWeights::of(admm.program, 1.0);
    // In a small pile, neither balance nor a look shows whether the choice is settled.
    let is_small = bodies <= admm::SMALL;
    if !known.is_empty() {
        admm.take(admm.program.state(known));
    } else if is_small {
        admm.run(&weights, admm::FIRST, admm::NEAR, going)?;
    } else {
        admm.settle(&weights, admm::FIRST, NOTHING, going)?;
    }
    let left_out = if known.is_empty() { 0 } else { KNOWN.min(rounds - 1) };
    let mut chosen = Vec::new();
    for number in left_out..rounds {
        // Spread evenly over all of them.
        let e = ROUNDS[(number + 1) * (MOST_ROUNDS + 1) / (rounds + 1) - 1];
        weights.reweight(&admm.state.joints, e);
        weights.price(admm.program, e);
        // Costs have fallen by e; balance must not outweigh them.
        admm.set_penalty(e);
        if is_small {
            admm.run(&weights, admm::NEXT_SMALL, admm::NEAR, going)?;
        } else {
            admm.settle(&weights, admm::NEXT, NOTHING, going)?;
        }
        chosen.push(admm.joints(NOTHING));
    }
    chosen.reverse();
    Ok(chosen)
}

/// Balances the joints of the last round; where that fails, also with the joints that a repair finds; then also with
/// those of the earlier rounds.
fn balance(
    program: &GlueProgram,
    admm: &mut Admm,
    rounds: &[Vec<usize>],
    going: &mut Going,
) -> Result<Balanced, GlueError> {
    let tight = admm.program;
    let Some((last, earlier)) = rounds.split_first() else { return Err(GlueError::Options) };
    let mut best = certificate::balance(program, tight, admm.state.clone(), last, false, going)?;
    if best.imbalance <= BALANCED {
        return Ok(best);
    }
    let mut iterations = best.iterations;
    let mut sites: BTreeSet<usize> = last.iter().copied().collect();
    // Further joints at their full price; the chosen ones are free.
    let mut weights = GlueWeights::of(tight, REPAIR_SHARE);
    last.iter().for_each(|&site| weights.joints[site] = 0.0);
    admm.set_penalty(1.0);
    admm.run(&weights, admm::FIRST, admm::NEAR * REPAIR_SHARE, going)?;
    let repaired = admm.joints(NOTHING);
    for (number, more) in iter::once(&repaired).chain(earlier).enumerate() {
        sites.extend(more);
        let choice: Vec<usize> = sites.iter().copied().collect();
        // The cone program may balance the largest choice, and in a small pile the smallest.
        let by_cone_program = number == earlier.len() || number == 0 && program.target.len() <= CONE_PROGRAM_FIRST;
        let found = certificate::balance(program, tight, admm.state.clone(), &choice, by_cone_program, going)?;
        iterations += found.iterations;
        if found.imbalance < best.imbalance {
            best = found;
        }
        if best.imbalance <= BALANCED {
            break;
        }
    }
    Ok(Balanced { iterations, ..best })
}
