//! The core's types -> messages.

use crate::problem::Problem;
use crate::wire::proto;
use cairn_core::input::observer::{Progress, Stage, State};
use cairn_core::input::params::{
    Accuracy, ContactSelection, Control, ControlMode, FillMethod, FrictionCone, FrictionModel, FrictionReserve, Glue,
    GlueMode, Layout, Neighbours, Params, Physics, ReleaseOrder, SortBy, Spread, Switch, Time,
};
use cairn_core::prepare::effects::Effect;
use cairn_core::prepare::estimate::Estimate;
use cairn_core::prepare::plan::Plan;

/// A scene of these parameters, without models.
pub fn params(params: &Params) -> proto::Scene {
    proto::Scene {
        accuracy: accuracy(params.accuracy).into(),
        seed: Some(signed(params.seed)),
        gravity: Some(params.gravity),
        ground: Some(params.ground),
        ground_friction: Some(params.ground_friction),
        ground_height: params.ground_height,
        physics: Some(physics(&params.physics)),
        base: Some(proto::Base { height: Some(params.base.height) }),
        fill: Some(fill(params)),
        release: Some(release(params)),
        glue: Some(glue(&params.glue)),
        control: Some(control(&params.control)),
        hold: Some(proto::Hold { patience: Some(params.hold.patience), least_seconds: Some(params.hold.least) }),
        output: Some(proto::Output {
            fps: Some(params.output.fps),
            frames: params.output.frames.map(signed),
            free_standing: Some(params.output.free_standing),
            free_pour: Some(params.output.free_pour),
        }),
        report: Some(proto::Figures {
            shape: switch(params.report.shape),
            pictures: switch(params.report.pictures),
            support: switch(params.report.support),
        }),
        effects: Some(effects(params)),
        ..Default::default()
    }
}

fn effects(params: &Params) -> proto::Effects {
    let (physics, control) = (&params.physics.switches, &params.control.switches);
    proto::Effects {
        primitives: switch(physics.primitives),
        decomposition: switch(physics.decomposition),
        continuous_collision: switch(physics.continuous_collision),
        stiff_contacts: switch(physics.stiff_contacts),
        rolling_resistance: switch(physics.rolling_resistance),
        restitution: switch(physics.restitution),
        guard: switch(params.guard),
        impact: switch(control.impact),
        breaking: switch(control.breaking),
        region: switch(control.region),
        kept_verdicts: switch(control.kept_verdicts),
        frames: switch(params.output.keeps_frames),
    }
}

fn switch(switch: Switch) -> i32 {
    let switch = match switch {
        Switch::Auto => proto::Switch::Auto,
        Switch::On => proto::Switch::On,
        Switch::Off => proto::Switch::Off,
    };
    switch.into()
}

/// A count as the wire has it. The core's ranges keep counts far below the wire's limits.
pub fn signed<U, S: TryFrom<U>>(value: U) -> S {
    S::try_from(value).unwrap_or_else(|_| panic!("a count in its range fits the wire"))
}

pub fn stage(stage: Stage) -> proto::Stage {
    match stage {
        Stage::Shape => proto::Stage::Shape,
        Stage::Fill => proto::Stage::Fill,
        Stage::Glue => proto::Stage::Glue,
        Stage::Release => proto::Stage::Release,
        Stage::Hold => proto::Stage::Hold,
        Stage::Measure => proto::Stage::Measure,
    }
}

pub fn body_state(state: State) -> proto::BodyState {
    match state {
        State::Free => proto::BodyState::Unspecified,
        State::Waiting => proto::BodyState::Waiting,
        State::Unstable => proto::BodyState::Unstable,
        State::Candidate => proto::BodyState::Candidate,
        State::Held => proto::BodyState::Held,
        State::Outside => proto::BodyState::Outside,
        State::Pinned => proto::BodyState::Kept,
        State::Glued => proto::BodyState::Glued,
        State::Anchored => proto::BodyState::Anchored,
    }
}

