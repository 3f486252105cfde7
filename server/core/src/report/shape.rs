//! Figures of the pile's shape against the control mesh.

use super::inputs::{NamedFigures, ReportInputs};
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::measure::{self, ShapeMeasurer, ShapeMeasures};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_geometry::thickness::{LocalThickness, Part};
use cairn_input::error::Error;
use cairn_input::observer::{Observer, observe};
use cairn_motion::instance::Instance;
use cairn_motion::pile::Pile;
use cairn_prepare::effects::EffectName;
use std::collections::BTreeSet;

/// Below this `shape_iou`, right after turning over and in the end, empty parts of the control mesh are looked for.
pub const POOR_MATCH: f64 = 0.85;

/// The figures that are null where nothing is measured.
const NAMES: [&str; 14] = [
    "fill_fraction",
    "height_p95_rel",
    "height_p95_rel_solid",
    "height_p95_rel_start",
    "height_rms_rel",
    "inside_fraction",
    "kept_shape",
    "prop_diameter",
    "protrusion_rel",
    "shape_iou",
    "shape_iou_solid",
    "shape_iou_start",
    "silhouette_iou",
    "silhouette_iou_start",
];

/// The figures of the shape, and the work for them.
#[derive(Default)]
pub struct Measured {
    pub figures: NamedFigures,
    /// Right after turning over, or of the first pile that there is.
    pub first: Option<ShapeMeasures>,
    /// Parts of the control mesh that are empty at the end of the hold, where much of it is.
    pub empty_parts: Vec<Part>,
    /// Number of shapes measured.
    pub shapes: u64,
    /// Number of pictures taken.
    pub pictures: u64,
    /// CPU seconds of the pictures.
    pub picture_seconds: f64,
}

impl Measured {
    /// All figures are null.
    pub fn nothing() -> Measured {
        Measured { figures: NAMES.iter().map(|&name| (name, None)).collect(), ..Measured::default() }
    }

    /// `first`: what was measured right after turning over.
    fn measure(
        &mut self,
        measurer: &ShapeMeasurer,
        pile: &measure::Instances,
        first: Option<&ShapeMeasures>,
    ) -> ShapeMeasures {
        self.shapes += 1;
        first.map_or_else(|| measurer.measure(pile), |first| measurer.measure_later(pile, first))
    }
}

