//! Where prims are: the steps of their transforms, and their motion.

use super::values::{number, quaternion, unit, vector};
use super::{Converter, Samples};
use cairn_gltf::document::Object;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use openusd::sdf::{Path, Value};
use serde_json::json;

/// Kinds of prims that have no place of their own, whatever they state.
const WITHOUT_PLACE: [&str; 2] = ["", "Scope"];
/// A transform begins at the world instead of at the prim above.
const RESET: &str = "!resetXformStack!";
const INVERTED: &str = "!invert!";
/// Steps of a transform: more than any program writes.
const MOST_STEPS: usize = 1000;
/// Poses of prims that move in other ways than glTF's, times the samples that each is made of: more, and they stand
/// still.
const MOST_WORK: usize = 10_000_000;
/// Frames of such a prim.
const MOST_FRAMES: f64 = 1e5;
/// A matrix is a turn and a scale along axes up to this, relative to its largest column.
const SHEAR: f64 = 1e-5;

/// The transform of a prim.
pub(super) struct Steps {
    /// Names of its steps, the outermost first.
    pub steps: Vec<String>,
    /// It does not depend on the prims above.
    pub resets: bool,
}

/// The place of a prim in what is above it, or in the world.
pub(super) struct PrimPlace {
    pub matrix: DMat4,
    resets: bool,
}

impl PrimPlace {
    /// In the world, below a place.
    pub fn below(&self, above: DMat4, world: DMat4) -> DMat4 {
        (if self.resets { world } else { above }) * self.matrix
    }
}

