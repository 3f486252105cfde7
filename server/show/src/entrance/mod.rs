//! Entrance: how the bodies of the finished pile come in.
//!
//! The motion is planned back from its end, so that it ends there exactly (Twigg & James 2008):
//!
//! 1. [`mod@order`]: bodies leave the pile one by one, each on a free way, and without which no other falls. They land
//!    in the reverse order.
//! 2. [`mod@search`]: a way in is a flight under gravity that ends at the body's place ([`mod@path`]), drawn by the
//!    seed ([`mod@sample`]) and held against all that stands there already ([`mod@sweep`]). Where one is found, the
//!    body touches something before, and bounces off to its place.
//! 3. [`mod@landing`]: a body that lands stops. The impulse comes from contacts within their friction, and from glue;
//!    the rest is guiding, which is summed.
//! 4. [`mod@timing`]: when each lands, so that no two meet in the air.
//!
//! Nothing is simulated. The pile is the one that the bake delivers without an entrance, and stands while others land.

mod landing;
mod lying;
mod order;
mod path;
mod sample;
mod search;
mod sweep;
mod timing;

use cairn_engine::world::{BodyId, Role, World};
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::{Frame, FrameBody, Observer, Progress, Stage, State, observe};
use cairn_input::params::{EntranceKind, EntranceOrder, Params};
use cairn_motion::instance::Instance;
use cairn_motion::pile::Pile;
use cairn_statics::local::Analyser;
use glam::{DMat3, DVec3};
use landing::Supports;
use path::{GRAVITY, Path};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use sample::Source;
use search::{Arrival, Search};
use std::collections::{BTreeMap, BTreeSet};

/// A spout that writes is above the mean of the places of this share of the bodies before and after each.
const AT_ABOUT: f64 = 0.1;

/// How the bodies come in, and what it takes.
#[derive(Clone, Debug)]
pub struct Entrance {
    /// The bodies that come in, in the order in which they land, and their motions.
    comers: Vec<Comer>,
    /// Frames after frame 0.
    pub last: usize,
    /// Characteristic times between two frames.
    interval: f64,
    pub figures: EntranceFigures,
    /// CPU seconds.
    pub seconds: f64,
}

#[derive(Clone, Debug)]
struct Comer {
    id: BodyId,
    path: Path,
    /// Characteristic times after frame 0.
    lands: f64,
    first_frame: usize,
}

/// What a planned motion took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EntranceFigures {
    /// Bodies that come in, and those of them that bounce.
    pub bodies: u64,
    pub bounces: u64,
    /// Momentum that no contact gave, as a share of the momentum brought in.
    pub guided_impulse: f64,
    /// The share of it that holds bodies until others carry them.
    pub held_impulse: f64,
    /// The most by which a body cut anything deeper on its way than where it ends, in the thinner one's thickness.
    pub cut_max: f64,
    /// Largest deviation from free fall of a body in the air, as a share of gravity; from the frames.
    pub ballistic_error: f64,
    /// The most that the energy of a body ever grew on its way, in its weight times d.
    pub energy_growth: f64,
    /// s, from frame 0 to the landing of the last body.
    pub seconds: f64,
}

