//! Filling the container with props (Cho et al. 2007; paper, 4.1).

mod filling;
mod insert;
mod mixture;
mod pockets;
mod pour;
mod shake;
mod stack;

use crate::error::Error;
use crate::input::observer::Observer;
use crate::input::params::{FillMethod, Layout, Params};
use crate::input::scene::Scene;
use crate::prepare::container::{Container, Walls};
use crate::prepare::shape::Shape;
use crate::sim::instance::Instance;
use crate::world::{Units, WallId, World, WorldCounters};
use filling::Filling;
use glam::DVec3;
use mixture::Mixture;

/// A full container. Plain data: a release starts from it as often as one likes.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Filled {
    pub bodies: Vec<Instance>,
    pub removed: Removed,
    /// Without those of the depenetration.
    pub steps: u64,
    pub depenetration_steps: u64,
    /// Whether the container was full, rather than a limit reached.
    pub full: bool,
    /// Share of the container's volume that no body is near.
    pub pockets: f64,
    /// `None`: it was not shaken.
    pub shaken: Option<Shaken>,
    /// Triangles that simplification took from the walls, and how far it moved them, in d.
    pub wall_triangles_saved: usize,
    pub wall_deviation: f64,
    pub counters: WorldCounters,
}

/// Bodies that the fill took out again, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Removed {
    pub sticking_out: usize,
    pub overlapping: usize,
    pub escaped: usize,
}

/// What shaking did.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Shaken {
    pub steps: u64,
    /// The shape was worse for it: the pile lies as before.
    pub taken_back: bool,
}

/// Places for so many times the expected bodies are before the walls.
const ROOM: usize = 2;

/// A fill of a wanted number of bodies has more by this share before the clean-up, which takes about as many.
const SURPLUS: f64 = 0.02;
/// What it takes beyond that is replaced so many times.
const REPLACEMENTS: usize = 5;

/// Fills the container and lets the props settle in it.
pub fn run(
    scene: &Scene,
    shapes: &[Shape],
    params: &Params,
    units: Units,
    container: &Container,
    observer: &mut dyn Observer,
) -> Result<Filled, Error> {
    let mut filling = Filling::new(scene, shapes, params, units, container);
    filling.place_given()?;
    filling.mixture = mixture(&mut filling);
    let poured = match params.fill.method {
        FillMethod::Pour => Some(pour::run(&mut filling, observer)?),
        FillMethod::Insert | FillMethod::Stack | FillMethod::Off => None,
    };
    let closed = container.closed(params.fill.loosened());
    let around = (params.fill.standing_out() > 0.0).then(|| container.closed(params.fill.outside()));
    let room = ROOM * filling.expected.min(params.fill.max_bodies as usize);
    let (walls, core, floor) = filling.world.add_behind(room, |world| {
        let walls = add_walls(world, &closed, around.as_ref());
        let core = add_core(world, container);
        (walls, core, world.add_wall(DVec3::new(0.0, container.base, 0.0), DVec3::Y, 0.0))
    });
    let (walls, core) = (walls?, core?);
    let wanted = params.fill.count.unwrap_or(u32::MAX).min(params.fill.max_bodies) as usize;
    let full = match poured {
        Some(full) => full,
        None => {
            let surplus = params.fill.count.map_or(0.0, |n| SURPLUS * f64::from(n)) as usize;
            fill_up(&mut filling, wanted.saturating_add(surplus), observer)?
        }
    };
    filling.use_real_friction();
    // Turned over with the container still around it, the pile closes its gaps under its own weight.
    filling.pull(DVec3::NEG_Y);
    if full {
        filling.settle(params.fill.settle, observer)?
    } else {
        filling.land(observer)?
    }
    filling.clean_up(observer)?;
    for _ in 0..REPLACEMENTS {
        let missing = |filling: &Filling| params.fill.count.is_some_and(|n| filling.loose().count() < n as usize);
        if full || poured.is_some() || !missing(&filling) {
            break;
        }
        fill_up(&mut filling, wanted, observer)?;
        filling.use_real_friction();
        filling.land(observer)?;
        filling.clean_up(observer)?;
    }
    let shaken = match params.fill.shake > 0.0 {
        true => Some(shake::run(&mut filling, observer)?),
        false => None,
    };
    filling.cut_to(wanted);
    // Parted bodies need the room that the walls do not leave them.
    walls.into_iter().for_each(|wall| filling.world.remove_wall(wall));
    let depenetration_steps = filling.depenetrate(observer)?;
    core.into_iter().for_each(|core| filling.world.remove_wall(core));
    filling.world.remove_wall(floor);
    let bodies = filling.loose().map(|id| filling.placed(id)).collect();
    let pockets = pockets::fraction(&filling);
    let (steps, counters) = (filling.world.steps - depenetration_steps, filling.world.counters);
    Ok(Filled {
        bodies,
        removed: filling.removed,
        steps,
        depenetration_steps,
        full,
        pockets,
        shaken,
        wall_triangles_saved: closed.saved,
        wall_deviation: closed.deviation,
        counters,
    })
}