/// `estimates`: none where the machine is not to be told. `params`: the scene's own.
pub fn plan(plan: &Plan, notes: &[String], estimates: &[Estimate], params: &Params) -> proto::Plan {
    let expected = estimates.iter().find(|estimate| estimate.accuracy == params.accuracy);
    let kept = |estimate: &Estimate, n: usize| estimate.kept_shape.map_or(0.0, |kept| kept[n]);
    let estimate = |estimate: &Estimate| proto::Estimate {
        kept_shape_low: kept(estimate, 0),
        kept_shape: kept(estimate, 1),
        kept_shape_high: kept(estimate, 2),
        accuracy: accuracy(estimate.accuracy).into(),
        cpu_seconds: estimate.cpu_seconds,
        factor: estimate.factor,
        penetration_mean_rel: estimate.penetration_mean_rel,
        glue_dots: estimate.glue_dots,
        body_count: signed(estimate.bodies),
        wall_seconds: estimate.wall_seconds(rayon::current_num_threads()),
        overlap: estimate.overlap,
        imbalance: estimate.imbalance,
        shape_error: estimate.shape_error,
        ..Default::default()
    };
    let effect = |effect: &Effect| proto::Effect {
        name: effect.name.to_string(),
        on: effect.on,
        reason: effect.reason.clone(),
        switch_field: effect.switch.as_deref().unwrap_or_default().to_owned(),
        expected_share: expected.and_then(|expected| expected.share(effect.name)).filter(|_| effect.on),
    };
    proto::Plan {
        expected_body_count: signed(plan.expected_bodies),
        expected_step_count: signed(plan.expected_steps),
        prop_diameter: plan.prop_diameter,
        natural_time_seconds: plan.natural_time,
        stages: plan.stages.iter().map(|&s| stage(s).into()).collect(),
        effects: plan.effects.iter().map(effect).collect(),
        warnings: notes.iter().chain(&plan.warnings).cloned().collect(),
        estimates: estimates.iter().map(estimate).collect(),
    }
}

pub fn progress(progress: &Progress, remaining_seconds: Option<f64>) -> proto::Progress {
    proto::Progress {
        stage: stage(progress.stage).into(),
        fraction: progress.fraction,
        body_count: signed(progress.bodies),
        released_count: signed(progress.released),
        at_rest_count: signed(progress.at_rest),
        nail_count: signed(progress.nails),
        remaining_seconds,
    }
}

/// Every accuracy with its parameters.
pub fn accuracy_presets() -> Vec<proto::AccuracyPreset> {
    let all = [&[Accuracy::Paper], &Accuracy::LADDER[..]].concat();
    let preset = |&of: &Accuracy| proto::AccuracyPreset {
        accuracy: accuracy(of).into(),
        parameters: Some(params(&Params::new(of))),
    };
    all.iter().map(preset).collect()
}

/// A problem of a scene, as one of the request that holds it.
pub fn field_problem(problem: &Problem) -> proto::FieldProblem {
    let mut field = String::from("spec.scene");
    for part in problem.field.split('.').filter(|part| !part.is_empty()) {
        match part.parse::<usize>() {
            Ok(index) => field += &format!("[{index}]"),
            Err(_) => field += &format!(".{part}"),
        }
    }
    proto::FieldProblem { field, description: problem.to_string() }
}

pub fn accuracy(accuracy: Accuracy) -> proto::Accuracy {
    match accuracy {
        Accuracy::Paper => proto::Accuracy::Paper,
        Accuracy::Draft => proto::Accuracy::Draft,
        Accuracy::Preview => proto::Accuracy::Preview,
        Accuracy::Standard => proto::Accuracy::Standard,
        Accuracy::Fine => proto::Accuracy::Fine,
        Accuracy::Reference => proto::Accuracy::Reference,
    }
}

/// As scene files write it: `standard`.
pub fn accuracy_name(of: Accuracy) -> String {
    accuracy(of).as_str_name().trim_start_matches("ACCURACY_").to_lowercase()
}

fn physics(physics: &Physics) -> proto::Physics {
    use proto::physics::Step;
    proto::Physics {
        step: Some(match physics.step {
            Time::Natural(time) => Step::StepNatural(time),
            Time::Seconds(time) => Step::StepSeconds(time),
        }),
        substeps: Some(signed(physics.substeps)),
        contact_frequency: Some(physics.contact_frequency),
        contact_damping_ratio: Some(physics.contact_damping_ratio),
        friction_model: match physics.friction_model {
            FrictionModel::Simplified => proto::FrictionModel::Simplified,
            FrictionModel::Coulomb => proto::FrictionModel::Coulomb,
        }
        .into(),
        rolling_resistance: Some(physics.rolling_resistance),
        shape_tolerance: Some(physics.shape_tolerance),
        max_parts: Some(signed(physics.max_parts)),
    }
}

