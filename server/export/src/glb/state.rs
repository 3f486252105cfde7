//! What a later bake needs of a pile to change it: a buffer view that the extras of the node `pile` name, as
//! `cairn.state`.
//!
//! Little-endian: the version, and the numbers of bodies, of glue joints, of points and triangles of the shape, and of
//! those of the scenery near it, as u32; height of the ground as f64, not a number without one; of each body prop and
//! number in its name as u32, scale and the poses in the first and in the last frame as f64 (x, y, z; x, y, z, w); of
//! each glue joint its bodies as u32, the largest for the ground and scenery, and force and moment on the first as f64;
//! then points as f32 and triangles as u32 of the shape, and of the scenery.

use cairn_core::report::bake::{BakedBody, BakedGlueDot, BakedPile};
use cairn_geometry::mesh::{TriMesh, bounds, boxes_meet};
use cairn_geometry::pose::Pose;
use cairn_gltf::Document;
use cairn_gltf::document::{reference, references};
use cairn_input::earlier::{EarlierBody, EarlierDot, EarlierProp};
use cairn_input::scene::StaticModel;
use glam::{DQuat, DVec3};
use serde_json::Value;
use std::collections::BTreeSet;

/// The member of the extras.
pub const KEY: &str = "state";

const VERSION: u32 = 1;
const NO_BODY: u32 = u32::MAX;
/// Largest number in a body's name: those of new bodies are larger, and still fit a message.
const MOST_NUMBER: u32 = 1 << 30;
/// Scenery that is farther from the shape than this, d, is left out: no change of it is near a body.
const FAR: f64 = 4.0;

/// The state of a pile as a result holds it. SI.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PileState {
    /// The bodies of the fill. Each prop is an index into the props of the result's scene.
    pub bodies: Vec<EarlierBody>,
    /// Its glue between them, and to the ground and scenery.
    pub dots: Vec<EarlierDot>,
    /// The shape that was filled; coordinates in single precision.
    pub shape: TriMesh,
    /// Scenery near it in the first frame; coordinates in single precision.
    pub scenery: TriMesh,
    /// Height of the ground, m.
    pub ground: Option<f64>,
}

/// Why a result's state cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum NoState {
    #[error("it holds no filled pile")]
    Absent,
    #[error("what it holds of its pile is damaged")]
    Damaged,
}

/// The state of a filled pile. `colliders`: the scenery that it met.
pub fn encode(bake: &BakedPile, shape: &TriMesh, colliders: &[StaticModel]) -> Vec<u8> {
    let scenery = scenery(shape, colliders, FAR * bake.world.diameter);
    let mut bytes = Vec::new();
    let is_own = |dot: &&BakedGlueDot| {
        !dot.is_broken && dot.body < bake.filled && dot.other.is_none_or(|other| other < bake.filled)
    };
    let dots: Vec<&BakedGlueDot> = bake.glue.iter().flat_map(|glue| &glue.dots).filter(is_own).collect();
    let counts = [
        bake.filled,
        dots.len(),
        shape.points.len(),
        shape.triangles.len(),
        scenery.points.len(),
        scenery.triangles.len(),
    ];
    let whole = |bytes: &mut Vec<u8>, n: usize| bytes.extend((n as u32).to_le_bytes());
    whole(&mut bytes, VERSION as usize);
    counts.into_iter().for_each(|n| whole(&mut bytes, n));
    bytes.extend(bake.world.ground.unwrap_or(f64::NAN).to_le_bytes());
    for (id, &BakedBody { prop, number, scale, .. }) in bake.bodies.iter().enumerate().take(bake.filled) {
        whole(&mut bytes, prop);
        whole(&mut bytes, number);
        bytes.extend(scale.to_le_bytes());
        for pose in ends(bake, id) {
            let numbers = pose.translation.to_array().into_iter().chain(pose.rotation.to_array());
            numbers.for_each(|x| bytes.extend(x.to_le_bytes()));
        }
    }
    for dot in dots {
        whole(&mut bytes, dot.body);
        whole(&mut bytes, dot.other.unwrap_or(NO_BODY as usize));
        dot.force.iter().chain(&dot.moment).for_each(|x| bytes.extend(x.to_le_bytes()));
    }
    for mesh in [shape, &scenery] {
        mesh.points.iter().flat_map(|p| p.as_vec3().to_array()).for_each(|x| bytes.extend(x.to_le_bytes()));
        mesh.triangles.iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    bytes
}

/// The first and the last pose of a body. Of the two quaternions of its last rotation, it is the one that the animation
/// has.
fn ends(bake: &BakedPile, id: usize) -> [Pose; 2] {
    let first = bake.frames.first().map_or(Pose::IDENTITY, |frame| frame[id]);
    let last = bake.frames.iter().fold(first, |before, frame| {
        let Pose { translation, rotation } = frame[id];
        Pose { translation, rotation: if rotation.dot(before.rotation) < 0.0 { -rotation } else { rotation } }
    });
    [first, last]
}

/// Scenery near the shape as it stands in the first frame.
fn scenery(shape: &TriMesh, colliders: &[StaticModel], reach: f64) -> TriMesh {
    let (low, high) = shape.bounds();
    let mut near = TriMesh::default();
    for model in colliders {
        let Pose { translation, rotation } = model.pose_at(0.0);
        let mesh = &model.model.mesh;
        let moved = |p: DVec3| if model.keys.is_empty() { p } else { rotation * p + translation };
        let mut places = vec![u32::MAX; mesh.points.len()];
        for triangle in &mesh.triangles {
            let corners = triangle.map(|v| moved(mesh.points[v as usize]));
            if !boxes_meet(bounds(corners.into_iter()), (low, high), DVec3::splat(reach)) {
                continue;
            }
            for (v, corner) in triangle.iter().zip(corners) {
                if places[*v as usize] == u32::MAX {
                    places[*v as usize] = near.points.len() as u32;
                    near.points.push(corner);
                }
            }
            near.triangles.push(triangle.map(|v| places[v as usize]));
        }
    }
    near
}

/// The state that a result holds.
pub fn read(bytes: &[u8]) -> Result<PileState, NoState> {
    let own = |_: &str| Err("a result holds its data itself".into());
    let document = Document::parse(bytes, &own).map_err(|_| NoState::Absent)?;
    let (_, pile) = cairn_render::nodes::pile(&document).ok_or(NoState::Absent)?;
    let entries = pile.get("extras").and_then(|extras| extras.get(super::glue::KEY)).and_then(Value::as_object);
    let view = entries.and_then(|entries| reference(entries, KEY)).ok_or(NoState::Absent)?;
    let state = document.view(view).ok().and_then(|bytes| Cursor { bytes }.state()).ok_or(NoState::Damaged)?;
    // Later frames may have more bodies, but none has fewer.
    if state.bodies.len() > references(pile, "children").len() { Err(NoState::Damaged) } else { Ok(state) }
}

/// What is not read yet.
struct Cursor<'a> {
    bytes: &'a [u8],
}

