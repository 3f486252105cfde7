//! The `stack` fill: props are laid down one by one, each as low as it can lie, on a height field of the pile, and
//! settle as they come. Bonded, crosswise and nested piles result from where the lowest place is sought.

mod course;
mod field;
mod place;

use super::insert::Insert;
use super::{Method, Pass};
use crate::fill::filling::{FillTask, Filling};
use cairn_engine::shape::{NestingPose, Shape, Solid, corners, hull_mesh, sphere};
use cairn_geometry::pose::Pose;
use cairn_geometry::rectangle::smallest_rectangle;
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use cairn_input::scene::{Prop, Turns};
use cairn_motion::instance::Instance;
use cairn_prepare::stable_pose::{StablePose, flattest, upright};
use course::{Course, kind};
use field::{Footprint, HeightField};
use glam::{DQuat, DVec2, DVec3};
use place::find;

/// Number of batches in which bodies are laid, and the time for which each settles, characteristic times.
const BATCHES: usize = 5;
const BATCH_SETTLE: f64 = 0.3;
/// A settled pile leaves room on top: the number of times that props are laid there.
const ROUNDS: usize = 3;
/// Largest and smallest cell, as shares of the shortest edge of any prop.
const CELL: (f64, f64) = (1.0 / 5.0, 1.0 / 12.0);
/// Bound on the cells of the height field.
const MAX_CELLS: f64 = 200_000.0;
/// Failed tries in a row after which a prop of random size or rotation is given up. A prop without randomness is tried
/// once.
const VAIN: u32 = 24;

/// A prop as it is laid down.
struct Layable {
    /// About the centre of mass, at scale 1.
    triangles: Vec<[DVec3; 3]>,
    /// `None`: it has no flat side.
    lies: Option<StablePose>,
    /// Its poses in another one of its kind, for cups, bowls and plates; empty for other props.
    nesting_poses: Vec<NestingPose>,
}

impl Layable {
    fn nests(&self) -> bool {
        !self.nesting_poses.is_empty()
    }

    /// The cells that it covers, seen from above. `size`: its scale, in engine units.
    fn footprint(&self, rotation: DQuat, size: f64, cell: f64, shift: DVec2) -> Footprint {
        let triangles: Vec<_> = self.triangles.iter().map(|t| t.map(|p| rotation * (p * size))).collect();
        Footprint::new(&triangles, cell, shift)
    }
}

pub struct Stack;

impl Method for Stack {
    fn run(&mut self, filling: &mut Filling, pass: &Pass, observer: &mut dyn Observer) -> Result<bool, Error> {
        let full = stack(filling, pass, observer)?;
        // Props thrown in fill the room that a stack in disorder leaves.
        if filling.task.params.fill.lying() < 1.0 { Insert.run(filling, pass, observer) } else { Ok(full) }
    }
}

