//! Bodies that would hover: glue may hold them, but no chain of visible meshes that touch leads from them to what
//! stands. A few such bodies are left out of the pile.

use super::TurnOverInputs;
use cairn_engine::world::World;
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::measure::Sight;
use cairn_geometry::mesh::TriMesh;
use cairn_motion::pile::Pile;
use std::collections::BTreeSet;

/// Share of the bodies that may be left out, and at least one. Where more hover, the shape is too thin for the props,
/// and would lose a limb: the report says so.
const MOST: f64 = 0.02;
/// Bodies move a little until they rest: here the gap is this share of what may be seen in the end.
const NARROWER: f64 = 0.8;

/// Which of the first bodies, `filled` of them, are to be left out, ascending. The pile waits where it starts.
pub fn find(pile: &Pile, filled: usize, inputs: &TurnOverInputs) -> Vec<usize> {
    let units = inputs.units;
    let bodies: Vec<_> = (pile.instances.iter())
        .map(|b| (b.prop, b.scale, inputs.shapes[b.prop].prop_pose(&units.pose_to_si(&b.pose), b.scale)))
        .collect();
    let thickness: Vec<f64> = bodies.iter().map(|&(prop, scale, _)| inputs.shapes[prop].thickness() * scale).collect();
    let meshes: Vec<&TriMesh> = inputs.scene.props.iter().map(|p| &p.model.mesh).collect();
    let sight = Sight::new(&meshes, &bodies, &thickness);
    let gap = NARROWER * inputs.params.accuracy.traits().visible_contact;
    let fixed = carried_by_fixed(&pile.world);
    let hovering = sight.hanging(gap, |i| {
        fixed.contains(&i) || inputs.params.ground && sight.lowest(i) - inputs.ground <= gap * thickness[i]
    });
    let are_few = hovering.len() as f64 <= (MOST * filled as f64).max(1.0);
    if are_few && hovering.iter().all(|&id| id < filled) { hovering } else { Vec::new() }
}

/// Bodies that touch scenery, or stand.
fn carried_by_fixed(world: &World) -> BTreeSet<usize> {
    let touching = world.static_contact_pairs(REAL_CONTACT).into_iter().map(|pair| pair.a);
    touching.chain(world.present().filter(|&id| world.bodies()[id].role.stands())).collect()
}
