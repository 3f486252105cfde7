//! Few corners whose hull holds a given hull: what is simplified moves outwards, so that the error is a gap and never
//! an overlap.
//!
//! Some corners of the hull are chosen, from the extreme ones on. They span a polytope inside it. Each of its facets
//! moves out to the last corner beyond it, and each of its corners to the nearest place that is beyond all of its moved
//! facets: then every facet of the new polytope is outside, or touches. Large faces of the hull keep their plane, so
//! that what lies flat goes on to lie flat. The corner that stands out most gets another one beside it, until none
//! stands out by more than is allowed, or there are too many.

use super::facets::Facet;
use super::hull::Hull;
use cairn_geometry::SINGLE_ROUNDING;
use glam::DVec3;
use rapier3d::math::Vector;

/// A facet of at least this share of the surface is a face that a body may lie on.
const FACE: f64 = 0.01;
/// Bound on the changes of the planes that a corner is on.
const MOST_CHANGES: usize = 200;
/// A place is on a plane if it is off by less, in diameters.
const SETTLED: f64 = 1e-10;
/// Two unit normals are parallel where the square of what is square to both is less.
const PARALLEL: f64 = 1e-12;
/// A facet is reached if a corner is short of it by less, in diameters: rounding of single precision.
const REACHED: f64 = 2e-7;
/// A corner moves out by at most this many times the distance of the farthest of its facets: beyond, it is a spike.
const SPIKE: f64 = 8.0;

/// Corners are moved out by no more because of rounding, in diameters: sound hulls need a millionth.
const MOST_GROWN: f64 = 0.01;

/// How a hull is simplified, in its diameters.
#[derive(Clone, Copy, Debug)]
pub struct Margin {
    /// Corners stand out by no more, besides the skin, if `most` corners suffice.
    pub tolerance: f64,
    /// All facets are moved out by this; less at sharp corners.
    pub skin: f64,
    /// Most corners.
    pub most: usize,
}

/// A corner of the polytope inside, and its place outside.
struct Outside {
    place: DVec3,
    /// Distance from the hull at most, without the skin.
    gap: f64,
    /// The facet around it whose distance from the hull is largest.
    farthest: usize,
}

/// A facet's plane, moved out to the hull.
struct Plane {
    normal: DVec3,
    /// Of the last corner beyond it.
    height: f64,
    /// That corner.
    beyond: usize,
    /// Its distance from the facet.
    sag: f64,
    /// Share of the surface.
    area: f64,
}

/// Corners, all of whose hull holds the points, which are of a size of about 1. The second value is the most that one
/// stands out, without the skin. `None` where the points have no hull.
pub fn enclosing(points: &[Vector], margin: Margin) -> Option<(Vec<Vector>, f64)> {
    let whole = Hull::new(points)?;
    let all: Vec<DVec3> = whole.points().iter().map(|p| p.as_dvec3()).collect();
    // The first facet is of the largest triangle.
    let widest = whole.facets().first()?.normal.as_dvec3();
    if support(&all, widest).1 + support(&all, -widest).1 <= f64::from(SINGLE_ROUNDING) / 10.0 {
        return None;
    }
    let mut kept = extremes(&all);
    loop {
        let corners: Vec<Vector> = kept.iter().map(|&i| whole.points()[i]).collect();
        let inner = Hull::new(&corners);
        let is_full = kept.len() >= margin.most.min(all.len());
        let Some(inner) = inner else {
            if is_full {
                return None;
            }
            // Flat so far.
            let near = |p: DVec3| kept.iter().map(|&i| all[i].distance_squared(p)).fold(f64::INFINITY, f64::min);
            let next = (0..all.len()).max_by(|&i, &j| near(all[i]).total_cmp(&near(all[j])))?;
            kept.push(next);
            continue;
        };
        let planes = planes(&inner, &all);
        // As long as whole sides are missing, corners need no place.
        let farthest = planes.iter().max_by(|a, b| a.sag.total_cmp(&b.sag))?;
        if farthest.sag > margin.tolerance && !is_full && !kept.contains(&farthest.beyond) {
            kept.push(farthest.beyond);
            continue;
        }
        let outside: Vec<Outside> = (0..inner.points().len()).map(|i| moved_out(&inner, i, &planes, margin)).collect();
        let gap = outside.iter().map(|o| o.gap).fold(0.0, f64::max);
        let mut worst: Vec<&Outside> = outside.iter().filter(|o| o.gap > margin.tolerance).collect();
        worst.sort_by(|a, b| b.gap.total_cmp(&a.gap));
        let next = worst.iter().map(|o| planes[o.farthest].beyond).find(|i| !kept.contains(i));
        match next.filter(|_| !is_full) {
            Some(next) => kept.push(next),
            None => {
                let (corners, grown) = holding(outside.iter().map(|o| o.place).collect(), &all)?;
                if grown <= MOST_GROWN {
                    return Some((corners, gap + grown));
                }
                // So thin that rounding turns its facets: its own corners, as they are.
                return (all.len() <= margin.most).then(|| (whole.points().to_vec(), 0.0));
            }
        }
    }
}

