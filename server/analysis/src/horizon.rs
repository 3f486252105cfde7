//! How far a pile stands under a horizontal load, in all directions.
//!
//! The set of horizontal loads under which a pile can stand is convex, since forces add up. So each program, which
//! finds the limit in one direction, says something of all directions: what it stands is a corner of a polygon inside
//! of which the pile stands, and its motion is a line beyond which it cannot. Programs are solved where the two are
//! farthest apart.

use super::{AZIMUTHS, own};
use cairn_statics::limit::Limit;
use glam::{DVec2, DVec3};

/// What is known, as points (x, z).
pub struct Horizon {
    /// It cannot stand farther in this direction, for other reasons. Shape `[azimuth]`.
    pub alone: [f64; AZIMUTHS],
    /// It stands there.
    inner: Vec<DVec2>,
    /// `normal . h > distance`: it cannot stand there.
    lines: Vec<(DVec2, f64)>,
}

impl Horizon {
    /// Nothing is known; larger accelerations than `most` are not sought.
    pub fn new(most: f64) -> Horizon {
        Horizon { alone: [most; AZIMUTHS], inner: Vec::new(), lines: Vec::new() }
    }

    /// Takes in what a program found in a direction. `work`: of the load along any direction, with the limit's motion.
    pub fn learn(&mut self, k: usize, limit: &Limit, work: impl Fn(DVec3) -> f64) {
        let way = planar(own::way(k).0);
        if let Some(stands) = limit.stands_to {
            self.inner.push(stands * way);
        }
        if limit.falls_from.is_finite() {
            let normal = DVec2::new(work(DVec3::X), work(DVec3::Z));
            // As far from the origin as the certificate says, which has its tolerance in it.
            self.lines.push((normal, limit.falls_from * normal.dot(way)));
        }
    }

    /// It stands so far in a direction.
    pub fn stands(&mut self, k: usize, distance: f64) {
        self.inner.push(distance * planar(own::way(k).0));
    }

    /// How far it stands at least, and at most, along a direction.
    pub fn along(&self, k: usize) -> (f64, f64) {
        let way = planar(own::way(k).0);
        let most = self.lines.iter().filter(|(normal, _)| normal.dot(way) > 1e-12);
        let most = most.map(|(normal, distance)| (distance / normal.dot(way)).max(0.0)).fold(self.alone[k], f64::min);
        // The ray leaves the triangles of the origin and two corners at the farthest.
        let mut least: f64 = 0.0;
        for (i, &a) in self.inner.iter().enumerate() {
            for &b in &self.inner[i..] {
                let cross = a.perp_dot(b);
                if cross.abs() < 1e-15 {
                    let along = a.dot(way).max(b.dot(way));
                    if a.perp_dot(way).abs() < 1e-9 * a.length() {
                        least = least.max(along);
                    }
                    continue;
                }
                // way * t = u a + v b with u, v >= 0 and u + v = 1.
                let (u, v) = (way.perp_dot(b) / cross, a.perp_dot(way) / cross);
                if u >= -1e-12 && v >= -1e-12 && u + v > 0.0 {
                    least = least.max(1.0 / (u + v));
                }
            }
        }
        (least.min(most), most)
    }
}

/// The horizontal part of a direction, as (x, z).
fn planar(way: DVec3) -> DVec2 {
    DVec2::new(way.x, way.z)
}
