//! UsdPhysics: the pile of the last frame, to be simulated further.
//!
//! Simulators see no bodies below a `PointInstancer`. So the prim `Physics`, beside the picture, has every body once
//! more: below `Bodies`, named as in all formats, with its mass, centre and inertia, its collision shape (`Collision`:
//! the convex parts, with the purpose `guide`) and its look (`Picture`: the prototype). `Ground` and `Scenery` stand
//! still, and so do bodies that the scene keeps where they are. `Glue` has a fixed joint for each joint that holds; its
//! break force is [`PEAK`] times what it bears in the bake, its break torque that about either body's centre. `Hulls`
//! and `Materials` are what these refer to.
//!
//! `Physics` is invisible, so that the stage shows the pile once. Who wants to see it move makes it visible and hides
//! the instancer.

use super::super::physics::{MassModel, SceneryCollider};
use super::super::{ExportScene, body_names};
use super::bounding_box::BoundingBox;
use super::layer::{Layer, quaternion, short_name, vector};
use cairn_core::report::BakedGlueDot;
use cairn_core::report::bake::{BakedBody, BakedPile, BakedSolid};
use cairn_engine::shape::Solid;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use glam::{DAffine3, DQuat, DVec3};
use openusd::gf;
use openusd::sdf::{FieldKey, Path, Specifier, Value};
use openusd::tf::Token;
use std::collections::BTreeMap;

/// Half the edges of the ground's picture, d: as a collision shape, a plane has no end.
const GROUND: f64 = 50.0;
/// Loads that engines hold against a joint's limits are those of a step, and peak where bodies that overlap by a hair
/// are pushed apart; the bake averages loads. In PhysX, some piles fall at 3 times the limit of the bake, and stand at
/// 10 times.
const PEAK: f64 = 10.0;
/// A joint this near the ground is on it, d.
const ON_GROUND: f64 = 0.25;

