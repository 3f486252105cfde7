//! The chain of solvers, and the substitution that every verdict must pass.

use super::projection::{Projection, StopRule};
use super::scaled::{ScaledProblem, SolverOutcome, Tolerances, join, norm, subtract};
use super::{LocalProblem, Options, ProblemError, STABLE_RESIDUAL, Solver, Verdict, interior_point, margin};
use glam::DVec3;

/// Number of decisions by each part, since the analyser was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VerdictCounters {
    pub stable: u64,
    pub unstable: u64,
    /// Steps of the fast solver, over all solves.
    pub fast_steps: u64,
    /// The fast solver's answer did not pass substitution.
    pub fast_open: u64,
    /// Clarabel gave no decision, or one that did not pass substitution.
    pub clarabel_open: u64,
    /// Both were open: verdicts that left with a proof weaker than the named tolerances.
    pub uncertified: u64,
}

/// The solver's workspace. One per thread; after it has seen the largest contact count, the fast solver allocates
/// nothing.
#[derive(Debug, Default)]
pub struct Analyser {
    pub(super) scaled: ScaledProblem,
    projection: Projection,
    pub(super) forces: Vec<DVec3>,
    pub(super) points: Vec<DVec3>,
    counters: VerdictCounters,
}

/// Start of the fast solver.
#[derive(Clone, Copy, Debug)]
pub(super) enum Start<'a> {
    Cold,
    /// From remembered forces, by mg.
    Forces(&'a [DVec3]),
    /// From its last answer, for the same contacts.
    Loaded,
}

impl Analyser {
    pub fn new() -> Self {
        Self::default()
    }

