//! The transform of a node relative to its parent.

use glam::{DAffine3, DQuat, DVec3};

use super::Object;

/// Translation, rotation and scale.
#[derive(Clone, Copy)]
pub struct LocalTransform {
    pub translation: DVec3,
    pub rotation: DQuat,
    pub scale: DVec3,
}

impl LocalTransform {
    /// Of a node without a matrix; a member that is no list of numbers takes glTF's default.
    pub fn of(node: &Object) -> LocalTransform {
        LocalTransform {
            translation: numbers(node, "translation").map_or(DVec3::ZERO, DVec3::from_array),
            rotation: numbers(node, "rotation").map_or(DQuat::IDENTITY, |q| unit(DQuat::from_array(q))),
            scale: numbers(node, "scale").map_or(DVec3::ONE, DVec3::from_array),
        }
    }

    pub fn affine(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

/// Normalised, even if the file has another length.
pub fn unit(q: DQuat) -> DQuat {
    if q.length_squared() > 0.0 { q.normalize() } else { DQuat::IDENTITY }
}

/// The matrix of a node that has one, column by column.
pub fn matrix(node: &Object) -> Option<[f64; 16]> {
    numbers(node, "matrix")
}

fn numbers<const N: usize>(node: &Object, key: &str) -> Option<[f64; N]> {
    let items = node.get(key)?.as_array()?.iter();
    let numbers: Option<Vec<f64>> = items.map(|v| v.as_f64().filter(|v| v.is_finite())).collect();
    numbers?.try_into().ok()
}
