//! Where a pile must be glued to stand: the sparsest set of touches that may also pull.
//!
//! Friction carries a heap; it carries no overhang, no ball on a point and no arm. A *glue dot* on a touch transmits any force and
//! any moment. This chooses few dots such that every body of the pile is in equilibrium **with safety**: friction counts by a
//! factor only, and normal forces have a price, since an equilibrium that wedges exists on paper alone.
//!
//! # Formulation
//!
//! To the contact forces f_c of [`super::global`] comes, per touch t, the dot's wrench g_t = (force, moment / arm), at the middle
//! of the touch:
//!
//! ```text
//! minimise    sum_t w_t |g_t|  +  sum_c price_c fn_c         (a group lasso over touches)
//! such that   every body is balanced, |ft_c| <= factor mu fn_c
//! ```
//!
//! The first solve has w = 1; each of [`ROUNDS`] then reweights by w_t = e / (|g_t| + e), so that what is needed little is
//! not used at all (Candes, Wakin & Boyd 2008). The price falls by e too, or a dot would soon cost less than the normal force
//! that replaces it. What is below [`NOTHING`] in the end is no dot. To find the fewest dots is NP-hard: this finds few; [`Placement::at_least`] is a bound.
//!
//! A bound on what a dot carries is a bound on |g_t|. Where no balance is found within it, even with all dots that any round chose,
//! some bodies fall: those that miss most where every touch that may be is glued ([`falls`]). [`Placement::fallen`] names them, and the rest is balanced without them.
//!
//! # Method
//!
//! [`splitting`] solves the rounds: projection onto balance, projection onto the friction cones and shrinkage of the dots in turn
//! (ADMM; Boyd et al. 2011), the former by preconditioned conjugate gradients. It chooses long before it balances; so
//! [`certificate`] balances the chosen dots, to [`BALANCED`] by substitution, with the help of Clarabel where that fails.

mod bound;
mod certificate;
mod factor;
mod falls;
mod loads;
mod missing;
pub mod oracle;
mod program;
mod splitting;

use super::global::{BALANCED, GlobalBody, GlobalContact};
use certificate::Balanced;
use glam::DVec3;
pub use loads::Loads;
pub use missing::missing;
use program::Program;
use splitting::{Splitting, Weights};
use std::collections::BTreeSet;
use std::iter;
use std::ops::{ControlFlow, Range};

/// Two things that touch, and could be glued there.
#[derive(Clone, Debug, PartialEq)]
pub struct GlueTouch {
    /// Index of the body that the contacts' normals point into.
    pub body: usize,
    /// The other body; `None` for the ground and scenery.
    pub other: Option<usize>,
    /// Its contacts among the pile's; none where the two are near each other and do not touch.
    pub contacts: Range<usize>,
    /// Where a dot would be.
    pub center: DVec3,
    /// A moment counts as the force that causes it at this distance, > 0.
    pub arm: f64,
    /// Whether it may be glued.
    pub may: bool,
    /// Its normal forces cost at least so much, against a dot's force as 1; >= 0.
    pub normal_price: f64,
}

/// The pile. Any consistent unit system.
#[derive(Clone, Copy, Debug)]
pub struct GlueProblem<'a> {
    pub bodies: &'a [GlobalBody],
    /// In the order of the touches.
    pub contacts: &'a [GlobalContact],
    pub touches: &'a [GlueTouch],
    pub gravity: DVec3,
}

/// How much safety, and how strong the glue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlueOptions {
    /// Friction counts by this factor, 0 to 1.
    pub friction_factor: f64,
    /// Price of a normal force, against that of a dot's force as 1; a touch may have a higher one.
    pub normal_price: f64,
    /// The most that a dot may carry, as |(force, moment / arm)|; a force. `None`: no bound.
    pub strength: Option<f64>,
    /// Rounds of reweighting, [`LEAST_ROUNDS`] to [`MOST_ROUNDS`]: fewer find somewhat more dots, and are sooner done.
    pub rounds: usize,
}

