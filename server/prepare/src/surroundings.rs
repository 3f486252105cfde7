//! What takes room in a shape: the room of a fill is what is inside the shape and outside of all scenery.
//!
//! Closed pieces of scenery are solid. Open ones are sheets of no thickness: there is room on both sides, but not below
//! a landscape, which is a sheet that nothing lies below and that covers the shape on all sides. SI.

use cairn_engine::shape::Size;
use cairn_engine::units::Units;
use cairn_geometry::interior::{Bvh, DistanceGrid, MeshInterior};
use cairn_geometry::mesh::{self, TriMesh, box_holds, boxes_meet};
use cairn_geometry::pose::Pose;
use cairn_geometry::topology::{self, WELD_TOLERANCE};
use cairn_input::scene::{Scene, StaticModel};
use glam::DVec3;
use std::collections::HashMap;
use std::fmt;
use std::sync::{Mutex, PoisonError};

/// The scenery around a shape.
pub struct Surroundings {
    /// The union of the closed pieces that reach into the shape.
    solid: Option<MeshInterior>,
    /// The sheets near the shape, and closed pieces that the shape is inside of.
    sheets: Option<Bvh>,
    /// All triangles above and below the shape and around it; each one's name is its place in `triangles`.
    all: Bvh,
    triangles: Vec<Source>,
    /// Lowest point of what each piece stands on or is joined to, m. Shape `[piece]`.
    lowest: Vec<f64>,
    /// Of the shape.
    bounds: (DVec3, DVec3),
    /// Below this height, the ground carries; `None`: there is none.
    ground: Option<f64>,
    /// Whether room below a landscape counts as taken.
    covers: bool,
}

/// Where a triangle comes from.
#[derive(Clone, Copy)]
struct Source {
    /// Index of the piece in the scene's `statics`.
    piece: u32,
    is_sheet: bool,
    /// Its unit normal on its upper side.
    up: DVec3,
    /// Of its plane along that normal, m.
    offset: f64,
}

/// A plane of scenery that a line crosses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossed {
    /// Index into the scene's `statics`.
    pub piece: usize,
    /// Unit.
    pub normal: DVec3,
    /// Of the plane along its normal, m.
    pub offset: f64,
}

/// A stretch of a vertical line between scenery.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    pub low: f64,
    pub high: f64,
    /// Not room: in a solid, or below a landscape.
    pub taken: bool,
}

/// What carries a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carrier {
    /// Height of its surface, m.
    pub height: f64,
    /// Index into the scene's `statics`.
    pub piece: usize,
    /// Unit normal of its surface, upward.
    pub up: DVec3,
}

/// Scenery farther beside the shape than this, in the shape's largest edge, is left out.
const NEAR: f64 = 1.0;
/// A closed mesh whose volume is less than this share of its area times its diagonal is a sheet with two sides.
const FLAT: f64 = 1e-5;
/// Props count as this much thinner than they are: a rounded one fits where its box does not.
const ROUNDING: f64 = 0.9;
/// Corners, and middles of triangles, of the shape at which a closed piece is asked whether the shape is inside of it.
const ASKED: usize = 64;
/// A landscape covers the shape on so many of eight sides, this far beyond it, in its largest edge.
const COVERED: usize = 6;
const BEYOND: f64 = 0.05;
/// Columns of the distance grid, along each axis, that share an answer to that.
const BLOCK: f64 = 4.0;
/// If less than this share of the shape is room below the rule of landscapes, the shape is inside a closed room.
const NO_ROOM: f64 = 0.02;
/// Pieces this near to each other, in the diagonal of the scenery, are joined.
const JOINED: f64 = 1e-3;
/// No vertical line runs exactly through the edges of a modeller's grid: lines are moved by this share of the shape's
/// largest edge.
const ASIDE: [f64; 2] = [4.1e-7, 2.3e-7];

impl fmt::Debug for Surroundings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Surroundings").field("ground", &self.ground).finish_non_exhaustive()
    }
}