/// Plans how the bodies of a finished pile come in.
pub fn run(pile: &Pile, params: &Params, observer: &mut dyn Observer) -> Result<Entrance, Error> {
    let begin = observer.cpu_seconds();
    let world = &pile.world;
    let comes = |id: BodyId| world.is_present(id) && world.bodies()[id].role != Role::Pinned;
    let ids: Vec<BodyId> = world.present().filter(|&id| comes(id)).collect();
    let supports = Supports::new(world, &pile.glue.joints, &comes);
    let inertia = |id: BodyId| {
        let axes = DMat3::from_quat(world.pose(id).rotation);
        axes.transpose() * world.inertia(id) * axes
    };
    let places: Vec<DVec3> = ids.iter().map(|&id| world.pose(id).translation).collect();
    let highest = ids.iter().zip(&places).map(|(&id, place)| place.y + world.bodies()[id].radius);
    let (distance, spread) = (params.entrance.distance, params.entrance.spread.to_radians());
    let points = |numbers: &[f64]| -> Vec<DVec3> {
        numbers.chunks_exact(3).map(|point| world.units.point_to_engine(DVec3::from_slice(point))).collect()
    };
    let (curve, given) = (points(&params.entrance.curve), points(&params.entrance.source));
    let given = given.first().copied();
    let wishes = wishes(params.entrance.order, &places, &curve);
    let top = highest.fold(f64::NEG_INFINITY, f64::max) + distance;
    let mut rng = Pcg64Mcg::seed_from_u64(params.seed);
    let (mut from, mut speed, mut starts) = (Vec::new(), 0.0, Vec::new());
    match params.entrance.kind {
        EntranceKind::None => {}
        // As if they had fallen from as high again. Where all appear at rest, one is in the way of the next.
        EntranceKind::Rain => speed = (2.0 * distance).sqrt(),
        EntranceKind::Pour if given.is_some() => from.extend(given),
        EntranceKind::Pour => {
            from = vec![DVec3::ZERO; world.bodies().len()];
            let about = if params.entrance.order == EntranceOrder::Along { AT_ABOUT } else { 1.0 };
            let spouts = spouts(&wishes, &places, top, about);
            ids.iter().zip(spouts).for_each(|(&id, spout)| from[id] = spout);
        }
        EntranceKind::Throw => from.push(given.unwrap_or_else(|| thrower(&places, distance))),
        EntranceKind::Assemble => starts = lying::places(pile, &ids, distance, &mut rng),
    }
    let stream = distance * libm::tan(spread);
    let source = Source { kind: params.entrance.kind, top, speed, spread, stream, places: from, starts };
    let all = 0..world.bodies().len();
    let inertia = all.map(|id| if world.is_present(id) { inertia(id) } else { DMat3::IDENTITY }).collect();
    let search = Search { world, supports: &supports, source, inertia, seed: params.seed };
    let bodies = world.present().count();
    let mut going = |fraction: f64| {
        let fraction = 0.99 + 0.01 * fraction;
        let (released, at_rest) = (bodies, bodies);
        observe(observer, &Progress { stage: Stage::Hold, fraction, bodies, released, at_rest, nails: 0, frames: 0 })
    };
    let wishes: Vec<(f64, BodyId)> = wishes.into_iter().zip(ids).collect();
    let mut comers = order::plan(&search, &wishes, &mut going)?;
    let bounces = bounce(&search, &mut comers, &comes);
    let [start, duration] = [params.entrance.start, params.entrance.duration].map(|s| s / world.units.time);
    let (lands, mut meeting) = timing::landings(world, &comers, start, duration, &mut rng);
    let interval = 1.0 / params.output.fps / world.units.time;
    let end = lands.last().copied().unwrap_or(0.0);
    // A frame at the landing belongs to it, whatever the rounding.
    let last = (end / interval - 1e-9).ceil().max(0.0) as usize;
    let held = held_impulse(&search, &comers, &lands, &comes);
    let momentum: f64 = comers.iter().map(|(_, arrival)| arrival.momentum).sum::<f64>().max(f64::MIN_POSITIVE);
    let guided = comers.iter().map(|(id, arrival)| arrival.guided + search.leap_momentum(*id, arrival)).sum::<f64>();
    let lie_about = !search.source.starts.is_empty();
    if lie_about {
        let flights = comers.iter().zip(&lands).map(|((id, arrival), &lands)| (*id, &arrival.path, lands));
        meeting = lying::cut(world, &flights.collect::<Vec<_>>(), &search.source.starts).max(meeting);
    }
    let cut = comers.iter().map(|(_, arrival)| arrival.passage.cut).fold(meeting, f64::max);
    let growth = comers.iter().map(|(id, arrival)| energy_growth(&search, *id, &arrival.path)).fold(0.0, f64::max);
    let figures = EntranceFigures {
        bodies: comers.len() as u64,
        bounces,
        guided_impulse: (guided + held) / momentum,
        held_impulse: held / momentum,
        cut_max: cut,
        ballistic_error: 0.0,
        energy_growth: growth,
        seconds: end * world.units.time,
    };
    let comer = |((id, arrival), lands): ((BodyId, Arrival), f64)| {
        let appears = (lands - arrival.path.duration()) / interval;
        let first_frame = if lie_about { 0 } else { ((appears - 1e-9).ceil().max(0.0) as usize).min(last) };
        Comer { id, path: arrival.path, lands, first_frame }
    };
    let comers = comers.into_iter().zip(lands).map(comer).collect();
    let mut entrance = Entrance { comers, last, interval, figures, seconds: 0.0 };
    entrance.figures.ballistic_error = entrance.ballistic_error();
    entrance.seconds = observer.cpu_seconds() - begin;
    Ok(entrance)
}