/// Figures of the end of the hold under their names; those right after turning over with `_start` behind; where
/// something disturbed the hold, those of the last frame with `_after` behind.
pub fn figures(
    inputs: &ReportInputs,
    target: &TriMesh,
    pile: &Pile,
    observer: &mut dyn Observer,
) -> Result<Measured, Error> {
    let region = MeshInterior::new(target);
    let props: Vec<TriMesh> = inputs.scene.props.iter().map(|p| p.model.mesh.clone()).collect();
    let last = inputs.pile.frames.len() - 1;
    let hold_end = pile.recorder.disturbed_frame.unwrap_or(last).min(last);
    let [start, held, after] = [0, hold_end, last].map(|number| inputs.placed(number));
    // The props at the beginning make the pile: a ball thrown into it has no part in its shape.
    let made_of: BTreeSet<usize> = if start.is_empty() { &after } else { &start }.iter().map(|b| b.0).collect();
    let only =
        |bodies: Vec<(usize, f64, Pose)>| -> Vec<_> { bodies.into_iter().filter(|b| made_of.contains(&b.0)).collect() };
    let (held, after) = (only(held), only(after));
    let measurer =
        ShapeMeasurer::new(target, &region, &pile_of(&props, if start.is_empty() { &after } else { &start }));
    let measurer = match inputs.filled {
        Some((container, _)) if !container.scenery().is_empty() => {
            let units = pile.world.units;
            measurer.within(|p| container.distance.signed_distance(units.point_to_engine(p)) <= 0.0)
        }
        _ => measurer,
    };
    let measurer = match inputs.core {
        Some(core) => measurer.around(&core.mesh),
        None => measurer,
    };
    let mut measured = Measured::nothing();
    let first = (!start.is_empty()).then(|| measured.measure(&measurer, &pile_of(&props, &start), None));
    observe(observer, &inputs.progress(0.4))?;
    let at_end = (!held.is_empty()).then(|| measured.measure(&measurer, &pile_of(&props, &held), first.as_ref()));
    if let Some(at_end) = &at_end {
        measured.figures.extend(at_end.figures().map(|(name, value)| (name, Some(value))));
    }
    // A pile of a given number of bodies, or around a core, need not fill the shape.
    let fills = inputs.core.is_none() && inputs.params.fill.count.is_none() && inputs.filled.is_some();
    let is_poor = |measures: &ShapeMeasures| measures.shape_iou.value < POOR_MATCH;
    // What was full and has fallen needs no smaller props.
    if fills && at_end.as_ref().is_some_and(is_poor) && first.as_ref().is_none_or(is_poor) {
        measured.shapes += 1;
        // What was filled and has fallen since is not empty for its thickness.
        let filled = if start.is_empty() { &held } else { &start };
        measured.empty_parts = LocalThickness::new(&region).uncovered(measurer.covered(&pile_of(&props, filled)));
    }
    if let Some(first) = &first {
        let kept = at_end.as_ref().and_then(|end| measure::kept_shape(first, &end.shape_iou));
        measured.figures.extend([
            ("shape_iou_start", Some(first.shape_iou.value)),
            ("height_p95_rel_start", Some(first.height_p95_rel)),
            // Defined right after turning over, and after the fill.
            ("protrusion_rel", Some(first.protrusion_rel)),
            ("fill_fraction", Some(first.fill_fraction)),
            ("kept_shape", kept),
        ]);
    }
    if let Some(glued) = inputs.glued {
        // Released without any hold, glued and not.
        for (name, poses) in
            [("kept_shape_freed", &glued.poses_with_glue), ("kept_shape_natural", &glued.poses_without_glue)]
        {
            let bodies = poses.as_ref().map(|poses| only(freed(pile, poses)));
            let kept = first.as_ref().zip(bodies).and_then(|(first, bodies)| {
                measured.shapes += 1;
                measure::kept_shape(first, &measurer.shape_iou(&pile_of(&props, &bodies)))
            });
            measured.figures.insert(name, kept);
        }
    }
    let mut first = first.or(at_end);
    let is_disturbed = hold_end < last || first.is_none();
    if is_disturbed {
        let shape = measured.measure(&measurer, &pile_of(&props, &after), first.as_ref());
        measured.figures.insert("shape_iou_after", Some(shape.shape_iou.value));
        measured.figures.insert("height_p95_rel_after", Some(shape.height_p95_rel));
        first.get_or_insert(shape);
    }
    measured.first = first;
    if inputs.resolved.is_on(EffectName::PictureFigures) {
        let begin = observer.cpu_seconds();
        let mut look = |bodies: &[(usize, f64, Pose)]| {
            measured.pictures += 1;
            measurer.look(&pile_of(&props, bodies))
        };
        let start = (!start.is_empty()).then(|| look(&start).silhouette_iou);
        let held = (!held.is_empty()).then(|| look(&held));
        let after = is_disturbed.then(|| look(&after).silhouette_iou);
        measured.figures.insert("silhouette_iou_start", start);
        measured.figures.insert("silhouette_iou", held.map(|held| held.silhouette_iou));
        measured.figures.insert("height_rms_rel", held.map(|held| held.height_rms_rel));
        measured.figures.extend(after.map(|after| ("silhouette_iou_after", Some(after))));
        measured.picture_seconds = observer.cpu_seconds() - begin;
    }
    Ok(measured)
}

/// The bodies that were left after the release on trial: prop, scale and pose.
fn freed(pile: &Pile, poses: &[Option<Pose>]) -> Vec<(usize, f64, Pose)> {
    let units = pile.world.units;
    let body = |(b, pose): (&Instance, &Option<Pose>)| {
        Some((b.prop, b.scale, pile.shapes[b.prop].prop_pose(&units.pose_to_si(pose.as_ref()?), b.scale)))
    };
    pile.instances.iter().zip(poses).filter_map(body).collect()
}

fn pile_of<'a>(props: &'a [TriMesh], bodies: &'a [(usize, f64, Pose)]) -> measure::Instances<'a> {
    measure::Instances { props, bodies }
}
