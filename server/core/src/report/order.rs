//! How tidily the bodies lie.

use super::inputs::Figures;
use crate::geometry::pose::Pose;
use crate::geometry::rectangle::{convex_hull, smallest_rectangle};
use crate::prepare::shape::{Shape, corners};
use crate::sim::whole::REAL_CONTACT;
use crate::world::{BodyId, PairSide, World};
use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;

/// A body lies flat if it is tilted by no more than about this, rad; two are aligned up to it.
const STRAIGHT: f64 = 0.18;
/// A body whose outline fills less than this of the rectangle around it has no direction: it is round.
const ANGULAR: f64 = 0.85;
/// Contacts whose normals point upward more than this carry.
const UPWARD: f64 = 0.5;

/// `flat_share`: bodies that are hardly higher than their thickness. `aligned_share`: of the pairs that touch and are not round, those
/// turned alike, or by quarter turns. `bonded_share`: of the bodies that lie on others, those that lie on two or more.
pub fn figures(world: &World, shapes: &[Shape]) -> Figures {
    let length = world.units.length;
    let bodies: Vec<BodyId> = world.present().collect();
    let flat = |&&id: &&BodyId| {
        let body = &world.bodies()[id];
        let (shape, size) = (&shapes[body.prop], body.scale / length);
        let heights = || corners(shape, size, &world.pose(id)).map(|p| p.y).collect::<Vec<_>>();
        let (low, high) = heights().iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| (a.min(*y), b.max(*y)));
        high - low <= body.thickness + STRAIGHT * shape.size.extents.z * size
    };
    let directions: BTreeMap<BodyId, f64> = bodies
        .iter()
        .filter_map(|&id| {
            let body = &world.bodies()[id];
            Some((id, direction(&shapes[body.prop], body.scale / length, &world.pose(id))?))
        })
        .collect();
    let (mut pairs, mut aligned) = (0, 0);
    let mut below: BTreeMap<BodyId, BTreeSet<PairSide>> = BTreeMap::new();
    for touch in world.contact_pairs(REAL_CONTACT) {
        if let PairSide::Body(b) = touch.b
            && let (Some(one), Some(other)) = (directions.get(&touch.a), directions.get(&b))
        {
            let apart = (one - other).rem_euclid(FRAC_PI_2);
            pairs += 1;
            aligned += usize::from(apart.min(FRAC_PI_2 - apart) <= STRAIGHT);
        }
        let up = touch.points.iter().map(|p| p.normal.y).sum::<f64>() / touch.points.len().max(1) as f64;
        match touch.b {
            PairSide::Body(b) if up < -UPWARD => below.entry(b).or_default().insert(PairSide::Body(touch.a)),
            side if up > UPWARD => below.entry(touch.a).or_default().insert(side),
            _ => false,
        };
    }
    let on_others = || below.values().filter(|below| below.iter().all(|side| matches!(side, PairSide::Body(_))));
    let share = |some: usize, all: usize| (all > 0).then(|| some as f64 / all as f64);
    BTreeMap::from([
        ("flat_share", share(bodies.iter().filter(flat).count(), bodies.len())),
        ("aligned_share", share(aligned, pairs)),
        ("bonded_share", share(on_others().filter(|below| below.len() > 1).count(), on_others().count())),
    ])
}

/// The turn of a body's outline seen from above, to quarter turns; `None` where it is round.
fn direction(shape: &Shape, size: f64, pose: &Pose) -> Option<f64> {
    let points: Vec<DVec2> = corners(shape, size, pose).map(|p| DVec2::new(p.x, p.z)).collect();
    let (turn, edges) = smallest_rectangle(&points);
    let hull = convex_hull(&points);
    let area: f64 = (0..hull.len()).map(|i| hull[i].perp_dot(hull[(i + 1) % hull.len()])).sum::<f64>().abs() / 2.0;
    (area >= ANGULAR * edges.x * edges.y).then_some(turn)
}
