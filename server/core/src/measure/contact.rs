//! Figures of contacts and of motion, from plain lists: no engine's types.

use super::extent::percentile;
use glam::DVec3;
use serde::Serialize;

/// Gap up to which a contact carries, relative to d (the definition of `hanging`).
pub const CARRYING_GAP: f64 = 1.0 / 200.0;
/// A contact points upward if its normal rises by more than this: walls are vertical only up to f32's rounding and
/// the engine's tolerances. It is a slope of 0.6 degrees, on which no friction holds anything.
const UPWARD: f64 = 0.01;

/// One side of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Index of a body.
    Body(usize),
    /// The ground or scenery.
    Fixed,
}

/// A place where two things touch, or nearly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    pub a: Side,
    pub b: Side,
    /// Unit, pointing from `b` into `a`: the direction in which `b` pushes `a`.
    pub normal: DVec3,
    /// Metres; negative where they overlap.
    pub gap: f64,
}

/// The bodies at rest that no chain of upward contacts joins to the ground or scenery: they hang in the air. Chains
/// may pass through bodies that are not at rest. `at_rest` has one entry per body; `diameter` is d, metres.
pub fn hanging(at_rest: &[bool], contacts: &[Contact], diameter: f64) -> Vec<usize> {
    // carried[i]: the bodies that rest on body i; `supported` grows from the ground upward.
    let mut carried = vec![Vec::new(); at_rest.len()];
    let mut supported = vec![false; at_rest.len()];
    let mut front = Vec::new();
    for contact in contacts.iter().filter(|c| c.gap <= diameter * CARRYING_GAP) {
        let (above, below) = match contact.normal.y {
            y if y > UPWARD => (contact.a, contact.b),
            y if y < -UPWARD => (contact.b, contact.a),
            _ => continue,
        };
        match (above, below) {
            (Side::Body(above), Side::Body(below)) => carried[below].push(above),
            (Side::Body(above), Side::Fixed) if !supported[above] => {
                supported[above] = true;
                front.push(above);
            }
            _ => {}
        }
    }
    while let Some(below) = front.pop() {
        for &above in &carried[below] {
            if !supported[above] {
                supported[above] = true;
                front.push(above);
            }
        }
    }
    (0..at_rest.len()).filter(|&i| at_rest[i] && !supported[i]).collect()
}

/// How deep a touching pair overlaps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Metres, recomputed from the final poses; a gap is negative and counts as 0.
    pub depth: f64,
    /// Smallest extent of the thinner of the two, metres.
    pub thickness: f64,
}

/// `penetration_max_rel` and `penetration_mean_rel`: depth over thickness.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Penetration {
    pub max_rel: f64,
    pub mean_rel: f64,
    /// Touching pairs that the mean is over.
    pub pairs: usize,
}

/// Over the touching pairs; all zero without any.
pub fn penetration(overlaps: &[Overlap]) -> Penetration {
    let relative = || overlaps.iter().map(|o| (o.depth / o.thickness).max(0.0));
    Penetration {
        max_rel: relative().fold(0.0, f64::max),
        mean_rel: relative().sum::<f64>() / overlaps.len().max(1) as f64,
        pairs: overlaps.len(),
    }
}

/// `drift_p95_rel`: 95th percentile of the displacement of the bodies' centres of mass (shape `[body]`, metres)
/// between the start and the end of the hold, in d.
pub fn drift_p95_rel(start: &[DVec3], end: &[DVec3], diameter: f64) -> f64 {
    assert_eq!(start.len(), end.len());
    let moved: Vec<f64> = start.iter().zip(end).map(|(a, b)| a.distance(*b) / diameter).collect();
    percentile(&moved, 0.95)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(a: usize, b: Side, up: f64, gap: f64) -> Contact {
        let normal = DVec3::new((1.0 - up * up).sqrt(), up, 0.0);
        Contact { a: Side::Body(a), b, normal, gap }
    }

    #[test]
    fn chains_of_upward_contacts_support() {
        let contacts = [
            touch(0, Side::Fixed, 1.0, 0.0),
            touch(1, Side::Body(0), 0.7, 0.004),
            // The same, seen from below: body 1 carries body 2.
            touch(1, Side::Body(2), -0.7, -0.01),
            // Too far, only beside, and hanging from above.
            touch(3, Side::Body(0), 1.0, 0.006),
            touch(4, Side::Body(0), 0.001, 0.0),
            touch(5, Side::Fixed, -1.0, 0.0),
            // Two that carry each other, and nothing else.
            touch(6, Side::Body(7), 0.5, 0.0),
            touch(7, Side::Body(6), 0.5, 0.0),
        ];
        assert_eq!(hanging(&[true; 8], &contacts, 1.0), [3, 4, 5, 6, 7]);
        let mut at_rest = [true; 8];
        at_rest[0] = false;
        at_rest[5] = false;
        assert_eq!(hanging(&at_rest, &contacts, 1.0), [3, 4, 6, 7]);
        assert_eq!(hanging(&[true], &[], 1.0), [0]);
    }

    #[test]
    fn depths_are_relative_to_the_thinner() {
        let overlaps = [(0.01, 0.1), (-0.5, 0.1), (0.02, 0.1), (0.01, 1.0)];
        let p = penetration(&overlaps.map(|(depth, thickness)| Overlap { depth, thickness }));
        assert!((p.max_rel - 0.2).abs() < 1e-12 && (p.mean_rel - 0.31 / 4.0).abs() < 1e-12 && p.pairs == 4);
        assert_eq!(penetration(&[]), Penetration { max_rel: 0.0, mean_rel: 0.0, pairs: 0 });
    }

    #[test]
    fn drift_is_the_95th_percentile() {
        let start = [DVec3::ZERO; 101];
        let end: Vec<DVec3> = (0..101).map(|k| DVec3::X * k as f64).collect();
        assert!((drift_p95_rel(&start, &end, 2.0) - 47.5).abs() < 1e-12);
        assert_eq!(drift_p95_rel(&[], &[], 1.0), 0.0);
    }
}