/// Fills the closed container until it is full, which is returned, or until there are `limit` bodies.
fn fill_up(filling: &mut Filling, limit: usize, observer: &mut dyn Observer) -> Result<bool, Error> {
    let mut full = false;
    for among in turns(filling) {
        filling.among = among;
        full = match filling.params.fill.method {
            FillMethod::Stack => {
                let full = stack::run(filling, limit, observer)?;
                // What lies in disorder leaves room for what is thrown in.
                if filling.params.fill.lying() < 1.0 { insert::run(filling, limit, observer)? } else { full }
            }
            _ => insert::run(filling, limit, observer)?,
        };
    }
    Ok(full)
}

/// Props smaller than this share of the largest fill its gaps.
const SMALL: f64 = 0.5;

/// Which props come first, and which then: where small ones are to fill the gaps of large ones, those come last.
fn turns(filling: &Filling) -> Vec<Vec<usize>> {
    let diameter = |i: usize| filling.shapes[i].size.diameter * filling.scene.props[i].scale[1];
    let drawn = || (0..filling.scene.props.len()).filter(|&i| filling.scene.props[i].weight > 0.0);
    let largest = drawn().map(diameter).fold(0.0, f64::max);
    let (small, large): (Vec<_>, Vec<_>) = drawn().partition(|&i| diameter(i) < SMALL * largest);
    if filling.params.fill.gaps && !small.is_empty() { vec![large, small] } else { vec![drawn().collect()] }
}

/// Where each of several props goes, if that is asked for.
fn mixture(filling: &mut Filling) -> Option<Mixture> {
    let (scene, fill, container) = (filling.scene, &filling.params.fill, filling.container);
    if fill.mixture.layout == Layout::Mixed {
        return None;
    }
    let heights = [container.base, container.high.y];
    let inside = filling.inside();
    Mixture::new(scene, filling.shapes, &fill.mixture, &inside, heights, filling.expected, &mut filling.rng)
}

/// The walls, and those around them for what stands out.
fn add_walls(world: &mut World, closed: &Walls, around: Option<&Walls>) -> Result<Vec<WallId>, Error> {
    let walls = world.add_container(&closed.mesh, 0.0).map_err(Error::Internal)?;
    let around =
        around.map(|around| world.add_walls_around(&around.mesh, walls).map_err(Error::Internal)).transpose()?;
    Ok([Some(walls), around].into_iter().flatten().collect())
}

/// The core, where there is one.
fn add_core(world: &mut World, container: &Container) -> Result<Option<WallId>, Error> {
    container.core.as_ref().map(|mesh| world.add_container(mesh, 0.0)).transpose().map_err(Error::Internal)
}

/// Pours the props through the opening and leaves them as they fell, upside down: no settling, no clean-up.
pub(crate) fn pour_only(
    scene: &Scene,
    shapes: &[Shape],
    params: &Params,
    units: Units,
    container: &Container,
    observer: &mut dyn Observer,
) -> Result<Vec<Instance>, Error> {
    let mut filling = Filling::new(scene, shapes, params, units, container);
    filling.shown = None;
    pour::run(&mut filling, observer)?;
    Ok(filling.world.present().map(|id| filling.placed(id)).collect())
}
