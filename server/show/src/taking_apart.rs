//! Taking apart: bodies leave the pile that rests, one after another, and each time the others come to rest again.
//!
//! Before a body leaves, statics says what becomes of the others ([`cairn_analysis`]); what did become of them is
//! found by simulation, and both are reported. A body that leaves is out of the world at once, so that it touches
//! nothing. Its way is for the eye: out in the direction in which least is in its way, and set down beside the pile.

use cairn_analysis::{AnalysisOptions, PileForecast, Removal, Touch, forecast};
use cairn_engine::shape::corners;
use cairn_geometry::pose::Pose;
use cairn_input::error::{Error, counted};
use cairn_input::observer::{Observer, Stage};
use cairn_input::params::Params;
use cairn_input::scene::{RemovalChoice, RemovalRequest};
use cairn_motion::hold::{self, HoldOutcome};

use cairn_engine::world::{BodyId, PairSide};
use cairn_motion::pile::Pile;
use cairn_motion::step::{Departure, Simulation};
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A body has moved that is farther than this from its place, d; and has come down, if farther than the other.
pub const MOVED: f64 = 0.02;
pub const FALLEN: f64 = 0.1;
/// Speed of a body that is carried away, d per characteristic time.
const SPEED: f64 = 0.75;
/// Room between bodies that were set down, and between them and the pile, d.
const ROOM: f64 = 0.25;
const BESIDE: f64 = 1.5;
/// The random order differs from the fill's numbers.
const SEED_STEP: u64 = 0xd134_2543_de82_ef95;

/// A body that was taken away, and what became of the others.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct RemovedBody {
    pub body: usize,
    /// The frame in which it begins to leave, and the one in which the others rest again.
    pub frame: usize,
    pub rest_frame: usize,
    /// By statics, before; `None` for a body that statics finds to fall as it is.
    pub forecast: Option<Removal>,
    /// Bodies that rested on it, ascending.
    pub rest_on_it: Vec<usize>,
    /// What touched before, with the forces of an equilibrium.
    pub touches: Vec<Touch>,
    /// Bodies that moved, ascending, and how far, m.
    pub moved: Vec<(usize, f64)>,
    /// Those of them that came down.
    pub came_down: Vec<usize>,
    /// Whether the others came to rest, and the largest speed of any in the end, m/s.
    pub at_rest: bool,
    pub speed: f64,
    /// Poses of all bodies before it left, and when the others rested again: from the props' own frames, m.
    pub before: Vec<Pose>,
    pub after: Vec<Pose>,
}

/// Takes the bodies of the scene away, and lets the others come to rest. `ground`: its height, m, where there is one.
/// `held`: how the hold before ended.
pub fn run(
    sim: &mut Simulation,
    requests: &[RemovalRequest],
    params: &Params,
    ground: Option<f64>,
    mut held: HoldOutcome,
    observer: &mut dyn Observer,
) -> Result<(HoldOutcome, Vec<RemovedBody>), Error> {
    let mut apart = TakingApart { params, ground, removed: Vec::new(), beside: None, is_over: false };
    if !requests.is_empty() && sim.pile.control.is_on() {
        // What is held would not come down.
        sim.pile.end_control(true);
        held = hold::run(sim, params, false, observer)?;
    }
    for (number, request) in requests.iter().enumerate() {
        let wait = request.start.unwrap_or(0.0);
        while sim.seconds_so_far() < wait && !apart.ends(sim) {
            sim.advance(observer, Stage::Hold, |_| 0.99)?;
        }
        let from = apart.removed.len();
        match request.choice {
            RemovalChoice::Named { prop, number: of } => {
                let ids = 0..sim.pile.instances.len();
                let mut named = ids.filter(|&id| prop.is_none_or(|prop| sim.pile.instances[id].prop == prop));
                match named.nth(of).filter(|&id| sim.pile.world.is_present(id)) {
                    Some(id) => held = apart.take(sim, &[id], false, held, observer)?.0,
                    None => apart.note(sim, number, "there is no such body in the pile, or it is gone"),
                }
            }
            RemovalChoice::Safe { most } => {
                let all = by_height(&sim.pile);
                let found = forecast(&sim.pile.world, &AnalysisOptions::default(), &all, false, observer)?;
                let is_safe = |(_, removal): &&(BodyId, Option<Removal>)| removal.as_ref().is_some_and(|r| r.is_safe);
                let safe: Vec<BodyId> = found.removals.iter().filter(is_safe).map(|(id, _)| *id).collect();
                for &id in &safe {
                    if apart.removed.len() - from < most {
                        held = apart.take(sim, &[id], true, held, observer)?.0;
                    }
                }
            }
            RemovalChoice::Order { most } => {
                let mut goes_on = true;
                while goes_on && apart.removed.len() - from < most {
                    let all = by_height(&sim.pile);
                    (held, goes_on) = apart.take(sim, &all, true, held, observer)?;
                }
            }
            RemovalChoice::Any { most } => {
                let seed = params.seed.wrapping_add((number as u64 + 1).wrapping_mul(SEED_STEP));
                let mut order: Vec<BodyId> = (0..sim.pile.instances.len()).collect();
                shuffle(&mut order, seed);
                for id in order {
                    if apart.removed.len() - from < most && may_leave(&sim.pile, id) {
                        held = apart.take(sim, &[id], false, held, observer)?.0;
                    }
                }
            }
        }
        if apart.removed.len() == from && !apart.is_over && !matches!(request.choice, RemovalChoice::Named { .. }) {
            apart.note(sim, number, "no body was found that may leave");
        }
    }
    if apart.is_over {
        let count = counted(apart.removed.len(), "body", "bodies");
        sim.pile.notes.push(format!(
            "remove: only {count} left before the last frame; bake more frames, or leave output.frames out"
        ));
    }
    Ok((held, apart.removed))
}

