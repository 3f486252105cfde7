//! Ways in which a body may come, by kind: drawn by the seed, the most natural ones first.

use super::path::{GRAVITY, Twist};
use cairn_engine::world::BodyId;
use cairn_geometry::pose::Pose;
use cairn_input::params::EntranceKind;
use glam::DVec3;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Attempts of the kind's own, and of steeper and flatter directions after those.
pub const OWN: usize = 10;
pub const ATTEMPTS: usize = OWN + 24;
/// The fastest spin, per characteristic time.
const SPIN: f64 = 1.2;
/// Speed at which a stream begins, d per characteristic time.
const STREAM_SPEED: f64 = 3.0;
/// How steeply bodies slide out of a container, radians.
const SLIDING: f64 = -0.5;
/// How steeply bodies are thrown, radians.
const FLATTEST: f64 = 0.9;
const STEEPEST: f64 = 1.35;
/// How high a leap is above where it begins and ends, in its length: at first, and more with each attempt.
const LEAP: f64 = 0.45;
const LEAP_STEP: f64 = 0.1;
/// The fastest way in, in speeds of a fall from the height at which bodies appear.
pub const FASTEST: f64 = 2.5;

/// Where bodies come from. Engine units.
pub struct Source {
    pub kind: EntranceKind,
    /// Height at which bodies appear that come from above.
    pub top: f64,
    /// Speed at which they appear there, downward.
    pub speed: f64,
    /// How far directions differ, radians.
    pub spread: f64,
    /// Radius of a stream.
    pub stream: f64,
    /// Where each body comes from in a stream; shape `[body]`. Where all come from: the only one.
    pub places: Vec<DVec3>,
    /// Where each lies before it leaps; shape `[body]`. Empty where bodies appear in flight.
    pub starts: Vec<Pose>,
}

/// Velocities at the end, and how long it takes.
pub type Sample = (Twist, f64);

impl Source {
    /// All come from one place.
    pub fn is_one_place(&self) -> bool {
        self.places.len() == 1
    }

    /// Where bodies come from is seen: a stream, or one place.
    pub fn is_stream(&self) -> bool {
        !self.places.is_empty()
    }

    /// A way to a place. `attempt`: its number; `free`: directions that lead away from what is touched there.
    pub fn sample(&self, id: BodyId, end: &Pose, attempt: usize, free: &[DVec3], rng: &mut Pcg64Mcg) -> Option<Sample> {
        let height = (self.top - end.translation.y).max(0.0);
        let fall = (self.speed * self.speed + 2.0 * height).sqrt();
        let duration = fall - self.speed;
        let (azimuth, share, turn) = (TAU * rng.random::<f64>(), rng.random::<f64>(), direction(rng));
        let spin = SPIN * rng.random_range(0.2..1.0) * turn;
        if let Some(k) = attempt.checked_sub(OWN) {
            return along(*free.get(k)?, fall, self.speed);
        }
        let calm = 1.0 - attempt as f64 / (OWN - 1) as f64;
        let spin = calm * spin;
        match self.kind {
            EntranceKind::None | EntranceKind::Assemble => None,
            EntranceKind::Rain => {
                let aside = fall * libm::tan(self.spread * share * calm);
                let (sin, cos) = libm::sincos(azimuth);
                let velocity = DVec3::new(aside * cos, -fall, aside * sin);
                Some((Twist { velocity, spin }, duration))
            }
            // All come from one place, out of which they slide, a little upward where that leads nowhere.
            EntranceKind::Pour if self.is_one_place() => {
                let (sin, cos) = libm::sincos(azimuth);
                let from = self.places[0] + self.stream * share.sqrt() * DVec3::new(cos, 0.0, sin);
                let rise = SLIDING + (STEEPEST - SLIDING) * (1.0 - calm);
                let (velocity, duration) = thrown(from, end.translation, rise)?;
                Some((Twist { velocity, spin }, duration))
            }
            EntranceKind::Pour => {
                let (sin, cos) = libm::sincos(azimuth);
                let from = *self.places.get(id)? + self.stream * share.sqrt() * DVec3::new(cos, 0.0, sin);
                let down = STREAM_SPEED * rng.random_range(0.5..1.0);
                let duration = (down * down + 2.0 * (from.y - end.translation.y).max(0.0)).sqrt() - down;
                Some((Twist { velocity: arrival(from, end.translation, duration), spin }, duration))
            }
            EntranceKind::Throw => {
                let from = *self.places.first()?;
                let to = end.translation;
                // Flatter at first, and steeper if that leads nowhere.
                let rise = STEEPEST + (FLATTEST - STEEPEST) * calm * (1.0 - share * self.spread);
                let (velocity, duration) = thrown(from, to, rise)?;
                Some((Twist { velocity, spin }, duration))
            }
        }
    }
}

