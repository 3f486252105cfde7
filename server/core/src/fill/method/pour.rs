//! The `pour` fill of the paper: props are dropped, batch by batch, through the opening of the upside-down container
//! (Cho et al. 2007). It leaves voids and cannot reach under overhangs, as `insert` can.

use super::{Method, Pass};
use crate::fill::filling::Filling;
use crate::fill::world::EnclosureMeshes;
use cairn_engine::world::{BodyId, ReservedPlaces};
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use cairn_motion::instance::Instance;
use cairn_prepare::container::Container;
use glam::DVec3;
use rand::RngExt;

/// Height of the collar that props are dropped from, in d.
const COLLAR: f64 = 3.0;
/// Time for a batch to fall in, characteristic times: three diameters of fall, and room to slide.
const BATCH_TIME: f64 = 4.0;
/// Places tried in the collar for a batch.
const TRIES: usize = 400;
/// The opening is probed at least this deep, in thicknesses of the prop.
const OPENING_DEPTH: f64 = 1.1;
/// Bound on the batches.
const MAX_BATCHES: usize = 400;
/// Batches in a row that add next to nothing before the container counts as full: one may have jammed in the opening.
const BARREN_BATCHES: usize = 3;

pub struct Pour;

impl Method for Pour {
    fn is_open(&self) -> bool {
        true
    }

    /// Drops batches until they stay outside.
    fn run(&mut self, filling: &mut Filling, pass: &Pass, observer: &mut dyn Observer) -> Result<bool, Error> {
        let (task, container) = (filling.task, filling.task.container);
        let open = container.opened(task.params.base.height * task.height(), COLLAR).mesh;
        let floor = container.base - COLLAR;
        let scenery = container.steep_scenery();
        let core = container.core.as_ref();
        let meshes = EnclosureMeshes { container: &open, outer: None, core, floor, scenery: &scenery };
        let enclosure = filling.world.enclose(0, &meshes)?;
        let (mut barren, mut full) = (0, false);
        for _ in 0..MAX_BATCHES {
            let before = inside(filling).len();
            if before >= pass.limit {
                break;
            }
            drop_batch(filling, pass, pass.limit - before)?;
            filling.settle(BATCH_TIME, observer)?;
            let kept = inside(filling);
            let outside: Vec<BodyId> = filling.world.loose().filter(|id| kept.binary_search(id).is_err()).collect();
            outside.into_iter().for_each(|id| filling.world.remove(id));
            filling.world.validate(pass.limit);
            let added = kept.len().saturating_sub(before) as f64;
            let least = (task.params.fill.full_below * kept.len() as f64).max(1.0);
            barren = if added < least { barren + 1 } else { 0 };
            if barren == BARREN_BATCHES {
                full = true;
                break;
            }
        }
        filling.world.remove_enclosure(enclosure);
        Ok(full)
    }
}

/// Whether scenery, such as a pole, leaves less than this much room above a place.
fn is_barred(container: &Container, place: DVec3, least: f64) -> bool {
    let Some(free) = container.free_along(place) else { return false };
    let room = free.iter().map(|[low, high]| high.min(container.high.y) - low.max(container.base));
    room.fold(f64::NEG_INFINITY, f64::max) < least
}

/// Bodies whose centre of mass is above the base, ascending.
fn inside(filling: &Filling) -> Vec<BodyId> {
    let is_inside = |&id: &BodyId| filling.world.pose(id).translation.y > filling.task.container.base;
    filling.world.loose().filter(is_inside).collect()
}

/// Places props in the collar, where nothing is in the way.
fn drop_batch(filling: &mut Filling, pass: &Pass, most: usize) -> Result<(), Error> {
    filling.world.update_contacts();
    let (task, container) = (filling.task, filling.task.container);
    let (low, high) = (container.low, container.high);
    let just_inside = 2.0 * task.params.base.height * (high.y - container.base);
    let (mut placed, mut reserved) = (0, ReservedPlaces::default());
    for _ in 0..TRIES {
        if placed == most {
            break;
        }
        let (prop, scale, rotation) = filling.draw(pass.props);
        let (shape, size) = (&task.shapes[prop], scale / task.units.length);
        let radius = shape.radius * size;
        let share = DVec3::new(filling.rng.random(), filling.rng.random(), filling.rng.random());
        let at = low + (high - low) * share;
        // So deep that the base itself, which is open, does not count as a side.
        let depth = just_inside.max(OPENING_DEPTH * shape.thickness() * size);
        let opening = DVec3::new(at.x, container.base + depth, at.z);
        // The rim of the opening is a side of the collar: keep clear of it as far as the opening allows.
        if container.shell().signed_distance(opening) > -shape.thickness() * size {
            continue;
        }
        if is_barred(container, opening, shape.thickness() * size) {
            continue;
        }
        let y = container.base - COLLAR + radius + share.y * (COLLAR - 2.0 * radius).max(0.0);
        let pose = Pose { translation: DVec3::new(at.x, y, at.z), rotation };
        if filling.world.reserve(shape, scale, &pose, &mut reserved) {
            filling.insert(Instance { prop, scale, pose })?;
            placed += 1;
        }
    }
    Ok(())
}
