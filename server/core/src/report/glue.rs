//! Figures of the glue, and warnings about it.

use super::bake::{BakedGlue, BakedGlueDot};
use super::inputs::NamedFigures;
use super::warnings::bodies;
use crate::glue::{Glued, MOST_MOVED};
use cairn_analysis::assembly::Assembly;
use cairn_engine::world::{BodyId, PairSide, Role, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::measure;
use cairn_geometry::topology::DisjointSets;
use cairn_input::error::counted;
use cairn_motion::glue::Joint;
use cairn_motion::step::Simulation;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// The glue as it is at the end.
pub fn baked(sim: &Simulation) -> BakedGlue {
    let (world, glue) = (&sim.pile.world, &sim.pile.glue);
    let units = world.units;
    let force = units.mass * units.length / (units.time * units.time);
    let dot = |dot: &Joint| {
        let (turn, point) = glue.place_of(dot, world);
        BakedGlueDot {
            body: dot.a,
            other: dot.b,
            point: units.point_to_si(point).to_array(),
            normal: (turn * dot.normal).to_array(),
            force: (turn * dot.force * force).to_array(),
            moment: (turn * dot.moment * force * units.length).to_array(),
            limit: [dot.limit * force, dot.limit * dot.arm * force * units.length],
            is_broken: dot.is_broken,
        }
    };
    BakedGlue {
        dots: glue.joints.iter().map(dot).collect(),
        clusters: glue.clusters().filter(|members| members.len() > 1).map(<[BodyId]>::to_vec).collect(),
        anchored: (0..world.bodies().len()).filter(|&id| world.bodies()[id].role == Role::Anchored).collect(),
    }
}

/// The least downward force of the glue at the ground that keeps each heap from tipping over as one solid; in weights
/// of all bodies. What feet pull against each other does not count.
fn least_pull(joints: &[Joint], world: &World) -> f64 {
    let mut heaps = DisjointSets::new(world.bodies().len());
    let mut feet: Vec<(BodyId, DVec3)> =
        joints.iter().filter(|dot| dot.b.is_none()).map(|dot| (dot.a, dot.point)).collect();
    joints.iter().filter_map(|dot| Some((dot.a, dot.b?))).for_each(|(a, b)| heaps.join(a, b));
    for pair in world.contact_pairs(REAL_CONTACT) {
        match pair.b {
            PairSide::Body(b) => heaps.join(pair.a, b),
            _ => feet.extend(pair.points.iter().map(|contact| (pair.a, contact.point))),
        }
    }
    let assembly = Assembly::new(world, |_| true);
    let mut found: BTreeMap<BodyId, (f64, DVec3, Vec<DVec3>)> = BTreeMap::new();
    for (&id, body) in assembly.ids.iter().zip(&assembly.bodies) {
        let (mass, moment, _) = found.entry(heaps.find(id)).or_default();
        *mass += body.mass;
        *moment += body.center_of_mass * body.mass;
    }
    for (id, point) in feet {
        found.entry(heaps.find(id)).or_default().2.push(point);
    }
    let mass: f64 = found.values().map(|(mass, ..)| mass).sum();
    let pull: f64 = found.values().map(|(mass, moment, feet)| mass * tipping(*moment / *mass, feet)).sum();
    if mass > 0.0 { pull / mass } else { 0.0 }
}

/// The least downward force at its feet that keeps a solid of weight 1 from tipping over: to each side, the lever of
/// its center of mass beyond the outermost foot, over that of the foot farthest behind.
fn tipping(center: DVec3, feet: &[DVec3]) -> f64 {
    let side = |degrees: usize| {
        let (sin, cos) = libm::sincos((degrees as f64).to_radians());
        let along = |p: &DVec3| p.x * cos + p.z * sin;
        let outer = feet.iter().map(along).fold(f64::NEG_INFINITY, f64::max);
        let inner = feet.iter().map(along).fold(f64::INFINITY, f64::min);
        (along(&center) - outer) / (outer - inner).max(NARROWEST)
    };
    if feet.is_empty() { 0.0 } else { (0..360).map(side).fold(0.0, f64::max) }
}

/// A foot is at least so wide, d.
const NARROWEST: f64 = 0.1;
/// Beyond this share of glued contact pairs, the pile is nearly one solid.
const SOLID: f64 = 0.3;

/// The extent of the glue, and its loads. Forces are in weights of the median prop, which in engine units is 1.
pub fn figures(glued: &Glued, sim: &Simulation) -> NamedFigures {
    let count = sim.pile.instances.len().max(1) as f64;
    let touched: BTreeSet<BodyId> = glued.joints.iter().flat_map(Joint::bodies).collect();
    let forces: Vec<f64> = glued.joints.iter().map(|dot| dot.force.length()).collect();
    // A moment in weights times the radius of the median prop, d/2.
    let moment = |dot: &Joint| dot.moment.length() * 2.0;
    let largest = |values: &[f64]| (!values.is_empty()).then(|| values.iter().copied().fold(0.0, f64::max));
    let at_ground = || glued.joints.iter().filter(|dot| dot.b.is_none());
    BTreeMap::from([
        ("touches", Some(glued.contact_pairs as f64)),
        ("glue_dots_least", Some(glued.at_least as f64)),
        ("glued_touch_fraction", Some(glued.joints.len() as f64 / glued.contact_pairs.max(1) as f64)),
        ("glued_body_fraction", Some(touched.len() as f64 / count)),
        ("glue_cluster_max", Some(sim.pile.glue.tally.cluster_max as f64)),
        ("anchored", Some(at_ground().count() as f64)),
        ("ground_pull_rel", Some(least_pull(&glued.joints, &sim.pile.world))),
        ("glue_force_max", largest(&forces)),
        ("glue_force_p50", (!forces.is_empty()).then(|| measure::percentile(&forces, 0.5))),
        ("glue_moment_max", largest(&glued.joints.iter().map(moment).collect::<Vec<_>>())),
        ("glue_normal_price", Some(glued.normal_price)),
        ("glue_imbalance", Some(glued.imbalance)),
        ("moved_freed", glued.moved),
        ("sag_freed", glued.moved.map(|_| glued.displacement)),
        ("moved_tilted", glued.moved_tilted),
    ])
}

/// Warnings about bodies that could not be glued, and about piles that the glue does not hold.
/// `diameter`: of the median prop, m; `bound`: what a joint carries, weights.
pub fn warnings(glued: &Glued, diameter: f64, bound: f64) -> Vec<String> {
    let mut warnings = Vec::new();
    if glued.unreachable > 0 {
        let apart = bodies(glued.unreachable);
        warnings.push(format!(
            "{apart} touched no part of the pile that stands on the ground and could not be glued: they fall"
        ));
    }
    if glued.bridges > 0 {
        let widest = glued.widest * diameter;
        let dots = counted(glued.bridges, "dot of glue bridges a gap", "dots of glue bridge gaps");
        warnings.push(format!(
            "{dots} of up to {widest:.3} m that the fill left in narrow places; smaller props fill them better"
        ));
    }
    if glued.too_weak > 0 {
        let weak = bodies(glued.too_weak);
        warnings.push(format!(
            "{weak} would need stronger glue than {bound} weights per dot: they fall; raise glue.strength to hold them"
        ));
    }
    if !glued.stands() {
        let moved = glued.moved.unwrap_or(0.0);
        warnings.push(match moved > MOST_MOVED {
            true => format!(
                "{:.0} % of the bodies moved in the trial release: the glue does not hold the pile; use smaller props \
                 or a broader base",
                100.0 * moved
            ),
            false => format!(
                "the bodies sank by {:.3} m in the mean in the trial release: the glued pile sags; use smaller props \
                 or a broader base",
                glued.displacement * diameter
            ),
        });
    }
    if glued.leans {
        warnings.push("the foot is narrow: every body that touches the ground was glued to it".into());
    }
    let share = glued.joints.len() as f64 / glued.contact_pairs.max(1) as f64;
    if share > SOLID {
        warnings.push(format!("{:.0} % of all contact pairs are glued: the pile is nearly one solid", 100.0 * share));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::{Glued, tipping, warnings};
    use crate::testing::says_only;
    use cairn_motion::glue::Joint;
    use glam::DVec3;

    #[test]
    fn a_solid_tips_where_its_center_is_beyond_its_feet() {
        let feet = [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0)].map(|(x, z)| DVec3::new(x, 0.3, z));
        for (x, z, pull) in [(0.5, 1.0, 0.0), (1.0, 1.9, 0.0), (3.0, 1.0, 2.0), (0.5, 3.0, 0.5), (0.5, -1.0, 0.5)] {
            let found = tipping(DVec3::new(x, 5.0, z), &feet);
            assert!((found - pull).abs() < 1e-9, "center at {x} {z}: {found}, not {pull}");
        }
        assert_eq!(tipping(DVec3::ZERO, &[]), 0.0, "what hangs on scenery does not tip");
    }

    #[test]
    fn each_warning_of_the_glue_has_its_cause() {
        let glued = Glued { contact_pairs: 10, ..Glued::default() };
        let joint = Joint {
            a: 0,
            b: None,
            point: DVec3::ZERO,
            normal: DVec3::Y,
            arm: 1.0,
            contact: None,
            force: DVec3::ZERO,
            moment: DVec3::ZERO,
            limit: f64::INFINITY,
            is_broken: false,
        };
        let joints = |count: usize| vec![joint; count];
        for (case, glued, words) in [
            ("when the glue holds", Glued { moved: Some(0.0), ..glued.clone() }, &[] as &[&str]),
            ("when nothing was tried", glued.clone(), &[]),
            (
                "when bodies lie apart",
                Glued { unreachable: 2, ..glued.clone() },
                &["2 bodies touched no part of the pile that stands on the ground and could not be glued: they fall"],
            ),
            (
                "when glue bridges gaps",
                Glued { bridges: 1, widest: 0.5, ..glued.clone() },
                &["1 dot of glue bridges a gap of up to 0.100 m that the fill left in narrow places; smaller props \
                   fill them better"],
            ),
            (
                "when the glue is too weak",
                Glued { too_weak: 3, ..glued.clone() },
                &["3 bodies would need stronger glue than 25 weights per dot: they fall; raise glue.strength to hold \
                   them"],
            ),
            (
                "when the glued pile moves",
                Glued { moved: Some(0.9), ..glued.clone() },
                &["90 % of the bodies moved in the trial release: the glue does not hold the pile; use smaller props \
                   or a broader base"],
            ),
            (
                "when the glued pile sinks",
                Glued { moved: Some(0.0), displacement: 2.0, ..glued.clone() },
                &["the bodies sank by 0.400 m in the mean in the trial release: the glued pile sags; use smaller \
                   props or a broader base"],
            ),
            (
                "when the foot is narrow",
                Glued { leans: true, ..glued.clone() },
                &["the foot is narrow: every body that touches the ground was glued to it"],
            ),
            ("when few pairs are glued", Glued { joints: joints(3), ..glued.clone() }, &[]),
            (
                "when most pairs are glued",
                Glued { joints: joints(9), ..glued },
                &["90 % of all contact pairs are glued: the pile is nearly one solid"],
            ),
        ] {
            says_only(case, &warnings(&glued, 0.2, 25.0), words);
        }
    }
}