/// A glued touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlueDot {
    /// Index among the touches.
    pub touch: usize,
    /// On the touch's body, at its center; the reverse on the other.
    pub force: DVec3,
    pub moment: DVec3,
}

/// What to glue.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Placement {
    /// By touch, rising.
    pub dots: Vec<GlueDot>,
    /// No choice has fewer dots than this; it may well be that none has so few.
    pub at_least: usize,
    /// Bodies that glue of this strength, where it may be, cannot hold, rising.
    pub fallen: Vec<usize>,
    /// Contact forces that balance the rest together with the dots. Shape `[contact]`.
    pub forces: Vec<DVec3>,
    /// What that leaves unbalanced, by substitution: sum over the bodies that stand, each by its own weight; for each thousand
    /// of them where there are more.
    pub imbalance: f64,
    /// Clarabel had to balance the chosen dots.
    pub by_cone_program: bool,
    /// Rounds of the splitting method.
    pub iterations: u64,
}

impl Placement {
    /// Whether every body that has not fallen is in equilibrium.
    pub fn stands(&self) -> bool {
        self.imbalance <= BALANCED
    }
}

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GlueError {
    #[error(transparent)]
    Problem(#[from] super::global::GlobalProblemError),
    #[error("touch {0}: its bodies, its contacts, its arm or its price mean nothing")]
    Touch(usize),
    #[error("friction factor, price or strength is negative or no number")]
    Options,
    #[error("cancelled")]
    Cancelled,
}

/// A round of reweighting for each; forces, in weights of the lighter body.
const ROUNDS: [f64; MOST_ROUNDS] = [0.3, 0.1, 0.05, 0.03, 0.02, 0.01, 0.005];
pub const MOST_ROUNDS: usize = 7;
/// Where so few find no balance, all are made.
pub const LEAST_ROUNDS: usize = 2;
/// Rounds at most for piles of more than so many bodies.
const ROUNDS_LARGE: usize = LEAST_ROUNDS;
const LARGE: usize = 4000;
/// The first solve, and all rounds but the last, only weigh the dots: they may end so many times as far from balance.
const FIRST_NEAR: f64 = 4.0;
const EARLY_NEAR: f64 = 2.0;
/// So many rounds are left out where dots are known.
const KNOWN: usize = 3;
/// A dot that carries less than this, in weights of the lighter body, is none.
const NOTHING: f64 = 1e-4;
/// Dots are chosen for a friction that is smaller still, by this factor: that leaves the certificate the room which it needs.
const TIGHT: f64 = 0.985;
/// Where a choice does not balance, what it takes besides is sought at this share of the price of normal forces, and to this share of
/// [`splitting::NEAR`].
const MENDING: f64 = 0.25;
/// In a pile of more bodies, some more dots are tried before the cone program, which takes longer than all the rest.
const CONE_PROGRAM_FIRST: usize = 400;
/// Told between iterations; `Break` cancels.
pub type Going<'a> = dyn FnMut() -> ControlFlow<()> + 'a;

/// Chooses the dots.
pub fn place(pile: &GlueProblem, options: &GlueOptions, going: &mut Going) -> Result<Placement, GlueError> {
    place_again(pile, options, &[], going)
}

/// Chooses again from dots of the same touches, after what carries has changed in places: sooner done, and most dots elsewhere stay.
pub fn place_again(
    pile: &GlueProblem,
    options: &GlueOptions,
    known: &[GlueDot],
    going: &mut Going,
) -> Result<Placement, GlueError> {
    let mut fallen = vec![false; pile.bodies.len()];
    let most_rounds = if pile.bodies.len() <= LARGE { MOST_ROUNDS } else { ROUNDS_LARGE };
    let (mut iterations, mut rounds) = (0, options.rounds.clamp(LEAST_ROUNDS, most_rounds));
    let tight_options = GlueOptions { friction_factor: options.friction_factor * TIGHT, ..*options };
    loop {
        let program = Program::new(pile, options, &fallen)?;
        let tight = Program::new(pile, &tight_options, &fallen)?;
        let may: Vec<bool> = tight.touches.iter().map(|touch| touch.may).collect();
        let mut splitting = Splitting::new(&tight, &may, false);
        let chosen = choose(&mut splitting, known, rounds, going)?;
        let balanced = balance(&program, &mut splitting, &chosen, going)?;
        iterations += splitting.iterations + balanced.iterations;
        if balanced.imbalance > BALANCED && rounds < most_rounds {
            rounds = most_rounds;
            continue;
        }
        if options.strength.is_some() && balanced.imbalance > BALANCED {
            let worst = certificate::worst(&program, &balanced.state);
            let fall = falls::fall(pile, &tight_options, &mut fallen, worst, going)?;
            iterations += fall.iterations;
            if fall.any {
                continue;
            }
        }
        return Ok(Placement {
            dots: balanced.touches.iter().map(|&touch| program.dot(touch, &balanced.state)).collect(),
            at_least: bound::at_least(pile, options, &fallen),
            fallen: (0..fallen.len()).filter(|&body| fallen[body]).collect(),
            forces: program.forces(&balanced.state),
            imbalance: balanced.imbalance,
            by_cone_program: balanced.by_cone_program,
            iterations,
        });
    }
}

/// The touches that each round glues, rising; the last round first.
fn choose(
    splitting: &mut Splitting,
    known: &[GlueDot],
    rounds: usize,
    going: &mut Going,
) -> Result<Vec<Vec<usize>>, GlueError> {
    let mut weights = Weights::of(splitting.program, 1.0);
    if known.is_empty() {
        splitting.run(&weights, splitting::FIRST, splitting::NEAR * FIRST_NEAR, going)?;
    } else {
        splitting.take(splitting.program.state(known));
    }
    let bodies = splitting.program.target.len();
    // In a small pile, balance says nothing of whether the choice is made.
    let next = if bodies <= splitting::SMALL { splitting::NEXT_SMALL } else { splitting::NEXT };
    let left_out = if known.is_empty() { 0 } else { KNOWN.min(rounds - 1) };
    let mut chosen = Vec::new();
    for number in left_out..rounds {
        // Spread evenly over all of them.
        let e = ROUNDS[(number + 1) * (MOST_ROUNDS + 1) / (rounds + 1) - 1];
        let near = splitting::NEAR * if number + 1 < rounds { EARLY_NEAR } else { 1.0 };
        weights.reweight(&splitting.state.dots, e);
        weights.price(splitting.program, e);
        // Costs have fallen by e, and balance must not outweigh them.
        splitting.set_penalty(e);
        splitting.run(&weights, next, near, going)?;
        chosen.push(splitting.dots(NOTHING));
    }
    chosen.reverse();
    Ok(chosen)
}

/// Balances the dots of the last round; where that fails, with what it takes besides; then with those of the rounds before, too.
fn balance(
    program: &Program,
    splitting: &mut Splitting,
    rounds: &[Vec<usize>],
    going: &mut Going,
) -> Result<Balanced, GlueError> {
    let tight = splitting.program;
    let Some((last, earlier)) = rounds.split_first() else { return Err(GlueError::Options) };
    let mut best = certificate::balance(program, tight, splitting.state.clone(), last, false, going)?;
    if best.imbalance <= BALANCED {
        return Ok(best);
    }
    let mut iterations = best.iterations;
    let mut touches: BTreeSet<usize> = last.iter().copied().collect();
    // More dots at their full price, and those that were chosen for nothing.
    let mut weights = Weights::of(tight, MENDING);
    last.iter().for_each(|&touch| weights.dots[touch] = 0.0);
    splitting.set_penalty(1.0);
    splitting.run(&weights, splitting::FIRST, splitting::NEAR * MENDING, going)?;
    let mended = splitting.dots(NOTHING);
    for (number, more) in iter::once(&mended).chain(earlier).enumerate() {
        touches.extend(more);
        let choice: Vec<usize> = touches.iter().copied().collect();
        // The cone program has its say on the largest choice, and in a small pile on the smallest.
        let has_say = number == earlier.len() || number == 0 && program.target.len() <= CONE_PROGRAM_FIRST;
        let found = certificate::balance(program, tight, splitting.state.clone(), &choice, has_say, going)?;
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
