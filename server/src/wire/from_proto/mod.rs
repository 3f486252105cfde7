//! Messages -> the core's types. A field that is not set has the accuracy preset's value.
//!
//! Ranges are the core's business; only what the core's types cannot hold is refused here.

pub mod added;

use crate::problem::Problem;
use crate::wire::proto;
use cairn_core::input::observer::{Progress, Stage};
use cairn_core::input::params::{
    Accuracy, ContactSelection, Control, ControlMode, ControlSwitches, Figures, Fill, FillMethod, FrictionCone,
    FrictionModel, FrictionReserve, Glue, GlueMode, Hold, Layout, Neighbours, Output, Params, Physics, PhysicsSwitches,
    Release, ReleaseOrder, SortBy, Spread, Switch, Time,
};
use cairn_core::input::scene::Turns;

/// The parameters of a scene.
pub fn params(scene: &proto::Scene) -> Result<Params, Vec<Problem>> {
    let (params, problems) = params_and_problems(scene);
    if problems.is_empty() { Ok(params) } else { Err(problems) }
}

/// The parameters of a scene, as far as they can be read, and what cannot.
pub fn params_and_problems(scene: &proto::Scene) -> (Params, Vec<Problem>) {
    let mut counts = Counts::default();
    let mut params = Params::new(accuracy(scene.accuracy()));
    if let Some(seed) = scene.seed {
        params.seed = counts.natural("seed", seed);
    }
    set(&mut params.gravity, scene.gravity);
    set(&mut params.ground, scene.ground);
    set(&mut params.ground_friction, scene.ground_friction);
    params.ground_height = scene.ground_height.or(params.ground_height);
    physics(&mut params.physics, &scene.physics.unwrap_or_default(), &mut counts);
    set(&mut params.base.height, scene.base.unwrap_or_default().height);
    fill(&mut params.fill, &scene.fill.unwrap_or_default(), &mut counts);
    release(&mut params.release, &scene.release.unwrap_or_default());
    glue(&mut params.glue, &scene.glue.unwrap_or_default(), &mut counts);
    control(&mut params.control, &scene.control.unwrap_or_default(), &mut counts);
    hold(&mut params.hold, &scene.hold.unwrap_or_default());
    output(&mut params.output, &scene.output.unwrap_or_default(), &mut counts);
    report(&mut params.report, &scene.report.unwrap_or_default());
    until(&mut params, scene, &mut counts);
    effects(&mut params, &scene.effects.unwrap_or_default());
    (params, counts.problems)
}

/// How a bake that runs elsewhere stands.
pub fn progress(progress: &proto::Progress) -> Progress {
    let stage = match progress.stage() {
        proto::Stage::Unspecified | proto::Stage::Shape => Stage::Shape,
        proto::Stage::Fill => Stage::Fill,
        proto::Stage::Glue => Stage::Glue,
        proto::Stage::Release => Stage::Release,
        proto::Stage::Hold => Stage::Hold,
        proto::Stage::Measure => Stage::Measure,
    };
    let count = |count: i32| usize::try_from(count).unwrap_or(0);
    Progress {
        stage,
        fraction: progress.fraction,
        bodies: count(progress.body_count),
        released: count(progress.released_count),
        at_rest: count(progress.at_rest_count),
        nails: count(progress.nail_count),
    }
}

/// Signed counts on the wire, unsigned ones in the core.
#[derive(Default)]
struct Counts {
    problems: Vec<Problem>,
}

impl Counts {
    fn natural<S: Copy + std::fmt::Display, U: TryFrom<S> + Default>(&mut self, field: &str, value: S) -> U {
        U::try_from(value).unwrap_or_else(|_| {
            let problem = Problem::new(field, format!("{value} is negative"), "Give 0 or more.");
            self.problems.push(problem.of_field(field));
            U::default()
        })
    }
}

fn set<T>(value: &mut T, given: Option<T>) {
    if let Some(given) = given {
        *value = given;
    }
}

fn accuracy(accuracy: proto::Accuracy) -> Accuracy {
    match accuracy {
        proto::Accuracy::Paper => Accuracy::Paper,
        proto::Accuracy::Draft => Accuracy::Draft,
        proto::Accuracy::Unspecified | proto::Accuracy::Standard => Accuracy::Standard,
        proto::Accuracy::Preview => Accuracy::Preview,
        proto::Accuracy::Fine => Accuracy::Fine,
        proto::Accuracy::Reference => Accuracy::Reference,
    }
}

