//! MJCF, the models of MuJoCo: the pile of the last frame, to be simulated further.
//!
//! Metres and kilograms, Z up, as MuJoCo has it: Cairn's (x, y, z) is (x, -z, y) here. Each free body is a `body` with
//! a `freejoint`, with the mass and inertia that it had in the bake, and one `geom` for each convex part of its
//! collision shape. Bodies that are glued to each other are one `body`, named `cluster.N`; one that is glued to the
//! ground has no joint. A body's geoms are named `NAME.PART`, by its name in all formats. The ground is a plane.
//!
//! MuJoCo softens contacts. They are as hard here as the time step bears, a hundredth of the characteristic time
//! sqrt(d / g), where d is the diameter of the median prop.

use super::glue::GlueMembership;
use super::{Encoded, ExportError, ExportScene, body_names};
use cairn_core::geometry::pose::Pose;
use cairn_core::prepare::shape::Solid;
use cairn_core::report::bake::{BakedBody, BakedPile, BakedWorld};
use glam::{DMat3, DQuat, DVec3};
use quick_xml::Writer;
use std::collections::BTreeMap;
use std::io::Result;

/// Time step, characteristic times.
const STEP: f64 = 0.01;
/// Time constant of contacts, steps: MuJoCo asks for two at least.
const CONTACT: f64 = 2.0;
/// Depth within which a contact reaches its full stiffness, d.
const SOFT: f64 = 1e-3;

type Xml = Writer<Vec<u8>>;

/// The `.xml`.
pub fn encode(bake: &BakedPile, scene: &ExportScene) -> std::result::Result<Encoded, ExportError> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 1);
    let names = body_names(bake, scene);
    let mut meshes = BTreeMap::new();
    for &BakedBody { prop, scale, .. } in &bake.bodies {
        let count = meshes.len();
        meshes.entry((prop, scale.to_bits())).or_insert(count);
    }
    xml.create_element("mujoco").with_attribute(("model", "pile")).write_inner_content(|xml| {
        xml.create_element("compiler")
            .with_attributes([("angle", "radian"), ("balanceinertia", "true")])
            .write_empty()?;
        settings(xml, &bake.world)?;
        xml.create_element("asset").write_inner_content(|xml| {
            for (&(prop, scale), number) in &meshes {
                hulls(xml, &bake.solids[prop].solid, f64::from_bits(scale), *number)?;
            }
            Ok(())
        })?;
        xml.create_element("worldbody").write_inner_content(|xml| {
            ground(xml, &bake.world)?;
            let count = bake.bodies.len();
            let glue = bake.glue.as_ref();
            let held = glue.map_or(vec![GlueMembership::default(); count], |glue| GlueMembership::all(glue, count));
            let solids = Solids { bake, names: &names, meshes: &meshes };
            for (body, GlueMembership { cluster, anchored }) in held.into_iter().enumerate() {
                match glue.zip(cluster) {
                    None => solids.write(xml, &names[body], &[body], anchored)?,
                    Some((glue, number)) if glue.clusters[number][0] == body => {
                        solids.write(xml, &format!("cluster.{number}"), &glue.clusters[number], anchored)?;
                    }
                    // It is written with the first one of its cluster.
                    Some(_) => {}
                }
            }
            Ok(())
        })?;
        Ok(())
    })?;
    let mut encoded = Encoded::single(xml.into_inner());
    if !scene.scenery.is_empty() {
        let text = "scenery: a MuJoCo model has none of it; add it there as geoms, or what leans on it falls";
        encoded.left_out.push(text.into());
    }
    Ok(encoded)
}

/// From Cairn's axes to MuJoCo's.
fn upright() -> DQuat {
    DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)
}

fn settings(xml: &mut Xml, world: &BakedWorld) -> Result<()> {
    let step = STEP * (world.diameter / world.gravity).sqrt();
    xml.create_element("option")
        .with_attributes([
            ("timestep", number(step).as_str()),
            ("gravity", &numbers([0.0, 0.0, -world.gravity])),
            ("integrator", "implicitfast"),
            ("cone", "elliptic"),
            ("impratio", "10"),
        ])
        .write_empty()?;
    xml.create_element("default").write_inner_content(|xml| {
        xml.create_element("geom")
            .with_attributes([
                ("solref", numbers([CONTACT * step, 1.0]).as_str()),
                ("solimp", &numbers([0.95, 0.99, SOFT * world.diameter])),
                ("condim", "3"),
            ])
            .write_empty()
            .map(|_| ())
    })?;
    Ok(())
}

fn ground(xml: &mut Xml, world: &BakedWorld) -> Result<()> {
    let Some(height) = world.ground else { return Ok(()) };
    xml.create_element("geom")
        .with_attributes([
            ("name", "ground"),
            ("type", "plane"),
            // Half sizes of what is shown, 0 for without end, and the distance of its lines.
            ("size", &numbers([0.0, 0.0, world.diameter])),
            ("pos", &numbers([0.0, 0.0, height])),
            ("friction", &numbers([world.ground_friction, 0.0, 0.0])),
        ])
        .write_empty()?;
    Ok(())
}

/// The convex parts of a prop at one scale.
fn hulls(xml: &mut Xml, solid: &Solid, scale: f64, number: usize) -> Result<()> {
    let Solid::Convex(parts) = solid else { return Ok(()) };
    for (part, points) in parts.iter().enumerate() {
        let corners = points.iter().flat_map(|&point| (point * scale).to_array());
        xml.create_element("mesh")
            .with_attributes([
                ("name", format!("{number}.{part}").as_str()),
                ("inertia", "convex"),
                ("vertex", &numbers(corners)),
            ])
            .write_empty()?;
    }
    Ok(())
}