    /// Is the body in local equilibrium (Eq. 1 to 4)?
    pub fn analyse(&mut self, problem: &LocalProblem, options: &Options) -> Result<Verdict<'_>, ProblemError> {
        self.scaled.set(problem, options.friction_law)?;
        let outcome = self.decide(options.solver, Start::Cold);
        Ok(self.verdict(outcome, options))
    }

    /// As [`Analyser::analyse`], starting from the forces of an earlier verdict: `last[i]` (by mg) belongs to contact
    /// i, zero for a contact that is new. The verdict does not depend on them; near the answer they save time.
    pub fn analyse_from(
        &mut self,
        problem: &LocalProblem,
        options: &Options,
        last: &[DVec3],
    ) -> Result<Verdict<'_>, ProblemError> {
        self.scaled.set(problem, options.friction_law)?;
        let outcome = self.decide(options.solver, Start::Forces(last));
        Ok(self.verdict(outcome, options))
    }

    /// The largest horizontal push at the centre of mass, in mg and at most `most`, that the body survives in each of
    /// these directions (unit vectors across gravity), to a share of [`margin::SLACK`] from below; `None` where it does
    /// not stand.
    pub fn pushes(
        &mut self,
        problem: &LocalProblem,
        ways: &[DVec3],
        most: f64,
    ) -> Result<Option<Vec<f64>>, ProblemError> {
        self.scaled.set(problem, Default::default())?;
        let outcome = self.decide(Solver::Fast, Start::Cold);
        self.count(&outcome);
        Ok(match outcome {
            SolverOutcome::Stable { .. } => Some(margin::pushes(&self.scaled, &mut self.projection, ways, most)),
            SolverOutcome::Unstable(_) => None,
        })
    }

    /// What contact forces within their friction leave of a force and a torque about the center of mass that they are
    /// to give, as a share of it; a torque counts as the force that causes it at the radius. The gravity of the problem
    /// does not count. 0 for no force at all.
    pub fn missing(&mut self, problem: &LocalProblem, force: DVec3, torque: DVec3) -> Result<f64, ProblemError> {
        self.scaled.set(problem, Default::default())?;
        let wanted = join(force, torque / problem.radius);
        let length = norm(&wanted);
        if !(length > 0.0 && length.is_finite()) {
            return Ok(0.0);
        }
        let target = wanted.map(|value| value / length);
        self.counters.fast_steps += u64::from(self.projection.run(&self.scaled, target));
        self.projection.forces(self.scaled.len(), &mut self.forces);
        let mut left = target;
        for (contact, force) in self.scaled.contacts().iter().zip(&self.forces) {
            subtract(&mut left, 1.0, &contact.wrench(*force));
        }
        Ok(norm(&left).min(1.0))
    }

    fn verdict(&mut self, outcome: SolverOutcome, options: &Options) -> Verdict<'_> {
        self.count(&outcome);
        match outcome {
            SolverOutcome::Stable { residual } => {
                let margin = options.margin.then(|| {
                    if options.solver == Solver::Clarabel {
                        self.projection.run(&self.scaled, self.scaled.target());
                    }
                    margin::of(&self.scaled, &mut self.projection)
                });
                Verdict::Stable { forces: &self.forces, residual, margin }
            }
            SolverOutcome::Unstable(c) => Verdict::Unstable { certificate: c.wrench(), residual: c.residual },
        }
    }

    pub fn counters(&self) -> VerdictCounters {
        self.counters
    }

    pub(super) fn count(&mut self, outcome: &SolverOutcome) {
        match outcome {
            SolverOutcome::Stable { .. } => self.counters.stable += 1,
            SolverOutcome::Unstable(_) => self.counters.unstable += 1,
        }
    }

    /// The chain of solvers: the one asked for, the other one, the projection as it is.
    pub(super) fn decide(&mut self, solver: Solver, start: Start) -> SolverOutcome {
        let first = match solver {
            Solver::Fast => self.fast(start).or_else(|| self.clarabel(Tolerances::FALLBACK)),
            Solver::Clarabel => self.clarabel(Tolerances::REFERENCE).or_else(|| self.fast(start)),
        };
        first.unwrap_or_else(|| self.last_resort())
    }

    fn fast(&mut self, start: Start) -> Option<SolverOutcome> {
        let target = self.scaled.target();
        let steps = match start {
            Start::Cold => self.projection.run(&self.scaled, target),
            Start::Forces(last) => self.projection.run_from(&self.scaled, target, last),
            Start::Loaded => self.projection.resume(&self.scaled, target, StopRule::default()),
        };
        self.counters.fast_steps += u64::from(steps);
        let outcome = self.certify_projection();
        if outcome.is_none() {
            self.counters.fast_open += 1;
        }
        outcome
    }

    /// Substitutes the projection's answer: its forces if it is near enough, else its certificate.
    fn certify_projection(&mut self) -> Option<SolverOutcome> {
        self.projection.forces(self.scaled.len(), &mut self.forces);
        let residual = self.scaled.residual_of(&self.forces);
        if self.scaled.balances(residual, &self.forces, Tolerances::OWN)
            && self.scaled.obeys_friction(&self.forces, Tolerances::OWN)
        {
            return Some(SolverOutcome::Stable { residual });
        }
        let certificate = self.scaled.certificate(self.projection.separator()?);
        certificate.proves(Tolerances::OWN).then_some(SolverOutcome::Unstable(certificate))
    }

    fn clarabel(&mut self, tolerances: Tolerances) -> Option<SolverOutcome> {
        let outcome = interior_point::solve(&self.scaled, tolerances, &mut self.forces);
        if outcome.is_none() {
            self.counters.clarabel_open += 1;
        }
        outcome
    }

    fn last_resort(&mut self) -> SolverOutcome {
        self.counters.uncertified += 1;
        self.projection.forces(self.scaled.len(), &mut self.forces);
        let residual = self.scaled.residual_of(&self.forces);
        match self.projection.separator() {
            Some(y) if residual > STABLE_RESIDUAL => SolverOutcome::Unstable(self.scaled.certificate(y)),
            _ => SolverOutcome::Stable { residual },
        }
    }
}
