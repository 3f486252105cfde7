//! The place of a prop: on the height field, as low as it can lie, or in another one of its kind.

use super::Layable;
use super::field::{Footprint, HeightField, Spot};
use crate::fill::filling::Filling;
use crate::fill::method::Pass;
use cairn_engine::shape::NestingPose;
use cairn_engine::world::BodyId;
use cairn_geometry::pose::Pose;
use cairn_input::scene::Turns;
use cairn_prepare::stable_pose::StablePose;
use glam::{DQuat, DVec2, DVec3};
use rand::RngExt;
use std::f64::consts::{FRAC_PI_2, PI};

/// The largest turn of a prop that lies, to either side, at order 0; rad.
const LARGEST_TURN: f64 = PI / 3.0;
/// The largest shift of a prop at order 0, as a share of its shorter edge.
const LARGEST_SHIFT: f64 = 0.3;

/// Props this many times longer than wide lie crosswise on each other; those that leave less than this share of their
/// length at the end of a row, too, if they are longer than wide at all: pushed to the other end, they would make no
/// bond.
const LONG: f64 = 2.5;
const BOND: f64 = 0.2;
const LONGER: f64 = 1.3;
/// All costs are in thicknesses. Cost of a prop that lies across its layer.
const ACROSS: f64 = 0.8;
/// Cost of a gap of one thickness below.
const GAP: f64 = 0.3;
/// Cost of lying on one body alone, rather than on two by halves.
const ALONE: f64 = 0.2;
/// Cost of leaving a slot too narrow for another one.
const SLOT: f64 = 0.1;
/// Cost of each prop that finds no more room in the same row.
const LOSS: f64 = 0.3;
/// Cost of the other end of the pile.
const PUSH: f64 = 0.5;
/// Cost of lying unstably.
const UNSTABLE: f64 = 3.0;
/// From this order on, props are laid only where they lie stably.
const FIRM: f64 = 0.5;

/// A prop takes another one in where it leans by at most the angle of this cosine.
const STRAIGHT: f64 = 0.98;

/// The best place for a prop of this scale. `rotation`: how it would fall.
pub fn find(
    filling: &mut Filling,
    pass: &Pass,
    layable: &Layable,
    field: &HeightField,
    (prop, scale): (usize, f64),
    rotation: DQuat,
) -> Option<(Pose, Footprint, Spot)> {
    let task = filling.task;
    let order = task.params.fill.order;
    let size = scale / task.units.length;
    let lies = layable.lies.filter(|_| filling.rng.random_bool(task.params.fill.lying()));
    let turns = task.scene.props[prop].stance.turns;
    let free = if turns == Turns::Any { LARGEST_TURN } else { 0.0 };
    let half = if turns != Turns::None && filling.rng.random() { PI } else { 0.0 };
    let mess = if lies.is_some() { 1.0 - order } else { 0.0 };
    let turn = mess * free * filling.rng.random_range(-1.0..=1.0);
    let shift = DVec2::new(filling.rng.random_range(-1.0..=1.0), filling.rng.random_range(-1.0..=1.0));
    let shift = lies.map_or(DVec2::ZERO, |lies| shift * mess * LARGEST_SHIFT * lies.edges.y * size);
    let nested =
        lies.filter(|_| layable.nests()).and_then(|lies| nest(filling, pass, layable, field, (prop, scale), &lies));
    let posture = |share: f64| {
        let turned = |lies: StablePose| DQuat::from_rotation_y(half + share * turn) * lies.rotation;
        let rotation = lies.map_or(field.turn * rotation, turned);
        let straight = lies.filter(|_| share > 0.0).map(|lies| lies.rotation);
        Posture { prop, size, rotation, straight, shift: share * shift, lies }
    };
    let mut seek = |share: f64, most: f64| lowest(filling, pass, layable, field, &posture(share), most);
    let straight = seek(0.0, f64::INFINITY);
    // A prop in disorder takes no more room than it would straight, or lies straighter.
    let shares = if mess > 0.0 { DISORDERED } else { &[] };
    let most = straight.as_ref().map_or(f64::INFINITY, |straight| straight.cost + DISORDER);
    let best = shares.iter().find_map(|&share| seek(share, most)).or(straight);
    let higher =
        |nested: &(Pose, Footprint, Spot)| best.as_ref().is_some_and(|best| best.spot.height < nested.2.height);
    if let Some(nested) = nested.filter(|nested| !higher(nested)) {
        return Some(nested);
    }
    let Found { footprint, spot, rotation, .. } = best?;
    let rotation = (field.turn.inverse() * rotation).normalize();
    let pose = Pose { translation: field.center(&footprint, &spot), rotation };
    Some((pose, footprint, spot))
}

/// Shares of its turn and shift with which a place is sought for a prop in disorder. The place may cost hardly more
/// than the best one for a prop that lies straight.
const DISORDERED: &[f64] = &[1.0, 0.5];
const DISORDER: f64 = 0.1;

/// The posture in which a prop is laid.
struct Posture {
    prop: usize,
    /// Scale, in engine units.
    size: f64,
    rotation: DQuat,
    /// As if it lay in perfect order; `None` where it does.
    straight: Option<DQuat>,
    shift: DVec2,
    /// `None`: as it fell.
    lies: Option<StablePose>,
}

/// A place for a prop.
struct Found {
    cost: f64,
    footprint: Footprint,
    spot: Spot,
    rotation: DQuat,
}

