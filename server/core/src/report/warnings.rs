//! The warnings of a report: removed bodies, empty places, bodies not at rest. Long: its tests hold each against its
//! cause and what looks alike.

use super::contacts::{self, Cut, InScenery};
use super::inputs::{NamedFigures, ReportInputs};
use crate::fill::{Filled, Removed, Shaken};
use crate::separate::Separation;
use cairn_engine::shape::{Size, corners};
use cairn_engine::world::BodyId;
use cairn_geometry::measure::ShapeMeasures;
use cairn_geometry::thickness::{Part, describe_parts};
use cairn_input::error::counted;
use cairn_motion::guard;
use cairn_motion::hold::HoldOutcome;
use cairn_motion::step::Simulation;
use cairn_prepare::check::FLOATING;
use cairn_prepare::container::Container;

/// If more of the volume than this lies in pockets, the user is warned.
const MOST_POCKETS: f64 = 0.02;
/// If the props, by their outlines, fill less of the control mesh than this, the user is warned: half of what random
/// props reach.
const POOR_FILL: f64 = 0.2;
/// A shape that a pile matches at least so far is filled, however much air its props enclose.
const HALF: f64 = 0.5;
/// A container whose surfaces are nearer to each other than two props are thick is narrow.
const NARROW: f64 = 1.0;

/// Warnings about the container, and about bodies that were removed from it.
pub fn container(inputs: &ReportInputs, container: &Container, filled: &Filled) -> Vec<String> {
    let mut warnings = Vec::new();
    if container.remeshed && inputs.scene.piles.is_empty() {
        let spacing = container.distance.spacing() * inputs.plan.prop_diameter;
        warnings.push(format!(
            "{}: filled inside a surface around the union of its parts, sampled every {spacing:.3} m",
            inputs.scene.control.as_ref().map_or("", |model| &model.name)
        ));
    }
    warnings.extend(removed(&filled.removed));
    warnings
}

/// Warnings about bodies that the fill took out.
fn removed(removed: &Removed) -> Vec<String> {
    let Removed { sticking_out, overlapping, escaped, cutting } = *removed;
    let reasons = [
        (sticking_out, "stuck out"),
        (overlapping, "overlapped another"),
        (escaped, "left the container"),
        (cutting, "reached into scenery"),
    ];
    let sentence = |(count, why): (usize, &str)| {
        let were = if count == 1 { "was" } else { "were" };
        format!("{} that {why} {were} removed after the fill", bodies(count))
    };
    reasons.into_iter().filter(|reason| reason.0 > 0).map(sentence).collect()
}

/// Warnings about the fill.
pub fn fill(inputs: &ReportInputs, container: &Container, filled: &Filled, first: &ShapeMeasures) -> Vec<String> {
    let mut warnings = Vec::new();
    let floats =
        inputs.target.is_some_and(|mesh| mesh.bounds().0.y - inputs.ground > FLOATING * inputs.plan.prop_diameter);
    // A pile that fell before frame 0 is not where it was filled.
    let is_poor = first.fill_fraction * outline_share(inputs) < POOR_FILL && first.shape_iou.value < HALF;
    if filled.full && is_poor && !floats {
        let protrusion = inputs.params.fill.protrusion;
        let cause = poor_fill(&filled.removed, filled.bodies.len(), protrusion, crowding(inputs, container));
        warnings.push(format!("only {:.0} % of the control mesh could be filled{cause}", 100.0 * first.fill_fraction));
    }
    if filled.full && filled.pockets > MOST_POCKETS {
        warnings.push(format!(
            "{:.0} % of the control mesh's volume lies in pockets that the fill did not reach; smaller props{} reach \
             farther",
            100.0 * filled.pockets,
            if inputs.params.fill.method.traits().falls { ", or fill.method = \"insert\"," } else { "" }
        ));
    }
    warnings.extend(shaken(filled.shaken.as_ref()));
    if !filled.full && inputs.params.fill.count.is_none() {
        warnings.push(format!(
            "the fill stopped at its limit of {} bodies before the control mesh was full; raise fill.max_bodies or use \
             larger props",
            inputs.params.fill.max_bodies
        ));
    }
    warnings
}

