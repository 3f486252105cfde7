//! The fast solver beside Clarabel on the contacts of a real bake: every control cycle of `sticks.toml`'s pile.
//!
//!     cargo study verdicts

mod piles;

use cairn_input::observer::{Silent, Stage};
use cairn_motion::control::BodyProblem;
use cairn_statics::local::{
    Analyser, Candidacy, CandidateRules, FrictionLaw, Options, ReserveRule, Solver, SpreadRule,
};
use std::path::Path;
use std::time::Instant;

/// Relative change of friction within which a verdict may turn: Clarabel decides no finer.
const BAND: f64 = 1e-5;

fn main() -> anyhow::Result<()> {
    let sticks = Path::new(env!("CAIRN_REPOSITORY")).join("examples/sticks.toml");
    let full = piles::Full::of(&sticks, &[])?;
    let params = &full.job.params;
    let mut sim = full.turn_over()?;

    // A bake's own release, interrupted before every cycle.
    let mut tally = Tally::default();
    let mut last = Vec::new();
    for id in sim.pile.world.present().collect::<Vec<_>>() {
        sim.pile.release(id);
    }
    for _ in 0..CYCLES * params.control.period {
        if sim.pile.control.is_due(sim.pile.step) {
            last = sim.pile.control.local_problems(&sim.pile.world);
            tally.cycles += 1;
            last.iter().for_each(|p| tally.compare(p, params.control.kinetic_ratio));
        }
        sim.advance(&mut Silent, Stage::Hold, |_| 0.0)?;
    }
    println!("{} bodies, {} cycles, {} problems", sim.pile.instances.len(), tally.cycles, tally.problems);
    println!(
        "candidates {}, differing {} of which outside the band {}",
        tally.candidates, tally.differing, tally.outside
    );
    println!(
        "fast {:.1} us per body, Clarabel {:.0} us per body",
        tally.fast * 1e6 / tally.problems as f64,
        tally.reference * 1e6 / tally.problems as f64
    );
    let local = time(|| {
        let mut analyser = Analyser::new();
        let stands =
            |p: &BodyProblem| analyser.analyse(&p.problem(), &options(Solver::Fast)).is_ok_and(|v| v.is_stable());
        std::hint::black_box(last.iter().map(stands).filter(|&s| s).count());
    });
    let global = time(|| drop(piles::whole(&sim.pile.world)));
    println!(
        "whole pile: local {:.2} ms, global {:.0} ms, {:.0} times as long",
        local * 1e3,
        global * 1e3,
        global / local
    );
    Ok(())
}

/// Cycles compared: as many as a bake of this pile needs, from the moment that all bodies are released.
const CYCLES: u32 = 60;

#[derive(Default)]
struct Tally {
    cycles: u64,
    problems: u64,
    candidates: u64,
    differing: u64,
    outside: u64,
    /// Seconds.
    fast: f64,
    reference: f64,
    analysers: [Analyser; 2],
}

impl Tally {
    fn compare(&mut self, p: &BodyProblem, kinetic_ratio: f64) {
        let (mut fast, mut reference) = (false, false);
        self.fast += time(|| fast = candidate(&mut self.analysers[0], p, Solver::Fast, kinetic_ratio));
        self.reference += time(|| reference = candidate(&mut self.analysers[1], p, Solver::Clarabel, kinetic_ratio));
        self.problems += 1;
        self.candidates += u64::from(fast);
        if fast != reference {
            self.differing += 1;
            let near = |factor: f64| candidate(&mut Analyser::new(), p, Solver::Fast, kinetic_ratio * factor);
            self.outside += u64::from(near(1.0 - BAND) == near(1.0 + BAND));
        }
    }
}

fn options(solver: Solver) -> Options {
    Options { friction_law: FrictionLaw::Cone, solver, margin: false }
}

fn candidate(analyser: &mut Analyser, p: &BodyProblem, solver: Solver, kinetic_ratio: f64) -> bool {
    let spread = SpreadRule::Relative { share: 0.05, area: p.face_area };
    let rules = CandidateRules { reserve: ReserveRule::Sharp, kinetic_ratio, spread, contacts: 3 };
    analyser.candidate(&p.problem(), &options(solver), &rules) == Ok(Candidacy::Candidate)
}

fn time(work: impl FnOnce()) -> f64 {
    let begin = Instant::now();
    work();
    begin.elapsed().as_secs_f64()
}
