//! Values of a stage, of whatever precision, as numbers.

use openusd::gf;
use openusd::sdf::Value;

/// Rotations of single precision are no farther from length 1. Those of half precision are.
const ROUNDING: f32 = 1e-5;

pub fn number(value: Value) -> Option<f64> {
    match value {
        Value::Double(number) => Some(number),
        Value::Float(number) => Some(number.into()),
        Value::Half(number) => Some(number.into()),
        Value::Int(number) => Some(number.into()),
        Value::Int64(number) => Some(number as f64),
        _ => None,
    }
}

pub fn vector(value: Value) -> Option<[f32; 3]> {
    match value {
        Value::Vec3f(v) => Some(v.into()),
        Value::Vec3d(v) => Some([v.x as f32, v.y as f32, v.z as f32]),
        Value::Vec3h(v) => Some([v.x, v.y, v.z].map(f32::from)),
        _ => None,
    }
}

pub fn vectors(value: Value) -> Option<Vec<[f32; 3]>> {
    match value {
        Value::Vec3fVec(all) => Some(all.into_iter().map(Into::into).collect()),
        Value::Vec3dVec(all) => Some(all.into_iter().map(|v| [v.x as f32, v.y as f32, v.z as f32]).collect()),
        Value::Vec3hVec(all) => Some(all.into_iter().map(|v| [v.x, v.y, v.z].map(f32::from)).collect()),
        _ => None,
    }
}

/// As glTF has it: x, y, z, w.
pub fn quaternion(value: Value) -> Option<[f32; 4]> {
    match value {
        Value::Quatf(gf::Quatf { w, x, y, z }) => Some([x, y, z, w]),
        Value::Quatd(gf::Quatd { w, x, y, z }) => Some([x, y, z, w].map(|part| part as f32)),
        Value::Quath(gf::Quath { w, x, y, z }) => Some([x, y, z, w].map(f32::from)),
        _ => None,
    }
}

pub fn quaternions(value: Value) -> Option<Vec<[f32; 4]>> {
    match value {
        Value::QuatfVec(all) => all.into_iter().map(|q| quaternion(Value::Quatf(q))).collect(),
        Value::QuatdVec(all) => all.into_iter().map(|q| quaternion(Value::Quatd(q))).collect(),
        Value::QuathVec(all) => all.into_iter().map(|q| quaternion(Value::Quath(q))).collect(),
        _ => None,
    }
}

/// A rotation of length 1; none where there is none. What is one but for rounding stays as it is.
pub fn unit(turn: [f32; 4]) -> [f32; 4] {
    let length = turn.iter().map(|part| part * part).sum::<f32>().sqrt();
    if (length - 1.0).abs() < ROUNDING {
        return turn;
    }
    if length > 0.0 && length.is_finite() { turn.map(|part| part / length) } else { [0.0, 0.0, 0.0, 1.0] }
}

/// Vectors of any width, each as a list.
pub fn rows(value: Value) -> Option<Vec<Vec<f32>>> {
    match value {
        Value::Vec2fVec(all) => Some(all.into_iter().map(|v| vec![v.x, v.y]).collect()),
        Value::Vec2dVec(all) => Some(all.into_iter().map(|v| vec![v.x as f32, v.y as f32]).collect()),
        Value::Vec4f(v) => Some(vec![vec![v.x, v.y, v.z, v.w]]),
        other => Some(vectors(other)?.into_iter().map(|v| v.to_vec()).collect()),
    }
}
