//! The report of a bake: its figures by the names of measures.md, its counts, and what a person should know.

use crate::equilibrium::global;
use crate::error::Error;
use crate::geometry::contact::{self, Contact};
use crate::geometry::mesh::TriMesh;
use crate::geometry::pose::Pose;
use crate::geometry::region::Region;
use crate::input::observer::{Observer, Progress, Stage, observe};
use crate::input::params::ControlMode;
use crate::input::params::{FillMethod, Params};
use crate::input::scene::{Given, Scene};
use crate::measure::{self, Gauge, Overlap, ShapeMeasures};
use crate::prepare::container::Container;
use crate::prepare::plan::Plan;
use crate::prepare::shape::{Outline, Shape};
use crate::report::bake::Body;
use crate::report::{Name, Report};
use crate::sim::guard;
use crate::stages::fill::{Filled, Removed};
use crate::stages::free_pour;
use crate::stages::free_standing;
use crate::stages::hold::Held;
use crate::stages::release::Pile;
use crate::world::{BodyId, Role, Side, Touch, TouchPoint, Work, World};
use std::collections::BTreeMap;

/// CPU seconds by stage.
pub struct Clock {
    last: f64,
    seconds: BTreeMap<Stage, f64>,
}

impl Clock {
    pub fn new(observer: &mut dyn Observer) -> Clock {
        Clock { last: observer.cpu_seconds(), seconds: BTreeMap::new() }
    }

    /// The time since the last call belongs to this stage.
    pub fn lap(&mut self, stage: Stage, observer: &mut dyn Observer) {
        let now = observer.cpu_seconds();
        *self.seconds.entry(stage).or_default() += now - self.last;
        self.last = now;
    }

    pub fn into_seconds(self) -> BTreeMap<Stage, f64> {
        self.seconds
    }
}

/// What a report is made of.
pub struct Inputs<'a> {
    pub scene: &'a Scene,
    pub params: &'a Params,
    pub plan: Plan,
    pub shapes: &'a [Shape],
    /// The shape that the pile is to have, welded and facing outward.
    pub target: Option<&'a TriMesh>,
    pub filled: Option<&'a (Container, Filled)>,
    pub held: Held,
    pub bodies: &'a [Body],
    /// Height, m.
    pub ground: f64,
}

/// The bodies that some frame has, and the frames in SI, from the props' own frames. Shape `[frame][body]`.
pub fn prop_frames(pile: &Pile) -> (Vec<Body>, Vec<Vec<Pose>>) {
    let count = pile.recorder.frames.last().map_or(0, Vec::len);
    let all = pile.bodies.iter().zip(&pile.first_frames).take(count);
    let bodies: Vec<Body> = all.map(|(b, &first_frame)| Body { prop: b.prop, scale: b.scale, first_frame }).collect();
    let mut frames: Vec<Vec<Pose>> =
        (0..pile.recorder.frames.len()).map(|number| pile.prop_frame(number).collect()).collect();
    // Before it appears, a body has the pose that it will have then.
    for number in (1..frames.len()).rev() {
        let (before, after) = frames.split_at_mut(number);
        let known = before[number - 1].len();
        before[number - 1].extend_from_slice(&after[0][known..]);
    }
    (bodies, frames)
}

