//! Glue of bounded strength: what it cannot hold has fallen.

use super::piles::{cantilever, random};
use super::{GRAVITY, OPTIONS};
use cairn_statics::glue::GlueOptions;

#[test]
fn stronger_glue_never_drops_more_of_a_cantilever() {
    let count = 8;
    let pile = cantilever(count);
    let weight = pile.bodies[0].mass * GRAVITY.length();
    let mut before = count;
    let mut fallen = Vec::new();
    // A joint's moment counts at the arm; the joint at the wall carries 32 weights at a quarter of the half diagonal:
    // 148 weights.
    for strength in [0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0] {
        let options = GlueOptions { strength: Some(strength * weight), ..OPTIONS };
        let placed = pile.place(&options);
        pile.certify(&placed, &options, &format!("strength {strength}"));
        fallen.push(placed.fallen.len());
        assert!(placed.fallen.len() <= before, "{fallen:?}");
        before = placed.fallen.len();
        // The moment of k cubes is carried by the joint's moment, and by its force at half a cube from the edge that
        // presses.
        let load = |k: usize| (k * k) as f64 / 2.0 / pile.sites[0].arm.hypot(0.5);
        let stand = count - before;
        assert!(
            load(stand) <= strength && (stand + 2 > count || load(stand + 2) + 2.0 > strength),
            "{strength}: {fallen:?}"
        );
        // What stands hangs together: those nearest to the wall.
        assert!(placed.fallen.iter().copied().eq(count - before..count), "{:?}", placed.fallen);
    }
    println!("fallen of a cantilever of {count}: {fallen:?}");
    assert_eq!((fallen[0], before), (count, 0));
    assert!(fallen.iter().any(|f| (1..count).contains(f)), "{fallen:?}");
}

/// However long the arm: glue that is strong enough holds it.
#[test]
fn enough_strength_holds_a_long_cantilever() {
    let pile = cantilever(30);
    let options = GlueOptions { strength: Some(1e6), ..OPTIONS };
    let placed = pile.place(&options);
    pile.certify(&placed, &options, "strong enough");
    assert_eq!((placed.fallen.len(), placed.joints.len()), (0, 30));
}

/// No glue: all that cannot stand has fallen, and the rest needs none.
#[test]
fn without_strength_the_rest_stands_by_itself() {
    let options = GlueOptions { strength: Some(0.0), ..OPTIONS };
    for seed in 0..12 {
        let pile = random(seed);
        let placed = pile.place(&options);
        pile.certify(&placed, &options, &format!("pile {seed}"));
        let joints = placed.joints.len();
        println!("pile {seed}: {} of {} bodies fell", placed.fallen.len(), pile.bodies.len());
        assert_eq!(joints, 0, "pile {seed}");
    }
}

#[test]
fn piles_with_weak_glue() {
    for seed in 0..8 {
        let pile = random(seed);
        let free = pile.place(&OPTIONS);
        let mut before = pile.bodies.len();
        for strength in [1.0, 10.0, 100.0, 1e4] {
            let options = GlueOptions { strength: Some(strength * GRAVITY.length()), ..OPTIONS };
            let placed = pile.place(&options);
            pile.certify(&placed, &options, &format!("pile {seed}, strength {strength}"));
            let (fallen, joints) = (placed.fallen.len(), placed.joints.len());
            println!(
                "pile {seed}, strength {strength}: {fallen} fell, {joints} joints, {} unbounded",
                free.joints.len()
            );
            assert!(fallen <= before + 1, "pile {seed}: {fallen} fell after {before}");
            before = fallen;
        }
        assert_eq!(before, 0, "pile {seed}: no strength is too little");
    }
}
