//! Small problems whose answer is known. Each is defined once, for every engine, and has one error in natural units,
//! computed from the poses alone by one formula.
#![allow(dead_code, reason = "the study and the tests use different parts")]

#[path = "../../peers/cpu.rs"]
mod cpu;
pub mod ours;
pub mod page;
pub mod results;
mod scenes;

use super::rows::{edges, piles, places, scenes as hard, stacks};
use cairn_geometry::pose::Pose;
use cairn_input::scene::Scene;
use glam::DVec3;
use std::ops::Range;

/// Frames per second of every motion.
pub const FPS: f64 = 60.0;
pub const GRAVITY: f64 = 9.81;

/// Poses of the bodies' centres of mass, in the props' own axes. Shape `[frame][body]`.
pub type Motion = [Vec<Pose>];

pub struct Problem {
    pub name: &'static str,
    pub title: &'static str,
    /// What is asked, and the answer.
    pub truth: &'static str,
    pub unit: &'static str,
    /// Simulated.
    pub seconds: f64,
    /// Below it, errors are the same: rounding of single precision, and of meshes.
    pub least: f64,
    /// From it on, one sees the error.
    pub seen: f64,
    /// Why `reference` errs more than `draft`, where it does.
    pub fault: Option<&'static str>,
    /// Something stands, so that a bake's control has a say.
    pub stands: bool,
    pub ask: Ask,
}

pub enum Ask {
    /// One scene.
    Error { scene: fn() -> Scene, of: fn(&Motion) -> f64 },
    /// Scenes from one that falls to one that stands, each by a share of the exact limit, per cent. The error is how
    /// far the limit is from the exact one. The middle case takes the time.
    Limit { scene: fn(f64) -> Scene, shares: Range<i32>, falls_low: bool, falls: fn(&Motion) -> bool },
}

/// The case of a limit whose time is measured stands by so many per cent.
const CLEAR: f64 = 10.5;

impl Problem {
    /// The scenes of the problem, with the share of the limit that each is, per cent; 0 where there is none. From the
    /// one that must fall to the one that must stand.
    pub fn shares(&self) -> Vec<f64> {
        match &self.ask {
            Ask::Error { .. } => vec![0.0],
            Ask::Limit { shares, falls_low, .. } => {
                let between = shares.clone().map(|share| f64::from(share) + 0.5);
                if *falls_low { between.collect() } else { between.rev().collect() }
            }
        }
    }

    /// The case whose time counts: of a limit, one that stands clearly.
    pub fn timed(&self) -> usize {
        let clear = |share: &f64| match &self.ask {
            Ask::Error { .. } => true,
            Ask::Limit { falls_low: true, .. } => *share == CLEAR,
            Ask::Limit { falls_low: false, .. } => *share == -CLEAR,
        };
        self.shares().iter().position(clear).expect("a limit has such a case")
    }

    pub fn scene(&self, case: usize) -> Scene {
        match &self.ask {
            Ask::Error { scene, .. } => scene(),
            Ask::Limit { scene, .. } => scene(1.0 + self.shares()[case] / 100.0),
        }
    }

    /// By how much the case stands whose time counts, per cent.
    pub fn clear(&self) -> f64 {
        self.shares()[self.timed()].abs()
    }

    pub fn is_limit(&self) -> bool {
        matches!(self.ask, Ask::Limit { .. })
    }

    pub fn frames(&self) -> u32 {
        (self.seconds * FPS).round() as u32
    }

    /// Of a limit, given the first case that stands; `None`: none does.
    pub fn limit_error(&self, found: Option<usize>) -> f64 {
        let shares = self.shares();
        let at = |case: usize| shares.get(case).copied();
        match found {
            Some(0) => shares[0].abs(),
            Some(case) => ((shares[case] + shares[case - 1]) / 2.0).abs(),
            None => at(shares.len() - 1).expect("there are cases").abs(),
        }
    }
}

pub fn of(name: &str) -> Option<&'static Problem> {
    PROBLEMS.iter().find(|problem| problem.name == name)
}