impl Surroundings {
    /// The scenery of a scene around a closed shape; `None` without any near it. `ground`: the height at which the
    /// ground is, if there is one.
    pub fn new(scene: &Scene, shape: &TriMesh, ground: Option<f64>) -> Option<Surroundings> {
        let bounds = shape.bounds();
        let extent = (bounds.1 - bounds.0).max_element();
        let meshes: Vec<TriMesh> = scene.statics.iter().map(placed).collect();
        let near =
            |piece: (DVec3, DVec3)| boxes_meet(piece, bounds, DVec3::new(NEAR * extent, f64::INFINITY, NEAR * extent));
        let (mut solid, mut sheets) = (TriMesh::default(), Vec::new());
        let (mut all, mut triangles) = (Vec::new(), Vec::new());
        for (piece, mesh) in meshes.iter().enumerate() {
            if !near(mesh.bounds()) {
                continue;
            }
            let welded = topology::weld(mesh, WELD_TOLERANCE);
            for part in topology::parts(&welded) {
                let part = topology::weld(&TriMesh { points: welded.points.clone(), triangles: part }, 0.0);
                let own = part.bounds();
                if !near(own) {
                    continue;
                }
                let closed = closed(&part).filter(|closed| !holds(closed, shape));
                let is_sheet = closed.is_none();
                let part = closed.unwrap_or(part);
                if !is_sheet && boxes_meet(own, bounds, DVec3::ZERO) {
                    solid.append(&part);
                }
                for corners in (0..part.triangles.len()).map(|i| part.corners(i)) {
                    if !near(mesh::bounds(corners.into_iter())) {
                        continue;
                    }
                    let [a, b, c] = corners;
                    let normal = (b - a).cross(c - a).normalize_or_zero();
                    let up = if normal.y < 0.0 { -normal } else { normal };
                    if is_sheet {
                        sheets.push((sheets.len() as u32, corners));
                    }
                    all.push((triangles.len() as u32, corners));
                    triangles.push(Source { piece: piece as u32, is_sheet, up, offset: a.dot(up) });
                }
            }
        }
        (!all.is_empty()).then(|| Surroundings {
            solid: (!solid.triangles.is_empty()).then(|| MeshInterior::new(&solid)),
            sheets: (!sheets.is_empty()).then(|| Bvh::new(sheets)),
            all: Bvh::new(all),
            triangles,
            lowest: lowest(&meshes),
            bounds,
            ground,
            covers: true,
        })
    }

    /// The same scenery, not cut out of anything yet, with the ground at another height; `None`: there is none.
    pub fn on_ground(self, ground: Option<f64>) -> Surroundings {
        Surroundings { ground, covers: true, ..self }
    }

    /// Whether a point is in a solid piece.
    pub fn is_solid_at(&self, p: DVec3) -> bool {
        self.solid.as_ref().is_some_and(|solid| solid.contains(p))
    }

    /// Depth of a point in the solid pieces, m; 0 outside.
    pub fn depth(&self, p: DVec3) -> f64 {
        self.solid.as_ref().map_or(0.0, |solid| (-solid.signed_distance(p)).max(0.0))
    }

    /// The surface that the line from one point to another meets, if there is one.
    pub fn between(&self, from: DVec3, to: DVec3) -> Option<Crossed> {
        let name = self.all.between(from, to)?;
        let source = self.triangles[name as usize];
        Some(Crossed { piece: source.piece as usize, normal: source.up, offset: source.offset })
    }

    /// Leaves only the room in a distance grid of the shape, in engine units, without what scenery makes too narrow for
    /// a ball of this radius, m. Returns the shares of volume and surface that this changes: what is left over what was
    /// there.
    pub fn cut(&mut self, distance: &mut DistanceGrid, units: &Units, radius: f64) -> (f64, f64) {
        let before = distance.clone();
        let volume = |grid: &DistanceGrid| grid.nodes().2.iter().filter(|value| **value <= 0.0).count() as f64;
        self.cut_once(distance, units);
        if self.covers && volume(distance) < NO_ROOM * volume(&before) {
            self.covers = false;
            *distance = before.clone();
            self.cut_once(distance, units);
        }
        distance.remove_narrow(&before, radius / units.length);
        let near = |grid: &DistanceGrid| {
            let band = -grid.spacing()..=0.0;
            grid.nodes().2.iter().filter(|value| band.contains(*value)).count() as f64
        };
        let ratio = |of: &dyn Fn(&DistanceGrid) -> f64| of(distance) / of(&before).max(1.0);
        (ratio(&volume), ratio(&near))
    }

