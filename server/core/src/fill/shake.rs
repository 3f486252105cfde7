//! Shaking: gravity leans to one side after the other, so that wedged props find a lower place.

use super::filling::Filling;
use super::{Shaken, pockets};
use cairn_engine::world::BodyId;
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use glam::DVec3;

/// Gravity leans to a side for this long, characteristic times.
const SWING: f64 = 0.5;
/// Tangent of the angle by which it leans.
const LEAN: f64 = 0.35;
/// After it, the pile settles this long.
const SETTLE: f64 = 1.0;
/// The shape suffers where pockets grow by more than this share of the volume.
const WORSE: f64 = 0.005;
/// Directions, one after the other, X and Z.
const LEANS: [[f64; 2]; 4] = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];

/// Shakes the filled container for `fill.shake`. Where the shape is worse for it, the pile lies as before.
pub fn run(filling: &mut Filling, observer: &mut dyn Observer) -> Result<Shaken, Error> {
    let (first, time) = (filling.world.steps(), filling.task.params.fill.shake);
    let before: Vec<(BodyId, Pose)> = filling.world.loose().map(|id| (id, filling.world.pose(id))).collect();
    let pockets_before = pockets::fraction(filling);
    let swings = (time / SWING).ceil() as usize;
    for [x, z] in (0..swings).map(|swing| LEANS[swing % LEANS.len()]) {
        filling.point_gravity(DVec3::new(LEAN * x, -1.0, LEAN * z));
        filling.settle(SWING.min(time), observer)?;
    }
    filling.point_gravity(DVec3::NEG_Y);
    filling.settle(SETTLE, observer)?;
    let lost = before.iter().any(|&(id, _)| !filling.world.is_present(id));
    let taken_back = !lost && pockets::fraction(filling) > pockets_before + WORSE;
    if taken_back {
        before.iter().for_each(|(id, pose)| filling.world.put_back(*id, pose));
    }
    Ok(Shaken { steps: filling.world.steps() - first, taken_back })
}
