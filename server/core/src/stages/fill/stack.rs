//! The `stack` fill: props are laid down one by one, each as low as it can lie, on a height field of what is there, and settle as
//! they come. Bonded, crosswise and nested piles come of where the lowest place is sought.

mod course;
mod field;
mod place;
mod rest;

use super::filling::Filling;
use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::geometry::rectangle::smallest_rectangle;
use crate::input::observer::Observer;
use crate::input::scene::{Prop, Turns};
use crate::prepare::shape::{Seat, Shape, Solid, corners, hull_mesh};
use crate::world::BodyId;
use course::{Course, kind};
use field::{Field, Footprint};
use glam::{DQuat, DVec2, DVec3};
use place::find;
use rest::{Rest, flattest, upright};
use std::f64::consts::{PI, TAU};

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

/// A prop as it is laid down.
struct Layable {
    /// About the centre of mass, at scale 1.
    triangles: Vec<[DVec3; 3]>,
    rest: Option<Rest>,
    /// How it goes into another one, turn by turn: cups, bowls and plates do.
    seats: Vec<Seat>,
}

impl Layable {
    fn nests(&self) -> bool {
        !self.seats.is_empty()
    }

    /// What it covers seen from above. `size`: its scale, in engine units.
    fn footprint(&self, rotation: DQuat, size: f64, cell: f64, shift: DVec2) -> Footprint {
        let triangles: Vec<_> = self.triangles.iter().map(|t| t.map(|p| rotation * (p * size))).collect();
        Footprint::new(&triangles, cell, shift)
    }
}

/// Lays props until there is no more room, or until there are `limit` bodies. Returns whether the container is full.
pub fn run(filling: &mut Filling, limit: usize, observer: &mut dyn Observer) -> Result<bool, Error> {
    filling.pull(DVec3::NEG_Y);
    let props: Vec<Layable> = filling.scene.props.iter().zip(filling.shapes).map(|(p, s)| layable(s, p)).collect();
    let mut field = field_of(filling, &props);
    let batch = filling.expected.div_ceil(BATCHES).max(1);
    let (mut course, mut rounds) = (None, 0);
    loop {
        look(filling, &props, &mut field);
        let before = filling.loose().count();
        let more = lay(filling, &props, &mut field, &mut course, batch.min(limit.saturating_sub(before)))?;
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
fn lay(
    filling: &mut Filling,
    props: &[Layable],
    field: &mut Field,
    course: &mut Option<Course>,
    wanted: usize,
) -> Result<bool, Error> {
    let order = filling.params.fill.order;
    let least = least(filling);
    let all = filling.among.clone();
    let random = |i: usize| order < 1.0 || filling.scene.props[i].scale[0] < filling.scene.props[i].scale[1];
    let patience: Vec<u32> = (0..props.len()).map(|i| if random(i) { VAIN } else { 1 }).collect();
    // How often each prop was drawn in vain since it last found a place; and whether any did since all were tried.
    let (mut vain, mut any) = (vec![0; props.len()], false);
    let mut laid = 0;
    while laid < wanted {
        let kind = kind(filling, course.as_ref());
        let (prop, scale, rotation) = match kind {
            Some(kind) => filling.draw_of(kind),
            None => filling.draw(),
        };
        match find(filling, &props[prop], field, (prop, scale), rotation) {
            Some((_, footprint, spot))
                if kind.is_some() && course.as_ref().is_some_and(|c| c.is_below(&footprint, &spot)) =>
            {
                *course = None;
            }
            Some((pose, footprint, spot)) => {
                if kind.is_some() && course.is_none() {
                    *course = Some(Course { prop, height: spot.height });
                }
                let id: BodyId = filling.insert(prop, scale, pose)?;
                field.put(&footprint, &spot, id, least);
                (laid, any, vain[prop]) = (laid + 1, true, 0);
            }
            None => {
                vain[prop] += 1;
                course.take_if(|course| course.prop == prop);
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