impl Converter<'_> {
    pub(super) fn steps(&self, prim: &Path) -> Steps {
        let order = match self.value(prim, "xformOpOrder") {
            Some(Value::TokenVec(order)) if !WITHOUT_PLACE.contains(&&*self.kind(prim)) => order,
            _ => Vec::new(),
        };
        let mut steps: Vec<String> = order.iter().map(|step| step.as_str().to_owned()).collect();
        // What is before the last one counts for nothing.
        let reset = steps.iter().rposition(|step| step == RESET);
        if let Some(reset) = reset {
            steps.drain(..=reset);
        }
        Steps { steps, resets: reset.is_some() }
    }

    /// The place of a prim, as at the start.
    pub(super) fn place(&self, prim: &Path) -> Result<PrimPlace, String> {
        let Steps { steps, resets } = self.steps(prim);
        Ok(PrimPlace { matrix: self.matrix(prim, &steps, self.clock[0])?, resets })
    }

    /// The product of steps at a time code.
    fn matrix(&self, prim: &Path, steps: &[String], time: f64) -> Result<DMat4, String> {
        if steps.len() > MOST_STEPS {
            return Err(format!("{}: its transform has more than {MOST_STEPS} steps", prim.as_str()));
        }
        let mut all = DMat4::IDENTITY;
        for step in steps {
            all *= self.step(prim, step, time).ok_or_else(|| {
                format!(
                    "{}: its transform has {step}, which is none of USD's steps, or has no such value",
                    prim.as_str()
                )
            })?;
        }
        // Rounding of its inverses aside, its last row is that of a place.
        Ok(DMat4::from(DAffine3::from_mat4(all)))
    }

    /// The transform of a prim: parts that may move, where it has the usual ones, else a matrix. Whether it does not
    /// depend on the prims above.
    pub(super) fn transform(&mut self, prim: &Path, node: &mut Object, place: usize) -> Result<bool, String> {
        let Steps { steps, resets } = self.steps(prim);
        let usual = ["xformOp:translate", "xformOp:orient", "xformOp:scale"];
        let mut rest = &usual[..];
        let is_usual = steps.iter().all(|step| match rest.iter().position(|one| one == step) {
            Some(at) => {
                rest = &rest[at + 1..];
                true
            }
            None => false,
        });
        if !is_usual {
            self.moving_matrix(prim, &steps, node, place)?;
            return Ok(resets);
        }
        for (step, name) in usual.into_iter().zip(["translation", "rotation", "scale"]) {
            if !steps.iter().any(|one| one == step) {
                continue;
            }
            if name == "rotation" {
                let Some(samples) = self.samples(prim, step, |value| quaternion(value).map(unit)) else { continue };
                node.insert(name.into(), json!(samples[0].1));
                self.channel(place, name, "LINEAR", &samples);
            } else {
                let Some(samples) = self.samples(prim, step, vector) else { continue };
                node.insert(name.into(), json!(samples[0].1));
                self.channel(place, name, "LINEAR", &samples);
            }
        }
        Ok(resets)
    }

    /// A matrix, which moves as translation, rotation and scale at each frame.
    fn moving_matrix(&mut self, prim: &Path, steps: &[String], node: &mut Object, place: usize) -> Result<(), String> {
        let first = self.matrix(prim, steps, self.clock[0])?;
        let (times, samples) = if self.is_still { Default::default() } else { self.times(prim, steps) };
        if times.is_empty() {
            node.insert("matrix".into(), json!(first.to_cols_array()));
            return Ok(());
        }
        self.work = self.work.saturating_add(times.len().saturating_mul(samples));
        let mut poses = Vec::new();
        if self.work <= MOST_WORK {
            for &time in &times {
                poses.push(parts(self.matrix(prim, steps, time)?));
            }
        }
        let poses: Option<Vec<_>> = poses.into_iter().collect();
        let Some(poses) = poses.filter(|poses| !poses.is_empty()) else {
            self.note(
                "the motion of prims that shear, or of very many prims, is left out: they stand as at the start",
                prim,
            );
            node.insert("matrix".into(), json!(first.to_cols_array()));
            return Ok(());
        };
        let (mut moves, mut turns, mut sizes) = (Samples::new(), Samples::new(), Samples::new());
        let mut before = DQuat::IDENTITY;
        for (time, (scale, rotation, translation)) in times.into_iter().zip(poses) {
            // The shorter way round.
            let rotation = if rotation.dot(before) < 0.0 { -rotation } else { rotation };
            before = rotation;
            moves.push((time, translation.as_vec3().to_array()));
            turns.push((time, rotation.as_quat().to_array()));
            sizes.push((time, scale.as_vec3().to_array()));
        }
        node.insert("translation".into(), json!(moves[0].1));
        node.insert("rotation".into(), json!(turns[0].1));
        node.insert("scale".into(), json!(sizes[0].1));
        self.channel(place, "translation", "LINEAR", &moves);
        self.channel(place, "rotation", "LINEAR", &turns);
        self.channel(place, "scale", "LINEAR", &sizes);
        Ok(())
    }

    /// The time codes at which a prim's transform is asked for, from the start on: those of its samples, and the frames
    /// between them. None where it does not move. And the number of samples.
    fn times(&self, prim: &Path, steps: &[String]) -> (Vec<f64>, usize) {
        let start = self.clock[0];
        let names = steps.iter().map(|step| step.strip_prefix(INVERTED).unwrap_or(step));
        let samples = names.filter_map(|name| self.stage.samples(prim, name));
        let mut times: Vec<f64> = samples.flatten().map(|(time, _)| time.max(start)).collect();
        let samples = times.len();
        let last = times.iter().copied().fold(start, f64::max);
        let frames = (last - start).floor();
        if frames <= MOST_FRAMES {
            times.extend((0..=frames as u64).map(|frame| start + frame as f64));
        }
        times.push(start);
        times.sort_by(f64::total_cmp);
        times.dedup();
        (if times.len() > 1 { times } else { Vec::new() }, samples)
    }

    /// One step of a transform. One without a value does nothing.
    fn step(&self, prim: &Path, step: &str, time: f64) -> Option<DMat4> {
        let (name, is_inverse) = match step.strip_prefix(INVERTED) {
            Some(name) => (name, true),
            None => (step, false),
        };
        let kind = name.strip_prefix("xformOp:")?.split(':').next()?;
        let value = self.stage.value(prim, name, time);
        let three =
            || value.clone().map_or(Some(DVec3::ZERO), |value| Some(DVec3::from(vector(value)?.map(f64::from))));
        let one = || value.clone().map_or(Some(0.0), number);
        let matrix = match kind {
            _ if value.is_none() && KINDS.contains(&kind) => DMat4::IDENTITY,
            "translate" => DMat4::from_translation(three()?),
            "translateX" => DMat4::from_translation(DVec3::X * one()?),
            "translateY" => DMat4::from_translation(DVec3::Y * one()?),
            "translateZ" => DMat4::from_translation(DVec3::Z * one()?),
            "scale" => DMat4::from_scale(three()?),
            "scaleX" => DMat4::from_scale(DVec3::ONE.with_x(one()?)),
            "scaleY" => DMat4::from_scale(DVec3::ONE.with_y(one()?)),
            "scaleZ" => DMat4::from_scale(DVec3::ONE.with_z(one()?)),
            "orient" => {
                let [x, y, z, w] = quaternion(value?)?.map(f64::from);
                DMat4::from_quat(DQuat::from_xyzw(x, y, z, w).normalize())
            }
            "transform" => match value? {
                Value::Matrix4d(matrix) => DMat4::from_cols_array(&matrix.0),
                _ => return None,
            },
            "rotateX" => DMat4::from_rotation_x(one()?.to_radians()),
            "rotateY" => DMat4::from_rotation_y(one()?.to_radians()),
            "rotateZ" => DMat4::from_rotation_z(one()?.to_radians()),
            "rotateXYZ" => euler([0, 1, 2], three()?),
            "rotateXZY" => euler([0, 2, 1], three()?),
            "rotateYXZ" => euler([1, 0, 2], three()?),
            "rotateYZX" => euler([1, 2, 0], three()?),
            "rotateZXY" => euler([2, 0, 1], three()?),
            "rotateZYX" => euler([2, 1, 0], three()?),
            _ => return None,
        };
        let matrix = if is_inverse { matrix.inverse() } else { matrix };
        matrix.is_finite().then_some(matrix)
    }
}

