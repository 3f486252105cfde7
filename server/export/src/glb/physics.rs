//! The `.physics.glb`: the pile of the last frame, to be simulated further, by the extensions KHR_physics_rigid_bodies
//! and KHR_implicit_shapes.
//!
//! It has no animation, which would come before the simulation. The node `pile` has a node for each body, by its name
//! in all formats, with its mass, centre and inertia. Bodies that are glued to each other are nodes below one that
//! moves, `cluster.N`; one that is glued to the ground, or that the scene keeps where it is, does not move. Below a
//! body are its look, `NAME.look`, and its collision shape, a node for each convex part, `NAME.PART`. `static` has the
//! ground, a box whose top it is, and the scenery. Metres, kilograms, Y up.

use super::super::physics::{MassModel, RigidGroup, SceneryCollider};
use super::super::{Encoded, ExportError, ExportScene, body_names};
use super::{GlbFile, place_node};
use cairn_core::report::bake::{BakedBody, BakedPile, BakedSolid};
use cairn_engine::shape::{Solid, principal};
use cairn_geometry::pose::Pose;
use cairn_gltf::document::Object;
use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;

const BODIES: &str = "KHR_physics_rigid_bodies";
const SHAPES: &str = "KHR_implicit_shapes";
/// Edges of the box that is the ground, d.
const GROUND: DVec3 = DVec3::new(2000.0, 100.0, 2000.0);

pub fn encode(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    let bake = &bake.last_frame();
    let mut file = PhysicsFile {
        glb: GlbFile { keeps_instancing: scene.keeps_instancing, ..GlbFile::default() },
        bake,
        scene,
        names: body_names(bake, scene),
        masses: MassModel { bake, turn: DQuat::IDENTITY },
        surfaces: Vec::new(),
        shapes: Vec::new(),
        parts: BTreeMap::new(),
    };
    let groups = RigidGroup::all(bake, &file.names);
    let groups = groups.iter().map(|group| file.group(group)).collect::<Result<Vec<_>, _>>()?;
    let mut tops = vec![file.glb.out.push("nodes", json!({ "name": "pile", "children": groups }))];
    tops.extend(file.glb.scenery(bake, scene, &mut Vec::new())?);
    tops.extend(file.fixed());
    let PhysicsFile { mut glb, surfaces, shapes, .. } = file;
    let materials: Vec<Value> = (surfaces.iter())
        .map(|[friction, restitution]| {
            json!({
                "staticFriction": friction, "dynamicFriction": friction, "restitution": restitution,
                "frictionCombine": "average",
            })
        })
        .collect();
    glb.extensions.insert(BODIES.into(), json!({ "physicsMaterials": materials }));
    glb.out.uses(BODIES);
    if !shapes.is_empty() {
        glb.extensions.insert(SHAPES.into(), json!({ "shapes": shapes }));
        glb.out.uses(SHAPES);
    }
    glb.finish(&tops, scene.origin).map(Encoded::single)
}

struct PhysicsFile<'a> {
    glb: GlbFile<'a>,
    bake: &'a BakedPile,
    scene: &'a ExportScene<'a>,
    names: Vec<String>,
    masses: MassModel<'a>,
    /// Coefficients of friction and restitution of the materials; pairs have the means of the latter by default.
    surfaces: Vec<[f64; 2]>,
    shapes: Vec<Value>,
    /// Of each prop.
    parts: BTreeMap<usize, Vec<Part>>,
}

/// A convex part of a prop at scale 1, from its pivot.
#[derive(Clone)]
struct Part {
    place: Pose,
    geometry: Value,
}