pub const PROBLEMS: &[Problem] = &[
    Problem {
        name: "slide",
        title: "A block slides down a slope",
        truth: "A low block on a slope of 35 degrees, friction 0.5, slides by g (sin a - mu cos a) / 2 = 0.804 m in 1 \
                s. The error is how far it is from there. The slope climbs across the axes, where pyramids of \
                friction err.",
        unit: "mm",
        seconds: 1.0,
        least: 0.02,
        seen: 10.0,
        fault: None,
        stands: false,
        ask: Ask::Error {
            scene: || edges::on_slope(0.5, SLIDING, AZIMUTH),
            of: |motion| {
                let exact = GRAVITY * (SLIDING.sin() - 0.5 * SLIDING.cos()) / 2.0;
                1e3 * (path(motion, 0) - exact).abs()
            },
        },
    },
    Problem {
        name: "creep",
        title: "A block stays on a slope",
        truth: "The same block, friction 0.7, on a slope that is 2 per cent less steep than the angle of friction, \
                stays where it is. The error is how far it creeps in 5 s.",
        unit: "mm",
        seconds: 5.0,
        least: 0.02,
        seen: 1.0,
        fault: None,
        stands: true,
        ask: Ask::Error {
            scene: || edges::on_slope(0.7, 0.98 * f64::atan(0.7), AZIMUTH),
            of: |motion| 1e3 * path(motion, 0),
        },
    },
    Problem {
        name: "sag",
        title: "A tower does not sink",
        truth: "Ten cubes of 10 cm on top of each other. The error is how far the top one sinks in 5 s.",
        unit: "mm",
        seconds: 5.0,
        least: 0.002,
        seen: 1.0,
        fault: None,
        stands: true,
        ask: Ask::Error {
            scene: || stacks::cubes(0.1),
            of: |motion| 1e3 * (motion[0][9].translation.y - last(motion)[9].translation.y).abs(),
        },
    },
    Problem {
        name: "sway",
        title: "A tower does not sway",
        truth: "The same tower. The error is how far any cube moves sideways in 5 s.",
        unit: "mm",
        seconds: 5.0,
        least: 0.002,
        seen: 1.0,
        fault: None,
        stands: true,
        ask: Ask::Error {
            scene: || stacks::cubes(0.1),
            of: |motion| 1e3 * last(motion).iter().map(|p| p.translation.x.hypot(p.translation.z)).fold(0.0, f64::max),
        },
    },
    Problem {
        name: "cards",
        title: "A house of cards stands",
        truth: "40 cards of 88 mm, friction 0.7. The error is how far the middle of a card moves in 5 s, mean of the \
                cards.",
        unit: "mm",
        seconds: 5.0,
        least: 0.002,
        seen: 1.0,
        fault: Some("with stiff contacts, from a frequency of 60 on, the house falls"),
        stands: true,
        ask: Ask::Error { scene: || hard::cards(1.0, 0.7), of: mean_path },
    },
    Problem {
        name: "ball",
        title: "A ball slides, then rolls",
        truth: "A ball thrown along the ground at 1 m/s without spin, friction 0.3, slides until it rolls at 5/7 of \
                its speed (2 v / 7 mu g = 97 ms). The error is how far it is from its place after 1 s. Nothing resists \
                rolling.",
        unit: "mm",
        seconds: 1.0,
        least: 0.2,
        seen: 5.0,
        fault: None,
        stands: false,
        ask: Ask::Error {
            scene: || piles::thrown_ball(scenes::round(), 1.0, 0.0, 0.3),
            of: |motion| {
                let slows = 0.3 * GRAVITY;
                let slides = 2.0 / 7.0 / slows;
                let exact = slides - slows * slides * slides / 2.0 + 5.0 / 7.0 * (1.0 - slides);
                1e3 * (path(motion, 0) - exact).abs()
            },
        },
    },
    Problem {
        name: "bounce",
        title: "What does not bounce stays down",
        truth: "A cube of 10 cm that falls by 50 cm, flat on the ground, with restitution 0. The error is how far it \
                is from rest at most, from two frames after the impact on.",
        unit: "mm",
        seconds: 1.0,
        least: 0.002,
        seen: 2.0,
        fault: Some(
            "with short steps, the engine pushes out what has sunk in so fast that it leaves the ground, as plain \
             rapier does",
        ),
        stands: false,
        ask: Ask::Error {
            scene: scenes::dropped,
            of: |motion| {
                let landed = ((2.0 * scenes::DROP / GRAVITY).sqrt() * FPS).ceil() as usize + 2;
                let off = |poses: &Vec<Pose>| (poses[0].translation.y - scenes::DROPPED / 2.0).abs();
                1e3 * motion[landed..].iter().map(off).fold(0.0, f64::max)
            },
        },
    },
    Problem {
        name: "arch",
        title: "The least thickness of an arch",
        truth: "A half ring of 15 stones, friction 0.7, stands if a line of thrust fits into it: from a thickness of \
                about 0.107 of its radius on. The error is how far the thickness is from that at which the arch no \
                longer stands for 5 s.",
        unit: "%",
        seconds: 5.0,
        least: 0.5,
        seen: 5.0,
        fault: None,
        stands: true,
        ask: Ask::Limit {
            scene: scenes::arch,
            shares: -20..60,
            falls_low: true,
            falls: |motion| {
                let crown = scenes::STONES / 2;
                motion[0][crown].translation.y - last(motion)[crown].translation.y > 0.1
            },
        },
    },
    Problem {
        name: "overhang",
        title: "How far a stack may overhang",
        truth: "Five blocks, each of which juts out over the one below by 1/2i of its length, i counted from the top. \
                The error is how far the share of this is from 1 at which the stack no longer stands for 10 s.",
        unit: "%",
        seconds: 10.0,
        least: 0.5,
        seen: 5.0,
        fault: None,
        stands: true,
        ask: Ask::Limit {
            scene: edges::overhanging,
            shares: -40..20,
            falls_low: false,
            falls: |motion| motion[0][0].translation.y - last(motion)[0].translation.y > edges::OVERHANGING.y / 2.0,
        },
    },
    Problem {
        name: "top",
        title: "A spinning top goes around",
        truth: "A top of two cones, 40 cm high, spins with 40 rad/s, leans by 20 degrees, and goes around its tip \
                with the slow speed of steady precession. The error is the angle between its axis and the exact one \
                after 1 s.",
        unit: "degrees",
        seconds: 1.0,
        least: 0.02,
        seen: 5.0,
        fault: None,
        stands: false,
        ask: Ask::Error {
            scene: scenes::top,
            of: |motion| {
                let now = last(motion)[0].rotation * DVec3::Y;
                now.angle_between(scenes::precession().axis(1.0)).to_degrees()
            },
        },
    },
    Problem {
        name: "masses",
        title: "Heavy on light",
        truth: "A cube of 1000 kg on one of 1 kg. The error is how far it sinks in 5 s; an edge has 100 mm.",
        unit: "mm",
        seconds: 5.0,
        least: 0.002,
        seen: 1.0,
        fault: None,
        stands: true,
        ask: Ask::Error {
            scene: || stacks::heavy(1e3),
            of: |motion| 1e3 * (motion[0][1].translation.y - last(motion)[1].translation.y).abs(),
        },
    },
    Problem {
        name: "balls",
        title: "A pyramid of balls stands",
        truth: "30 balls of 10 cm, stacked as cannon balls in a frame that holds the lowest layer, friction 0.7. The \
                error is how far their common centre sinks in 5 s. Nothing resists rolling.",
        unit: "mm",
        seconds: 5.0,
        least: 0.002,
        seen: 1.0,
        fault: None,
        stands: true,
        ask: Ask::Error {
            scene: scenes::pyramid,
            of: |motion| {
                let height = |poses: &[Pose]| poses.iter().map(|p| p.translation.y).sum::<f64>() / poses.len() as f64;
                1e3 * (height(&motion[0]) - height(last(motion))).abs()
            },
        },
    },
    Problem {
        name: "chain",
        title: "A chain hangs as long as it is",
        truth: "Eight rings hang in each other from a fixed one; each middle is 84 mm below the one above. The error \
                is how far the lowest one is from its place after 3 s. It includes that of the collision shapes, \
                which are the convex parts that Cairn makes of a ring.",
        unit: "mm",
        seconds: 3.0,
        least: 0.02,
        seen: 2.0,
        fault: None,
        stands: true,
        ask: Ask::Error {
            scene: places::hanging,
            of: |motion| {
                let lowest = last(motion).len();
                let exact = DVec3::Y * (1.0 - places::TAUT * lowest as f64);
                1e3 * last(motion)[lowest - 1].translation.distance(exact)
            },
        },
    },
    Problem {
        name: "conveyor",
        title: "A block comes along on a conveyor",
        truth: "A block on a slab that moves at 1 m/s from the beginning on, friction 0.2, slides on it by v^2 / 2 mu \
                g = 255 mm. The error is how far it is from there after 1.4 s.",
        unit: "mm",
        seconds: 1.4,
        least: 0.02,
        seen: 5.0,
        fault: None,
        stands: false,
        ask: Ask::Error {
            scene: || places::on_conveyor(0.2),
            of: |motion| {
                let moved = last(motion)[0].translation.x - motion[0][0].translation.x;
                1e3 * (places::CONVEYOR * 1.4 - moved - places::conveyor_slide(0.2)).abs()
            },
        },
    },
];

/// 35 degrees.
const SLIDING: f64 = 35.0 * std::f64::consts::PI / 180.0;
/// Across the axes.
const AZIMUTH: f64 = 0.55;

fn last(motion: &Motion) -> &[Pose] {
    motion.last().expect("frame 0 is there")
}

/// How far a body is from its beginning, m.
fn path(motion: &Motion, body: usize) -> f64 {
    motion[0][body].translation.distance(last(motion)[body].translation)
}

fn mean_path(motion: &Motion) -> f64 {
    let bodies = motion[0].len();
    1e3 * (0..bodies).map(|body| path(motion, body)).sum::<f64>() / bodies as f64
}
