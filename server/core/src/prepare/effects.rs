//! What a bake may leave out: every effect, whether the scene calls for it, and the user's word on it.
//!
//! An effect that is off costs nothing: its [`Effect::counters`] in the report are 0.

use crate::input::params::{ControlMode, FillMethod, FrictionCone, FrictionModel, Params, ReleaseOrder, Switch};
use crate::input::scene::Scene;
use crate::prepare::check::Checked;
use crate::prepare::container;
use crate::prepare::extremes;
use crate::prepare::shape::Outline;
use crate::report::Name;
use std::collections::BTreeMap;

/// Something that costs time and may be left out.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Effect {
    pub name: Name,
    pub on: bool,
    /// One sentence.
    pub reason: String,
    /// The field of the scene that forces it, and the value that switches it off; `None`: nothing does.
    pub switch: Option<Name>,
    /// The counts of the report that tell what it did: all 0 where it is off.
    pub counters: Vec<Name>,
}

/// What an effect did in a bake, and what it cost.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Charge {
    pub name: Name,
    pub on: bool,
    /// CPU seconds; `None` where it is part of the engine's steps or of another stage.
    pub seconds: Option<f64>,
    /// Of the bake's CPU seconds.
    pub share: Option<f64>,
    /// Its counters.
    pub counts: BTreeMap<Name, u64>,
}

/// The bill of a bake: each effect with its counts, and the CPU seconds that are its own.
pub fn bill(
    effects: &[Effect],
    counts: &BTreeMap<Name, u64>,
    seconds: &BTreeMap<&'static str, f64>,
    total: f64,
) -> Vec<Charge> {
    let charge = |effect: &Effect| {
        let own = seconds.get(&*effect.name).copied().filter(|_| effect.on);
        let count = |name: &Name| Some((name.clone(), *counts.get(name)?));
        Charge {
            name: effect.name.clone(),
            on: effect.on,
            seconds: own,
            share: own.filter(|_| total > 0.0).map(|own| own / total),
            counts: effect.counters.iter().filter_map(count).collect(),
        }
    };
    effects.iter().map(charge).collect()
}

/// All effects of a checked scene, in the order of the stages. `outlines`: what the props are simulated as.
pub fn of(scene: &Scene, params: &Params, checked: &Checked, outlines: &[Outline]) -> Vec<Effect> {
    [
        shapes(scene, params, outlines),
        stages(scene, params, checked),
        physics(scene, params, checked),
        control(scene, params),
    ]
    .concat()
    .into_iter()
    .chain(output(params))
    .collect()
}

/// An effect that the scene's own contents decide on.
fn plain(name: &'static str, on: bool, reason: impl Into<String>, counters: &'static [&'static str]) -> Effect {
    let counters = counters.iter().map(|&name| name.into()).collect();
    Effect { name: name.into(), on, reason: reason.into(), switch: None, counters }
}

/// An effect with a parameter of its own.
fn set_by(field: &'static str, effect: Effect) -> Effect {
    Effect { switch: Some(field.into()), ..effect }
}

/// An effect that the user's word decides on, and else the scene; with the reason why the scene does or does not.
fn switched(
    (name, field): (&'static str, &'static str),
    switch: Switch,
    (called_for, reason): (bool, String),
    counters: &'static [&'static str],
) -> Effect {
    let reason = match switch {
        Switch::Auto => reason,
        Switch::On => format!("switched on by {field}"),
        Switch::Off => format!("switched off by {field}"),
    };
    set_by(field, plain(name, switch.is_on(called_for), reason, counters))
}

/// "a, b and 3 more".
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 3;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    match names.len().checked_sub(SHOWN) {
        None | Some(0) => shown,
        Some(more) => format!("{shown} and {more} more"),
    }
}

/// What the props are simulated as.
fn shapes(scene: &Scene, params: &Params, outlines: &[Outline]) -> Vec<Effect> {
    let switches = &params.physics.switches;
    let names = |is: fn(&Outline) -> bool| -> Vec<&str> {
        let props = scene.props.iter().zip(outlines).filter(|(_, outline)| is(outline));
        props.map(|(prop, _)| &*prop.model.name).collect()
    };
    let primitives = names(|outline| matches!(outline, Outline::Box | Outline::Ball));
    let split = names(|outline| matches!(outline, Outline::Parts));
    let boxes = match primitives.as_slice() {
        [] => "no prop is a box or a ball".into(),
        names => format!("box or ball: {}", listed(names)),
    };
    let parts = match split.as_slice() {
        [] => "one convex shape is near enough to each prop".into(),
        names => format!("nonconvex: {}; at most {} parts each", listed(names), params.physics.max_parts),
    };
    vec![
        switched(
            ("primitives", "effects.primitives"),
            switches.primitives,
            (!primitives.is_empty(), boxes),
            &["props_as_primitives"],
        ),
        switched(
            ("decomposition", "effects.decomposition"),
            switches.decomposition,
            (!split.is_empty(), parts),
            &["props_split"],
        ),
    ]
}

