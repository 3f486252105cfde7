//! Filling the container with props (Cho et al. 2007; paper, 4.1).

mod filling;
mod method;
mod pockets;
mod shake;
mod world;
mod zones;

use cairn_engine::shape::Shape;
use cairn_engine::world::{Units, WorldCounters};
use cairn_input::error::{Error, SceneProblem};
use cairn_input::observer::Observer;
use cairn_input::params::{FillMethod, Params};
use cairn_input::scene::Scene;
use cairn_motion::instance::Instance;
use cairn_prepare::container::Container;
pub use filling::FillTask;
use filling::Filling;
use glam::DVec3;
use method::{Method, Pass};
use world::EnclosureMeshes;
use zones::Zones;

/// A full container. Plain data: a release starts from it as often as one likes.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Filled {
    pub bodies: Vec<Instance>,
    pub removed: Removed,
    /// Without the steps of the depenetration.
    pub steps: u64,
    pub depenetration_steps: u64,
    /// The container was full; `false`: a limit was reached.
    pub full: bool,
    /// Share of the container's volume in pockets, which no body is near.
    pub pockets: f64,
    /// `None`: it was not shaken.
    pub shaken: Option<Shaken>,
    /// Triangles that simplification removed from the container, and the distance by which it moved the surface, in d.
    pub wall_triangles_saved: usize,
    pub wall_deviation: f64,
    pub counters: WorldCounters,
}

/// Bodies that the fill took out, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Removed {
    pub sticking_out: usize,
    pub overlapping: usize,
    pub escaped: usize,
    /// Reached into scenery.
    #[serde(default)]
    pub cutting: usize,
}

impl Filled {
    /// Adds another pile. `share`: of its volume in that of both.
    pub fn join(&mut self, other: Filled, share: f64) {
        let Removed { sticking_out, overlapping, escaped, cutting } = other.removed;
        self.bodies.extend(other.bodies);
        self.removed.sticking_out += sticking_out;
        self.removed.overlapping += overlapping;
        self.removed.escaped += escaped;
        self.removed.cutting += cutting;
        self.steps += other.steps;
        self.depenetration_steps += other.depenetration_steps;
        self.full &= other.full;
        self.pockets += share * (other.pockets - self.pockets);
        self.shaken = match (self.shaken, other.shaken) {
            (Some(a), Some(b)) => Some(Shaken { steps: a.steps + b.steps, taken_back: a.taken_back || b.taken_back }),
            (one, another) => one.or(another),
        };
        self.wall_triangles_saved += other.wall_triangles_saved;
        self.wall_deviation = self.wall_deviation.max(other.wall_deviation);
        self.counters.add(&other.counters);
    }
}

/// Outcome of shaking.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Shaken {
    pub steps: u64,
    /// The shape was worse after it: the pile lies as before.
    pub taken_back: bool,
}

/// Places before the container in the engine's order, per expected body.
const PLACES: usize = 2;

/// Rounds in which bodies that the clean-up removes are replaced.
const REPLACEMENTS: usize = 5;
/// Settling between the passes of depenetration, and after the bodies have shrunk to their size, characteristic times.
const CLOSE_GAPS: f64 = 1.0;

/// Fills the container and lets the props settle in it. `others`: bodies of other piles, which the fill leaves alone,
/// as it does those that an earlier pile had there. An error if not one prop found room.
pub fn run(task: FillTask, others: &[Instance], observer: &mut dyn Observer) -> Result<Filled, Error> {
    let FillTask { scene, params, container, .. } = task;
    let (fill, wanted) = (&params.fill, task.wanted());
    let mut method = method::of(task.method());
    let mut filling = Filling::new(task, method.gravity(task.height()), true);
    filling.place_given(others)?;
    let zones = Zones::new(&task, &mut filling.rng);
    let poured = if method.is_open() { Some(fill_open(&mut *method, &mut filling, observer)?) } else { None };

    let closed = container.closed(fill.loosened());
    let outer = (fill.standing_out() > 0.0).then(|| container.closed(fill.outside()));
    let enclosure = filling.world.enclose(
        PLACES * (task.expected + task.kept_inside).min(fill.max_bodies as usize),
        &EnclosureMeshes {
            container: &closed.mesh,
            outer: outer.as_ref().map(|outer| &outer.mesh),
            core: container.core.as_ref(),
            floor: container.base,
            scenery: container.scenery(),
        },
    )?;
    let full = match poured {
        Some(full) => {
            filling.remove_from_scenery();
            full
        }
        None => {
            let exchanged = task.kept.map_or(&[][..], |kept| &kept.exchanged);
            method::grow_at(&mut filling, exchanged, observer)?;
            fill_closed(&mut *method, &mut filling, zones.as_ref(), wanted, observer)?
        }
    };
    filling.use_real_friction();
    filling.world.use_scenery_friction(&enclosure);
    // Turned over with the container still around it, the pile closes its gaps under its own weight.
    filling.point_gravity(DVec3::NEG_Y);
    if full {
        filling.settle(fill.settle, observer)?
    } else {
        filling.settle_from_fall(observer)?
    }
    filling.clean_up(observer)?;
    for _ in 0..REPLACEMENTS {
        let is_short = fill.count.is_some() && filling.world.loose().count() < wanted;
        if full || poured.is_some() || !is_short {
            break;
        }
        fill_closed(&mut *method, &mut filling, zones.as_ref(), wanted, observer)?;
        filling.use_real_friction();
        filling.settle_from_fall(observer)?;
        filling.clean_up(observer)?;
    }
    let shaken = if fill.shake > 0.0 { Some(shake::run(&mut filling, observer)?) } else { None };
    let depenetration_steps = part(&mut filling, observer)?;
    if !container.scenery().is_empty() {
        filling.clear_scenery(observer)?;
    }
    filling.world.remove_enclosure(enclosure);
    let depenetration_steps = depenetration_steps + filling.part_in_scenery(observer)?;
    filling.world.validate(wanted);
    let bodies: Vec<Instance> = filling.world.loose().map(|id| filling.world.instance(id)).collect();
    if bodies.is_empty() && task.kept_inside == 0 {
        let name = scene.control.as_ref().map_or("", |model| &model.name);
        let text =
            format!("{name}: not one prop found room inside; make the control mesh larger, or the props smaller");
        return Err(Error::Invalid(vec![SceneProblem::new("control_mesh", text)]));
    }
    Ok(Filled {
        bodies,
        removed: filling.removed(),
        steps: filling.world.steps() - depenetration_steps,
        depenetration_steps,
        full,
        pockets: pockets::fraction(&filling),
        shaken,
        wall_triangles_saved: closed.saved,
        wall_deviation: closed.deviation,
        counters: filling.world.counters(),
    })
}

