//! The warnings of a report: removed bodies, empty places, bodies not at rest.

use super::inputs::{NamedFigures, ReportInputs};
use crate::measure::ShapeMeasures;
use crate::prepare::container::Container;
use crate::sim::guard;
use crate::sim::step::Simulation;
use crate::stages::fill::{Filled, Removed};
use crate::stages::hold::HoldOutcome;
use crate::world::BodyId;

/// If more of the volume than this lies in pockets, the user is warned.
const MOST_POCKETS: f64 = 0.02;
/// If less of the control mesh than this is filled, the user is warned: half of what random props reach.
const POOR_FILL: f64 = 0.2;

/// Warnings about the container, and about bodies that were removed from it.
pub fn container(inputs: &ReportInputs, container: &Container, filled: &Filled) -> Vec<String> {
    let mut warnings = Vec::new();
    if container.remeshed {
        let spacing = container.distance.spacing() * inputs.plan.prop_diameter;
        warnings.push(format!(
            "{}: filled inside a surface around the union of its parts, sampled every {spacing:.3} m",
            inputs.scene.control.as_ref().map_or("", |model| &model.name)
        ));
    }
    let Removed { sticking_out, overlapping, escaped } = filled.removed;
    for (count, why) in
        [(sticking_out, "stuck out"), (overlapping, "overlapped another"), (escaped, "left the container")]
    {
        if count > 0 {
            warnings.push(match count {
                1 => format!("1 body that {why} was removed after the fill"),
                _ => format!("{count} bodies that {why} were removed after the fill"),
            });
        }
    }
    warnings
}

/// Warnings about the fill.
pub fn fill(inputs: &ReportInputs, filled: &Filled, first: &ShapeMeasures) -> Vec<String> {
    let mut warnings = Vec::new();
    if filled.full && first.fill_fraction < POOR_FILL {
        warnings.push(format!(
            "only {:.0} % of the control mesh could be filled: its parts are narrow for these props; smaller props \
             reach farther",
            100.0 * first.fill_fraction
        ));
    }
    if filled.full && filled.pockets > MOST_POCKETS {
        warnings.push(format!(
            "{:.0} % of the control mesh's volume lies in pockets that the fill did not reach; smaller props{} reach \
             farther",
            100.0 * filled.pockets,
            if inputs.params.fill.method.traits().falls { ", or fill.method = \"insert\"," } else { "" }
        ));
    }
    if filled.shaken.is_some_and(|shaken| shaken.taken_back) {
        warnings.push("shaking made the shape worse and was undone; lower fill.shake, or leave it out".into());
    }
    if !filled.full && inputs.params.fill.count.is_none() {
        warnings.push(format!(
            "the fill stopped at its limit of {} bodies before the control mesh was full; raise fill.max_bodies or use \
             larger props",
            inputs.params.fill.max_bodies
        ));
    }
    warnings
}

/// "1 body" or "2 bodies".
pub fn bodies(count: usize) -> String {
    if count == 1 { "1 body".into() } else { format!("{count} bodies") }
}

/// Warnings about the guard's actions.
fn guard(sim: &Simulation) -> Vec<String> {
    let name = |id: BodyId| format!("{id} ({})", sim.pile.scene.props[sim.pile.instances[id].prop].model.name);
    let actions = &sim.guard.actions;
    let mut warnings = guard::describe_aside(&actions.aside, name);
    warnings.iter_mut().for_each(|text| text.push_str(" and were set aside"));
    if actions.retries > 0 {
        warnings.push(format!("{} steps gained energy or speed and were repeated in smaller ones", actions.retries));
    }
    let deep = if actions.sinks { sim.guard.still_deep(&sim.pile.world) } else { 0 };
    if deep > 0 {
        let pairs =
            if deep == 1 { "1 pair of bodies overlaps".into() } else { format!("{deep} pairs of bodies overlap") };
        let even = if actions.stiffened > 0 { ", even with stiffer contacts" } else { "" };
        warnings.push(format!("{pairs} by more than half of the thinner one's thickness in the end{even}"));
    }
    warnings
}

/// Warnings about the end of the bake.
pub fn end(sim: &Simulation, held: HoldOutcome, measures: &NamedFigures) -> Vec<String> {
    let mut warnings = Vec::new();
    if !held.at_rest {
        warnings.push("the pile was still moving at the last frame; bake more frames, or raise hold.patience".into());
    }
    if sim.fallen > 0 {
        let bodies = bodies(sim.fallen);
        warnings.push(format!("{bodies} fell past the scenery and were set aside: there is no ground"));
    }
    warnings.extend(guard(sim));
    if let Some(Some(hanging)) = measures.get("hanging")
        && *hanging > 0.0
    {
        let rest = if *hanging == 1.0 { "1 body rests".into() } else { format!("{hanging} bodies rest") };
        warnings.push(format!("{rest} without a chain of contacts down to the ground"));
    }
    warnings
}
