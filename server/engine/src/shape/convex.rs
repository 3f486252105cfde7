//! Convex hulls and approximate convex decomposition, each with its measured distance from the mesh. What is chosen is
//! then simplified from outside.

use crate::shape::deviation::{deviation, mesh_contains};
use crate::shape::enclose::{Margin, enclosing};
use crate::shape::hull::Hull;
use crate::shape::{INVISIBLE, SKIN, Solid};
use cairn_geometry::SINGLE_PRECISION;
use cairn_geometry::hull::convex_hull;
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::mesh::TriMesh;
use cairn_input::params::{Physics, Switch};
use glam::DVec3;
use rapier3d::math::Vector;
use rapier3d::parry::query::PointQuery;
use rapier3d::parry::shape::TriMesh as EngineMesh;
use rapier3d::parry::transformation::vhacd::{VHACD, VHACDParameters};
use rapier3d::parry::transformation::voxelization::FillMode;
use std::cell::OnceCell;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Most corners of a prop that is one hull. The masks of a [`Hull`] have bits for 128.
pub(super) const MOST_CORNERS: usize = 96;
/// Most corners of one of several parts. They cost more, for each pair that is near.
const MOST_PART_CORNERS: usize = 40;
/// A hull of no more corners is not simplified: it is cheap, and what it lies on stays as it is.
const FEW_CORNERS: usize = 16;
/// Corners of a hull by which the deviation is measured.
const SKETCH_POINTS: usize = 48;
/// A plate around a flat part stands out by no more, in prop diameters: beyond, its corners are spikes.
const MOST_FLAT_OUT: f64 = 0.02;

/// A solid that stands for a prop.
pub struct Fitted {
    pub solid: Solid,
    /// The same without the skin around its hulls.
    pub bare: Solid,
    /// Largest distance, both ways, between sampled points of mesh and shape, m.
    pub deviation: f64,
}

/// How large a prop is, m.
#[derive(Clone, Copy)]
pub struct Extent {
    pub diameter: f64,
    pub thickness: f64,
    /// How far its mesh may be from the one that is shown.
    pub off: f64,
}

/// One hull where that is close enough to the mesh, else up to `max_parts` convex parts, with few corners.
pub fn decompose(mesh: &TriMesh, extent: Extent, closed: bool, physics: &Physics) -> Fitted {
    let Extent { diameter, thickness, off } = extent;
    let unit = Unit::new(mesh, diameter, closed);
    let mut best = vec![Part::of(&unit.points)];
    let mut best_deviation = unit.deviation(&best);
    let tolerance = tolerance(physics);
    if physics.max_parts > 1 && best_deviation > tolerance {
        for concavity in CONCAVITIES {
            let Some(parts) = unit.vhacd(concavity, physics.max_parts) else { continue };
            let found = unit.deviation(&parts);
            if found < best_deviation {
                (best, best_deviation) = (parts, found);
            }
            if best_deviation <= tolerance {
                break;
            }
        }
    }
    let gap = physics.shape_gap * thickness / diameter;
    let most = if best.len() > 1 { MOST_PART_CORNERS } else { MOST_CORNERS };
    let skin = SKIN * gap;
    let mut farthest = 0.0f64;
    let mut enclosed = |part: &Part, own: f64| {
        let tolerance = if part.exact.len() <= FEW_CORNERS { 0.0 } else { gap - skin };
        let margin = Margin { tolerance, skin: own, most };
        match enclosing(&part.exact, margin) {
            Some((corners, gap)) => {
                farthest = farthest.max(gap + own);
                corners
            }
            // Flat: the skin makes it a plate.
            None => {
                let thick = skin as f32;
                let around = |p: &Vector| Vector::AXES.map(|axis| [*p + axis * thick, *p - axis * thick]);
                let plate: Vec<Vector> = part.exact.iter().flat_map(around).flatten().collect();
                let out = |corners: &[Vector]| {
                    let near = |c: &Vector| part.exact.iter().map(|p| p.distance(*c)).fold(f32::INFINITY, f32::min);
                    f64::from(corners.iter().map(near).fold(0.0, f32::max))
                };
                let simple = enclosing(&plate, margin).map(|(corners, _)| corners);
                let corners = simple.filter(|corners| out(corners) <= MOST_FLAT_OUT).unwrap_or_else(|| {
                    let own = hull_points(&plate);
                    if own.len() <= most { own } else { part.coarse.clone() }
                });
                farthest = farthest.max(out(&corners));
                corners
            }
        }
    };
    let [solid, bare] = [skin, 0.0]
        .map(|own| own.max(off / diameter))
        .map(|own| Solid::Convex(best.iter().map(|part| unit.back(enclosed(part, own))).collect()));
    Fitted { solid, bare, deviation: best_deviation.max(farthest) * diameter + off }
}