/// A warning about parts of the control mesh that are empty. `shape_iou`: the match with the control mesh, as filled.
pub fn empty_parts(parts: &[Part], shape_iou: f64) -> Option<String> {
    let share: f64 = parts.iter().map(|part| part.share).sum();
    let are = counted(parts.len(), "part is", "parts are");
    let (places, shape_iou) = (describe_parts(parts), 100.0 * shape_iou);
    (!parts.is_empty()).then(|| {
        format!(
            "as filled, the pile matches {shape_iou:.0} % of the shape as drawn: {are} empty, {:.0} % of its volume: \
             {places}; smaller props reach farther (`cairn plan` names a size)",
            100.0 * share
        )
    })
}

/// A warning about shaking that did harm.
fn shaken(shaken: Option<&Shaken>) -> Option<String> {
    let text = "shaking made the shape worse and was undone; lower fill.shake, or leave it out";
    shaken.is_some_and(|shaken| shaken.taken_back).then(|| text.into())
}

/// Why little of the control mesh is filled, and what helps. `left`: bodies that were not removed.
fn poor_fill(removed: &Removed, left: usize, protrusion: f64, crowding: f64) -> String {
    let Removed { sticking_out, overlapping, escaped, cutting } = *removed;
    let all = sticking_out + overlapping + escaped + cutting;
    if all > left {
        let remedy = if sticking_out >= overlapping.max(escaped) {
            format!("raise fill.protrusion (it is {protrusion})")
        } else {
            "use more accuracy, or props of a simpler shape".into()
        };
        return format!(": {all} of {} bodies were removed again; {remedy}", all + left);
    }
    let text = if crowding > NARROW {
        ": its parts are narrow for these props; smaller props reach farther"
    } else {
        "; a lower fill.full_below goes on for longer, and fill.method = \"pour\" packs some props better"
    };
    text.to_owned()
}

/// Volume of the bodies' convex hulls over their own: 1 for solid ones, more for hollow ones, which fill a shape
/// although they have little volume.
fn outline_share(inputs: &ReportInputs) -> f64 {
    let volume = |of: fn(&Size) -> f64| -> f64 {
        inputs.pile.bodies.iter().map(|body| of(&inputs.shapes[body.prop].size) * body.scale.powi(3)).sum()
    };
    let own = volume(|size| size.volume);
    if own > 0.0 { volume(|size| size.hull_volume) / own } else { 1.0 }
}

/// Share of the container that is within a prop's thickness of its surface; above 1 where the surfaces are nearer to
/// each other.
fn crowding(inputs: &ReportInputs, container: &Container) -> f64 {
    let thickness = inputs.pile.bodies.iter().map(|body| inputs.shapes[body.prop].size.extents.x * body.scale);
    let mean = thickness.sum::<f64>() / inputs.pile.bodies.len().max(1) as f64;
    mean / inputs.plan.prop_diameter * container.area / container.volume
}

/// "1 body" or "2 bodies".
pub fn bodies(count: usize) -> String {
    counted(count, "body", "bodies")
}

/// What the guard did, and what it left.
#[derive(Default)]
struct Guarded {
    /// Sentences about the bodies that it set aside.
    aside: Vec<String>,
    retries: u64,
    stiffened: bool,
    /// Pairs of bodies that are still deep in each other.
    deep: usize,
}

impl Guarded {
    fn of(sim: &Simulation) -> Guarded {
        let name = |id: BodyId| format!("{id} ({})", sim.pile.scene.props[sim.pile.instances[id].prop].model.name);
        let actions = &sim.guard.actions;
        Guarded {
            aside: guard::describe_aside(&actions.aside, name),
            retries: actions.retries,
            stiffened: actions.stiffened > 0,
            deep: if actions.sinks { sim.guard.still_deep(&sim.pile.world) } else { 0 },
        }
    }

