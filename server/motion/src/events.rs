//! Events of a scene at given times: bodies appear, are carried away, pinned bodies are released, scenery moves, the
//! control ends. Called before each step of the release and the hold; times are those of the frames.

use super::instance::{self, Instance};
use super::pile::Pile;
use super::policy::Policy;
use cairn_engine::world::{BodyId, MovingId, ReservedPlaces};
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::pose::Pose;
use cairn_input::error::{Error, counted};
use cairn_input::params::{Params, Switch};
use cairn_input::scene::{Emitter, EmitterVolume, PlacedBody, Scene, StaticModel};
use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// The events still to come.
pub struct Events<'a> {
    scene: &'a Scene,
    /// By time.
    late: Vec<&'a PlacedBody>,
    /// When a pinned body is released, s; in no order.
    pinned: Vec<(f64, BodyId)>,
    emissions: Vec<Emission<'a>>,
    moving: Vec<(MovingId, &'a StaticModel)>,
    /// Bodies that are being carried away.
    leaving: Vec<(BodyId, Departure)>,
    /// When the control ends, s, and whether it is withdrawn then, not ended at once.
    until: Option<(f64, bool)>,
    /// s after frame 0, at the end of the step to come.
    time: f64,
    /// The step at which frame 0 is; `None`: it is still to come.
    first_step: Option<u64>,
    /// Whether the scene has any events.
    has_any: bool,
}

/// The way of a body that is taken out of the world: it touches nothing on it.
#[derive(Clone, Debug)]
pub struct Departure {
    /// s after frame 0.
    pub begin: f64,
    /// Its turn all the way, and its places, engine units, each with the time until the next, s. At least one.
    pub rotation: DQuat,
    pub places: Vec<(DVec3, f64)>,
}

impl Departure {
    fn seconds(&self) -> f64 {
        let legs = self.places.len().saturating_sub(1);
        self.places[..legs].iter().map(|(_, seconds)| seconds).sum()
    }

    /// Each leg begins and ends gently.
    fn pose_after(&self, mut seconds: f64) -> Pose {
        for leg in self.places.windows(2) {
            let [(from, time), (to, _)] = [leg[0], leg[1]];
            if seconds < time {
                let s = (seconds / time).clamp(0.0, 1.0);
                return Pose { translation: from.lerp(to, s * s * (3.0 - 2.0 * s)), rotation: self.rotation };
            }
            seconds -= time;
        }
        let end = self.places.last().map_or(DVec3::ZERO, |(place, _)| *place);
        Pose { translation: end, rotation: self.rotation }
    }
}

/// An emitter at work.
struct Emission<'a> {
    emitter: &'a Emitter,
    /// The interior of its mesh; `None`: it emits in a box.
    inside: Option<MeshInterior>,
    rng: Pcg64Mcg,
    emitted: u32,
    /// Time since which it has found no free spot, s.
    blocked: Option<f64>,
    given_up: bool,
}

/// Spots tried for a body before it has to wait for the next step.
const TRIES: usize = 30;
/// An emitter that finds no free spot for this long, characteristic times, gives up: a pile has grown into it.
const PATIENCE: f64 = 20.0;
/// Emitters' random numbers differ from the fill's and from each other's.
const SEED_STEP: u64 = 0x9e37_79b9_7f4a_7c15;

