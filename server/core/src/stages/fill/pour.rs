//! The `pour` fill of the paper: props are dropped, batch by batch, through the opening of the upside-down container
//! (Cho et al. 2007). It leaves voids and cannot reach under overhangs; `insert` does both better.

use super::filling::Filling;
use crate::error::Error;
use crate::geometry::pose::Pose;
use crate::input::observer::Observer;
use crate::world::{BodyId, Claims};
use glam::DVec3;
use rand::RngExt;

/// Height of the collar that props are dropped from, in d.
const COLLAR: f64 = 3.0;
/// Time for a batch to fall in, natural times: three diameters of fall, and room to slide.
const BATCH_TIME: f64 = 4.0;
/// Places tried in the collar for a batch.
const TRIES: usize = 400;
/// The opening is probed at least this deep, in thicknesses of the prop.
const OPENING_DEPTH: f64 = 1.1;
/// Bound on the batches.
const MAX_BATCHES: usize = 400;
/// Batches in a row that add next to nothing before the container counts as full: one may have jammed in the opening.
const BARREN_BATCHES: usize = 3;

/// Drops batches until they stay outside. Returns whether the container is full.
pub fn run(filling: &mut Filling, observer: &mut dyn Observer) -> Result<bool, Error> {
    let fill = filling.params.fill.clone();
    let height = filling.container.high.y - filling.container.base;
    let walls = filling.container.opened(filling.params.base.height * height, COLLAR);
    let walls = filling.world.add_container(&walls.mesh, 0.0).map_err(Error::Internal)?;
    let core = super::add_core(&mut filling.world, filling.container)?;
    let bottom = DVec3::new(0.0, filling.container.base - COLLAR, 0.0);
    let floor = filling.world.add_wall(bottom, DVec3::Y, 0.0);
    let limit = fill.count.unwrap_or(u32::MAX).min(fill.max_bodies) as usize;
    let (mut barren, mut full) = (0, false);
    for _ in 0..MAX_BATCHES {
        let before = inside(filling).len();
        if before >= limit {
            break;
        }
        drop_batch(filling, limit - before)?;
        filling.settle(BATCH_TIME, observer)?;
        let kept = inside(filling);
        let outside: Vec<BodyId> = filling.loose().filter(|id| kept.binary_search(id).is_err()).collect();
        outside.into_iter().for_each(|id| filling.world.remove(id));
        let added = kept.len().saturating_sub(before) as f64;
        barren = if added < (fill.full_below * kept.len() as f64).max(1.0) { barren + 1 } else { 0 };
        if barren == BARREN_BATCHES {
            full = true;
            break;
        }
    }
    filling.world.remove_wall(walls);
    core.into_iter().for_each(|core| filling.world.remove_wall(core));
    filling.world.remove_wall(floor);
    Ok(full)
}

/// Bodies whose centre of mass is above the base; rising.
fn inside(filling: &Filling) -> Vec<BodyId> {
    filling.loose().filter(|&id| filling.world.pose(id).translation.y > filling.container.base).collect()
}

/// Places props in the collar, where nothing is in the way.
fn drop_batch(filling: &mut Filling, most: usize) -> Result<(), Error> {
    filling.world.zero_step();
    let (low, high) = (filling.container.low, filling.container.high);
    let just_inside = 2.0 * filling.params.base.height * (high.y - filling.container.base);
    let (mut placed, mut claims) = (0, Claims::default());
    for _ in 0..TRIES {
        if placed == most {
            break;
        }
        let (prop, scale, rotation) = filling.draw();
        let size = scale / filling.world.units.length;
        let radius = filling.shapes[prop].radius * size;
        let share = DVec3::new(filling.rng.random(), filling.rng.random(), filling.rng.random());
        let at = low + (high - low) * share;
        // So deep that the base itself, which is open, does not count as a wall.
        let depth = just_inside.max(OPENING_DEPTH * filling.shapes[prop].thickness() * size);
        let opening = DVec3::new(at.x, filling.container.base + depth, at.z);
        // The opening's rim is a wall of the collar: keep clear of it as far as the opening allows.
        if filling.container.distance.signed_distance(opening) > -filling.shapes[prop].thickness() * size {
            continue;
        }
        let y = filling.container.base - COLLAR + radius + share.y * (COLLAR - 2.0 * radius).max(0.0);
        let pose = Pose { translation: DVec3::new(at.x, y, at.z), rotation };
        if filling.world.claim(&filling.shapes[prop], scale, &pose, &mut claims) {
            filling.insert(prop, scale, pose)?;
            placed += 1;
        }
    }
    Ok(())
}