/// A number for each place: bodies should land in their order. `curve`: points of the line that it follows, if any.
fn wishes(order: EntranceOrder, places: &[DVec3], curve: &[DVec3]) -> Vec<f64> {
    let low = places.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let high = places.iter().copied().reduce(DVec3::max).unwrap_or_default();
    let (middle, size) = ((low + high) / 2.0, high - low);
    let wish = |place: &DVec3| match order {
        EntranceOrder::BottomUp => place.y,
        EntranceOrder::CenterOut => DVec3::new(place.x - middle.x, 0.0, place.z - middle.z).length(),
        EntranceOrder::Along if curve.len() > 1 => along(curve, *place),
        EntranceOrder::Along => {
            if size.x >= size.z {
                place.x
            } else {
                place.z
            }
        }
    };
    places.iter().map(wish).collect()
}

/// How far along a line of points its nearest point to a place is.
fn along(curve: &[DVec3], place: DVec3) -> f64 {
    let (mut best, mut passed) = ((f64::INFINITY, 0.0), 0.0);
    for pair in curve.windows(2) {
        let span = pair[1] - pair[0];
        let share = ((place - pair[0]).dot(span) / span.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let away = place.distance_squared(pair[0] + share * span);
        if away < best.0 {
            best = (away, passed + share * span.length());
        }
        passed += span.length();
    }
    best.1
}

/// Where the spout is for each place: at this height, above the mean of the places that are filled at about the time,
/// which is a share of all places before and after.
fn spouts(wishes: &[f64], places: &[DVec3], top: f64, about: f64) -> Vec<DVec3> {
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|&a, &b| wishes[a].total_cmp(&wishes[b]).then(a.cmp(&b)));
    let reach = (places.len() as f64 * about).ceil() as usize;
    let mut sums = vec![DVec3::ZERO];
    sums.extend(order.iter().scan(DVec3::ZERO, |sum, &k| {
        *sum += places[k];
        Some(*sum)
    }));
    let mut spouts = vec![DVec3::ZERO; places.len()];
    for (rank, &k) in order.iter().enumerate() {
        let near = rank.saturating_sub(reach)..(rank + reach + 1).min(order.len());
        let mean = (sums[near.end] - sums[near.start]) / near.len() as f64;
        spouts[k] = DVec3::new(mean.x, top, mean.z);
    }
    spouts
}

/// Where bodies are thrown from: beside the pile on the side of -Z, as high as its lowest body.
fn thrower(places: &[DVec3], distance: f64) -> DVec3 {
    let low = places.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let high = places.iter().copied().reduce(DVec3::max).unwrap_or_default();
    DVec3::new((low.x + high.x) / 2.0, low.y, low.z - distance)
}

