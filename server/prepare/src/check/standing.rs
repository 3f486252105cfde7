//! Where the pile stands: on scenery, on the ground, or on nothing.

use super::{CheckedScene, FLOATING};
use crate::container::EXACT;
use crate::surroundings::{self, Carrier, Surroundings};
use cairn_engine::shape::Size;
use cairn_engine::units::Units;
use cairn_geometry::interior::{DistanceGrid, MeshInterior};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::{ClosedMesh, RESOLUTION};
use cairn_input::params::Params;
use cairn_input::scene::Scene;
use glam::DVec3;
use std::collections::BTreeMap;

/// The findings about a shape with scenery around it.
#[derive(Default)]
pub struct Standing {
    /// The lowest of what carries the pile, m, where that is scenery.
    pub ground: Option<f64>,
    /// Shares of the shape's volume and surface that scenery leaves.
    pub room: Option<(f64, f64)>,
    /// The scenery around the shape.
    pub around: Option<Surroundings>,
    /// What carries the pile moves.
    pub rides: bool,
    pub warnings: Vec<String>,
}

/// A column of the shape: where its room begins, and what carries it.
struct Column {
    foot: f64,
    carrier: Option<Carrier>,
    /// A surface of scenery crosses it not far above its foot: one without a back leaves the room on its other side.
    crosses: bool,
}

/// Nodes of the grid are this much farther apart than those of the container's: this looks at the shape as a whole.
const COARSER: f64 = 2.0;
const MOST_NODES: usize = 250_000;
/// The pile's lowest part: columns whose foot is no higher above the lowest than this, d.
const LOWEST: f64 = 0.5;
/// If more than this share of the lowest part is above scenery, scenery carries the pile.
const MOST: f64 = 0.5;
/// The user is warned if more than this share of the foot of a shape that stands on scenery is above a hole in it.
const HOLE: f64 = 0.05;
/// The user is warned if more than this share of the foot is too steep.
const STEEP: f64 = 0.1;
/// Slopes face one way if their mean direction downhill, as a vector, is at least this long.
const ONE_WAY: f64 = 0.5;

/// Looks at what carries the shape. `diameter`: d, m.
pub fn of(
    scene: &Scene,
    params: &Params,
    control: &ClosedMesh,
    diameter: f64,
    shares: &[f64],
    sizes: &[Size],
) -> Standing {
    if scene.statics.is_empty() || !scene.is_filled(params) {
        return Standing::default();
    }
    let low = control.mesh.bounds().0.y;
    let ground = params.ground_height.unwrap_or(low);
    let Some(mut around) = Surroundings::new(scene, &control.mesh, params.ground.then_some(ground)) else {
        return Standing::default();
    };
    let units = Units::new(diameter, 1.0, params.gravity);
    let region = MeshInterior::new(&units.mesh_to_engine(&control.mesh));
    let mut grid = DistanceGrid::new(&region, COARSER * RESOLUTION, MOST_NODES, EXACT);
    let room = around.cut(&mut grid, &units, surroundings::least_radius(scene, sizes));
    let columns = columns(&around, &grid, &units, LOWEST * diameter);
    let mut standing = Standing { room: Some(room), ..Standing::default() };
    let lowest = columns.iter().map(|column| column.foot).fold(f64::INFINITY, f64::min);
    let lowest_part = || columns.iter().filter(|column| column.foot <= lowest + LOWEST * diameter);
    let carried = lowest_part().filter_map(|column| column.carrier).count();
    if carried as f64 > MOST * lowest_part().count() as f64 {
        let pieces = lowest_part().filter_map(|column| Some(around.lowest_of(column.carrier?.piece)));
        standing.ground = pieces.reduce(f64::min).filter(|_| params.ground_height.is_none());
        let moves = |column: &&Column| column.carrier.is_some_and(|on| !scene.statics[on.piece].keys.is_empty());
        standing.rides = lowest_part().filter(moves).count() as f64 > MOST * carried as f64;
    }
    let ground = params.ground.then_some(standing.ground.unwrap_or(ground));
    let error = grid.spacing() * diameter / 2.0;
    standing.warnings.extend(floats(scene, &columns, ground, FLOATING * diameter + error));
    if ground.is_none() {
        let foot: Vec<&Column> = lowest_part().collect();
        standing.warnings.extend(above_a_hole(scene, &foot, LOWEST * diameter));
    }
    standing.warnings.extend(steep(scene, &columns, ground, LOWEST * diameter, shares));
    standing.around = Some(around);
    standing
}

/// `reach`: what is not far above a foot, m.
fn columns(around: &Surroundings, grid: &DistanceGrid, units: &Units, reach: f64) -> Vec<Column> {
    let (origin, [nx, ny, nz], values) = grid.nodes();
    let h = grid.spacing();
    let mut columns = Vec::new();
    for (x, z) in (0..nz).flat_map(|z| (0..nx).map(move |x| (x, z))) {
        let value = |y: usize| values[(z * ny + y) * nx + x];
        let Some(first) = (0..ny).find(|&y| value(y) <= 0.0) else { continue };
        let inside = -value(first);
        let below = first.checked_sub(1).map_or(0.0, |y| value(y).max(0.0));
        // Where the distance is 0 between the two nodes; half a step below, where both are inside or one is on it.
        let share = if inside + below > 0.0 { inside / (inside + below) } else { 0.0 };
        let node = origin + DVec3::new(x as f64, first as f64, z as f64) * h;
        let foot = units.point_to_si(node - DVec3::Y * share * h);
        let carrier = around.carrier(foot + DVec3::Y * h * units.length / 2.0);
        let nearest = around.carrier(foot + DVec3::Y * reach);
        let crosses = nearest.is_some_and(|nearest| nearest.height > foot.y);
        columns.push(Column { foot: foot.y, carrier, crosses });
    }
    columns
}

