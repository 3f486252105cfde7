//! The accuracy that a goal calls for.

use super::Estimate;

/// What a bake is to keep to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// Seconds from the start to the result.
    Time(f64),
    /// What 95 of 100 pairs of touching meshes may overlap by at most, m.
    Overlap(f64),
}

/// What an accuracy is expected to come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Nine of ten bakes take no longer from start to result, s.
    pub most_seconds: f64,
    /// What 95 of 100 pairs of touching meshes overlap by at most in nine of ten bakes, m.
    pub overlap: f64,
}

/// The accuracy that was chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Its index in the ladder.
    pub index: usize,
    /// Whether it is expected to keep to the goal. If not, it comes nearest to it.
    pub is_expected: bool,
}

/// A bake keeps to its time if it takes no more than this many times as long.
pub const TOLERANCE: f64 = 1.25;

impl Estimate {
    /// With this number of threads.
    pub fn expected(&self, threads: usize) -> Expected {
        Expected { most_seconds: self.factor * self.wall_seconds(threads), overlap: self.most_overlap }
    }
}

impl Goal {
    /// The most accurate preset that is expected to take no longer, or the cheapest one that overlaps by no more.
    /// `ladder`: cheapest first. `None` for an empty one.
    pub fn choose(&self, ladder: &[Expected]) -> Option<Choice> {
        let last = ladder.len().checked_sub(1)?;
        let (found, nearest) = match *self {
            Goal::Time(seconds) => (ladder.iter().rposition(|e| e.most_seconds <= TOLERANCE * seconds), 0),
            Goal::Overlap(most) => (ladder.iter().position(|e| e.overlap <= most), last),
        };
        Some(Choice { index: found.unwrap_or(nearest), is_expected: found.is_some() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ladder() -> Vec<Expected> {
        (0..5).map(|n| Expected { most_seconds: 4f64.powi(n), overlap: 0.01 * 0.1f64.powi(n) }).collect()
    }

    #[test]
    fn the_most_accurate_that_has_the_time() {
        let choose = |seconds| Goal::Time(seconds).choose(&ladder()).unwrap();
        // 16 s are at most 1.25 x 13 s.
        assert_eq!(choose(13.0), Choice { index: 2, is_expected: true });
        assert_eq!(choose(12.0), Choice { index: 1, is_expected: true });
        assert_eq!(choose(1e9), Choice { index: 4, is_expected: true });
        assert_eq!(choose(0.1), Choice { index: 0, is_expected: false });
    }

    #[test]
    fn the_cheapest_that_overlaps_little() {
        let choose = |most| Goal::Overlap(most).choose(&ladder()).unwrap();
        assert_eq!(choose(1.0), Choice { index: 0, is_expected: true });
        assert_eq!(choose(2e-4), Choice { index: 2, is_expected: true });
        assert_eq!(choose(1e-9), Choice { index: 4, is_expected: false });
        assert_eq!(Goal::Overlap(1.0).choose(&[]), None);
    }
}
