//! The inputs of a report.

use super::bake::BakedPile;
use crate::fill::Filled;
use crate::glue::Glued;
use crate::keep::Outcome;
use crate::separate::Separation;
use cairn_engine::shape::Shape;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::{Progress, Stage};
use cairn_input::params::Params;
use cairn_input::scene::Scene;
use cairn_motion::hold::HoldOutcome;
use cairn_prepare::container::Container;
use cairn_prepare::container::core::Core;
use cairn_prepare::effects::Resolved;
use cairn_prepare::plan::Plan;
use cairn_show::entrance::Entrance;
use std::collections::BTreeMap;

/// Figures by name; `None` where a figure has no meaning for the scene.
pub type NamedFigures = BTreeMap<&'static str, Option<f64>>;

/// The inputs of a report.
pub struct ReportInputs<'a> {
    pub scene: &'a Scene,
    pub params: &'a Params,
    pub plan: &'a Plan,
    pub resolved: &'a Resolved,
    pub shapes: &'a [Shape],
    /// The shape that the pile is to have, welded and facing outward.
    pub target: Option<&'a TriMesh>,
    pub filled: Option<&'a (Container, Filled)>,
    /// The core, where the pile is a shell.
    pub core: Option<&'a Core>,
    pub held: HoldOutcome,
    pub separation: Option<Separation>,
    /// What became of the earlier pile, where there is one.
    pub outcome: Option<&'a Outcome>,
    /// `None`: nothing is glued.
    pub glued: Option<&'a Glued>,
    /// With every frame that was kept.
    pub pile: &'a BakedPile,
    /// How its bodies come in.
    pub entrance: Option<&'a Entrance>,
    /// Height, m.
    pub ground: f64,
}

/// What physics alone does with the pile and with its props, where the report has figures of that.
#[derive(Default)]
pub struct PhysicsAlone {
    pub figures: NamedFigures,
    /// Steps in which it moved the pile.
    pub steps: u64,
    /// CPU seconds of those.
    pub seconds: f64,
}

impl ReportInputs<'_> {
    /// Progress of the measures, 0 to 1.
    pub fn progress(&self, fraction: f64) -> Progress {
        let bodies = self.pile.bodies.len();
        // An entrance has frames of its own.
        let frames = self.entrance.map_or(self.pile.frames.len(), |entrance| entrance.last + 1);
        Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0, frames }
    }

    /// The bodies that a frame has, as the measures take them: prop, scale and pose.
    pub fn placed(&self, number: usize) -> Vec<(usize, f64, Pose)> {
        let there = self.pile.bodies.iter().zip(&self.pile.frames[number]).filter(|(b, _)| b.first_frame <= number);
        there.map(|(b, &pose)| (b.prop, b.scale, pose)).collect()
    }
}