/// Lets bodies bounce where they may, and looks further where one cuts something. Returns how many bounce.
fn bounce(search: &Search, comers: &mut [(BodyId, Arrival)], comes: &dyn Fn(BodyId) -> bool) -> u64 {
    let bodies = search.world.bodies().len();
    let mut number: Vec<usize> = (0..bodies).map(|id| if comes(id) { usize::MAX } else { 0 }).collect();
    comers.iter().enumerate().for_each(|(k, (id, _))| number[*id] = k);
    let bounced = |(k, (id, arrival)): (usize, &(BodyId, Arrival))| {
        let is_there = |other: BodyId| number[other] < k || !is_comer(search.world, other);
        match arrival.passage.is_clear() {
            true => search.bounced(*id, &is_there, arrival, &mut Analyser::new()),
            false => search.refined(*id, &is_there, arrival),
        }
    };
    let found: Vec<Option<Arrival>> = comers.par_iter().enumerate().map(bounced).collect();
    let mut count = 0;
    for ((_, arrival), found) in comers.iter_mut().zip(found) {
        if let Some(found) = found {
            count += u64::from(found.path.flights.len() > 1);
            *arrival = found;
        }
    }
    count
}

fn is_comer(world: &World, id: BodyId) -> bool {
    world.is_present(id) && world.bodies()[id].role != Role::Pinned
}

/// Momentum that holds bodies which have landed until others that come carry them.
fn held_impulse(search: &Search, comers: &[(BodyId, Arrival)], lands: &[f64], comes: &dyn Fn(BodyId) -> bool) -> f64 {
    let bodies = search.world.bodies().len();
    let mut is_there: Vec<bool> = (0..bodies).map(|id| !comes(id)).collect();
    // Bodies that are not carried: the share of the weight that is missing; and those that nothing connects to what
    // stays.
    let (mut falling, mut floating) = (BTreeMap::<BodyId, f64>::new(), BTreeSet::new());
    let mut analyser = Analyser::new();
    let mut held = 0.0;
    for (k, (id, arrival)) in comers.iter().enumerate() {
        is_there[*id] = true;
        let touched = search.supports.neighbours(*id).into_iter().filter(|other| falling.contains_key(other));
        for one in touched.chain([*id]).collect::<Vec<_>>() {
            match search.supports.falls(one, &|other| is_there[other], &mut analyser) {
                0.0 => falling.remove(&one),
                share => falling.insert(one, share),
            };
        }
        let own = search.supports.floating(*id, &|other| is_there[other]);
        if own.is_empty() {
            // It connects what floated at it to what stays.
            let mut next = vec![*id];
            while let Some(one) = next.pop() {
                let others = search.supports.neighbours(one).into_iter();
                next.extend(others.filter(|other| floating.remove(other)));
            }
        } else {
            // What floats gives no impulse of its own.
            held += arrival.momentum - arrival.guided;
            floating.extend(own);
        }
        let until = lands.get(k + 1).map_or(0.0, |next| next - lands[k]);
        let mass = |id: &BodyId| search.world.bodies()[*id].mass;
        let leaning = falling.iter().filter(|(id, _)| !floating.contains(id)).map(|(id, share)| share * mass(id));
        held += until * (leaning.sum::<f64>() + floating.iter().map(mass).sum::<f64>());
    }
    held
}

/// The most that the energy of a body grows where one flight follows another, in its weight times d.
fn energy_growth(search: &Search, id: BodyId, path: &Path) -> f64 {
    let (mass, inertia) = (search.world.bodies()[id].mass, &search.inertia[id]);
    let energy = |flight: &path::Flight, before: f64| {
        let (pose, twist) = (flight.pose(before), flight.twist(before, inertia));
        let axes = DMat3::from_quat(pose.rotation);
        let turning = twist.spin.dot(axes * *inertia * axes.transpose() * twist.spin);
        0.5 * (twist.velocity.length_squared() + turning / mass) - pose.translation.dot(GRAVITY)
    };
    let pairs = path.flights.windows(2).map(|pair| energy(&pair[0], pair[0].duration) - energy(&pair[1], 0.0));
    let within = path.flights.iter().map(|flight| energy(flight, 0.0) - energy(flight, flight.duration));
    pairs.chain(within).fold(0.0, f64::max)
}