/// What happens, from the fill on.
fn stages(scene: &Scene, params: &Params, checked: &Checked) -> Vec<Effect> {
    let fill = scene.is_filled(params);
    let filling = match params.fill.method {
        _ if scene.control.is_none() => "there is no control mesh",
        FillMethod::Insert => "props grow at free places inside the closed container",
        FillMethod::Pour => "props are dropped through the container's opening",
        FillMethod::Off => "switched off by the scene",
    };
    let closed = checked.control.as_ref().filter(|_| fill);
    let fine = closed.is_some_and(|closed| container::has_fine_walls(&closed.topology, checked.diameter));
    let tolerance = params.fill.wall_tolerance;
    let walls = match fine {
        _ if !fill => "there is no fill".into(),
        false => "the control mesh is not finer than the props need".into(),
        true if tolerance == 0.0 => "fill.wall_tolerance is 0".into(),
        true => format!("the container's walls may be finer than the props need: within {tolerance} d of it"),
    };
    let turning = if fill { "the container is filled upside down" } else { "there is no fill" };
    let releasing = match params.release.order {
        ReleaseOrder::BottomUp => "layers are let go from the bottom to the top",
        ReleaseOrder::TopDown => "layers are let go from the top to the bottom",
        ReleaseOrder::AtOnce => "everything is let go at frame 0",
    };
    let moving = scene.statics.iter().filter(|m| !m.keys.is_empty()).count();
    let scenery = match scene.statics.len() {
        0 => "there is no geometry besides the ground".into(),
        n => format!("geometry besides the ground: {n}, of which {moving} moving"),
    };
    let placed = match scene.bodies.len() {
        0 => "no body is placed by hand".into(),
        n => format!("placed by hand: {n}"),
    };
    let emission = match scene.emitters.len() {
        0 => "there is no emitter".into(),
        n => format!("where bodies appear: {n}"),
    };
    vec![
        set_by("fill.method", plain("fill", fill, filling, &["fill_steps"])),
        set_by(
            "fill.wall_tolerance",
            plain("wall_simplification", fine && tolerance > 0.0, walls, &["wall_triangles_saved"]),
        ),
        plain("turn_over", fill, turning, &["fill_steps"]),
        set_by(
            "release.order",
            plain("staged_release", params.release.order != ReleaseOrder::AtOnce, releasing, &["release_layers"]),
        ),
        plain("scenery", !scene.statics.is_empty(), scenery, &["scenery_pieces"]),
        plain("bodies", !scene.bodies.is_empty(), placed, &["bodies_placed"]),
        plain("emitters", !scene.emitters.is_empty(), emission, &["bodies_emitted"]),
    ]
}

/// What the engine does besides contacts between rigid bodies.
fn physics(scene: &Scene, params: &Params, checked: &Checked) -> Vec<Effect> {
    let switches = &params.physics.switches;
    let prop_names = |is: &dyn Fn(usize) -> bool| -> Vec<&str> {
        let props = scene.props.iter().enumerate().filter(|(i, _)| is(*i));
        props.map(|(_, prop)| &*prop.model.name).collect()
    };
    let round = prop_names(&|i| checked.sizes[i].round.is_some());
    let resistance = params.physics.rolling_resistance;
    let rolling = match round.as_slice() {
        [] => "no prop is round".into(),
        _ if resistance == 0.0 => "physics.rolling_resistance is 0".into(),
        names => format!("round: {}; rolling resistance {resistance}", listed(names)),
    };
    let bouncing = prop_names(&|i| scene.props[i].restitution > 0.0);
    let bounce = if bouncing.is_empty() { "no prop bounces".into() } else { format!("bounces: {}", listed(&bouncing)) };
    let mass = |i: usize| checked.sizes[i].volume * scene.props[i].density;
    let ratio = extremes::mass_ratio(scene, params, mass);
    let stiffened =
        extremes::stiffened(&params.physics, ratio, f64::INFINITY, (checked.diameter / params.gravity).sqrt());
    let is_stiff = stiffened != params.physics;
    let stiff = match is_stiff {
        true => format!(
            "the masses of the pile differ by {ratio:.0}:1: contact frequency {:.0}, {} substeps",
            stiffened.contact_frequency, stiffened.substeps
        ),
        false if ratio < 1.5 => "the bodies of the pile have about the same mass".into(),
        false => format!("the masses of the pile differ by {ratio:.0}:1, which the contacts carry as they are"),
    };
    let (coulomb, law) = match params.physics.friction_model {
        FrictionModel::Simplified => (false, "one friction force per contact patch is enough at this accuracy"),
        FrictionModel::Coulomb => (true, "one friction force per contact point"),
    };
    let swept = "whatever moves by more than half of its thickness in a step is swept along its way, while it does; of several parts, its \
                 contacts are found a step ahead";
    vec![
        switched(
            ("continuous_collision", "effects.continuous_collision"),
            switches.continuous_collision,
            (true, swept.into()),
            &["speculative_body_steps", "ccd_body_steps"],
        ),
        set_by("physics.friction_model", plain("friction_per_point", coulomb, law, &["steps_with_friction_per_point"])),
        switched(
            ("restitution", "effects.restitution"),
            switches.restitution,
            (!bouncing.is_empty(), bounce),
            &["bouncing_bodies"],
        ),
        switched(
            ("rolling_resistance", "effects.rolling_resistance"),
            switches.rolling_resistance,
            (!round.is_empty() && resistance > 0.0, rolling),
            &["rolling_body_steps"],
        ),
        switched(
            ("stiff_contacts", "effects.stiff_contacts"),
            switches.stiff_contacts,
            (is_stiff, stiff),
            &["steps_with_stiff_contacts"],
        ),
        switched(
            ("guard", "effects.guard"),
            params.guard,
            (true, "every step is watched, which costs less than one in a hundred".into()),
            &["guard_steps", "guard_retries", "guard_stiffened"],
        ),
        plain("same_on_all_machines", true, "the engine's arithmetic is the same on every processor", &[]),
    ]
}