/// Writes it below the pile's prim. `prototypes`: the prims of the props.
pub fn write(
    layer: &mut Layer,
    pile: &Path,
    bake: &BakedPile,
    scene: &ExportScene,
    prototypes: &BTreeMap<usize, Path>,
) {
    let layout = layer.layout.clone();
    layer.set(&Path::abs_root(), "kilogramsPerUnit", 1.0);
    let top = layer.prim(pile, "Physics", "Xform");
    layer.attribute(&top, "token visibility", Token::from("invisible"));
    let world = layer.prim(&top, "World", "PhysicsScene");
    layer.attribute(&world, "vector3f physics:gravityDirection", vector(layout.direction(-DVec3::Y)));
    let gravity = bake.world.gravity / layout.meters_per_unit;
    layer.attribute(&world, "float physics:gravityMagnitude", gravity as f32);

    let mut surfaces = Surfaces { scope: layer.prim(&top, "Materials", "Scope"), known: BTreeMap::new() };
    let hulls = hulls(layer, &top, bake, scene);
    let scope = layer.prim(&top, "Bodies", "Xform");
    let (names, masses) = (body_names(bake, scene), MassModel { bake, turn: DQuat::IDENTITY });
    let last = bake.frames.len() - 1;
    let mut bodies = Vec::with_capacity(names.len());
    for (body, name) in names.iter().enumerate() {
        let BakedBody { prop, scale, is_pinned, .. } = bake.bodies[body];
        let (solid, pose) = (&bake.solids[prop], bake.pivot_pose(last, body));
        let kinds: &[&str] = match is_pinned {
            true => &["MaterialBindingAPI"],
            false => &["PhysicsRigidBodyAPI", "PhysicsMassAPI", "MaterialBindingAPI"],
        };
        let prim = layer.prim(&scope, name, "Xform");
        layer.apply_all(&prim, kinds);
        pose_prim(layer, &prim, pose);
        if !is_pinned {
            let (principal, turn) = masses.inertia(body);
            let unit = layout.meters_per_unit;
            layer.attribute(&prim, "float physics:mass", masses.mass(body) as f32);
            let center = vector(layout.place((solid.center - solid.pivot) * scale));
            layer.attribute(&prim, "point3f physics:centerOfMass", center);
            layer.attribute(&prim, "float3 physics:diagonalInertia", vector(principal / (unit * unit)));
            layer.attribute(&prim, "quatf physics:principalAxes", quaternion(layout.turn() * turn));
        }
        surfaces.bind(layer, &prim, [solid.friction, solid.restitution]);
        let collision = layer.prim(&prim, "Collision", "Xform");
        layer.refer(&collision, "", Some(hulls[&prop].as_str()));
        layer.attribute(&collision, "uniform token purpose", Token::from("guide"));
        let picture = layer.prim(&prim, "Picture", "Xform");
        for scaled in [&collision, &picture] {
            layer.attribute(scaled, "float3 xformOp:scale", vector(DVec3::splat(scale)));
            layer.order(scaled, &["xformOp:scale"]);
        }
        let shown = layer.prim(&picture, "Prop", "");
        layer.refer(&shown, "", Some(prototypes[&prop].as_str()));
        layer.set(&shown, "instanceable", true);
        bodies.push(prim);
    }
    let ground = bake.world.ground.map(|height| ground(layer, &top, bake, height, &mut surfaces));
    let colliders = SceneryCollider::all(bake, scene);
    if !colliders.is_empty() {
        let scope = layer.prim(&top, "Scenery", "Xform");
        for SceneryCollider { piece, mesh, friction } in &colliders {
            let name = scene.scenery.get(*piece).map_or("Around", |model| short_name(model.name));
            let prim = layer.prim(&scope, name, "Mesh");
            layer.apply_all(&prim, &["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "MaterialBindingAPI"]);
            triangles(layer, &prim, mesh);
            layer.attribute(&prim, "uniform token physics:approximation", Token::from("none"));
            layer.attribute(&prim, "uniform token purpose", Token::from("guide"));
            surfaces.bind(layer, &prim, [*friction, 0.0]);
        }
    }
    let dots = bake.glue.iter().flat_map(|glue| &glue.dots).filter(|dot| !dot.is_broken);
    let scope = bake.glue.as_ref().map(|_| layer.prim(&top, "Glue", "Scope"));
    let targets = JointTargets { masses: &masses, bodies: &bodies, ground: ground.as_ref(), fixed: &top };
    for (number, (dot, scope)) in dots.zip(scope.iter().cycle()).enumerate() {
        let prim = layer.prim(scope, &format!("Joint_{number:04}"), "PhysicsFixedJoint");
        joint(layer, &prim, dot, &targets, bake);
    }
}

/// Places a prim, without a scale.
fn pose_prim(layer: &mut Layer, prim: &Path, pose: Pose) {
    let layout = &layer.layout;
    let (place, turn) = (layout.place(pose.translation), layout.rotation(pose.rotation));
    layer.attribute(prim, "double3 xformOp:translate", gf::Vec3d::from(place.to_array()));
    layer.attribute(prim, "quatf xformOp:orient", quaternion(turn.normalize()));
    layer.order(prim, &["xformOp:translate", "xformOp:orient"]);
}

/// Materials of colliders, one for each friction and restitution.
struct Surfaces {
    scope: Path,
    known: BTreeMap<[u64; 2], Path>,
}

impl Surfaces {
    fn bind(&mut self, layer: &mut Layer, prim: &Path, [friction, restitution]: [f64; 2]) {
        let material = self.known.entry([friction, restitution].map(f64::to_bits)).or_insert_with(|| {
            let material = layer.prim(&self.scope, "Surface", "Material");
            layer.apply_all(&material, &["PhysicsMaterialAPI"]);
            for name in ["staticFriction", "dynamicFriction"] {
                layer.attribute(&material, &format!("float physics:{name}"), friction as f32);
            }
            if restitution > 0.0 {
                layer.attribute(&material, "float physics:restitution", restitution as f32);
            }
            material
        });
        layer.relationship(prim, "material:binding:physics", std::slice::from_ref(material));
    }
}

/// The collision shape of each prop at scale 1, about its pivot: classes, so that they are no colliders themselves.
fn hulls(layer: &mut Layer, top: &Path, bake: &BakedPile, scene: &ExportScene) -> BTreeMap<usize, Path> {
    let scope = layer.prim(top, "Hulls", "Scope");
    layer.set(&scope, FieldKey::Specifier, Value::Specifier(Specifier::Class));
    let mut prims = BTreeMap::new();
    for &BakedBody { prop, .. } in &bake.bodies {
        if prims.contains_key(&prop) {
            continue;
        }
        let prim = layer.prim(&scope, short_name(scene.props[prop].name), "Xform");
        parts(layer, &prim, &bake.solids[prop]);
        prims.insert(prop, prim);
    }
    prims
}

fn parts(layer: &mut Layer, prop: &Path, solid: &BakedSolid) {
    let (layout, offset) = (layer.layout.clone(), solid.center - solid.pivot);
    match &solid.solid {
        Solid::Box(around) => {
            let part = layer.prim(prop, "Part", "Cube");
            layer.apply_all(&part, &["PhysicsCollisionAPI"]);
            layer.attribute(&part, "double size", 2.0);
            layer.attribute(&part, "float3[] extent", vec![vector(DVec3::NEG_ONE), vector(DVec3::ONE)]);
            // Its own axes stay: only where they point is turned.
            let turn = layout.turn() * around.rotation;
            let place = gf::Vec3d::from(layout.place(around.center + offset).to_array());
            layer.attribute(&part, "double3 xformOp:translate", place);
            layer.attribute(&part, "quatf xformOp:orient", quaternion(turn));
            layer.attribute(&part, "float3 xformOp:scale", vector(around.half / layout.meters_per_unit));
            layer.order(&part, &["xformOp:translate", "xformOp:orient", "xformOp:scale"]);
        }
        Solid::Ball { center, radius } => {
            let part = layer.prim(prop, "Part", "Sphere");
            layer.apply_all(&part, &["PhysicsCollisionAPI"]);
            let radius = radius / layout.meters_per_unit;
            layer.attribute(&part, "double radius", radius);
            let corner = DVec3::splat(radius);
            layer.attribute(&part, "float3[] extent", vec![vector(-corner), vector(corner)]);
            layer.transform(&part, DAffine3::from_translation(layout.place(*center + offset)));
        }
        Solid::Convex(_) => {
            for mut mesh in solid.solid.meshes() {
                mesh.points.iter_mut().for_each(|point| *point += offset);
                let part = layer.prim(prop, "Part", "Mesh");
                layer.apply_all(&part, &["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]);
                triangles(layer, &part, &mesh);
                layer.attribute(&part, "uniform token physics:approximation", Token::from("convexHull"));
            }
        }
    }
}

/// A mesh of the pile's axes and metres.
fn triangles(layer: &mut Layer, prim: &Path, mesh: &TriMesh) {
    let layout = layer.layout.clone();
    let points: Vec<DVec3> = mesh.points.iter().map(|&point| layout.place(point)).collect();
    let mut bounds = BoundingBox::default();
    points.iter().for_each(|&point| bounds.add(point));
    layer.attribute(prim, "uniform token subdivisionScheme", Token::from("none"));
    layer.attribute(prim, "float3[] extent", bounds.extent());
    layer.attribute(prim, "int[] faceVertexCounts", vec![3; mesh.triangles.len()]);
    let corners: Vec<i32> = mesh.triangles.iter().flatten().map(|&i| i as i32).collect();
    layer.attribute(prim, "int[] faceVertexIndices", corners);
    layer.attribute(prim, "point3f[] points", points.into_iter().map(vector).collect::<Vec<_>>());
}

fn ground(layer: &mut Layer, top: &Path, bake: &BakedPile, height: f64, surfaces: &mut Surfaces) -> Path {
    let layout = layer.layout.clone();
    let prim = layer.prim(top, "Ground", "Plane");
    layer.apply_all(&prim, &["PhysicsCollisionAPI", "MaterialBindingAPI"]);
    let half = GROUND * bake.world.diameter / layout.meters_per_unit;
    let (axis, corner) =
        if layout.is_z_up { ("Z", DVec3::new(half, half, 0.0)) } else { ("Y", DVec3::new(half, 0.0, half)) };
    layer.attribute(&prim, "uniform token axis", Token::from(axis));
    layer.attribute(&prim, "double width", 2.0 * half);
    layer.attribute(&prim, "double length", 2.0 * half);
    layer.attribute(&prim, "float3[] extent", vec![vector(-corner), vector(corner)]);
    layer.attribute(&prim, "uniform token purpose", Token::from("guide"));
    layer.transform(&prim, DAffine3::from_translation(layout.place(DVec3::Y * height)));
    surfaces.bind(layer, &prim, [bake.world.ground_friction, 0.0]);
    prim
}

/// What joints join.
struct JointTargets<'a> {
    masses: &'a MassModel<'a>,
    bodies: &'a [Path],
    ground: Option<&'a Path>,
    /// A prim that stands still.
    fixed: &'a Path,
}

/// A glue joint. One that is on the ground joins the body with it: engines leave out contacts between what they join,
/// and a body that is glued to the ground may be sunk into it.
fn joint(layer: &mut Layer, prim: &Path, dot: &BakedGlueDot, targets: &JointTargets, bake: &BakedPile) {
    let (layout, world) = (layer.layout.clone(), bake.world);
    let last = bake.frames.len() - 1;
    let point = DVec3::from(dot.point);
    let height = world.ground.filter(|height| (point.y - height).abs() < ON_GROUND * world.diameter);
    for (side, body) in [Some(dot.body), dot.other].into_iter().enumerate() {
        let fixed = || Pose { translation: DVec3::Y * height.unwrap_or(0.0), rotation: DQuat::IDENTITY };
        let pose = body.map_or_else(fixed, |body| bake.pivot_pose(last, body));
        let target = match body {
            Some(body) => &targets.bodies[body],
            None => targets.ground.filter(|_| height.is_some()).unwrap_or(targets.fixed),
        };
        layer.relationship(prim, &format!("physics:body{side}"), std::slice::from_ref(target));
        let back = pose.rotation.inverse();
        let place = vector(layout.place(back * (point - pose.translation)));
        layer.attribute(prim, &format!("point3f physics:localPos{side}"), place);
        layer.attribute(prim, &format!("quatf physics:localRot{side}"), quaternion(layout.rotation(back)));
    }
    let [force, moment] = dot.limit.map(|limit| limit * PEAK);
    if force.is_finite() {
        // About the joint it is the moment; engines may measure it about a body's centre, where the force adds to it.
        let lever = |body: usize| targets.masses.place(body).translation.distance(point);
        let torque = moment + force * [Some(dot.body), dot.other].into_iter().flatten().map(lever).fold(0.0, f64::max);
        let unit = layout.meters_per_unit;
        layer.attribute(prim, "float physics:breakForce", (force / unit) as f32);
        layer.attribute(prim, "float physics:breakTorque", (torque / (unit * unit)) as f32);
    }
}
