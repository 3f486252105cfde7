//! Additions to the engine's own step: continuous collision of fast bodies and new contacts of what turns before it;
//! resistance to rolling, no sleep for bodies that creep, and more substeps for piles that bob after it. Each knows the
//! engine and the bodies, and nothing of the world above.

pub mod bobbing;
pub mod ccd;
pub mod creep;
pub mod resistance;
pub mod rolling;
pub mod turning;

/// Counts of the steps and their corrections: bodies, summed over the steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct WorldCounters {
    /// Bodies that the engine moved.
    pub awake_body_steps: u64,
    /// Pairs of near boxes that the engine kept.
    pub pair_steps: u64,
    /// Pairs of convex parts whose contact was computed, and pairs of bodies that cannot have met since the last look.
    #[serde(default)]
    pub contact_looks: u64,
    #[serde(default)]
    pub contact_skips: u64,
    /// Bodies whose contacts were found a step ahead.
    pub speculative_body_steps: u64,
    /// Bodies swept along their path.
    pub ccd_body_steps: u64,
    /// Bodies braked by their resistance to rolling.
    pub rolling_body_steps: u64,
    /// Bodies braked by the resistance of their contacts.
    pub resisted_body_steps: u64,
    /// Steps taken for those of one because scenery moved fast.
    pub scenery_part_steps: u64,
    /// Looks at a body that moved on the spot, and so was allowed to fall asleep.
    pub rocking_looks: u64,
    /// Times that a pile that bobbed got more substeps.
    pub calmed: u64,
}

impl WorldCounters {
    /// Adds those of another world.
    pub fn add(&mut self, other: &WorldCounters) {
        let WorldCounters {
            awake_body_steps,
            pair_steps,
            contact_looks,
            contact_skips,
            speculative_body_steps,
            ccd_body_steps,
            rolling_body_steps,
            resisted_body_steps,
            scenery_part_steps,
            rocking_looks,
            calmed,
        } = other;
        self.awake_body_steps += awake_body_steps;
        self.pair_steps += pair_steps;
        self.contact_looks += contact_looks;
        self.contact_skips += contact_skips;
        self.speculative_body_steps += speculative_body_steps;
        self.ccd_body_steps += ccd_body_steps;
        self.rolling_body_steps += rolling_body_steps;
        self.resisted_body_steps += resisted_body_steps;
        self.scenery_part_steps += scenery_part_steps;
        self.rocking_looks += rocking_looks;
        self.calmed += calmed;
    }
}