/// What keeps the shape.
fn control(scene: &Scene, params: &Params) -> Vec<Effect> {
    let (control, switches) = (&params.control, &params.control.switches);
    let on = control.mode != ControlMode::Off;
    let only = |called_for: bool, reason: &str| match on {
        true => (called_for, reason.to_owned()),
        false => (false, "nothing is controlled".to_owned()),
    };
    // What nothing is controlled for stays off, whatever it is forced to.
    let word = |switch: Switch| if on { switch } else { Switch::Auto };
    let holding = match control.mode {
        ControlMode::Off => "switched off by the scene",
        ControlMode::Nails => "certified pairs are nailed together until the next verdict",
        ControlMode::Hold => "certified bodies are held until the next verdict",
    };
    let nailing = if control.mode == ControlMode::Hold { "bodies are held, not nailed" } else { holding };
    let cone = match control.friction_cone {
        FrictionCone::Pyramid => "four-sided friction pyramid, as in the paper",
        FrictionCone::Cone => "exact friction cone",
    };
    let analysis = only(on, cone);
    let holds = control.mode == ControlMode::Hold;
    let hits = scene.something_hits();
    let hit = match (holds, hits) {
        (false, _) => "nothing is held",
        (true, true) => "something flies, falls or moves, or kept bodies are let go",
        (true, false) => "nothing flies in, falls or moves",
    };
    let inside = scene.region.is_some() || scene.control.is_some();
    let where_to =
        if inside { "bodies outside are never controlled" } else { "no region, no test: the control acts everywhere" };
    let breaking = only(on, &format!("what carries more than kappa = {} N s per kg lets go", control.kappa));
    let kept = if holds { "a verdict holds until something that it rests on changes" } else { "nothing is held" };
    let stand = on && control.stand;
    vec![
        set_by("control.mode", plain("control", on, holding, &["control_cycles"])),
        set_by("control.friction_cone", plain("analysis", analysis.0, analysis.1, &["analyses"])),
        switched(
            ("kept_verdicts", "effects.kept_verdicts"),
            if holds { switches.kept_verdicts } else { Switch::Auto },
            only(holds, kept),
            &["verdicts_kept"],
        ),
        switched(
            ("region", "effects.region"),
            if inside { word(switches.region) } else { Switch::Auto },
            only(inside, where_to),
            &["region_tests"],
        ),
        set_by("control.mode", plain("nails", control.mode == ControlMode::Nails, nailing, &["nails_driven"])),
        switched(
            ("breaking", "effects.breaking"),
            word(switches.breaking),
            breaking,
            &["break_checks", "nails_broken", "holds_broken"],
        ),
        switched(
            ("impact", "effects.impact"),
            if holds { switches.impact } else { Switch::Auto },
            only(holds && hits, hit),
            &["impact_looks", "shaken"],
        ),
        set_by(
            "control.stand",
            plain(
                "stand",
                stand,
                if stand { "the control ends gently" } else { "only on request: the control would end gently" },
                &["stand_steps"],
            ),
        ),
    ]
}

/// What is made of the bake.
fn output(params: &Params) -> [Effect; 3] {
    let request = |on: bool| match on {
        true => "asked for: a further simulation",
        false => "only on request: it is a further simulation",
    };
    [
        switched(
            ("frames", "effects.frames"),
            params.output.keeps_frames,
            (true, format!("{} per second; without them, the result is the final pose", params.output.fps)),
            &["frames"],
        ),
        set_by(
            "output.free_standing",
            plain(
                "free_standing",
                params.output.free_standing,
                request(params.output.free_standing),
                &["free_standing_steps"],
            ),
        ),
        set_by("output.free_pour", plain("free_pour", params.output.free_pour, request(params.output.free_pour), &[])),
    ]
}