/// Along a free way, without a turn, with a downward speed at the end that a body had less of where it appears. `None`:
/// the way is so flat that it would be too fast.
pub fn along(way: DVec3, fall: f64, speed: f64) -> Option<Sample> {
    let velocity = -(fall / way.y) * way;
    (velocity.length() <= FASTEST * fall).then_some((Twist { velocity, spin: DVec3::ZERO }, fall - speed))
}

/// How long a leap takes: steeper with each attempt, so that what it reaches is reached from above.
pub fn leap(start: DVec3, end: DVec3, attempt: usize, rng: &mut Pcg64Mcg) -> f64 {
    let level = DVec3::new(end.x - start.x, 0.0, end.z - start.z).length();
    let top = start.y.max(end.y) + level * (LEAP + LEAP_STEP * (attempt as f64 + rng.random::<f64>()));
    (2.0 * (top - start.y)).sqrt() + (2.0 * (top - end.y)).sqrt()
}

/// A direction, evenly drawn.
pub fn direction(rng: &mut Pcg64Mcg) -> DVec3 {
    let (height, turn) = (rng.random_range(-1.0..1.0f64), TAU * rng.random::<f64>());
    let (sin, cos) = libm::sincos(turn);
    let out = (1.0 - height * height).max(0.0).sqrt();
    DVec3::new(out * cos, height, out * sin)
}

/// Directions in which a body leaves what it touches by these normals, the freest and steepest first.
pub fn free_directions(normals: &[DVec3]) -> Vec<DVec3> {
    const COUNT: usize = 96;
    let golden = TAU * 0.618_033_988_749_895;
    let spiral = (0..COUNT).map(|k| {
        let height = 1.0 - k as f64 / COUNT as f64;
        let (sin, cos) = libm::sincos(golden * k as f64);
        let out = (1.0 - height * height).max(0.0).sqrt();
        DVec3::new(out * cos, height, out * sin)
    });
    let along = normals.iter().map(|normal| normal.normalize_or_zero());
    let rate = |way: DVec3| normals.iter().map(|normal| normal.dot(way)).fold(0.0, f64::min);
    let mut ways: Vec<(f64, DVec3)> = spiral.chain(along).map(|way| (4.0 * rate(way) + way.y, way)).collect();
    ways.retain(|(_, way)| way.y * FASTEST > 1.0);
    ways.sort_by(|a, b| b.0.total_cmp(&a.0));
    ways.into_iter().map(|(_, way)| way).take(ATTEMPTS - OWN).collect()
}

/// Velocity at the end of a flight that begins with this rise, radians, and how long it takes. `None`: it leads
/// elsewhere.
fn thrown(from: DVec3, to: DVec3, rise: f64) -> Option<(DVec3, f64)> {
    let level = DVec3::new(to.x - from.x, 0.0, to.z - from.z).length();
    let duration = (2.0 * (level * libm::tan(rise) - (to.y - from.y))).max(0.0).sqrt();
    (duration > 0.0).then(|| (arrival(from, to, duration), duration))
}

/// Velocity at the end of a flight that takes this long from one place to another.
fn arrival(from: DVec3, to: DVec3, duration: f64) -> DVec3 {
    (to - from) / duration + 0.5 * duration * GRAVITY
}
