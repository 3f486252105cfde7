//! The size of a prop: its bounding sphere and its smallest extent, from the points that its triangles use.

use crate::mesh::{TriMesh, bounds, width};
use crate::{HALVINGS, MOST_ITERATIONS, TOLERANCE};
use glam::DVec3;

/// Points in a cluster: about the square root of a large prop's, so that neither the clusters nor their points are
/// many.
const CLUSTER: usize = 64;
/// Directions on the half sphere in which widths are measured, before the best one is refined.
const DIRECTIONS: usize = 512;
/// Directions on the half sphere in which the outermost points are sought.
const OUTWARD: usize = 64;

/// Centre and radius of the smallest ball around the points that the triangles use; a radius of 0 without any.
///
/// A ball of at most four points is kept; the farthest point joins them, and the smallest ball of those (at most
/// five) takes over, until nothing is outside. Each ball is larger than the last, so this ends, at the exact one.
pub fn bounding_sphere(mesh: &TriMesh) -> (DVec3, f64) {
    let points = used_points(mesh);
    let Some(&first) = points.first() else { return (DVec3::ZERO, 0.0) };
    let mut support = vec![first];
    let mut ball = (first, 0.0);
    for _ in 0..MOST_ITERATIONS {
        let farthest =
            points.iter().copied().max_by(|a, b| ball.0.distance_squared(*a).total_cmp(&ball.0.distance_squared(*b)));
        let Some(p) = farthest.filter(|p| ball.0.distance(*p) > ball.1 * (1.0 + TOLERANCE)) else { break };
        support.push(p);
        (ball, support) = smallest_ball(&support);
    }
    // Covers points that rounding has left outside.
    let radius = points.iter().map(|p| ball.0.distance(*p)).fold(0.0, f64::max);
    (ball.0, radius)
}

/// Points whose hull is nearly that of the mesh: all that its triangles use, if they are few, else the outermost along
/// a fixed set of directions.
pub fn outermost_points(mesh: &TriMesh) -> Vec<DVec3> {
    extreme_points(&used_points(mesh), &spread(OUTWARD))
}

/// Smallest width of the mesh over all directions, metres: of its thinnest oriented slab, so that a stick's is its
/// thickness, however it lies in its frame. Sought along face normals, the axes, and a fixed set of directions
/// whose best is refined; on shapes whose true minimum lies between, it is within about 1 % above.
pub fn smallest_extent(mesh: &TriMesh) -> f64 {
    let points = used_points(mesh);
    if points.is_empty() {
        return 0.0;
    }
    let spread = spread(DIRECTIONS);
    let extremes = extreme_points(&points, &spread);
    let width = |d: DVec3| width(&extremes, d);
    // At most twice as many normals as directions.
    let stride = mesh.triangles.len().div_ceil(2 * DIRECTIONS).max(1);
    let normals = (0..mesh.triangles.len()).step_by(stride).filter_map(|i| {
        let [a, b, c] = mesh.corners(i);
        (b - a).cross(c - a).try_normalize()
    });
    let first = (DVec3::X, f64::INFINITY);
    let mut best = normals.chain(spread.iter().copied()).map(|d| (d, width(d))).fold(first, narrower);
    // After the last halving, a width changes by less than 1e-9 of the size.
    let mut turn = 0.1;
    for _ in 0..HALVINGS {
        let (u, v) = best.0.any_orthonormal_pair();
        let around = (0..8).map(|k| {
            let (sin, cos) = libm::sincos(k as f64 * std::f64::consts::FRAC_PI_4);
            (best.0 + (u * cos + v * sin) * turn).normalize()
        });
        best = around.map(|d| (d, width(d))).fold(best, narrower);
        turn /= 2.0;
    }
    best.1
}

/// The value below which a share of the sorted values lies, between ranks linearly. 0 without values.
pub fn percentile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let rank = share.clamp(0.0, 1.0) * last as f64;
    let low = rank.floor() as usize;
    let high = (low + 1).min(last);
    sorted[low] + (sorted[high] - sorted[low]) * (rank - low as f64)
}

fn narrower(a: (DVec3, f64), b: (DVec3, f64)) -> (DVec3, f64) {
    if b.1 < a.1 { b } else { a }
}

/// The points that triangles use: a file may carry others.
pub(super) fn used_points(mesh: &TriMesh) -> Vec<DVec3> {
    let mut used = vec![false; mesh.points.len()];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    mesh.points.iter().zip(used).filter(|(_, used)| *used).map(|(&p, _)| p).collect()
}