/// The outermost corners along the axes.
fn extremes(all: &[DVec3]) -> Vec<usize> {
    let extreme = |direction: DVec3| support(all, direction).0;
    let mut kept: Vec<usize> = DVec3::AXES.iter().flat_map(|&a| [extreme(a), extreme(-a)]).collect();
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// The last corner in a direction, and its height.
fn support(all: &[DVec3], direction: DVec3) -> (usize, f64) {
    let heights = all.iter().map(|p| p.dot(direction)).enumerate();
    heights.fold((0, f64::NEG_INFINITY), |best, (i, height)| if height > best.1 { (i, height) } else { best })
}

/// The planes of a polytope's facets.
fn planes(inner: &Hull, all: &[DVec3]) -> Vec<Plane> {
    let of = |facet: &Facet| {
        let at = |i: u32| inner.points()[i as usize].as_dvec3();
        let first = at(facet.corners[0]);
        let sides = facet.corners[1..].windows(2).map(|w| (at(w[0]) - first).cross(at(w[1]) - first));
        let area = sides.sum::<DVec3>();
        let normal = area.try_normalize().unwrap_or_else(|| facet.normal.as_dvec3().normalize());
        let (beyond, height) = support(all, normal);
        let own = facet.corners.iter().map(|&i| at(i).dot(normal)).fold(f64::INFINITY, f64::min);
        Plane { normal, height, beyond, sag: (height - own).max(0.0), area: area.length() / 2.0 }
    };
    let mut planes: Vec<Plane> = inner.facets().iter().map(of).collect();
    let surface: f64 = planes.iter().map(|p| p.area).sum();
    planes.iter_mut().for_each(|p| p.area /= surface);
    planes
}

/// The place of corner `i` beyond all of its facets.
fn moved_out(inner: &Hull, i: usize, planes: &[Plane], margin: Margin) -> Outside {
    let start = inner.points()[i].as_dvec3();
    let mut around: Vec<usize> =
        (0..planes.len()).filter(|&k| inner.facets()[k].corners.contains(&(i as u32))).collect();
    let farthest = around.iter().copied().max_by(|&a, &b| planes[a].sag.total_cmp(&planes[b].sag)).unwrap_or(0);
    // Faces of the hull itself, the largest first.
    around.sort_by(|&a, &b| planes[b].area.total_cmp(&planes[a].area));
    let is_face = |k: usize| planes[k].area >= FACE && planes[k].sag <= f64::from(SINGLE_ROUNDING);
    let faces = around.iter().take(3).take_while(|&&k| is_face(k)).count();
    let place = |skin: f64| {
        let short = |place: DVec3, k: usize| planes[k].height + skin - place.dot(planes[k].normal);
        let limit = SPIKE * (planes[farthest].sag + skin) + REACHED;
        let found = (0..=faces).rev().find_map(|on| {
            let place = beyond(start, &around, short, on, planes)?;
            let is_beyond = around.iter().all(|&k| short(place, k) <= REACHED);
            (is_beyond && place.distance(start) <= limit).then_some(place)
        });
        found.unwrap_or_else(|| {
            // Along the middle of its facets, as far as it takes.
            let middle = around.iter().map(|&k| planes[k].normal).sum::<DVec3>().normalize_or(DVec3::Y);
            let far = |&k: &usize| short(start, k).max(0.0) / planes[k].normal.dot(middle).max(1.0 / SPIKE);
            start + middle * around.iter().map(far).fold(0.0, f64::max)
        })
    };
    // The corner is one of the hull's: no place is farther from that than from the corner.
    let gap = |place: DVec3| place.distance(start);
    // At a sharp corner the skin is thinner: it would be a spike.
    let bare = place(0.0);
    let most = gap(bare) + 2.0 * margin.skin;
    let skins = [1.0, 0.5, 0.25].map(|share| place(share * margin.skin));
    let place = skins.into_iter().find(|&place| gap(place) <= most).unwrap_or(bare);
    Outside { place, gap: (gap(place) - margin.skin).max(0.0), farthest }
}

/// The place nearest to `start` that is beyond all of these planes, and on those of the first few (the dual method of
/// Goldfarb & Idnani 1983, with at most three planes at a time). `None` where there is none.
fn beyond(
    start: DVec3,
    around: &[usize],
    short: impl Fn(DVec3, usize) -> f64,
    faces: usize,
    planes: &[Plane],
) -> Option<DVec3> {
    let mut place = start;
    // Planes that the place is on, with the sign of their normal, and how hard they push.
    let mut on: Vec<(usize, DVec3, f64)> = Vec::new();
    for _ in 0..MOST_CHANGES {
        let lacks = |&n: &usize| if n < faces { short(place, around[n]).abs() } else { short(place, around[n]) };
        let free = (0..around.len()).filter(|n| on.iter().all(|(active, ..)| active != n));
        let next =
            free.map(|n| (n, lacks(&n))).filter(|(n, lack)| *lack > if *n < faces { SETTLED } else { REACHED / 2.0 });
        // The faces first.
        let Some((next, _)) = next.max_by(|a, b| (a.0 < faces).cmp(&(b.0 < faces)).then(a.1.total_cmp(&b.1))) else {
            return Some(place);
        };
        let sign = if short(place, around[next]) < 0.0 { -1.0 } else { 1.0 };
        let normal = planes[around[next]].normal * sign;
        let mut push = 0.0;
        loop {
            let (along, shares) = split(normal, &on);
            let slack = short(place, around[next]) * sign;
            let step = if along.length_squared() > PARALLEL { slack / along.dot(normal) } else { f64::INFINITY };
            let leaves =
                (0..on.len()).filter(|&k| on[k].0 >= faces && shares[k] > 0.0).map(|k| (k, on[k].2 / shares[k]));
            let leaves = leaves.min_by(|a, b| a.1.total_cmp(&b.1));
            let (taken, leaving) = match leaves {
                Some((k, bound)) if bound < step => (bound, Some(k)),
                _ if step.is_infinite() => return None,
                _ => (step, None),
            };
            if step.is_finite() {
                place += along * taken;
            }
            on.iter_mut().zip(shares).for_each(|(plane, share)| plane.2 -= taken * share);
            push += taken;
            match leaving {
                Some(k) => drop(on.remove(k)),
                None => break,
            }
        }
        on.push((next, normal, push));
    }
    None
}

/// The part of a normal that is square to the planes, and the shares of theirs in the rest.
fn split(normal: DVec3, on: &[(usize, DVec3, f64)]) -> (DVec3, [f64; 3]) {
    match *on {
        [(_, a, _)] => (normal - a * normal.dot(a), [normal.dot(a), 0.0, 0.0]),
        [(_, a, _), (_, b, _)] => {
            let axis = a.cross(b);
            let square = axis.length_squared();
            let shares = [normal.cross(b).dot(axis) / square, a.cross(normal).dot(axis) / square, 0.0];
            (axis * (normal.dot(axis) / square), shares)
        }
        [(_, a, _), (_, b, _), (_, c, _), ..] => {
            let whole = a.dot(b.cross(c));
            (
                DVec3::ZERO,
                [normal.dot(b.cross(c)) / whole, a.dot(normal.cross(c)) / whole, a.dot(b.cross(normal)) / whole],
            )
        }
        [] => (normal, [0.0; 3]),
    }
}

/// The corners, or, where rounding or a spike cut short let some of the hull out, these about its middle, larger by as
/// much as it takes; and by how far that moves one.
fn holding(places: Vec<DVec3>, all: &[DVec3]) -> Option<(Vec<Vector>, f64)> {
    let middle = all.iter().sum::<DVec3>() / all.len() as f64;
    let near: Vec<Vector> = places.iter().map(|p| p.as_vec3()).collect();
    let hull = Hull::new(&near)?;
    let planes = planes(&hull, all);
    let factor = planes.iter().zip(hull.facets()).map(|(plane, facet)| {
        let own = hull.points()[facet.corners[0] as usize].as_dvec3();
        let reach = (own - middle).dot(plane.normal);
        let wanted = plane.height - middle.dot(plane.normal);
        if wanted > reach && reach > 0.0 { wanted / reach } else { 1.0 }
    });
    let factor = factor.fold(1.0, f64::max);
    let away = |p: &Vector| p.as_dvec3() - middle;
    let farthest = hull.points().iter().map(|p| away(p).length()).fold(0.0, f64::max);
    let corners = hull.points().iter().map(|p| (middle + away(p) * factor).as_vec3()).collect();
    Some((corners, (factor - 1.0) * farthest))
}

#[cfg(test)]
#[path = "../../../testing/box_part.rs"]
mod box_part;

#[cfg(test)]
mod tests {
    use super::box_part::BOX_PART;
    use super::*;

    /// Points on an ellipsoid, on a rounded slice, and the corners of a prism.
    fn clouds() -> Vec<Vec<Vector>> {
        let mut turn = 0.0f32;
        let mut next = || {
            turn += 2.399_963;
            turn
        };
        let egg = (0..600).map(|k| {
            let z = 1.0 - (k as f32 + 0.5) / 300.0;
            let (sin, cos) = next().sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vector::new(0.3 * r * cos, 0.3 * r * sin, 0.5 * z)
        });
        let slice = (0..64).flat_map(|k| {
            let (sin, cos) = (k as f32 / 64.0 * std::f32::consts::TAU).sin_cos();
            let r = 0.4 / (sin.powi(4) + cos.powi(4)).powf(0.25);
            [(-0.05, 0.97), (-0.03, 1.0), (0.03, 1.0), (0.05, 0.97)]
                .map(|(z, f)| Vector::new(r * cos * f, r * sin * f, z))
        });
        let prism = (0..6).flat_map(|k| {
            let (sin, cos) = (k as f32 / 6.0 * std::f32::consts::TAU).sin_cos();
            [-0.3, 0.3].map(|z| Vector::new(0.3 * cos, 0.3 * sin, z))
        });
        vec![egg.collect(), slice.collect(), prism.collect()]
    }

    #[test]
    fn the_hull_holds_all_points_with_few_corners() {
        for (cloud, points) in clouds().iter().enumerate() {
            for (tolerance, skin) in [(0.02, 0.0), (0.01, 0.002), (0.004, 0.001)] {
                let (corners, gap) = enclosing(points, Margin { tolerance, skin, most: 96 }).expect("it has a volume");
                assert!(corners.len() <= 96);
                let hull = Hull::new(&corners).expect("it has a volume");
                for plane in hull.facets() {
                    let height = hull.points()[plane.corners[0] as usize].dot(plane.normal);
                    let beyond = points.iter().map(|p| p.dot(plane.normal) - height).fold(f32::NEG_INFINITY, f32::max);
                    assert!(beyond <= 1e-6, "cloud {cloud}, {tolerance}: {beyond} outside");
                }
                // With so many corners, smooth clouds 1 long are no finer than this.
                let is_full = corners.len() > 90 && gap < 0.016;
                assert!(gap <= tolerance * 1.001 || is_full, "cloud {cloud}, {tolerance}: {gap}, {}", corners.len());
            }
        }
    }

    #[test]
    fn corners_that_are_nearly_on_a_line_lead_to_no_spike() {
        let points = BOX_PART.map(Vector::from_array);
        for skin in [0.0, 0.0015] {
            let (corners, gap) = enclosing(&points, Margin { tolerance: 0.0, skin, most: 40 }).unwrap();
            let far = |c: &Vector| points.iter().map(|p| p.distance(*c)).fold(f32::INFINITY, f32::min);
            let farthest = corners.iter().map(far).fold(0.0, f32::max);
            assert!(gap < 0.005 && farthest < 0.005, "skin {skin}: {gap}, {farthest}");
        }
    }

    #[test]
    fn faces_stay_flat_and_corners_stay_where_they_are() {
        let clouds = clouds();
        let (corners, gap) = enclosing(&clouds[2], Margin { tolerance: 0.01, skin: 0.0, most: 48 }).unwrap();
        assert!(gap < 1e-6 && corners.len() == 12);
        assert!(corners.iter().all(|c| clouds[2].iter().any(|p| p.distance(*c) < 1e-6)));
        let (corners, _) = enclosing(&clouds[1], Margin { tolerance: 0.01, skin: 0.002, most: 48 }).unwrap();
        let top = corners.iter().map(|p| p.z).fold(0.0, f32::max);
        assert!((top - 0.052).abs() < 1e-5, "{top}");
        assert!(corners.iter().filter(|p| (p.z - top).abs() < 1e-5).count() >= 8);
    }

    #[test]
    fn points_without_a_volume_have_none() {
        let flat: Vec<Vector> = (0..9).map(|k| Vector::new((k % 3) as f32, (k / 3) as f32, 0.0)).collect();
        assert!(enclosing(&flat, Margin { tolerance: 0.01, skin: 0.0, most: 48 }).is_none());
        assert!(enclosing(&[], Margin { tolerance: 0.01, skin: 0.0, most: 48 }).is_none());
    }
}