/// A convex part of a mesh, in the unit frame.
pub(super) struct Part {
    /// The corners of its hull.
    exact: Vec<Vector>,
    /// Those from which no other stands out by more than [`INVISIBLE`].
    pub(super) coarse: Vec<Vector>,
}

impl Part {
    fn of(points: &[Vector]) -> Part {
        let exact = hull_points(points);
        Part { coarse: reduced(&exact, INVISIBLE), exact }
    }
}

/// The deviation allowed, in prop diameters.
fn tolerance(physics: &Physics) -> f64 {
    match physics.switches.decomposition {
        Switch::Auto => physics.shape_tolerance,
        Switch::On => 0.0,
        Switch::Off => f64::INFINITY,
    }
}

/// Largest distance, both ways, between sampled points of a mesh and of the hull of these corners, m.
pub fn distance(mesh: &TriMesh, diameter: f64, closed: bool, corners: &[DVec3]) -> f64 {
    let unit = Unit::new(mesh, diameter, closed);
    let corners: Vec<Vector> = corners.iter().map(|&p| ((p - unit.origin) / diameter).as_vec3()).collect();
    let found = unit.deviation(&[Part::of(&corners)]);
    if found > SINGLE_PRECISION { found * diameter } else { 0.0 }
}

/// Whether one hull is close enough: known without a decomposition.
pub fn is_one_hull(mesh: &TriMesh, diameter: f64, closed: bool, physics: &Physics) -> bool {
    let unit = Unit::new(mesh, diameter, closed);
    physics.max_parts == 1 || unit.deviation(&[Part::of(&unit.points)]) <= tolerance(physics)
}

/// From coarse to fine: the first that is close enough is the cheapest to simulate.
const CONCAVITIES: [f32; 3] = [0.06, 0.02, 0.008];

/// A prop's mesh, scaled to the diameter 1.
struct Unit<'a> {
    points: Vec<Vector>,
    triangles: &'a [[u32; 3]],
    /// `None` where the geometry library refuses the mesh.
    reference: Option<EngineMesh>,
    closed: bool,
    /// The inside of an open mesh, where it is needed.
    inside: OnceCell<MeshInterior>,
    origin: DVec3,
    diameter: f64,
}

