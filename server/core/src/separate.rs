//! Separate: at the end, bodies whose visible meshes cut each other are moved apart until none do.
//!
//! Collision shapes hold the meshes, so that little is left to do: what the engine lets overlap beyond the skin around
//! the shapes, and what the parts of a nonconvex prop leave out. Bodies are translated, never turned. That nothing cuts
//! is then proved on the poses as files have them, in single precision, by exact predicates
//! ([`cairn_geometry::crossing`]).

use cairn_geometry::crossing::Surface;
use cairn_geometry::measure::Neighbourhood;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Observer;
use cairn_input::params::Params;
use cairn_motion::pile::Pile;
use glam::{DAffine3, DQuat, DVec3};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Meshes are left this far apart, in thicknesses of the thinner one: more than files round.
const CLEARANCE: f64 = 1e-4;
/// No body is moved farther, in its thicknesses. Overlaps add up from layer to layer.
const FARTHEST: f64 = 0.25;
/// Bound on the rounds; each moves apart every pair that still cuts.
const MOST_ROUNDS: usize = 400;
/// After so many rounds, the pile is spread: what one pair needs goes through all bodies above it too slowly.
const ROUNDS_UNTIL_SPREAD: usize = 20;
/// How far the bodies are spread the first time, as a share of their distances from the pile's foot, and by how much
/// more each further time.
const SPREAD: f64 = 1e-4;
const SPREAD_GROWS: f64 = 1.6;
/// After so many rounds in which no fewer pairs cut, nothing more is tried.
const ROUNDS_WITHOUT_GAIN: usize = 3 * ROUNDS_UNTIL_SPREAD;
/// A pair is moved apart by so much more than it overlaps: what is below others needs fewer rounds.
const OVER_RELAXATION: f64 = 1.5;

/// What was done.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Separation {
    /// Pairs of bodies, and of a body and a piece of scenery, that were held against each other in the end.
    pub pairs: u64,
    /// Of these, pairs whose meshes cut each other: proved by exact predicates.
    pub cut: u64,
    /// Bodies that were moved.
    pub moved: u64,
    /// The farthest that one was moved, in its thicknesses.
    pub farthest: f64,
    /// The pile did not rest before the last frame, and was left as it is.
    pub left: bool,
    /// CPU seconds.
    pub seconds: f64,
}

/// A mesh at its place: a body, or a piece of scenery, which stays.
struct Item {
    prop: usize,
    scale: f64,
    pose: Pose,
    thickness: f64,
    stays: bool,
    shift: DVec3,
    /// How far it may sink: it is no deeper in the ground than before.
    above_ground: f64,
}

impl Item {
    /// As files have it.
    fn map(&self) -> DAffine3 {
        let at = (self.pose.translation + self.shift).as_vec3().as_dvec3();
        let turn = DQuat::from_array(self.pose.rotation.as_quat().to_array().map(f64::from));
        DAffine3::from_scale_rotation_translation(DVec3::splat(self.scale), turn, at)
    }

    /// Moves it as far as it may.
    fn push(&mut self, by: DVec3) {
        let mut shift = self.shift + by;
        shift.y = shift.y.max(-self.above_ground);
        if shift.length() <= FARTHEST * self.thickness {
            self.shift = shift;
        }
    }
}

/// Moves the bodies of the last frame apart, where the pile rests, and adds the frame that shows them so. `ground`: its
/// height, m. `stays`: bodies that are not moved.
pub fn run(
    pile: &mut Pile,
    stays: &BTreeSet<usize>,
    rests: bool,
    params: &Params,
    ground: Option<f64>,
    observer: &mut dyn Observer,
) -> Separation {
    let begin = observer.cpu_seconds();
    let may_add = rests && params.output.frames.is_none_or(|most| pile.recorder.count() < most as usize);
    let scenery = pile.scene.statics.len();
    let (mut items, ids) = items(pile, stays, ground);
    let props = pile.scene.props.iter().map(|prop| &prop.model.mesh);
    let meshes: Vec<&TriMesh> = props.chain(pile.scene.statics.iter().map(|model| &model.model.mesh)).collect();
    let surfaces: Vec<Surface> = meshes.par_iter().map(|mesh| Surface::new(mesh)).collect();
    let pairs = pairs(&items, &surfaces);
    let mut dirty = vec![true; items.len()];
    let between = |items: &[Item], [i, j]: [usize; 2]| items[i].map().inverse() * items[j].map();
    let (foot, mut share) = (foot(&items), SPREAD);
    // The fewest pairs that cut, in which round, and the places then.
    let (mut fewest, mut best_round, mut best) = (usize::MAX, 0, Vec::new());
    for round in 1..=if may_add { MOST_ROUNDS } else { 0 } {
        if round % ROUNDS_UNTIL_SPREAD == 0 && scenery == 0 {
            spread(&mut items, foot, share);
            share *= SPREAD_GROWS;
            dirty.fill(true);
        }
        let crosses = |&[i, j]: &[usize; 2]| {
            let is_new = dirty[i] || dirty[j];
            is_new && surfaces[items[i].prop].crosses(&surfaces[items[j].prop], &between(&items, [i, j]))
        };
        let found: Vec<[usize; 2]> = pairs.par_iter().copied().filter(crosses).collect();
        dirty.fill(false);
        if found.len() < fewest {
            (fewest, best_round) = (found.len(), round);
            best = items.iter().map(|item| item.shift).collect();
        }
        if found.is_empty() || round - best_round > ROUNDS_WITHOUT_GAIN {
            break;
        }
        // Each as those before it have left it.
        for [i, j] in found {
            (dirty[i], dirty[j]) = (true, true);
            let map = between(&items, [i, j]);
            let Some(found) = surfaces[items[i].prop].overlap(&surfaces[items[j].prop], &map) else { continue };
            let unit = items[i].thickness.min(items[j].thickness);
            let far = OVER_RELAXATION * found.depth * items[i].scale + CLEARANCE * unit;
            let way = (items[i].pose.rotation * found.way_out) * far;
            let share = match [items[i].stays, items[j].stays] {
                [true, true] => continue,
                [true, false] => [0.0, 1.0],
                [false, true] => [1.0, 0.0],
                [false, false] => [0.5, 0.5],
            };
            items[i].push(way * -share[0]);
            items[j].push(way * share[1]);
        }
    }
    items.iter_mut().zip(best).for_each(|(item, shift)| item.shift = shift);
    let crosses =
        |&&[i, j]: &&[usize; 2]| surfaces[items[i].prop].crosses(&surfaces[items[j].prop], &between(&items, [i, j]));
    let cut = pairs.par_iter().filter(crosses).count() as u64;
    let moved: Vec<(usize, &Item)> =
        ids.into_iter().zip(&items[scenery..]).filter(|(_, item)| item.shift != DVec3::ZERO).collect();
    let farthest = moved.iter().map(|(_, item)| item.shift.length() / item.thickness).fold(0.0, f64::max);
    let (moved_count, seconds) = (moved.len() as u64, observer.cpu_seconds() - begin);
    let found = Separation { pairs: pairs.len() as u64, cut, moved: moved_count, farthest, left: !may_add, seconds };
    if !moved.is_empty() {
        let units = pile.world.units;
        let shifts: Vec<(usize, DVec3)> = moved.into_iter().map(|(id, item)| (id, item.shift / units.length)).collect();
        pile.recorder.amend(&shifts);
    }
    found
}

