//! Counts of the control, and the problems that it poses.

use cairn_engine::world::BodyId;
use cairn_statics::local::{LocalContact, LocalProblem};
use glam::DVec3;

/// Counts of the control so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControlCounters {
    pub cycles: u64,
    /// Local analyses.
    pub analyses: u64,
    /// Verdicts kept because nothing that they depend on had changed.
    pub verdicts_kept: u64,
    pub stable: u64,
    pub unstable: u64,
    /// Verdicts that left the solver without a proof within its tolerances: there must be none.
    pub undecided: u64,
    pub candidates: u64,
    /// Bodies that were held without a verdict, because they had stood for a while.
    pub held_at_rest: u64,
    pub nails_driven: u64,
    pub nails_broken: u64,
    pub nails_peak: u64,
    /// Held bodies freed within a cycle because the load on them exceeded kappa.
    pub holds_broken: u64,
    /// Bodies that slid without friction for a cycle, because they were jammed above a gap.
    pub unjammed: u64,
    pub held_peak: u64,
    /// Held bodies freed because something was about to hit them, or others in contact with them.
    pub shaken: u64,
    /// Steps in which the loads on held or nailed bodies were checked.
    pub break_checks: u64,
    /// Steps in which coming hits were looked for.
    pub impact_looks: u64,
    /// Tests of whether a body is inside the region.
    pub region_tests: u64,
    /// Largest force of a nail that held, in weights of the lighter body.
    pub nail_load_max: f64,
}

/// One body's local equilibrium, as the control poses it; engine units, mass and gravity 1.
#[derive(Clone, Debug)]
pub struct BodyProblem {
    pub body: BodyId,
    pub contacts: Vec<LocalContact>,
    pub center_of_mass: DVec3,
    pub radius: f64,
    /// Of the body's smallest face.
    pub face_area: f64,
}

impl BodyProblem {
    pub fn problem(&self) -> LocalProblem<'_> {
        let BodyProblem { contacts, center_of_mass, radius, .. } = self;
        LocalProblem { contacts, mass: 1.0, center_of_mass: *center_of_mass, radius: *radius, gravity: DVec3::NEG_Y }
    }
}