impl<'a> Unit<'a> {
    fn new(mesh: &'a TriMesh, diameter: f64, closed: bool) -> Unit<'a> {
        let origin = mesh.bounds().0;
        let points: Vec<Vector> = mesh.points.iter().map(|&p| ((p - origin) / diameter).as_vec3()).collect();
        let reference = EngineMesh::new(points.clone(), mesh.triangles.clone()).ok();
        Unit { points, triangles: &mesh.triangles, reference, closed, inside: OnceCell::new(), origin, diameter }
    }

    fn back(&self, points: Vec<Vector>) -> Vec<DVec3> {
        points.into_iter().map(|p| p.as_dvec3() * self.diameter + self.origin).collect()
    }

    /// In prop diameters.
    fn deviation(&self, parts: &[Part]) -> f64 {
        let is_inside = |mesh: &EngineMesh, p: Vector| match self.closed {
            true => mesh_contains(mesh, p),
            // One hull is judged by its whole surface: that of a sheet is on both sides of it.
            false => parts.len() > 1 && self.inside().contains(p.as_dvec3()),
        };
        self.reference.as_ref().map_or(0.0, |mesh| deviation(mesh, |p| is_inside(mesh, p), parts))
    }

    /// By winding numbers, which give a hole its natural cap.
    fn inside(&self) -> &MeshInterior {
        let mesh = || TriMesh {
            points: self.points.iter().map(|p| p.as_dvec3()).collect(),
            triangles: self.triangles.to_vec(),
        };
        self.inside.get_or_init(|| MeshInterior::new(&mesh()))
    }

    fn vhacd(&self, concavity: f32, max_parts: u32) -> Option<Vec<Part>> {
        // The inside of an open mesh counts, too. Where a hole is wider than a voxel, the parts are of its surface.
        let fill_mode = FillMode::FloodFill { detect_cavities: false };
        let params = VHACDParameters { concavity, fill_mode, ..VHACDParameters::default() };
        // Without a split, one hull is the answer, and the report states its deviation.
        let parts = split(&params, &self.points, self.triangles)?;
        // A part of an open mesh may have no corner at all.
        let solid = parts.into_iter().filter(|points| points.len() >= 4);
        let parts: Vec<Part> = solid.map(|points| Part::of(&points)).filter(|p| p.coarse.len() >= 4).collect();
        (!parts.is_empty() && parts.len() <= max_parts as usize).then_some(parts)
    }
}

/// Tests of a triangle against a voxel that a split may take: half a minute of one core. Fine meshes take a few for
/// each triangle; only very many triangles that are as large as the mesh itself take more.
const MOST_VOXEL_TESTS: f64 = 5e7;

/// Voxels in the boxes around the triangles.
fn voxel_tests(resolution: u32, points: &[Vector], triangles: &[[u32; 3]]) -> f64 {
    let bounds = |points: &mut dyn Iterator<Item = Vector>| {
        points.fold((Vector::INFINITY, Vector::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    };
    let (low, high) = bounds(&mut points.iter().copied());
    let voxel = (high - low).max_element() / resolution as f32;
    let of = |triangle: &[u32; 3]| {
        let (low, high) = bounds(&mut triangle.iter().map(|&v| points[v as usize]));
        f64::from(((high - low) / voxel + 1.0).element_product())
    };
    triangles.iter().map(of).sum()
}

/// The exact hulls of what the mesh is split into. `None` where the library panics, as it does on some dirty meshes,
/// and where it would take too long.
pub(super) fn split(params: &VHACDParameters, points: &[Vector], triangles: &[[u32; 3]]) -> Option<Vec<Vec<Vector>>> {
    if voxel_tests(params.resolution, points, triangles) > MOST_VOXEL_TESTS {
        return None;
    }
    let parts = catch_unwind(AssertUnwindSafe(|| {
        let split = VHACD::decompose(params, points, triangles, true);
        split.compute_exact_convex_hulls(points, triangles)
    }));
    Some(parts.ok()?.into_iter().map(|(points, _)| points).collect())
}

/// Corners of the hull, or the points themselves where they have none.
fn hull_points(points: &[Vector]) -> Vec<Vector> {
    convex_hull(points).map_or_else(|| points.to_vec(), |(corners, _)| corners)
}

/// At most [`SKETCH_POINTS`] of a hull's corners: from the extreme ones along the axes on, always the one farthest
/// from the hull of those before it, as far as that is more than `tolerance`.
pub(super) fn reduced(points: &[Vector], tolerance: f32) -> Vec<Vector> {
    let extreme = |direction: Vector| {
        let key = |&i: &usize| points[i].dot(direction);
        (0..points.len()).max_by(|a, b| key(a).total_cmp(&key(b))).unwrap_or(0)
    };
    let axes = [Vector::X, Vector::Y, Vector::Z];
    let mut kept: Vec<usize> = axes.iter().flat_map(|&a| [extreme(a), extreme(-a)]).collect();
    kept.sort_unstable();
    kept.dedup();
    // What is outside of a hull was so of each hull before: no distance grows, so that few are asked for again.
    let mut bounds = vec![f32::INFINITY; points.len()];
    while kept.len() < SKETCH_POINTS.min(points.len()) {
        let corners: Vec<Vector> = kept.iter().map(|&i| points[i]).collect();
        let hull = Hull::new(&corners);
        let outside = |p: Vector| match &hull {
            Some(hull) => hull.distance_to_local_point(p, true),
            // Flat so far.
            None => corners.iter().map(|c| c.distance(p)).fold(f32::INFINITY, f32::min),
        };
        // The last of the farthest; the most promising one first.
        let mut far: Option<(f32, usize)> = None;
        let first = (0..points.len()).max_by(|&a, &b| bounds[a].total_cmp(&bounds[b]));
        for i in first.into_iter().chain(0..points.len()) {
            if far.is_none_or(|(most, _)| bounds[i] >= most) {
                bounds[i] = outside(points[i]);
                if far.is_none_or(|found| (bounds[i], i) > found) {
                    far = Some((bounds[i], i));
                }
            }
        }
        match far {
            Some((distance, i)) if distance > tolerance => kept.push(i),
            _ => break,
        }
    }
    kept.into_iter().map(|i| points[i]).collect()
}

/// The hull of some points as a closed mesh.
pub fn hull_mesh(points: &[DVec3]) -> TriMesh {
    let near: Vec<Vector> = points.iter().map(|p| p.as_vec3()).collect();
    let Some((corners, triangles)) = convex_hull(&near) else { return TriMesh::default() };
    TriMesh { points: corners.into_iter().map(|p| p.as_dvec3()).collect(), triangles }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Size;
    use crate::shape::deviation::surface_samples;
    use cairn_geometry::topology::weld;
    use cairn_input::params::{Accuracy, Params};

    #[test]
    fn a_split_that_would_take_too_long_is_none() {
        let params = VHACDParameters::default();
        // Each across the whole mesh.
        let across = |count: u32| -> (Vec<Vector>, Vec<[u32; 3]>) {
            let third = |i: u32| Vector::new(i as f32 / count as f32, 0.0, 1.0);
            let points = [Vector::ZERO, Vector::ONE].into_iter().chain((0..count).map(third)).collect();
            (points, (0..count).map(|i| [0, 1, i + 2]).collect())
        };
        let (points, triangles) = across(4000);
        assert_eq!(split(&params, &points, &triangles), None);
        let trough = trough(false);
        let points: Vec<Vector> = trough.points.iter().map(|p| p.as_vec3()).collect();
        assert!(split(&params, &points, &trough.triangles).is_some());
    }

    /// A trough of a floor and two walls, closed or with a hole in its floor.
    fn trough(is_open: bool) -> TriMesh {
        let rim = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.8, 1.0), (0.8, 0.2), (0.2, 0.2), (0.2, 1.0), (0.0, 1.0)];
        let points = [0.0, 0.7].iter().flat_map(|&z| rim.map(|(x, y)| DVec3::new(x, y, z))).collect();
        let cap = [[0, 1, 5], [1, 4, 5], [1, 2, 4], [2, 3, 4], [0, 5, 6], [0, 6, 7]];
        let back = cap.map(|[a, b, c]: [u32; 3]| [a, c, b]);
        let front = cap.map(|t| t.map(|v| v + 8));
        let sides = (0..8).flat_map(|i: u32| {
            let j = (i + 1) % 8;
            [[i, j, j + 8], [i, j + 8, i + 8]]
        });
        let triangles: Vec<[u32; 3]> = back.into_iter().chain(front).chain(sides).collect();
        if is_open {
            // Next to nothing is missing: a sliver of the back.
            let mut mesh = TriMesh { points, triangles };
            let [a, b, c] = mesh.triangles[0];
            let near = mesh.points[a as usize].lerp(mesh.points[b as usize], 0.01);
            mesh.points.push(near);
            let new = mesh.points.len() as u32 - 1;
            mesh.triangles[0] = [new, b, c];
            return weld(&mesh, 0.0);
        }
        TriMesh { points, triangles }
    }

    #[test]
    fn parts_hold_the_mesh_open_or_closed() {
        let mut counts = Vec::new();
        for is_open in [false, true] {
            let mesh = trough(is_open);
            let size = Size::of(&mesh);
            assert_eq!(size.closed, !is_open);
            let physics = &Params::new(Accuracy::Standard).physics;
            let extent = Extent { diameter: size.diameter, thickness: size.extents.x, off: 0.0 };
            let Fitted { solid, deviation, .. } = decompose(&mesh, extent, size.closed, physics);
            let Solid::Convex(parts) = &solid else { panic!("it is neither box nor ball") };
            assert!(deviation < 0.1 * size.diameter, "{deviation}");
            let unit = |p: DVec3| (p / size.diameter).as_vec3();
            let hulls: Vec<Hull> = parts
                .iter()
                .map(|part| Hull::new(&part.iter().map(|&p| unit(p)).collect::<Vec<_>>()).expect("it has a volume"))
                .collect();
            let outside = |p: Vector| {
                let beyond = |hull: &Hull| {
                    let out =
                        |f: &super::super::facets::Facet| (p - hull.points()[f.corners[0] as usize]).dot(f.normal);
                    hull.facets().iter().map(out).fold(f32::NEG_INFINITY, f32::max)
                };
                hulls.iter().map(beyond).fold(f32::INFINITY, f32::min)
            };
            let surface = EngineMesh::new(mesh.points.iter().map(|&p| unit(p)).collect(), mesh.triangles.clone());
            let worst = surface_samples(&surface.expect("it is a mesh")).into_iter().map(outside).fold(0.0, f32::max);
            assert!(worst < 1e-5, "open: {is_open}, {worst} of the diameter is outside of {} parts", parts.len());
            counts.push(parts.len());
        }
        assert!(counts[0] > 1 && counts[0] == counts[1], "{counts:?}");
    }
}
