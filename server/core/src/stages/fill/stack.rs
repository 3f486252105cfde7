//! The `stack` fill: props are laid down one by one, each as low as it can lie, on a height field of what is there, and settle as
//! they come. Bonded, crosswise and nested piles come of where the lowest place is sought.

mod field;
mod rest;

use super::filling::Filling;
use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::geometry::rectangle::smallest_rectangle;
use crate::input::observer::Observer;
use crate::input::scene::{Prop, Turns};
use crate::prepare::shape::{Seat, Shape, Solid, corners, hull_mesh};
use crate::world::BodyId;
use field::{Field, Footprint, Spot};
use glam::{DQuat, DVec2, DVec3};
use rand::RngExt;
use rest::{Rest, flattest, upright};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Bodies come in so many batches, each of which settles this long, natural times.
const BATCHES: usize = 5;
const BATCH_SETTLE: f64 = 0.3;
/// A settled pile leaves room on top: it is looked for so many times.
const ROUNDS: usize = 3;
/// A cell is at most this share of the shortest edge of any prop, and at least that.
const CELL: (f64, f64) = (1.0 / 5.0, 1.0 / 12.0);
/// Bound on the cells of the height field.
const MAX_CELLS: f64 = 200_000.0;
/// Where a prop of random size or turn found no place so often, there is none for it; one that is always the same is tried once.
const VAIN: u32 = 24;

/// From this order on, every prop lies flat.
pub const ALL_FLAT: f64 = 2.0 / 3.0;
/// The largest turn of a prop that lies, to either side, at order 0; rad.
const LARGEST_TURN: f64 = PI / 3.0;
/// The largest shift of a prop at order 0, as a share of its shorter edge.
const LARGEST_SHIFT: f64 = 0.3;

/// Props this many times longer than wide lie crosswise on each other; those that leave less than this share of their length at
/// the end of a row, too, if they are longer than wide at all: pushed to the other end, they would make no bond.
const LONG: f64 = 2.5;
const BOND: f64 = 0.2;
const LONGER: f64 = 1.3;
/// What lying across costs where the layer lies along, in thicknesses.
const ACROSS: f64 = 0.8;
/// What a gap of one thickness below costs.
const GAP: f64 = 0.3;
/// What it costs to lie on one body alone, rather than on two by halves.
const ALONE: f64 = 0.2;
/// What it costs to leave a slot too narrow for another one.
const SLOT: f64 = 0.1;
/// What each prop costs that finds no more room in the same row.
const LOSS: f64 = 0.3;
/// What the other end of the pile costs.
const PUSH: f64 = 0.5;
/// What it costs not to lie firm.
const UNSTABLE: f64 = 3.0;
/// From this order on, nothing is laid where it does not lie firm.
const FIRM: f64 = 0.5;

/// A prop as it is laid down.
struct Layable {
    /// About the centre of mass, at scale 1.
    triangles: Vec<[DVec3; 3]>,
    rest: Option<Rest>,
    /// How it goes into another one, turn by turn: cups, bowls and plates do.
    seats: Vec<Seat>,
}

/// What was laid down, and how.
struct Laid {
    prop: usize,
    scale: f64,
    pose: Pose,
}

/// Lays props until there is no more room, or until there are `limit` bodies. Returns whether the container is full.
pub fn run(filling: &mut Filling, limit: usize, observer: &mut dyn Observer) -> Result<bool, Error> {
    filling.pull(DVec3::NEG_Y);
    let props: Vec<Layable> = filling.scene.props.iter().zip(filling.shapes).map(|(p, s)| layable(s, p)).collect();
    let mut field = field_of(filling, &props);
    let batch = filling.expected.div_ceil(BATCHES).max(1);
    let mut rounds = 0;
    loop {
        look(filling, &props, &mut field);
        let before = filling.loose().count();
        let more = lay(filling, &props, &mut field, batch.min(limit.saturating_sub(before)))?;
        filling.use_real_friction();
        filling.settle(BATCH_SETTLE, observer)?;
        filling.remove_escaped();
        if filling.loose().count() >= limit {
            return Ok(false);
        }
        if !more {
            rounds += 1;
            let added = filling.loose().count() - before.min(filling.loose().count());
            if rounds == ROUNDS || (added as f64) < filling.params.fill.full_below * before as f64 {
                return Ok(true);
            }
            filling.settle(filling.params.fill.settle / 2.0, observer)?;
        }
    }
}