    fn cut_once(&self, distance: &mut DistanceGrid, units: &Units) {
        let reach = 2.0 * distance.spacing();
        if let Some(solid) = &self.solid {
            distance.cut_out_region(solid, (units.length, units.origin), reach);
        }
        let Some(sheets) = &self.sheets else { return };
        let answers = Mutex::new(HashMap::new());
        let (h, block) = (distance.spacing(), BLOCK * distance.spacing() * units.length);
        distance.raise_columns(reach, |foot, column| {
            let at = |y: usize| units.point_to_si(foot + DVec3::Y * (y as f64 * h));
            let gaps = self.gaps_with(at(0), |p| {
                let key = ((p - self.bounds.0) / block).floor().to_array().map(|n| n as i64);
                // Computed where the block begins, so that the order of columns does not matter.
                let place =
                    self.bounds.0 + (DVec3::from_array(key.map(|n| n as f64)) + DVec3::new(0.5, 0.0, 0.5)) * block;
                let known = answers.lock().unwrap_or_else(PoisonError::into_inner).get(&key).copied();
                known.unwrap_or_else(|| {
                    let covered = self.is_covered(place);
                    *answers.lock().unwrap_or_else(PoisonError::into_inner).entry(key).or_insert(covered)
                })
            });
            let mut guess = 0;
            let raised = column.iter().enumerate().map(|(y, value)| {
                if *value > reach {
                    return *value;
                }
                let p = at(y);
                let Some(hit) = sheets.nearest(p, guess) else { return *value };
                guess = hit.place;
                let away = hit.squared.sqrt() / units.length;
                let taken = gaps.iter().any(|gap| gap.taken && gap.low < p.y && p.y < gap.high);
                if taken && !self.is_solid_at(p) { away } else { -away }
            });
            raised.collect()
        });
    }

    /// The gaps of the vertical line through a point, from below.
    pub fn gaps(&self, p: DVec3) -> Vec<Gap> {
        self.gaps_with(p, |p| self.is_covered(p))
    }

    fn gaps_with(&self, p: DVec3, covered: impl Fn(DVec3) -> bool) -> Vec<Gap> {
        let (x, z) = self.aside(p);
        let met = self.all.column(x, z);
        let heights = met.iter().map(|(y, _)| *y);
        let ends: Vec<f64> = [f64::NEG_INFINITY].into_iter().chain(heights).chain([f64::INFINITY]).collect();
        let mut gaps = Vec::with_capacity(ends.len() - 1);
        for (i, ends) in ends.windows(2).enumerate() {
            let [low, high] = [ends[0], ends[1]];
            let reached = [low.max(self.bounds.0.y), high.min(self.bounds.1.y)];
            if low == high || reached[0] >= reached[1] {
                gaps.push(Gap { low, high, taken: false });
                continue;
            }
            let middle = DVec3::new(x, (reached[0] + reached[1]) / 2.0, z);
            let is_below_sheet = met[i..].iter().any(|(_, name)| self.triangles[*name as usize].is_sheet);
            let is_below_landscape = || self.covers && i == 0 && is_below_sheet && self.is_void(middle, &covered);
            gaps.push(Gap { low, high, taken: self.is_solid_at(middle) || is_below_landscape() });
        }
        gaps
    }

    /// Whether nothing can lie at a place below a sheet that has no scenery below it.
    fn is_void(&self, p: DVec3, covered: impl Fn(DVec3) -> bool) -> bool {
        self.ground.is_none_or(|ground| p.y < ground) || covered(p)
    }

    /// Whether scenery is above a place, or in the way, on nearly all sides just beyond the shape.
    fn is_covered(&self, p: DVec3) -> bool {
        let (low, high) = self.bounds;
        let beyond = BEYOND * (high - low).max_element();
        let is_closed = |k: usize| {
            let angle = std::f64::consts::TAU * (k as f64 + 0.1) / 8.0;
            let way = DVec3::new(libm::cos(angle), 0.0, libm::sin(angle));
            // To where the line leaves the shape's box.
            let to = |axis: usize| match way[axis] {
                w if w > 0.0 => (high[axis] - p[axis]).max(0.0) / w,
                w => (low[axis] - p[axis]).min(0.0) / w,
            };
            let end = p + way * (to(0).min(to(2)) + beyond);
            let (x, z) = self.aside(end);
            self.all.is_between(p, end) || self.all.column(x, z).last().is_some_and(|(y, _)| *y > p.y)
        };
        (0..8).filter(|&k| is_closed(k)).count() >= COVERED
    }

