//! Odd input: an answer or an error by name, never a panic.

use super::piles::{cantilever, random};
use super::{OPTIONS, Pile};
use cairn_statics::glue::{GlueError, GlueOptions};
use glam::DVec3;
use std::ops::ControlFlow;

#[test]
fn nothing_needs_nothing() {
    let empty = Pile::new();
    for strength in [None, Some(0.0), Some(1.0)] {
        let options = GlueOptions { strength, ..OPTIONS };
        let placed = empty.place(&options);
        assert!(placed.stands() && placed.joints.is_empty() && placed.fallen.is_empty());
    }
    assert!(empty.place_by_clarabel(&OPTIONS).stands());
    let mut alone = Pile::new();
    alone.body(1.0, DVec3::ZERO, 1.0);
    let placed = alone.place(&OPTIONS);
    assert!(!placed.stands() && (placed.imbalance - 1.0).abs() < 1e-12, "{placed:?}");
    for strength in [Some(0.0), Some(5.0)] {
        let placed = alone.place(&GlueOptions { strength, ..OPTIONS });
        assert!(placed.stands() && placed.fallen == [0], "{placed:?}");
    }
}

/// Numbers at the ends of the range: an error or an answer in numbers.
#[test]
fn extremes_do_not_break_it() {
    for value in [1e-300, 1e-150, 1e-20, 1e20, 1e150, 1e300] {
        for change in [
            |pile: &mut Pile, value: f64| pile.sites[1].center.x = value,
            |pile: &mut Pile, value: f64| pile.sites[1].arm = value,
            |pile: &mut Pile, value: f64| pile.contacts[5].point.y = value,
            |pile: &mut Pile, value: f64| pile.contacts[5].friction = value,
            |pile: &mut Pile, value: f64| pile.bodies[1].mass = value,
            |pile: &mut Pile, value: f64| pile.bodies[1].radius = value,
            |pile: &mut Pile, value: f64| pile.gravity *= value,
        ] {
            let mut pile = cantilever(3);
            change(&mut pile, value);
            for strength in [None, Some(value)] {
                if let Ok(placed) = pile.try_place(&GlueOptions { strength, ..OPTIONS }) {
                    let in_numbers =
                        placed.joints.iter().all(|joint| joint.force.is_finite() && joint.moment.is_finite());
                    assert!(in_numbers && placed.forces.iter().all(|f| f.is_finite()), "{pile:?}");
                    assert!(placed.imbalance.is_finite(), "{pile:?}");
                }
            }
        }
    }
}

#[test]
fn nonsense_is_refused() {
    let good = cantilever(3);
    let refused = |change: &dyn Fn(&mut Pile)| {
        let mut pile = good.clone();
        change(&mut pile);
        pile.try_place(&OPTIONS).map(|placed| placed.joints.len())
    };
    assert_eq!(refused(&|_| ()), Ok(3));
    for arm in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(refused(&|pile| pile.sites[1].arm = arm), Err(GlueError::SiteArm(1)));
    }
    for price in [-1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(refused(&|pile| pile.sites[1].normal_price = price), Err(GlueError::SitePrice(1)));
    }
    assert_eq!(refused(&|pile| pile.sites[1].center.x = f64::NAN), Err(GlueError::SiteCenter(1)));
    assert_eq!(refused(&|pile| pile.sites[1].other = Some(1)), Err(GlueError::SiteBodies(1)));
    assert_eq!(refused(&|pile| pile.sites[1].other = Some(7)), Err(GlueError::SiteBodies(1)));
    assert_eq!(refused(&|pile| pile.sites[2].body = 7), Err(GlueError::SiteBodies(2)));
    assert_eq!(refused(&|pile| pile.sites[2].contacts = 8..99), Err(GlueError::SiteContacts(2)));
    assert_eq!(
        refused(&|pile| pile.sites[2].contacts = std::ops::Range { start: 8, end: 4 }),
        Err(GlueError::SiteContacts(2))
    );
    assert_eq!(refused(&|pile| pile.sites[1].contacts = 3..8), Err(GlueError::SiteContacts(1)));
    // Contacts of another pair, and contacts of no site.
    assert_eq!(refused(&|pile| pile.contacts[5].body = 2), Err(GlueError::SiteContacts(1)));
    assert_eq!(refused(&|pile| pile.sites[2].contacts = 8..11), Err(GlueError::Contact(11)));
    assert!(matches!(refused(&|pile| pile.gravity = DVec3::ZERO), Err(GlueError::Problem(_))));
    assert!(matches!(refused(&|pile| pile.bodies[0].mass = 0.0), Err(GlueError::Problem(_))));
    assert!(matches!(refused(&|pile| pile.contacts[0].friction = -1.0), Err(GlueError::Problem(_))));
}

#[test]
fn options_without_meaning_are_refused() {
    let pile = cantilever(3);
    for bad in [-1.0, f64::NAN] {
        for options in [
            GlueOptions { friction_factor: bad, ..OPTIONS },
            GlueOptions { normal_price: bad, ..OPTIONS },
            GlueOptions { strength: Some(bad), ..OPTIONS },
        ] {
            assert_eq!(pile.try_place(&options), Err(GlueError::Options), "{options:?}");
        }
    }
}

#[test]
fn without_friction_and_without_price() {
    for seed in 0..4 {
        let pile = random(seed);
        for options in [GlueOptions { friction_factor: 0.0, ..OPTIONS }, GlueOptions { normal_price: 0.0, ..OPTIONS }] {
            pile.certify(&pile.place(&options), &options, &format!("pile {seed}, {options:?}"));
        }
        let mut ice = pile;
        ice.contacts.iter_mut().for_each(|c| c.friction = 0.0);
        ice.certify(&ice.place(&OPTIONS), &OPTIONS, &format!("pile {seed} on ice"));
    }
}

/// Every other body is ten thousand times heavier.
#[test]
fn uneven_masses() {
    for seed in 0..8 {
        let mut pile = random(seed);
        pile.bodies.iter_mut().step_by(2).for_each(|b| b.mass *= 1e4);
        pile.certify(&pile.place(&OPTIONS), &OPTIONS, &format!("pile {seed}"));
    }
}

#[test]
fn it_can_be_cancelled_and_repeats_bit_by_bit() {
    for seed in 0..4 {
        let pile = random(seed);
        for strength in [None, Some(20.0)] {
            let options = GlueOptions { strength, ..OPTIONS };
            let placed = pile.place(&options);
            assert_eq!(placed, pile.place(&options), "pile {seed}");
            let bits = |v: &DVec3| v.to_array().map(f64::to_bits);
            assert!(placed.forces.iter().map(bits).eq(pile.place(&options).forces.iter().map(bits)));
        }
        for after in [0, 1, 100] {
            let mut left = after;
            let mut going = || {
                left -= 1;
                if left < 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let cancelled = cairn_statics::glue::place(&pile.problem(), &OPTIONS, &mut going);
            assert_eq!(cancelled, Err(GlueError::Cancelled));
        }
    }
}
