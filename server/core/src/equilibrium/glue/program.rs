//! The pile without units: how contact forces, dots and what is missing enter each body's balance.
//!
//! Forces of a touch are in weights of its lighter body, so that no column is dwarfed; a body's balance is in its own weight, and
//! its moments in weight times its radius.

use super::{GlueDot, GlueError, GlueOptions, GlueProblem};
use crate::equilibrium::global::{self, GlobalContact};
use glam::DVec3;
use nalgebra::{Matrix6, SMatrix, Vector3, Vector6};

/// From three components of a force to the balance of a body.
pub type Lever = SMatrix<f64, 6, 3>;

/// A touch on one of its bodies.
pub struct Side {
    pub body: usize,
    /// Per contact of the touch.
    pub contacts: Vec<Lever>,
    /// Of the dot's force and of its moment.
    pub dot: Matrix6<f64>,
}

/// A touch between two bodies, or a body and the ground.
pub struct Touch {
    /// Those of its bodies that stand: one or two. Empty where none does.
    pub sides: Vec<Side>,
    /// Axes of its contacts: normal and two tangents.
    pub axes: Vec<[DVec3; 3]>,
    /// Reduced friction, per contact.
    pub friction: Vec<f64>,
    /// Index of its first contact.
    pub first: usize,
    /// Force of 1: the lighter body's weight.
    pub unit: f64,
    pub arm: f64,
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
        let mut touches = Vec::with_capacity(pile.touches.len());
        for (index, touch) in pile.touches.iter().enumerate() {
            let exists = |b: usize| b < pile.bodies.len();
            let bodies_exist = exists(touch.body) && touch.other.is_none_or(|o| exists(o) && o != touch.body);
            let follows = touch.contacts.start == touches.last().map_or(0, |t: &Touch| t.first + t.axes.len());
            let contacts = pile.contacts.get(touch.contacts.clone()).filter(|_| bodies_exist && follows);
            let is_sane = touch.arm > 0.0 && touch.arm.is_finite() && touch.center.is_finite();
            let is_between = |c: &GlobalContact| (c.body, c.other) == (touch.body, touch.other);
            let contacts = contacts.filter(|all| is_sane && all.iter().all(is_between));
            let next = contacts.map(|contacts| Touch::new(pile, touch, contacts, options, fallen, g));
            let is_finite = |touch: &Touch| touch.sides.iter().all(|side| side.dot.iter().all(|x| x.is_finite()));
            touches.push(next.filter(is_finite).ok_or(GlueError::Touch(index))?);
        }
        if touches.last().map_or(0, |t| t.first + t.axes.len()) != pile.contacts.len() {
            return Err(GlueError::Touch(touches.len()));
        }
        let weight = Vector6::new(-down.x, -down.y, -down.z, 0.0, 0.0, 0.0);
        let target = fallen.iter().map(|&fallen| if fallen { Vector6::zeros() } else { weight }).collect();
        let mut order: Vec<usize> = (0..pile.bodies.len()).collect();
        let depth = |body: usize| pile.bodies[body].center_of_mass.dot(down);
        order.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)).then(a.cmp(&b)));
        Ok(Program { pile, touches, target, order })
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
            for side in &touch.sides {
                let mut sum = side.dot * dot;
                for (lever, force) in side.contacts.iter().zip(&state.contacts[touch.first..]) {
                    sum += lever * force;
                }
                left[side.body] -= sum;
            }
        }
    }

    /// A dot of a state, in the pile's units.
    pub fn dot(&self, index: usize, state: &State) -> GlueDot {
        let (touch, dot) = (&self.touches[index], state.dots[index]);
        let vector = |from: usize| DVec3::new(dot[from], dot[from + 1], dot[from + 2]) * touch.unit;
        GlueDot { touch: index, force: vector(0), moment: vector(3) * touch.arm }
    }

    /// The contact forces of a state, in the pile's units and axes.
    pub fn forces(&self, state: &State) -> Vec<DVec3> {
        let contacts = self.touches.iter().flat_map(|touch| touch.axes.iter().map(|axes| (axes, touch.unit)));
        let force = |((axes, unit), f): ((&[DVec3; 3], f64), &Vector3<f64>)| {
            (axes[0] * f[0] + axes[1] * f[1] + axes[2] * f[2]) * unit
        };
        contacts.zip(&state.contacts).map(force).collect()
    }
}

impl Touch {
    fn new(
        pile: &GlueProblem,
        touch: &super::GlueTouch,
        contacts: &[GlobalContact],
        options: &GlueOptions,
        fallen: &[bool],
        g: f64,
    ) -> Touch {
        let weight = |body: usize| pile.bodies[body].mass * g;
        let unit = touch.other.map_or(f64::INFINITY, weight).min(weight(touch.body));
        let axes: Vec<[DVec3; 3]> = contacts.iter().map(|c| axes(c.normal)).collect();
        let side = |body: usize, sign: f64| {
            let (b, scale) = (&pile.bodies[body], sign * unit / weight(body));
            let lever = |point: DVec3, axis: DVec3| {
                let moment = ((point - b.center_of_mass) / b.radius).cross(axis);
                Vector6::new(axis.x, axis.y, axis.z, moment.x, moment.y, moment.z) * scale
            };
            let contact = |(c, axes): (&GlobalContact, &[DVec3; 3])| {
                // Without friction, only the normal force counts.
                let slides = if c.friction * options.friction_factor > 0.0 { 1.0 } else { 0.0 };
                let [normal, t1, t2] = axes.map(|axis| lever(c.point, axis));
                Lever::from_columns(&[normal, t1 * slides, t2 * slides])
            };
            let mut dot = Matrix6::zeros();
            for (k, axis) in DVec3::AXES.into_iter().enumerate() {
                dot.set_column(k, &lever(touch.center, axis));
                dot[(3 + k, 3 + k)] = scale * touch.arm / b.radius;
            }
            Side { body, contacts: contacts.iter().zip(&axes).map(contact).collect(), dot }
        };
        let both = [Some((touch.body, 1.0)), touch.other.map(|other| (other, -1.0))];
        // What has fallen carries nothing, and is carried by nothing.
        let stands = both.iter().flatten().all(|&(body, _)| !fallen[body]);
        let sides = both.into_iter().flatten().filter(|_| stands).map(|(body, sign)| side(body, sign)).collect();
        Touch {
            sides,
            friction: contacts.iter().map(|c| c.friction * options.friction_factor).collect(),
            axes,
            first: touch.contacts.start,
            unit,
            arm: touch.arm,
            may: touch.may && stands,
            strength: options.strength.map_or(f64::INFINITY, |strength| strength / unit),
        }
    }
}

/// A unit normal, and two tangents.
fn axes(normal: DVec3) -> [DVec3; 3] {
    let normal = normal.normalize();
    let (t1, t2) = normal.any_orthonormal_pair();
    [normal, t1, t2]
}
