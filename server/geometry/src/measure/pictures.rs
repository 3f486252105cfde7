//! The pile as a camera sees it: silhouettes from the side and the top surface from above. The props' own triangles are
//! drawn, with their gaps: nothing is closed here.

use super::Instances;
use super::raster::PixelGrid;
use super::shape_measurer::{ShapeMeasurer, placed};
use crate::mesh::TriMesh;
use crate::pose::Pose;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;

/// Azimuths, evenly over half a turn: a view from behind is the same silhouette, mirrored.
const AZIMUTHS: usize = 8;
/// Pixels along the control mesh's largest extent.
const PIXELS: f64 = 512.0;
/// The top surface has pixels of half a cell, but no more than this many along each side.
const HEIGHT_PIXELS: f64 = 1024.0;

/// Mean over the azimuths of the IoU of the two silhouettes, in horizontal parallel projection. Pixels below the
/// control mesh's base do not count: a heap may stand on others.
pub(super) fn silhouette_iou(measurer: &ShapeMeasurer, pile: &Instances) -> f64 {
    let (lo, hi) = picture_box(measurer, pile);
    let (control_lo, control_hi) = measurer.control_bounds();
    let lo = lo.with_y(control_lo.y);
    let pixel = (control_hi - control_lo).max_element() / PIXELS;
    let sides = Sides::of(measurer, pile);
    let views: Vec<f64> = (0..AZIMUTHS)
        .into_par_iter()
        .map(|k| {
            let (sin, cos) = libm::sincos(k as f64 / AZIMUTHS as f64 * std::f64::consts::PI);
            let view = PictureView { right: DVec3::new(cos, 0.0, sin), up: DVec3::Y, toward: DVec3::ZERO };
            let corner = |i: usize| DVec3::from_array([0, 1, 2].map(|a| if i >> a & 1 == 1 { hi[a] } else { lo[a] }));
            let corners = || (0..8).map(|i| DVec2::new(corner(i).dot(view.right), corner(i).y));
            let frame = PixelGrid::covering(
                corners().fold(DVec2::INFINITY, DVec2::min),
                corners().fold(DVec2::NEG_INFINITY, DVec2::max),
                pixel,
            );
            // Bit 0: the control mesh, bit 1: the pile.
            let mut picture = vec![0u8; frame.len()];
            view.fill((measurer.control, sides.control), 1.0, &Pose::IDENTITY, &frame, &mut picture, 1);
            for (prop, scale, pose) in pile.bodies {
                view.fill((&pile.props[*prop], sides.props[*prop]), *scale, pose, &frame, &mut picture, 2);
            }
            let both = picture.iter().filter(|&&p| p == 3).count();
            let any = picture.iter().filter(|&&p| p != 0).count();
            if any > 0 { both as f64 / any as f64 } else { 0.0 }
        })
        .collect();
    views.iter().sum::<f64>() / AZIMUTHS as f64
}

/// The box that the pictures show, metres: the control mesh and the bodies, as far as the control mesh's
/// largest extent around it.
fn picture_box(measurer: &ShapeMeasurer, pile: &Instances) -> (DVec3, DVec3) {
    let (lo, hi) = measurer.region.bounds();
    let around = (hi - lo).max_element();
    let reach = |b: &(usize, f64, Pose)| (placed(b, measurer.solid(b).centre), measurer.solid(b).reach * b.1);
    let all = pile.bodies.iter().map(reach).fold((lo, hi), |all, (c, r)| (all.0.min(c - r), all.1.max(c + r)));
    (all.0.max(lo - around), all.1.min(hi + around))
}

