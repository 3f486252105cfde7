//! Warnings about figures that are bad by themselves, whatever the scene is: each with its limit and a remedy.

use super::inputs::NamedFigures;

/// From where on a figure is bad.
#[derive(Clone, Copy)]
enum Limit {
    Above(f64),
    Below(f64),
}
use Limit::{Above, Below};

/// How a figure is shown.
type Shown = fn(f64) -> String;

fn percent(value: f64) -> String {
    format!("{:.0} %", 100.0 * value)
}

fn plain(value: f64) -> String {
    format!("{value:.2}")
}

fn whole(value: f64) -> String {
    format!("{value:.0}")
}

/// Figure, limit, and what is said of it; `{}` is its value. The guide's page of measures states each limit.
const LIMITS: [(&str, Limit, Shown, &str); 14] = [
    (
        "foot_load",
        Above(300.0),
        whole,
        "few bodies carry the pile: {} for each at the ground; this looks wrong: cut the shape lower, raise \
         base.height, or use smaller props",
    ),
    (
        "ground_pull_rel",
        Above(0.1),
        plain,
        "glue at the ground pulls the pile down with {} of its weight, so that it does not tip over: this \
         looks wrong; widen the foot, or put it below the middle of the shape",
    ),
    (
        "stayed_fraction",
        Below(0.95),
        percent,
        "only {} of the bodies that nothing new is near kept their places: the others lean on what is new; a smaller \
         from.reach exchanges less of it, and glue holds more (glue.mode)",
    ),
    (
        "kept_shape",
        Below(0.7),
        percent,
        "the pile has slumped: {} of its shape is kept; glue keeps any shape (glue.mode), and holds better with \
         more accuracy; more friction or a wider foot keep more, too",
    ),
    (
        "protrusion_rel",
        Above(1.0),
        plain,
        "bodies stick out of the shape by {} times a prop's size; raise fill.surface, or use smaller props",
    ),
    (
        "ballistic_error_max",
        Above(0.1),
        percent,
        "a body that touched nothing fell by {} otherwise than gravity asks for; use more accuracy",
    ),
    (
        "second_collapse",
        Above(0.5),
        whole,
        "bodies had stood, and fell untouched later ({}); bake more frames, or use more accuracy",
    ),
    (
        "hanging_frames",
        Above(0.5),
        whole,
        "bodies stood still in the air for a moment ({} in all frames); use more accuracy, or release.order = at_once",
    ),
    (
        "energy_growth_rel",
        Above(0.01),
        plain,
        "the pile gained energy that nothing gave, {} times its weight and a prop's size; use more accuracy",
    ),
    (
        "drift_p95_rel",
        Above(0.5),
        plain,
        "the pile flowed while it was held: by {} times a prop's size (95 of 100); raise control.speed or friction, or \
         let glue hold it (glue.mode)",
    ),
    (
        "creep_max_rel",
        Above(0.25),
        plain,
        "a body crept by {} times a prop's size after all had come to rest; use more accuracy",
    ),
    (
        "visible_depth_p95_rel",
        Above(0.1),
        plain,
        "meshes cut each other by up to {} of a thickness (95 of 100); use more accuracy, or fewer bodies (fill.count)",
    ),
    (
        "visible_depth_max_rel",
        Above(1.0),
        plain,
        "the meshes of two bodies cut each other by {} times a thickness: one is squeezed through the other; use more \
         accuracy, or fewer bodies (fill.count)",
    ),
    (
        "penetration_max_rel",
        Above(0.5),
        plain,
        "two collision shapes overlap by {} times a thickness; use more accuracy, or fewer bodies (fill.count)",
    ),
];

