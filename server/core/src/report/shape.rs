//! Figures of the pile's shape against the control mesh.

use super::inputs::{Figures, Inputs};
use crate::error::Error;
use crate::geometry::mesh::TriMesh;
use crate::geometry::pose::Pose;
use crate::geometry::region::Region;
use crate::input::observer::{Observer, Progress, Stage, observe};
use crate::measure::{self, Gauge, ShapeMeasures};
use crate::sim::instance::Instance;
use crate::sim::pile::Pile;

/// Figures of the end of the hold under their names; those right after turning over with `_start` behind; where
/// something disturbed the hold, those of the last frame with `_after` behind. Also the measures that caveats are taken of.
pub fn figures(
    inputs: &Inputs,
    target: &TriMesh,
    pile: &Pile,
    observer: &mut dyn Observer,
) -> Result<(Figures, ShapeMeasures), Error> {
    let bodies = inputs.bodies.len();
    let progress =
        |fraction| Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0 };
    let region = Region::new(target);
    let props: Vec<TriMesh> = inputs.scene.props.iter().map(|p| p.model.mesh.clone()).collect();
    let last = inputs.frames.len() - 1;
    let hold_end = pile.recorder.disturbed_frame.unwrap_or(last).min(last);
    let [start, held, after] = [0, hold_end, last].map(|number| inputs.placed(number));
    let pile_of = |bodies| measure::Instances { props: &props, bodies };
    // The pile is what it is made of at the beginning: a ball thrown into it has no part in its shape.
    let made_of: std::collections::BTreeSet<usize> =
        if start.is_empty() { &after } else { &start }.iter().map(|b| b.0).collect();
    let only =
        |bodies: Vec<(usize, f64, Pose)>| -> Vec<_> { bodies.into_iter().filter(|b| made_of.contains(&b.0)).collect() };
    let (held, after) = (only(held), only(after));
    let gauge = Gauge::new(target, &region, &pile_of(if start.is_empty() { &after } else { &start }));
    let first = (!start.is_empty()).then(|| gauge.measure(&pile_of(&start)));
    observe(observer, &progress(0.4))?;
    let mut figures = Figures::new();
    let at_end = (!held.is_empty()).then(|| gauge.measure(&pile_of(&held)));
    if let Some(at_end) = &at_end {
        figures.extend(at_end.figures().into_iter().map(|(name, value)| (name, Some(value))));
    }
    if let Some(first) = &first {
        figures.insert("shape_iou_start", Some(first.shape_iou.value));
        figures.insert("height_p95_rel_start", Some(first.height_p95_rel));
        figures.insert("silhouette_iou_start", Some(first.silhouette_iou));
        // Defined right after turning over, and after the fill.
        figures.insert("protrusion_rel", Some(first.protrusion_rel));
        figures.insert("fill_fraction", Some(first.fill_fraction));
        figures.insert("kept_shape", at_end.as_ref().and_then(|end| measure::kept_shape(first, end)));
    }
    // Let go without any hold, glued and not.
    let freed = |poses: &Option<Vec<Option<Pose>>>| -> Option<f64> {
        let units = pile.world.units;
        let body = |(b, pose): (&Instance, &Option<Pose>)| {
            Some((b.prop, b.scale, pile.shapes[b.prop].prop_pose(&units.pose_to_si(pose.as_ref()?), b.scale)))
        };
        let bodies = only(pile.instances.iter().zip(poses.as_ref()?).filter_map(body).collect());
        let freed = gauge.measure(&measure::Instances { props: &props, bodies: &bodies });
        measure::kept_shape(first.as_ref()?, &freed)
    };
    if let Some(glued) = inputs.glued {
        figures.insert("kept_shape_freed", freed(&glued.freed));
        figures.insert("kept_shape_natural", freed(&glued.natural));
    }
    let mut caveats_of = first.or(at_end);
    if hold_end < last || caveats_of.is_none() {
        let after = gauge.measure(&pile_of(&after));
        figures.insert("shape_iou_after", Some(after.shape_iou.value));
        figures.insert("height_p95_rel_after", Some(after.height_p95_rel));
        figures.insert("silhouette_iou_after", Some(after.silhouette_iou));
        caveats_of.get_or_insert(after);
    }
    Ok((figures, caveats_of.expect("some frame has bodies")))
}
