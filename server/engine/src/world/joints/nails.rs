//! Nails: breakable constraints between two bodies (paper, 3.3).

use crate::world::{BodyId, World, settings};
use glam::DVec3;
use rapier3d::prelude::*;
use std::collections::BTreeMap;

/// A nail's number, in the order of driving; never reused.
pub type NailId = u64;

/// All nails, in order.
#[derive(Clone, Default)]
pub struct NailJoints {
    next: NailId,
    pub driven: BTreeMap<NailId, NailJoint>,
    /// The body that nails to the ground and to scenery hold on to.
    anchor: Option<RigidBodyHandle>,
}

#[derive(Clone)]
pub struct NailJoint {
    pub handle: ImpulseJointHandle,
    pub a: BodyId,
    /// `None`: the ground or scenery.
    pub b: Option<BodyId>,
}

impl NailJoints {
    /// Drops the nails of a body that leaves the world; the engine removes its joints itself.
    pub fn forget(&mut self, id: BodyId) {
        self.driven.retain(|_, n| n.a != id && n.b != Some(id));
    }
}

impl World {
    /// Pins two bodies together at a point, or one (`b` is `None`) to the ground or scenery: no relative translation,
    /// rotation about `axis` only.
    pub fn drive_nail(&mut self, a: BodyId, b: Option<BodyId>, point: DVec3, axis: DVec3) -> NailId {
        let ha = self.bodies[a].carrier;
        let hb = match b {
            Some(b) => self.bodies[b].carrier,
            None => *self.nails.anchor.get_or_insert_with(|| self.engine.insert_body(RigidBodyBuilder::fixed())),
        };
        let (pa, pb) = (*self.engine.bodies[ha].position(), *self.engine.bodies[hb].position());
        let (p, n) = (point.as_vec3(), axis.as_vec3());
        let joint = RevoluteJointBuilder::new(Vector::X)
            .local_anchor1(pa.inverse_transform_point(p))
            .local_anchor2(pb.inverse_transform_point(p))
            .softness(settings::nail_softness());
        let mut joint: GenericJoint = joint.build().into();
        joint.set_local_axis1(pa.inverse_transform_vector(n));
        joint.set_local_axis2(pb.inverse_transform_vector(n));
        let frame = |pose: &Pose, local: &Pose| pose.rotation * local.rotation;
        // The two frames agree about the axis only up to a turn: take the second from the first, so that the nail
        // starts without strain.
        joint.local_frame2.rotation = pb.rotation.inverse() * frame(&pa, &joint.local_frame1);
        let handle = self.engine.impulse_joints.insert(ha, hb, joint, false);
        let id = self.nails.next;
        self.nails.next += 1;
        self.nails.driven.insert(id, NailJoint { handle, a, b });
        id
    }

    pub fn pull_all_nails(&mut self) {
        for (_, nail) in std::mem::take(&mut self.nails.driven) {
            self.engine.impulse_joints.remove(nail.handle, false);
        }
    }

    pub fn nail_count(&self) -> usize {
        self.nails.driven.len()
    }

    /// Whether a nail holds it. Shape `[body]`.
    pub fn nailed(&self) -> Vec<bool> {
        let mut nailed = vec![false; self.bodies().len()];
        for nail in self.nails.driven.values() {
            nailed[nail.a] = true;
            if let Some(b) = nail.b {
                nailed[b] = true;
            }
        }
        nailed
    }

    /// Removes the nails whose force exceeds `limit` (per unit of the lighter body's mass) and returns how many, with
    /// the largest force per weight of the lighter body among those that hold.
    pub fn break_nails(&mut self, limit: f64) -> (usize, f64) {
        let substep = self.step_length() / self.engine.integration_parameters.num_solver_iterations as f64;
        let (mut broken, mut largest) = (Vec::new(), 0.0f64);
        for (&id, nail) in &self.nails.driven {
            let Some(joint) = self.engine.impulse_joints.get(nail.handle) else { continue };
            let impulse = (0..3).map(|i| (joint.impulses[i] as f64).powi(2)).sum::<f64>().sqrt();
            let force = impulse / substep;
            let lighter = nail.b.map_or(f64::INFINITY, |b| self.bodies[b].mass).min(self.bodies[nail.a].mass);
            if force > limit * lighter {
                broken.push(id);
            } else {
                largest = largest.max(force / lighter);
            }
        }
        for id in &broken {
            if let Some(nail) = self.nails.driven.remove(id) {
                self.engine.impulse_joints.remove(nail.handle, true);
            }
        }
        (broken.len(), largest)
    }
}