fn physics(physics: &mut Physics, given: &proto::Physics, counts: &mut Counts) {
    use proto::physics::Step;
    set(
        &mut physics.step,
        given.step.map(|step| match step {
            Step::StepNatural(time) => Time::Natural(time),
            Step::StepSeconds(time) => Time::Seconds(time),
        }),
    );
    set(&mut physics.substeps, given.substeps.map(|n| counts.natural("physics.substeps", n)));
    set(&mut physics.contact_frequency, given.contact_frequency);
    set(&mut physics.contact_damping_ratio, given.contact_damping_ratio);
    match given.friction_model() {
        proto::FrictionModel::Unspecified => {}
        proto::FrictionModel::Simplified => physics.friction_model = FrictionModel::Simplified,
        proto::FrictionModel::Coulomb => physics.friction_model = FrictionModel::Coulomb,
    }
    set(&mut physics.rolling_resistance, given.rolling_resistance);
    set(&mut physics.shape_tolerance, given.shape_tolerance);
    set(&mut physics.max_parts, given.max_parts.map(|n| counts.natural("physics.max_parts", n)));
}

/// The turns that a prop may have; any where nothing is said.
pub fn turns(given: proto::Turns) -> Turns {
    match given {
        proto::Turns::Unspecified | proto::Turns::Any => Turns::Any,
        proto::Turns::Quarter => Turns::Quarter,
        proto::Turns::None => Turns::None,
    }
}

fn fill(fill: &mut Fill, given: &proto::Fill, counts: &mut Counts) {
    match given.method() {
        proto::FillMethod::Unspecified => {}
        proto::FillMethod::Insert => fill.method = FillMethod::Insert,
        proto::FillMethod::Pour => fill.method = FillMethod::Pour,
        proto::FillMethod::Stack => fill.method = FillMethod::Stack,
        proto::FillMethod::Off => fill.method = FillMethod::Off,
    }
    set(&mut fill.order, given.order);
    // One of the two says it: what is stacked is tidy, and what is to be tidy is stacked.
    match (given.method(), given.order) {
        (proto::FillMethod::Stack, None) => fill.order = 1.0,
        (proto::FillMethod::Unspecified, Some(order)) if order > 0.0 => fill.method = FillMethod::Stack,
        _ => {}
    }
    set(&mut fill.surface, given.surface);
    match given.layout() {
        proto::Layout::Unspecified => {}
        proto::Layout::Mixed => fill.mixture.layout = Layout::Mixed,
        proto::Layout::Bands => fill.mixture.layout = Layout::Bands,
        proto::Layout::Gradient => fill.mixture.layout = Layout::Gradient,
        proto::Layout::Clusters => fill.mixture.layout = Layout::Clusters,
    }
    match given.sort_by() {
        proto::SortBy::Unspecified => {}
        proto::SortBy::Size => fill.mixture.sort_by = SortBy::Size,
        proto::SortBy::Mass => fill.mixture.sort_by = SortBy::Mass,
        proto::SortBy::Name => fill.mixture.sort_by = SortBy::Name,
    }
    set(&mut fill.mixture.descending, given.descending);
    set(&mut fill.gaps, given.gaps);
    set(&mut fill.shake, given.shake);
    set(&mut fill.friction, given.friction);
    set(&mut fill.count, given.count.map(|n| Some(counts.natural("fill.count", n))));
    set(&mut fill.max_bodies, given.max_bodies.map(|n| counts.natural("fill.max_bodies", n)));
    set(&mut fill.step, given.step);
    set(&mut fill.round, given.round);
    set(&mut fill.full_below, given.full_below);
    set(&mut fill.growth, given.growth);
    set(&mut fill.settle, given.settle);
    set(&mut fill.protrusion, given.protrusion);
    set(&mut fill.overlap, given.overlap);
    set(&mut fill.residual_overlap, given.residual_overlap);
    set(&mut fill.wall_tolerance, given.wall_tolerance);
    set(&mut fill.shell, given.shell.map(Some));
}

fn release(release: &mut Release, given: &proto::Release) {
    use proto::release::Interval;
    set(&mut release.layer, given.layer);
    set(
        &mut release.interval,
        given.interval.map(|interval| match interval {
            Interval::IntervalNatural(time) => Time::Natural(time),
            Interval::IntervalSeconds(time) => Time::Seconds(time),
        }),
    );
    set(&mut release.damping, given.damping);
    match given.order() {
        proto::ReleaseOrder::Unspecified => {}
        proto::ReleaseOrder::BottomUp => release.order = ReleaseOrder::BottomUp,
        proto::ReleaseOrder::TopDown => release.order = ReleaseOrder::TopDown,
        proto::ReleaseOrder::AtOnce => release.order = ReleaseOrder::AtOnce,
    }
}

fn glue(glue: &mut Glue, given: &proto::Glue, counts: &mut Counts) {
    match given.mode() {
        proto::GlueMode::Unspecified => {}
        proto::GlueMode::Auto => glue.mode = GlueMode::Auto,
        proto::GlueMode::Natural => glue.mode = GlueMode::Natural,
        proto::GlueMode::Tacky => glue.mode = GlueMode::Tacky,
        proto::GlueMode::AsModelled => glue.mode = GlueMode::AsModelled,
    }
    glue.strength = given.strength.or(glue.strength);
    set(&mut glue.friction_factor, given.friction_factor);
    set(&mut glue.normal_price, given.normal_price);
    set(&mut glue.rounds, given.rounds.map(|n| counts.natural("glue.rounds", n)));
    glue.anchor = switch(given.anchor());
    set(&mut glue.breaking, given.breaking);
    glue.proof = switch(given.proof());
}

