//! The core's types -> messages.

pub use crate::parameters::{signed, to_scene as params};
use crate::proto;
use cairn_files::problem::Problem;
use cairn_geometry::thickness::Part;
use cairn_input::observer::{Progress, State};
use cairn_input::params::{Accuracy, Params};
use cairn_prepare::effects::Effect;
use cairn_prepare::estimate::Estimate;
use cairn_prepare::plan::Plan;

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

/// `estimates`: none where the message must not depend on the machine. `params`: the scene's own. `most_bytes`: of the
/// result.
pub fn plan(plan: &Plan, notes: &[String], estimates: &[Estimate], params: &Params, most_bytes: u64) -> proto::Plan {
    let expected = estimates.iter().find(|estimate| estimate.accuracy == params.accuracy);
    let kept = |estimate: &Estimate, n: usize| estimate.kept_shape.map_or(0.0, |kept| kept[n]);
    let estimate = |estimate: &Estimate| proto::Estimate {
        kept_shape_low: kept(estimate, 0),
        kept_shape: kept(estimate, 1),
        kept_shape_high: kept(estimate, 2),
        accuracy: proto::Accuracy::from(estimate.accuracy).into(),
        cpu_seconds: estimate.cpu_seconds,
        factor: estimate.factor,
        overlap_rel: estimate.overlap_rel,
        glue_dots: estimate.glue_dots,
        body_count: signed(estimate.bodies),
        wall_seconds: estimate.wall_seconds(rayon::current_num_threads()),
        overlap: estimate.overlap,
        imbalance: estimate.imbalance,
        shape_error: estimate.shape_error,
        speed_error: estimate.speed_error,
        most_overlap: estimate.most_overlap,
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
        natural_time_seconds: plan.characteristic_time,
        stages: plan.stages.iter().map(|&stage| proto::Stage::from(stage).into()).collect(),
        effects: plan.effects.iter().map(effect).collect(),
        warnings: notes.iter().chain(&plan.warnings).cloned().collect(),
        estimates: estimates.iter().map(estimate).collect(),
        most_result_bytes: signed(most_bytes),
        thin_parts: plan.thin_parts.iter().map(thin_part).collect(),
        fitting_scale: plan.fitting_scale,
        expected_match: plan.expected_match,
    }
}

fn thin_part(part: &Part) -> proto::ThinPart {
    proto::ThinPart {
        center: part.center.to_vec(),
        size: part.size.to_vec(),
        volume_share: part.share,
        thickness: part.thickness,
    }
}

pub fn progress(progress: &Progress, remaining_seconds: Option<f64>) -> proto::Progress {
    proto::Progress {
        stage: proto::Stage::from(progress.stage).into(),
        fraction: progress.fraction,
        body_count: signed(progress.bodies),
        released_count: signed(progress.released),
        at_rest_count: signed(progress.at_rest),
        nail_count: signed(progress.nails),
        remaining_seconds,
        frame_count: signed(progress.frames),
    }
}

/// Every accuracy: `paper`, then the others in ascending order of cost.
pub fn accuracies() -> Vec<Accuracy> {
    [&[Accuracy::Paper], &Accuracy::LADDER[..]].concat()
}

/// Every accuracy with its parameters.
pub fn accuracy_presets() -> Vec<proto::AccuracyPreset> {
    let preset = |of: Accuracy| proto::AccuracyPreset {
        accuracy: proto::Accuracy::from(of).into(),
        parameters: Some(params(&Params::new(of))),
    };
    accuracies().into_iter().map(preset).collect()
}

/// Converts a problem of a scene to a problem of the request that holds the scene.
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

/// The field of a [`proto::FieldProblem`] that is no problem, but a note about the scene's files: often the reason of
/// the problems beside it.
pub const NOTES_FIELD: &str = "notes";

/// Notes beside the problems of a refused scene.
pub fn notes(notes: &[String]) -> impl Iterator<Item = proto::FieldProblem> {
    let field = |note: &String| proto::FieldProblem { field: NOTES_FIELD.into(), description: note.clone() };
    notes.iter().map(field)
}

/// The name of an accuracy in scene files: `standard`.
pub fn accuracy_name(of: Accuracy) -> String {
    proto::Accuracy::from(of).as_str_name().trim_start_matches("ACCURACY_").to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_accuracy_of_the_schema_is_listed() {
        let schema = (1..).map_while(|number| proto::Accuracy::try_from(number).ok());
        assert_eq!(accuracies().len(), schema.filter(|accuracy| *accuracy != proto::Accuracy::Auto).count());
    }
}
