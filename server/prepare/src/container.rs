//! The control mesh as a container: a closed surface that faces inward, and a base on the ground.
//!
//! The mesh stays upright while it is filled under upward gravity: turning over then only changes the sign of gravity.

pub mod core;

use self::core::Core;
use crate::surroundings::{self, Surroundings};
use cairn_engine::shape::{Shape, Size, corners};
use cairn_engine::units::Units;
use cairn_geometry::contact::CARRYING_GAP;
use cairn_geometry::interior::{DistanceGrid, MeshInterior};
use cairn_geometry::mesh::{TriMesh, bounds, boxes_meet};
use cairn_geometry::pose::Pose;
use cairn_geometry::simplify::{self, Simplified};
use cairn_geometry::topology::{self, Topology};
use cairn_geometry::{ClosedMesh, RESOLUTION};
use cairn_input::scene::Scene;
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::DVec3;
use ndshape::{RuntimeShape, Shape as _};
use std::sync::Arc;

/// The container that is filled. Engine units.
pub struct Container {
    /// Triangles facing inward; closed.
    mesh: TriMesh,
    /// Largest distance of the simplified mesh from it; 0: it is not simplified.
    tolerance: f64,
    /// The room: distance to the surface and to scenery, negative inside.
    pub distance: DistanceGrid,
    /// Distance to the surface alone, where scenery takes room.
    shell: Option<DistanceGrid>,
    /// Scenery that takes room.
    scenery: Vec<SceneryMesh>,
    surroundings: Option<Arc<Surroundings>>,
    units: Units,
    /// Height of the base, which a half-space closes as well.
    pub base: f64,
    pub volume: f64,
    /// Of the control mesh's surface.
    pub area: f64,
    pub low: DVec3,
    pub high: DVec3,
    /// The mesh is a surface around the union of the control mesh's parts, not the control mesh itself.
    pub remeshed: bool,
    /// The surface of the core, where there is one: closed, facing outward.
    pub core: Option<TriMesh>,
}

/// A piece of scenery near the container, engine units.
pub struct SceneryMesh {
    pub mesh: TriMesh,
    pub friction: f64,
}

/// What is farther from the container than this, d, meets no prop of the fill.
pub const FAR: f64 = 4.0;

/// A face is steep if its normal's share along Y is less than this: at more than 45 degrees.
const STEEP: f64 = 0.7;

/// Bound on the distance grid, for memory.
const MAX_GRID_NODES: usize = 2_000_000;
/// Distances are exact this far inside and outside, d: no more than the size of a usual prop is asked for.
pub const EXACT: [f64; 2] = [1.0, 0.5];
/// A container of more triangles than this per d^2 is finer than props need: each prop meets dozens of them.
const FINE_WALLS: f64 = 50.0;
/// A remeshed container is this far inside the control mesh, in grid spacings: the surface of a grid rounds edges off,
/// outward at concave ones.
const REMESH_INSET: f64 = 0.2;

/// Whether a control mesh is finer than props need, or remeshing may make it so: then the container is simplified. `d`
/// in the mesh's unit.
pub fn has_fine_walls(topology: &Topology, d: f64) -> bool {
    !topology.is_watertight()
        || topology.components > 1
        || topology.triangles as f64 > FINE_WALLS * topology.area / d.powi(2)
}

impl Container {
    /// `control` and `ground` in SI. `tolerance`: how far the simplified container may
    /// be from the mesh, in d; 0: it is not simplified.
    pub fn new(control: &ClosedMesh, units: &Units, ground: f64, tolerance: f64) -> Container {
        let topology = &control.topology;
        let solid = units.mesh_to_engine(&control.mesh);
        let (region, distance) = grid(&control.mesh, units);
        let (low, high) = solid.bounds();
        // Parts that reach less deep into each other only touch.
        let remeshed = !topology.is_watertight() || topology.components > 1 && region.overlaps(CARRYING_GAP);
        let mesh = if remeshed {
            surface(&distance, REMESH_INSET * distance.spacing())
        } else {
            inward(&solid, region.was_inside_out())
        };
        let base = low.y.max(units.height_to_engine(ground));
        Container {
            mesh,
            tolerance,
            distance,
            shell: None,
            scenery: Vec::new(),
            surroundings: None,
            units: *units,
            base,
            volume: region.volume(),
            area: topology.area / units.length.powi(2),
            low,
            high,
            remeshed,
            core: None,
        }
    }

    /// Leaves no room in the core.
    pub fn around(mut self, core: &Core, units: &Units) -> Container {
        self.distance.cut_out(&grid(&core.mesh, units).1);
        self.volume -= core.volume / units.length.powi(3);
        self.area += core.area / units.length.powi(2);
        self.core = Some(units.mesh_to_engine(&core.mesh));
        self
    }