/// RMS over the control mesh's footprint of the difference between the two top surfaces / d. Where the pile leaves
/// the footprint bare, its top is the control mesh's base.
pub(super) fn height_rms_rel(measurer: &ShapeMeasurer, pile: &Instances) -> f64 {
    let (lo, hi) = measurer.control_bounds();
    let pixel = (measurer.lattice.cell / 2.0).max((hi.x - lo.x).max(hi.z - lo.z) / HEIGHT_PIXELS);
    let frame = PixelGrid::covering(DVec2::new(lo.x, lo.z), DVec2::new(hi.x, hi.z), pixel);
    let view = PictureView { right: DVec3::X, up: DVec3::Z, toward: DVec3::Y };
    let mut control = vec![f64::NEG_INFINITY; frame.len()];
    view.draw(measurer.control, 1.0, &Pose::IDENTITY, &frame, |i, y| control[i] = control[i].max(y));
    let mut top = vec![lo.y; frame.len()];
    for (prop, scale, pose) in pile.bodies {
        view.draw(&pile.props[*prop], *scale, pose, &frame, |i, y| top[i] = top[i].max(y));
    }
    let footprint = || control.iter().zip(&top).filter(|(c, _)| c.is_finite());
    let squares: f64 = footprint().map(|(c, t)| (c - t) * (c - t)).sum();
    (squares / footprint().count().max(1) as f64).sqrt() / measurer.diameter
}

/// Which triangles of a mesh cover all that it covers: where a line of sight goes into a closed mesh, it comes out
/// again, so that those that face one side are enough.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    One,
    Both,
}

struct Sides {
    control: Side,
    /// Shape `[prop]`.
    props: Vec<Side>,
}

impl Sides {
    fn of(measurer: &ShapeMeasurer, pile: &Instances) -> Sides {
        Sides { control: side(measurer.control), props: pile.props.par_iter().map(side).collect() }
    }
}

fn side(mesh: &TriMesh) -> Side {
    let directed = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let mut balance: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for [a, b] in directed {
        *balance.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
    }
    if balance.values().all(|&sum| sum == 0) { Side::One } else { Side::Both }
}

/// A parallel projection.
struct PictureView {
    right: DVec3,
    up: DVec3,
    /// Toward the camera: the direction of the depth that `draw` reports.
    toward: DVec3,
}

impl PictureView {
    /// The corners of a body in the picture.
    fn seen(&self, mesh: &TriMesh, scale: f64, pose: &Pose) -> Vec<DVec2> {
        let back = pose.rotation.inverse();
        let [right, up] = [self.right, self.up].map(|a| back * a * scale);
        let shift = DVec2::new(pose.translation.dot(self.right), pose.translation.dot(self.up));
        mesh.points.iter().map(|p| DVec2::new(p.dot(right), p.dot(up)) + shift).collect()
    }

    /// Sets a bit in every pixel of a body.
    fn fill(
        &self,
        (mesh, side): (&TriMesh, Side),
        scale: f64,
        pose: &Pose,
        frame: &PixelGrid,
        picture: &mut [u8],
        bit: u8,
    ) {
        let seen = self.seen(mesh, scale, pose);
        for triangle in &mesh.triangles {
            let corners = triangle.map(|v| seen[v as usize]);
            let area = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
            if area > 0.0 || side == Side::Both {
                let set = |pixels: Range<usize>| picture[pixels].iter_mut().for_each(|pixel| *pixel |= bit);
                frame.spans(corners, set);
            }
        }
    }

    /// Calls `plot(pixel, depth)` for every pixel of every triangle of a body.
    fn draw(&self, mesh: &TriMesh, scale: f64, pose: &Pose, frame: &PixelGrid, mut plot: impl FnMut(usize, f64)) {
        let toward = pose.rotation.inverse() * self.toward * scale;
        let height = pose.translation.dot(self.toward);
        let seen = self.seen(mesh, scale, pose);
        for triangle in &mesh.triangles {
            let corners = triangle.map(|v| seen[v as usize]);
            let [a, b, c] = triangle.map(|v| mesh.points[v as usize].dot(toward) + height);
            let (ab, ac) = (corners[1] - corners[0], corners[2] - corners[0]);
            let area = ab.perp_dot(ac);
            let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
            frame.cover(corners, |i, p| {
                let ap = p - corners[0];
                let depth = a + (b - a) * (ap.perp_dot(ac) / area) + (c - a) * (ab.perp_dot(ap) / area);
                // A triangle seen edge-on has no area, and rounding may leave its range: its top is the answer.
                plot(i, if depth.is_finite() { depth.clamp(lo, hi) } else { hi });
            });
        }
    }
}
