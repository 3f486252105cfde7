//! The pile without units: how contact forces, dots and what is missing enter each body's balance.
//!
//! Forces of a touch are in weights of its lighter body, so that no column is dwarfed; a body's balance is in its own weight, and
//! its moments in weight times its radius.

use super::{GlueDot, GlueError, GlueOptions, GlueProblem};
use crate::equilibrium::global::{self, GlobalContact};
use glam::DVec3;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use std::ops::Range;

/// From three components of a force to the balance of a body.
pub type Lever = SMatrix<f64, 6, 3>;

/// A touch on one of its bodies.
#[derive(Clone, Copy)]
pub struct Side {
    pub body: usize,
    /// A unit of force against the body's weight; negative where the reverse acts.
    scale: f64,
    /// The dot from the centre of mass, in the body's radius.
    arm: Vector3<f64>,
    /// A unit of moment against a unit of force.
    twist: f64,
}

/// A contact of a touch.
pub struct Contact {
    /// Normal and two tangents. Without friction, only the normal force counts, and the tangents are zero.
    axes: Matrix3<f64>,
    /// The contact from the centre of mass of each of the touch's bodies, in its radius.
    arms: [Vector3<f64>; 2],
    /// Reduced friction.
    pub friction: f64,
    /// Of its normal force.
    pub price: f64,
}

/// A touch between two bodies, or a body and the ground.
pub struct Touch {
    both: [Side; 2],
    /// How many of its bodies count: none where one has fallen.
    count: usize,
    pub contacts: Range<usize>,
    /// Force of 1: the lighter body's weight.
    unit: f64,
    arm: f64,
    pub may: bool,
    /// Bound of its dot, in its unit.
    pub strength: f64,
}

/// Forces: an unknown of each contact, of each touch's dot, and what each body misses.
#[derive(Clone)]
pub struct State {
    /// Shape `[contact]`, along its axes.
    pub contacts: Vec<Vector3<f64>>,
    /// Shape `[touch]`; zero where there is no dot.
    pub dots: Vec<Vector6<f64>>,
    /// Shape `[body]`; zero where nothing may be missing.
    pub missing: Vec<Vector6<f64>>,
}

/// The pile without units.
pub struct Program<'a> {
    pub pile: &'a GlueProblem<'a>,
    pub touches: Vec<Touch>,
    pub contacts: Vec<Contact>,
    /// What the forces on a body must add up to.
    pub target: Vec<Vector6<f64>>,
    /// From the highest body to the lowest: the order in which balance is best eliminated.
    pub order: Vec<usize>,
}

