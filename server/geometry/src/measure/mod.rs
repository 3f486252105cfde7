//! Figures of how good a pile is: its shape against the control mesh, its contacts, its motion.
//!
//! Every length is in metres, heights are along Y, and `d` is the median diameter of the bodies (bounding sphere of
//! the prop, scaled). A figure never stands alone where it could mislead: the structs carry the caveats.

mod extent;
mod figures;
mod overlap;
mod pictures;
mod raster;
mod shape_measurer;
mod solid;
#[cfg(test)]
mod tests;
mod visible;
mod volume_iou;
mod voxels;

pub use extent::{bounding_sphere, outermost_points, percentile, smallest_extent};
pub use overlap::{Overlap, Penetration, penetration};
pub use shape_measurer::ShapeMeasurer;
pub use solid::SolidSource;
pub use visible::{Neighbourhood, Sight, Visible};

use crate::counted;
use crate::mesh::TriMesh;
use crate::pose::Pose;
use serde::Serialize;

/// Bodies where they lie: a prop's points are scaled, then posed.
#[derive(Clone, Copy, Debug)]
pub struct Instances<'a> {
    /// Each in its own frame, with at least one triangle and more than a single point.
    pub props: &'a [TriMesh],
    /// Index into `props`, uniform scale > 0, and the pose of the prop's own frame.
    pub bodies: &'a [(usize, f64, Pose)],
}

/// The figures of a pile's shape, and the grid and solids behind them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShapeMeasures {
    pub bodies: usize,
    /// d, metres.
    pub prop_diameter: f64,
    /// Share of the bodies' volume whose centre of mass lies inside the control mesh, or within d/10 of it.
    pub inside_fraction: f64,
    pub shape_iou: ShapeIou,
    /// 95th percentile of the height of the bodies' volume above the control mesh's base / its height.
    pub height_p95_rel: f64,
    /// The same for the solid control mesh.
    pub height_p95_rel_solid: f64,
    /// Largest distance of a body's vertex outside the control mesh / d.
    pub protrusion_rel: f64,
    /// Volume of the bodies' parts inside the control mesh / its volume.
    pub fill_fraction: f64,
    /// Of the control mesh, m^3.
    pub control_volume: f64,
    /// One per prop, in their order; `None` for a prop that no body uses.
    pub solids: Vec<Option<PropSolid>>,
}

/// Figures of the shape as a camera sees it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PictureMeasures {
    /// Mean IoU of the silhouettes from 8 azimuths.
    pub silhouette_iou: f64,
    /// RMS of the difference of the top surfaces, over the control mesh's footprint / d. Where no body is below the
    /// sky, the pile's top is the control mesh's base.
    pub height_rms_rel: f64,
}

/// The volume IoU, and the grid that it was taken on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ShapeIou {
    pub value: f64,
    /// The score of the solid control mesh itself on this grid with the same closing: below 1 where the closing
    /// fills corners of the control mesh that no prop fits into.
    pub solid: f64,
    /// Edge of a cell, metres.
    pub cell: f64,
    /// The edge that the definition asks for, metres.
    pub wanted_cell: f64,
    /// The grid is coarser than that, to bound memory and time.
    pub capped: bool,
    /// Bodies that lie wholly or partly beyond the grid; parts beyond it count by their volume.
    pub beyond: usize,
}

/// Source of a prop's volume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PropSolid {
    pub source: SolidSource,
    /// At scale 1, m^3.
    pub volume: f64,
    /// Its own cells are coarser than wanted, to bound memory and time.
    pub capped: bool,
}

impl ShapeMeasures {
    /// The figures by name.
    pub fn figures(&self) -> [(&'static str, f64); 8] {
        [
            ("inside_fraction", self.inside_fraction),
            ("shape_iou", self.shape_iou.value),
            ("shape_iou_solid", self.shape_iou.solid),
            ("height_p95_rel", self.height_p95_rel),
            ("height_p95_rel_solid", self.height_p95_rel_solid),
            ("protrusion_rel", self.protrusion_rel),
            ("fill_fraction", self.fill_fraction),
            ("prop_diameter", self.prop_diameter),
        ]
    }

    /// Deviations from the figures' definitions, in sentences; empty without any. `name`: of a prop by its index.
    pub fn caveats<'a>(&self, name: impl Fn(usize) -> &'a str) -> Vec<String> {
        let mut caveats = Vec::new();
        let iou = &self.shape_iou;
        if iou.capped {
            caveats.push(format!(
                "shape_iou was taken on cells of {:.3e} m instead of {:.3e} m, to bound memory and time",
                iou.cell, iou.wanted_cell
            ));
        }
        if iou.beyond > 0 {
            let bodies = counted(iou.beyond, "body lies", "bodies lie");
            caveats.push(format!("{bodies} beyond the grid of shape_iou: counted by volume"));
        }
        for (i, solid) in self.solids.iter().enumerate() {
            let Some(solid) = solid else { continue };
            let source = match solid.source {
                // That a mesh is open was said before the bake.
                SolidSource::Closed | SolidSource::Capped => None,
                SolidSource::Hull => Some("the mesh encloses next to no volume: its convex hull is measured instead"),
                SolidSource::Plate => Some("the mesh is flat: a plate of 2 % of its diameter is measured instead"),
            };
            let grid = solid.capped.then_some("the prop is too fine for its grid: its cells are coarser than wanted");
            caveats.extend(source.into_iter().chain(grid).map(|text| format!("{}: {text}", name(i))));
        }
        caveats
    }
}

/// `kept_shape`: the IoU at the end of the hold over the one right after turning over. `None` when that was 0.
pub fn kept_shape(turned_over: &ShapeMeasures, end: &ShapeIou) -> Option<f64> {
    let start = turned_over.shape_iou.value;
    (start > 0.0).then(|| end.value / start)
}