/// The bodies of a pile that may leave, the highest first.
fn by_height(pile: &Pile) -> Vec<BodyId> {
    let mut all: Vec<BodyId> = (0..pile.instances.len()).filter(|&id| may_leave(pile, id)).collect();
    let height = |id: BodyId| pile.world.pose(id).translation.y;
    all.sort_by(|&a, &b| height(b).total_cmp(&height(a)).then(a.cmp(&b)));
    all
}

/// An order drawn evenly from all.
fn shuffle(order: &mut [BodyId], seed: u64) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    for last in (1..order.len()).rev() {
        order.swap(last, rng.random_range(0..=last));
    }
}

/// What is placed to stay does not leave by choice.
fn may_leave(pile: &Pile, id: BodyId) -> bool {
    pile.world.is_present(id) && !pile.world.bodies()[id].role.stands()
}

struct TakingApart<'p> {
    params: &'p Params,
    /// Its height, m.
    ground: Option<f64>,
    removed: Vec<RemovedBody>,
    /// Where the next body is set down: beyond this, along X; engine units.
    beside: Option<f64>,
    /// The last frame came before all had left.
    is_over: bool,
}

impl TakingApart<'_> {
    fn ends(&mut self, sim: &Simulation) -> bool {
        let last = self.params.output.frames;
        self.is_over |= last.is_some_and(|last| sim.pile.recorder.count() >= last as usize);
        self.is_over
    }

    fn note(&self, sim: &mut Simulation, number: usize, what: &str) {
        sim.pile.notes.push(format!("remove.{number}: {what}; choose another body"));
    }

    /// Takes the first of these away, or, where `only_safe`, the first that is safe to remove. Returns how the others
    /// came to rest, and whether one was taken.
    fn take(
        &mut self,
        sim: &mut Simulation,
        bodies: &[BodyId],
        only_safe: bool,
        held: HoldOutcome,
        observer: &mut dyn Observer,
    ) -> Result<(HoldOutcome, bool), Error> {
        if self.ends(sim) {
            return Ok((held, false));
        }
        let PileForecast { touches, removals, rest_on } =
            forecast(&sim.pile.world, &AnalysisOptions::default(), bodies, only_safe, observer)?;
        let chosen = match only_safe {
            true => removals.into_iter().find(|(_, removal)| removal.as_ref().is_some_and(|r| r.is_safe)),
            false => bodies.first().map(|&id| (id, removals.into_iter().find_map(|(_, removal)| removal))),
        };
        let Some((id, removal)) = chosen else { return Ok((held, false)) };
        let before = poses(&sim.pile);
        let from: Vec<(BodyId, Pose)> = sim.pile.world.present().map(|id| (id, sim.pile.world.pose(id))).collect();
        let frame = sim.pile.recorder.count();
        let way = self.way(&sim.pile, id);
        sim.take_away(id, way);
        let held = hold::run(sim, self.params, false, observer)?;
        let world = &sim.pile.world;
        let moved: Vec<(usize, f64)> = (from.iter())
            .filter(|(other, _)| world.is_present(*other))
            .map(|(other, pose)| (*other, pose.moved(&world.pose(*other), world.bodies()[*other].radius)))
            .filter(|(_, distance)| *distance > MOVED)
            .collect();
        let units = world.units;
        self.removed.push(RemovedBody {
            body: id,
            frame,
            rest_frame: sim.pile.recorder.count(),
            forecast: removal,
            rest_on_it: rest_on[id].clone(),
            touches,
            came_down: moved.iter().filter(|(_, distance)| *distance > FALLEN).map(|(id, _)| *id).collect(),
            moved: moved.into_iter().map(|(id, distance)| (id, distance * units.length)).collect(),
            at_rest: held.at_rest,
            speed: sim.top_speed * units.length / units.time,
            before,
            after: poses(&sim.pile),
        });
        Ok((held, true))
    }

    /// Out in the direction in which least is in its way, up over the pile, and down beside it.
    fn way(&mut self, pile: &Pile, id: BodyId) -> Departure {
        let (world, units) = (&pile.world, pile.world.units);
        let corners_of = |id: BodyId, pose: &Pose| {
            let instance = &pile.instances[id];
            corners(&pile.shapes[instance.prop], instance.scale / units.length, pose).collect::<Vec<DVec3>>()
        };
        let bounds = |id: BodyId, pose: &Pose| {
            let corners = corners_of(id, pose);
            let least = corners.iter().copied().reduce(DVec3::min).unwrap_or(pose.translation);
            (least, corners.into_iter().reduce(DVec3::max).unwrap_or(pose.translation))
        };
        let pose = world.pose(id);
        let (low, high) = bounds(id, &pose);
        let others: Vec<(DVec3, DVec3)> =
            world.present().filter(|&other| other != id).map(|other| bounds(other, &world.pose(other))).collect();
        let pile_low = others.iter().map(|(low, _)| *low).fold(low, DVec3::min);
        let pile_high = others.iter().map(|(_, high)| *high).fold(high, DVec3::max);
        // On a table or a floor, at the height on which the pile stands.
        let ground = self.ground.filter(|_| pile.scene.statics.is_empty());
        let floor = ground.map_or(pile_low.y, |ground| units.height_to_engine(ground));
        // What comes down from the top may go as far as it is high.
        let beside = *self.beside.get_or_insert(pile_high.x + BESIDE.max(pile_high.y - floor));
        let wide = high - low;
        self.beside = Some(beside + wide.x + ROOM);

        // Normals of its contacts, into it.
        let normals: Vec<DVec3> = world
            .contact_pairs(cairn_geometry::contact::REAL_CONTACT)
            .iter()
            .filter_map(|pair| match pair.b {
                _ if pair.a == id => Some((1.0, pair)),
                PairSide::Body(b) if b == id => Some((-1.0, pair)),
                _ => None,
            })
            .flat_map(|(sign, pair)| pair.points.iter().map(move |point| sign * point.normal))
            .collect();
        let around = (0..8).map(|k| {
            let (sin, cos) = libm::sincos(f64::from(k) * std::f64::consts::FRAC_PI_4);
            DVec3::new(sin, 0.0, cos)
        });
        let free = |way: DVec3| normals.iter().map(|normal| normal.dot(way)).fold(0.0, f64::min);
        // Up, unless something on it is in the way.
        let out = around.fold(DVec3::Y, |best, way| if free(way) > free(best) + 0.1 { way } else { best });
        let clear = match out == DVec3::Y {
            true => pile_high.y - low.y,
            // Beyond the box around all others.
            false => {
                (pile_low * out).max(pile_high * out).element_sum() - pose.translation.dot(out) + wide.max_element()
            }
        } + ROOM;
        let outside = pose.translation + clear * out;
        let over = DVec3::new(outside.x, outside.y.max(pile_high.y + wide.y), outside.z);
        let slot = DVec3::new(beside + (pose.translation.x - low.x), over.y, (pile_low.z + pile_high.z) / 2.0);
        let down = DVec3::new(slot.x, floor + (pose.translation.y - low.y), slot.z);
        let places = [pose.translation, outside, over, slot, down];
        let seconds = |from: DVec3, to: DVec3| (from.distance(to) / SPEED * units.time).max(1e-3);
        // It is there for two frames before the others count as at rest.
        let stays = 2.0 / self.params.output.fps;
        let times = places.windows(2).map(|leg| seconds(leg[0], leg[1])).chain([stays, 0.0]);
        let places = places.into_iter().chain([down]).zip(times).collect();
        Departure { begin: 0.0, rotation: pose.rotation, places }
    }
}

/// Poses of all bodies, from the props' own frames, m.
fn poses(pile: &Pile) -> Vec<Pose> {
    let units = pile.world.units;
    let pose = |(id, b): (usize, &cairn_motion::instance::Instance)| {
        let now = match pile.world.is_present(id) {
            true => pile.world.pose(id),
            false => pile.recorder.carried.get(&id).copied().unwrap_or(b.pose),
        };
        pile.shapes[b.prop].prop_pose(&units.pose_to_si(&now), b.scale)
    };
    pile.instances.iter().enumerate().map(pose).collect()
}