/// Measures the pile.
pub fn report(
    inputs: &Inputs,
    pile: &mut Pile,
    frames: &[Vec<Pose>],
    observer: &mut dyn Observer,
) -> Result<Report, Error> {
    let Inputs { scene, params, shapes, filled, held, .. } = *inputs;
    let bodies = inputs.bodies.len();
    let progress =
        |fraction| Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0 };
    observe(observer, &progress(0.0))?;
    let mut warnings = inputs.plan.warnings.clone();
    warnings.extend(filled.map_or(Vec::new(), |(container, filled)| container_warnings(inputs, container, filled)));
    warnings.append(&mut pile.notes);
    let mut measures = Figures::new();
    if let Some(target) = inputs.target {
        let (figures, first) = shape_figures(inputs, target, pile, frames, observer)?;
        measures.extend(figures);
        if let Some((_, filled)) = filled {
            warnings.extend(fill_warnings(inputs, filled, &first));
        }
        warnings.extend(first.caveats());
    }
    if let Some((_, filled)) = filled {
        measures.insert("pocket_fraction", Some(filled.pockets));
        measures.insert("wall_deviation_rel", Some(filled.wall_deviation));
    }
    observe(observer, &progress(0.8))?;
    measures.extend(contact_figures(&pile.world));
    measures.extend(motion_figures(inputs, pile, frames));
    measures.extend(control_figures(pile));
    if params.output.free_standing {
        let begin = observer.cpu_seconds();
        measures.extend(free_standing::measure(pile, observer)?);
        pile.standing_seconds = observer.cpu_seconds() - begin;
    }
    if params.output.free_pour {
        measures.insert("free_pour_fraction", free_pour::of_props(&scene.props, shapes, params, observer)?);
    }
    warnings.extend(end_warnings(pile, held, &measures));
    let error_sources = error_sources(inputs, &pile.world, &measures);
    let limited_by = error_sources.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(&name, _)| name.into());
    Ok(Report {
        seed: params.seed,
        bodies,
        plan: inputs.plan.clone(),
        params: params.clone(),
        measures: named(measures),
        error_sources: named(error_sources),
        limited_by,
        counts: named(counts(scene, filled.map(|(_, filled)| filled), pile)),
        shapes: shapes.iter().map(|s| s.report.clone()).collect(),
        seconds: BTreeMap::new(),
        bill: Vec::new(),
        warnings,
    })
}

fn named<T>(values: BTreeMap<&'static str, T>) -> BTreeMap<Name, T> {
    values.into_iter().map(|(name, value)| (name.into(), value)).collect()
}

/// Lengths by which a pile may differ from the true one, in d, by the parameter that lessens each: how far the collision
/// shapes are from the meshes, how far contacts sink in, the gap across which bodies may be held, and how far a body falls
/// within a step.
fn error_sources(inputs: &Inputs, world: &World, measures: &Figures) -> BTreeMap<&'static str, f64> {
    let mut thickness: Vec<f64> = world.present().map(|id| world.bodies()[id].thickness).collect();
    thickness.sort_by(f64::total_cmp);
    let thickness = thickness.get(thickness.len() / 2).copied().unwrap_or(0.0);
    let used = inputs.shapes.iter().enumerate().filter(|(i, _)| inputs.bodies.iter().any(|b| b.prop == *i));
    let deviation = used.map(|(_, shape)| shape.report.deviation_rel).fold(0.0, f64::max);
    let sunk = measures.get("penetration_mean_rel").copied().flatten().unwrap_or(0.0);
    let control = &inputs.params.control;
    let gap = if control.mode == ControlMode::Off { 0.0 } else { control.contact_tolerance };
    BTreeMap::from([
        ("physics.shape_tolerance", deviation),
        ("physics.contact_frequency", sunk * thickness),
        ("physics.step", world.step_length().powi(2) / 2.0),
        ("control.contact_tolerance", gap * thickness),
    ])
}

type Figures = BTreeMap<&'static str, Option<f64>>;

/// The bodies that a frame has, as the measures take them.
fn placed(bodies: &[Body], frame: &[Pose], number: usize) -> Vec<(usize, f64, Pose)> {
    let there = bodies.iter().zip(frame).filter(|(b, _)| b.first_frame <= number);
    there.map(|(b, &pose)| (b.prop, b.scale, pose)).collect()
}