impl<'a> Program<'a> {
    /// `fallen`: bodies that are not there. Shape `[body]`.
    pub fn new(pile: &'a GlueProblem<'a>, options: &GlueOptions, fallen: &[bool]) -> Result<Program<'a>, GlueError> {
        let counts = |x: f64| x >= 0.0 && x.is_finite();
        let strength = options.strength.unwrap_or(0.0);
        if !(counts(options.friction_factor) && counts(options.normal_price) && strength >= 0.0) {
            return Err(GlueError::Options);
        }
        global::check(&global::GlobalProblem { bodies: pile.bodies, contacts: pile.contacts, gravity: pile.gravity })?;
        let g = pile.gravity.length();
        let down = pile.gravity / g;
        let mut touches: Vec<Touch> = Vec::with_capacity(pile.touches.len());
        let mut contacts: Vec<Contact> = Vec::with_capacity(pile.contacts.len());
        for (index, touch) in pile.touches.iter().enumerate() {
            let exists = |b: usize| b < pile.bodies.len();
            let bodies_exist = exists(touch.body) && touch.other.is_none_or(|o| exists(o) && o != touch.body);
            let follows = touch.contacts.start == contacts.len();
            let own = pile.contacts.get(touch.contacts.clone()).filter(|_| bodies_exist && follows);
            let is_sane =
                touch.arm > 0.0 && touch.arm.is_finite() && touch.center.is_finite() && counts(touch.normal_price);
            let is_between = |c: &GlobalContact| (c.body, c.other) == (touch.body, touch.other);
            let own = own.filter(|all| is_sane && all.iter().all(is_between)).ok_or(GlueError::Touch(index))?;
            contacts.extend(own.iter().map(|contact| Contact::new(pile, contact, options, touch.normal_price)));
            touches.push(Touch::new(pile, touch, options, fallen, g));
            let is_finite = |side: &Side| side.dot().iter().all(|x| x.is_finite());
            if !touches[index].sides().iter().all(is_finite) {
                return Err(GlueError::Touch(index));
            }
        }
        if contacts.len() != pile.contacts.len() {
            return Err(GlueError::Touch(touches.len()));
        }
        let weight = Vector6::new(-down.x, -down.y, -down.z, 0.0, 0.0, 0.0);
        let target = fallen.iter().map(|&fallen| if fallen { Vector6::zeros() } else { weight }).collect();
        let mut order: Vec<usize> = (0..pile.bodies.len()).collect();
        let depth = |body: usize| pile.bodies[body].center_of_mass.dot(down);
        order.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)).then(a.cmp(&b)));
        Ok(Program { pile, touches, contacts, target, order })
    }

    pub fn empty_state(&self) -> State {
        State {
            contacts: vec![Vector3::zeros(); self.pile.contacts.len()],
            dots: vec![Vector6::zeros(); self.touches.len()],
            missing: vec![Vector6::zeros(); self.pile.bodies.len()],
        }
    }

    /// What the forces leave unbalanced: target less their sum. Shape `[body]`.
    pub fn imbalance(&self, state: &State, left: &mut Vec<Vector6<f64>>) {
        left.clear();
        left.extend(self.target.iter().zip(&state.missing).map(|(target, missing)| target - missing));
        for (touch, dot) in self.touches.iter().zip(&state.dots) {
            let (force, moment): (Vector3<f64>, Vector3<f64>) =
                (dot.fixed_rows::<3>(0).into(), dot.fixed_rows::<3>(3).into());
            for (k, side) in touch.sides().iter().enumerate() {
                let (mut pull, mut turn) = (force, side.arm.cross(&force) + moment * side.twist);
                for at in touch.contacts.clone() {
                    let force = self.contacts[at].axes * state.contacts[at];
                    pull += force;
                    turn += self.contacts[at].arms[k].cross(&force);
                }
                let left = &mut left[side.body];
                for (k, x) in pull.iter().chain(&turn).enumerate() {
                    left[k] -= x * side.scale;
                }
            }
        }
    }

    /// How fast the two sides of each contact and of each dot part where the bodies move like this: the transpose of what forces add
    /// up to. `contact` and `dot` take the index and the velocity, in their own components.
    pub fn velocities(
        &self,
        motion: &[Vector6<f64>],
        is_dot: &[bool],
        mut contact: impl FnMut(usize, Vector3<f64>),
        mut dot: impl FnMut(usize, Vector6<f64>),
    ) {
        for (t, touch) in self.touches.iter().enumerate() {
            let part = |from: usize, side: &Side| -> Vector3<f64> {
                let all = &motion[side.body];
                Vector3::new(all[from], all[from + 1], all[from + 2]) * side.scale
            };
            let sides = touch.sides();
            let linear: Vector3<f64> = sides.iter().map(|side| part(0, side)).sum();
            let angular = [sides.first(), sides.get(1)].map(|side| side.map_or(Vector3::zeros(), |side| part(3, side)));
            if sides.is_empty() {
                continue;
            }
            for at in touch.contacts.clone() {
                let Contact { axes, arms, .. } = &self.contacts[at];
                contact(at, axes.tr_mul(&(linear + angular[0].cross(&arms[0]) + angular[1].cross(&arms[1]))));
            }
            if is_dot[t] {
                let [a, b] = &touch.both;
                let pull = linear + angular[0].cross(&a.arm) + angular[1].cross(&b.arm);
                let turn = angular[0] * a.twist + angular[1] * b.twist;
                dot(t, Vector6::new(pull.x, pull.y, pull.z, turn.x, turn.y, turn.z));
            }
        }
    }

    /// How a contact of a touch enters the balance of the touch's body of this number.
    pub fn lever(&self, touch: &Touch, side: usize, contact: usize) -> Lever {
        let Contact { axes, arms, .. } = &self.contacts[contact];
        let scale = touch.both[side].scale;
        let mut lever = Lever::zeros();
        for (k, axis) in axes.column_iter().enumerate() {
            lever.fixed_view_mut::<3, 1>(0, k).copy_from(&(axis * scale));
            lever.fixed_view_mut::<3, 1>(3, k).copy_from(&(arms[side].cross(&axis) * scale));
        }
        lever
    }

    /// A dot of a state, in the pile's units.
    pub fn dot(&self, index: usize, state: &State) -> GlueDot {
        let (touch, dot) = (&self.touches[index], state.dots[index]);
        let vector = |from: usize| DVec3::new(dot[from], dot[from + 1], dot[from + 2]) * touch.unit;
        GlueDot { touch: index, force: vector(0), moment: vector(3) * touch.arm }
    }

    /// A state of these dots, and of no contact forces.
    pub fn state(&self, dots: &[GlueDot]) -> State {
        let mut state = self.empty_state();
        for dot in dots {
            let touch = &self.touches[dot.touch];
            let (force, moment) = (dot.force / touch.unit, dot.moment / (touch.unit * touch.arm));
            state.dots[dot.touch] = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
        }
        state
    }

    /// The contact forces of a state, in the pile's units and axes.
    pub fn forces(&self, state: &State) -> Vec<DVec3> {
        let contacts = self.touches.iter().flat_map(|touch| touch.contacts.clone().map(|at| (at, touch.unit)));
        let force = |(at, unit): (usize, f64)| self.contacts[at].axes * state.contacts[at] * unit;
        contacts.map(force).map(|f| DVec3::new(f.x, f.y, f.z)).collect()
    }
}

