//! Depth of overlaps between bodies, from plain lists.

use serde::Serialize;

/// Overlap of a contact pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Metres, recomputed from the final poses; a gap is negative and counts as 0.
    pub depth: f64,
    /// Smallest extent of the thinner of the two, metres.
    pub thickness: f64,
}

/// `penetration_max_rel`, `penetration_p95_rel` and `penetration_mean_rel`: depth over thickness.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Penetration {
    pub max_rel: f64,
    /// Of 100 touching pairs, 95 overlap by no more.
    pub p95_rel: f64,
    pub mean_rel: f64,
    /// Touching pairs that the mean is over.
    pub pairs: usize,
}

/// Over the touching pairs; all zero without any.
pub fn penetration(overlaps: &[Overlap]) -> Penetration {
    let mut relative: Vec<f64> = overlaps.iter().map(|o| (o.depth / o.thickness).max(0.0)).collect();
    let (sum, pairs) = (relative.iter().sum::<f64>(), relative.len());
    relative.sort_by(f64::total_cmp);
    let rank = (pairs as f64 * 0.95).ceil() as usize;
    Penetration {
        max_rel: relative.last().copied().unwrap_or(0.0),
        p95_rel: relative.get(rank.saturating_sub(1)).copied().unwrap_or(0.0),
        mean_rel: sum / pairs.max(1) as f64,
        pairs,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_relative_to_the_thinner() {
        let overlaps = [(0.01, 0.1), (-0.5, 0.1), (0.02, 0.1), (0.01, 1.0)];
        let p = penetration(&overlaps.map(|(depth, thickness)| Overlap { depth, thickness }));
        assert!(
            (p.max_rel - 0.2).abs() < 1e-12
                && p.p95_rel == p.max_rel
                && (p.mean_rel - 0.31 / 4.0).abs() < 1e-12
                && p.pairs == 4
        );
        assert_eq!(penetration(&[]), Penetration { max_rel: 0.0, p95_rel: 0.0, mean_rel: 0.0, pairs: 0 });
        let many: Vec<Overlap> = (1..=100).map(|k| Overlap { depth: f64::from(k), thickness: 100.0 }).collect();
        assert_eq!(penetration(&many).p95_rel, 0.95);
    }
}
