//! The report of a bake: its figures by the names of measures.md, its counts, and what a person should know.

use crate::Error;
use crate::container::Container;
use crate::equilibrium::global;
use crate::fill::{Filled, Placed, Removed};
use crate::free_pour;
use crate::hold::Held;
use crate::measure::{self, Contact, Gauge, Overlap, ShapeMeasures};
use crate::mesh::TriMesh;
use crate::observer::{Observer, Progress, Stage, observe};
use crate::params::Params;
use crate::plan::Plan;
use crate::pose::Pose;
use crate::region::Region;
use crate::release::Pile;
use crate::report::Report;
use crate::scene::Scene;
use crate::shape::Shape;
use crate::standing;
use crate::world::{BodyId, Side, Touch, World};
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
    /// Welded and facing outward.
    pub control: &'a TriMesh,
    pub container: &'a Container,
    pub filled: &'a Filled,
    pub held: Held,
}

/// The frames in SI, from the props' own frames. Shape `[frame][body]`.
pub fn prop_frames(pile: &Pile) -> Vec<Vec<Pose>> {
    (0..pile.recorder.frames.len()).map(|number| pile.prop_frame(number).collect()).collect()
}

/// Measures the pile.
pub fn report(
    inputs: &Inputs,
    pile: &mut Pile,
    frames: &[Vec<Pose>],
    observer: &mut dyn Observer,
) -> Result<Report, Error> {
    let Inputs { scene, params, shapes, filled, held, .. } = *inputs;
    let bodies = filled.bodies.len();
    let progress =
        |fraction| Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0 };
    observe(observer, &progress(0.0))?;
    let region = Region::new(inputs.control);
    let props: Vec<TriMesh> = scene.props.iter().map(|p| p.model.mesh.clone()).collect();
    let (start, end) = (placed(&filled.bodies, &frames[0]), placed(&filled.bodies, &frames[frames.len() - 1]));
    let gauge = Gauge::new(inputs.control, &region, &measure::Pile { props: &props, bodies: &start });
    let first = gauge.measure(&measure::Pile { props: &props, bodies: &start });
    observe(observer, &progress(0.4))?;
    let last = gauge.measure(&measure::Pile { props: &props, bodies: &end });
    observe(observer, &progress(0.8))?;

    let mut measures = shape_figures(&first, &last);
    measures.extend(contact_figures(&pile.world));
    measures.extend(motion_figures(inputs, pile));
    measures.extend(control_figures(pile));
    if params.output.free_standing {
        measures.extend(standing::measure(pile, observer)?);
    }
    if params.output.free_pour {
        measures.insert("free_pour_fraction", free_pour::of_props(&scene.props, shapes, params, observer)?);
    }
    let mut warnings = inputs.plan.warnings.clone();
    warnings.extend(fill_warnings(inputs, &first));
    warnings.extend(end_warnings(pile, held, &measures));
    warnings.extend(first.caveats());
    Ok(Report {
        seed: params.seed,
        bodies,
        plan: inputs.plan.clone(),
        params: params.clone(),
        measures,
        counts: counts(filled, pile),
        shapes: shapes.iter().map(|s| s.report.clone()).collect(),
        seconds: BTreeMap::new(),
        warnings,
    })
}

type Figures = BTreeMap<&'static str, Option<f64>>;

fn placed(bodies: &[Placed], frame: &[Pose]) -> Vec<(usize, f64, Pose)> {
    bodies.iter().zip(frame).map(|(b, &pose)| (b.prop, b.scale, pose)).collect()
}

/// Figures of the end under their names; those right after turning over with `_start` behind.
fn shape_figures(first: &ShapeMeasures, last: &ShapeMeasures) -> Figures {
    let mut figures: Figures = last.figures().into_iter().map(|(name, value)| (name, Some(value))).collect();
    figures.insert("shape_iou_start", Some(first.shape_iou.value));
    figures.insert("height_p95_rel_start", Some(first.height_p95_rel));
    figures.insert("silhouette_iou_start", Some(first.silhouette_iou));
    // Defined right after turning over, and after the fill.
    figures.insert("protrusion_rel", Some(first.protrusion_rel));
    figures.insert("fill_fraction", Some(first.fill_fraction));
    figures.insert("kept_shape", measure::kept_shape(first, last));
    figures
}

/// Gap up to which contacts carry in `unsupported_fraction`, as a share of the thinner prop's thickness (measures.md).
pub const REAL_CONTACT: f64 = 0.05;