/// Writes bodies that move as one.
struct Solids<'a> {
    bake: &'a BakedPile,
    names: &'a [String],
    /// The number of the meshes of a prop at a scale, by its bits.
    meshes: &'a BTreeMap<(usize, u64), usize>,
}

impl Solids<'_> {
    fn write(&self, xml: &mut Xml, name: &str, members: &[usize], is_anchored: bool) -> Result<()> {
        let mass: f64 = members.iter().map(|&body| self.mass(body)).sum();
        let center = members.iter().map(|&body| self.mass(body) * self.place(body).translation).sum::<DVec3>() / mass;
        // A body alone keeps its axes; the others have the world's.
        let axes = if let [body] = members { self.place(*body).rotation } else { DQuat::IDENTITY };
        let own = Pose { translation: center, rotation: axes };
        xml.create_element("body")
            .with_attributes([("name", name), ("pos", &numbers(center.to_array())), ("quat", &quaternion(axes))])
            .write_inner_content(|xml| {
                if !is_anchored {
                    xml.create_element("freejoint").write_empty()?;
                }
                let inertia: DMat3 = members.iter().map(|&body| self.inertia(body, &own)).sum();
                let full =
                    [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|(row, column)| inertia.col(column)[row]);
                xml.create_element("inertial")
                    .with_attributes([
                        ("pos", "0 0 0"),
                        ("mass", number(mass).as_str()),
                        ("fullinertia", &numbers(full)),
                    ])
                    .write_empty()?;
                members.iter().try_for_each(|&body| self.geoms(xml, body, &own))
            })?;
        Ok(())
    }

    fn mass(&self, body: usize) -> f64 {
        let BakedBody { prop, scale, .. } = self.bake.bodies[body];
        self.bake.solids[prop].mass * scale.powi(3)
    }

    /// The pose of a body's centre of mass and axes at the last frame, MuJoCo's axes.
    fn place(&self, body: usize) -> Pose {
        let BakedBody { prop, scale, .. } = self.bake.bodies[body];
        let Some(&pose) = self.bake.frames.last().and_then(|frame| frame.get(body)) else { return Pose::IDENTITY };
        let center = pose.transform_point(self.bake.solids[prop].center * scale);
        Pose { translation: upright() * center, rotation: upright() * pose.rotation }
    }

    /// About the origin of a frame, along its axes.
    fn inertia(&self, body: usize, frame: &Pose) -> DMat3 {
        let BakedBody { prop, scale, .. } = self.bake.bodies[body];
        let (principal, turn) = self.bake.solids[prop].inertia;
        let local = self.local(body, frame);
        let axes = DMat3::from_quat(local.rotation * turn);
        let arm = local.translation;
        let outer = DMat3::from_cols(arm * arm.x, arm * arm.y, arm * arm.z);
        let parallel = DMat3::from_diagonal(DVec3::splat(arm.length_squared())) - outer;
        axes * DMat3::from_diagonal(principal * scale.powi(5)) * axes.transpose() + parallel * self.mass(body)
    }

    fn local(&self, body: usize, frame: &Pose) -> Pose {
        let place = self.place(body);
        let back = frame.rotation.inverse();
        Pose { translation: back * (place.translation - frame.translation), rotation: back * place.rotation }
    }

    fn geoms(&self, xml: &mut Xml, body: usize, frame: &Pose) -> Result<()> {
        let BakedBody { prop, scale, .. } = self.bake.bodies[body];
        let (solid, local) = (&self.bake.solids[prop], self.local(body, frame));
        let friction = numbers([solid.friction, 0.0, 0.0]);
        let parts: Vec<(&str, DVec3, DQuat, (&str, String))> = match &solid.solid {
            Solid::Box(b) => vec![("box", b.center, b.rotation, ("size", numbers((b.half * scale).to_array())))],
            Solid::Ball { center, radius } => {
                vec![("sphere", *center, DQuat::IDENTITY, ("size", number(radius * scale)))]
            }
            Solid::Convex(parts) => {
                let mesh = self.meshes[&(prop, scale.to_bits())];
                (0..parts.len())
                    .map(|part| ("mesh", DVec3::ZERO, DQuat::IDENTITY, ("mesh", format!("{mesh}.{part}"))))
                    .collect()
            }
        };
        for (part, (kind, center, turn, (key, value))) in parts.into_iter().enumerate() {
            xml.create_element("geom")
                .with_attributes([
                    ("name", format!("{}.{part}", self.names[body]).as_str()),
                    ("type", kind),
                    ("pos", &numbers(local.transform_point(center * scale).to_array())),
                    ("quat", &quaternion(local.rotation * turn)),
                    ("friction", &friction),
                    (key, &value),
                ])
                .write_empty()?;
        }
        Ok(())
    }
}

fn number(value: f64) -> String {
    // Nine digits hold what single precision does.
    format!("{value:.9e}")
}

fn numbers(values: impl IntoIterator<Item = f64>) -> String {
    values.into_iter().map(number).collect::<Vec<_>>().join(" ")
}

/// MuJoCo's order: w first.
fn quaternion(turn: DQuat) -> String {
    let [x, y, z, w] = turn.normalize().to_array();
    numbers([w, x, y, z])
}