/// Removes the overlaps that are left, while the container still keeps the bodies in: without it, parted bodies would
/// move outward, and the pile would lose the pressure that its shape rests on. Returns the steps of depenetration.
fn part(filling: &mut Filling, observer: &mut dyn Observer) -> Result<u64, Error> {
    if filling.shrink_overgrown() {
        filling.settle(CLOSE_GAPS, observer)?;
    }
    // What a softer settling lets sink in, the hold would keep.
    filling.use_stiffer_contacts();
    let first = filling.depenetrate(observer)?;
    if first > 0 {
        filling.settle(CLOSE_GAPS, observer)?;
    }
    let mut second = filling.depenetrate(observer)?;
    if filling.task.method() == FillMethod::Insert {
        second += filling.free_locked(observer)?;
    }
    // What is stacked stands on what is below it.
    if second > 0 && filling.task.params.fill.method == FillMethod::Stack {
        filling.settle(CLOSE_GAPS, observer)?;
    }
    Ok(first + second)
}

/// Fills the open container. Returns whether it is full.
fn fill_open(method: &mut dyn Method, filling: &mut Filling, observer: &mut dyn Observer) -> Result<bool, Error> {
    let props: Vec<usize> = filling.task.drawn_props().collect();
    let limit = filling.task.wanted();
    method.run(filling, &Pass { props: &props, zones: None, limit }, observer)
}

/// Fills the closed container until it is full, which is returned, or until there are `limit` bodies.
fn fill_closed(
    method: &mut dyn Method,
    filling: &mut Filling,
    zones: Option<&Zones>,
    limit: usize,
    observer: &mut dyn Observer,
) -> Result<bool, Error> {
    let mut full = false;
    for props in passes(&filling.task) {
        full = method.run(filling, &Pass { props: &props, zones, limit }, observer)?;
    }
    Ok(full)
}

/// Props smaller than this share of the largest fill its gaps.
const SMALL: f64 = 0.5;

/// The props of each pass: where small ones are to fill the gaps of large ones, those come last.
fn passes(task: &FillTask) -> Vec<Vec<usize>> {
    let diameter = |i: usize| task.shapes[i].size.diameter * task.scene.props[i].scale[1];
    let largest = task.drawn_props().map(diameter).fold(0.0, f64::max);
    let (small, large): (Vec<_>, Vec<_>) = task.drawn_props().partition(|&i| diameter(i) < SMALL * largest);
    if task.params.fill.gaps && !small.is_empty() { vec![large, small] } else { vec![task.drawn_props().collect()] }
}

/// Pours the props by a method for open containers and leaves them as they fell, upside down: no settling, no clean-up.
pub fn pour_only(
    scene: &Scene,
    shapes: &[Shape],
    params: &Params,
    units: Units,
    container: &Container,
    observer: &mut dyn Observer,
) -> Result<Vec<Instance>, Error> {
    let task = FillTask::new(scene, shapes, params, units, container, None);
    let mut method = method::of(params.fill.method);
    let mut filling = Filling::new(task, method.gravity(task.height()), false);
    fill_open(&mut *method, &mut filling, observer)?;
    Ok(filling.world.present().map(|id| filling.world.instance(id)).collect())
}
