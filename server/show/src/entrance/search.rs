//! The search for the motion of one body: among samples, the one that cuts nothing and needs the least guiding.

use super::landing::Supports;
use super::path::{Flight, GRAVITY, Path, Twist};
use super::sample::{ATTEMPTS, FASTEST, OWN, Source, along, direction, free_directions, leap};
use super::sweep::{self, Passage};
use cairn_engine::world::{BodyId, PairSide, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::pose::Pose;
use cairn_statics::local::{Analyser, LocalContact, LocalProblem};
use glam::{DMat3, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A way in is good enough if contacts give all but this share of the momentum brought in.
pub const GOOD: f64 = 0.005;
/// Out of a stream, so much.
const FAIR: f64 = 0.1;
/// Further ways in that are tried where the best one cuts something, and how far from that they are: in shares of its
/// velocity, and per characteristic time.
const REFINED: usize = 150;
/// A way that cuts by more thicknesses is not followed any further.
const DEEPEST: f64 = 0.5;
const NEAR: f64 = 0.2;
const NEAR_SPIN: f64 = 0.3;
/// A body that leaps to above its place is so many radii above it there.
const ABOVE: f64 = 4.0;
/// Bodies' random numbers differ from each other's, and from the fill's.
const SEED_STEP: u64 = 0x9e37_79b9_7f4a_7c15;
const SEED: u64 = 0x6f8d_1e53_a2c4_97b1;
/// Bounces tried for a body; how fast and how long they are, and how far from the last place that may be.
const BOUNCES: u64 = 16;
const BOUNCE_SPEED: [f64; 2] = [0.25, 1.1];
const BOUNCE_ASIDE: f64 = 0.45;
const BOUNCE_SPIN: f64 = 0.6;
const BOUNCE_TIME: [f64; 2] = [0.4, 4.0];
/// The fastest spin before a bounce, per characteristic time.
const INCOMING_SPIN: f64 = 2.0;

/// A way in, and what it takes.
#[derive(Clone, Debug)]
pub struct Arrival {
    pub path: Path,
    /// Momentum that it brings in; moments count as forces at the radius.
    pub momentum: f64,
    /// Momentum that no contact gives.
    pub guided: f64,
    pub passage: Passage,
}

impl Arrival {
    pub fn is_good(&self) -> bool {
        self.passage.is_clear() && self.guided <= GOOD * self.momentum
    }

    fn rank(&self) -> (f64, f64) {
        let cut = if self.passage.is_clear() { 0.0 } else { self.passage.cut };
        (cut, self.guided / self.momentum.max(f64::MIN_POSITIVE))
    }
}

/// What the search looks at.
pub struct Search<'a> {
    pub world: &'a World,
    pub supports: &'a Supports,
    pub source: Source,
    /// Of each body about its center of mass, in its own axes. Shape `[body]`.
    pub inertia: Vec<DMat3>,
    pub seed: u64,
}

impl Search<'_> {
    fn rng(&self, id: BodyId, step: u64) -> Pcg64Mcg {
        let of_body = (id as u64 + 1).wrapping_mul(SEED_STEP);
        Pcg64Mcg::seed_from_u64((self.seed ^ SEED).wrapping_add(of_body).wrapping_add(step << 48))
    }

    /// Mass, radius, and inertia in the world's axes at a pose.
    fn body(&self, id: BodyId, pose: &Pose) -> (f64, f64, DMat3) {
        let axes = DMat3::from_quat(pose.rotation);
        let body = &self.world.bodies()[id];
        (body.mass, body.radius, axes * self.inertia[id] * axes.transpose())
    }

    /// The size of a change of motion.
    fn size(&self, id: BodyId, force: DVec3, moment: DVec3) -> f64 {
        let radius = self.world.bodies()[id].radius;
        (force.length_squared() + (moment / radius).length_squared()).sqrt()
    }

    /// The way in with this number, the last flight first.
    fn flights(
        &self,
        id: BodyId,
        end: &Pose,
        attempt: usize,
        free: &[DVec3],
        rng: &mut Pcg64Mcg,
    ) -> Option<Vec<Flight>> {
        let Some(start) = self.source.starts.get(id) else {
            let (twist, duration) = self.source.sample(id, end, attempt, free, rng)?;
            return Some(vec![Flight::new(*end, twist, duration, &self.inertia[id])]);
        };
        let leap = |end: Pose, attempt: usize, rng: &mut Pcg64Mcg| {
            Flight::between(start, end, leap(start.translation, end.translation, attempt, rng))
        };
        let Some(k) = attempt.checked_sub(OWN) else { return Some(vec![leap(*end, attempt, rng)]) };
        // To above its place, and in along what is free.
        let (twist, duration) = along(*free.get(k)?, (2.0 * ABOVE * self.world.bodies()[id].radius).sqrt(), 0.0)?;
        let last = Flight::new(*end, twist, duration, &self.inertia[id]);
        let above = last.pose(duration);
        Some(vec![last, leap(above, 0, rng)])
    }

    /// A way in that is a little other than this one.
    fn near(&self, id: BodyId, flights: &[Flight], rng: &mut Pcg64Mcg) -> Vec<Flight> {
        let (last, start) = (&flights[0], self.source.starts.get(id));
        if let (Some(start), [leaps]) = (start, flights) {
            let longest = leap(start.translation, leaps.end.translation, OWN, rng);
            let duration = leaps.duration * (1.0 + NEAR * rng.random_range(-1.0..1.0));
            return vec![Flight::between(start, leaps.end, duration.min(longest))];
        }
        let Twist { velocity, spin } = last.twist;
        let aside = direction(rng) * NEAR * velocity.length() * rng.random::<f64>();
        let other = velocity + aside.with_y(0.0);
        let velocity = if other.length() > FASTEST * other.y.abs() { velocity } else { other };
        let twist = Twist { velocity, spin: spin + NEAR_SPIN * rng.random::<f64>() * direction(rng) };
        let last = Flight::new(last.end, twist, last.duration, &self.inertia[id]);
        let above = last.pose(last.duration);
        let leaps = start.zip(flights.get(1)).map(|(start, leap)| Flight::between(start, above, leap.duration));
        std::iter::once(last).chain(leaps).collect()
    }

    /// The momentum with which a body leaps, and is turned in the air; 0 where it appears in flight.
    pub fn leap_momentum(&self, id: BodyId, arrival: &Arrival) -> f64 {
        if self.source.starts.is_empty() {
            return 0.0;
        }
        let (mut sum, mut after) = (0.0, None);
        for flight in &arrival.path.flights {
            let (mass, _, inertia) = self.body(id, &flight.end);
            if let Some(velocity) = after {
                sum += self.size(id, mass * (velocity - flight.twist.velocity), inertia * flight.twist.spin);
            }
            after = Some(flight.twist.velocity - flight.duration * GRAVITY);
        }
        let (mass, _, _) = self.body(id, arrival.path.end());
        sum + mass * after.unwrap_or_default().length()
    }

    /// The best way in for a body, past what `is_there`.
    pub fn direct(&self, id: BodyId, is_there: &dyn Fn(BodyId) -> bool, analyser: &mut Analyser) -> Option<Arrival> {
        let end = self.world.pose(id);
        let (mass, _, inertia) = self.body(id, &end);
        let normals: Vec<DVec3> = self.supports.normals(id, is_there).collect();
        let free = free_directions(&normals);
        let mut rng = self.rng(id, 0);
        let (mut best, mut blockers): (Option<Arrival>, Vec<BodyId>) = (None, Vec::new());
        for attempt in 0..ATTEMPTS {
            // One that comes from outside the stream is seen at once.
            let is_fair = |best: &Arrival| best.passage.is_clear() && best.guided <= FAIR * best.momentum;
            if attempt >= OWN && self.source.is_stream() && best.as_ref().is_some_and(is_fair) {
                break;
            }
            let Some(flights) = self.flights(id, &end, attempt, &free, &mut rng) else { continue };
            let twist = flights[0].twist;
            let (force, moment) = (-mass * twist.velocity, -(inertia * twist.spin));
            let momentum = self.size(id, force, moment);
            let guided = momentum * self.supports.missing(id, is_there, force, moment, analyser);
            let is_worse = |best: &Arrival| best.passage.is_clear() && guided / momentum >= best.rank().1;
            if best.as_ref().is_some_and(is_worse) {
                continue;
            }
            let path = Path { flights };
            let most = best.as_ref().map_or(DEEPEST, |best| best.rank().0.clamp(sweep::ALLOWED, DEEPEST));
            let passage = sweep::pass(self.world, id, &path, is_there, most);
            blockers.extend_from_slice(&passage.blockers);
            let found = Arrival { path, momentum, guided, passage };
            if best.as_ref().is_none_or(|best| found.rank() < best.rank()) {
                best = Some(found);
            }
            if best.as_ref().is_some_and(Arrival::is_good) {
                break;
            }
        }
        blockers.sort_unstable();
        blockers.dedup();
        let mut best = best?;
        best.passage.blockers = blockers;
        Some(best)
    }

    /// A way in near to one that cuts something, which cuts less.
    pub fn refined(&self, id: BodyId, is_there: &dyn Fn(BodyId) -> bool, than: &Arrival) -> Option<Arrival> {
        let end = self.world.pose(id);
        let (mass, _, inertia) = self.body(id, &end);
        let (mut rng, mut analyser) = (self.rng(id, BOUNCES + 1), Analyser::new());
        let mut best = than.clone();
        for _ in 0..REFINED {
            if best.passage.is_clear() {
                break;
            }
            let flights = self.near(id, &best.path.flights, &mut rng);
            let twist = flights[0].twist;
            let (force, moment) = (-mass * twist.velocity, -(inertia * twist.spin));
            let momentum = self.size(id, force, moment);
            let guided = momentum * self.supports.missing(id, is_there, force, moment, &mut analyser);
            let path = Path { flights };
            let passage = sweep::pass(self.world, id, &path, is_there, best.passage.cut.max(sweep::ALLOWED));
            let found = Arrival { path, momentum, guided, passage };
            if found.rank() < best.rank() {
                best = found;
            }
        }
        (best.rank() < than.rank()).then_some(best)
    }

    /// The same way, with what others leave of its support.
    pub fn weighed(
        &self,
        id: BodyId,
        is_there: &dyn Fn(BodyId) -> bool,
        arrival: &mut Arrival,
        analyser: &mut Analyser,
    ) {
        let end = self.world.pose(id);
        let (mass, _, inertia) = self.body(id, &end);
        let twist = arrival.path.flights[0].twist;
        let (force, moment) = (-mass * twist.velocity, -(inertia * twist.spin));
        arrival.guided = arrival.momentum * self.supports.missing(id, is_there, force, moment, analyser);
    }

    /// A way in that touches something first and bounces off to the end, if one is found that needs no more guiding
    /// than `than`.
    pub fn bounced(
        &self,
        id: BodyId,
        is_there: &dyn Fn(BodyId) -> bool,
        than: &Arrival,
        analyser: &mut Analyser,
    ) -> Option<Arrival> {
        if !self.source.starts.is_empty() {
            return None;
        }
        let end = self.world.pose(id);
        (0..BOUNCES).find_map(|k| {
            let mut rng = self.rng(id, k + 1);
            let (hop, impact) = self.hop(id, &end, is_there, &mut rng, analyser)?;
            let found = self.before_bounce(id, hop, impact, is_there, &mut rng, analyser)?;
            let enough = (GOOD * found.momentum).max(than.guided);
            (found.passage.is_clear() && found.guided <= enough).then_some(found)
        })
    }

    /// A small jump to the end, from where it touches something; and the momentum that no contact gives at its end.
    fn hop(
        &self,
        id: BodyId,
        end: &Pose,
        is_there: &dyn Fn(BodyId) -> bool,
        rng: &mut Pcg64Mcg,
        analyser: &mut Analyser,
    ) -> Option<(Flight, f64)> {
        let (mass, _, inertia) = self.body(id, end);
        let down = rng.random_range(BOUNCE_SPEED[0]..BOUNCE_SPEED[1]);
        let aside = BOUNCE_ASIDE * down.min(1.0) * rng.random::<f64>();
        let way = direction(rng);
        let aside = aside * DVec3::new(way.x, 0.0, way.z).normalize_or_zero();
        let twist =
            Twist { velocity: aside - down * DVec3::Y, spin: BOUNCE_SPIN * rng.random::<f64>() * direction(rng) };
        let (force, moment) = (-mass * twist.velocity, -(inertia * twist.spin));
        let momentum = self.size(id, force, moment);
        let guided = momentum * self.supports.missing(id, is_there, force, moment, analyser);
        if guided > 0.1 * momentum {
            return None;
        }
        let flight = Flight::new(*end, twist, BOUNCE_TIME[1], &self.inertia[id]);
        let path = Path { flights: vec![flight] };
        let touches = sweep::first_cut(self.world, id, &path, is_there)?;
        let flight = path.flights.into_iter().next()?.cut(touches);
        (BOUNCE_TIME[0]..BOUNCE_TIME[1]).contains(&touches).then_some((flight, guided))
    }

    /// The way to where a jump begins. `guided`: at the end of the jump.
    fn before_bounce(
        &self,
        id: BodyId,
        hop: Flight,
        guided: f64,
        is_there: &dyn Fn(BodyId) -> bool,
        rng: &mut Pcg64Mcg,
        analyser: &mut Analyser,
    ) -> Option<Arrival> {
        let touch = hop.pose(hop.duration);
        let after = hop.twist(hop.duration, &self.inertia[id]);
        let (mass, radius, inertia) = self.body(id, &touch);
        let contacts = self.touching(id, &touch, is_there);
        let middle = contacts.iter().map(|c| c.point).sum::<DVec3>() / contacts.len().max(1) as f64;
        let (before, duration) = self.source.sample(id, &touch, 0, &[], rng)?;
        let force = mass * (after.velocity - before.velocity);
        // The spin with which an impact at the middle of the contacts is all that happens.
        let own = after.spin - inertia.inverse() * (middle - touch.translation).cross(force);
        let spin = if own.length() <= INCOMING_SPIN { own } else { before.spin };
        let before = Twist { spin, ..before };
        let moment = inertia * (after.spin - before.spin);
        let energy = |twist: &Twist| mass * twist.velocity.length_squared() + twist.spin.dot(inertia * twist.spin);
        if contacts.is_empty() || energy(&after) > energy(&before) {
            return None;
        }
        let center_of_mass = touch.translation;
        let problem = LocalProblem { contacts: &contacts, mass, center_of_mass, radius, gravity: DVec3::NEG_Y };
        let missing = analyser.missing(&problem, force, moment).ok()?;
        let momentum = self.size(id, mass * before.velocity, inertia * before.spin);
        let guided = guided + missing * self.size(id, force, moment);
        if guided > 0.1 * momentum {
            return None;
        }
        let path = Path { flights: vec![hop, Flight::new(touch, before, duration, &self.inertia[id])] };
        let passage = sweep::pass(self.world, id, &path, is_there, sweep::ALLOWED);
        Some(Arrival { path, momentum, guided, passage })
    }

    /// The contacts of a body at a pose with what is there.
    fn touching(&self, id: BodyId, pose: &Pose, is_there: &dyn Fn(BodyId) -> bool) -> Vec<LocalContact> {
        let body = &self.world.bodies()[id];
        let near = self.world.obstacles(id, pose.translation - body.radius, pose.translation + body.radius);
        let there = near.into_iter().filter(|obstacle| match obstacle.side {
            PairSide::Body(other) => is_there(other),
            _ => true,
        });
        let contacts = there.flat_map(|obstacle| {
            let (friction, points) = self.world.touches_at(id, pose, &obstacle, REAL_CONTACT * body.thickness);
            points.into_iter().map(move |p| LocalContact { point: p.point, normal: p.normal, friction })
        });
        contacts.collect()
    }
}
