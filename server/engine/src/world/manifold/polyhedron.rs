//! A convex polyhedron as a contact looks at it: corners and planes side by side, so that the processor looks at
//! several of them at once, and edges. Hulls have that ready; boxes and triangles are put into it.

use crate::shape::{CornerLanes, EdgesAround, Hull, HullEdge, LANES, PlaneLanes, eight, outermost, top};
use rapier3d::parry::shape::{Cuboid, Shape, Triangle};
use rapier3d::prelude::*;

/// See the module. In the frame of its shape; it is `scale` times as large as its corners and planes say.
#[derive(Clone, Copy)]
pub(in crate::world) struct Polyhedron<'a> {
    pub scale: f32,
    pub corners: &'a [Vector],
    pub lanes: &'a [CornerLanes],
    /// Unit normals outwards; the last lanes are filled up with the last plane.
    pub planes: &'a [PlaneLanes],
    pub edges: &'a [HullEdge],
    /// Number of its planes, without those that fill up the last lanes.
    pub facets: usize,
    /// `None`: there are few edges.
    pub around: Option<&'a EdgesAround>,
}

impl Polyhedron<'_> {
    pub fn normal(&self, facet: usize) -> Vector {
        let [x, y, z] = &self.planes[facet / LANES].normal;
        let k = facet % LANES;
        Vector::new(x.as_array()[k], y.as_array()[k], z.as_array()[k])
    }

    pub fn offset(&self, facet: usize) -> f32 {
        self.planes[facet / LANES].offset.as_array()[facet % LANES] * self.scale
    }

    /// The corner that is outermost in a direction.
    pub fn outermost(&self, direction: Vector) -> Vector {
        // The last lanes are filled up with the last corner.
        self.corner(outermost(self.lanes, direction).min(self.corners.len() - 1))
    }

    pub fn corner(&self, i: usize) -> Vector {
        self.corners[i] * self.scale
    }

    /// The height of the outermost corner in a direction.
    pub fn top(&self, direction: Vector) -> f32 {
        top(self.lanes, direction * self.scale)
    }

    /// A point inside or on it.
    pub fn middle(&self) -> Vector {
        self.corners.iter().sum::<Vector>() * (self.scale / self.corners.len() as f32)
    }
}

/// Room for a box or a triangle as a polyhedron: eight corners and planes at most.
pub(in crate::world) struct Small {
    corners: [Vector; LANES],
    count: usize,
    facets: usize,
    lanes: [CornerLanes; 1],
    planes: [PlaneLanes; 1],
}

/// The facet on the negative and on the positive side along each axis of a box, and its edges: parallel to each axis in
/// turn. The corner whose number has the bit of an axis is on its positive side.
const BOX_EDGES: [HullEdge; 12] = {
    let mut edges = [HullEdge { corners: [0; 2], facets: [0; 2] }; 12];
    let mut number = 0;
    while number < 12 {
        let (axis, others) = (number as u32 / 4, number as u32 % 4);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let (on_u, on_v) = (others & 1, others >> 1);
        let low = on_u << u | on_v << v;
        let (facet_u, facet_v) = (2 * u + on_u, 2 * v + on_v);
        // Counterclockwise around the first facet, seen from outside.
        edges[number] = if on_u == on_v {
            HullEdge { corners: [low, low | 1 << axis], facets: [facet_u, facet_v] }
        } else {
            HullEdge { corners: [low | 1 << axis, low], facets: [facet_u, facet_v] }
        };
        number += 1;
    }
    edges
};

/// A triangle is a prism of no height: its two faces, and three sides.
const TRIANGLE_EDGES: [HullEdge; 6] = [
    HullEdge { corners: [0, 1], facets: [0, 2] },
    HullEdge { corners: [1, 2], facets: [0, 3] },
    HullEdge { corners: [2, 0], facets: [0, 4] },
    HullEdge { corners: [1, 0], facets: [1, 2] },
    HullEdge { corners: [2, 1], facets: [1, 3] },
    HullEdge { corners: [0, 2], facets: [1, 4] },
];

impl Small {
    fn new(corners: &[Vector], planes: &[(Vector, f32)]) -> Small {
        let mut all = [Vector::ZERO; LANES];
        all[..corners.len()].copy_from_slice(corners);
        Small {
            corners: all,
            count: corners.len(),
            facets: planes.len(),
            lanes: [[0, 1, 2].map(|axis| eight(corners, |p| p[axis]))],
            planes: [PlaneLanes {
                normal: [0, 1, 2].map(|axis| eight(planes, |plane| plane.0[axis])),
                offset: eight(planes, |plane| plane.1),
            }],
        }
    }

    fn seen_with<'a>(&'a self, edges: &'a [HullEdge]) -> Polyhedron<'a> {
        Polyhedron {
            scale: 1.0,
            corners: &self.corners[..self.count],
            lanes: &self.lanes,
            planes: &self.planes,
            edges,
            facets: self.facets,
            around: None,
        }
    }
}

/// A shape as a polyhedron; `room`: for one that is a box or a triangle. `None`: it is none, or a triangle without
/// area.
pub(in crate::world) fn polyhedron<'a>(shape: &'a dyn Shape, room: &'a mut Option<Small>) -> Option<Polyhedron<'a>> {
    if let Some(hull) = shape.as_shape::<Hull>() {
        return Some(Polyhedron {
            scale: hull.scale(),
            corners: hull.unit_points(),
            lanes: hull.unit_lanes(),
            planes: hull.unit_planes(),
            edges: hull.edges(),
            facets: hull.facets().len(),
            around: Some(hull.around()),
        });
    }
    if let Some(cuboid) = shape.as_shape::<Cuboid>() {
        let half = cuboid.half_extents;
        let side = |i: u32, axis: u32| if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
        let corners: [Vector; 8] =
            std::array::from_fn(|i| half * Vector::new(side(i as u32, 0), side(i as u32, 1), side(i as u32, 2)));
        let planes: [(Vector, f32); 6] = std::array::from_fn(|f| {
            let normal = Vector::AXES[f / 2] * if f % 2 == 1 { 1.0 } else { -1.0 };
            (normal, half[f / 2])
        });
        return Some(room.insert(Small::new(&corners, &planes)).seen_with(&BOX_EDGES));
    }
    let Triangle { a, b, c } = *shape.as_shape::<Triangle>()?;
    let normal = (b - a).cross(c - a).try_normalize()?;
    let mut planes = [
        (normal, a.dot(normal)),
        (-normal, -a.dot(normal)),
        Default::default(),
        Default::default(),
        Default::default(),
    ];
    for (plane, [from, to]) in planes[2..].iter_mut().zip([[a, b], [b, c], [c, a]]) {
        let out = (to - from).cross(normal).try_normalize()?;
        *plane = (out, from.dot(out));
    }
    Some(room.insert(Small::new(&[a, b, c], &planes)).seen_with(&TRIANGLE_EDGES))
}
