//! How often "locally stable" is right: the verdicts of each friction law against a simulation and against the global
//! program, at moments of real bakes.
//!
//!     cargo study precision -- examples/sticks.toml examples/books.toml --set fill.count=150
//!
//! The truth of a body: everything else is fixed, and the body alone is released for 1 s; it is stable if it moves by
//! less than a hundredth of d. `precision`: share of the bodies called stable that are. `recall`: share of the stable
//! ones that are called so. `candidates`: the same precision of those that the control would hold. `global`: share of
//! the bodies called stable that the best distribution of forces over the whole pile balances to a tenth of their
//! weight.

mod piles;

use cairn_core::Error;
use cairn_core::release;
use cairn_engine::world::{Resistance, Role, World};
use cairn_input::observer::{Observer, Progress, Silent};
use cairn_input::params::{self, Params};
use cairn_motion::control::BodyProblem;
use cairn_motion::hold;
use cairn_motion::step::Simulation;
use cairn_statics::local::{
    Analyser, Candidacy, CandidateRules, Fit, FrictionLaw, Options, ReserveRule, Solver, SpreadRule,
};
use clap::Parser;
use std::ops::ControlFlow;
use std::path::PathBuf;

/// Precision and recall of the local verdicts, at moments of bakes.
#[derive(Parser)]
struct Args {
    /// Scene files
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Set a field of each scene, as `cairn bake --set` does
    #[arg(long)]
    set: Vec<String>,
    /// Seeds 1 to this
    #[arg(long, default_value_t = 3)]
    seeds: u64,
}

/// Shares of the release at which the pile is looked at; 1 stands for the end of the hold, too.
const MOMENTS: [f64; 3] = [0.35, 0.7, 1.0];
/// In units of d, and s.
const TRUTH: (f64, f64) = (0.01, 1.0);
/// In weights.
const BALANCED: f64 = 0.1;

const LAWS: [(&str, FrictionLaw); 6] = [
    ("cone", FrictionLaw::Cone),
    ("pyramid of 4 (paper)", FrictionLaw::PAPER),
    ("pyramid of 8", FrictionLaw::Pyramid { sides: 8, fit: Fit::Circumscribed }),
    ("pyramid of 16", FrictionLaw::Pyramid { sides: 16, fit: Fit::Circumscribed }),
    ("pyramid of 8, inside the cone", FrictionLaw::Pyramid { sides: 8, fit: Fit::Inscribed }),
    ("pyramid of 16, inside the cone", FrictionLaw::Pyramid { sides: 16, fit: Fit::Inscribed }),
];

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    println!("| scene | friction law | bodies judged | stable in truth | precision | recall | candidates | global |");
    println!("|{}", " --- |".repeat(8));
    for path in &args.scenes {
        let mut tallies = [Tally::default(); LAWS.len()];
        for seed in 1..=args.seeds {
            let set: Vec<String> = args.set.iter().cloned().chain([format!("seed={seed}")]).collect();
            let full = piles::Full::of(path, &set)?;
            for moment in MOMENTS {
                let mut sim = full.turn_over()?;
                advance(&mut sim, &full.job.params, moment)?;
                judge(sim, &full.job.params, &mut tallies);
            }
        }
        let scene = path.file_stem().unwrap_or_default().to_string_lossy();
        for ((law, _), tally) in LAWS.iter().zip(&tallies) {
            println!("| {scene} | {law} | {} |", tally.cells());
        }
    }
    Ok(())
}

