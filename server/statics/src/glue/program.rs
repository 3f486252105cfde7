//! The pile without units: how contact forces, joints and missing support enter each body's balance.
//!
//! Forces of a site are in weights of its lighter body, so that the columns are of one size; a body's balance is in its
//! own weight, its moments in weight times its radius.

use super::{GlueError, GlueJoint, GlueOptions, GlueProblem};
use crate::global::{self, GlobalContact};
use crate::limit::Load;
use glam::DVec3;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use std::ops::Range;

/// From three components of a force to the balance of a body.
pub type Lever = SMatrix<f64, 6, 3>;

/// A site seen from one of its bodies.
#[derive(Clone, Copy)]
pub struct SiteEnd {
    pub body: usize,
    /// The site's unit of force in the body's weight; negative on the second body, on which the reverse acts.
    scale: f64,
    /// From the centre of mass to the joint, in the body's radius.
    arm: Vector3<f64>,
    /// The site's unit of moment against its unit of force times the body's radius.
    twist: f64,
}

/// A contact of a site.
pub struct SiteContact {
    /// Normal and two tangents. Without friction, only the normal force counts, and the tangents are zero.
    axes: Matrix3<f64>,
    /// From the centre of mass of each of the site's bodies to the contact, in its radius.
    arms: [Vector3<f64>; 2],
    /// Reduced friction.
    pub friction: f64,
    /// Of its normal force.
    pub price: f64,
}

/// A site between two bodies, or a body and the ground.
pub struct ScaledSite {
    both: [SiteEnd; 2],
    /// Number of its bodies in the balance: 0 if one has fallen.
    count: usize,
    pub contacts: Range<usize>,
    /// Unit of force: the lighter body's weight.
    unit: f64,
    arm: f64,
    pub may_glue: bool,
    /// Bound of its joint, in its unit.
    pub strength: f64,
}

/// The unknowns: a force per contact, a wrench per site's joint, and the missing support per body.
#[derive(Clone, Debug, Default)]
pub struct GlueForces {
    /// Shape `[contact]`, along its axes.
    pub contacts: Vec<Vector3<f64>>,
    /// Shape `[site]`; zero where there is no joint.
    pub joints: Vec<Vector6<f64>>,
    /// Shape `[body]`; zero where every body must be balanced.
    pub missing: Vec<Vector6<f64>>,
}

/// The pile without units.
pub struct GlueProgram<'a> {
    pub pile: &'a GlueProblem<'a>,
    pub sites: Vec<ScaledSite>,
    pub contacts: Vec<SiteContact>,
    /// The wrench that the forces on each body must add up to. Shape `[body]`.
    pub target: Vec<Vector6<f64>>,
    /// From the highest body to the lowest: the order in which balance is best eliminated.
    pub order: Vec<usize>,
}

