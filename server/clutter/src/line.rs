//! One layout as one line of JSON. SI, glTF's axes.

use crate::Library;
use crate::arrange::{Start, arrange};
use crate::catalogue::{Arrangement, StartPose};
use crate::draw::{Drawn, draw, numbers};
use crate::pile::Pile;
use crate::proof::MOST_ELSEWHERE;
use crate::settle::{Rejection, Settled, settle};
use crate::view::{Look, SeenBody};
use cairn_analysis::{AnalysisOptions, forecast};
use cairn_engine::world::BodyId;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use glam::DMat3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A layout.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Its number.
    pub layout: u64,
    /// Attempts before it that were no layouts, by reason.
    pub rejected: BTreeMap<Rejection, u32>,
    /// Bodies that were there and are not: they left, or were taken away with what rested on them; by reason.
    pub taken_away: BTreeMap<Rejection, u32>,
    /// Label of the place, and its number in the catalogue.
    pub place: String,
    pub place_number: usize,
    pub arrangement: Arrangement,
    pub pose: StartPose,
    pub bodies: Vec<LineBody>,
    pub proof: Proof,
    /// What the camera sees; null: the catalogue asks for nothing of it.
    pub view: Option<Seen>,
    /// The body that is looked for.
    pub target: Option<usize>,
    /// Why there is no layout; then there are no bodies.
    pub failed: Option<String>,
}

/// A body of a layout.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LineBody {
    /// Its number in the catalogue, folders replaced by their models.
    pub prop: usize,
    pub label: String,
    pub scale: f64,
    /// Of the prop's own origin in the frame of the place's file, m.
    pub position: [f64; 3],
    /// x, y, z, w.
    pub rotation: [f64; 4],
    /// kg.
    pub mass: f64,
    /// In the body's own frame, m.
    pub center_of_mass: [f64; 3],
    /// About the center of mass along the body's own axes, kg m^2: xx, yy, zz, xy, xz, yz.
    pub inertia: [f64; 6],
    /// Bodies that carry it, ascending; -1: the place.
    pub rests_on: Vec<i64>,
    /// Bodies that rest on it, directly or through others, ascending.
    pub carries: Vec<usize>,
    /// Whether the others are proven to stand without it; null: neither that nor the contrary.
    pub may_leave: Option<bool>,
    /// Share of its outline in the camera's picture that is seen, past other bodies and the place; null: there is no
    /// camera.
    pub visible: Option<f64>,
}

/// What the camera sees of a layout.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seen {
    /// Mean share of a body's outline in the picture that other bodies hide.
    pub overlap: f64,
    /// Share of the target's outline that is seen, past other bodies and the place; null: there is no target.
    pub target: Option<f64>,
}

/// What was found of a layout.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Proof {
    pub at_rest: bool,
    /// Every center of mass is above a surface of the place.
    pub contained: bool,
    /// Largest overlap of two collision shapes, m.
    pub overlap: f64,
    /// Each body stands a push to any side by this share of its weight, by statics; null: it was not tried.
    pub push: Option<f64>,
    /// Largest way of a body in 2 s of our own trial, m; null: it was not tried.
    pub drift: Option<f64>,
    /// The same in MuJoCo.
    pub drift_mujoco: Option<f64>,
}

/// What a layout is tried by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gates {
    /// Our own trial.
    pub any: bool,
    /// Removals are judged.
    pub removals: bool,
}

/// Another engine, to which a layout is given.
pub type Judge<'a> = &'a mut dyn FnMut(&Line) -> Result<f64, String>;

/// Makes the layout of a number. `judge`: its drift in another engine, m.
pub fn make(library: &Library, number: u64, gates: Gates, mut judge: Option<Judge>) -> Result<Line, String> {
    let mut rejected: BTreeMap<Rejection, u32> = BTreeMap::new();
    let mut last = None;
    for attempt in 0..library.catalogue.attempts() {
        match attempt_at(library, number, attempt, gates, &mut judge)? {
            Ok(line) => return Ok(Line { rejected, ..line }),
            Err((drawn, why)) => {
                *rejected.entry(why).or_default() += 1;
                last = Some(drawn);
            }
        }
    }
    let counts: Vec<String> = rejected.iter().map(|(why, count)| format!("{}: {count}", name_of(*why))).collect();
    let failed = format!("no attempt of {} was a layout ({})", library.catalogue.attempts(), counts.join(", "));
    let drawn = last.expect("there is at least one attempt");
    Ok(Line { rejected, failed: Some(failed), ..empty(library, number, &drawn) })
}

/// The name of a reason in lines.
pub fn name_of(why: Rejection) -> String {
    serde_json::to_value(why).ok().and_then(|name| name.as_str().map(str::to_owned)).unwrap_or_default()
}