/// A shape that touches nothing below it. `most`: a gap that is none, m.
fn floats(scene: &Scene, columns: &[Column], ground: Option<f64>, most: f64) -> Option<String> {
    let gap = |column: &Column| {
        let scenery = column.carrier.map_or(f64::NEG_INFINITY, |carrier| carrier.height);
        column.foot - scenery.max(ground.unwrap_or(f64::NEG_INFINITY))
    };
    let (gap, column) = columns.iter().map(|c| (gap(c), c)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    if gap <= most || columns.iter().any(|column| column.crosses) {
        return None;
    }
    let name = scene.control.as_ref().map_or("", |model| &model.name);
    let onto = match column.carrier.filter(|carrier| ground.is_none_or(|ground| carrier.height > ground)) {
        Some(carrier) => format!("onto {}", scene.statics[carrier.piece].model.name),
        None if gap.is_finite() => "onto the ground".into(),
        None => {
            return Some(format!(
                "{name}: nothing is below it: the pile starts there, and falls past the scenery; move it over scenery, \
                 or set ground = true"
            ));
        }
    };
    Some(format!(
        "{name}: it touches nothing: the pile starts there and falls {gap:.3} m {onto}; move the control mesh down, or \
         add scenery below it"
    ))
}

/// A foot of which a part is above a hole of the scenery that carries the rest. `most`: a gap that is none, m.
fn above_a_hole(scene: &Scene, foot: &[&Column], most: f64) -> Option<String> {
    let stands =
        |column: &Column| column.crosses || column.carrier.is_some_and(|carrier| column.foot - carrier.height <= most);
    let open = foot.iter().filter(|column| !stands(column)).count();
    let share = open as f64 / foot.len().max(1) as f64;
    let name = scene.control.as_ref().map_or("", |model| &model.name);
    (share > HOLE && open < foot.len()).then(|| {
        format!(
            "{name}: {:.0} % of its foot is above a hole in the scenery: what is there falls, or is held by glue \
             alone; move the control mesh, or add scenery below it",
            100.0 * share
        )
    })
}

/// A foot that slides: on slopes that friction does not hold, and that do not face each other as those of a bowl do.
/// `most`: what is this near below, m, carries.
fn steep(scene: &Scene, columns: &[Column], ground: Option<f64>, most: f64, shares: &[f64]) -> Option<String> {
    let all: f64 = shares.iter().sum();
    let own = scene.props.iter().zip(shares).map(|(prop, share)| prop.friction * share / all).sum::<f64>();
    let mut slides = BTreeMap::<usize, Vec<f64>>::new();
    let mut downhill = DVec3::ZERO;
    let mut touching = 0;
    for column in columns {
        let carrier = column.carrier.filter(|carrier| column.foot - carrier.height <= most);
        let on_ground = ground.is_some_and(|ground| column.foot - ground <= most);
        touching += usize::from(carrier.is_some() || on_ground);
        let Some(carrier) = carrier.filter(|carrier| ground.is_none_or(|ground| carrier.height > ground)) else {
            continue;
        };
        let friction = (own + scene.statics[carrier.piece].friction) / 2.0;
        let slope = libm::acos(carrier.up.y.min(1.0));
        if libm::tan(slope) > friction {
            slides.entry(carrier.piece).or_default().push(slope);
            downhill += carrier.up.with_y(0.0).normalize_or_zero();
        }
    }
    let sliding: usize = slides.values().map(Vec::len).sum();
    if sliding as f64 <= STEEP * touching as f64 || downhill.length() < ONE_WAY * sliding as f64 {
        return None;
    }
    let (&piece, slopes) = slides.iter().max_by_key(|(_, slopes)| slopes.len())?;
    let mut slopes = slopes.clone();
    slopes.sort_by(f64::total_cmp);
    let angle = slopes[slopes.len() / 2].to_degrees();
    let friction = (own + scene.statics[piece].friction) / 2.0;
    let name = scene.control.as_ref().map_or("", |model| &model.name);
    Some(format!(
        "{name}: {:.0} % of its foot is on slopes that friction does not hold, of {angle:.0} degrees on {}; friction \
         {friction:.2} holds up to {:.0} degrees: raise statics.{piece}.friction or the props', or the pile slides",
        100.0 * sliding as f64 / touching as f64,
        scene.statics[piece].model.name,
        libm::atan(friction).to_degrees()
    ))
}

impl CheckedScene {
    /// Shares of the shape's volume and surface that scenery leaves.
    pub fn room_shares(&self) -> (f64, f64) {
        self.room.unwrap_or((1.0, 1.0))
    }
}

/// A warning about a small base. The base is the part of the underside within `height` (a share of the mesh's height)
/// above the ground: a pour's opening is cut there, and the pile stands on it. It is small for a ball, hooves, a hill
/// with a hollow underside.
pub fn base(name: &str, mesh: &TriMesh, ground: f64, height: f64) -> Option<String> {
    let cut = ground + height * (mesh.bounds().1.y - ground);
    let (mut underside, mut base) = (0.0, 0.0);
    for i in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(i);
        // Seen from below, m^2.
        let area = -(b - a).cross(c - a).y / 2.0;
        if area > 0.0 {
            underside += area;
            base += if a.y.max(b.y).max(c.y) <= cut { area } else { 0.0 };
        }
    }
    (base < super::MOST * underside).then(|| {
        let share = 100.0 * base / underside;
        let cut = cut - ground;
        format!(
            "{name}: the pile stands on a small foot: {share:.0} % of its underside lies within {cut:.3} m of the \
             ground (base.height), where a pour enters, too; flatten the underside, or raise base.height"
        )
    })
}
