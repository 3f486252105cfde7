//! The bodies of a pile: one `PointInstancer`.

use super::super::glue::GlueMembership;
use super::super::hierarchy::BranchFrame;
use super::super::{ExportError, ExportScene, tracks};
use super::binary::SHORTEST_COMPRESSED;
use super::bounding_box::BoundingBox;
use super::layer::{short_name, vector};
use super::layout::Layout;
use super::model::UsdStage;
use cairn_core::report::bake::BakedPile;
use cairn_geometry::pose::Pose;
use cairn_wire::proto::UsdMotion;
use glam::{DAffine3, DQuat, DVec3};
use openusd::gf;
use openusd::sdf::{FieldKey, Path, Value};
use std::collections::{BTreeMap, BTreeSet};

/// Values at moments, by their frames.
type Samples = Vec<(f64, Value)>;

/// What is known of the bodies that were written.
pub struct WrittenBodies {
    /// The prims of their props.
    pub prototypes: BTreeMap<usize, Path>,
    /// All of them in all frames that are shown, in the stage.
    pub bounds: BoundingBox,
}

/// Writes the bodies below the pile's prim.
pub fn write<'a>(
    stage: &mut UsdStage<'a>,
    pile: &Path,
    bake: &BakedPile,
    scene: &'a ExportScene,
) -> Result<WrittenBodies, ExportError> {
    let layout = stage.layer.layout.clone();
    let instancer = stage.layer.prim(pile, "Bodies", "PointInstancer");
    let (prototypes, bounds) = prototypes(stage, &instancer, bake, scene)?;
    let layer = &mut stage.layer;
    let targets: Vec<Path> = prototypes.values().map(|(_, prim)| prim.clone()).collect();
    layer.relationship(&instancer, "prototypes", &targets);
    let indices: Vec<i32> = bake.bodies.iter().map(|body| prototypes[&body.prop].0 as i32).collect();
    layer.attribute(&instancer, "int[] protoIndices", indices);
    layer.attribute(&instancer, "int64[] ids", (0..bake.bodies.len() as i64).collect::<Vec<_>>());

    let rotations = rotations(bake, &layout);
    let moments = moments(bake, &rotations, layout.motion);
    let is_full = layout.motion == UsdMotion::Full;
    let at = |values: &dyn Fn(&Moment) -> Value| -> Samples {
        moments.iter().map(|moment| (moment.time, values(moment))).collect()
    };
    let points = |v: Vec<DVec3>| Value::Vec3fVec(v.into_iter().map(vector).collect());
    let place = |frame: usize, body: usize| layout.place(bake.pivot_pose(frame, body).translation);
    let positions = at(&|m| points((0..bake.bodies.len()).map(|body| place(m.frame, body)).collect()));
    layer.animated(&instancer, "point3f[] positions", positions);
    let turns = moments.iter().map(|m| (m.time, rotations[m.frame].clone())).collect();
    layer.orientations(&instancer, turns, layout.motion != UsdMotion::Lean);
    let is_still = layout.motion == UsdMotion::None;
    layer.animated(&instancer, "float3[] scales", scales(bake, is_still));
    if bake.bodies.iter().any(|body| body.first_frame > 0) && !is_still {
        layer.animated(&instancer, "int64[] invisibleIds", invisible(bake));
    }
    if moments.len() > 1 && is_full {
        let velocities = at(&|m| points(motion(bake, m, |a, b, body| place(b, body) - place(a, body))));
        layer.animated(&instancer, "vector3f[] velocities", velocities);
        let turned = |a: usize, b: usize, body: usize| {
            layout.direction(turn(bake.frames[a][body].rotation, bake.frames[b][body].rotation))
        };
        let turns = at(&|m| points(motion(bake, m, turned)));
        layer.animated(&instancer, "vector3f[] angularVelocities", turns);
    }
    let first = if is_still { bake.frames.len() - 1 } else { 0 };
    let shown = first..bake.frames.len();
    let rooms: Vec<BoundingBox> = shown.map(|frame| room(bake, frame, &bounds, &layout)).collect();
    let extents: Vec<_> = rooms.iter().map(BoundingBox::extent).collect();
    let extent = |frame: usize| (frame as f64, Value::Vec3fVec(extents[frame].clone()));
    layer.animated(&instancer, "float3[] extent", changes(&extents).into_iter().map(extent).collect());
    if let Some(glue) = &bake.glue {
        let held = GlueMembership::all(glue, bake.bodies.len());
        let clusters: Vec<i32> = held.iter().map(|held| held.cluster.map_or(-1, |number| number as i32)).collect();
        let anchored: Vec<bool> = held.iter().map(|held| held.anchored).collect();
        layer.primvar(&instancer, "int[] primvars:cairn:cluster", "vertex", clusters);
        layer.primvar(&instancer, "bool[] primvars:cairn:anchored", "vertex", anchored);
    }
    let mut bounds = BoundingBox::default();
    rooms.iter().for_each(|room| bounds.join(room, DAffine3::IDENTITY));
    let prototypes = prototypes.into_iter().map(|(prop, (_, prim))| (prop, prim)).collect();
    Ok(WrittenBodies { prototypes, bounds })
}