/// Figures of the end of the hold under their names; those right after turning over with `_start` behind; where
/// something disturbed the hold, those of the last frame with `_after` behind. Also the measures that caveats are taken of.
fn shape_figures(
    inputs: &Inputs,
    target: &TriMesh,
    pile: &Pile,
    frames: &[Vec<Pose>],
    observer: &mut dyn Observer,
) -> Result<(Figures, ShapeMeasures), Error> {
    let bodies = inputs.bodies.len();
    let progress =
        |fraction| Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0 };
    let region = Region::new(target);
    let props: Vec<TriMesh> = inputs.scene.props.iter().map(|p| p.model.mesh.clone()).collect();
    let last = frames.len() - 1;
    let hold_end = pile.disturbed_frame.unwrap_or(last).min(last);
    let [start, held, after] = [0, hold_end, last].map(|number| placed(inputs.bodies, &frames[number], number));
    let pile_of = |bodies| measure::Pile { props: &props, bodies };
    // The pile is what it is made of at the beginning: a ball thrown into it has no part in its shape.
    let made_of: std::collections::BTreeSet<usize> =
        if start.is_empty() { &after } else { &start }.iter().map(|b| b.0).collect();
    let only =
        |bodies: Vec<(usize, f64, Pose)>| -> Vec<_> { bodies.into_iter().filter(|b| made_of.contains(&b.0)).collect() };
    let (held, after) = (only(held), only(after));
    let gauge = Gauge::new(target, &region, &pile_of(if start.is_empty() { &after } else { &start }));
    let first = (!start.is_empty()).then(|| gauge.measure(&pile_of(&start)));
    observe(observer, &progress(0.4))?;
    let mut figures = Figures::new();
    let at_end = (!held.is_empty()).then(|| gauge.measure(&pile_of(&held)));
    if let Some(at_end) = &at_end {
        figures.extend(at_end.figures().into_iter().map(|(name, value)| (name, Some(value))));
    }
    if let Some(first) = &first {
        figures.insert("shape_iou_start", Some(first.shape_iou.value));
        figures.insert("height_p95_rel_start", Some(first.height_p95_rel));
        figures.insert("silhouette_iou_start", Some(first.silhouette_iou));
        // Defined right after turning over, and after the fill.
        figures.insert("protrusion_rel", Some(first.protrusion_rel));
        figures.insert("fill_fraction", Some(first.fill_fraction));
        figures.insert("kept_shape", at_end.as_ref().and_then(|end| measure::kept_shape(first, end)));
    }
    let mut caveats_of = first.or(at_end);
    if hold_end < last || caveats_of.is_none() {
        let after = gauge.measure(&pile_of(&after));
        figures.insert("shape_iou_after", Some(after.shape_iou.value));
        figures.insert("height_p95_rel_after", Some(after.height_p95_rel));
        figures.insert("silhouette_iou_after", Some(after.silhouette_iou));
        caveats_of.get_or_insert(after);
    }
    Ok((figures, caveats_of.expect("some frame has bodies")))
}

/// Gap up to which contacts carry in `unsupported_fraction`, as a share of the thinner prop's thickness (measures.md).
pub const REAL_CONTACT: f64 = 0.05;

fn contact_figures(world: &World) -> Figures {
    // `hanging` counts contacts up to d/200, which may be more than the thickness tolerance of thin props.
    let thinnest = world.present().map(|id| world.bodies()[id].thickness).fold(f64::INFINITY, f64::min);
    let touches = world.touches(REAL_CONTACT.max(contact::CARRYING_GAP / thinnest));
    let contacts: Vec<Contact> = touches.iter().flat_map(|t| t.measured(world)).collect();
    let movable = |id: BodyId| !matches!(world.bodies()[id].role, Role::Gone | Role::Kept);
    let at_rest: Vec<bool> =
        (0..world.bodies().len()).map(|id| movable(id) && world.speed(id) < crate::stages::hold::REST_SPEED).collect();
    // Engine units: d is 1.
    let hanging = contact::hanging(&at_rest, &contacts, 1.0).len();
    let overlap = |t: &Touch| Overlap { depth: t.depth(), thickness: world.pair_thickness(t) };
    let penetration = measure::penetration(&touches.iter().map(overlap).collect::<Vec<_>>());
    let unsupported = unsupported(world);
    BTreeMap::from([
        ("unsupported_fraction", unsupported.is_finite().then_some(unsupported)),
        ("hanging", Some(hanging as f64)),
        ("penetration_max_rel", Some(penetration.max_rel)),
        ("penetration_mean_rel", Some(penetration.mean_rel)),
    ])
}