fn control(control: &mut Control, given: &proto::Control, counts: &mut Counts) {
    use proto::control::Spread as PlacedBody;
    match given.mode() {
        proto::ControlMode::Unspecified => {}
        proto::ControlMode::Off => control.mode = ControlMode::Off,
        proto::ControlMode::Nails => control.mode = ControlMode::Nails,
        proto::ControlMode::Hold => control.mode = ControlMode::Freeze,
    }
    set(&mut control.period, given.period.map(|n| counts.natural("control.period", n)));
    match given.selection() {
        proto::ContactSelection::Unspecified => {}
        proto::ContactSelection::Conservative => control.selection = ContactSelection::Conservative,
        proto::ContactSelection::All => control.selection = ContactSelection::All,
    }
    match given.friction_reserve() {
        proto::FrictionReserve::Unspecified => {}
        proto::FrictionReserve::Paper => control.friction_reserve = FrictionReserve::Paper,
        proto::FrictionReserve::Sharp => control.friction_reserve = FrictionReserve::Sharp,
    }
    match given.friction_cone() {
        proto::FrictionCone::Unspecified => {}
        proto::FrictionCone::Pyramid => control.friction_cone = FrictionCone::Pyramid,
        proto::FrictionCone::Cone => control.friction_cone = FrictionCone::Cone,
    }
    set(&mut control.kinetic_ratio, given.kinetic_ratio);
    set(&mut control.contact_tolerance, given.contact_tolerance);
    set(
        &mut control.spread,
        given.spread.map(|spread| match spread {
            PlacedBody::SpreadRelative(share) => Spread::Relative(share),
            PlacedBody::SpreadArea(area) => Spread::Paper(area),
        }),
    );
    match given.neighbours() {
        proto::Neighbours::Unspecified => {}
        proto::Neighbours::All => control.neighbours = Neighbours::All,
        proto::Neighbours::Either => control.neighbours = Neighbours::Either,
    }
    set(&mut control.speed, given.speed);
    set(&mut control.damping, given.damping);
    set(&mut control.kappa, given.kappa);
    set(&mut control.nails_per_body, given.nails_per_body.map(|n| counts.natural("control.nails_per_body", n)));
    if let Some(stand) = given.stand {
        control.stand = if stand { Switch::On } else { Switch::Off };
    }
}

fn effects(params: &mut Params, given: &proto::Effects) {
    params.physics.switches = PhysicsSwitches {
        primitives: switch(given.primitives()),
        decomposition: switch(given.decomposition()),
        continuous_collision: switch(given.continuous_collision()),
        stiff_contacts: switch(given.stiff_contacts()),
        rolling_resistance: switch(given.rolling_resistance()),
        restitution: switch(given.restitution()),
    };
    params.control.switches = ControlSwitches {
        impact: switch(given.impact()),
        breaking: switch(given.breaking()),
        region: switch(given.region()),
        kept_verdicts: switch(given.kept_verdicts()),
    };
    params.guard = switch(given.guard());
    params.output.keeps_frames = switch(given.frames());
}

fn switch(switch: proto::Switch) -> Switch {
    match switch {
        proto::Switch::Unspecified | proto::Switch::Auto => Switch::Auto,
        proto::Switch::On => Switch::On,
        proto::Switch::Off => Switch::Off,
    }
}

/// When the control ends: its frames are the output's.
fn until(params: &mut Params, scene: &proto::Scene, counts: &mut Counts) {
    use proto::control::Until;
    let control = scene.control.unwrap_or_default();
    match control.until {
        None => {}
        Some(Until::UntilSeconds(seconds)) => params.control.until = Some(seconds),
        Some(Until::UntilFrame(frame)) => {
            let frame: u32 = counts.natural("control.until_frame", frame);
            if f64::from(frame) > added::LAST_FRAME {
                let problem = Problem::new(
                    "control.until_frame",
                    format!("{frame} is out of range"),
                    format!("Give 0 to {}.", added::LAST_FRAME),
                );
                counts.problems.push(problem.of_field("control.until_frame"));
            }
            params.control.until = Some(f64::from(frame) / params.output.fps);
        }
    }
}

fn hold(hold: &mut Hold, given: &proto::Hold) {
    set(&mut hold.patience, given.patience);
    set(&mut hold.least, given.least_seconds);
}

fn output(output: &mut Output, given: &proto::Output, counts: &mut Counts) {
    set(&mut output.fps, given.fps);
    set(&mut output.frames, given.frames.map(|n| Some(counts.natural("output.frames", n))));
    set(&mut output.free_standing, given.free_standing);
    set(&mut output.free_pour, given.free_pour);
}

fn report(report: &mut Figures, given: &proto::Figures) {
    report.shape = switch(given.shape());
    report.pictures = switch(given.pictures());
    report.support = switch(given.support());
}