fn contact_figures(world: &World) -> Figures {
    // `hanging` counts contacts up to d/200, which may be more than the thickness tolerance of thin props.
    let thinnest = world.present().map(|id| world.bodies()[id].thickness).fold(f64::INFINITY, f64::min);
    let touches = world.touches(REAL_CONTACT.max(measure::CARRYING_GAP / thinnest));
    let contacts: Vec<Contact> = touches.iter().flat_map(Touch::measured).collect();
    let at_rest: Vec<bool> =
        (0..world.bodies().len()).map(|id| world.is_present(id) && world.speed(id) < crate::hold::REST_SPEED).collect();
    // Engine units: d is 1.
    let hanging = measure::hanging(&at_rest, &contacts, 1.0).len();
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
    let present: Vec<BodyId> = world.present().collect();
    let index = |id: BodyId| present.binary_search(&id).ok();
    let body = |&id: &BodyId| {
        let b = &world.bodies()[id];
        global::Body { mass: b.mass, center_of_mass: world.pose(id).translation, radius: b.radius }
    };
    let bodies: Vec<global::Body> = present.iter().map(body).collect();
    let touches = world.touches(REAL_CONTACT);
    let contact = |t: &Touch| {
        let (body, friction) = (index(t.a)?, t.friction);
        let other = match t.b {
            Side::Body(b) => Some(index(b)?),
            Side::Ground | Side::Scenery => None,
        };
        Some((body, other, friction))
    };
    let contacts: Vec<global::Contact> = touches
        .iter()
        .filter_map(|t| Some((t, contact(t)?)))
        .flat_map(|(t, (body, other, friction))| {
            t.points.iter().map(move |p| global::Contact { body, other, point: p.point, normal: p.normal, friction })
        })
        .collect();
    let pile = global::Pile { bodies: &bodies, contacts: &contacts, gravity: glam::DVec3::NEG_Y };
    let Ok(report) = global::analyse(&pile, global::Objective::SumOfNorms { sharpen: 2 }) else { return f64::NAN };
    let resting = present.iter().filter(|&&id| world.speed(id) < crate::hold::REST_SPEED).count();
    let unbalanced = |(&id, &e): (&BodyId, &f64)| world.speed(id) < crate::hold::REST_SPEED && e > UNBALANCED;
    let count = present.iter().zip(&report.imbalance).filter(|&pair| unbalanced(pair)).count();
    count as f64 / resting.max(1) as f64
}

/// mg (measures.md).
const UNBALANCED: f64 = 0.1;

fn motion_figures(inputs: &Inputs, pile: &Pile) -> Figures {
    let units = pile.world.units;
    let weight = inputs.filled.bodies.len() as f64;
    let centres = |frame: &Vec<Pose>| frame.iter().map(|p| p.translation).collect::<Vec<_>>();
    let frames = &pile.recorder.frames;
    let from = pile.hold_frame.min(frames.len() - 1);
    let drift = measure::drift_p95_rel(&centres(&frames[from]), &centres(&frames[frames.len() - 1]), 1.0);
    BTreeMap::from([
        ("drift_p95_rel", Some(drift)),
        ("resting_speed_max", Some(inputs.held.resting_speed_max * units.length / units.time)),
        ("resting_speed_max_rel", Some(inputs.held.resting_speed_max)),
        ("kinetic_energy_rel", Some(pile.world.kinetic_energy() / weight)),
        ("active_body_share", Some(pile.active_body_steps as f64 / weight / pile.step.max(1) as f64)),
    ])
}

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

fn counts(filled: &Filled, pile: &Pile) -> BTreeMap<&'static str, u64> {
    let tally = pile.control.tally;
    BTreeMap::from([
        ("fill_steps", filled.steps),
        ("steps", pile.step),
        ("removed_sticking_out", filled.removed.sticking_out as u64),
        ("removed_overlapping", filled.removed.overlapping as u64),
        ("removed_escaped", filled.removed.escaped as u64),
        ("bodies_lost", pile.lost.len() as u64),
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
        ("frames", pile.recorder.frames.len() as u64),
    ])
}

/// Emptier than this, the fill is worth a warning: half of what random props reach.
const POOR_FILL: f64 = 0.2;

fn fill_warnings(inputs: &Inputs, first: &ShapeMeasures) -> Vec<String> {
    let mut warnings = Vec::new();
    if inputs.container.remeshed {
        let spacing = inputs.container.distance.spacing() * inputs.plan.prop_diameter;
        warnings.push(format!(
            "{}: filled inside a surface around the union of its parts, {spacing:.3} m between samples",
            inputs.scene.control.name
        ));
    }
    let Removed { sticking_out, overlapping, escaped } = inputs.filled.removed;
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
    if inputs.filled.full && first.fill_fraction < POOR_FILL {
        warnings.push(format!(
            "only {:.0} % of the control mesh could be filled: its parts are narrow for these props; smaller props reach farther",
            100.0 * first.fill_fraction
        ));
    }
    if !inputs.filled.full && inputs.params.fill.count.is_none() {
        warnings.push(format!(
            "the fill stopped at its limit of {} bodies before the control mesh was full; raise fill.max_bodies or use larger props",
            inputs.params.fill.max_bodies
        ));
    }
    warnings
}

fn end_warnings(pile: &Pile, held: Held, measures: &Figures) -> Vec<String> {
    let mut warnings = Vec::new();
    if !held.at_rest {
        warnings.push("the pile was still moving at the last frame; bake more frames, or raise hold.patience".into());
    }
    if !pile.lost.is_empty() {
        warnings.push(format!("bodies {:?} became numerically unstable and were set aside", pile.lost));
    }
    if let Some(Some(hanging)) = measures.get("hanging")
        && *hanging > 0.0
    {
        let who = if *hanging == 1.0 { "1 body rests".into() } else { format!("{hanging} bodies rest") };
        warnings.push(format!("{who} without a chain of contacts down to the ground"));
    }
    warnings
}