fn layable(shape: &Shape, prop: &Prop) -> Layable {
    let unit = shape.size.diameter;
    let parts: Vec<Vec<DVec3>> = match &shape.solid {
        Solid::Convex(parts) => parts.iter().map(|part| part.iter().map(|&p| p / unit).collect()).collect(),
        Solid::Ball { center, radius } => vec![sphere().map(|p| (*center + p * *radius) / unit).collect()],
        Solid::Box(_) => vec![corners(shape, 1.0 / unit, &Pose::IDENTITY).collect()],
    };
    let meshes = parts.iter().map(|points| hull_mesh(points));
    let triangles = meshes.flat_map(|mesh| (0..mesh.triangles.len()).map(|i| mesh.corners(i)).collect::<Vec<_>>());
    let up = prop.stance.up.or((prop.tilt_max < 90.0).then_some(DVec3::Y));
    let rest = up.map_or_else(|| flattest(shape), |up| Some(upright(shape, up)));
    let turns = |rest: &Rest| match prop.stance.turns {
        Turns::None => 1,
        _ if rest.edges.x >= ROUND * rest.edges.y => 2,
        Turns::Quarter => 4,
        Turns::Any => TURNS,
    };
    let mut seats = rest.map_or_else(Vec::new, |rest| shape.seats(rest.up, turns(&rest)));
    seats.retain(|seat| rest.is_some_and(|rest| seat.pitch < NESTED * rest.height));
    Layable { triangles: triangles.map(|t| t.map(|p| p * unit)).collect(), rest, seats }
}

/// A prop nests if one on another is less high than this share of two.
const NESTED: f64 = 0.9;

/// A prop not longer than so many times its width is as good as round, and is tried in another one in so many turns.
const ROUND: f64 = 1.1;
const TURNS: usize = 24;
/// Cosine of the angle up to which what another one is put into stands straight.
const STRAIGHT: f64 = 0.98;

/// Points of the unit sphere.
fn sphere() -> impl Iterator<Item = DVec3> {
    (0..=8).flat_map(|i| {
        let (height, out) = (libm::cos(PI * f64::from(i) / 8.0), libm::sin(PI * f64::from(i) / 8.0));
        (0..16).map(move |k| {
            let turn = TAU * f64::from(k) / 16.0;
            DVec3::new(out * libm::cos(turn), height, out * libm::sin(turn))
        })
    })
}

/// An empty height field of the container, in cells into which the props fit.
fn field_of(filling: &Filling, props: &[Layable]) -> Field {
    let container = filling.container;
    let walls = container.bounds();
    let outline: Vec<DVec2> = walls.points.iter().map(|p| DVec2::new(p.x, p.z)).collect();
    let (turn, extent) = smallest_rectangle(&outline);
    let mut edges: Vec<(f64, f64)> = Vec::new();
    for ((prop, layable), shape) in filling.scene.props.iter().zip(props).zip(filling.shapes) {
        let scale = (prop.scale[0] + prop.scale[1]) / 2.0 / filling.world.units.length;
        let [long, short] = layable.rest.map_or([shape.size.diameter; 2], |rest| rest.edges.to_array());
        edges.extend([(long * scale, prop.weight), (short * scale, prop.weight)]);
    }
    let shortest = edges.iter().filter(|(_, weight)| *weight > 0.0).map(|(e, _)| *e).fold(f64::INFINITY, f64::min);
    // Props take whole cells: the edge with which they waste the least of the container's extent.
    let waste = |cell: f64, extent: f64, edge: f64| {
        let taken = (edge / cell - field::SNUG).ceil();
        1.0 - ((extent / cell + field::SNUG).floor() / taken).floor() * edge / extent.max(edge)
    };
    let total: f64 = edges.iter().map(|(_, weight)| weight).sum();
    let price = |cell: f64| {
        let of = |(edge, weight): &(f64, f64)| weight * (waste(cell, extent.x, *edge) + waste(cell, extent.y, *edge));
        edges.iter().map(of).sum::<f64>() / total + FINE * shortest / cell
    };
    let tried =
        (0..=CELLS_TRIED).map(|i| shortest * (CELL.0 + (CELL.1 - CELL.0) * f64::from(i) / f64::from(CELLS_TRIED)));
    let best = tried.reduce(|best, cell| if price(cell) < price(best) { cell } else { best }).unwrap_or(shortest);
    let least = ((extent.x * extent.y) / MAX_CELLS).sqrt();
    Field::new(&walls, container.base, DQuat::from_rotation_y(turn), best.max(least), LEEWAY)
}

/// What is laid may reach through the container's ceiling by this much, d: it is pushed back.
const LEEWAY: f64 = 0.02;
/// Edges of a cell that are compared, and what a cell of the shortest edge saves against one of half of it.
const CELLS_TRIED: u32 = 60;
const FINE: f64 = 0.004;

/// The height field of what is there.
fn look(filling: &Filling, props: &[Layable], field: &mut Field) {
    field.clear();
    let length = filling.world.units.length;
    let least = least(filling);
    for id in filling.world.present() {
        let placed = filling.placed(id);
        let triangles = props[placed.prop].triangles.iter();
        let triangles: Vec<_> =
            triangles.map(|t| t.map(|p| placed.pose.transform_point(p * placed.scale / length))).collect();
        field.put_as_it_lies(&triangles, id, least);
    }
}

