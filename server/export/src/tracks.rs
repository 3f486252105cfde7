//! The keyframes of one body, in the numbers of a glTF file.

use cairn_core::report::bake::BakedBody;
use cairn_geometry::pose::Pose;
use glam::DQuat;

/// The keys of one channel, without redundant ones.
pub struct Track<const N: usize> {
    /// Frames, ascending.
    pub frames: Vec<u32>,
    /// Shape `[frames.len()][N]`.
    pub values: Vec<[f32; N]>,
}

/// A body's translation per frame, metres.
pub fn translations(poses: impl Iterator<Item = Pose>) -> Vec<[f32; 3]> {
    poses.map(|pose| pose.translation.as_vec3().to_array()).collect()
}

/// A body's rotation per frame, x y z w: unit length, the first as it is, and each other in the half space of the one
/// before it, so that linear interpolation takes the short way.
pub fn rotations(poses: impl Iterator<Item = Pose>) -> Vec<[f32; 4]> {
    let mut before: Option<DQuat> = None;
    poses
        .map(|pose| {
            let unit = pose.rotation.normalize();
            let next = if before.is_some_and(|before| unit.dot(before) < 0.0) { -unit } else { unit };
            before = Some(next);
            next.as_quat().to_array()
        })
        .collect()
}

/// The scale of a body that appears later: nothing, then its own. The keys are not blended.
pub fn appearance(body: &BakedBody) -> Option<Track<3>> {
    let first = u32::try_from(body.first_frame).ok().filter(|&first| first > 0)?;
    Some(Track { frames: vec![0, first], values: vec![[0.0; 3], [body.scale as f32; 3]] })
}

/// Thins a channel: a key between two keys of the same value is redundant. Linear interpolation of the others gives
/// exactly the same value at every frame. `None` if the value never changes.
pub fn thin<const N: usize>(values: &[[f32; N]]) -> Option<Track<N>> {
    let first = values.first()?;
    if values.iter().all(|v| v == first) {
        return None;
    }
    let frames = key_frames(values);
    Some(Track {
        values: frames.iter().map(|&i| values[i]).collect(),
        frames: frames.into_iter().map(|i| i as u32).collect(),
    })
}

/// The frames whose value is not redundant, as that of a frame between two of the same value is.
pub fn key_frames<T: PartialEq>(values: &[T]) -> Vec<usize> {
    let last = values.len().saturating_sub(1);
    let is_key = |&i: &usize| i == 0 || i == last || values[i - 1] != values[i] || values[i] != values[i + 1];
    (0..values.len()).filter(is_key).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn keys_between_equal_keys_are_dropped() {
        let values = [[0.0], [0.0], [0.0], [1.0], [2.0], [2.0], [2.0], [2.0]];
        let track = thin(&values).unwrap();
        assert_eq!(track.frames, [0, 2, 3, 4, 7]);
        assert_eq!(track.values, [[0.0], [0.0], [1.0], [2.0], [2.0]]);
    }

    #[test]
    fn constant_channels_vanish() {
        assert!(thin(&[[1.0, 2.0]; 5]).is_none());
        assert!(thin(&[[1.0, 2.0]]).is_none());
        assert!(thin::<3>(&[]).is_none());
    }

    #[test]
    fn the_sign_of_a_rotation_follows_the_frame_before() {
        let turn = |angle: f64| Pose { translation: DVec3::ZERO, rotation: DQuat::from_rotation_y(angle) };
        // `from_rotation_y` changes sign once per turn: two turns in steps of 0.1, every second one negated.
        let poses = (0..126).map(|i| {
            let mut pose = turn(f64::from(i) * 0.1);
            pose.rotation = if i % 2 == 1 { -pose.rotation } else { pose.rotation };
            pose
        });
        let keys = rotations(poses);
        for pair in keys.windows(2) {
            let dot: f32 = pair[0].iter().zip(&pair[1]).map(|(a, b)| a * b).sum();
            assert!(dot > 0.99);
        }
    }
}