impl<'a> GlueProgram<'a> {
    /// `fallen`: bodies that are not there. Shape `[body]`.
    pub fn new(
        pile: &'a GlueProblem<'a>,
        options: &GlueOptions,
        fallen: &[bool],
    ) -> Result<GlueProgram<'a>, GlueError> {
        let counts = |x: f64| x >= 0.0 && x.is_finite();
        let strength = options.strength.unwrap_or(0.0);
        if !(counts(options.friction_factor) && counts(options.normal_price) && strength >= 0.0) {
            return Err(GlueError::Options);
        }
        global::check(&global::GlobalProblem { bodies: pile.bodies, contacts: pile.contacts, gravity: pile.gravity })?;
        let g = pile.gravity.length();
        let down = pile.gravity / g;
        let mut sites: Vec<ScaledSite> = Vec::with_capacity(pile.sites.len());
        let mut contacts: Vec<SiteContact> = Vec::with_capacity(pile.contacts.len());
        for (index, site) in pile.sites.iter().enumerate() {
            let exists = |b: usize| b < pile.bodies.len();
            if !(exists(site.body) && site.other.is_none_or(|o| exists(o) && o != site.body)) {
                return Err(GlueError::SiteBodies(index));
            }
            let follows = site.contacts.start == contacts.len();
            let is_between = |c: &GlobalContact| (c.body, c.other) == (site.body, site.other);
            let own = pile.contacts.get(site.contacts.clone());
            let own = own.filter(|all| follows && all.iter().all(is_between)).ok_or(GlueError::SiteContacts(index))?;
            if !site.center.is_finite() {
                return Err(GlueError::SiteCenter(index));
            }
            if !(site.arm > 0.0 && site.arm.is_finite()) {
                return Err(GlueError::SiteArm(index));
            }
            if !counts(site.normal_price) {
                return Err(GlueError::SitePrice(index));
            }
            contacts.extend(own.iter().map(|contact| SiteContact::new(pile, contact, options, site.normal_price)));
            sites.push(ScaledSite::new(pile, site, options, fallen, g));
            let is_finite = |end: &SiteEnd| end.joint_lever().iter().all(|x| x.is_finite());
            if !sites[index].ends().iter().all(is_finite) {
                return Err(GlueError::SiteCenter(index));
            }
        }
        if contacts.len() != pile.contacts.len() {
            return Err(GlueError::Contact(contacts.len()));
        }
        let weight = Vector6::new(-down.x, -down.y, -down.z, 0.0, 0.0, 0.0);
        let target = fallen.iter().map(|&fallen| if fallen { Vector6::zeros() } else { weight }).collect();
        let mut order: Vec<usize> = (0..pile.bodies.len()).collect();
        let depth = |body: usize| pile.bodies[body].center_of_mass.dot(down);
        order.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)).then(a.cmp(&b)));
        Ok(GlueProgram { pile, sites, contacts, target, order })
    }

    /// Adds loads to the weights. Shape `[body]`.
    pub fn load(&mut self, loads: &[Load]) {
        let g = self.pile.gravity.length();
        for ((target, load), body) in self.target.iter_mut().zip(loads).zip(self.pile.bodies) {
            let Load { force, moment } = load.in_weights(body, g);
            *target -= Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
        }
    }

    /// The sites that may be glued. Shape `[site]`.
    pub fn allowed_sites(&self) -> Vec<bool> {
        self.sites.iter().map(|site| site.may_glue).collect()
    }

    pub fn empty_state(&self) -> GlueForces {
        GlueForces {
            contacts: vec![Vector3::zeros(); self.pile.contacts.len()],
            joints: vec![Vector6::zeros(); self.sites.len()],
            missing: vec![Vector6::zeros(); self.pile.bodies.len()],
        }
    }

    /// Imbalance: the target less the sum of the forces. Shape `[body]`.
    pub fn imbalance(&self, state: &GlueForces, left: &mut Vec<Vector6<f64>>) {
        left.clear();
        left.extend(self.target.iter().zip(&state.missing).map(|(target, missing)| target - missing));
        for (site, joint) in self.sites.iter().zip(&state.joints) {
            let (force, moment): (Vector3<f64>, Vector3<f64>) =
                (joint.fixed_rows::<3>(0).into(), joint.fixed_rows::<3>(3).into());
            for (k, end) in site.ends().iter().enumerate() {
                let (mut pull, mut turn) = (force, end.arm.cross(&force) + moment * end.twist);
                for at in site.contacts.clone() {
                    let force = self.contacts[at].axes * state.contacts[at];
                    pull += force;
                    turn += self.contacts[at].arms[k].cross(&force);
                }
                let left = &mut left[end.body];
                for (k, x) in pull.iter().chain(&turn).enumerate() {
                    left[k] -= x * end.scale;
                }
            }
        }
    }

    /// Relative velocity of the two bodies at each contact and joint under this motion of the bodies: the transpose of
    /// the balance. `contact` and `joint` take the index and the velocity, in their own components.
    pub fn velocities(
        &self,
        motion: &[Vector6<f64>],
        is_joint: &[bool],
        mut contact: impl FnMut(usize, Vector3<f64>),
        mut joint: impl FnMut(usize, Vector6<f64>),
    ) {
        for (t, site) in self.sites.iter().enumerate() {
            let part = |from: usize, end: &SiteEnd| -> Vector3<f64> {
                let all = &motion[end.body];
                Vector3::new(all[from], all[from + 1], all[from + 2]) * end.scale
            };
            let ends = site.ends();
            let linear: Vector3<f64> = ends.iter().map(|end| part(0, end)).sum();
            let angular = [ends.first(), ends.get(1)].map(|end| end.map_or(Vector3::zeros(), |end| part(3, end)));
            if ends.is_empty() {
                continue;
            }
            for at in site.contacts.clone() {
                let SiteContact { axes, arms, .. } = &self.contacts[at];
                contact(at, axes.tr_mul(&(linear + angular[0].cross(&arms[0]) + angular[1].cross(&arms[1]))));
            }
            if is_joint[t] {
                let [a, b] = &site.both;
                let pull = linear + angular[0].cross(&a.arm) + angular[1].cross(&b.arm);
                let turn = angular[0] * a.twist + angular[1] * b.twist;
                joint(t, Vector6::new(pull.x, pull.y, pull.z, turn.x, turn.y, turn.z));
            }
        }
    }

    /// Matrix from a contact's force to the balance of the site's body of this number.
    pub fn lever(&self, site: &ScaledSite, end: usize, contact: usize) -> Lever {
        let SiteContact { axes, arms, .. } = &self.contacts[contact];
        let scale = site.both[end].scale;
        let mut lever = Lever::zeros();
        for (k, axis) in axes.column_iter().enumerate() {
            lever.fixed_view_mut::<3, 1>(0, k).copy_from(&(axis * scale));
            lever.fixed_view_mut::<3, 1>(3, k).copy_from(&(arms[end].cross(&axis) * scale));
        }
        lever
    }

    /// A joint of a state, in the pile's units.
    pub fn joint(&self, index: usize, state: &GlueForces) -> GlueJoint {
        let (site, joint) = (&self.sites[index], state.joints[index]);
        let vector = |from: usize| DVec3::new(joint[from], joint[from + 1], joint[from + 2]) * site.unit;
        GlueJoint { site: index, force: vector(0), moment: vector(3) * site.arm }
    }

    /// A state of these joints, and of no contact forces.
    pub fn state(&self, joints: &[GlueJoint]) -> GlueForces {
        let mut state = self.empty_state();
        for joint in joints {
            let site = &self.sites[joint.site];
            let (force, moment) = (joint.force / site.unit, joint.moment / (site.unit * site.arm));
            state.joints[joint.site] = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
        }
        state
    }

    /// A state of these contact forces, and of no joints.
    pub fn state_of_contacts(&self, forces: &[DVec3]) -> GlueForces {
        let mut state = self.empty_state();
        for site in &self.sites {
            for at in site.contacts.clone() {
                state.contacts[at] = self.contacts[at].axes.tr_mul(&vector(forces[at])) / site.unit;
            }
        }
        state
    }

    /// The contact forces of a state, in the pile's units and axes.
    pub fn forces(&self, state: &GlueForces) -> Vec<DVec3> {
        let contacts = self.sites.iter().flat_map(|site| site.contacts.clone().map(|at| (at, site.unit)));
        let force = |(at, unit): (usize, f64)| self.contacts[at].axes * state.contacts[at] * unit;
        contacts.map(force).map(|f| DVec3::new(f.x, f.y, f.z)).collect()
    }
}

