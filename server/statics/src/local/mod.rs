//! Equilibrium of one body whose neighbours are held fixed (*local* equilibrium): contacts in, a verdict with its proof
//! out.
//!
//! # The question
//!
//! A body of mass m and centre of mass c touches its surroundings at points p_i with unit normals n_i that point
//! *into* it. It is in local equilibrium (Hsu & Keyser 2012, section 3.2) if contact forces f_i exist with
//!
//! ```text
//! sum f_i               = -m g        forces       (Eq. 1)
//! sum (p_i - c) x f_i   = 0           torques      (Eq. 1; the paper prints f x r, the same equation)
//! |f_i - (f_i.n_i) n_i| <= mu_i f_i.n_i            (Eq. 2 and 4; see *Friction laws*)
//! f_i.n_i               >= 0          compression  (Eq. 3)
//! ```
//!
//! Divided by mg (forces) and mgR (torques; R the body's bounding radius) the problem has no unit left. With
//! r_i = (p_i - c)/R, the wrench of a force f at contact i is a = (f, r_i x f), a point of R^6; the wrench wanted is
//! b = (-g/|g|, 0), of length one. All wrenches that the contacts can exert form a convex cone
//! W = { sum (f_i, r_i x f_i) : f_i in friction cone i }, so that the question is: **is b in W?**
//!
//! # The answer is a distance
//!
//! The projection of b onto W (its closure: a wedge on the verge of jamming needs infinite forces, which no arithmetic
//! can distinguish from very large ones) always exists and is unique. Let y = b - proj(b). By Moreau's decomposition
//!
//! ```text
//! y . a <= 0 for every wrench a in W,      y . b = |y|^2.
//! ```
//!
//! - |y| = 0: the projection's forces balance the body. They are the proof of [`Verdict::Stable`].
//! - |y| > 0: z = y/|y| is the proof of [`Verdict::Unstable`] (Farkas): as a virtual velocity it does positive work
//!   with the weight's counter-wrench (z . b > 0) while no contact can do positive work with it. Read as a motion, z is
//!   how the body starts to fall. |y| is the *residual*: no contact forces come nearer to equilibrium than that.
//!
//! Both proofs are checked by substitution into the equations above before a verdict leaves this module, by code that
//! knows the friction laws and nothing of the solvers (`scaled.rs`). "Undecided" does not exist: the module's answer is
//! a number, the distance, and the verdict compares it with [`STABLE_RESIDUAL`].
//!
//! # Friction laws
//!
//! [`FrictionLaw::Cone`] is Coulomb's law. [`FrictionLaw::Pyramid`] replaces the circle |f_t| <= mu f_n by a regular
//! polygon; the paper's |f_t1|, |f_t2| <= mu f_n is the circumscribed square ([`FrictionLaw::PAPER`]), which overstates
//! friction along its diagonals by sqrt 2. The first tangent t1 completes n in the manner of Duff et al. (2017): it
//! depends on n alone.
//!
//! # The solvers
//!
//! | | pyramid | cone |
//! | --- | --- | --- |
//! | [`Solver::Fast`] | projection onto W, listed generators (`projection.rs`) | the same, generators by formula |
//! | [`Solver::Clarabel`] | linear program (`interior_point.rs`) | second-order cone program |
//!
//! What the fast solver cannot certify, Clarabel decides; what Clarabel leaves open, the fast solver decides; what both
//! leave open returns with the fast solver's projection, and is counted as [`VerdictCounters::uncertified`]: in a
//! million generated problems that has not happened once.
//!
//! # What this does not see
//!
//! The local analysis holds a body's neighbours fixed and therefore says nothing about them: every block of an
//! overhanging stack, and every stone of an arch too thin to stand, may be locally stable while the whole falls. Only
//! [`crate::global`] sees that.
//!
//! [`margin`]: how far a stable body is from the edge. [`candidate`]: which bodies may be held (section 3.3). [`rank`]:
//! how degenerate a contact set is. An answer does not depend on what the [`Analyser`] was used for before.

mod analyser;
pub mod candidate;
mod interior_point;
pub mod margin;
mod projection;
pub mod rank;
mod scaled;

pub use analyser::{Analyser, VerdictCounters};
pub use candidate::{Candidacy, CandidateRules, ReserveRule, SpreadRule};
pub use scaled::MAX_SIDES;

use glam::DVec3;

/// A body whose forces miss equilibrium by at most this (forces by mg, torques by mgR) is stable; beyond it, unstable.
///
/// Ten times below the nearest boundary that a caller may ask about (a centre of mass 1e-9 R outside its support), and
/// five orders above the rounding of forces of the size of mg.
pub const STABLE_RESIDUAL: f64 = 1e-10;

/// [`STABLE_RESIDUAL`] grows by this much per mg of normal force: forces of F mg are themselves rounded to 1e-16 F, and
/// a wedge that needs 1e6 mg to hold cannot show a smaller residual. The same forces balance exactly if the contact
/// points move by about this share of the radius. The solver's offers of work below it are rounding, too.
pub const FORCE_ROUNDING: f64 = 1e-15;

/// The most by which a proof may violate what it shows; exact arithmetic would give zero. For every contact, no force
/// of unit normal component does more work with a certificate z of instability. The forces of a stable verdict exceed
/// the friction law by no larger share, and show no larger tension, in mg. A normal force of no more than that loads
/// no contact: Eq. 5 has nothing to test there. Clarabel works to this tolerance.
pub const PROOF_TOLERANCE: f64 = 1e-9;