/// The props that bodies have, by their numbers: place among the prototypes, and prim. And the bounding box of each.
type Prototypes = (BTreeMap<usize, (usize, Path)>, BTreeMap<usize, BoundingBox>);

fn prototypes<'a>(
    stage: &mut UsdStage<'a>,
    instancer: &Path,
    bake: &BakedPile,
    scene: &'a ExportScene,
) -> Result<Prototypes, ExportError> {
    let scope = stage.layer.prim(instancer, "Prototypes", "Scope");
    [instancer, &scope].into_iter().for_each(|prim| stage.group(prim));
    let (mut prims, mut bounds) = (BTreeMap::new(), BTreeMap::new());
    let used: BTreeSet<usize> = bake.bodies.iter().map(|body| body.prop).collect();
    for (place, prop) in used.into_iter().enumerate() {
        let model = &scene.props[prop];
        let prim = stage.layer.prim(&scope, short_name(model.name), "Xform");
        let shown = stage.layer.text(model.name);
        stage.layer.set(&prim, FieldKey::DisplayName, shown);
        let pivot = bake.solids[prop].pivot;
        let moved = DAffine3::from_translation(stage.layer.layout.place(-pivot));
        bounds.insert(prop, stage.put(&prim, model, BranchFrame::Origin, moved)?);
        prims.insert(prop, (place, prim));
    }
    Ok((prims, bounds))
}

/// Per frame and body, each in the half space of the one before it.
fn rotations(bake: &BakedPile, layout: &Layout) -> Vec<Vec<gf::Quatf>> {
    let mut rotations = vec![Vec::with_capacity(bake.bodies.len()); bake.frames.len()];
    for body in 0..bake.bodies.len() {
        let poses = bake.frames.iter().map(|poses| poses[body]);
        let track = tracks::rotations(poses.map(|pose| Pose { rotation: layout.rotation(pose.rotation), ..pose }));
        for (frame, [x, y, z, w]) in rotations.iter_mut().zip(track) {
            frame.push(gf::Quatf { w, x, y, z });
        }
    }
    rotations
}

/// The scales of the bodies: nothing until they appear. The steps are one frame long, in which [`invisible`] hides
/// them.
fn scales(bake: &BakedPile, is_still: bool) -> Samples {
    let at = |frame: usize| {
        let scale =
            |body: &cairn_core::report::bake::BakedBody| if frame < body.first_frame { 0.0 } else { body.scale };
        Value::Vec3fVec(bake.bodies.iter().map(|body| vector(DVec3::splat(scale(body)))).collect())
    };
    if is_still {
        return vec![(0.0, at(bake.frames.len() - 1))];
    }
    let steps = appearances(bake).into_iter().flat_map(|frame| [frame.saturating_sub(1), frame]);
    steps.collect::<BTreeSet<_>>().into_iter().map(|frame| (frame as f64, at(frame))).collect()
}

/// The bodies that have not appeared yet. A list that is too short for USD to compress repeats its bodies, which means
/// the same: see `binary`.
fn invisible(bake: &BakedPile) -> Samples {
    let at = |frame: usize| {
        let ids = bake.bodies.iter().enumerate().filter(|(_, body)| frame < body.first_frame).map(|(id, _)| id as i64);
        let ids: Vec<i64> = ids.collect();
        let count = if ids.is_empty() { 0 } else { ids.len().max(SHORTEST_COMPRESSED) };
        Value::Int64Vec(ids.into_iter().cycle().take(count).collect())
    };
    appearances(bake).into_iter().map(|frame| (frame as f64, at(frame))).collect()
}

/// Frame 0, and the frames in which bodies appear.
fn appearances(bake: &BakedPile) -> BTreeSet<usize> {
    std::iter::once(0).chain(bake.bodies.iter().map(|body| body.first_frame)).collect()
}

/// A sample of the motion.
struct Moment {
    /// Time code.
    time: f64,
    /// Whose poses it has.
    frame: usize,
    /// Nothing moves from here on, or up to here.
    is_still: bool,
}

