//! The expected peak memory of a bake, fitted on bakes of the examples (`tests/studies/memory`).

use super::Job;
use cairn_export::Format;
use cairn_prepare::plan::Plan;

const MIB: f64 = (1 << 20) as f64;
/// Of the program itself, MiB.
const BASE: f64 = 29.6;
/// Of the bodies, MiB for a pile of one, and how it grows with their number.
const OF_BODIES: f64 = 0.162;
const POWER: f64 = 0.9;
/// Of motion and models, for each byte that the `.glb` has at most.
const OF_RESULT: f64 = 3.76;
/// Nine of ten bakes of the study take between the expected memory / this and the expected memory * this.
const FACTOR: f64 = 1.17;

/// The expected peak memory of a bake, bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeakMemory {
    pub expected: u64,
    /// What nine of ten bakes stay below.
    pub most: u64,
}

impl Job {
    pub fn peak_memory(&self, plan: &Plan) -> PeakMemory {
        let bodies = OF_BODIES * MIB * libm::pow(plan.expected_bodies as f64, POWER);
        let expected = BASE * MIB + bodies + OF_RESULT * self.most_bytes(plan, Format::Glb) as f64;
        PeakMemory { expected: expected as u64, most: (FACTOR * expected) as u64 }
    }
}