/// A certificate of instability must also exclude all forces whose normal components sum to less than this many mg.
/// Near the boundary this is stricter than [`PROOF_TOLERANCE`]: the violation v of a certificate with residual r
/// leaves open only forces above r/v.
pub const EXCLUDED_FORCE: f64 = 1e4;

/// Bound on the iterations of a solver, far more than any problem has needed: beyond, the next solver decides.
pub(crate) const MOST_ITERATIONS: u32 = 400;

/// Wrenches nearer than this (forces by mg, torques by mgR) to the span of the others add nothing to it:
/// single-precision contacts on a line are no straighter.
pub const INDEPENDENT: f64 = 1e-6;

/// One contact of the analysed body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalContact {
    /// Position, in the same frame and unit as the centre of mass.
    pub point: DVec3,
    /// Unit normal pointing into the analysed body: a positive normal force pushes the body along it. Normalised
    /// again here, so that single precision does no harm.
    pub normal: DVec3,
    /// Coulomb's coefficient, >= 0.
    pub friction: f64,
}

/// One body and its contacts. Any consistent unit system.
#[derive(Clone, Copy, Debug)]
pub struct LocalProblem<'a> {
    pub contacts: &'a [LocalContact],
    /// > 0.
    pub mass: f64,
    pub center_of_mass: DVec3,
    /// Bounding radius of the body about its centre of mass, > 0: the length that makes torques comparable to forces.
    pub radius: f64,
    /// Acceleration of gravity. Zero is allowed: then nothing has to be balanced.
    pub gravity: DVec3,
}

/// The forces that friction allows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrictionLaw {
    /// Coulomb's cone, exactly.
    #[default]
    Cone,
    /// A regular polygon instead of the circle; `sides` from 3 to [`MAX_SIDES`].
    Pyramid { sides: u32, fit: Fit },
}

impl FrictionLaw {
    /// Eq. 2 and 4: |f_t1|, |f_t2| <= mu f_n.
    pub const PAPER: FrictionLaw = FrictionLaw::Pyramid { sides: 4, fit: Fit::Circumscribed };
}

/// Position of a pyramid's polygon relative to the circle of Coulomb's law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fit {
    /// Its corners lie on the circle: friction is understated, by up to cos(pi/sides).
    Inscribed,
    /// Its sides touch the circle (the paper's, and the default): friction is overstated, by up to 1/cos(pi/sides).
    #[default]
    Circumscribed,
}

/// The solver that runs first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solver {
    #[default]
    Fast,
    /// The interior-point solver. Its forces are near the center of the feasible set, to about 1e-8.
    Clarabel,
}

/// Options of an analysis. Default: Coulomb's cone, the fast solver, no margin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    pub friction_law: FrictionLaw,
    pub solver: Solver,
    /// Also compute the margin of a stable body. Costs four to eight verdicts.
    pub margin: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options { friction_law: FrictionLaw::Cone, solver: Solver::Fast, margin: false }
    }
}

/// A force and a torque about the centre of mass; forces by mg, torques by mgR.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench {
    pub force: DVec3,
    pub torque: DVec3,
}

/// The answer, with its proof.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict<'a> {
    /// Forces exist.
    Stable {
        /// One force per contact, acting on the body, in units of mg. Where many distributions balance the body, this
        /// is one of them, with at most six contacts loaded ([`Solver::Fast`]).
        forces: &'a [DVec3],
        /// Norm of the wrench that the forces leave unbalanced, by substitution: at most [`STABLE_RESIDUAL`]
        /// and [`FORCE_ROUNDING`] ([`REFERENCE_RESIDUAL`] if Clarabel found the forces).
        residual: f64,
        /// See [`margin`]; `None` where not asked for.
        margin: Option<f64>,
    },
    /// No forces exist.
    Unstable {
        /// Unit wrench z: z . b > 0, and z . a <= 0 for every wrench a that the contacts can exert. As a twist
        /// (velocity of the centre of mass, angular velocity times R) it is minus the motion in which the body falls.
        certificate: Wrench,
        /// z . b: how far, in mg and mgR, the best forces stay from equilibrium.
        residual: f64,
    },
}

impl Verdict<'_> {
    pub fn is_stable(&self) -> bool {
        matches!(self, Verdict::Stable { .. })
    }
}

/// As [`STABLE_RESIDUAL`], for forces that Clarabel found: the accuracy of an interior-point solver.
pub const REFERENCE_RESIDUAL: f64 = 1e-7;

/// As [`EXCLUDED_FORCE`], for certificates that Clarabel found: also where the fast solver left a body open.
pub const REFERENCE_EXCLUDED_FORCE: f64 = 1e2;

/// Input that has no physical meaning. Contacts are named by their index.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ProblemError {
    #[error("mass {0} is not a positive number")]
    Mass(f64),
    #[error("radius {0} is not a positive number")]
    Radius(f64),
    #[error("centre of mass is not finite")]
    CenterOfMass,
    #[error("gravity is not finite")]
    Gravity,
    #[error("contact {0}: point is not finite, or beyond 1e150 radii")]
    Point(usize),
    #[error("contact {0}: normal is zero or not finite")]
    Normal(usize),
    #[error("contact {index}: friction {friction} is negative or not finite")]
    Friction { index: usize, friction: f64 },
    #[error("a pyramid of {0} sides (3 to {MAX_SIDES} are possible)")]
    Sides(u32),
}