/// A line without bodies.
fn empty(library: &Library, number: u64, drawn: &Drawn) -> Line {
    Line {
        layout: number,
        rejected: BTreeMap::new(),
        taken_away: BTreeMap::new(),
        place: library.places[drawn.place].label.clone(),
        place_number: drawn.place,
        arrangement: drawn.arrangement,
        pose: drawn.pose,
        bodies: Vec::new(),
        proof: Proof::default(),
        view: None,
        target: None,
        failed: None,
    }
}

/// The line of a layout whose process ended, or took too long.
pub fn lost(library: &Library, number: u64, why: &str) -> Line {
    let drawn = draw(library, number, &mut numbers(library.catalogue.seed(), number, 0));
    Line { failed: Some(why.to_owned()), ..empty(library, number, &drawn) }
}

type Attempt = Result<Line, (Drawn, Rejection)>;

fn attempt_at(
    library: &Library,
    number: u64,
    attempt: u32,
    gates: Gates,
    judge: &mut Option<Judge>,
) -> Result<Attempt, String> {
    let mut rng = numbers(library.catalogue.seed(), number, attempt);
    let drawn = draw(library, number, &mut rng);
    let starts = arrange(library, &drawn, &mut rng);
    if !is_enough(&drawn, &starts) {
        return Ok(Err((drawn, Rejection::NoRoom)));
    }
    let settled = match settle(library, &drawn, &starts, gates.any, &mut rng) {
        Ok(settled) => settled,
        Err(why) => return Ok(Err((drawn, why))),
    };
    let look = look(&settled.pile);
    if let Some(why) = look.as_ref().and_then(|look| misses(&settled.pile, look)) {
        return Ok(Err((drawn, why)));
    }
    let mut line = line(library, number, &settled, look, gates)?;
    if let (Some(target), Some(body)) = (&library.catalogue.settings.target, line.target)
        && target.covered_by.is_some_and(|span| !span.holds(line.bodies[body].carries.len() as f64))
    {
        return Ok(Err((drawn, Rejection::Covered)));
    }
    if let Some(judge) = judge {
        let moved = judge(&line)?;
        if moved > MOST_ELSEWHERE {
            return Ok(Err((drawn, Rejection::DriftInMujoco)));
        }
        line.proof.drift_mujoco = Some(round(moved));
    }
    Ok(Ok(line))
}

/// Whether as many bodies found room as the catalogue asks for, and the target is among them.
fn is_enough(drawn: &Drawn, starts: &[Start]) -> bool {
    let has_target = drawn.target.is_none_or(|target| starts.iter().any(|start| start.drawn == target));
    has_target && starts.len() >= drawn.range[0]
}

/// What the camera sees of the bodies that are there, in their order.
fn look(pile: &Pile) -> Option<Look> {
    let (library, world) = (pile.library, &pile.world);
    let body = |id: BodyId| {
        let Start { prop, scale, .. } = pile.starts[id];
        SeenBody { prop, scale, pose: library.shapes[prop].prop_pose(&world.units.pose_to_si(&world.pose(id)), scale) }
    };
    let view = library.view.as_ref()?;
    Some(view.look(pile.drawn.place, &world.present().map(body).collect::<Vec<_>>()))
}

/// Why what the camera sees is not what the catalogue asks for.
fn misses(pile: &Pile, look: &Look) -> Option<Rejection> {
    let settings = &pile.library.catalogue.settings;
    if settings.overlap.is_some_and(|span| !span.holds(look.overlap)) {
        return Some(Rejection::OverlapInView);
    }
    let visible = settings.target.as_ref()?.visible?;
    let seen = pile.target().map_or(0.0, |body| look.visible[body]);
    (!visible.holds(seen)).then_some(Rejection::TargetInView)
}

