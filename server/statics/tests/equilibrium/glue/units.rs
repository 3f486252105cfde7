//! The joints depend neither on the units nor on the frame.

use super::piles::random;
use super::{OPTIONS, joints};
use glam::{DQuat, DVec3};

#[test]
fn units_do_not_matter() {
    for seed in 0..8 {
        let pile = random(seed);
        let placed = pile.place(&OPTIONS);
        let by_each = |by: f64| [(by, 1.0, 1.0), (1.0, by, 1.0), (1.0, 1.0, by)];
        // A power of two changes no digit.
        for (length, mass, acceleration) in [1.0 / 1024.0, 1024.0].into_iter().flat_map(by_each) {
            let again = pile.in_units(length, mass, acceleration).place(&OPTIONS);
            assert_eq!(joints(&again), joints(&placed), "pile {seed} in units {length} {mass} {acceleration}");
        }
        for (length, mass, acceleration) in [1e-3, 1e3].into_iter().flat_map(by_each) {
            let what = format!("pile {seed} in units {length} {mass} {acceleration}");
            let other = pile.in_units(length, mass, acceleration);
            let again = other.place(&OPTIONS);
            other.certify(&again, &OPTIONS, &what);
            // Rounding may decide a tie.
            let only_here = joints(&again).iter().filter(|joint| !joints(&placed).contains(joint)).count();
            let only_there = joints(&placed).iter().filter(|joint| !joints(&again).contains(joint)).count();
            println!("{what}: {} joints, {only_here} others, {only_there} missing", again.joints.len());
            assert!(only_here.max(only_there) <= 1, "{what}: {only_here} others, {only_there} missing");
        }
    }
}

/// A turned frame has other tangents: the joints may differ by ties alone.
#[test]
fn gravity_may_point_anywhere() {
    for seed in 0..4 {
        let pile = random(seed);
        let count = pile.place(&OPTIONS).joints.len();
        for q in [DQuat::from_rotation_x(2.0), DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.0)] {
            let turned = pile.turned(q);
            let placed = turned.place(&OPTIONS);
            turned.certify(&placed, &OPTIONS, &format!("pile {seed} turned"));
            assert!(
                placed.joints.len().abs_diff(count) <= 1 + count / 10,
                "{} and {count} joints",
                placed.joints.len()
            );
        }
        let mut leaning = pile;
        leaning.gravity = DVec3::new(3.0, -9.0, 1.0);
        leaning.certify(&leaning.place(&OPTIONS), &OPTIONS, &format!("pile {seed} leaning"));
    }
}
