//! Bodies as a camera sees them: by their own meshes; and which of them something besides other bodies carries.

use cairn_engine::shape::Shape;
use cairn_engine::world::{BodyId, ContactPair, PairSide, Role, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::measure::Sight;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::params::Params;
use cairn_input::scene::Scene;
use cairn_motion::instance::Instance;
use cairn_motion::pile::Pile;
use std::collections::BTreeSet;

/// Bodies with their meshes.
pub struct SeenBodies<'a> {
    /// Index of the prop, scale and pose.
    bodies: Vec<(usize, f64, Pose)>,
    /// Of each body, m.
    pub thickness: Vec<f64>,
    meshes: Vec<&'a TriMesh>,
}

impl<'a> SeenBodies<'a> {
    /// `bodies`: index of the prop, scale and pose of its mesh, m.
    pub fn new(scene: &'a Scene, shapes: &[Shape], bodies: Vec<(usize, f64, Pose)>) -> SeenBodies<'a> {
        let thickness = bodies.iter().map(|&(prop, scale, _)| shapes[prop].thickness() * scale).collect();
        let meshes = scene.props.iter().map(|prop| &prop.model.mesh).collect();
        SeenBodies { bodies, thickness, meshes }
    }

    pub fn sight(&self) -> Sight<'_> {
        Sight::new(&self.meshes, &self.bodies, &self.thickness)
    }

    /// Whether a body is seen to stand on the ground, if there is one at this height, m: its mesh is no more than `gap`
    /// above it, in its thickness.
    pub fn is_on_ground(&self, sight: &Sight, body: usize, gap: f64, ground: Option<f64>) -> bool {
        ground.is_some_and(|ground| sight.lowest(body) - ground <= gap * self.thickness[body])
    }
}

/// The bodies that are seen to hang at these poses of a pile, engine units: no chain of meshes that touch leads from
/// them to what was fixed or stood on something fixed at its start, nor to the ground, if there is one at this height,
/// m.
pub fn hanging(pile: &Pile, poses: &[Option<Pose>], params: &Params, ground: Option<f64>) -> BTreeSet<BodyId> {
    let units = &pile.world.units;
    let present: Vec<(BodyId, Pose)> = poses.iter().enumerate().filter_map(|(id, pose)| Some((id, (*pose)?))).collect();
    let body = |&(id, pose): &(BodyId, Pose)| {
        let Instance { prop, scale, .. } = pile.instances[id];
        (prop, scale, pile.shapes[prop].prop_pose(&units.pose_to_si(&pose), scale))
    };
    let seen = SeenBodies::new(pile.scene, pile.shapes, present.iter().map(body).collect());
    let (sight, gap) = (seen.sight(), params.accuracy.traits().visible_contact);
    let fixed = carried(&pile.world.static_contact_pairs(REAL_CONTACT), &pile.world);
    let stands = |i: usize| fixed.contains(&present[i].0) || seen.is_on_ground(&sight, i, gap, ground);
    sight.hanging(gap, stands).into_iter().map(|i| present[i].0).collect()
}

/// The bodies that were placed to stay, and those that touch something besides other bodies. What glue holds may hover.
/// `pairs`: at least those of bodies and what is fixed that touch.
pub fn carried(pairs: &[ContactPair], world: &World) -> BTreeSet<BodyId> {
    let is_near = |pair: &&ContactPair| pair.points.iter().any(|p| p.gap <= REAL_CONTACT * world.pair_thickness(pair));
    let is_fixed = |pair: &&ContactPair| matches!(pair.b, PairSide::Scenery | PairSide::Moving | PairSide::Ground);
    let on_fixed = pairs.iter().filter(is_fixed).filter(is_near).map(|pair| pair.a);
    on_fixed.chain(world.present().filter(|&id| world.bodies()[id].role == Role::Pinned)).collect()
}