impl PhysicsFile<'_> {
    /// Bodies that move as one. Gives their node.
    fn group(&mut self, group: &RigidGroup) -> Result<usize, ExportError> {
        let (members, pivot) = (&group.members, |body| self.bake.pivot_pose(0, body));
        if let [body] = members[..] {
            let own = pivot(body);
            let mut node = self.body(body, own)?;
            if !group.is_fixed {
                let BakedBody { prop, scale, .. } = self.bake.bodies[body];
                let solid = &self.bake.solids[prop];
                let center = (solid.center - solid.pivot) * scale;
                self.moves(&mut node, self.masses.mass(body), center, self.masses.inertia(body));
            }
            return Ok(self.glb.out.push("nodes", node));
        }
        let frame = self.masses.frame(members);
        let back = frame.rotation.inverse();
        let mut children = Vec::with_capacity(members.len());
        for &body in members {
            let Pose { translation, rotation } = self.bake.pivot_pose(0, body);
            let local = Pose { translation: back * (translation - frame.translation), rotation: back * rotation };
            let node = self.body(body, local)?;
            children.push(self.glb.out.push("nodes", node));
        }
        let mut node =
            Object::from_iter([("name".to_owned(), json!(group.name)), ("children".into(), json!(children))]);
        place_node(&mut node, frame);
        if !group.is_fixed {
            let inertia = principal(self.masses.inertia_in(members, &frame));
            self.moves(&mut node, self.masses.total(members), DVec3::ZERO, inertia);
        }
        Ok(self.glb.out.push("nodes", node))
    }

    fn moves(&self, node: &mut Object, mass: f64, center: DVec3, (principal, turn): (DVec3, DQuat)) {
        let motion = json!({
            "mass": mass, "centerOfMass": center.to_array(), "inertiaDiagonal": principal.to_array(),
            "inertiaOrientation": turn.normalize().to_array(),
        });
        node.insert("extensions".into(), json!({ BODIES: { "motion": motion } }));
    }

    /// The node of a body: its look and its collision shape.
    fn body(&mut self, body: usize, pose: Pose) -> Result<Object, ExportError> {
        let BakedBody { prop, scale, .. } = self.bake.bodies[body];
        let (name, model, solid) = (self.names[body].clone(), &self.scene.props[prop], &self.bake.solids[prop]);
        let (source, branch) = self.glb.open(model, super::BranchFrame::Origin)?;
        let placed = self.glb.place(source, &branch).map_err(|error| ExportError::source(model, error))?;
        let look = json!({
            "name": format!("{name}.look"), "children": placed, "scale": [scale, scale, scale],
            "translation": (-solid.pivot * scale).to_array(),
        });
        let mut children = vec![self.glb.out.push("nodes", look)];
        let surface = self.surface(solid.friction, solid.restitution);
        for (number, Part { place, geometry }) in self.parts(prop, solid).into_iter().enumerate() {
            let mut node = Object::from_iter([
                ("name".to_owned(), json!(format!("{name}.{number}"))),
                ("scale".into(), json!([scale, scale, scale])),
                ("extensions".into(), collider(&geometry, surface)),
            ]);
            place_node(&mut node, Pose { translation: place.translation * scale, ..place });
            children.push(self.glb.out.push("nodes", node));
        }
        let mut node = Object::from_iter([("name".to_owned(), json!(name)), ("children".into(), json!(children))]);
        place_node(&mut node, pose);
        Ok(node)
    }

    fn parts(&mut self, prop: usize, solid: &BakedSolid) -> Vec<Part> {
        if let Some(known) = self.parts.get(&prop) {
            return known.clone();
        }
        let offset = solid.center - solid.pivot;
        let mut shape = |place: Pose, shape: Value| {
            self.shapes.push(shape);
            vec![Part { place, geometry: json!({ "shape": self.shapes.len() - 1 }) }]
        };
        let parts = match &solid.solid {
            Solid::Box(b) => {
                let place = Pose { translation: b.center + offset, rotation: b.rotation };
                shape(place, json!({ "type": "box", "box": { "size": (b.half * 2.0).to_array() } }))
            }
            Solid::Ball { center, radius } => {
                let place = Pose { translation: *center + offset, rotation: DQuat::IDENTITY };
                shape(place, json!({ "type": "sphere", "sphere": { "radius": radius } }))
            }
            Solid::Convex(_) => {
                let hull = |(number, mut mesh): (usize, cairn_geometry::mesh::TriMesh)| {
                    mesh.points.iter_mut().for_each(|point| *point += offset);
                    let mesh = self.glb.mesh(&format!("{}.{number}", self.scene.props[prop].name), &mesh);
                    Part { place: Pose::IDENTITY, geometry: json!({ "mesh": mesh, "convexHull": true }) }
                };
                solid.solid.meshes().into_iter().enumerate().map(hull).collect()
            }
        };
        self.parts.insert(prop, parts.clone());
        parts
    }

    /// The material of these coefficients.
    fn surface(&mut self, friction: f64, restitution: f64) -> usize {
        let surface = [friction, restitution];
        self.surfaces.iter().position(|&known| known == surface).unwrap_or_else(|| {
            self.surfaces.push(surface);
            self.surfaces.len() - 1
        })
    }

    /// The node of what stands still, if anything does.
    fn fixed(&mut self) -> Option<usize> {
        let mut children = Vec::new();
        let world = self.bake.world;
        if let Some(height) = world.ground {
            let (size, surface) = (GROUND * world.diameter, self.surface(world.ground_friction, 0.0));
            self.shapes.push(json!({ "type": "box", "box": { "size": size.to_array() } }));
            let geometry = json!({ "shape": self.shapes.len() - 1 });
            let middle = [0.0, height - size.y / 2.0, 0.0];
            let extensions = collider(&geometry, surface);
            let node = json!({ "name": "ground", "translation": middle, "extensions": extensions });
            children.push(self.glb.out.push("nodes", node));
        }
        for SceneryCollider { piece, mesh, friction } in SceneryCollider::all(self.bake, self.scene) {
            let name = format!("scenery.{piece}");
            let surface = self.surface(friction, 0.0);
            let mesh = self.glb.mesh(&name, &mesh);
            let extensions = collider(&json!({ "mesh": mesh }), surface);
            children.push(self.glb.out.push("nodes", json!({ "name": name, "extensions": extensions })));
        }
        (!children.is_empty()).then(|| self.glb.out.push("nodes", json!({ "name": "static", "children": children })))
    }
}

/// The extensions of a node that is a collider.
fn collider(geometry: &Value, surface: usize) -> Value {
    json!({ BODIES: { "collider": { "geometry": geometry, "physicsMaterial": surface } } })
}
