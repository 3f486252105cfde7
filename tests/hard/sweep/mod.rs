//! The stability sweep: random scenes, and what must hold in each of them.
#![allow(dead_code, reason = "the tests and the example use different parts")]

pub mod file;
pub mod recipe;

use cairn_core::report::bake::Bake;
use cairn_core::{Error, bake};
use cairn_engine::shape;
use cairn_input::observer::Silent;
use cairn_prepare::check;
use glam::DVec3;
use recipe::Recipe;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What a scene came to.
pub enum Verdict {
    Sound(Box<Bake>),
    /// Refused before anything ran, with the reason.
    Refused(String),
}

/// No pair may be deeper in each other at the end than the larger of these: shares of the thinner one's thickness, and
/// of d (the sag of contacts does not shrink with a sheet's thickness).
const MOST_PENETRATION: f64 = 0.5;
const MOST_DEPTH: f64 = 0.05;
/// Potential energy may grow by so much of m g d summed over the bodies: what rolls over an edge lifts its middle.
const MOST_GAIN: f64 = 0.05;
/// Heavy and light, by their masses' ratio.
const SQUEEZING: f64 = 100.0;
/// A fill leaves overlaps of up to this share of a thickness, which push bodies up.
const FILL_OVERLAP: f64 = 0.25;

/// Bakes a recipe; an error is a violated invariant.
pub fn run(recipe: &Recipe) -> Result<Verdict, String> {
    let (scene, params) = recipe.scene();
    cairn_engine::invariants::check_always();
    let baked = catch_unwind(AssertUnwindSafe(|| bake(&scene, &params, &mut Silent)));
    let baked = baked.map_err(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        format!("panic: {}", text.unwrap_or("?"))
    })?;
    match baked {
        Ok(bake) => {
            judge(recipe, &bake)?;
            Ok(Verdict::Sound(Box::new(bake)))
        }
        Err(Error::Invalid(problems)) if problems.iter().all(|p| is_refusal(&p.text)) => {
            Ok(Verdict::Refused(problems.iter().map(ToString::to_string).collect()))
        }
        Err(error) => Err(format!("error: {error}")),
    }
}

/// Props that do not fit into the control mesh, or no body left, since all were too deep in each other.
fn is_refusal(text: &str) -> bool {
    text.contains("larger than the control mesh")
        || text.contains("found room")
        || text.contains("find room")
        || text.contains("the scene has none; give a closed mesh")
}

fn judge(recipe: &Recipe, bake: &Bake) -> Result<(), String> {
    let (scene, params) = recipe.scene();
    let checked = check::run(&scene, &params).map_err(|e| format!("{e:?}"))?;
    let shapes = shape::run(&scene, &params, &checked.sizes, &mut Silent).map_err(|e| e.to_string())?;
    let (d, g) = (checked.diameter, params.gravity);
    let must = |holds: bool, violation: String| if holds { Ok(()) } else { Err(violation) };
    let finite = |p: &cairn_geometry::pose::Pose| p.translation.is_finite() && p.rotation.is_finite();
    must(bake.pile.frames.iter().flatten().all(finite), "a pose is not finite".into())?;

    let count = |name: &str| bake.report.counts[name];
    must(count("bodies_lost") == 0, format!("{} bodies set aside: {:?}", count("bodies_lost"), bake.report.warnings))?;
    let verdicts = count("verdicts_stable") + count("verdicts_unstable");
    must(count("verdicts_undecided") == 0 && verdicts == count("analyses"), "a verdict is undecided".into())?;

    // From here on by centres of mass.
    let center = |frame: &[cairn_geometry::pose::Pose], k: usize| -> DVec3 {
        let body = bake.pile.bodies[k];
        shapes[body.prop].body_pose(&frame[k], body.scale).translation
    };
    let bodies = bake.pile.bodies.len();
    let mass = |k: usize| {
        scene
            .bodies
            .get(k)
            .and_then(|body| body.mass)
            .unwrap_or_else(|| shapes[bake.pile.bodies[k].prop].mass * bake.pile.bodies[k].scale.powi(3))
    };
    let first = &bake.pile.frames[0];
    let last = &bake.pile.frames[bake.pile.frames.len() - 1];
    let highest = (0..bodies).map(|k| center(first, k).y - checked.ground).fold(0.0, f64::max) + d;
    let masses: Vec<f64> = (0..bodies).map(mass).collect();
    let (light, heavy) = masses.iter().fold((f64::INFINITY, 0.0f64), |(lo, hi), &m| (lo.min(m), hi.max(m)));
    // A light body is squeezed out from under a heavy one like a pip, faster than by any fall.
    let limit = if heavy > SQUEEZING * light { 4.0 } else { 2.0 } * (2.0 * g * highest).sqrt();
    let all: f64 = (0..bodies).map(mass).sum();
    // By heights: what is pushed out of another body moves without momentum, so that frames do not give the kinetic
    // energy. It is bounded by the speeds; the guard in the bake weighs all of it.
    let energy = |frame: &[cairn_geometry::pose::Pose]| {
        (0..bodies).map(|k| mass(k) * g * (center(frame, k).y - checked.ground)).sum::<f64>()
    };
    let start = energy(first);
    let pushed = match scene.control {
        Some(_) => (0..bodies).map(|k| FILL_OVERLAP * mass(k) * shapes[bake.pile.bodies[k].prop].thickness()).sum(),
        None => recipe::overlap_moment(&scene, &params),
    };
    let allowed = g * (MOST_GAIN * all * d + pushed);
    for pair in bake.pile.frames.windows(2) {
        let speed =
            (0..bodies).map(|k| center(&pair[0], k).distance(center(&pair[1], k)) * bake.pile.fps).fold(0.0, f64::max);
        must(speed <= limit, format!("a body moves at {speed:.3} m/s, more than {limit:.3}"))?;
        let gained = energy(&pair[1]) - start;
        must(gained <= allowed, format!("energy grew by {gained:.3e} J of {allowed:.3e} allowed"))?;
    }
    for k in 0..bodies {
        let (at, thickness) =
            (center(last, k), shapes[bake.pile.bodies[k].prop].thickness() * bake.pile.bodies[k].scale);
        must(at.y > checked.ground - thickness.max(0.02 * d), format!("body {k} is at {at}, below the ground"))?;
        let seconds = bake.pile.frames.len() as f64 / bake.pile.fps;
        must((at - center(first, k)).length() < limit * seconds, format!("body {k} escaped to {at}"))?;
    }
    let floating = bake.report.measures["ballistic_error_max"].unwrap_or(0.0);
    must(floating <= 0.01, format!("what touches nothing falls at {floating:.3} g beside g"))?;
    let fell = bake.report.measures["second_collapse"].unwrap_or(0.0);
    must(fell == 0.0, format!("bodies that stood for a second and fell untouched: {fell}"))?;
    let deepest = bake.report.measures["penetration_max_rel"].unwrap_or(0.0);
    let thinnest = shapes.iter().map(|s| s.thickness()).fold(f64::INFINITY, f64::min) / d;
    let limit = MOST_PENETRATION.max(MOST_DEPTH / thinnest);
    must(deepest <= limit, format!("two bodies are {deepest:.2} thicknesses deep in each other"))
}