/// Bakes up to this share of the release, or to the end of the hold.
fn advance(sim: &mut Simulation, params: &Params, moment: f64) -> anyhow::Result<()> {
    match release::run(sim, params, params.release.order, false, &|_| 0.0, &mut Until(moment)) {
        Ok(()) => hold::run(sim, params, false, &mut Silent).map(|_| ()).map_err(Into::into),
        Err(Error::Cancelled) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// Cancels at this share of the release.
struct Until(f64);

impl Observer for Until {
    fn progress(&mut self, now: &Progress) -> ControlFlow<()> {
        if now.fraction >= self.0 && self.0 < 1.0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn cpu_seconds(&mut self) -> f64 {
        0.0
    }
}

/// Bodies, counted.
#[derive(Clone, Copy, Default)]
struct Tally {
    judged: u32,
    stable: u32,
    called: u32,
    rightly: u32,
    candidates: u32,
    rightly_candidates: u32,
    balanced: u32,
}

impl Tally {
    fn cells(&self) -> String {
        let share = |a: u32, b: u32| if b == 0 { "-".into() } else { format!("{:.3}", f64::from(a) / f64::from(b)) };
        [
            self.judged.to_string(),
            share(self.stable, self.judged),
            share(self.rightly, self.called),
            share(self.rightly, self.stable),
            share(self.rightly_candidates, self.candidates),
            share(self.balanced, self.called),
        ]
        .join(" | ")
    }
}

/// Judges every released body by every law, and by letting it go alone.
fn judge(mut sim: Simulation, params: &Params, tallies: &mut [Tally; LAWS.len()]) {
    let pile = &mut sim.pile;
    let problems = pile.control.local_problems(&pile.world);
    let present: Vec<usize> = pile.world.present().collect();
    let imbalance = piles::whole(&pile.world).map(|report| report.imbalance);
    for &id in &present {
        if pile.world.bodies()[id].role == Role::Free {
            pile.world.set_role(id, Role::Frozen);
        }
    }
    let mut analyser = Analyser::new();
    for problem in &problems {
        let truth = stands_alone(&mut pile.world, problem.body);
        let at = present.binary_search(&problem.body).expect("a body with contacts is present");
        let balanced = imbalance.as_ref().is_some_and(|all| all[at] <= BALANCED);
        for (tally, (_, law)) in tallies.iter_mut().zip(LAWS) {
            let candidacy = verdict(&mut analyser, problem, law, params, pile.world.units.length);
            let (called, candidate) = (candidacy.is_stable(), candidacy == Candidacy::Candidate);
            tally.judged += 1;
            tally.stable += u32::from(truth);
            tally.called += u32::from(called);
            tally.rightly += u32::from(called && truth);
            tally.candidates += u32::from(candidate);
            tally.rightly_candidates += u32::from(candidate && truth);
            tally.balanced += u32::from(called && balanced);
        }
    }
}

/// Lets one body go while all others are fixed, and puts it back.
fn stands_alone(world: &mut World, id: usize) -> bool {
    let (before, role) = (world.pose(id), world.bodies()[id].role);
    world.set_role(id, Role::Free);
    world.set_resistance(id, Resistance::default());
    world.set_slippery(id, false);
    let steps = (TRUTH.1 / world.units.time / world.step_length()).ceil() as u64;
    let mut stands = true;
    for _ in 0..steps {
        world.step();
        stands = world.is_present(id) && world.pose(id).translation.distance(before.translation) < TRUTH.0;
        if !stands {
            break;
        }
    }
    world.set_role(id, role);
    world.put(id, &before);
    stands
}

fn verdict(analyser: &mut Analyser, p: &BodyProblem, law: FrictionLaw, params: &Params, length: f64) -> Candidacy {
    let control = &params.control;
    let spread = match control.spread {
        params::Spread::Area(alpha) => SpreadRule::Paper(alpha / (length * length)),
        params::Spread::Relative(share) => SpreadRule::Relative { share, area: p.face_area },
    };
    let reserve = ReserveRule::Sharp;
    let rules = CandidateRules { reserve, kinetic_ratio: control.kinetic_ratio, spread, contacts: 3 };
    let options = Options { friction_law: law, solver: Solver::Fast, margin: false };
    analyser.candidate(&p.problem(), &options, &rules).expect("contacts of a checked world")
}