fn fill(params: &Params) -> proto::Fill {
    let fill = &params.fill;
    proto::Fill {
        method: match fill.method {
            FillMethod::Insert => proto::FillMethod::Insert,
            FillMethod::Pour => proto::FillMethod::Pour,
            FillMethod::Stack => proto::FillMethod::Stack,
            FillMethod::Off => proto::FillMethod::Off,
        }
        .into(),
        order: Some(fill.order),
        surface: Some(fill.surface),
        layout: match fill.mixture.layout {
            Layout::Mixed => proto::Layout::Mixed,
            Layout::Bands => proto::Layout::Bands,
            Layout::Gradient => proto::Layout::Gradient,
            Layout::Clusters => proto::Layout::Clusters,
        }
        .into(),
        sort_by: match fill.mixture.sort_by {
            SortBy::Size => proto::SortBy::Size,
            SortBy::Mass => proto::SortBy::Mass,
            SortBy::Name => proto::SortBy::Name,
        }
        .into(),
        descending: Some(fill.mixture.descending),
        gaps: Some(fill.gaps),
        shake: Some(fill.shake),
        friction: Some(fill.friction),
        count: fill.count.map(signed),
        max_bodies: Some(signed(fill.max_bodies)),
        step: Some(fill.step),
        round: Some(fill.round),
        full_below: Some(fill.full_below),
        growth: Some(fill.growth),
        settle: Some(fill.settle),
        protrusion: Some(fill.protrusion),
        overlap: Some(fill.overlap),
        residual_overlap: Some(fill.residual_overlap),
        wall_tolerance: Some(fill.wall_tolerance),
        shell: fill.shell,
    }
}

fn release(params: &Params) -> proto::Release {
    use proto::release::Interval;
    proto::Release {
        layer: Some(params.release.layer),
        interval: Some(match params.release.interval {
            Time::Natural(time) => Interval::IntervalNatural(time),
            Time::Seconds(time) => Interval::IntervalSeconds(time),
        }),
        damping: Some(params.release.damping),
        order: match params.release.order {
            ReleaseOrder::BottomUp => proto::ReleaseOrder::BottomUp,
            ReleaseOrder::TopDown => proto::ReleaseOrder::TopDown,
            ReleaseOrder::AtOnce => proto::ReleaseOrder::AtOnce,
        }
        .into(),
    }
}

fn glue(glue: &Glue) -> proto::Glue {
    proto::Glue {
        mode: match glue.mode {
            GlueMode::Auto => proto::GlueMode::Auto,
            GlueMode::Natural => proto::GlueMode::Natural,
            GlueMode::Tacky => proto::GlueMode::Tacky,
            GlueMode::AsModelled => proto::GlueMode::AsModelled,
        }
        .into(),
        strength: glue.strength,
        friction_factor: Some(glue.friction_factor),
        normal_price: Some(glue.normal_price),
        rounds: Some(glue.rounds as i32),
        anchor: switch(glue.anchor),
        breaking: Some(glue.breaking),
        proof: switch(glue.proof),
    }
}

fn control(control: &Control) -> proto::Control {
    use proto::control::Spread as Wire;
    proto::Control {
        mode: match control.mode {
            ControlMode::Off => proto::ControlMode::Off,
            ControlMode::Nails => proto::ControlMode::Nails,
            ControlMode::Freeze => proto::ControlMode::Hold,
        }
        .into(),
        period: Some(signed(control.period)),
        selection: match control.selection {
            ContactSelection::Conservative => proto::ContactSelection::Conservative,
            ContactSelection::All => proto::ContactSelection::All,
        }
        .into(),
        friction_reserve: match control.friction_reserve {
            FrictionReserve::Paper => proto::FrictionReserve::Paper,
            FrictionReserve::Sharp => proto::FrictionReserve::Sharp,
        }
        .into(),
        friction_cone: match control.friction_cone {
            FrictionCone::Pyramid => proto::FrictionCone::Pyramid,
            FrictionCone::Cone => proto::FrictionCone::Cone,
        }
        .into(),
        kinetic_ratio: Some(control.kinetic_ratio),
        contact_tolerance: Some(control.contact_tolerance),
        spread: Some(match control.spread {
            Spread::Relative(share) => Wire::SpreadRelative(share),
            Spread::Paper(area) => Wire::SpreadArea(area),
        }),
        neighbours: match control.neighbours {
            Neighbours::All => proto::Neighbours::All,
            Neighbours::Either => proto::Neighbours::Either,
        }
        .into(),
        speed: Some(control.speed),
        damping: Some(control.damping),
        kappa: Some(control.kappa),
        nails_per_body: Some(signed(control.nails_per_body)),
        until: control.until.map(proto::control::Until::UntilSeconds),
        stand: match control.stand {
            Switch::Auto => None,
            Switch::On => Some(true),
            Switch::Off => Some(false),
        },
    }
}
