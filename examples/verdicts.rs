//! The fast solver beside Clarabel on the contacts of a real bake: every control cycle of `sticks.toml`'s pile.
//!
//!     cargo run --release --example verdicts

use cairn_core::container::Container;
use cairn_core::control::{Control, LocalProblem};
use cairn_core::equilibrium::{
    Analyser, Candidacy, CandidateRules, FrictionLaw, FrictionReserve, Options, Solver, Spread, global,
};
use cairn_core::observer::{Observer, Progress, Silent, Stage};
use cairn_core::params::{Accuracy, Params};
use cairn_core::scene::{Model, Prop, Scene};
use cairn_core::world::{Side, Units, World};
use cairn_core::{check, fill, release, shape};
use std::ops::ControlFlow;
use std::time::Instant;

/// Relative change of friction within which a verdict may turn: Clarabel decides no finer.
const BAND: f64 = 1e-5;

fn main() -> anyhow::Result<()> {
    let scene = scene()?;
    let params = Params::new(Accuracy::Standard);
    let checked = check::run(&scene, &params).map_err(cairn_core::Error::Invalid)?;
    let shapes = shape::run(&scene, &params, &checked, &mut Silent)?;
    let units = Units::new(checked.diameter, shapes[0].mass, params.gravity);
    let control = checked.control.as_ref().expect("the scene has a control mesh");
    let container = Container::new(&control.mesh, &control.topology, units.length, checked.ground);
    let full = fill::run(&scene, &shapes, &params, units, &container, &mut Silent)?;
    let control = Control::new(&params.control, params.gravity, params.seed, Some(&container.distance));
    let mut pile = release::turn_over(&scene, &shapes, &params, units, &full.bodies, checked.ground, control)?;

    // A bake's own release, interrupted before every cycle.
    let mut tally = Tally::default();
    let mut last = Vec::new();
    for id in pile.world.present().collect::<Vec<_>>() {
        pile.control.release(id);
        pile.world.set_role(id, cairn_core::world::Role::Free);
    }
    for _ in 0..CYCLES * params.control.period {
        if pile.control.is_due(pile.step) {
            last = pile.control.local_problems(&pile.world);
            tally.cycles += 1;
            last.iter().for_each(|p| tally.compare(p, params.control.kinetic_ratio));
        }
        pile.advance(&mut Ignore, Stage::Hold, |_| 0.0)?;
    }
    println!("{} bodies, {} cycles, {} problems", full.bodies.len(), tally.cycles, tally.problems);
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
            |p: &LocalProblem| analyser.analyse(&p.problem(), &options(Solver::Fast)).is_ok_and(|v| v.is_stable());
        std::hint::black_box(last.iter().map(stands).filter(|&s| s).count());
    });
    let global = time(|| drop(whole(&pile.world)));
    println!(
        "whole pile: local {:.2} ms, global {:.0} ms, {:.0} times as long",
        local * 1e3,
        global * 1e3,
        global / local
    );
    Ok(())
}

/// Cycles compared: as many as a bake of this pile needs, from the moment that all bodies are let go.
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
    fn compare(&mut self, p: &LocalProblem, kinetic_ratio: f64) {
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

fn candidate(analyser: &mut Analyser, p: &LocalProblem, solver: Solver, kinetic_ratio: f64) -> bool {
    let spread = Spread::Relative { share: 0.05, area: p.face_area };
    let rules = CandidateRules { reserve: FrictionReserve::Sharp, kinetic_ratio, spread, contacts: 3 };
    analyser.candidate(&p.problem(), &options(solver), &rules) == Ok(Candidacy::Candidate)
}

/// The global program over all contacts.
fn whole(world: &World) -> Option<global::Report> {
    let bodies: Vec<global::Body> = world
        .present()
        .map(|id| {
            let b = &world.bodies()[id];
            global::Body { mass: b.mass, center_of_mass: world.pose(id).translation, radius: b.radius }
        })
        .collect();
    let other = |side: Side| match side {
        Side::Body(b) => Some(b),
        Side::Ground | Side::Scenery | Side::Moving => None,
    };
    let touches = world.touches(0.05);
    let contacts: Vec<global::Contact> = touches
        .iter()
        .flat_map(|t| t.points.iter().map(move |p| (t, p)))
        .map(|(t, p)| global::Contact {
            body: t.a,
            other: other(t.b),
            point: p.point,
            normal: p.normal,
            friction: t.friction,
        })
        .collect();
    let pile = global::Pile { bodies: &bodies, contacts: &contacts, gravity: glam::DVec3::NEG_Y };
    global::analyse(&pile, global::Objective::SumOfNorms { sharpen: 0 }).ok()
}

fn time(work: impl FnOnce()) -> f64 {
    let begin = Instant::now();
    work();
    begin.elapsed().as_secs_f64()
}

fn scene() -> anyhow::Result<Scene> {
    let stick = model("stick")?;
    let prop = Prop {
        model: stick,
        weight: 1.0,
        friction: 0.7,
        density: 500.0,
        restitution: 0.0,
        scale: [1.0; 2],
        tilt_max: 180.0,
    };
    Ok(Scene { control: Some(model("cone")?), props: vec![prop], ..Scene::default() })
}

fn model(name: &str) -> anyhow::Result<Model> {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets").join(name).with_extension("glb");
    let bytes = std::fs::read(&path)?;
    let source = cairn_core::asset::Source {
        name,
        bytes: &bytes,
        node: None,
        resolve: &|uri| Err(format!("{uri}: the examples have no external files")),
        limits: Default::default(),
    };
    let asset = cairn_core::asset::read(&source).map_err(|problems| anyhow::anyhow!("{problems:?}"))?;
    Ok(Model { name: name.into(), mesh: asset.mesh })
}

struct Ignore;

impl Observer for Ignore {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        0.0
    }
}