    /// Leaves no room in scenery. `scene`: the one that `surroundings` are of. `sizes`: of its props.
    pub fn apart_from(mut self, mut surroundings: Surroundings, scene: &Scene, sizes: &[Size]) -> Container {
        self.shell = Some(self.distance.clone());
        let (volume, area) =
            surroundings.cut(&mut self.distance, &self.units, surroundings::least_radius(scene, sizes));
        self.volume *= volume;
        self.area *= area;
        let near =
            |corners: [DVec3; 3]| boxes_meet(bounds(corners.into_iter()), (self.low, self.high), DVec3::splat(FAR));
        for model in &scene.statics {
            let mut mesh = self.units.mesh_to_engine(&surroundings::placed(model));
            mesh.triangles.retain(|t| near(t.map(|v| mesh.points[v as usize])));
            if !mesh.triangles.is_empty() {
                // Without the points that no triangle uses.
                let mesh = topology::weld(&mesh, 0.0);
                self.scenery.push(SceneryMesh { mesh, friction: model.friction });
            }
        }
        self.surroundings = Some(Arc::new(surroundings));
        self
    }

    /// Distance to the surface alone, negative inside.
    pub fn shell(&self) -> &DistanceGrid {
        self.shell.as_ref().unwrap_or(&self.distance)
    }

    /// The scenery that takes room.
    pub fn scenery(&self) -> &[SceneryMesh] {
        &self.scenery
    }

    /// The steep faces of the scenery that takes room: a pour enters through the base, past what the pile stands on.
    pub fn steep_scenery(&self) -> Vec<SceneryMesh> {
        let steep = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).normalize_or_zero().y.abs() < STEEP;
        let piece = |piece: &SceneryMesh| {
            let mut mesh = piece.mesh.clone();
            mesh.triangles.retain(|t| steep(t.map(|v| piece.mesh.points[v as usize])));
            SceneryMesh { mesh: topology::weld(&mesh, 0.0), friction: piece.friction }
        };
        self.scenery.iter().map(piece).filter(|piece| !piece.mesh.triangles.is_empty()).collect()
    }

    /// Whether a point is in solid scenery: exact, where [`Container::distance`] is too coarse for thin walls.
    pub fn is_solid_at(&self, p: DVec3) -> bool {
        let solid = |around: &Arc<Surroundings>| around.is_solid_at(self.units.point_to_si(p));
        self.surroundings.as_ref().is_some_and(solid)
    }

    /// Depth of a point in solid scenery, 0 outside.
    pub fn depth_in_scenery(&self, p: DVec3) -> f64 {
        let depth = |around: &Arc<Surroundings>| around.depth(self.units.point_to_si(p)) / self.units.length;
        self.surroundings.as_ref().map_or(0.0, depth)
    }

    /// The piece of scenery that a body has through its middle, as an index into the scene's `statics`, and how far it
    /// reaches through that, on the side where that is less. `scale` engine units per metre of the prop.
    pub fn pierced(&self, shape: &Shape, scale: f64, pose: &Pose) -> Option<(usize, f64)> {
        let around = self.surroundings.as_ref()?;
        let to_si = |p: DVec3| self.units.point_to_si(p);
        let crossed = shape.skeleton(scale, pose).find_map(|[a, b]| around.between(to_si(a), to_si(b)))?;
        let heights = corners(shape, scale, pose).map(|p| to_si(p).dot(crossed.normal) - crossed.offset);
        let (above, below) = heights.fold((0.0f64, 0.0f64), |(above, below), h| (above.max(h), below.max(-h)));
        Some((crossed.piece, above.min(below) / self.units.length))
    }

    /// Height of what carries a place: of the scenery below it, and no lower than the base. 0 without scenery, where
    /// the base carries everything.
    pub fn support(&self, p: DVec3) -> f64 {
        let Some(around) = &self.surroundings else { return 0.0 };
        let carrier = around.carrier(self.units.point_to_si(p));
        carrier.map_or(self.base, |carrier| self.units.height_to_engine(carrier.height).max(self.base))
    }

    /// Whether scenery carries the shape: one of its corners is no higher above it than this, d.
    pub fn is_carried(&self, most: f64) -> bool {
        let reaches = |p: &DVec3| p.y - self.support(*p + DVec3::Y * most) <= most;
        self.surroundings.is_some() && self.mesh.points.iter().any(reaches)
    }

    /// The parts of a vertical line that scenery leaves free, from below; `None` without scenery.
    pub fn free_along(&self, p: DVec3) -> Option<Vec<[f64; 2]>> {
        let around = self.surroundings.as_ref()?;
        let gaps = around.gaps(self.units.point_to_si(p)).into_iter().filter(|gap| !gap.taken);
        Some(gaps.map(|gap| [gap.low, gap.high].map(|y| self.units.height_to_engine(y))).collect())
    }

    /// The closed container, larger by `outside` on all sides, facing inward.
    pub fn closed(&self, outside: f64) -> Simplified {
        let mesh = if outside > 0.0 { surface(self.shell(), -outside) } else { self.mesh.clone() };
        simplify::run(mesh, self.tolerance)
    }

    /// Triangles facing inward, and those of the core outward; closed.
    pub fn bounds(&self) -> TriMesh {
        let mut all = self.mesh.clone();
        self.core.iter().for_each(|core| all.append(core));
        all
    }

    /// Whether all points lie inside, up to `slack`.
    pub fn contains(&self, mut points: impl Iterator<Item = DVec3>, slack: f64) -> bool {
        points.all(|p| p.y >= self.base - slack && self.distance.signed_distance(p) <= slack)
    }

    /// The container with an opening where the base was, and a collar below it.
    pub fn opened(&self, cut: f64, collar: f64) -> Simplified {
        simplify::run(without_base(&self.mesh, self.base, cut, collar).0, self.tolerance)
    }
}