    fn warnings(self) -> Vec<String> {
        let mut warnings: Vec<String> = self.aside.iter().map(|text| format!("{text}: set aside")).collect();
        if self.retries > 0 {
            let were = if self.retries == 1 { "was" } else { "were" };
            let steps = counted(self.retries as usize, "step", "steps");
            warnings.push(format!("{steps} gained energy or speed and {were} repeated in smaller ones"));
        }
        if self.deep > 0 {
            let pairs = counted(self.deep, "pair of bodies overlaps", "pairs of bodies overlap");
            let even = if self.stiffened { ", even with stiffer contacts" } else { "" };
            warnings.push(format!("{pairs} by more than half of the thinner one's thickness in the end{even}"));
        }
        warnings
    }
}

/// Warnings about bodies that cut scenery in the end.
pub fn cuts(inputs: &ReportInputs, sim: &Simulation) -> Vec<String> {
    let world = &sim.pile.world;
    // As the container knows the scenery, nothing of it has moved yet.
    let still = inputs.scene.statics.iter().all(|model| model.keys.is_empty());
    let container = inputs.filled.map(|(container, _)| container).filter(|of| still && !of.scenery().is_empty());
    let in_scenery = |id: BodyId| {
        let (Some(container), body) = (container, &world.bodies()[id]) else { return InScenery::default() };
        let (shape, size, pose) = (&inputs.shapes[body.prop], body.scale / world.units.length, world.pose(id));
        InScenery {
            buried: corners(shape, size, &pose).map(|p| container.depth_in_scenery(p)).fold(0.0, f64::max),
            pierced: container.pierced(shape, size, &pose),
        }
    };
    let cuts = contacts::cuts(world, in_scenery);
    let cut = |cut: &Cut| {
        let mut of_kind = inputs.scene.statics.iter().filter(|model| model.keys.is_empty() != cut.moves);
        let name = of_kind.nth(cut.piece).map_or("the scenery", |model| &model.model.name);
        let body = counted(cut.bodies, "body cuts", "bodies cut");
        let remedy = match cut.moves {
            true => "move it more slowly, or give it more thickness",
            false => "use more accuracy, or smaller props, or give the scenery more thickness",
        };
        format!("{body} {name}, by up to {:.4} m; {remedy}", cut.depth * world.units.length)
    };
    cuts.iter().map(cut).collect()
}

/// The warning about meshes that still cut each other, where none should.
pub fn separation(found: Separation) -> Option<String> {
    let pairs = counted(found.cut as usize, "pair of meshes cuts", "pairs of meshes cut");
    let remedy = match found.left {
        true => "the pile did not rest before the last frame: bake more frames",
        false => {
            "they would have to move by more than a quarter of their thickness: use a smaller \
             physics.shape_tolerance, or more physics.max_parts"
        }
    };
    (found.cut > 0).then(|| format!("{pairs} each other in the end (hold.separate); {remedy}"))
}

/// Warnings about the end of the bake.
pub fn end(sim: &Simulation, held: HoldOutcome, measures: &NamedFigures) -> Vec<String> {
    let hanging = measures.get("hanging").copied().flatten().unwrap_or(0.0) as usize;
    let mut warnings = rest(held);
    warnings.extend(fallen(sim.fallen));
    warnings.extend(Guarded::of(sim).warnings());
    warnings.extend(unsupported(hanging));
    warnings.extend(floating(measures.get("hanging_visible").copied().flatten().unwrap_or(0.0) as usize));
    warnings
}

/// Warnings about a pile that is not at rest.
fn rest(held: HoldOutcome) -> Vec<String> {
    if held.at_rest {
        return Vec::new();
    }
    let text = match held.moving {
        0 => "no body moved at the last frame, but the pile had not been still for long enough to count as at rest; \
              bake more frames"
            .into(),
        moving => {
            let moved = counted(moving, "body was", "bodies were");
            format!("{moved} still moving at the last frame; bake more frames, or raise hold.patience")
        }
    };
    vec![text]
}

