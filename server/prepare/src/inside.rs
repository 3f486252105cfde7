//! The inside of an open container among the scenery, as a closed mesh to be filled: where water would stay.

use super::check;
use super::container::net;
use super::surroundings::placed;
use cairn_engine::shape::Size;
use cairn_geometry::interior::{Bvh, MeshInterior};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::topology::{self, WELD_TOLERANCE};
use cairn_geometry::{RESOLUTION, enlarged_cell};
use cairn_input::params::Fill;
use cairn_input::scene::{Model, Prop, StaticModel};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Bound on the cells, for time and memory.
const MOST_CELLS: f64 = 600_000.0;
/// Cells around the container on each side: air that water runs off to.
const MARGIN: usize = 2;
/// A container that holds less than this many cells holds nothing.
const LEAST: usize = 8;

/// Cells of a box, shape `[z][y][x]`.
struct Cells {
    origin: DVec3,
    edge: f64,
    size: [usize; 3],
}

impl Cells {
    fn around((low, high): (DVec3, DVec3), wanted: f64) -> Cells {
        let cells = |edge: f64| ((high - low) / edge).ceil() + 2.0 * MARGIN as f64 + 1.0;
        let (edge, cells) = enlarged_cell(wanted, 1.05, MOST_CELLS, cells);
        let size = cells.to_array().map(|n| n as usize);
        let extent = DVec3::from_array(size.map(|n| (n - 1) as f64)) * edge;
        Cells { origin: (low + high) / 2.0 - extent / 2.0, edge, size }
    }

    fn count(&self) -> usize {
        self.size.iter().product()
    }

    fn at(&self, i: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [i % nx, i / nx % ny, i / (nx * ny)]
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    fn middle(&self, i: usize) -> DVec3 {
        self.origin + DVec3::from_array(self.at(i).map(|n| n as f64)) * self.edge
    }

    /// The neighbours of a cell, each with the axis along which it lies and whether it is behind.
    fn neighbours(&self, i: usize) -> impl Iterator<Item = (usize, usize, bool)> + '_ {
        let at = self.at(i);
        (0..3).flat_map(move |axis| [false, true].map(|behind| (axis, behind))).filter_map(move |(axis, behind)| {
            let mut to = at;
            to[axis] = if behind { at[axis].checked_sub(1)? } else { at[axis] + 1 };
            (to[axis] < self.size[axis]).then(|| (self.index(to), axis, behind))
        })
    }
}

/// The inside of a piece of scenery, up to the level that `fill` asks for, for these props. An error names fault and
/// remedy.
pub fn inside(model: &StaticModel, fill: &Fill, props: &[Prop]) -> Result<Model, String> {
    let sizes: Vec<Size> = props.iter().map(|prop| Size::of(&prop.model.mesh)).collect();
    let weights: Vec<f64> = props.iter().map(|prop| prop.weight).collect();
    let diameter = check::median_diameter(props, &sizes, &weights);
    if !(diameter > 0.0 && diameter.is_finite()) {
        return Err("the props have no size; give props with meshes".into());
    }
    let mesh = topology::weld(&placed(model), WELD_TOLERANCE);
    let name = &model.model.name;
    if mesh.triangles.is_empty() {
        return Err(format!("{name} has no triangles; name scenery that has an inside"));
    }
    let cells = Cells::around(mesh.bounds(), RESOLUTION * diameter);
    let held = held(&mesh, &cells);
    let held = largest_part(&cells, &held);
    let count = held.iter().filter(|held| **held).count();
    if count < LEAST {
        return Err(format!(
            "{name} holds nothing: water would run off everywhere, or its inside is narrower than the props; name \
             scenery that is open at its top, such as a bowl or a crate, or give a control mesh"
        ));
    }
    let top = level(&cells, &held, count, fill);
    let filled = surface(&cells, &held, top, libm::tan(fill.heap.to_radians()));
    if filled.triangles.is_empty() {
        return Err(format!("fill.level: no prop fits below it in {name}; raise it"));
    }
    Ok(Model::new(format!("the inside of {name}"), filled))
}

/// The cells in which water would stay (the priority flood of Barnes, Lehman & Mulla 2014, in space).
fn held(mesh: &TriMesh, cells: &Cells) -> Vec<bool> {
    let tree = Bvh::new((0..mesh.triangles.len()).map(|i| (i as u32, mesh.corners(i))).collect());
    let solid: Vec<MeshInterior> = topology::parts(mesh)
        .into_iter()
        .filter_map(|triangles| {
            let part = topology::weld(&TriMesh { points: mesh.points.clone(), triangles }, 0.0);
            topology::inspect(&part).closed.then(|| MeshInterior::new(&part))
        })
        .collect();
    let is_solid: Vec<bool> =
        (0..cells.count()).into_par_iter().map(|i| solid.iter().any(|solid| solid.contains(cells.middle(i)))).collect();
    // Whether the way to the next cell along each axis is free.
    let is_open: Vec<[bool; 3]> = (0..cells.count())
        .into_par_iter()
        .map(|i| {
            let mut open = [false; 3];
            for (to, axis, behind) in cells.neighbours(i) {
                if !behind && !is_solid[i] && !is_solid[to] {
                    open[axis] = !tree.is_between(cells.middle(i), cells.middle(to));
                }
            }
            open
        })
        .collect();
    let height = |i: usize| cells.at(i)[1];
    // How high water stands in a cell before it runs off.
    let mut level = vec![usize::MAX; cells.count()];
    let mut front = BinaryHeap::new();
    for i in 0..cells.count() {
        let at = cells.at(i);
        if (0..3).any(|axis| at[axis] == 0 || at[axis] + 1 == cells.size[axis]) && !is_solid[i] {
            level[i] = height(i);
            front.push(Reverse((height(i), i)));
        }
    }
    while let Some(Reverse((reached, i))) = front.pop() {
        for (to, axis, behind) in cells.neighbours(i) {
            let is_free = if behind { is_open[to][axis] } else { is_open[i][axis] };
            if is_free && level[to] == usize::MAX {
                level[to] = reached.max(height(to));
                front.push(Reverse((level[to], to)));
            }
        }
    }
    (0..cells.count()).map(|i| !is_solid[i] && level[i] > height(i)).collect()
}