/// Less height than this takes no prop.
fn least(filling: &Filling) -> f64 {
    let thickness = filling.scene.props.iter().zip(filling.shapes).filter(|(p, _)| p.weight > 0.0);
    thickness.map(|(p, s)| p.scale[0] * s.thickness()).fold(f64::INFINITY, f64::min) / filling.world.units.length
}

/// Lays up to `wanted` props. Returns whether there may be room for more.
fn lay(filling: &mut Filling, props: &[Layable], field: &mut Field, wanted: usize) -> Result<bool, Error> {
    let order = filling.params.fill.order;
    let least = least(filling);
    let all = filling.among.clone();
    let random = |i: usize| order < 1.0 || filling.scene.props[i].scale[0] < filling.scene.props[i].scale[1];
    let patience: Vec<u32> = (0..props.len()).map(|i| if random(i) { VAIN } else { 1 }).collect();
    // How often each prop was drawn in vain since it last found a place; and whether any did since all were tried.
    let (mut vain, mut any) = (vec![0; props.len()], false);
    let mut laid = 0;
    while laid < wanted {
        let (prop, scale, rotation) = filling.draw();
        match find(filling, &props[prop], field, prop, scale, rotation) {
            Some((place, footprint, spot)) => {
                let Laid { prop, scale, pose } = place;
                let id: BodyId = filling.insert(prop, scale, pose)?;
                field.put(&footprint, &spot, id, least);
                (laid, any, vain[prop]) = (laid + 1, true, 0);
            }
            None => {
                vain[prop] += 1;
                if vain[prop] >= patience[prop] {
                    filling.among.retain(|&i| i != prop);
                }
            }
        }
        let drawn = |i: &usize| filling.scene.props[*i].weight > 0.0;
        if !filling.among.iter().any(drawn) {
            filling.among = all.clone();
            if !any && !field.go_on_above() {
                return Ok(false);
            }
            (vain, any) = (vec![0; props.len()], false);
        }
    }
    filling.among = all;
    Ok(true)
}

/// The best place for a prop of this scale. `rotation`: how it would fall.
fn find(
    filling: &mut Filling,
    layable: &Layable,
    field: &Field,
    prop: usize,
    scale: f64,
    rotation: DQuat,
) -> Option<(Laid, Footprint, Spot)> {
    let order = filling.params.fill.order;
    let mess = 1.0 - order;
    let size = scale / filling.world.units.length;
    let flat = filling.rng.random_bool((order / ALL_FLAT).min(1.0));
    let lies = layable.rest.filter(|_| flat);
    let turns = filling.scene.props[prop].stance.turns;
    let free = if turns == Turns::Any { LARGEST_TURN } else { 0.0 };
    let half = if turns != Turns::None && filling.rng.random() { PI } else { 0.0 };
    let turn = half + mess * free * filling.rng.random_range(-1.0..=1.0);
    let (rotation, crosswise, shift) = match lies {
        Some(rest) => {
            let shift = DVec2::new(filling.rng.random_range(-1.0..=1.0), filling.rng.random_range(-1.0..=1.0));
            let shift = shift * mess * LARGEST_SHIFT * rest.edges.y * size;
            (DQuat::from_rotation_y(turn) * rest.rotation, lies_crosswise(&rest, size, field.extent()), shift)
        }
        None => (field.turn * rotation, false, DVec2::ZERO),
    };
    let thickness = filling.shapes[prop].thickness() * size;
    let nested =
        lies.filter(|_| !layable.seats.is_empty()).and_then(|rest| nest(filling, layable, field, (prop, scale), &rest));
    let mut best: Option<(f64, Footprint, Spot, DQuat)> = None;
    let ways: &[bool] = if turns == Turns::None { &[false] } else { &[false, true] };
    for &across in ways {
        let rotation = DQuat::from_rotation_y(if across { FRAC_PI_2 } else { 0.0 }) * rotation;
        let triangles: Vec<_> = layable.triangles.iter().map(|t| t.map(|p| rotation * (p * size))).collect();
        let footprint = Footprint::new(&triangles, field.cell, shift);
        let Some(last) = rest_of(field.size, footprint.size) else { continue };
        let mut found: Option<(f64, Spot)> = None;
        for z in 0..=last[1] {
            for x in 0..=last[0] {
                let bound = found
                    .as_ref()
                    .map(|f| f.0)
                    .into_iter()
                    .chain(best.as_ref().map(|b| b.0))
                    .fold(f64::INFINITY, f64::min);
                // Nothing below makes up for what is higher than this.
                let Some(spot) = field.lay(&footprint, [x, z], bound * thickness + filling.container.base, thickness)
                else {
                    continue;
                };
                let layer = ((spot.height - filling.container.base) / footprint.height + 0.5).floor();
                let odd = layer.rem_euclid(2.0) >= 1.0;
                let beside = || {
                    spot.on.is_some_and(|(id, _)| !layable.seats.is_empty() && filling.world.bodies()[id].prop == prop)
                };
                if !spot.stable && order >= FIRM || lies.is_some() && beside() {
                    continue;
                }
                // Odd layers are pushed to the other end: joints do not lie above joints.
                let share = |at: usize, last: usize| at as f64 / last.max(1) as f64;
                let (u, v) = (share(x, last[0]), share(z, last[1]));
                let (u, v) = if odd { (1.0 - u, 1.0 - v) } else { (u, v) };
                let push = (v + u / (last[1] + 1) as f64) / 2.0;
                let wrong_way = across != (odd && crosswise);
                let cost = (spot.height - filling.container.base) / thickness
                    + GAP * spot.gap / thickness
                    + if wrong_way { ACROSS } else { 0.0 }
                    + spot.on.map_or(0.0, |(_, share)| ALONE * (2.0 * share - 1.0).max(0.0))
                    + PUSH * push
                    + if spot.stable { 0.0 } else { UNSTABLE }
                    + mess * filling.rng.random::<f64>();
                if cost >= bound || !filling.may_be(prop, field.center(&footprint, &spot)) {
                    continue;
                }
                let (lost, slots) = field.loss(&footprint, &spot, thickness, odd);
                let cost = cost + LOSS * lost as f64 + SLOT * slots as f64;
                if cost < bound {
                    found = Some((cost, spot));
                }
            }
        }
        if let Some((cost, spot)) = found {
            best = Some((cost, footprint, spot, rotation));
        }
    }
    let higher =
        |nested: &(Laid, Footprint, Spot)| best.as_ref().is_some_and(|(_, _, spot, _)| spot.height < nested.2.height);
    if let Some(nested) = nested.filter(|nested| !higher(nested)) {
        return Some(nested);
    }
    let (_, footprint, spot, rotation) = best?;
    let rotation = (field.turn.inverse() * rotation).normalize();
    let pose = Pose { translation: field.center(&footprint, &spot), rotation };
    Some((Laid { prop, scale, pose }, footprint, spot))
}