fn fallen(count: usize) -> Option<String> {
    let fell = bodies(count);
    let were = if count == 1 { "was" } else { "were" };
    (count > 0).then(|| format!("{fell} fell past the scenery and {were} set aside: there is no ground"))
}

fn unsupported(count: usize) -> Option<String> {
    let rest = counted(count, "body rests", "bodies rest");
    (count > 0).then(|| format!("{rest} without a chain of contacts down to the ground"))
}

fn floating(count: usize) -> Option<String> {
    let hang = counted(count, "body hangs", "bodies hang");
    (count > 0).then(|| {
        format!(
            "{hang} in the air to the eye: no chain of meshes that touch leads from there to what stands; smaller \
             props fill thin parts, and more accuracy leaves smaller gaps"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::{
        Guarded, HoldOutcome, Removed, Shaken, fallen, floating, poor_fill, removed, rest, separation, shaken,
        unsupported,
    };
    use crate::separate::Separation;
    use crate::testing::says_only;
    use cairn_motion::guard::{AsideReason, describe_aside};

    /// Each remedy is that of its cause.
    #[test]
    fn a_poor_fill_has_the_cause_that_it_has() {
        let none = Removed::default();
        let out = Removed { sticking_out: 90, overlapping: 3, escaped: 1, cutting: 0 };
        let deep = Removed { sticking_out: 3, overlapping: 90, escaped: 1, cutting: 0 };
        for (case, removed, left, crowding, words, remedy) in [
            ("when its parts are narrow", none, 50, 2.0, "its parts are narrow for these props", ""),
            (
                "when the fill ended early",
                none,
                50,
                0.5,
                "; a lower fill.full_below goes on for longer, and fill.method = \"pour\" packs some props better",
                "",
            ),
            (
                "when most stuck out",
                out,
                50,
                2.0,
                "94 of 144 bodies were removed again; ",
                "raise fill.protrusion (it is 0)",
            ),
            (
                "when most overlapped",
                deep,
                50,
                0.5,
                "94 of 144 bodies were removed again; ",
                "use more accuracy, or props of a simpler shape",
            ),
            ("when few of many stuck out", out, 500, 2.0, "its parts are narrow for these props", ""),
        ] {
            let text = poor_fill(&removed, left, 0.0, crowding);
            assert!(text.contains(remedy), "{case}: {text}");
            says_only(case, &[text], &[words]);
        }
    }

    #[test]
    fn each_warning_of_the_fill_has_its_cause() {
        let none = Removed::default();
        let back = |taken_back: bool| Some(Shaken { steps: 9, taken_back });
        for (case, taken, shake, words) in [
            ("when nothing was removed", none, None, &[] as &[&str]),
            (
                "when bodies stuck out",
                Removed { sticking_out: 2, ..none },
                None,
                &["2 bodies that stuck out were removed after the fill"],
            ),
            (
                "when one body overlapped",
                Removed { overlapping: 1, ..none },
                None,
                &["1 body that overlapped another was removed after the fill"],
            ),
            (
                "when bodies overlapped",
                Removed { overlapping: 2, ..none },
                None,
                &["2 bodies that overlapped another were removed after the fill"],
            ),
            (
                "when bodies left the container",
                Removed { escaped: 3, ..none },
                None,
                &["3 bodies that left the container were removed after the fill"],
            ),
            (
                "when bodies reached into scenery",
                Removed { cutting: 2, ..none },
                None,
                &["2 bodies that reached into scenery were removed after the fill"],
            ),
            ("when shaking helped", none, back(false), &[]),
            (
                "when shaking did harm",
                none,
                back(true),
                &["shaking made the shape worse and was undone; lower fill.shake, or leave it out"],
            ),
        ] {
            let said: Vec<String> = removed(&taken).into_iter().chain(shaken(shake.as_ref())).collect();
            says_only(case, &said, words);
        }
    }

    #[test]
    fn each_warning_about_visible_meshes_has_its_cause() {
        let done = Separation { pairs: 9, moved: 2, farthest: 0.001, ..Separation::default() };
        for (case, found, words) in [
            ("when none cuts another", done, &[] as &[&str]),
            (
                "when the pile moved to the end",
                Separation { cut: 2, left: true, ..done },
                &["2 pairs of meshes cut each other in the end (hold.separate); the pile did not rest before the \
                   last frame: bake more frames"],
            ),
            (
                "when some are hooked",
                Separation { cut: 2, ..done },
                &["2 pairs of meshes cut each other in the end (hold.separate); they would have to move by more \
                   than a quarter of their thickness: use a smaller physics.shape_tolerance, or more \
                   physics.max_parts"],
            ),
        ] {
            says_only(case, &separation(found).into_iter().collect::<Vec<_>>(), words);
        }
    }

    #[test]
    fn each_warning_of_the_end_has_its_cause() {
        let still = HoldOutcome { at_rest: true, moving: 0, resting_speed_max: 0.0, rest: None };
        let aside = |why: AsideReason| Guarded {
            aside: describe_aside(&[(4, why), (6, why)], |id| format!("{id} (brick)")),
            ..Guarded::default()
        };
        let none = Guarded::default;
        for (case, held, fell, guarded, [hanging, floating_bodies], words) in [
            ("when all is well", still, 0, none(), [0, 0], &[] as &[&str]),
            (
                "when bodies still move",
                HoldOutcome { at_rest: false, moving: 2, ..still },
                0,
                none(),
                [0, 0],
                &["2 bodies were still moving at the last frame; bake more frames, or raise hold.patience"],
            ),
            (
                "when it was not still for long enough",
                HoldOutcome { at_rest: false, ..still },
                0,
                none(),
                [0, 0],
                &["no body moved at the last frame, but the pile had not been still for long enough"],
            ),
            (
                "when bodies fell past the scenery",
                still,
                2,
                none(),
                [0, 0],
                &["2 bodies fell past the scenery and were set aside: there is no ground"],
            ),
            (
                "when numbers ran out",
                still,
                0,
                aside(AsideReason::NotFinite),
                [0, 0],
                &["bodies 4 (brick), 6 (brick) (2 in all) became numerically unstable: set aside"],
            ),
            (
                "when bodies were thrown",
                still,
                0,
                aside(AsideReason::TooFast),
                [0, 0],
                &["(2 in all) became faster than anything in the scene could make them: set aside"],
            ),
            (
                "when bodies fell through the ground",
                still,
                0,
                aside(AsideReason::BelowGround),
                [0, 0],
                &["(2 in all) fell through the ground: set aside"],
            ),
            (
                "when steps were repeated",
                still,
                0,
                Guarded { retries: 3, ..none() },
                [0, 0],
                &["3 steps gained energy or speed and were repeated in smaller ones"],
            ),
            (
                "when bodies are deep in each other",
                still,
                0,
                Guarded { deep: 2, stiffened: true, ..none() },
                [0, 0],
                &["2 pairs of bodies overlap by more than half of the thinner one's thickness in the end, even with \
                   stiffer contacts"],
            ),
            ("when stiffer contacts helped", still, 0, Guarded { stiffened: true, ..none() }, [0, 0], &[]),
            (
                "when bodies hang",
                still,
                0,
                none(),
                [2, 0],
                &["2 bodies rest without a chain of contacts down to the ground"],
            ),
            (
                "when meshes do not touch",
                still,
                0,
                none(),
                [0, 2],
                &["2 bodies hang in the air to the eye: no chain of meshes that touch leads from there to what \
                     stands; smaller props fill thin parts, and more accuracy leaves smaller gaps"],
            ),
        ] {
            let said = rest(held).into_iter().chain(fallen(fell)).chain(guarded.warnings()).chain(unsupported(hanging));
            let said = said.chain(floating(floating_bodies));
            says_only(case, &said.collect::<Vec<_>>(), words);
        }
    }
}
