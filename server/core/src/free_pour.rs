//! The free pour: the reference for "full".
//!
//! A prop is poured with its own friction into a wide box, and the share of the volume that it takes is measured in an
//! inner box, clear of walls, floor and surface. In: one prop, its shape and the parameters of the bake. Out: the
//! fraction, or `None` where the inner box stayed empty. Bounded in bodies; the result does not depend on the size of
//! the prop.

use crate::fill;
use cairn_engine::shape::Shape;
use cairn_engine::world::Units;
use cairn_geometry::ClosedMesh;
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::measure::{self, ShapeMeasurer};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use cairn_input::params::{FillMethod, Params};
use cairn_input::scene::{Prop, Scene};
use cairn_prepare::container::Container;
use glam::DVec3;

/// Width, depth and height of the box, in d; less where more bodies than [`MAX_BODIES`] would fit, but never below
/// the second.
const WIDTHS: [f64; 2] = [6.0, 2.5];
/// Bound on the bodies poured.
const MAX_BODIES: usize = 500;
/// Walls, floor and surface order the bodies up to about this distance, in d.
const MARGIN: f64 = 1.0;
/// In a narrow box, that distance is at most this share of its width.
const LARGEST_MARGIN: f64 = 0.25;

/// Share of its volume that a pour usually fills, about.
const USUAL_PACKING: f64 = 0.4;

/// The volume fraction of a free pour of this prop, in the middle of its range of scales.
pub fn free_pour(
    prop: &Prop,
    shape: &Shape,
    params: &Params,
    observer: &mut dyn Observer,
) -> Result<Option<f64>, Error> {
    let scale = (prop.scale[0] + prop.scale[1]) / 2.0;
    let diameter = shape.size.diameter * scale;
    let needed = MAX_BODIES as f64 * shape.volume * scale.powi(3) / USUAL_PACKING;
    let width = (libm::cbrt(needed) / diameter).clamp(WIDTHS[1], WIDTHS[0]);
    let bin = block(DVec3::new(-0.5, 0.0, -0.5) * width * diameter, DVec3::new(0.5, 1.0, 0.5) * width * diameter);

    let mut params = params.clone();
    params.fill.method = FillMethod::Pour;
    params.fill.friction = prop.friction;
    params.fill.count = None;
    params.fill.max_bodies = MAX_BODIES as u32;
    let prop = Prop { scale: [scale; 2], weight: 1.0, ..prop.clone() };
    let scene = Scene { props: vec![prop], ..Scene::default() };
    let units = Units::new(diameter, shape.mass * scale.powi(3), params.gravity);
    let bin = ClosedMesh::of(bin);
    let container = Container::new(&bin, &units, 0.0, 0.0);
    let shapes = std::slice::from_ref(shape);
    let poured = fill::pour_only(&scene, shapes, &params, units, &container, observer)?;

    let poses: Vec<(usize, f64, Pose)> =
        poured.iter().map(|b| (b.prop, b.scale, shape.prop_pose(&units.pose_to_si(&b.pose), b.scale))).collect();
    if poses.is_empty() {
        return Ok(None);
    }
    let (top, margin) = (width * diameter, MARGIN.min(LARGEST_MARGIN * width) * diameter);
    // Poured upward: the floor is the top of the box, and the surface lies this deep below it.
    let depth = depth(&poses, top);
    let clear = margin.min(LARGEST_MARGIN * depth);
    let side = top / 2.0 - margin;
    let inner = block(DVec3::new(-side, top - depth + clear, -side), DVec3::new(side, top - clear, side));
    let volume = inner.signed_volume();
    if volume.is_nan() || volume <= 0.0 {
        return Ok(None);
    }
    let region = MeshInterior::new(&inner);
    let props = [scene.props[0].model.mesh.clone()];
    let pile = measure::Instances { props: &props, bodies: &poses };
    Ok(Some(ShapeMeasurer::new(&inner, &region, &pile).fill_fraction(&pile)))
}

/// The mean over the props, by weight; `None` where one of them has none.
pub fn of_props(
    props: &[Prop],
    shapes: &[Shape],
    params: &Params,
    observer: &mut dyn Observer,
) -> Result<Option<f64>, Error> {
    let total: f64 = props.iter().map(|p| p.weight).sum();
    let mut mean = 0.0;
    for (prop, shape) in props.iter().zip(shapes).filter(|(prop, _)| prop.weight > 0.0) {
        let Some(fraction) = free_pour(prop, shape, params, observer)? else { return Ok(None) };
        mean += fraction * prop.weight / total;
    }
    Ok(Some(mean))
}

/// Depth of the poured bodies below `top`, m: nine tenths of an even pour lie in nine tenths of its depth.
fn depth(poses: &[(usize, f64, Pose)], top: f64) -> f64 {
    let depths: Vec<f64> = poses.iter().map(|p| top - p.2.translation.y).collect();
    (measure::percentile(&depths, 0.9) / 0.9).clamp(0.0, top)
}

/// A box between two corners, facing outward.
fn block(low: DVec3, high: DVec3) -> TriMesh {
    let corner = |i: u32| {
        let pick = |bit: u32, lo: f64, hi: f64| if i >> bit & 1 == 0 { lo } else { hi };
        DVec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z))
    };
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { points: (0..8).map(corner).collect(), triangles }
}