    /// What carries a point that is no lower than its surface.
    pub fn carrier(&self, p: DVec3) -> Option<Carrier> {
        let (x, z) = self.aside(p);
        let (height, name) = self.all.column(x, z).into_iter().rfind(|(y, _)| *y <= p.y)?;
        let source = self.triangles[name as usize];
        Some(Carrier { height, piece: source.piece as usize, up: source.up })
    }

    /// Lowest point of a piece and of what it is joined to, m.
    pub fn lowest_of(&self, piece: usize) -> f64 {
        self.lowest[piece]
    }

    fn aside(&self, p: DVec3) -> (f64, f64) {
        let extent = (self.bounds.1 - self.bounds.0).max_element();
        (p.x + ASIDE[0] * extent, p.z + ASIDE[1] * extent)
    }
}

/// Radius of a ball that is as thick as the thinnest prop that is drawn, or nearly, m.
pub fn least_radius(scene: &Scene, sizes: &[Size]) -> f64 {
    let drawn = scene.props.iter().zip(sizes).filter(|(prop, _)| prop.weight > 0.0);
    let thickness = drawn.map(|(prop, size)| size.extents.x * prop.scale[0]).fold(f64::INFINITY, f64::min);
    if thickness.is_finite() { ROUNDING * thickness / 2.0 } else { 0.0 }
}

/// A piece as it stands in the first frame.
pub fn placed(model: &StaticModel) -> TriMesh {
    let Pose { translation, rotation } = model.pose_at(0.0);
    let mesh = &model.model.mesh;
    if model.keys.is_empty() {
        return mesh.clone();
    }
    let points = mesh.points.iter().map(|&p| rotation * p + translation).collect();
    TriMesh { points, triangles: mesh.triangles.clone() }
}

/// A part that bounds a solid, facing outward.
fn closed(part: &TriMesh) -> Option<TriMesh> {
    let found = topology::inspect(part);
    if !found.closed {
        return None;
    }
    let (part, _) = topology::oriented(part);
    let volume = part.signed_volume();
    (volume > FLAT * found.area * found.diagonal).then_some(part)
}

/// Whether all of a shape is inside a closed mesh: nothing of its surface outside, and nothing of the mesh in it, as of
/// a crate whose walls hold the shape's surface.
fn holds(closed: &TriMesh, shape: &TriMesh) -> bool {
    if !box_holds(closed.bounds(), shape.bounds()) {
        return false;
    }
    let around = MeshInterior::new(closed);
    if !asked(shape).all(|p| around.contains(p)) {
        return false;
    }
    let inside = MeshInterior::new(shape);
    asked(closed).all(|p| !inside.contains(p))
}

/// Some corners of a mesh and some middles of its triangles.
fn asked(mesh: &TriMesh) -> impl Iterator<Item = DVec3> + '_ {
    let step = |count: usize| count.div_ceil(ASKED).max(1);
    let middle = |i: usize| mesh.corners(i).into_iter().sum::<DVec3>() / 3.0;
    let middles = (0..mesh.triangles.len()).step_by(step(mesh.triangles.len())).map(middle);
    mesh.points.iter().copied().step_by(step(mesh.points.len())).chain(middles)
}

/// The lowest point of each mesh and of all that it is joined to by touching boxes.
fn lowest(meshes: &[TriMesh]) -> Vec<f64> {
    let boxes: Vec<(DVec3, DVec3)> = meshes.iter().map(TriMesh::bounds).collect();
    let (low, high) =
        boxes.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), (l, h)| (a.min(*l), b.max(*h)));
    let reach = JOINED * low.distance(high);
    let mut sets = topology::DisjointSets::new(boxes.len());
    for (i, a) in boxes.iter().enumerate() {
        for (k, b) in boxes.iter().enumerate().take(i) {
            if boxes_meet(*b, *a, DVec3::splat(reach)) {
                sets.join(i, k);
            }
        }
    }
    let mut lowest = HashMap::<usize, f64>::new();
    for (i, bounds) in boxes.iter().enumerate() {
        let least = lowest.entry(sets.find(i)).or_insert(f64::INFINITY);
        *least = least.min(bounds.0.y);
    }
    (0..boxes.len()).map(|i| lowest[&sets.find(i)]).collect()
}