/// The middle of what may move, at the height of its lowest body's centre.
fn foot(items: &[Item]) -> DVec3 {
    let loose = || items.iter().filter(|item| !item.stays).map(|item| item.pose.translation);
    let low = loose().fold(f64::INFINITY, |low, p| low.min(p.y));
    let mean = loose().sum::<DVec3>() / loose().count().max(1) as f64;
    DVec3::new(mean.x, low, mean.z)
}

/// Moves bodies away from the foot by a share of their distances. Of two that touch, the centres move apart in nearly
/// all directions of contact. Not where scenery may be around them.
fn spread(items: &mut [Item], foot: DVec3, share: f64) {
    for item in items.iter_mut().filter(|item| !item.stays) {
        let away = item.pose.translation + item.shift - foot;
        item.push(share * away);
    }
}

/// Scenery, then the bodies that are there, each with its number.
fn items(pile: &Pile, stays: &BTreeSet<usize>, ground: Option<f64>) -> (Vec<Item>, Vec<usize>) {
    let Pile { world, recorder, scene, shapes, instances, .. } = pile;
    let props = scene.props.len();
    let time = recorder.time(world.units);
    let still = |(k, model): (usize, &cairn_input::scene::StaticModel)| Item {
        prop: props + k,
        scale: 1.0,
        pose: model.pose_at(time),
        thickness: f64::INFINITY,
        stays: true,
        shift: DVec3::ZERO,
        above_ground: 0.0,
    };
    let mut items: Vec<Item> = scene.statics.iter().enumerate().map(still).collect();
    let ground = ground.unwrap_or(f64::NEG_INFINITY);
    let ids: Vec<usize> = world.present().collect();
    for &id in &ids {
        let (instance, pose) = (&instances[id], world.units.pose_to_si(&world.pose(id)));
        let shape = &shapes[instance.prop];
        let pose = shape.prop_pose(&pose, instance.scale);
        let points = &scene.props[instance.prop].model.mesh.points;
        let low = points.iter().map(|&p| pose.transform_point(p * instance.scale).y).fold(f64::INFINITY, f64::min);
        items.push(Item {
            prop: instance.prop,
            scale: instance.scale,
            pose,
            thickness: shape.thickness() * instance.scale,
            stays: world.bodies()[id].role == cairn_engine::world::Role::Pinned || stays.contains(&id),
            shift: DVec3::ZERO,
            above_ground: (low - ground).max(0.0),
        });
    }
    (items, ids)
}

/// All pairs that may come to cut each other, the lower index first. Not of scenery alone.
fn pairs(items: &[Item], surfaces: &[Surface]) -> Vec<[usize; 2]> {
    let reach = |item: &Item| if item.stays { 0.0 } else { (FARTHEST + CLEARANCE) * item.thickness };
    let boxes = items.iter().map(|item| {
        let (lo, hi) = surfaces[item.prop].bounds(&item.map());
        (lo - reach(item), hi + reach(item))
    });
    let near = Neighbourhood::new(boxes.collect());
    let of = |i: usize| {
        let near = near.of(i).into_iter().filter(move |&j| j > i);
        near.filter(move |&j| !(items[i].stays && items[j].stays)).map(move |j| [i, j]).collect::<Vec<_>>()
    };
    (0..items.len()).flat_map(of).collect()
}