/// Lays props until there is no more room. Returns whether the container is full.
fn stack(filling: &mut Filling, pass: &Pass, observer: &mut dyn Observer) -> Result<bool, Error> {
    filling.point_gravity(DVec3::NEG_Y);
    let task = filling.task;
    let props: Vec<Layable> = task.scene.props.iter().zip(task.shapes).map(|(p, s)| layable(s, p)).collect();
    let mut field = field_of(&task, &props);
    let batch = task.expected.div_ceil(BATCHES).max(1);
    let (mut course, mut rounds) = (None, 0);
    loop {
        survey(filling, &props, &mut field);
        let before = filling.world.loose().count();
        let wanted = batch.min(pass.limit.saturating_sub(before));
        let more = lay(filling, pass, &props, &mut field, &mut course, wanted)?;
        filling.use_real_friction();
        filling.settle(BATCH_SETTLE, observer)?;
        filling.remove_escaped();
        filling.world.validate(pass.limit);
        let after = filling.world.loose().count();
        if after >= pass.limit {
            return Ok(false);
        }
        if !more {
            rounds += 1;
            if rounds == ROUNDS || (after.saturating_sub(before) as f64) < task.params.fill.full_below * before as f64 {
                return Ok(true);
            }
            filling.settle(task.params.fill.settle / 2.0, observer)?;
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
    let lies = up.map_or_else(|| flattest(shape), |up| Some(upright(shape, up)));
    let turns = |lies: &StablePose| match prop.stance.turns {
        Turns::None => 1,
        _ if lies.edges.x >= ROUND * lies.edges.y => 2,
        Turns::Quarter => 4,
        Turns::Any => TURNS,
    };
    let mut nesting_poses = lies.map_or_else(Vec::new, |lies| shape.nesting_poses(lies.up, turns(&lies)));
    nesting_poses.retain(|nesting| lies.is_some_and(|lies| nesting.pitch < NESTED * lies.height));
    Layable { triangles: triangles.map(|t| t.map(|p| p * unit)).collect(), lies, nesting_poses }
}

/// A prop nests if one on another is less high than this share of two.
const NESTED: f64 = 0.9;

/// A prop is as good as round if its length / width is at most this.
const ROUND: f64 = 1.1;
/// Number of rotations in which a round prop is tried in another one.
const TURNS: usize = 24;

/// An empty height field of the container, in cells into which the props fit.
fn field_of(task: &FillTask, props: &[Layable]) -> HeightField {
    let container = task.container;
    let bounds = container.bounds();
    let outline: Vec<DVec2> = bounds.points.iter().map(|p| DVec2::new(p.x, p.z)).collect();
    let (turn, extent) = smallest_rectangle(&outline);
    let mut edges: Vec<(f64, f64)> = Vec::new();
    for ((prop, layable), shape) in task.scene.props.iter().zip(props).zip(task.shapes) {
        let scale = (prop.scale[0] + prop.scale[1]) / 2.0 / task.units.length;
        let [long, short] = layable.lies.map_or([shape.size.diameter; 2], |lies| lies.edges.to_array());
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
    let mut field = HeightField::new(&bounds, container.base, DQuat::from_rotation_y(turn), best.max(least), LEEWAY);
    if !container.scenery().is_empty() {
        field.keep_free(LEEWAY, |p| container.free_along(p).unwrap_or_default());
    }
    field
}

/// A prop may be laid through the container's ceiling by this much, d: it is pushed back.
const LEEWAY: f64 = 0.02;
/// Number of cell edges that are compared, and the saving of a cell with the shortest edge against one of half of it.
const CELLS_TRIED: u32 = 60;
const FINE: f64 = 0.004;

/// Brings the height field up to date with the bodies as they lie now.
fn survey(filling: &Filling, props: &[Layable], field: &mut HeightField) {
    field.clear();
    let length = filling.task.units.length;
    let least = filling.task.least_thickness();
    for id in filling.world.present() {
        let placed = filling.world.instance(id);
        let triangles = props[placed.prop].triangles.iter();
        let triangles: Vec<_> =
            triangles.map(|t| t.map(|p| placed.pose.transform_point(p * placed.scale / length))).collect();
        field.put_as_it_lies(&triangles, id, least);
    }
}

/// Lays up to `wanted` props. Returns whether there may be room for more.
fn lay(
    filling: &mut Filling,
    pass: &Pass,
    props: &[Layable],
    field: &mut HeightField,
    course: &mut Option<Course>,
    wanted: usize,
) -> Result<bool, Error> {
    let (scene, order) = (filling.task.scene, filling.task.params.fill.order);
    let least = filling.task.least_thickness();
    let is_random = |i: usize| order < 1.0 || scene.props[i].scale[0] < scene.props[i].scale[1];
    let patience: Vec<u32> = (0..props.len()).map(|i| if is_random(i) { VAIN } else { 1 }).collect();
    // The props that may still find a place; how often each was drawn in vain since it last found one; and whether any
    // did since all were tried.
    let (mut tried, mut vain, mut any) = (pass.props.to_vec(), vec![0; props.len()], false);
    let mut laid = 0;
    while laid < wanted {
        let kind = kind(filling, &tried, course.as_ref());
        let (prop, scale, rotation) = match kind {
            Some(kind) => filling.draw(&[kind]),
            None => filling.draw(&tried),
        };
        match find(filling, pass, &props[prop], field, (prop, scale), rotation) {
            Some((_, footprint, spot))
                if kind.is_some() && course.as_ref().is_some_and(|c| c.is_below(&footprint, &spot)) =>
            {
                *course = None;
            }
            Some((pose, footprint, spot)) => {
                if kind.is_some() && course.is_none() {
                    *course = Some(Course { prop, height: spot.height });
                }
                let id = filling.insert(Instance { prop, scale, pose })?;
                field.put(&footprint, &spot, id, least);
                (laid, any, vain[prop]) = (laid + 1, true, 0);
            }
            None => {
                vain[prop] += 1;
                course.take_if(|course| course.prop == prop);
                if vain[prop] >= patience[prop] {
                    tried.retain(|&i| i != prop);
                }
            }
        }
        if tried.is_empty() {
            if !any && !field.go_on_above() {
                return Ok(false);
            }
            (tried, vain, any) = (pass.props.to_vec(), vec![0; props.len()], false);
        }
    }
    Ok(true)
}
