//! Distance of a stable body from the limit of stability.
//!
//! **The margin is the largest horizontal push at the centre of mass, in units of mg, that the body survives from each
//! of six azimuths**, at most [`MOST_PUSH`]. Zero: on the edge. 0.2: the ground may shake sideways with 0.2 g, or
//! (nearly) tilt by atan 0.2. The set of pushes that a body survives is convex, so that it survives every azimuth at
//! cos(pi/6) = 0.87 of its margin or more.
//!
//! Why this disturbance:
//! - Friction alone (by what factor may it shrink?) does not see tipping: a block with its centre of mass a hair inside
//!   its support needs no friction at all. A horizontal push sees both: a block of half-width w and centre height h on
//!   friction mu has the margin min(mu, w/h). Engineers know it as the pseudo-static seismic coefficient.
//! - The worst of *all* wrenches is zero for every body on two contacts, and to find it is a concave minimisation over
//!   the facets of W. Six rays cost six to eight verdicts.
//! - It needs no length other than the lever arms, and does not depend on what else the contacts could carry.
//!
//! A ray b + t d leaves the convex cone W at one t. Outside of it the projection's separator z gives a half-space z . x
//! <= 0 that holds W, and the ray leaves that at t' = -(z . b)/(z . d) < t: Newton's method, from above, monotone,
//! finite on a pyramid and quadratic on a cone. The next projection is made a share [`SLACK`] short of t': if its
//! target lies in W, the exit is bracketed, and the push that was survived is the answer. (On the boundary itself a
//! projection onto a cone is slowest.) Each projection starts from the previous one's generators, and each azimuth at
//! the least push so far: most of the six are settled by one projection.

use super::MOST_ITERATIONS;
use super::projection::{Projection, StopRule};
use super::scaled::{ScaledProblem, Vec6, dot, join, norm, split};
use std::f64::consts::FRAC_PI_3;

/// Pushes beyond the body's own weight are not distinguished.
pub const MOST_PUSH: f64 = 1.0;

/// The margin is reported to this share of itself, from below.
pub const SLACK: f64 = 1e-3;

/// A margin smaller than this is reported as zero.
pub const LEAST_PUSH: f64 = 1e-5;

/// The projections only have to distinguish the two sides of the slack.
const ACCURACY: StopRule = StopRule { reached: 1e-6, violation: 1e-5, excluded_force: 1e2 };

/// The largest push of at most `most` that a stable body survives in each of these directions across gravity, from
/// below. Leaves other generators in the projection.
pub(super) fn pushes(scaled: &ScaledProblem, projection: &mut Projection, ways: &[glam::DVec3], most: f64) -> Vec<f64> {
    let b = scaled.target();
    ways.iter().map(|&way| ray(scaled, projection, &b, &join(way, glam::DVec3::ZERO), most)).collect()
}

/// The margin of a stable body. Leaves other generators in the projection.
pub(super) fn of(scaled: &ScaledProblem, projection: &mut Projection) -> f64 {
    let b = scaled.target();
    let (up, _) = split(&b);
    if up.length_squared() == 0.0 {
        return MOST_PUSH;
    }
    let (e1, e2) = up.any_orthonormal_pair();
    let mut least = MOST_PUSH;
    for k in 0..6 {
        let (s, c) = libm::sincos(FRAC_PI_3 * f64::from(k));
        let push = join(c * e1 + s * e2, glam::DVec3::ZERO);
        least = ray(scaled, projection, &b, &push, least);
        if least <= LEAST_PUSH {
            return 0.0;
        }
    }
    least
}

/// A t <= `most` with b + t d in W, and the largest within the slack.
fn ray(scaled: &ScaledProblem, projection: &mut Projection, b: &Vec6, d: &Vec6, most: f64) -> f64 {
    let mut t = most;
    // Newton's steps: two to four are usual. If all do not suffice, the push counts as not survived.
    for _ in 0..MOST_ITERATIONS {
        let target = std::array::from_fn(|k| b[k] + t * d[k]);
        projection.resume(scaled, target, ACCURACY);
        let Some(y) = projection.separator() else { return t };
        if norm(&y) <= ACCURACY.reached {
            return t;
        }
        let exit = -dot(&y, b) / dot(&y, d);
        if exit.is_nan() || exit <= LEAST_PUSH {
            return 0.0;
        }
        t = exit.min(t) * (1.0 - SLACK);
    }
    0.0
}