/// Neighbouring points, and a ball around them.
pub(super) struct PointCluster {
    pub centre: DVec3,
    pub radius: f64,
    pub points: Vec<DVec3>,
}

/// The points that triangles use, halved across their longest extent until no group is above [`CLUSTER`].
pub(super) fn clusters(mesh: &TriMesh) -> Vec<PointCluster> {
    let mut done = Vec::new();
    let mut groups = vec![used_points(mesh)];
    while let Some(mut points) = groups.pop() {
        let (lo, hi) = bounds(points.iter().copied());
        if points.len() > CLUSTER {
            let axis = (hi - lo).max_position();
            points.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
            groups.push(points.split_off(points.len() / 2));
            groups.push(points);
        } else if !points.is_empty() {
            let centre = (lo + hi) / 2.0;
            let radius = points.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
            done.push(PointCluster { centre, radius, points });
        }
    }
    done
}

/// All points if they are few, else those that are farthest along one of the directions.
fn extreme_points(points: &[DVec3], directions: &[DVec3]) -> Vec<DVec3> {
    if points.len() <= 2 * directions.len() {
        return points.to_vec();
    }
    let mut extremes = Vec::with_capacity(2 * directions.len());
    for &d in directions {
        let mut ends = [(f64::INFINITY, 0), (f64::NEG_INFINITY, 0)];
        for (i, height) in points.iter().map(|p| p.dot(d)).enumerate() {
            if height < ends[0].0 {
                ends[0] = (height, i);
            }
            if height > ends[1].0 {
                ends[1] = (height, i);
            }
        }
        extremes.extend(ends.map(|e| e.1));
    }
    extremes.sort_unstable();
    extremes.dedup();
    extremes.into_iter().map(|i| points[i]).collect()
}

/// The axes and `n` evenly spread directions on the upper half sphere (Fibonacci's spiral).
fn spread(n: usize) -> Vec<DVec3> {
    let direction = |i: usize| {
        let y = (i as f64 + 0.5) / n as f64;
        let turn = i as f64 * std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let r = (1.0 - y * y).sqrt();
        let (sin, cos) = libm::sincos(turn);
        DVec3::new(r * cos, y, r * sin)
    };
    (0..n).map(direction).chain(DVec3::AXES).collect()
}

/// Smallest ball of up to five points, and those (at most four) that define it.
fn smallest_ball(points: &[DVec3]) -> ((DVec3, f64), Vec<DVec3>) {
    let mut best: Option<((DVec3, f64), Vec<DVec3>)> = None;
    for chosen in 1u32..1 << points.len() {
        if chosen.count_ones() > 4 {
            continue;
        }
        let subset: Vec<DVec3> = (0..points.len()).filter(|i| chosen >> i & 1 == 1).map(|i| points[i]).collect();
        let Some((centre, radius)) = circumsphere(&subset) else { continue };
        let holds = points.iter().all(|p| centre.distance(*p) <= radius * (1.0 + TOLERANCE));
        if holds && best.as_ref().is_none_or(|b| radius < b.0.1) {
            best = Some(((centre, radius), subset));
        }
    }
    best.unwrap_or_else(|| {
        // Only rounding gets here (nearly coincident points): a ball that is good enough.
        let centre = points.iter().sum::<DVec3>() / points.len() as f64;
        let radius = points.iter().map(|p| centre.distance(*p)).fold(0.0, f64::max);
        ((centre, radius), points[..points.len().min(4)].to_vec())
    })
}

/// The smallest ball with all of up to four points on its surface. `None` when they are degenerate.
fn circumsphere(points: &[DVec3]) -> Option<(DVec3, f64)> {
    let origin = points[0];
    let edges: Vec<DVec3> = points[1..].iter().map(|&p| p - origin).collect();
    let offset = match edges[..] {
        [] => DVec3::ZERO,
        [a] => a / 2.0,
        [a, b] => {
            let n = a.cross(b);
            (n.cross(a) * b.length_squared() + b.cross(n) * a.length_squared()) / (2.0 * n.length_squared())
        }
        [a, b, c] => {
            let (aa, bb, cc) = (a.length_squared(), b.length_squared(), c.length_squared());
            (b.cross(c) * aa + c.cross(a) * bb + a.cross(b) * cc) / (2.0 * a.dot(b.cross(c)))
        }
        _ => unreachable!("a ball is defined by at most four points"),
    };
    offset.is_finite().then(|| (origin + offset, offset.length()))
}