impl Entrance {
    /// The first frame that has each body. Shape `[body]`.
    pub fn first_frames(&self, bodies: usize) -> Vec<usize> {
        let mut frames = vec![0; bodies];
        self.comers.iter().for_each(|comer| frames[comer.id] = comer.first_frame);
        frames
    }

    /// All frames, from the props' own frames, m. `end`: the poses of the finished pile. Shape `[frame][body]`.
    pub fn frames(&self, pile: &Pile, end: &[Pose]) -> Vec<Vec<Pose>> {
        let units = pile.world.units;
        let mut frames = vec![end.to_vec(); self.last + 1];
        for comer in &self.comers {
            let (id, instance) = (comer.id, &pile.instances[comer.id]);
            let shape = &pile.shapes[instance.prop];
            // What separates visible meshes moves a body after it has come to rest.
            let body_end = shape.body_pose(&end[id], instance.scale);
            let shift = body_end.translation - units.point_to_si(comer.path.end().translation);
            let mut after = end[id];
            for number in (0..self.last).rev() {
                let before = comer.lands - number.max(comer.first_frame) as f64 * self.interval;
                if before > 0.0 {
                    let mut pose = units.pose_to_si(&comer.path.pose(before));
                    pose.translation += shift;
                    // The same rotation has two quaternions.
                    if pose.rotation.dot(after.rotation) < 0.0 {
                        pose.rotation = -pose.rotation;
                    }
                    after = shape.prop_pose(&pose, instance.scale);
                }
                frames[number][id] = after;
            }
        }
        frames
    }

    /// Of all frames: the largest deviation from free fall of a body that flies from the frame before one to the frame
    /// after it, as a share of gravity.
    fn ballistic_error(&self) -> f64 {
        let mut worst = 0.0f64;
        for comer in &self.comers {
            for number in comer.first_frame + 1..self.last {
                let times = [number - 1, number, number + 1].map(|k| comer.lands - k as f64 * self.interval);
                if times[2] <= 0.0 {
                    break;
                }
                if times[0] > comer.path.duration() {
                    continue;
                }
                let [first, middle, last] = times.map(|before| (comer.path.at(before).0, comer.path.pose(before)));
                if first.0 != last.0 {
                    continue;
                }
                let bend = first.1.translation - 2.0 * middle.1.translation + last.1.translation;
                worst = worst.max((bend / (self.interval * self.interval) - GRAVITY).length());
            }
        }
        worst
    }
}

/// Shows the frames of an entrance. `frames`: as of [`Entrance::frames`]; `appear`: of [`Entrance::first_frames`].
pub fn show(pile: &Pile, frames: &[Vec<Pose>], appear: &[usize], fps: f64, observer: &mut dyn Observer) {
    if !observer.wants_frames() {
        return;
    }
    for (number, poses) in frames.iter().enumerate() {
        let body = |(&pose, instance): (&Pose, &Instance)| {
            let (prop, scale, state) = (instance.prop, instance.scale, State::Free);
            FrameBody { prop, scale, pose, state }
        };
        let comers: Vec<FrameBody> = poses.iter().zip(&pile.instances).map(body).collect();
        let there = comers.iter().zip(appear).map(|(&body, &first)| (first <= number).then_some(body));
        let bodies: Vec<Option<FrameBody>> = there.collect();
        let time = number as f64 / fps;
        observer.frame(&Frame { stage: Stage::Hold, number, time, bodies: &bodies, comers: &comers });
    }
}