impl SiteEnd {
    /// Matrix from a joint's force and moment to the body's balance.
    pub fn joint_lever(&self) -> Matrix6<f64> {
        let mut joint = Matrix6::zeros();
        for k in 0..3 {
            joint[(k, k)] = self.scale;
            joint[(3 + k, 3 + k)] = self.scale * self.twist;
        }
        joint.fixed_view_mut::<3, 3>(3, 0).copy_from(&(self.arm.cross_matrix() * self.scale));
        joint
    }
}

impl SiteContact {
    fn new(pile: &GlueProblem, contact: &GlobalContact, options: &GlueOptions, least_price: f64) -> SiteContact {
        let friction = contact.friction * options.friction_factor;
        let normal = contact.normal.normalize();
        let (t1, t2) = normal.any_orthonormal_pair();
        let slides = if friction > 0.0 { 1.0 } else { 0.0 };
        SiteContact {
            axes: Matrix3::from_columns(&[vector(normal), vector(t1 * slides), vector(t2 * slides)]),
            arms: [Some(contact.body), contact.other]
                .map(|body| body.map_or(Vector3::zeros(), |b| arm(pile, b, contact.point))),
            friction,
            price: options.normal_price.max(least_price),
        }
    }
}

impl ScaledSite {
    fn new(pile: &GlueProblem, site: &super::GlueSite, options: &GlueOptions, fallen: &[bool], g: f64) -> ScaledSite {
        let weight = |body: usize| pile.bodies[body].mass * g;
        let unit = site.other.map_or(f64::INFINITY, weight).min(weight(site.body));
        let end = |body: usize, sign: f64| SiteEnd {
            body,
            scale: sign * unit / weight(body),
            arm: arm(pile, body, site.center),
            twist: site.arm / pile.bodies[body].radius,
        };
        let first = end(site.body, 1.0);
        let nothing = SiteEnd { scale: 0.0, ..first };
        let bodies = 1 + usize::from(site.other.is_some());
        // A fallen body neither carries nor is carried.
        let stands = !fallen[site.body] && site.other.is_none_or(|other| !fallen[other]);
        ScaledSite {
            both: [first, site.other.map_or(nothing, |other| end(other, -1.0))],
            count: if stands { bodies } else { 0 },
            contacts: site.contacts.clone(),
            unit,
            arm: site.arm,
            may_glue: site.may_glue && stands,
            strength: options.strength.map_or(f64::INFINITY, |strength| strength / unit),
        }
    }

    /// Its one or two bodies; none where one of them has fallen.
    pub fn ends(&self) -> &[SiteEnd] {
        &self.both[..self.count]
    }
}

/// A point from the centre of mass of a body, in its radius.
fn arm(pile: &GlueProblem, body: usize, point: DVec3) -> Vector3<f64> {
    let body = &pile.bodies[body];
    vector((point - body.center_of_mass) / body.radius)
}

fn vector(v: DVec3) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}
