//! Bodies that lie about around the place of the pile, until they leap into it.

use super::path::Path;
use cairn_engine::world::{BodyId, PairSide, World};
use cairn_geometry::pose::Pose;
use cairn_motion::pile::Pile;
use cairn_prepare::stable_pose::{flattest, upright};
use glam::{DQuat, DVec3};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64Mcg;
use std::f64::consts::{PI, TAU};

/// Room for each body that lies about, in the diameter of the largest one.
const ROOM: f64 = 1.3;
/// They lie nearer to the pile than bodies appear that fly, by this factor.
const NEARER: f64 = 0.2;
/// A body is let down in so many steps at most, until it is this near to what it lies on, in its thickness.
const MOST_STEPS: usize = 100;
const NEAR: f64 = 1e-3;
/// Looks at each flight, for whether it cuts bodies that still lie.
const LOOKS: usize = 64;

/// Where bodies lie: on their flattest sides, in a ring around the middle that begins this far from the pile, each let
/// down onto what is there. Shape `[body]`; those that do not come have no place of their own.
pub fn places(pile: &Pile, ids: &[BodyId], distance: f64, rng: &mut Pcg64Mcg) -> Vec<Pose> {
    let world = &pile.world;
    let mut starts = vec![Pose::IDENTITY; world.bodies().len()];
    let places = ids.iter().map(|&id| (world.pose(id).translation, world.bodies()[id].radius));
    let (mut low, mut high, mut largest) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0f64);
    for (place, radius) in places {
        (low, high, largest) = (low.min(place - radius), high.max(place + radius), largest.max(radius));
    }
    let middle = (low + high) / 2.0;
    let inner = DVec3::new(high.x - middle.x, 0.0, high.z - middle.z).length() + NEARER * distance;
    let area = (ROOM * 2.0 * largest).powi(2);
    let flat: Vec<DQuat> =
        pile.shapes.iter().map(|s| flattest(s).unwrap_or_else(|| upright(s, DVec3::Y)).rotation).collect();
    let mut order: Vec<usize> = (0..ids.len()).collect();
    order.shuffle(rng);
    for (&id, &number) in ids.iter().zip(&order) {
        // As seeds of a sunflower: each turned on by the golden angle, each with the same area.
        let radius = (inner * inner + area * number as f64 / PI).sqrt();
        let (sin, cos) = libm::sincos(TAU * 0.618_033_988_749_895 * (PI * radius * radius / area));
        let place = middle + radius * DVec3::new(cos, 0.0, sin);
        let turn = DQuat::from_rotation_y(TAU * rng.random::<f64>());
        let rotation = (turn * flat[pile.instances[id].prop]).normalize();
        starts[id] = let_down(world, id, &Pose { translation: DVec3::new(place.x, high.y, place.z), rotation }, low.y);
    }
    starts
}

/// The pose where a body that moves straight down first nearly touches the ground or scenery; where there is none, its
/// middle is at this height.
fn let_down(world: &World, id: BodyId, from: &Pose, lowest: f64) -> Pose {
    let body = &world.bodies()[id];
    let (mut pose, bottom) = (*from, lowest - body.radius);
    let (low, high) = (DVec3::new(pose.translation.x, bottom, pose.translation.z), pose.translation);
    let mut below = world.obstacles(id, low - body.radius, high + body.radius);
    below.retain(|obstacle| !matches!(obstacle.side, PairSide::Body(_)));
    let reach = high.y - bottom;
    for _ in 0..MOST_STEPS {
        let gaps = below.iter().filter_map(|obstacle| world.gap_at(id, &pose, obstacle, reach));
        let gap = gaps.fold(f64::INFINITY, f64::min);
        if gap < NEAR * body.thickness {
            return pose;
        }
        pose.translation.y -= gap.min(reach);
        if pose.translation.y < bottom {
            break;
        }
    }
    Pose { translation: DVec3::new(pose.translation.x, lowest + body.radius, pose.translation.z), ..pose }
}

/// By how much flights cut bodies that still lie, in the thickness of the thinner one.
pub fn cut(world: &World, flights: &[(BodyId, &Path, f64)], starts: &[Pose]) -> f64 {
    let mut deepest = 0.0f64;
    for &(id, path, lands) in flights {
        let body = &world.bodies()[id];
        for look in 0..LOOKS {
            let before = path.duration() * (1.0 - look as f64 / LOOKS as f64);
            let pose = path.pose(before);
            for &(other, its_path, its_landing) in flights {
                let (there, start) = (&world.bodies()[other], &starts[other]);
                let lies = its_landing - its_path.duration() > lands - before;
                let far = pose.translation.distance(start.translation) > body.radius + there.radius;
                if other == id || !lies || far {
                    continue;
                }
                let gap = world.gap_between((id, &pose), (other, start), 0.0).unwrap_or(0.0);
                deepest = deepest.max(-gap / body.thickness.min(there.thickness));
            }
        }
    }
    deepest
}