/// `unsupported_fraction`: share of the resting bodies that the best global distribution of contact forces leaves
/// unbalanced by more than a tenth of their weight. All contacts count, up to a gap of [`REAL_CONTACT`].
fn unsupported(world: &World) -> f64 {
    // What is kept in place carries like scenery.
    let is_kept = |id: BodyId| world.bodies()[id].role == Role::Kept;
    let present: Vec<BodyId> = world.present().filter(|&id| !is_kept(id)).collect();
    let index = |id: BodyId| present.binary_search(&id).ok();
    let body = |&id: &BodyId| {
        let b = &world.bodies()[id];
        global::Body { mass: b.mass, center_of_mass: world.pose(id).translation, radius: b.radius }
    };
    let bodies: Vec<global::Body> = present.iter().map(body).collect();
    let touches = world.touches(REAL_CONTACT);
    let contact = |t: &Touch| {
        let other = match t.b {
            Side::Body(b) if is_kept(b) => None,
            Side::Body(b) => Some(index(b)?),
            Side::Ground | Side::Scenery | Side::Moving => None,
        };
        // Normals point into the first of the pair.
        match (index(t.a), other) {
            (Some(body), other) => Some((body, other, t.friction, 1.0)),
            (None, Some(body)) => Some((body, None, t.friction, -1.0)),
            (None, None) => None,
        }
    };
    let contacts: Vec<global::Contact> = touches
        .iter()
        .filter_map(|t| Some((t, contact(t)?)))
        .flat_map(|(t, (body, other, friction, side))| {
            let contact = move |p: &TouchPoint| global::Contact {
                body,
                other,
                point: p.point,
                normal: side * p.normal,
                friction,
            };
            t.points.iter().map(contact)
        })
        .collect();
    let pile = global::Pile { bodies: &bodies, contacts: &contacts, gravity: glam::DVec3::NEG_Y };
    let Ok(report) = global::analyse(&pile, global::Objective::SumOfNorms { sharpen: 2 }) else { return f64::NAN };
    let resting = present.iter().filter(|&&id| world.speed(id) < crate::stages::hold::REST_SPEED).count();
    let unbalanced = |(&id, &e): (&BodyId, &f64)| world.speed(id) < crate::stages::hold::REST_SPEED && e > UNBALANCED;
    let count = present.iter().zip(&report.imbalance).filter(|&pair| unbalanced(pair)).count();
    count as f64 / resting.max(1) as f64
}

/// mg (measures.md).
const UNBALANCED: f64 = 0.1;

fn motion_figures(inputs: &Inputs, pile: &Pile, prop_frames: &[Vec<Pose>]) -> Figures {
    let units = pile.world.units;
    let weight = pile.bodies.len() as f64;
    let frames = &pile.recorder.frames;
    let last = frames.len() - 1;
    let hold_end = pile.disturbed_frame.unwrap_or(last).min(last);
    let from = pile.hold_frame.min(hold_end);
    let displacements = |from: usize, to: usize| -> Vec<f64> {
        frames[from].iter().zip(&frames[to]).map(|(a, b)| a.translation.distance(b.translation)).collect()
    };
    let mut figures = BTreeMap::from([
        ("drift_p95_rel", Some(measure::percentile(&displacements(from, hold_end), 0.95))),
        ("resting_speed_max", Some(inputs.held.resting_speed_max * units.length / units.time)),
        ("resting_speed_max_rel", Some(inputs.held.resting_speed_max)),
        ("kinetic_energy_rel", Some(pile.world.kinetic_energy() / weight)),
        ("active_body_share", Some(pile.active_body_steps as f64 / weight / pile.step.max(1) as f64)),
    ]);
    if let Some(rest) = inputs.held.rest {
        let seconds = rest.steps as f64 * pile.world.step_length() * units.time;
        figures.insert("rest_seconds", Some(seconds));
        // Where frames are not kept, nobody knows where the bodies were then.
        let from = pile.recorder.keeps().then_some(rest.frame.min(last));
        let creep = from.map(|from| displacements(from, last).into_iter().fold(0.0, f64::max));
        figures.insert("creep_max_rel", creep);
    }
    if inputs.scene.bodies.iter().any(Given::is_stacked) || pile.disturbed_frame.is_some() {
        let stack = placed(inputs.bodies, &prop_frames[0], 0);
        let point = |(prop, scale, pose): &(usize, f64, Pose)| {
            let points = &inputs.scene.props[*prop].model.mesh.points;
            points.iter().map(|p| pose.transform_point(*p * *scale).y).fold(f64::NEG_INFINITY, f64::max)
        };
        let top = stack.iter().map(point).fold(f64::NEG_INFINITY, f64::max);
        let height = (top - inputs.ground) / units.length;
        let drift = displacements(0, hold_end).into_iter().fold(0.0, f64::max);
        figures.insert("stack_drift_rel", (height > 0.0).then(|| drift / height));
        let fallen = frames[0].iter().zip(&frames[last]).filter(|(a, b)| a.translation.y - b.translation.y > FALLEN);
        figures.insert("fallen_fraction", Some(fallen.count() as f64 / frames[0].len().max(1) as f64));
    }
    figures
}

