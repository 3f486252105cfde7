//! Bodies that would hover: glue may hold them, but no chain of visible meshes that touch leads from them to what
//! stands. They come down until they touch; a few that do not reach anything are left out of the pile.

use super::TurnOverInputs;
use crate::sight::{SeenBodies, carried};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::measure::Sight;
use cairn_motion::instance::Instance;
use cairn_motion::pile::Pile;

/// Share of the bodies that may be left out, and at least one. Where more hover, the shape is too thin for the props,
/// and would lose a limb: the report says so.
const MOST: f64 = 0.02;
/// Bodies move a little until they rest: here the gap is this share of what may be seen in the end.
const NARROWER: f64 = 0.8;
/// What comes down stops at this share of that gap.
const CLOSE: f64 = 0.5;
/// A group comes down by so much of its thickest body's thickness at most: where one more body finds no room below, the
/// gap is no wider. Farther, it would leave its place.
const FARTHEST: f64 = 1.0;

/// What is done about bodies that would hover.
#[derive(Default)]
pub struct Landed {
    /// All bodies of the fill that stay, engine units; empty: as they are.
    pub bodies: Vec<Instance>,
    /// Their numbers in the fill.
    pub places: Vec<usize>,
    pub lowered: usize,
    pub left_out: usize,
}

/// Of the first bodies, `filled` of them, those that hover come down or are left out. The pile waits where it starts.
pub fn land(pile: &Pile, filled: usize, inputs: &TurnOverInputs) -> Landed {
    let units = inputs.units;
    let pose = |b: &Instance| inputs.shapes[b.prop].prop_pose(&units.pose_to_si(&b.pose), b.scale);
    let bodies = pile.instances.iter().map(|b| (b.prop, b.scale, pose(b))).collect();
    let seen = SeenBodies::new(inputs.scene, inputs.shapes, bodies);
    let (mut sight, thickness) = (seen.sight(), &seen.thickness);
    let gap = NARROWER * inputs.params.accuracy.traits().visible_contact;
    let ground = inputs.params.ground.then_some(inputs.ground);
    let fixed = carried(&pile.world.static_contact_pairs(REAL_CONTACT), &pile.world);
    let hovering =
        |sight: &Sight| sight.hanging(gap, |i| fixed.contains(&i) || seen.is_on_ground(sight, i, gap, ground));
    let mut left = hovering(&sight);
    let mut groups = sight.groups(&left, gap);
    while !left.is_empty() && left.iter().all(|&id| id < filled) {
        // Bodies of an earlier pile stay where they lie.
        for group in groups.iter().filter(|group| group.iter().all(|&i| i >= inputs.kept)) {
            let farthest = FARTHEST * group.iter().map(|&i| thickness[i]).fold(0.0, f64::max);
            let before = group.iter().map(|&i| sight.lowered()[i]).fold(0.0, f64::max);
            let down = sight.way_down(group, CLOSE * gap, ground, farthest - before);
            if let Some(down) = down.filter(|down| *down > 0.0) {
                sight.lower(group, down);
            }
        }
        let before = (left.len(), groups.len());
        left = hovering(&sight);
        groups = sight.groups(&left, gap);
        // What has met a group that hovers, too, comes down with it.
        if (left.len(), groups.len()) >= before {
            break;
        }
    }
    let are_few = left.len() as f64 <= (MOST * filled as f64).max(1.0) && left.iter().all(|&id| id < filled);
    let out = if are_few { left } else { Vec::new() };
    let lowered = sight.lowered();
    let mut landed = Landed { lowered: lowered.iter().filter(|by| **by > 0.0).count(), ..Landed::default() };
    if landed.lowered + out.len() == 0 {
        return landed;
    }
    landed.left_out = out.len();
    for (id, mut body) in pile.instances[..filled].iter().copied().enumerate() {
        body.pose.translation.y -= lowered[id] / units.length;
        if out.binary_search(&id).is_err() {
            landed.bodies.push(body);
            landed.places.push(id);
        }
    }
    landed
}