/// The largest connected part.
fn largest_part(cells: &Cells, held: &[bool]) -> Vec<bool> {
    let mut sets = topology::DisjointSets::new(held.len());
    for i in (0..held.len()).filter(|&i| held[i]) {
        cells.neighbours(i).filter(|&(to, ..)| held[to] && to < i).for_each(|(to, ..)| sets.join(i, to));
    }
    let mut counts = std::collections::BTreeMap::<usize, usize>::new();
    for i in (0..held.len()).filter(|&i| held[i]) {
        *counts.entry(sets.find(i)).or_default() += 1;
    }
    let largest = counts.into_iter().max_by_key(|&(set, count)| (count, Reverse(set))).map(|(set, _)| set);
    (0..held.len()).map(|i| held[i] && Some(sets.find(i)) == largest).collect()
}

/// Height up to which the cells are to be filled, m.
fn level(cells: &Cells, held: &[bool], count: usize, fill: &Fill) -> f64 {
    let mut layers = vec![0usize; cells.size[1]];
    (0..held.len()).filter(|&i| held[i]).for_each(|i| layers[cells.at(i)[1]] += 1);
    let height = |layer: f64| cells.origin.y + (layer - 0.5) * cells.edge;
    let lowest = layers.iter().position(|n| *n > 0).unwrap_or(0);
    let rim = layers.iter().rposition(|n| *n > 0).unwrap_or(0) + 1;
    if let Some(above) = fill.level {
        return (height(lowest as f64) + above).min(height(rim as f64));
    }
    let mut left = fill.share * count as f64;
    for (layer, &n) in layers.iter().enumerate() {
        if left <= n as f64 && n > 0 {
            return height(layer as f64 + left / n as f64);
        }
        left -= n as f64;
    }
    height(rim as f64)
}

/// The surface around the cells below `top` and, with a slope, the heap above them.
fn surface(cells: &Cells, held: &[bool], top: f64, slope: f64) -> TriMesh {
    let [nx, ny, nz] = cells.size;
    let last = (0..ny).rev().find(|&y| cells.origin.y + (y as f64 - 0.5) * cells.edge < top).unwrap_or(0);
    // Seen from above: where the top is, and how far each of its places is from the rim.
    let is_top = |x: usize, z: usize| held[cells.index([x, last, z])];
    let rim: Vec<DVec2> = (0..nz)
        .flat_map(|z| (0..nx).map(move |x| (x, z)))
        .filter(|&(x, z)| !is_top(x, z))
        .filter(|&(x, z)| {
            let near = |a: usize, n: usize| a.saturating_sub(1)..(a + 2).min(n);
            near(z, nz).any(|z| near(x, nx).any(|x| is_top(x, z)))
        })
        .map(|(x, z)| DVec2::new(x as f64, z as f64))
        .collect();
    let heap = |x: usize, z: usize| {
        if slope <= 0.0 || !is_top(x, z) {
            return 0.0;
        }
        let p = DVec2::new(x as f64, z as f64);
        slope * cells.edge * rim.iter().map(|r| r.distance(p)).reduce(f64::min).unwrap_or(0.0)
    };
    let heaps: Vec<f64> = (0..nx * nz).into_par_iter().map(|i| heap(i % nx, i / nx)).collect();
    // The heap may be higher than the container.
    let most = heaps.iter().fold(0.0, |a: f64, b| a.max(*b));
    let more = (most / cells.edge).ceil() as usize;
    let size = [nx, ny + more, nz];
    let half = cells.edge / 2.0;
    let value = |i: usize| {
        let [x, y, z] = [i % nx, i / nx % size[1], i / (nx * size[1])];
        let above = cells.origin.y + y as f64 * cells.edge - top;
        if above > -half {
            // Half a cell of the wall belongs to it: the wall itself is scenery.
            let is_below = last < ny && is_top(x, z);
            return if is_below { (above - heaps[z * nx + x]).clamp(-half, half) } else { half };
        }
        let own = cells.index([x, y, z]);
        let is_inside = held[own] || cells.neighbours(own).any(|(to, ..)| held[to]);
        if is_inside { -half } else { half }
    };
    let values: Vec<f32> = (0..size.iter().product()).map(|i| value(i) as f32).collect();
    let mut mesh = net(&values, size, cells.origin, cells.edge);
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh
}