/// A body whose centre of mass has come down by more than this, in d, has fallen.
const FALLEN: f64 = 0.25;

fn control_figures(pile: &Pile) -> Figures {
    let tally = pile.control.tally;
    let ratio = |a: f64, b: f64| (b > 0.0).then_some(a / b);
    BTreeMap::from([
        ("nails_peak", Some(tally.nails_peak as f64)),
        ("nails_end", Some(pile.world.nail_count() as f64)),
        ("nails_broken", Some(tally.nails_broken as f64)),
        ("nail_load_max", Some(tally.nail_load_max)),
        ("control_overhead", ratio(pile.control_seconds, pile.step_seconds)),
        ("analysis_us_per_body", ratio(pile.control_seconds * 1e6, tally.analyses as f64)),
    ])
}

fn counts(scene: &Scene, filled: Option<&Filled>, pile: &Pile) -> BTreeMap<&'static str, u64> {
    let (tally, work, world) = (pile.control.tally, pile.work, &pile.world);
    let of_kind = |is: fn(&Outline) -> bool| pile.shapes.iter().filter(|s| is(&s.solid.outline())).count() as u64;
    let steps_if = |on: bool| if on { pile.step } else { 0 };
    let removed = filled.map(|filled| filled.removed).unwrap_or_default();
    let both = |of: fn(&Work) -> u64| of(&world.work) + filled.map_or(0, |filled| of(&filled.work));
    BTreeMap::from([
        ("fill_steps", filled.map_or(0, |filled| filled.steps)),
        ("fill_steps_recalled", 0),
        ("steps", pile.step),
        ("steps_recalled", 0),
        ("removed_sticking_out", removed.sticking_out as u64),
        ("removed_overlapping", removed.overlapping as u64),
        ("removed_escaped", removed.escaped as u64),
        ("bodies_lost", pile.lost.len() as u64),
        ("guard_retries", pile.guard.actions.retries),
        ("guard_stiffened", pile.guard.actions.stiffened),
        ("control_cycles", tally.cycles),
        ("analyses", tally.analyses),
        ("verdicts_kept", tally.settled),
        ("verdicts_stable", tally.stable),
        ("verdicts_unstable", tally.unstable),
        ("verdicts_undecided", 0),
        ("candidates", tally.candidates),
        ("nails_driven", tally.nails_driven),
        ("nails_broken", tally.nails_broken),
        ("held_peak", tally.held_peak),
        ("holds_broken", tally.holds_broken),
        ("unjammed", tally.unjammed),
        ("shaken", tally.shaken),
        ("frames", if pile.recorder.keeps() { pile.recorder.frames.len() as u64 } else { 0 }),
        ("wall_triangles_saved", filled.map_or(0, |filled| filled.wall_triangles_saved as u64)),
        ("props_as_primitives", of_kind(|outline| matches!(outline, Outline::Box | Outline::Ball))),
        ("props_split", of_kind(|outline| matches!(outline, Outline::Parts))),
        ("release_layers", work.layers),
        ("scenery_pieces", scene.statics.len() as u64),
        ("bodies_placed", scene.bodies.len() as u64),
        ("bodies_emitted", work.bodies_emitted),
        ("bouncing_bodies", work.bouncing_bodies),
        ("stand_steps", work.stand_steps),
        ("free_standing_steps", work.free_standing_steps),
        ("steps_with_stiff_contacts", steps_if(work.is_stiff)),
        ("steps_with_friction_per_point", steps_if(world.has_friction_per_point())),
        ("speculative_body_steps", both(|w| w.speculative_body_steps)),
        ("ccd_body_steps", both(|w| w.ccd_body_steps)),
        ("rolling_body_steps", world.work.rolling_body_steps),
        ("rocking_looks", world.work.rocking_looks),
        ("guard_steps", pile.guard.actions.steps),
        ("region_tests", pile.control.region_tests()),
        ("break_checks", tally.break_checks),
        ("impact_looks", tally.impact_looks),
    ])
}