fn line(library: &Library, number: u64, settled: &Settled, look: Option<Look>, gates: Gates) -> Result<Line, String> {
    let Settled { pile, overlap, push, drift } = settled;
    let (world, drawn) = (&pile.world, pile.drawn);
    let ids: Vec<BodyId> = world.present().collect();
    let starts: Vec<Start> = ids.iter().map(|&id| pile.starts[id]).collect();
    let index = |id: usize| ids.binary_search(&id).ok();
    let asked: &[usize] = if gates.removals { &ids } else { &[] };
    let found = forecast(world, &AnalysisOptions::default(), asked, false, &mut Silent).map_err(|e| e.to_string())?;
    let mut rests_on = vec![Vec::new(); starts.len()];
    for touch in &found.touches {
        let (body, other) = (index(touch.body), touch.other.map(index));
        let (Some(body), lift) = (body, touch.force[1]) else { continue };
        match other {
            None => rests_on[body].push(-1),
            Some(Some(other)) if lift > 0.0 => rests_on[body].push(other as i64),
            Some(Some(other)) if lift < 0.0 => rests_on[other].push(body as i64),
            Some(_) => {}
        }
    }
    let mut may_leave = vec![None; starts.len()];
    for (id, removal) in &found.removals {
        if let (Some(body), Some(removal)) = (index(*id), removal) {
            may_leave[body] = (!removal.is_open).then_some(removal.is_safe);
        }
    }
    let body = |(k, start): (usize, &Start)| {
        let shape = &library.shapes[start.prop];
        let center = world.units.pose_to_si(&world.pose(ids[k]));
        let Pose { translation, rotation } = shape.prop_pose(&center, start.scale);
        let mut below = std::mem::take(&mut rests_on[k]);
        below.sort_unstable();
        below.dedup();
        LineBody {
            prop: start.prop,
            label: library.labels[start.prop].clone(),
            scale: round(start.scale),
            position: translation.to_array().map(round),
            rotation: rotation.normalize().to_array().map(round),
            mass: significant(shape.mass * start.scale.powi(3)),
            center_of_mass: (shape.center * start.scale).to_array().map(round),
            inertia: inertia(shape.inertia, start.scale).map(significant),
            rests_on: below,
            carries: found.rest_on[ids[k]].iter().filter_map(|&id| index(id)).collect(),
            may_leave: may_leave[k],
            visible: look.as_ref().map(|look| round(look.visible[k])),
        }
    };
    let bodies = starts.iter().enumerate().map(body).collect();
    Ok(Line {
        bodies,
        taken_away: pile.away.clone(),
        proof: Proof {
            at_rest: true,
            contained: true,
            overlap: round(*overlap),
            push: push.map(round),
            drift: drift.map(round),
            drift_mujoco: None,
        },
        view: look.as_ref().map(|look| Seen {
            overlap: round(look.overlap),
            target: pile.target().map(|body| round(look.visible[body])),
        }),
        target: pile.target(),
        ..empty(library, number, drawn)
    })
}

/// Inertia about the center of mass along a body's own axes: xx, yy, zz, xy, xz, yz.
pub fn inertia((principal, turn): (glam::DVec3, glam::DQuat), scale: f64) -> [f64; 6] {
    let axes = DMat3::from_quat(turn);
    let m = axes * DMat3::from_diagonal(principal * scale.powi(5)) * axes.transpose();
    [m.x_axis.x, m.y_axis.y, m.z_axis.z, m.y_axis.x, m.z_axis.x, m.z_axis.y]
}

/// To nanometers: what is less is rounding of the engine.
pub fn round(value: f64) -> f64 {
    (value * 1e9).round() / 1e9 + 0.0
}

/// To seven digits.
pub fn significant(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::library;

    fn make_all(library: &Library) -> Vec<Line> {
        let gates = Gates { any: true, removals: false };
        (0..4).map(|number| make(library, number, gates, None).unwrap()).collect()
    }

    /// Pictures are taken where the catalogue asks for them alone: one of each attempt that stands.
    #[test]
    fn pictures_are_taken_where_they_are_asked_for() {
        let plain = library("");
        let lines = make_all(&plain);
        assert!(plain.view.is_none());
        assert!(lines.iter().all(|line| line.view.is_none() && line.bodies.iter().all(|body| body.visible.is_none())));
        let looked = library("camera = {}");
        let seen = make_all(&looked);
        assert_eq!(looked.view.as_ref().unwrap().renders(), 4);
        for (line, plain) in seen.iter().zip(&lines) {
            let view = line.view.as_ref().unwrap();
            assert!((0.0..=1.0).contains(&view.overlap) && view.target.is_none(), "{view:?}");
            assert!(line.bodies.iter().all(|body| (0.0..=1.0).contains(&body.visible.unwrap())));
            // All else is as without a camera.
            let bodies = line.bodies.iter().map(|body| LineBody { visible: None, ..body.clone() }).collect();
            assert_eq!(Line { view: None, bodies, ..line.clone() }, *plain);
        }
    }

    /// What the camera sees is within its ranges; what was not is drawn again, and counted.
    #[test]
    fn what_the_camera_sees_is_within_its_range() {
        let free = make_all(&library("camera = {}\ntarget = { label = \"bowl\" }"));
        let mut overlaps: Vec<f64> = free.iter().map(|line| line.view.as_ref().unwrap().overlap).collect();
        overlaps.sort_by(f64::total_cmp);
        // Two of the four layouts are not within.
        let most = overlaps[1];
        let asked = library(&format!("overlap = [0, {most}]\ntarget = {{ label = \"bowl\", visible = [0.2, 1] }}"));
        let lines = make_all(&asked);
        for line in &lines {
            let view = line.view.as_ref().unwrap();
            assert!(view.overlap <= most && view.target.unwrap() >= 0.2, "{view:?}");
            assert_eq!(line.bodies[line.target.unwrap()].visible, view.target);
        }
        let again = |why| lines.iter().filter_map(|line| line.rejected.get(&why)).sum::<u32>();
        let again = again(Rejection::OverlapInView) + again(Rejection::TargetInView);
        assert!(again >= 2, "{again}");
        assert_eq!(asked.view.as_ref().unwrap().renders(), u64::from(4 + again));
    }
}