/// Kinds of steps.
const KINDS: [&str; 19] = [
    "translate",
    "translateX",
    "translateY",
    "translateZ",
    "scale",
    "scaleX",
    "scaleY",
    "scaleZ",
    "orient",
    "transform",
    "rotateX",
    "rotateY",
    "rotateZ",
    "rotateXYZ",
    "rotateXZY",
    "rotateYXZ",
    "rotateYZX",
    "rotateZXY",
    "rotateZYX",
];

/// Turns about the axes in this order, in degrees.
fn euler(order: [usize; 3], degrees: DVec3) -> DMat4 {
    let angles = degrees.to_array().map(f64::to_radians);
    let turn = |axis: usize| match axis {
        0 => DMat3::from_rotation_x(angles[0]),
        1 => DMat3::from_rotation_y(angles[1]),
        _ => DMat3::from_rotation_z(angles[2]),
    };
    DMat4::from_mat3(turn(order[2]) * turn(order[1]) * turn(order[0]))
}

/// Scale, rotation and translation that make a matrix. `None` where there are none.
fn parts(matrix: DMat4) -> Option<(DVec3, DQuat, DVec3)> {
    let found = matrix.to_scale_rotation_translation();
    let (scale, rotation, translation) = found;
    if !(scale.is_finite() && rotation.is_finite()) {
        return None;
    }
    let again = DMat4::from_scale_rotation_translation(scale, rotation, translation);
    let size = scale.abs().max_element().max(translation.abs().max_element()).max(f64::MIN_POSITIVE);
    again.abs_diff_eq(matrix, SHEAR * size).then_some(found)
}
