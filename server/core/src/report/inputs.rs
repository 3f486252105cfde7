//! The inputs of a report.

use super::bake::BakedPile;
use crate::geometry::mesh::TriMesh;
use crate::geometry::pose::Pose;
use crate::input::observer::{Progress, Stage};
use crate::input::params::Params;
use crate::input::scene::Scene;
use crate::prepare::container::Container;
use crate::prepare::container::core::Core;
use crate::prepare::effects::Resolved;
use crate::prepare::plan::Plan;
use crate::prepare::shape::Shape;
use crate::stages::entrance::Entrance;
use crate::stages::fill::Filled;
use crate::stages::glue::Glued;
use crate::stages::hold::HoldOutcome;
use crate::stages::separate::Separation;
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
    /// `None`: nothing is glued.
    pub glued: Option<&'a Glued>,
    /// With every frame that was kept.
    pub pile: &'a BakedPile,
    /// How its bodies come in.
    pub entrance: Option<&'a Entrance>,
    /// Height, m.
    pub ground: f64,
}

impl ReportInputs<'_> {
    /// Progress of the measures, 0 to 1.
    pub fn progress(&self, fraction: f64) -> Progress {
        let bodies = self.pile.bodies.len();
        let frames = self.pile.frames.len();
        Progress { stage: Stage::Measure, fraction, bodies, released: bodies, at_rest: 0, nails: 0, frames }
    }

    /// The bodies that a frame has, as the measures take them: prop, scale and pose.
    pub fn placed(&self, number: usize) -> Vec<(usize, f64, Pose)> {
        let there = self.pile.bodies.iter().zip(&self.pile.frames[number]).filter(|(b, _)| b.first_frame <= number);
        there.map(|(b, &pose)| (b.prop, b.scale, pose)).collect()
    }
}
