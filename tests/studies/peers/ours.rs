//! Cairn, and what it has to be better than: the same program with less.

use crate::cpu::{Cpu, simulation};
use crate::format::{PeerRun, PeerScene};
use crate::pile::{self, Full};
use crate::shapes::peer_body;
use anyhow::Context;
use cairn_core::release;
use cairn_core::report::bake::{Bake, BakedBody};
use cairn_geometry::pose::Pose;
use cairn_input::params::{ControlMode, GlueMode, Params, Switch};
use cairn_motion::glue::PileGlue;
use cairn_motion::glue::sites::Sites;
use cairn_motion::hold;
use cairn_prepare::effects::Count;
use clap::ValueEnum;
use cpu_time::ProcessTime;
use glam::DVec3;
use rand::SeedableRng;
use rand::seq::index;
use std::collections::BTreeSet;

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Variant {
    /// The paper's control to the last frame, nothing glued
    Held,
    /// The same, but the control is withdrawn once the pile rests
    Natural,
    /// Glued as modelled, without control
    Glued,
    /// Physics alone
    Off,
    /// Physics alone, with four times the substeps: more CPU time than the control takes
    OffSubsteps,
    /// Physics alone, everything damped as strongly as the control damps what is not held
    OffDamped,
    /// As many dots of glue as `glued` has, but anywhere
    Random,
}

const MORE_SUBSTEPS: u32 = 4;

impl Variant {
    fn settings(self) -> &'static str {
        match self {
            Variant::Held => "held",
            Variant::Natural => "natural",
            Variant::Glued => "glued",
            Variant::Off => "uncontrolled",
            Variant::OffSubsteps => "uncontrolled, 4 x the substeps",
            Variant::OffDamped => "uncontrolled, all damped",
            Variant::Random => "as many dots of glue, at random",
        }
    }

    fn params(self, full: &Full, scene: &PeerScene) -> Params {
        let mut params = full.job.params.clone();
        params.output.frames = Some(scene.frames);
        // What rests is still a part of the time.
        params.hold.least_seconds = f64::from(scene.frames) / scene.fps;
        params.report.shape = Switch::Off;
        params.report.support = Switch::Off;
        params.glue.mode = if self == Variant::Glued { GlueMode::AsModelled } else { GlueMode::Natural };
        if !matches!(self, Variant::Held | Variant::Natural | Variant::Glued) {
            params.control.mode = ControlMode::Off;
        }
        match self {
            Variant::Held => params.control.stand = Switch::Off,
            Variant::Natural => params.control.stand = Switch::On,
            Variant::OffSubsteps => params.physics.substeps *= MORE_SUBSTEPS,
            Variant::OffDamped => params.release.resistance = params.control.resistance,
            _ => {}
        }
        params
    }
}

/// The pile from turning over to the last frame.
pub fn bake(full: &Full, scene: &PeerScene, variant: Variant) -> anyhow::Result<PeerRun> {
    let params = variant.params(full, scene);
    let (cpu, poses, resisted_steps) = match variant {
        Variant::Random => at_random(full, scene, &params)?,
        _ => {
            let Bake { pile, report } = release(full, &params)?;
            let shapes = pile::shapes(&full.job)?;
            let last = pile.frames.last().context("a bake has frames")?;
            let body = |(b, pose): (&BakedBody, &Pose)| shapes[b.prop].body_pose(pose, b.scale);
            let poses: Vec<_> = pile.bodies.iter().zip(last).map(body).collect();
            (simulation(&report), poses, report.counts.get(&Count::ResistedBodySteps).copied().unwrap_or_default())
        }
    };
    let bodies = scene.bodies.iter().zip(&poses).map(|(b, pose)| peer_body(&scene.shapes, b.shape, pose)).collect();
    Ok(PeerRun {
        engine: "Cairn".into(),
        settings: variant.settings().into(),
        cpu,
        keyframes_cpu: None,
        resisted_steps: Some(resisted_steps as f64 / scene.bodies.len().max(1) as f64),
        seconds: f64::from(scene.frames) / scene.fps,
        bodies,
        motion: Vec::new(),
    })
}

fn release(full: &Full, params: &Params) -> anyhow::Result<Bake> {
    let released = cairn_core::release_pile(&full.job.scene, params, &full.container, &mut Cpu)?;
    Ok(released.measured(&mut Cpu)?)
}

/// Dots at random touches, as many as Cairn chooses.
fn at_random(full: &Full, scene: &PeerScene, params: &Params) -> anyhow::Result<(f64, Vec<Pose>, u64)> {
    let glued = release(full, &Variant::Glued.params(full, scene))?;
    let count = glued.pile.glue.map_or(0, |glue| glue.dots.len());
    let mut sim = full.container.turn_over(&full.job.scene, params)?;
    let sites = Sites::new(&sim.pile.world, None, true, &BTreeSet::new());
    let touches = sites.problem(DVec3::NEG_Y).sites.len();
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(params.seed);
    let mut chosen = index::sample(&mut rng, touches, count.min(touches)).into_vec();
    chosen.sort_unstable();
    let dots = chosen.into_iter().map(|touch| sites.joint(touch, DVec3::ZERO, DVec3::ZERO, 0.0, 1.0)).collect();
    sim.pile.glue = PileGlue::new(dots, false, &mut sim.pile.world, &mut sim.pile.policy);
    let begin = ProcessTime::now();
    release::run(&mut sim, params, params.release.order, false, &|_| 0.0, &mut Cpu)?;
    hold::run(&mut sim, params, false, &mut Cpu)?;
    let world = &sim.pile.world;
    let poses = (0..world.bodies().len()).map(|id| world.units.pose_to_si(&world.pose(id)));
    Ok((begin.elapsed().as_secs_f64(), poses.collect(), world.counters.resisted_body_steps))
}
