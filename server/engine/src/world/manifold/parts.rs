//! Contacts of two shapes of which one has several parts: a compound, or a mesh's triangles.
//!
//! A pair remembers which parts of the two are near each other, and how far apart each such pair of parts was when it
//! was last looked at: until the shapes may have moved by as much, it is not looked at again. So neither which pairs
//! touch nor where they touch depends on what is skipped.

use super::{Constraints, Manifolds};
use rapier3d::parry::bounding_volume::{Aabb, BoundingVolume};
use rapier3d::parry::query::details::NormalConstraints;
use rapier3d::parry::query::{ContactManifold, ContactManifoldsWorkspace, TypedWorkspaceData, WorkspaceData};
use rapier3d::parry::shape::{Compound, HalfSpace, Shape, TriMesh};
use rapier3d::prelude::*;
use std::sync::atomic::Ordering::Relaxed;

/// Parts that are farther apart than this many predictions are not listed as near.
const NEAR_PARTS: f32 = 8.0;
/// A motion is larger by this share of the shape, by rounding.
const MOTION_ROUNDING: f32 = 1e-6;

/// A shape as its parts.
enum Parts<'a> {
    Several(&'a Compound),
    One(&'a dyn Shape, Aabb),
    /// What follows is larger than what meets it, and it is that which moves.
    Plane(&'a HalfSpace),
    Mesh(&'a TriMesh),
}

impl<'a> Parts<'a> {
    fn new(shape: &'a dyn Shape) -> Parts<'a> {
        if let Some(compound) = shape.as_compound() {
            Parts::Several(compound)
        } else if let Some(plane) = shape.as_halfspace() {
            Parts::Plane(plane)
        } else if let Some(mesh) = shape.as_trimesh() {
            Parts::Mesh(mesh)
        } else {
            Parts::One(shape, shape.compute_local_aabb())
        }
    }

    fn is_large(&self) -> bool {
        matches!(self, Parts::Plane(_) | Parts::Mesh(_))
    }

    /// Of the sphere about the origin that holds the whole.
    fn radius(&self) -> f32 {
        let of = |aabb: &Aabb| aabb.mins.abs().max(aabb.maxs.abs()).length();
        match self {
            Parts::Several(compound) => of(compound.local_aabb()),
            Parts::One(_, aabb) => of(aabb),
            Parts::Plane(_) | Parts::Mesh(_) => f32::INFINITY,
        }
    }

    /// The box of the whole.
    fn aabb(&self) -> Aabb {
        match self {
            Parts::Several(compound) => *compound.local_aabb(),
            Parts::One(_, aabb) => *aabb,
            Parts::Plane(_) | Parts::Mesh(_) => Aabb::new(Vector::NEG_INFINITY, Vector::INFINITY),
        }
    }

    /// Calls `found` for each part that may be within `reach` of a box, with the part's own.
    fn near(&self, around: &Aabb, reach: f32, mut found: impl FnMut(u32, &Aabb)) {
        match self {
            Parts::Several(compound) => (0..).zip(compound.aabbs()).for_each(|(i, aabb)| found(i, aabb)),
            Parts::One(_, aabb) => found(0, aabb),
            Parts::Plane(_) => found(0, &self.aabb()),
            Parts::Mesh(mesh) => {
                for i in mesh.bvh().intersect_aabb(&around.loosened(reach)) {
                    found(i, &mesh.triangle(i).local_aabb());
                }
            }
        }
    }

    /// Calls `look` with a part, its place, and what keeps normals between those of a mesh's triangles.
    fn part<T>(&self, i: u32, look: impl FnOnce(&dyn Shape, Pose, Option<&dyn NormalConstraints>) -> T) -> T {
        match self {
            Parts::Several(compound) => {
                let (at, shape) = &compound.shapes()[i as usize];
                look(&**shape, *at, None)
            }
            Parts::One(shape, _) => look(*shape, Pose::IDENTITY, None),
            Parts::Plane(plane) => look(*plane, Pose::IDENTITY, None),
            Parts::Mesh(mesh) => {
                let normals = mesh.triangle_normal_constraints(i);
                look(&mesh.triangle(i), Pose::IDENTITY, normals.as_ref().map(|n| n as &dyn NormalConstraints))
            }
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

/// How far a point of the second shape moves at most, in the frame of the first. `radius`: of the sphere about its
/// origin that holds it.
fn motion(before: &Pose, now: &Pose, radius: f32) -> f32 {
    let turn = now.rotation * before.rotation.inverse();
    let chord = 2.0 * Vector::new(turn.x, turn.y, turn.z).length();
    (now.translation - before.translation).length() + (chord + MOTION_ROUNDING) * radius
}

/// Along the axis along which two boxes are farthest apart.
fn apart(a: &Aabb, b: &Aabb) -> f32 {
    (b.mins - a.maxs).max(a.mins - b.maxs).max_element()
}

/// Two shapes.
struct PartsPair<'a> {
    shapes: [Parts<'a>; 2],
    /// Of the second one, in the frame of the first.
    pos12: Pose,
}

impl PartsPair<'_> {
    /// How far a point of the smaller shape has moved at most, in the frame of the larger one.
    fn moved(&self, before: &Pose) -> f32 {
        let [first, second] = &self.shapes;
        match second.is_large() {
            true => motion(&before.inverse(), &self.pos12.inverse(), first.radius()),
            false => motion(before, &self.pos12, second.radius()),
        }
    }

    /// Calls `found` for each pair of parts that may be within `reach` of each other, with a distance that they are
    /// apart at least. Returns the least distance of all others, if that is less than `reach`.
    fn near(&self, reach: f32, mut found: impl FnMut([u32; 2], f32)) -> f32 {
        // In the frame of the larger shape, the parts of the smaller one in turn.
        let [first, second] = &self.shapes;
        let (large, small, pose, is_flipped) = match second.is_large() {
            true => (second, first, self.pos12.inverse(), true),
            false => (first, second, self.pos12, false),
        };
        let (whole, mut far) = (large.aabb(), reach);
        let everything = Aabb::new(Vector::NEG_INFINITY, Vector::INFINITY);
        small.near(&everything, 0.0, |j, own| {
            // The box around the part's own box first, which is larger.
            let around = own.transform_by(&pose);
            if apart(&whole, &around) > reach {
                far = far.min(apart(&whole, &around));
                return;
            }
            let around = small.part(j, |shape, at, _| shape.compute_aabb(&(pose * at)));
            large.near(&around, reach, |i, other| {
                let gap = apart(other, &around);
                if gap > reach {
                    far = far.min(gap);
                } else {
                    found(if is_flipped { [j, i] } else { [i, j] }, gap);
                }
            });
        });
        far
    }
}

/// The points of contact of two shapes, at least one of which has several parts. `pos12`: of the second shape, in the
/// frame of the first.
pub(super) fn update_manifolds<M: Default + Clone + Send + Sync, C: Default + Copy + Send + Sync>(
    dispatcher: &Manifolds,
    pos12: &Pose,
    shapes: [&dyn Shape; 2],
    prediction: f32,
    manifolds: &mut Vec<ContactManifold<M, C>>,
    workspace: &mut Option<ContactManifoldsWorkspace>,
) {
    let pair = PartsPair { shapes: shapes.map(Parts::new), pos12: *pos12 };
    if pair.shapes.iter().all(Parts::is_large) {
        return;
    }
    let is_known = workspace.as_ref().is_some_and(|w| w.0.downcast_ref::<PairMemory>().is_some());
    if !is_known {
        *workspace = Some(ContactManifoldsWorkspace(Box::new(PairMemory::default())));
    }
    let Some(memory) = workspace.as_mut().and_then(|w| w.0.downcast_mut::<PairMemory>()) else { return };
    if is_known && manifolds.is_empty() && pair.moved(&memory.at) < memory.clear {
        dispatcher.looks.skips.fetch_add(1, Relaxed);
        return;
    }
    if !is_known || pair.moved(&memory.listed_at) >= memory.far {
        memory.list(&pair, prediction);
    } else {
        let moved = pair.moved(&memory.at);
        memory.near.iter_mut().for_each(|near| near.slack -= moved);
    }
    memory.at = *pos12;
    memory.clear = memory.far - pair.moved(&memory.listed_at);
    let (known, mut next, mut is_new) = (manifolds.len(), 0, false);
    for near in &mut memory.near {
        while next < known && [manifolds[next].subshape1, manifolds[next].subshape2] < near.parts {
            // They are no longer near.
            manifolds[next].points.clear();
            next += 1;
        }
        let has_one = next < known && [manifolds[next].subshape1, manifolds[next].subshape2] == near.parts;
        if near.slack > 0.0 {
            if has_one {
                manifolds[next].points.clear();
            }
        } else {
            let number = if has_one { next } else { manifolds.len() };
            if !has_one {
                let [i, j] = near.parts;
                manifolds
                    .push(ContactManifold { local_n1: near.axis, ..ContactManifold::with_data(i, j, M::default()) });
            }
            near.look(dispatcher, &pair, prediction, &mut manifolds[number]);
            if !has_one && manifolds[number].points.is_empty() {
                manifolds.pop();
            } else {
                is_new |= !has_one;
            }
        }
        memory.clear = memory.clear.min(near.slack);
        next += usize::from(has_one);
    }
    manifolds[next..known].iter_mut().for_each(|m| m.points.clear());
    manifolds.retain(|m| !m.points.is_empty());
    if is_new {
        manifolds.sort_by_key(|m| [m.subshape1, m.subshape2]);
    }
}

impl NearParts {
    /// Looks at two parts.
    fn look<M: Default + Clone + Send + Sync, C: Default + Copy + Send + Sync>(
        &mut self,
        dispatcher: &Manifolds,
        pair: &PartsPair,
        prediction: f32,
        manifold: &mut ContactManifold<M, C>,
    ) {
        let ([first, second], [i, j]) = (&pair.shapes, self.parts);
        let distance = first.part(i, |a, at_a, of_a| {
            second.part(j, |b, at_b, of_b| {
                let constraints: Constraints = (of_a, of_b);
                if at_a == Pose::IDENTITY && at_b == Pose::IDENTITY {
                    return dispatcher.update_convex(&pair.pos12, [a, b], constraints, prediction, manifold);
                }
                manifold.set_subshape_pos1(Some(at_a));
                manifold.set_subshape_pos2(Some(at_b));
                let between = at_a.inv_mul(&pair.pos12) * at_b;
                dispatcher.update_convex(&between, [a, b], constraints, prediction, manifold)
            })
        });
        self.axis = manifold.local_n1;
        self.slack = distance.map_or(0.0, |distance| distance - prediction);
    }
}

impl PairMemory {
    /// Lists the parts that are near each other.
    fn list(&mut self, pair: &PartsPair, prediction: f32) {
        let before = std::mem::take(&mut self.near);
        self.listed_at = pair.pos12;
        let reach = NEAR_PARTS * prediction;
        let near = &mut self.near;
        let far =
            pair.near(reach, |parts, gap| near.push(NearParts { parts, axis: Vector::ZERO, slack: gap - prediction }));
        self.far = far - prediction;
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