impl Cursor<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.bytes.split_first_chunk::<N>()?;
        self.bytes = rest;
        Some(*first)
    }

    fn whole(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn number(&mut self) -> Option<f64> {
        self.take().map(f64::from_le_bytes)
    }

    fn finite(&mut self) -> Option<f64> {
        self.number().filter(|x| x.is_finite())
    }

    fn vector(&mut self) -> Option<DVec3> {
        Some(DVec3::new(self.finite()?, self.finite()?, self.finite()?))
    }

    fn pose(&mut self) -> Option<Pose> {
        let translation = self.vector()?;
        let rotation = DQuat::from_xyzw(self.finite()?, self.finite()?, self.finite()?, self.finite()?);
        rotation.is_normalized().then_some(Pose { translation, rotation })
    }

    fn body(&mut self) -> Option<EarlierBody> {
        let (prop, number, scale) = (self.whole()? as usize, self.whole()?, self.finite()?);
        let (first, last) = (self.pose()?, self.pose()?);
        let is_right = scale > 0.0 && number <= MOST_NUMBER;
        let (prop, number) = (EarlierProp::Same(prop), number as usize);
        is_right.then_some(EarlierBody { prop, number, scale, first, last })
    }

    fn dot(&mut self, bodies: u32) -> Option<EarlierDot> {
        let (body, other) = (self.whole()?, Some(self.whole()?).filter(|other| *other != NO_BODY));
        let (force, moment) = (self.vector()?, self.vector()?);
        let is_there = body < bodies && other.is_none_or(|other| other < bodies && other != body);
        let other = other.map(|other| other as usize);
        is_there.then_some(EarlierDot { body: body as usize, other, force, moment })
    }

    fn mesh(&mut self, points: u32, triangles: u32) -> Option<TriMesh> {
        let mut coordinate = || self.take().map(f32::from_le_bytes).filter(|x| x.is_finite()).map(f64::from);
        let mut mesh = TriMesh::default();
        for _ in 0..points {
            mesh.points.push(DVec3::new(coordinate()?, coordinate()?, coordinate()?));
        }
        for _ in 0..triangles {
            let triangle = [self.whole()?, self.whole()?, self.whole()?];
            mesh.triangles.push(triangle);
            if triangle.iter().any(|v| *v >= points) {
                return None;
            }
        }
        Some(mesh)
    }

    fn state(mut self) -> Option<PileState> {
        if self.whole()? != VERSION {
            return None;
        }
        let [count, joints] = [self.whole()?, self.whole()?];
        let [points, triangles, near_points, near_triangles] =
            [self.whole()?, self.whole()?, self.whole()?, self.whole()?];
        let ground = Some(self.number()?).filter(|height| height.is_finite());
        let (mut bodies, mut numbers) = (Vec::new(), BTreeSet::new());
        for _ in 0..count {
            let body = self.body()?;
            if !numbers.insert(body.number) {
                return None;
            }
            bodies.push(body);
        }
        let mut dots = Vec::new();
        for _ in 0..joints {
            dots.push(self.dot(count)?);
        }
        let shape = self.mesh(points, triangles)?;
        let scenery = self.mesh(near_points, near_triangles)?;
        self.bytes.is_empty().then_some(PileState { bodies, dots, shape, scenery, ground })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damaged_state_is_refused() {
        let triangle = TriMesh { points: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]] };
        let mut bytes: Vec<u8> = [VERSION, 0, 0, 3, 1, 0, 0].iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes.extend(f64::NAN.to_le_bytes());
        triangle.points.iter().flat_map(|p| p.as_vec3().to_array()).for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0u32, 1, 2].iter().flat_map(|v| v.to_le_bytes()));
        let state = Cursor { bytes: &bytes }.state().unwrap();
        assert_eq!(state, PileState { shape: triangle, ..PileState::default() });
        for length in 0..bytes.len() {
            assert_eq!(Cursor { bytes: &bytes[..length] }.state(), None, "{length} bytes of {}", bytes.len());
        }
        let last = bytes.len() - 4;
        bytes[last] = 3;
        assert_eq!(Cursor { bytes: &bytes }.state(), None);
    }

    /// A state of two bodies, a joint between them, and a triangle.
    fn small() -> Vec<u8> {
        let mut bytes: Vec<u8> = [VERSION, 2, 1, 3, 1, 3, 1].iter().flat_map(|n| n.to_le_bytes()).collect();
        bytes.extend(0f64.to_le_bytes());
        for number in [0u32, 7] {
            bytes.extend([0, number].iter().flat_map(|n| n.to_le_bytes()));
            let pose = [0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0];
            bytes.extend([1.0].iter().chain(&pose).chain(&pose).flat_map(|x: &f64| x.to_le_bytes()));
        }
        bytes.extend([0u32, 1].iter().flat_map(|n| n.to_le_bytes()));
        bytes.extend([1.0; 6].iter().flat_map(|x: &f64| x.to_le_bytes()));
        for _ in 0..2 {
            bytes.extend([0.0; 9].iter().flat_map(|x: &f32| x.to_le_bytes()));
            bytes.extend([0u32, 1, 2].iter().flat_map(|v| v.to_le_bytes()));
        }
        bytes
    }

    /// Whatever its bytes are, a state is refused, or all that it refers to is there.
    #[test]
    fn any_bytes_are_refused_or_are_a_state() {
        let whole = small();
        let read = Cursor { bytes: &whole }.state().unwrap();
        assert_eq!((read.bodies.len(), read.dots.len(), read.bodies[1].number), (2, 1, 7));
        let (mut draw, mut taken) = (1u64, 0);
        let mut next = |below: usize| {
            draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (draw >> 33) as usize % below
        };
        for _ in 0..50_000 {
            let mut bytes = whole.clone();
            for _ in 0..=next(3) {
                let (at, value) = (next(bytes.len()), [0, 1, 2, 0x7f, 0x80, 0xff][next(6)]);
                match next(3) {
                    0 => bytes[at] = value,
                    1 => bytes[at] ^= 1 << next(8),
                    _ => {
                        let end = (at + 1 + next(8)).min(bytes.len());
                        bytes.drain(at..end);
                        bytes.push(0);
                    }
                }
            }
            let Some(state) = (Cursor { bytes: &bytes }).state() else { continue };
            taken += 1;
            let count = state.bodies.len();
            let numbers: BTreeSet<usize> = state.bodies.iter().map(|body| body.number).collect();
            assert!(numbers.len() == count && numbers.iter().all(|number| *number <= MOST_NUMBER as usize));
            let is_there = |dot: &EarlierDot| dot.body < count && dot.other.is_none_or(|other| other < count);
            assert!(state.dots.iter().all(is_there));
            for mesh in [&state.shape, &state.scenery] {
                assert!(mesh.points.iter().all(|p| p.is_finite()));
                assert!(mesh.triangles.iter().flatten().all(|v| (*v as usize) < mesh.points.len()));
            }
        }
        assert!(taken > 1000, "{taken} of them can be read");
    }
}
