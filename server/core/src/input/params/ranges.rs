//! The ranges of all parameters.

use super::{Params, Spread, Time};
use crate::error::Problem;

impl Params {
    /// What is out of range, and what to give instead.
    pub fn problems(&self) -> Vec<Problem> {
        let time = |t: Time| match t {
            Time::Natural(t) | Time::Seconds(t) => t,
        };
        let spread = match self.control.spread {
            Spread::Paper(alpha) => alpha,
            Spread::Relative(share) => share,
        };
        let ranges = [
            ("gravity", self.gravity, 0.01, 1000.0),
            ("ground_friction", self.ground_friction, 0.0, 2.0),
            ("ground_height", self.ground_height.unwrap_or(0.0), -1e6, 1e6),
            ("physics.step", time(self.physics.step), 1e-6, 1.0),
            ("physics.substeps", f64::from(self.physics.substeps), 1.0, 64.0),
            ("physics.contact_frequency", self.physics.contact_frequency, 1.0, 1000.0),
            ("physics.contact_damping_ratio", self.physics.contact_damping_ratio, 0.1, 100.0),
            ("physics.rolling_resistance", self.physics.rolling_resistance, 0.0, 1.0),
            ("physics.shape_tolerance", self.physics.shape_tolerance, 0.001, 0.5),
            ("physics.max_parts", f64::from(self.physics.max_parts), 1.0, 64.0),
            ("base.height", self.base.height, 0.001, 0.5),
            ("fill.order", self.fill.order, 0.0, 1.0),
            ("fill.surface", self.fill.surface, 0.0, 1.0),
            ("fill.shake", self.fill.shake, 0.0, 100.0),
            ("fill.friction", self.fill.friction, 0.0, 2.0),
            ("fill.count", f64::from(self.fill.count.unwrap_or(1)), 1.0, 100_000.0),
            ("fill.max_bodies", f64::from(self.fill.max_bodies), 1.0, 100_000.0),
            ("fill.step", self.fill.step, 0.001, 0.2),
            ("fill.round", self.fill.round, 0.01, 1.0),
            ("fill.full_below", self.fill.full_below, 0.0, 0.5),
            ("fill.growth", self.fill.growth, 0.05, 10.0),
            ("fill.settle", self.fill.settle, 0.0, 1000.0),
            ("fill.protrusion", self.fill.protrusion, 0.0, 1.0),
            ("fill.overlap", self.fill.overlap, 0.01, 1.0),
            ("fill.residual_overlap", self.fill.residual_overlap, 0.0005, 1.0),
            ("fill.wall_tolerance", self.fill.wall_tolerance, 0.0, 0.5),
            ("fill.shell", self.fill.shell.unwrap_or(1.0), 0.05, 1000.0),
            ("release.layer", self.release.layer, 0.01, 1000.0),
            ("release.interval", time(self.release.interval), 0.0, 1000.0),
            ("release.damping", self.release.damping, 0.0, 100.0),
            ("glue.strength", self.glue.strength.unwrap_or(0.0), 0.0, 1e9),
            ("glue.friction_factor", self.glue.friction_factor, 0.05, 1.0),
            ("glue.normal_price", self.glue.normal_price, 0.0, 1.0),
            ("glue.rounds", f64::from(self.glue.rounds), 2.0, 7.0),
            ("glue.breaking", self.glue.breaking, 1.0, 1e6),
            ("control.period", f64::from(self.control.period), 1.0, 1000.0),
            ("control.kinetic_ratio", self.control.kinetic_ratio, 0.0, 1.0),
            ("control.contact_tolerance", self.control.contact_tolerance, 0.0, 1.0),
            ("control.spread", spread, 0.0, 1e6),
            ("control.damping", self.control.damping, 0.0, 100.0),
            ("control.kappa", self.control.kappa, 0.0, 1e9),
            ("control.nails_per_body", f64::from(self.control.nails_per_body), 1.0, 1000.0),
            ("control.until", self.control.until.unwrap_or(0.0), 0.0, 100_000.0),
            ("hold.patience", self.hold.patience, 0.0, 100_000.0),
            ("hold.least_seconds", self.hold.least, 0.0, 100_000.0),
            ("output.fps", self.output.fps, 1.0, 1000.0),
            ("output.frames", f64::from(self.output.frames.unwrap_or(0)), 0.0, 100_000.0),
        ];
        let bad = ranges.into_iter().filter(|(_, value, lo, hi)| !(lo..=hi).contains(&value));
        let told =
            |(name, value, lo, hi)| Problem::new(name, format!("{name}: {value} is out of range; give {lo} to {hi}"));
        let mut problems: Vec<Problem> = bad.map(told).collect();
        if self.control.speed.is_nan() || self.control.speed <= 0.0 {
            let text = format!("control.speed: {} is out of range; give a speed above 0", self.control.speed);
            problems.push(Problem::new("control.speed", text));
        }
        problems
    }
}
