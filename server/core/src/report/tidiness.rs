//! Tidiness of the pile: flat, aligned and bonded bodies.

use super::inputs::NamedFigures;
use cairn_engine::shape::{Shape, corners};
use cairn_engine::world::{BodyId, ContactPair, PairSide, World};
use cairn_geometry::pose::Pose;
use cairn_geometry::rectangle::{convex_hull, smallest_rectangle};
use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;

/// A body lies flat if it is tilted by no more than about this, rad; two are aligned up to it.
const STRAIGHT: f64 = 0.18;
/// A body whose outline from above fills less than this of the rectangle around it is round: it has no direction.
const ANGULAR: f64 = 0.85;
/// A contact pair carries if its normals point upward by more than this.
const UPWARD: f64 = 0.5;

/// `flat_share`: bodies that are hardly higher than their thickness. `aligned_share`: pairs of touching non-round
/// bodies whose headings differ by a multiple of 90 degrees (within [`STRAIGHT`]). `bonded_share`: of the bodies that
/// lie on others, those that lie on two or more.
///
/// `pairs`: the contact pairs up to [`cairn_geometry::contact::REAL_CONTACT`].
pub fn figures(world: &World, shapes: &[Shape], pairs: &[ContactPair]) -> NamedFigures {
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
    let (mut compared, mut aligned) = (0, 0);
    let mut below: BTreeMap<BodyId, BTreeSet<PairSide>> = BTreeMap::new();
    for pair in pairs {
        if let PairSide::Body(b) = pair.b
            && let (Some(one), Some(other)) = (directions.get(&pair.a), directions.get(&b))
        {
            let apart = (one - other).rem_euclid(FRAC_PI_2);
            compared += 1;
            aligned += usize::from(apart.min(FRAC_PI_2 - apart) <= STRAIGHT);
        }
        let up = pair.points.iter().map(|p| p.normal.y).sum::<f64>() / pair.points.len().max(1) as f64;
        match pair.b {
            PairSide::Body(b) if up < -UPWARD => below.entry(b).or_default().insert(PairSide::Body(pair.a)),
            side if up > UPWARD => below.entry(pair.a).or_default().insert(side),
            _ => false,
        };
    }
    let on_others = || below.values().filter(|below| below.iter().all(|side| matches!(side, PairSide::Body(_))));
    let share = |some: usize, all: usize| (all > 0).then(|| some as f64 / all as f64);
    BTreeMap::from([
        ("flat_share", share(bodies.iter().filter(flat).count(), bodies.len())),
        ("aligned_share", share(aligned, compared)),
        ("bonded_share", share(on_others().filter(|below| below.len() > 1).count(), on_others().count())),
    ])
}

/// Heading of a body's outline seen from above, rad, modulo 90 degrees; `None` if the outline is round.
fn direction(shape: &Shape, size: f64, pose: &Pose) -> Option<f64> {
    let points: Vec<DVec2> = corners(shape, size, pose).map(|p| DVec2::new(p.x, p.z)).collect();
    let (turn, edges) = smallest_rectangle(&points);
    let hull = convex_hull(&points);
    let area: f64 = (0..hull.len()).map(|i| hull[i].perp_dot(hull[(i + 1) % hull.len()])).sum::<f64>().abs() / 2.0;
    (area >= ANGULAR * edges.x * edges.y).then_some(turn)
}