/// The warnings of these figures.
pub fn warnings(figures: &NamedFigures) -> Vec<String> {
    let said = |&(name, limit, shown, text): &(&str, Limit, Shown, &str)| {
        let value = figures.get(name).copied().flatten()?;
        let is_bad = match limit {
            Above(most) => value > most,
            Below(least) => value < least,
        };
        is_bad.then(|| text.replacen("{}", &shown(value), 1))
    };
    LIMITS.iter().filter_map(said).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::says_only;

    /// Each figure beyond its limit is said, alone; at its limit, nothing is.
    #[test]
    fn each_figure_has_a_warning_from_its_limit_on() {
        let at_limits: NamedFigures =
            LIMITS.iter().map(|(name, Above(at) | Below(at), ..)| (*name, Some(*at))).collect();
        says_only("when all is well", &warnings(&at_limits), &[]);
        assert!(warnings(&at_limits.keys().map(|name| (*name, None)).collect()).is_empty());
        let cases = [
            (
                "when few carry the pile",
                "foot_load",
                412.0,
                "few bodies carry the pile: 412 for each at the ground; this looks wrong: cut the shape \
                 lower, raise base.height, or use smaller props",
            ),
            (
                "when the pile would tip over",
                "ground_pull_rel",
                0.4,
                "glue at the ground pulls the pile down with 0.40 of its weight, so that it does not tip over: \
                 this looks wrong; widen the foot, or put it below the middle of the shape",
            ),
            (
                "when the pile has slumped",
                "kept_shape",
                0.182,
                "the pile has slumped: 18 % of its shape is kept; glue keeps any shape (glue.mode), and holds \
                 better with more accuracy; more friction or a wider foot keep more, too",
            ),
            (
                "when kept bodies move",
                "stayed_fraction",
                0.8,
                "only 80 % of the bodies that nothing new is near kept their places: the others lean on what is new; a \
                 smaller from.reach exchanges less of it, and glue holds more (glue.mode)",
            ),
            (
                "when bodies stick out",
                "protrusion_rel",
                1.4,
                "bodies stick out of the shape by 1.40 times a prop's size; raise fill.surface, or use smaller \
                 props",
            ),
            (
                "when a fall is no fall",
                "ballistic_error_max",
                0.25,
                "a body that touched nothing fell by 25 % otherwise than gravity asks for; use more accuracy",
            ),
            (
                "when bodies fall later",
                "second_collapse",
                3.0,
                "bodies had stood, and fell untouched later (3); bake more frames, or use more accuracy",
            ),
            (
                "when bodies stand in the air",
                "hanging_frames",
                12.0,
                "bodies stood still in the air for a moment (12 in all frames); use more accuracy, or release.order \
                 = at_once",
            ),
            (
                "when energy comes from nothing",
                "energy_growth_rel",
                0.05,
                "the pile gained energy that nothing gave, 0.05 times its weight and a prop's size; use more \
                 accuracy",
            ),
            (
                "when the pile flows",
                "drift_p95_rel",
                0.8,
                "the pile flowed while it was held: by 0.80 times a prop's size (95 of 100); raise control.speed or \
                 friction, or let glue hold it (glue.mode)",
            ),
            (
                "when a body creeps",
                "creep_max_rel",
                0.4,
                "a body crept by 0.40 times a prop's size after all had come to rest; use more accuracy",
            ),
            (
                "when meshes cut each other",
                "visible_depth_p95_rel",
                0.4,
                "meshes cut each other by up to 0.40 of a thickness (95 of 100); use more accuracy, or fewer bodies \
                 (fill.count)",
            ),
            (
                "when a body is squeezed through another",
                "visible_depth_max_rel",
                56.0,
                "the meshes of two bodies cut each other by 56.00 times a thickness: one is squeezed through the \
                 other; use more accuracy, or fewer bodies (fill.count)",
            ),
            (
                "when collision shapes overlap",
                "penetration_max_rel",
                0.9,
                "two collision shapes overlap by 0.90 times a thickness; use more accuracy, or fewer bodies \
                 (fill.count)",
            ),
        ];
        for (case, name, beyond, words) in cases {
            let figures = at_limits.iter().map(|(at, value)| (*at, if *at == name { Some(beyond) } else { *value }));
            says_only(case, &warnings(&figures.collect()), &[words]);
        }
        assert!(LIMITS.iter().all(|limit| cases.iter().any(|case| case.1 == limit.0)));
    }

    /// The guide's rows state these limits, and every other figure there has another warning or a reason.
    #[test]
    fn the_guide_states_each_limit() {
        let page = include_str!("../../../../examples/guide/measures.md");
        let mut missing = Vec::new();
        for row in page.lines().take_while(|line| !line.starts_with("| count ")).filter(|line| line.starts_with("| `"))
        {
            let (names, rest) = row[2..].split_once(" | ").unwrap();
            let good = rest.trim_end_matches(" |").rsplit(" | ").next().unwrap();
            for name in names.split('`').skip(1).step_by(2) {
                match LIMITS.iter().find(|limit| limit.0 == name) {
                    Some((_, Above(at), ..)) if *at == 0.5 && good.starts_with("0") => {}
                    Some((_, limit, ..)) => {
                        let words = match limit {
                            Above(at) => format!("a warning above {at}"),
                            Below(at) => format!("a warning below {at}"),
                        };
                        if !good.contains(&words) {
                            missing.push(format!("{name}: {words}"));
                        }
                    }
                    None if good.contains("a warning") => missing.push(format!("{name} has no warning")),
                    None if NONE.iter().any(|(one, _)| *one == name) => {}
                    None => missing.push(format!("{name}: a limit, or a reason why there is none")),
                }
            }
        }
        assert!(missing.is_empty(), "{missing:#?}");
        assert!(NONE.iter().all(|(name, _)| page.contains(&format!("`{name}`"))));
    }

    const SAID: &str = "has a warning of its own subject";
    const SAME: &str = "another figure of the same thing has one";
    const SCENE: &str = "what is good depends on the scene";
    const ASKED: &str = "is measured on request, to be read by whoever asks";
    const COST: &str = "says what a bake costs, not how good it is";

    /// Figures without a limit of their own, and why.
    const NONE: [(&str, &str); 76] = [
        ("shape_iou", SAID),
        ("shape_iou_start", SAME),
        ("shape_iou_after", SAME),
        ("shape_iou_solid", SCENE),
        ("silhouette_iou", SAME),
        ("silhouette_iou_start", SAME),
        ("silhouette_iou_after", SAME),
        ("height_p95_rel", SAME),
        ("height_p95_rel_start", SAME),
        ("height_p95_rel_after", SAME),
        ("height_p95_rel_solid", SCENE),
        ("height_rms_rel", SCENE),
        ("inside_fraction", SAME),
        ("prop_diameter", SCENE),
        ("fill_fraction", SAID),
        ("free_pour_fraction", SCENE),
        ("flat_share", SCENE),
        ("aligned_share", SCENE),
        ("bonded_share", SCENE),
        ("pocket_fraction", SAID),
        ("wall_deviation_rel", SCENE),
        ("moving", SAID),
        ("resting_speed_max", SAME),
        ("resting_speed_max_rel", SAME),
        ("kinetic_energy_rel", SAME),
        ("rest_seconds", SCENE),
        ("active_body_share", COST),
        ("stack_drift_rel", SCENE),
        ("fallen_fraction", SCENE),
        ("entrance_guided_impulse", SAID),
        ("entrance_held_impulse", SAME),
        ("entrance_cut_max_rel", SAID),
        ("entrance_ballistic_error_max", SAME),
        ("entrance_energy_growth_rel", SAME),
        ("entrance_seconds", SCENE),
        ("visible_cut_share", SAME),
        ("visible_depth_mean_rel", SAME),
        ("visible_gap_p95_rel", SCENE),
        ("visible_depth_p95", SAME),
        ("visible_gap_p95", SAME),
        ("separation_max_rel", SCENE),
        ("penetration_p95_rel", SAME),
        ("penetration_mean_rel", SAME),
        ("scenery_penetration_max_rel", SAID),
        ("scenery_penetration_mean_rel", SAID),
        ("hanging", SAID),
        ("hanging_visible", SAID),
        ("unsupported_fraction", SCENE),
        ("touches", SCENE),
        ("glue_dots_least", SCENE),
        ("glued_touch_fraction", SAID),
        ("glued_body_fraction", SCENE),
        ("glue_cluster_max", SCENE),
        ("anchored", SAID),
        ("glue_force_max", SCENE),
        ("glue_force_p50", SCENE),
        ("glue_moment_max", SCENE),
        ("glue_normal_price", SCENE),
        ("glue_imbalance", SAME),
        ("moved_freed", SAID),
        ("sag_freed", SAME),
        ("moved_tilted", SAME),
        ("kept_shape_freed", SAME),
        ("kept_shape_natural", SCENE),
        ("free_standing_fraction", SCENE),
        ("control_overhead", COST),
        ("analysis_us_per_body", COST),
        ("nails_peak", COST),
        ("nails_end", SCENE),
        ("nails_broken", COST),
        ("nail_load_max", COST),
        ("equilibrium_residual_max", ASKED),
        ("equilibrium_residual_p95", ASKED),
        ("friction_violation_max", ASKED),
        ("friction_violation_mean", ASKED),
        ("energy_gain_rel", ASKED),
    ];
}