/// The cheapest place for a prop in this posture, along or across, if it costs less than `most`.
fn lowest(
    filling: &mut Filling,
    pass: &Pass,
    layable: &Layable,
    field: &HeightField,
    posture: &Posture,
    most: f64,
) -> Option<Found> {
    let (task, order) = (filling.task, filling.task.params.fill.order);
    let &Posture { prop, size, shift, lies, .. } = posture;
    let base = task.container.base;
    let thickness = task.shapes[prop].thickness() * size;
    let crosswise = lies.is_some_and(|lies| lies_crosswise(&lies, size, field.extent()));
    let turns: &[bool] = if task.scene.props[prop].stance.turns == Turns::None { &[false] } else { &[false, true] };
    let mut best: Option<Found> = None;
    for &across in turns {
        let quarter = DQuat::from_rotation_y(if across { FRAC_PI_2 } else { 0.0 });
        let rotation = quarter * posture.rotation;
        let footprint = layable.footprint(rotation, size, field.cell, shift);
        let straight = |turn: DQuat| layable.footprint(quarter * turn, size, field.cell, DVec2::ZERO).size;
        let edges = posture.straight.map_or(footprint.size, straight);
        let Some(last) = last_cell(field.size, footprint.size) else { continue };
        let mut found: Option<(f64, Spot)> = None;
        let most = best.as_ref().map_or(most, |best| best.cost);
        for z in 0..=last[1] {
            for x in 0..=last[0] {
                let bound = found.as_ref().map_or(most, |found| found.0);
                // No lower cost makes up for a place that is higher than this.
                let Some(spot) = field.lay(&footprint, [x, z], bound * thickness + base, thickness) else { continue };
                let layer = ((spot.height - base) / footprint.height + 0.5).floor();
                let odd = layer.rem_euclid(2.0) >= 1.0;
                let beside = || spot.on.is_some_and(|(id, _)| layable.nests() && filling.world.body(id).prop == prop);
                if !spot.stable && order >= FIRM || lies.is_some() && beside() {
                    continue;
                }
                // Odd layers are pushed to the other end, so that joints do not lie above joints.
                let share = |at: usize, last: usize| at as f64 / last.max(1) as f64;
                let (u, v) = (share(x, last[0]), share(z, last[1]));
                let (u, v) = if odd { (1.0 - u, 1.0 - v) } else { (u, v) };
                let push = (v + u / (last[1] + 1) as f64) / 2.0;
                let is_turned_wrong = across != (odd && crosswise);
                let cost = (spot.height - base) / thickness
                    + GAP * spot.gap / thickness
                    + if is_turned_wrong { ACROSS } else { 0.0 }
                    + spot.on.map_or(0.0, |(_, share)| ALONE * (2.0 * share - 1.0).max(0.0))
                    + PUSH * push
                    + if spot.stable { 0.0 } else { UNSTABLE }
                    + (1.0 - order) * filling.rng.random::<f64>();
                if cost >= bound || !pass.allows(prop, field.center(&footprint, &spot), &mut filling.rng) {
                    continue;
                }
                let (lost, slots) = field.loss(&footprint, &spot, edges, thickness, odd);
                let cost = cost + LOSS * lost as f64 + SLOT * slots as f64;
                if cost < bound {
                    found = Some((cost, spot));
                }
            }
        }
        if let Some((cost, spot)) = found {
            best = Some(Found { cost, footprint, spot, rotation });
        }
    }
    best
}

/// The lowest place in another one of its kind.
fn nest(
    filling: &mut Filling,
    pass: &Pass,
    layable: &Layable,
    field: &HeightField,
    (prop, scale): (usize, f64),
    lies: &StablePose,
) -> Option<(Pose, Footprint, Spot)> {
    let size = scale / filling.task.units.length;
    let mut carriers: Vec<(f64, BodyId)> = Vec::new();
    for id in filling.world.present() {
        let (body, pose) = (filling.world.body(id), filling.world.pose(id));
        let straight = (pose.rotation * lies.up).y > STRAIGHT;
        if body.prop == prop && straight && field.is_topmost(id, pose.translation) && body.scale >= SMALLER * scale {
            carriers.push((pose.translation.y, id));
        }
    }
    carriers.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (_, id) in carriers {
        let below = filling.world.pose(id);
        // Where one leans on the other, the turn in which it stands straightest, whatever leans below it.
        let upright = |nesting: &NestingPose| (below.rotation * nesting.rotation * lies.up).y;
        let mut nesting_poses: Vec<&NestingPose> = layable.nesting_poses.iter().collect();
        nesting_poses.sort_by(|a, b| upright(b).total_cmp(&upright(a)));
        for nesting in nesting_poses {
            let rotation = (below.rotation * nesting.rotation).normalize();
            let translation = below.translation + DVec3::Y * (nesting.pitch * size);
            // Whether there is room, as if it stood straight.
            let straight = field.turn * DQuat::from_rotation_arc(rotation * lies.up, DVec3::Y) * rotation;
            let footprint = layable.footprint(straight, size, field.cell, DVec2::ZERO);
            let spot = field.lay_at(&footprint, translation);
            if let Some(spot) = spot.filter(|_| pass.allows(prop, translation, &mut filling.rng)) {
                return Some((Pose { translation, rotation }, footprint, spot));
            }
        }
    }
    None
}

/// A prop goes into another one that is at least this much of its size.
const SMALLER: f64 = 0.98;

fn lies_crosswise(lies: &StablePose, size: f64, extent: DVec2) -> bool {
    let [long, short] = lies.edges.to_array();
    let left = (extent.x / (long * size)).fract();
    long >= LONG * short || long >= LONGER * short && left < BOND && long * size <= extent.y
}

/// The last cells at which a footprint can begin.
fn last_cell(field: [usize; 2], footprint: [usize; 2]) -> Option<[usize; 2]> {
    Some([field[0].checked_sub(footprint[0])?, field[1].checked_sub(footprint[1])?])
}