/// More of the volume than this in pockets is worth a word.
const MOST_POCKETS: f64 = 0.02;
/// Emptier than this, the fill is worth a warning: half of what random props reach.
const POOR_FILL: f64 = 0.2;

fn container_warnings(inputs: &Inputs, container: &Container, filled: &Filled) -> Vec<String> {
    let mut warnings = Vec::new();
    if container.remeshed {
        let spacing = container.distance.spacing() * inputs.plan.prop_diameter;
        warnings.push(format!(
            "{}: filled inside a surface around the union of its parts, {spacing:.3} m between samples",
            inputs.scene.control.as_ref().map_or("", |model| &model.name)
        ));
    }
    let Removed { sticking_out, overlapping, escaped } = filled.removed;
    for (count, why) in
        [(sticking_out, "stuck out"), (overlapping, "overlapped another"), (escaped, "left the container")]
    {
        if count > 0 {
            warnings.push(match count {
                1 => format!("1 body that {why} was removed after the fill"),
                _ => format!("{count} bodies that {why} were removed after the fill"),
            });
        }
    }
    warnings
}

fn fill_warnings(inputs: &Inputs, filled: &Filled, first: &ShapeMeasures) -> Vec<String> {
    let mut warnings = Vec::new();
    if filled.full && first.fill_fraction < POOR_FILL {
        warnings.push(format!(
            "only {:.0} % of the control mesh could be filled: its parts are narrow for these props; smaller props reach farther",
            100.0 * first.fill_fraction
        ));
    }
    if filled.full && filled.pockets > MOST_POCKETS {
        warnings.push(format!(
            "{:.0} % of the control mesh's volume lies in pockets that the fill did not reach; smaller props{} reach farther",
            100.0 * filled.pockets,
            if inputs.params.fill.method == FillMethod::Pour { ", or fill.method = \"insert\"," } else { "" }
        ));
    }
    if !filled.full && inputs.params.fill.count.is_none() {
        warnings.push(format!(
            "the fill stopped at its limit of {} bodies before the control mesh was full; raise fill.max_bodies or use larger props",
            inputs.params.fill.max_bodies
        ));
    }
    warnings
}

/// What the guard did.
fn guard_warnings(pile: &Pile) -> Vec<String> {
    let name = |id: BodyId| format!("{id} ({})", pile.scene().props[pile.bodies[id].prop].model.name);
    let actions = &pile.guard.actions;
    let mut warnings = guard::told(&actions.aside, name);
    warnings.iter_mut().for_each(|text| text.push_str(" and were set aside"));
    if actions.retries > 0 {
        warnings.push(format!("{} steps gained energy or speed and were taken again in smaller ones", actions.retries));
    }
    let deep = if actions.stiffened > 0 { pile.guard.still_deep(&pile.world) } else { 0 };
    if deep > 0 {
        warnings.push(format!(
            "{deep} pairs of bodies overlap by more than half of the thinner one's thickness in the end, even with stiffer contacts"
        ));
    }
    warnings
}

fn end_warnings(pile: &Pile, held: Held, measures: &Figures) -> Vec<String> {
    let mut warnings = Vec::new();
    if !held.at_rest {
        warnings.push("the pile was still moving at the last frame; bake more frames, or raise hold.patience".into());
    }
    if pile.fallen > 0 {
        let who = if pile.fallen == 1 { "1 body".into() } else { format!("{} bodies", pile.fallen) };
        warnings.push(format!("{who} fell past the scenery and were set aside: there is no ground"));
    }
    warnings.extend(guard_warnings(pile));
    if let Some(Some(hanging)) = measures.get("hanging")
        && *hanging > 0.0
    {
        let who = if *hanging == 1.0 { "1 body rests".into() } else { format!("{hanging} bodies rest") };
        warnings.push(format!("{who} without a chain of contacts down to the ground"));
    }
    warnings
}
