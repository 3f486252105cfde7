//! Bodies as a camera sees them: by their own meshes; and which of them something besides other bodies carries.

use cairn_engine::shape::Shape;
use cairn_engine::world::{BodyId, ContactPair, PairSide, Role, World};
use cairn_geometry::contact::REAL_CONTACT;
use cairn_geometry::measure::Sight;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::scene::Scene;
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

/// The bodies that were placed to stay, and those that touch something besides other bodies. What glue holds may hover.
/// `pairs`: at least those of bodies and what is fixed that touch.
pub fn carried(pairs: &[ContactPair], world: &World) -> BTreeSet<BodyId> {
    let is_near = |pair: &&ContactPair| pair.points.iter().any(|p| p.gap <= REAL_CONTACT * world.pair_thickness(pair));
    let is_fixed = |pair: &&ContactPair| matches!(pair.b, PairSide::Scenery | PairSide::Moving | PairSide::Ground);
    let on_fixed = pairs.iter().filter(is_fixed).filter(is_near).map(|pair| pair.a);
    on_fixed.chain(world.present().filter(|&id| world.bodies()[id].role == Role::Pinned)).collect()
}