/// A mesh with an opening where its base was, and a collar below it: faces within `cut` above the base are removed, and
/// the rim that they leave is drawn down by `collar`. And the removed faces.
fn without_base(mesh: &TriMesh, base: f64, cut: f64, collar: f64) -> (TriMesh, Vec<[u32; 3]>) {
    let below = |v: u32| mesh.points[v as usize].y <= base + cut;
    let (removed, kept): (Vec<[u32; 3]>, Vec<[u32; 3]>) =
        mesh.triangles.iter().partition(|t| t.iter().all(|&v| below(v)));
    let edges = |t: &[u32; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
    let inner: std::collections::BTreeSet<(u32, u32)> = removed.iter().flat_map(edges).collect();
    let mut open = TriMesh { points: mesh.points.clone(), triangles: kept };
    for (a, b) in inner.iter().copied().filter(|&(a, b)| !inner.contains(&(b, a))) {
        // The removed face ran from a to b; the collar replaces it and faces the same side as the face above.
        let n = open.points.len() as u32;
        for v in [a, b] {
            let p = open.points[v as usize];
            open.points.push(DVec3::new(p.x, base - collar, p.z));
        }
        open.triangles.extend([[a, b, n + 1], [a, n + 1, n]]);
    }
    (open, removed)
}

/// The inside of a mesh in SI, and the distance to its surface, in engine units.
pub fn grid(mesh: &TriMesh, units: &Units) -> (MeshInterior, DistanceGrid) {
    let region = MeshInterior::new(&units.mesh_to_engine(mesh));
    let distance = DistanceGrid::new(&region, RESOLUTION, MAX_GRID_NODES, EXACT);
    (region, distance)
}

fn inward(solid: &TriMesh, inside_out: bool) -> TriMesh {
    let flip = |&[a, b, c]: &[u32; 3]| [a, c, b];
    let triangles = if inside_out { solid.triangles.clone() } else { solid.triangles.iter().map(flip).collect() };
    TriMesh { points: solid.points.clone(), triangles }
}

/// The surface at this depth below that of the distance grid (naive surface nets), facing inward.
fn surface(distance: &DistanceGrid, inset: f64) -> TriMesh {
    let (origin, size, values) = distance.nodes();
    let field: Vec<f32> = values.iter().map(|&v| (v + inset) as f32).collect();
    net(&field, size, origin, distance.spacing())
}

/// The surface where a field on a grid is 0, facing to where it is negative. Shape `[z][y][x]`.
pub fn net(field: &[f32], size: [usize; 3], origin: DVec3, spacing: f64) -> TriMesh {
    let shape = RuntimeShape::<u32, 3>::new(size.map(|n| n as u32));
    debug_assert_eq!(shape.size() as usize, field.len());
    let mut net = SurfaceNetsBuffer::default();
    surface_nets(field, &shape, [0; 3], size.map(|n| n as u32 - 1), &mut net);
    let point = |p: &[f32; 3]| origin + DVec3::from_array(p.map(f64::from)) * spacing;
    let triangles = net.indices.chunks_exact(3).map(|t| [t[0], t[2], t[1]]).collect();
    TriMesh { points: net.positions.iter().map(point).collect(), triangles }
}