/// The lowest place in another one of its kind.
fn nest(
    filling: &mut Filling,
    layable: &Layable,
    field: &Field,
    (prop, scale): (usize, f64),
    rest: &Rest,
) -> Option<(Laid, Footprint, Spot)> {
    let size = scale / filling.world.units.length;
    let mut carriers: Vec<(f64, BodyId)> = Vec::new();
    for id in filling.world.present() {
        let (body, pose) = (&filling.world.bodies()[id], filling.world.pose(id));
        let straight = (pose.rotation * rest.up).y > STRAIGHT;
        if body.prop == prop && straight && field.is_topmost(id, pose.translation) && body.scale >= SMALLER * scale {
            carriers.push((pose.translation.y, id));
        }
    }
    carriers.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (_, id) in carriers {
        let below = filling.world.pose(id);
        // Where one leans on the other, the turn in which it stands straightest, whatever leans below it.
        let upright = |seat: &Seat| (below.rotation * seat.rotation * rest.up).y;
        let mut seats: Vec<&Seat> = layable.seats.iter().collect();
        seats.sort_by(|a, b| upright(b).total_cmp(&upright(a)));
        for seat in seats {
            let rotation = (below.rotation * seat.rotation).normalize();
            let translation = below.translation + DVec3::Y * (seat.pitch * size);
            // Whether there is room, as if it stood straight.
            let straight = field.turn * DQuat::from_rotation_arc(rotation * rest.up, DVec3::Y) * rotation;
            let triangles: Vec<_> = layable.triangles.iter().map(|t| t.map(|p| straight * (p * size))).collect();
            let footprint = Footprint::new(&triangles, field.cell, DVec2::ZERO);
            if let Some(spot) = field.lay_at(&footprint, translation).filter(|_| filling.may_be(prop, translation)) {
                return Some((Laid { prop, scale, pose: Pose { translation, rotation } }, footprint, spot));
            }
        }
    }
    None
}

/// A prop goes into another one that is at least this much of its size.
const SMALLER: f64 = 0.98;

fn lies_crosswise(rest: &Rest, size: f64, extent: DVec2) -> bool {
    let [long, short] = rest.edges.to_array();
    let left = (extent.x / (long * size)).fract();
    long >= LONG * short || long >= LONGER * short && left < BOND && long * size <= extent.y
}

/// The last cells at which a footprint can begin.
fn rest_of(field: [usize; 2], footprint: [usize; 2]) -> Option<[usize; 2]> {
    Some([field[0].checked_sub(footprint[0])?, field[1].checked_sub(footprint[1])?])
}
