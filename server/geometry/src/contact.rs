//! The bodies that each body rests on, from plain lists: no types of the engine.

use glam::DVec3;

/// Bodies this near to each other touch, relative to d: less cannot be seen. A contact carries up to this gap (the
/// definition of `hanging`). The engine leaves overlaps up to this, as its own default for objects of unit size, and
/// moves no body farther from its support without finding contacts again.
pub const CARRYING_GAP: f64 = 1.0 / 200.0;
/// Gap up to which contacts carry, as a share of the thinner body's thickness. The engine finds a contact again once
/// the pair has moved by as much: later, a verdict would read contacts that are gone; sooner, small towers creep.
pub const REAL_CONTACT: f64 = 0.05;
/// A contact points upward if its normal does by more than this: a vertical face is so only up to f32's rounding and
/// the engine's tolerances. It is a slope of 0.6 degrees, on which no friction holds anything.
const UPWARD: f64 = 0.01;

/// One end of a bearing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Index of a body.
    Body(usize),
    /// The ground or scenery.
    Fixed,
}

/// A point where a body may bear on another one, or on something that stands still: they touch, or nearly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bearing {
    pub a: End,
    pub b: End,
    /// Unit, pointing from `b` into `a`: the direction in which `b` pushes `a`.
    pub normal: DVec3,
    /// Metres; negative where they overlap.
    pub gap: f64,
}

/// The bodies at rest that no chain of upward contacts joins to the ground or scenery: they hang in the air. Chains
/// may pass through bodies that are not at rest. `at_rest` has one entry per body; `diameter` is d, metres.
pub fn hanging(at_rest: &[bool], contacts: &[Bearing], diameter: f64) -> Vec<usize> {
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
            (End::Body(above), End::Body(below)) => carried[below].push(above),
            (End::Body(above), End::Fixed) if !supported[above] => {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(a: usize, b: End, up: f64, gap: f64) -> Bearing {
        let normal = DVec3::new((1.0 - up * up).sqrt(), up, 0.0);
        Bearing { a: End::Body(a), b, normal, gap }
    }

    #[test]
    fn chains_of_upward_contacts_support() {
        let contacts = [
            touch(0, End::Fixed, 1.0, 0.0),
            touch(1, End::Body(0), 0.7, 0.004),
            // The same, seen from below: body 1 carries body 2.
            touch(1, End::Body(2), -0.7, -0.01),
            // Too far, only beside, and hanging from above.
            touch(3, End::Body(0), 1.0, 0.006),
            touch(4, End::Body(0), 0.001, 0.0),
            touch(5, End::Fixed, -1.0, 0.0),
            // Two that carry each other, and nothing else.
            touch(6, End::Body(7), 0.5, 0.0),
            touch(7, End::Body(6), 0.5, 0.0),
        ];
        assert_eq!(hanging(&[true; 8], &contacts, 1.0), [3, 4, 5, 6, 7]);
        let mut at_rest = [true; 8];
        at_rest[0] = false;
        at_rest[5] = false;
        assert_eq!(hanging(&at_rest, &contacts, 1.0), [3, 4, 6, 7]);
        assert_eq!(hanging(&[true], &[], 1.0), [0]);
    }
}