impl<'a> Events<'a> {
    /// The events of a pile's scene; those due at the beginning happen at once, or where they wait, by
    /// [`Events::begin`].
    pub fn new(pile: &mut Pile<'a>, params: &Params, waits: bool) -> Result<Events<'a>, Error> {
        let scene = pile.scene;
        let mut late: Vec<&PlacedBody> = scene.bodies.iter().filter(|body| !body.is_stacked()).collect();
        late.sort_by(|a, b| a.start.total_cmp(&b.start));
        let first_stacked = pile.instances.len() - scene.bodies.iter().filter(|body| body.is_stacked()).count();
        let stacked = scene.bodies.iter().filter(|body| body.is_stacked()).zip(first_stacked..);
        let pinned = stacked.filter_map(|(body, id)| Some((body.pinned_until?, id))).collect();
        let emission = |(i, emitter): (usize, &'a Emitter)| Emission {
            emitter,
            inside: match &emitter.place {
                EmitterVolume::Box { .. } => None,
                EmitterVolume::Mesh(model) => Some(MeshInterior::new(&model.mesh)),
            },
            rng: Pcg64Mcg::seed_from_u64(params.seed.wrapping_add((i as u64 + 1).wrapping_mul(SEED_STEP))),
            emitted: 0,
            blocked: None,
            given_up: false,
        };
        let mut events = Events {
            scene,
            late,
            pinned,
            emissions: scene.emitters.iter().enumerate().map(emission).collect(),
            moving: Vec::new(),
            leaving: Vec::new(),
            until: params.control.until.map(|time| (time, params.control.stand == Switch::On)),
            time: 0.0,
            first_step: (!waits).then_some(0),
            has_any: false,
        };
        for model in scene.statics.iter().filter(|model| !model.keys.is_empty()) {
            let added = pile.world.add_moving_scenery(&model.model.mesh, model.friction, &model.pose_at(0.0));
            events.moving.push((added.map_err(Error::Internal)?, model));
        }
        events.late.reverse();
        if !waits {
            events.add_late(pile)?;
        }
        events.has_any = scene.something_hits() || events.until.is_some();
        Ok(events)
    }

    /// Frame 0 is now.
    pub fn begin(&mut self, pile: &mut Pile<'a>) -> Result<(), Error> {
        self.first_step = Some(pile.step);
        self.add_late(pile)
    }

    /// The step at which frame 0 was.
    pub fn first_step(&self) -> u64 {
        self.first_step.unwrap_or(0)
    }

    /// No event is to come before anything else happens.
    pub fn are_over(&self) -> bool {
        if self.first_step.is_none() {
            return true;
        }
        let at_end = |model: &StaticModel| model.keys.last().is_none_or(|key| key.time < self.time);
        self.late.is_empty()
            && self.pinned.is_empty()
            && self.until.is_none()
            && self.leaving.is_empty()
            && self.emissions.iter().all(Emission::is_over)
            && self.moving.iter().all(|(_, model)| at_end(model))
    }

    /// Carries out the events that are due in the coming step.
    pub fn before_step(&mut self, pile: &mut Pile<'a>) -> Result<(), Error> {
        let Some(first) = self.first_step.filter(|_| self.has_any) else { return Ok(()) };
        let step = pile.world.step_length() * pile.world.units.time;
        // An event at the end of a step belongs to it, whatever the rounding, as a frame does.
        self.time = ((pile.step - first) as f64 + 1.0 + 1e-9) * step;
        for &(id, model) in &self.moving {
            pile.world.move_scenery(id, &model.pose_at(self.time));
        }
        if pile.world.scenery_moves() {
            pile.latest_event = pile.step;
        }
        self.carry(pile);
        let before = pile.instances.len();
        self.add_late(pile)?;
        for i in 0..self.emissions.len() {
            self.emit(i, before, pile)?;
        }
        if pile.instances.len() > before {
            pile.recorder.join(&pile.world);
        }
        let due: Vec<BodyId> = self.pinned.iter().filter(|k| k.0 <= self.time).map(|k| k.1).collect();
        self.pinned.retain(|k| k.0 > self.time);
        for id in due {
            pile.disturb();
            pile.release(id);
        }
        if let Some((_, withdraws)) = self.until.filter(|until| until.0 <= self.time) {
            self.until = None;
            pile.end_control(withdraws);
        }
        Ok(())
    }

    /// Time at the end of the latest step, s after frame 0.
    pub fn now(&self, pile: &Pile) -> f64 {
        (pile.step - self.first_step()) as f64 * pile.world.step_length() * pile.world.units.time
    }

    /// A body leaves on a way that begins now.
    pub fn take_away(&mut self, pile: &mut Pile<'a>, id: BodyId, way: Departure) {
        self.has_any = true;
        pile.recorder.carried.insert(id, way.pose_after(0.0));
        self.leaving.push((id, Departure { begin: self.now(pile), ..way }));
    }

    /// Moves the bodies that are being carried away.
    fn carry(&mut self, pile: &mut Pile<'a>) {
        for (id, way) in &self.leaving {
            pile.recorder.carried.insert(*id, way.pose_after(self.time - way.begin));
            pile.latest_event = pile.step;
        }
        let time = self.time;
        self.leaving.retain(|(_, way)| time - way.begin < way.seconds());
    }

    /// Adds the bodies placed by hand that are due.
    fn add_late(&mut self, pile: &mut Pile<'a>) -> Result<(), Error> {
        while let Some(body) = self.late.pop_if(|body| body.start <= self.time) {
            // Its own time is within the step: it starts from where it reaches its pose at that time.
            let step = pile.world.step_length() * pile.world.units.time;
            let begin = (pile.step - self.first_step()) as f64 * step;
            let mut placed = body.clone();
            placed.pose.translation -= body.velocity * (body.start - begin).clamp(0.0, step);
            pile.disturb();
            let id = pile.place(&placed)?;
            if body.pinned {
                Policy::pin(&mut pile.world, id);
                self.pinned.extend(body.pinned_until.map(|until| (until, id)));
            } else {
                pile.world.launch(id, body.velocity, body.angular_velocity);
            }
        }
        Ok(())
    }

    /// Adds the bodies that are due from an emitter. `first`: the first body that was added since the last step.
    fn emit(&mut self, number: usize, first: BodyId, pile: &mut Pile<'a>) -> Result<(), Error> {
        let emission = &mut self.emissions[number];
        let emitter = emission.emitter;
        if emission.is_over() || emitter.start > self.time {
            return Ok(());
        }
        let due = ((self.time - emitter.start) * emitter.rate).floor() + 1.0;
        let wanted = due.min(f64::from(emitter.count)) as u32 - emission.emitted;
        let mut reserved = pile.world.reserved_places(first..pile.instances.len());
        for _ in 0..wanted {
            let Some(body) = emission.find_spot(self.scene, pile, &mut reserved) else {
                let since = *emission.blocked.get_or_insert(self.time);
                if self.time - since > PATIENCE * pile.world.units.time {
                    emission.given_up = true;
                    pile.notes.push(format!(
                        "emitters.{number}: only {} of {} could appear: there was no free spot left; make its place \
                         larger, or move it away from the pile",
                        emission.emitted,
                        counted(emitter.count as usize, "body", "bodies")
                    ));
                }
                break;
            };
            emission.blocked = None;
            emission.emitted += 1;
            let id = pile.insert(body)?;
            pile.counters.bodies_emitted += 1;
            pile.world.launch(id, emitter.velocity, DVec3::ZERO);
            pile.latest_event = pile.step;
        }
        Ok(())
    }
}

impl Emission<'_> {
    fn is_over(&self) -> bool {
        self.given_up || self.emitted >= self.emitter.count
    }

    /// A body at a free spot, engine units.
    fn find_spot(&mut self, scene: &Scene, pile: &Pile, reserved: &mut ReservedPlaces) -> Option<Instance> {
        for _ in 0..TRIES {
            let (prop, scale, rotation) = instance::draw(&scene.props, scene.emitted(self.emitter), &mut self.rng);
            let at = match (&self.emitter.place, &self.inside) {
                (_, Some(inside)) => inside.sample_inside(&mut self.rng)?,
                (EmitterVolume::Box { center, size }, None) => {
                    *center + *size * (DVec3::from_array(std::array::from_fn(|_| self.rng.random())) - 0.5)
                }
                (EmitterVolume::Mesh(_), None) => return None,
            };
            let pose = pile.world.units.pose_to_engine(&Pose { translation: at, rotation });
            if pile.world.reserve(&pile.shapes[prop], scale, &pose, reserved) {
                return Some(Instance { prop, scale, pose });
            }
        }
        None
    }
}