/// The samples of the motion: frames whose poses, as they are written, are not redundant. USD extrapolates bodies by
/// their velocities, before the first sample and after the last one, too: these have none. Where the pile moves from
/// frame 0 on, its first sample is one frame before that.
fn moments(bake: &BakedPile, rotations: &[Vec<gf::Quatf>], motion: UsdMotion) -> Vec<Moment> {
    let place = |frame: usize, body: usize| vector(bake.pivot_pose(frame, body).translation);
    let written: Vec<_> = (rotations.iter().enumerate())
        .map(|(frame, turns)| ((0..bake.bodies.len()).map(|body| place(frame, body)).collect::<Vec<_>>(), turns))
        .collect();
    let last = written.len() - 1;
    if motion == UsdMotion::None {
        return vec![Moment { time: 0.0, frame: last, is_still: true }];
    }
    let frames = changes(&written);
    let moves_at_once = written.len() > 1 && written[0] != written[1];
    let before =
        (moves_at_once && motion == UsdMotion::Full).then_some(Moment { time: -1.0, frame: 0, is_still: true });
    let sample = |frame: usize| Moment { time: frame as f64, frame, is_still: frame == last };
    before.into_iter().chain(frames.into_iter().map(sample)).collect()
}

/// The frames whose value is not redundant; the first alone if it never changes.
fn changes<T: PartialEq>(values: &[T]) -> Vec<usize> {
    if values.iter().all(|value| *value == values[0]) { vec![0] } else { tracks::key_frames(values) }
}

/// Velocities between a frame and the next, per second, by which bodies arrive at the poses of the next frame.
///
/// `change`: of a body from one frame to another.
fn motion(bake: &BakedPile, moment: &Moment, change: impl Fn(usize, usize, usize) -> DVec3) -> Vec<DVec3> {
    let from = moment.frame;
    let of = |body| if moment.is_still { DVec3::ZERO } else { change(from, from + 1, body) * bake.fps };
    (0..bake.bodies.len()).map(of).collect()
}

/// The turn from one rotation to another by the short way: its axis, as long as its angle in degrees.
fn turn(from: DQuat, to: DQuat) -> DVec3 {
    let turn = (to * from.inverse()).normalize();
    let (axis, angle) = (if turn.w < 0.0 { -turn } else { turn }).to_axis_angle();
    axis * angle.to_degrees()
}

/// The bounding box of all bodies that have appeared, in the stage.
fn room(bake: &BakedPile, frame: usize, bounds: &BTreeMap<usize, BoundingBox>, layout: &Layout) -> BoundingBox {
    let mut all = BoundingBox::default();
    for (index, body) in bake.bodies.iter().enumerate().filter(|(_, body)| body.first_frame <= frame) {
        let (scale, pose) = (DVec3::splat(body.scale), bake.pivot_pose(frame, index));
        let (rotation, place) = (layout.rotation(pose.rotation), layout.place(pose.translation));
        all.join(&bounds[&body.prop], DAffine3::from_scale_rotation_translation(scale, rotation, place));
    }
    all
}

/// The poses that a stage shows, as it has them.
fn shown<'a>(poses: &'a [Pose], layout: &'a Layout) -> impl Iterator<Item = Pose> + 'a {
    let poses = if layout.motion == UsdMotion::None { &poses[poses.len() - 1..] } else { poses };
    poses
        .iter()
        .map(|pose| Pose { translation: layout.place(pose.translation), rotation: layout.rotation(pose.rotation) })
}

/// A box in all poses of its prim.
pub fn swept(bounds: &BoundingBox, poses: &[Pose], layout: &Layout) -> BoundingBox {
    let mut all = BoundingBox::default();
    for pose in shown(poses, layout) {
        all.join(bounds, DAffine3::from_rotation_translation(pose.rotation, pose.translation));
    }
    all
}

/// Writes a prim that is placed by poses.
pub fn place(stage: &mut UsdStage, prim: &Path, poses: &[Pose]) {
    let layout = stage.layer.layout.clone();
    let poses: Vec<Pose> = shown(poses, &layout).collect();
    let moments = |track: Option<Vec<u32>>| track.unwrap_or_else(|| vec![0]);
    let translations = tracks::translations(poses.iter().copied());
    let frames = moments(tracks::thin(&translations).map(|track| track.frames));
    let value = |frame: u32| Value::Vec3d(translations[frame as usize].map(f64::from).into());
    let samples = frames.into_iter().map(|frame| (f64::from(frame), value(frame))).collect();
    stage.layer.animated(prim, "double3 xformOp:translate", samples);
    let rotations = tracks::rotations(poses.iter().copied());
    let frames = moments(tracks::thin(&rotations).map(|track| track.frames));
    let value = |frame: u32| {
        let [x, y, z, w] = rotations[frame as usize];
        Value::Quatf(gf::Quatf { w, x, y, z })
    };
    let samples = frames.into_iter().map(|frame| (f64::from(frame), value(frame))).collect();
    stage.layer.animated(prim, "quatf xformOp:orient", samples);
    stage.layer.order(prim, &["xformOp:translate", "xformOp:orient"]);
}
