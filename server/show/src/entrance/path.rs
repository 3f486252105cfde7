//! A planned motion of one body: flights under gravity with free rotation, the last of which ends where the body stays.

use cairn_geometry::pose::Pose;
use glam::{DMat3, DQuat, DVec3};

/// Gravity, engine units.
pub const GRAVITY: DVec3 = DVec3::NEG_Y;
/// Length of a step in which free rotation is integrated, characteristic times.
const TURN_STEP: f64 = 0.05;

/// Linear and angular velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    pub velocity: DVec3,
    pub spin: DVec3,
}

/// A flight. Times count back from its end; engine units.
#[derive(Clone, Debug)]
pub struct Flight {
    /// Where it ends, and how fast.
    pub end: Pose,
    pub twist: Twist,
    pub duration: f64,
    /// The rotations at every [`TURN_STEP`] before the end; empty where it does not turn.
    turns: Vec<DQuat>,
    /// Angular momentum over mass.
    momentum: DVec3,
}

impl Flight {
    /// `inertia`: of the body about its center of mass, in its own axes.
    pub fn new(end: Pose, twist: Twist, duration: f64, inertia: &DMat3) -> Flight {
        let axes = DMat3::from_quat(end.rotation);
        let momentum = axes * (*inertia * (axes.transpose() * twist.spin));
        let turns = match twist.spin == DVec3::ZERO {
            true => Vec::new(),
            false => rotations(end.rotation, momentum, duration, &inertia.inverse()),
        };
        Flight { end, twist, duration, turns, momentum }
    }

    /// From a pose to another, with an even turn between the two: something other than contacts makes it turn.
    pub fn between(start: &Pose, end: Pose, duration: f64) -> Flight {
        let near = if start.rotation.dot(end.rotation) < 0.0 { -start.rotation } else { start.rotation };
        let spin = (end.rotation * near.inverse()).to_scaled_axis() / duration;
        let velocity = (end.translation - start.translation) / duration + 0.5 * duration * GRAVITY;
        let count = (duration / TURN_STEP).ceil() as usize + 1;
        let turn = |k: usize| end.rotation.slerp(near, (k as f64 * TURN_STEP / duration).min(1.0)).normalize();
        let turns = (0..=count).map(turn).collect();
        Flight { end, twist: Twist { velocity, spin }, duration, turns, momentum: DVec3::ZERO }
    }

    /// The pose at a time before the end.
    pub fn pose(&self, before: f64) -> Pose {
        if before <= 0.0 {
            return self.end;
        }
        let translation = self.end.translation - self.twist.velocity * before + 0.5 * before * before * GRAVITY;
        let at = before / TURN_STEP;
        let k = (at as usize).min(self.turns.len().saturating_sub(2));
        let rotation = match self.turns.get(k..k + 2) {
            Some(&[late, early]) => late.slerp(early, at - k as f64).normalize(),
            _ => self.end.rotation,
        };
        Pose { translation, rotation }
    }

    /// Velocities at a time before the end.
    pub fn twist(&self, before: f64, inertia: &DMat3) -> Twist {
        let axes = DMat3::from_quat(self.pose(before).rotation);
        let spin = axes * (inertia.inverse() * (axes.transpose() * self.momentum));
        Twist { velocity: self.twist.velocity - before * GRAVITY, spin }
    }

    /// The same flight without what is earlier than this time before its end.
    pub fn cut(self, duration: f64) -> Flight {
        Flight { duration: duration.min(self.duration), ..self }
    }

    /// A box around the whole motion of a body of this radius.
    fn bounds(&self, radius: f64) -> (DVec3, DVec3) {
        // The highest point is at an end, or where it does not rise.
        let turning = (-self.twist.velocity.y).clamp(0.0, self.duration);
        let points = [0.0, turning, self.duration].map(|before| self.pose(before).translation);
        let low = points.into_iter().fold(points[0], DVec3::min);
        let high = points.into_iter().fold(points[0], DVec3::max);
        (low - radius, high + radius)
    }
}

/// Rotations of a body that nothing turns, back from its end: its angular momentum stays. `inverse`: of its inertia.
fn rotations(end: DQuat, momentum: DVec3, duration: f64, inverse: &DMat3) -> Vec<DQuat> {
    let rate = |turn: DQuat| {
        let axes = DMat3::from_quat(turn.normalize());
        let spin = axes * (*inverse * (axes.transpose() * momentum));
        DQuat::from_xyzw(spin.x, spin.y, spin.z, 0.0) * turn * 0.5
    };
    let count = (duration / TURN_STEP).ceil() as usize + 1;
    let mut turns = Vec::with_capacity(count + 1);
    turns.push(end);
    let step = -TURN_STEP;
    for _ in 0..count {
        let turn = turns[turns.len() - 1];
        let first = rate(turn);
        let second = rate(turn + first * (step / 2.0));
        let third = rate(turn + second * (step / 2.0));
        let fourth = rate(turn + third * step);
        turns.push((turn + (first + second * 2.0 + third * 2.0 + fourth) * (step / 6.0)).normalize());
    }
    turns
}

/// Flights one after another, the last one first.
#[derive(Clone, Debug)]
pub struct Path {
    pub flights: Vec<Flight>,
}

impl Path {
    pub fn duration(&self) -> f64 {
        self.flights.iter().map(|flight| flight.duration).sum()
    }

    /// The flight at a time before the end, and the time before its own end.
    pub fn at(&self, before: f64) -> (usize, f64) {
        let mut left = before;
        for (number, flight) in self.flights.iter().enumerate() {
            if left <= flight.duration || number + 1 == self.flights.len() {
                return (number, left);
            }
            left -= flight.duration;
        }
        (0, before)
    }

    /// The pose at a time before the end; before its beginning, the one there.
    pub fn pose(&self, before: f64) -> Pose {
        let (number, before) = self.at(before);
        self.flights[number].pose(before.min(self.flights[number].duration))
    }

    /// Velocity of the center of mass at a time before the end.
    pub fn velocity(&self, before: f64) -> DVec3 {
        let (number, before) = self.at(before);
        self.flights[number].twist.velocity - before * GRAVITY
    }

    /// The fastest that a body of this radius turns, as a speed of its surface.
    pub fn turning(&self, radius: f64) -> f64 {
        self.flights.iter().map(|flight| flight.twist.spin.length() * radius).fold(0.0, f64::max)
    }

    /// The highest speed of the center of mass.
    pub fn fastest(&self) -> f64 {
        let ends = |flight: &Flight| {
            let begin = flight.twist.velocity - flight.duration * GRAVITY;
            flight.twist.velocity.length().max(begin.length())
        };
        self.flights.iter().map(ends).fold(0.0, f64::max)
    }

    pub fn end(&self) -> &Pose {
        &self.flights[0].end
    }

    /// A box around the whole motion of a body of this radius.
    pub fn bounds(&self, radius: f64) -> (DVec3, DVec3) {
        let boxes = self.flights.iter().map(|flight| flight.bounds(radius));
        boxes.reduce(|(l, h), (low, high)| (l.min(low), h.max(high))).unwrap_or_default()
    }
}
