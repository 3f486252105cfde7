//! Contacts of two shapes of which one has several parts.
//!
//! A pair remembers which parts of the two are near each other, and how far apart each such pair of parts was when it was
//! last looked at: until the shapes may have moved by as much, it is not looked at again. So neither which pairs touch
//! nor where they touch depends on what is skipped.

use super::Manifolds;
use rapier3d::parry::bounding_volume::Aabb;
use rapier3d::parry::query::{
    ContactManifold, ContactManifoldsWorkspace, TypedWorkspaceData, WorkspaceData,
};
use rapier3d::parry::shape::{Compound, HalfSpace, Shape};
use rapier3d::prelude::*;

/// Parts that are farther apart than this many predictions are not listed as near.
const NEAR_PARTS: f32 = 8.0;
/// A motion is larger by this share of the shape, by rounding.
const MOTION_ROUNDING: f32 = 1e-6;

/// A shape as its parts, each with its box.
enum Parts<'a> {
    Several(&'a Compound),
    One(&'a dyn Shape, Aabb),
    /// It has no box.
    Plane(&'a HalfSpace),
}

impl<'a> Parts<'a> {
    fn new(shape: &'a dyn Shape) -> Parts<'a> {
        if let Some(compound) = shape.as_compound() {
            Parts::Several(compound)
        } else if let Some(plane) = shape.as_halfspace() {
            Parts::Plane(plane)
        } else {
            Parts::One(shape, shape.compute_local_aabb())
        }
    }

    fn count(&self) -> usize {
        match self {
            Parts::Several(compound) => compound.shapes().len(),
            _ => 1,
        }
    }

    fn part(&self, i: usize) -> (&'a dyn Shape, Pose) {
        match self {
            Parts::Several(compound) => (&*compound.shapes()[i].1, compound.shapes()[i].0),
            Parts::One(shape, _) => (*shape, Pose::IDENTITY),
            Parts::Plane(plane) => (*plane, Pose::IDENTITY),
        }
    }

    /// In the frame of the whole.
    fn aabb(&self, i: usize) -> Option<&Aabb> {
        match self {
            Parts::Several(compound) => Some(&compound.aabbs()[i]),
            Parts::One(_, aabb) => Some(aabb),
            Parts::Plane(_) => None,
        }
    }

    /// Of the sphere about the origin that holds the whole; that of a plane is moved only by a displacement.
    fn radius(&self) -> f32 {
        let of = |aabb: &Aabb| aabb.mins.abs().max(aabb.maxs.abs()).length();
        match self {
            Parts::Several(compound) => of(compound.local_aabb()),
            Parts::One(_, aabb) => of(aabb),
            Parts::Plane(_) => f32::INFINITY,
        }
    }
}

/// What a pair remembers.
#[derive(Clone, Default)]
struct PairMemory {
    /// The pose of the second shape, in the frame of the first, when near parts were last listed, and at the last look.
    listed_at: Pose,
    at: Pose,
    /// How far the two may move until parts that are not listed may be in contact.
    far: f32,
    /// How far they may move until any may be, since the last look.
    clear: f32,
    near: Vec<NearParts>,
}

#[derive(Clone)]
struct NearParts {
    parts: [u32; 2],
    /// Along which they were apart.
    axis: Vector,
    /// How far the two may move until these parts may be in contact.
    slack: f32,
}

impl WorkspaceData for PairMemory {
    fn as_typed_workspace_data(&self) -> TypedWorkspaceData<'_> {
        TypedWorkspaceData::Custom
    }

    fn clone_dyn(&self) -> Box<dyn WorkspaceData> {
        Box::new(self.clone())
    }
}

/// How far a point of the second shape moves at most, in the frame of the first. `radius`: of the sphere about its origin
/// that holds it.
fn motion(before: &Pose, now: &Pose, radius: f32) -> f32 {
    let turn = now.rotation * before.rotation.inverse();
    let chord = 2.0 * Vector::new(turn.x, turn.y, turn.z).length();
    (now.translation - before.translation).length() + (chord + MOTION_ROUNDING) * radius
}

/// Along the axis along which two boxes are farthest apart.
fn apart(a: &Aabb, b: &Aabb) -> f32 {
    (b.mins - a.maxs).max(a.mins - b.maxs).max_element()
}

/// The points of contact of two shapes, at least one of which has several parts and none of which is a mesh. `pos12`: of
/// the second shape, in the frame of the first.
pub(super) fn update_manifolds<M: Default + Clone + Send + Sync, C: Default + Copy + Send + Sync>(
    dispatcher: &Manifolds,
    pos12: &Pose,
    shapes: [&dyn Shape; 2],
    prediction: f32,
    manifolds: &mut Vec<ContactManifold<M, C>>,
    workspace: &mut Option<ContactManifoldsWorkspace>,
) {
    let [first, second] = shapes.map(Parts::new);
    // Seen from a plane, it is the other one that moves.
    let radius = if second.radius().is_finite() { second.radius() } else { first.radius() };
    let moved = |before: &Pose| match second {
        Parts::Plane(_) => motion(&before.inverse(), &pos12.inverse(), radius),
        _ => motion(before, pos12, radius),
    };
    let is_known = workspace.as_ref().is_some_and(|w| w.0.downcast_ref::<PairMemory>().is_some());
    if !is_known {
        *workspace = Some(ContactManifoldsWorkspace(Box::new(PairMemory { far: -1.0, ..PairMemory::default() })));
    }
    let Some(memory) = workspace.as_mut().and_then(|w| w.0.downcast_mut::<PairMemory>()) else { return };
    if is_known && manifolds.is_empty() && moved(&memory.at) < memory.clear {
        return;
    }
    if !is_known || moved(&memory.listed_at) >= memory.far {
        memory.list(pos12, [&first, &second], prediction);
    } else {
        let moved = moved(&memory.at);
        memory.near.iter_mut().for_each(|near| near.slack -= moved);
    }
    memory.at = *pos12;
    let (known, mut clear) = (manifolds.len(), memory.far - moved(&memory.listed_at));
    let mut next = 0;
    let mut is_new = false;
    for near in &mut memory.near {
        let [i, j] = near.parts;
        while next < known && [manifolds[next].subshape1, manifolds[next].subshape2] < near.parts {
            // It is no longer near.
            manifolds[next].points.clear();
            next += 1;
        }
        let has_one = next < known && [manifolds[next].subshape1, manifolds[next].subshape2] == near.parts;
        if near.slack > 0.0 {
            clear = clear.min(near.slack);
            if has_one {
                manifolds[next].points.clear();
                next += 1;
            }
            continue;
        }
        let ((a, at_a), (b, at_b)) = (first.part(i as usize), second.part(j as usize));
        let is_moved = at_a != Pose::IDENTITY || at_b != Pose::IDENTITY;
        let between = if is_moved { at_a.inv_mul(pos12) * at_b } else { *pos12 };
        let number = if has_one { next } else { manifolds.len() };
        if !has_one {
            let mut manifold = ContactManifold::with_data(i, j, M::default());
            if is_moved {
                manifold.set_subshape_pos1(Some(at_a));
                manifold.set_subshape_pos2(Some(at_b));
            }
            manifold.local_n1 = near.axis;
            manifolds.push(manifold);
        }
        let manifold = &mut manifolds[number];
        let distance = dispatcher.update_convex(&between, [a, b], (None, None), prediction, manifold);
        near.axis = manifold.local_n1;
        near.slack = distance.map_or(0.0, |distance| distance - prediction);
        clear = clear.min(near.slack);
        next += usize::from(has_one);
        if !has_one {
            if manifold.points.is_empty() {
                manifolds.pop();
            } else {
                is_new = true;
            }
        }
    }
    manifolds[next..known].iter_mut().for_each(|m| m.points.clear());
    manifolds.retain(|m| !m.points.is_empty());
    if is_new {
        manifolds.sort_by_key(|m| [m.subshape1, m.subshape2]);
    }
    memory.clear = clear;
}

impl PairMemory {
    /// Lists the parts that are near each other.
    fn list(&mut self, pos12: &Pose, [first, second]: [&Parts; 2], prediction: f32) {
        let before = std::mem::take(&mut self.near);
        self.listed_at = *pos12;
        self.far = f32::INFINITY;
        for j in 0..second.count() {
            let (part, own) = second.part(j);
            let around = second.aabb(j).map(|_| part.compute_aabb(&(*pos12 * own)));
            for i in 0..first.count() {
                let gap = match (first.aabb(i), &around) {
                    (Some(a), Some(b)) => apart(a, b),
                    _ => f32::NEG_INFINITY,
                };
                if gap > NEAR_PARTS * prediction {
                    self.far = self.far.min(gap - prediction);
                } else {
                    self.near.push(NearParts {
                        parts: [i as u32, j as u32],
                        axis: Vector::ZERO,
                        slack: gap - prediction,
                    });
                }
            }
        }
        self.near.sort_by_key(|near| near.parts);
        // What was known of them is a good guess.
        let mut known = before.into_iter().peekable();
        for near in &mut self.near {
            while known.next_if(|old| old.parts < near.parts).is_some() {}
            if let Some(old) = known.next_if(|old| old.parts == near.parts) {
                near.axis = old.axis;
            }
        }
    }
}
