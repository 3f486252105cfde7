//! The fast solver allocates nothing once its workspace has grown.

// An allocator that counts cannot be had otherwise.
#![allow(unsafe_code)]

#[path = "equilibrium/generator.rs"]
#[allow(dead_code)]
mod generator;

use cairn_statics::local::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: forwards to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|n| n.set(n.get() + 1));
        // SAFETY: the caller's contract is the system's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's contract is the system's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn no_allocation_after_warm_up() {
    let cases: Vec<generator::Case> = (0..2000).map(generator::case).collect();
    let rules = CandidateRules {
        reserve: ReserveRule::Sharp,
        kinetic_ratio: 6.0 / 7.0,
        spread: SpreadRule::Relative { share: 0.1, area: 1.0 },
        contacts: 3,
    };
    for friction_law in [FrictionLaw::Cone, FrictionLaw::PAPER] {
        let options = Options { friction_law, margin: true, ..Options::default() };
        let mut analyser = Analyser::new();
        let last = [glam::DVec3::Y; 64];
        let mut pass = || {
            for case in &cases {
                let p = case.problem();
                assert!(analyser.analyse(&p, &options).is_ok());
                assert!(analyser.analyse_from(&p, &options, &last).is_ok());
                assert!(analyser.candidate(&p, &options, &rules).is_ok());
            }
        };
        pass();
        let before = ALLOCATIONS.with(Cell::get);
        pass();
        assert_eq!(ALLOCATIONS.with(Cell::get) - before, 0, "{friction_law:?}");
    }
}