impl Side {
    /// How a dot's force and moment enter the body's balance.
    pub fn dot(&self) -> Matrix6<f64> {
        let mut dot = Matrix6::zeros();
        for k in 0..3 {
            dot[(k, k)] = self.scale;
            dot[(3 + k, 3 + k)] = self.scale * self.twist;
        }
        dot.fixed_view_mut::<3, 3>(3, 0).copy_from(&(self.arm.cross_matrix() * self.scale));
        dot
    }
}

impl Contact {
    fn new(pile: &GlueProblem, contact: &GlobalContact, options: &GlueOptions, least_price: f64) -> Contact {
        let friction = contact.friction * options.friction_factor;
        let normal = contact.normal.normalize();
        let (t1, t2) = normal.any_orthonormal_pair();
        let slides = if friction > 0.0 { 1.0 } else { 0.0 };
        Contact {
            axes: Matrix3::from_columns(&[vector(normal), vector(t1 * slides), vector(t2 * slides)]),
            arms: [Some(contact.body), contact.other]
                .map(|body| body.map_or(Vector3::zeros(), |b| arm(pile, b, contact.point))),
            friction,
            price: options.normal_price.max(least_price),
        }
    }
}

impl Touch {
    fn new(pile: &GlueProblem, touch: &super::GlueTouch, options: &GlueOptions, fallen: &[bool], g: f64) -> Touch {
        let weight = |body: usize| pile.bodies[body].mass * g;
        let unit = touch.other.map_or(f64::INFINITY, weight).min(weight(touch.body));
        let side = |body: usize, sign: f64| Side {
            body,
            scale: sign * unit / weight(body),
            arm: arm(pile, body, touch.center),
            twist: touch.arm / pile.bodies[body].radius,
        };
        let first = side(touch.body, 1.0);
        let nothing = Side { scale: 0.0, ..first };
        let bodies = 1 + usize::from(touch.other.is_some());
        // What has fallen carries nothing, and is carried by nothing.
        let stands = !fallen[touch.body] && touch.other.is_none_or(|other| !fallen[other]);
        Touch {
            both: [first, touch.other.map_or(nothing, |other| side(other, -1.0))],
            count: if stands { bodies } else { 0 },
            contacts: touch.contacts.clone(),
            unit,
            arm: touch.arm,
            may: touch.may && stands,
            strength: options.strength.map_or(f64::INFINITY, |strength| strength / unit),
        }
    }

    /// Those of its bodies that count: one or two. Empty where one has fallen.
    pub fn sides(&self) -> &[Side] {
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
