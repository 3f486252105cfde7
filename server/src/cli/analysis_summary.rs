//! The answers of an analysis as text.

use super::table;
use cairn_analysis::{AnalysedBody, NeededDot, Nudge, PileAnalysis, Standing};
use cairn_export::analysis::FoundPile;

/// The answers as text: the whole, then the bodies that carry most.
pub fn text(pile: &FoundPile, found: &PileAnalysis, top: usize) -> String {
    let name = |body: &usize| pile.bodies[*body].name.as_str();
    let names = |list: &[usize]| {
        let more = list.len().saturating_sub(LISTED);
        let listed = list.iter().take(LISTED).map(name).collect::<Vec<_>>().join(", ");
        if more > 0 { format!("{listed} and {more} more") } else { listed }
    };
    let count = found.bodies.len();
    let falling: Vec<usize> = (0..count).filter(|&body| found.bodies[body].standing.falls()).collect();
    let mut lines = vec![match falling.is_empty() {
        true => format!("{count} bodies, {} touches: all stand", found.touches.len()),
        false => {
            format!("{count} bodies, {} touches: {} fall: {}", found.touches.len(), falling.len(), names(&falling))
        }
    }];
    lines.push(format!("proof: forces that leave {:.1e} of a body's weight unbalanced in all", found.imbalance));
    if let Some(whole) = &found.whole {
        let range = |[low, high]: [f64; 2], digits: usize| match high - low < 2.0 * 0.1_f64.powi(digits as i32) {
            true => format!("{high:.digits$}"),
            false => format!("{low:.digits$} to {high:.digits$}"),
        };
        lines.push(format!(
            "goes at a tilt of {} degrees toward azimuth {:.0}, or a shake of {} g; first: {}",
            range(whole.tilt, 1),
            whole.azimuth,
            range(whole.shake, 3),
            names(&whole.goes_first)
        ));
        lines.push(format!("needs {} of its friction", range(whole.friction, 3)));
        if let Some(knock) = &whole.knock_over {
            lines.push(format!(
                "least push that brings it down: {:.2} of the weight of {} ({:.3} N) toward azimuth {:.0}; {} come \
                 down: {}",
                knock.push[1],
                name(&knock.body),
                knock.force,
                knock.azimuth,
                knock.comes_down.len(),
                names(&knock.comes_down)
            ));
        }
        if let Some(weakest) = &whole.weakest {
            lines.push(format!("weakest point: {}", name(weakest)));
        }
    }
    let removals = || found.bodies.iter().filter_map(|body| body.removal.as_ref());
    let safe = removals().filter(|removal| removal.is_safe).count();
    let open = removals().filter(|removal| removal.is_open).count();
    lines.push(format!("safe to remove: {safe} of {}; not proven either way: {open}", removals().count()));
    lines.push(match found.stuck.is_empty() {
        true => format!("comes apart in the order: {}", names(&found.order)),
        false => format!(
            "comes apart in the order: {}; no next step was found for the last {}: {}",
            names(&found.order),
            found.stuck.len(),
            names(&found.stuck)
        ),
    });
    if !found.glue.is_empty() {
        let dot = |dot: &NeededDot| {
            let other = dot.other.as_ref().map_or("the ground", |other| name(other));
            format!("{} to {other} ({:.3} N)", name(&dot.body), dot.force)
        };
        let dots: Vec<String> = found.glue.iter().map(dot).collect();
        lines.push(format!("stands with {} dots of glue: {}", dots.len(), dots.join(", ")));
    }
    if !found.beyond_glue.is_empty() {
        lines.push(format!("touch nothing that is held: {}", names(&found.beyond_glue)));
    }
    if !found.nudges.is_empty() {
        let move_of = |nudge: &Nudge| {
            let [x, y, z] = nudge.by.map(|along| format!("{:.1}", 1000.0 * along));
            format!("{} by ({x}, {y}, {z}) mm", name(&nudge.body))
        };
        let moves: Vec<String> = found.nudges.iter().take(LISTED).map(move_of).collect();
        let more = found.nudges.len() - moves.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        lines.push(match found.beyond_nudges.is_empty() {
            true => format!("or stands without glue once moved: {}{more}", moves.join(", ")),
            false => {
                let fall = names(&found.beyond_nudges);
                format!("fewer fall once moved: {}{more}; still fall: {fall}", moves.join(", "))
            }
        });
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| found.bodies[b].load.total_cmp(&found.bodies[a].load).then(a.cmp(&b)));
    let header = ["body", "stands", "load N", "load/weight", "rest on it", "friction", "push", "tilt", "remove"];
    let row = |&body: &usize| row(name(&body), &found.bodies[body]);
    let rows = table(header.map(str::to_owned).to_vec(), order.iter().take(top).map(row));
    lines.join("\n") + "\n\n" + &rows
}

/// Names in a list of the summary.
const LISTED: usize = 8;

fn row(name: &str, body: &AnalysedBody) -> Vec<String> {
    let number = |figure: Option<f64>| figure.map_or("-".to_owned(), |figure| format!("{figure:.3}"));
    let standing = match body.standing {
        Standing::Stands => "yes",
        Standing::Pinned => "pinned",
        Standing::FallsAlone => "falls",
        Standing::FallsWithOthers => "falls with others",
    };
    let removal = match &body.removal {
        Some(removal) if removal.is_safe => "safe".to_owned(),
        Some(removal) if removal.is_open => "open".to_owned(),
        Some(removal) => format!("{} fall", removal.moving.len()),
        None => "-".to_owned(),
    };
    vec![
        name.to_owned(),
        standing.to_owned(),
        format!("{:.3}", body.load),
        format!("{:.2}", body.load_in_weights),
        body.rests_on_it.len().to_string(),
        number(body.least_friction),
        number(body.least_push),
        body.least_tilt.map_or("-".to_owned(), |tilt| format!("{tilt:.1}")),
        removal,
    ]
}
