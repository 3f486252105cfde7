//! MJCF, the models of MuJoCo: the pile of the last frame, to be simulated further.
//!
//! Metres and kilograms, Z up, as MuJoCo has it: Cairn's (x, y, z) is (x, -z, y) here. Each free body is a `body` with
//! a `freejoint`, with the mass and inertia that it had in the bake, and one `geom` for each convex part of its
//! collision shape. Bodies that are glued to each other are one `body`, named `cluster.N`; one that is glued to the
//! ground, or that the scene keeps where it is, has no joint. A body's geoms are named `NAME.PART`, by its name in all
//! formats. The ground is a plane. Scenery, where it is in the last frame, is `scenery.PIECE.PART`: MuJoCo knows only
//! convex solids, so what is not convex is plates as thin as a twentieth of a prop.
//!
//! MuJoCo takes a moment of inertia or a volume below some limit for none, and refuses the model. Where a body is as
//! small as a grain of sand, the model is in millimetres and grams, and says so (`units.rs`).
//!
//! MuJoCo softens contacts. They are as hard here as the time step bears, a hundredth of the characteristic time
//! sqrt(d / g), where d is the diameter of the median prop.

mod units;

use super::convex_cover::{ConvexCover, CoverLimits};
use super::physics::{MassModel, RigidGroup, SceneryCollider};
use super::{Encoded, ExportError, ExportScene, body_names};
use cairn_core::report::bake::{BakedBody, BakedPile, BakedWorld};
use cairn_engine::shape::Solid;
use cairn_geometry::pose::Pose;
use glam::{DQuat, DVec3};
use quick_xml::Writer;
use std::collections::BTreeMap;
use std::io::Result;
use units::ModelUnits;

/// Time step, characteristic times.
const STEP: f64 = 0.01;
/// Time constant of contacts, steps: MuJoCo asks for two at least.
const CONTACT: f64 = 2.0;
/// Depth within which a contact reaches its full stiffness, d.
const SOFT: f64 = 1e-3;
/// Scenery farther than this from the pile is left out, d.
const REACH: f64 = 20.0;
/// Thickness of scenery that is a sheet or not convex, d: its outer faces are where they were.
const PLATE: f64 = 0.05;
/// Convex solids of the scenery at most: MuJoCo takes a second for some thousands.
const MOST_SOLIDS: usize = 4000;

type Xml = Writer<Vec<u8>>;

/// The `.xml`.
pub fn encode(bake: &BakedPile, scene: &ExportScene) -> std::result::Result<Encoded, ExportError> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 1);
    let names = body_names(bake, scene);
    let mut colliders = SceneryCollider::all(bake, scene);
    let units = ModelUnits::of(bake);
    if units.are_small() {
        colliders.iter_mut().for_each(|collider| collider.mesh = collider.mesh.scaled(units.per_si));
    }
    let bake = &*units.applied(bake);
    let masses = MassModel { bake, turn: upright() };
    let (low, high) = masses.bounds();
    let (reach, mut left_out, mut scenery) = (DVec3::splat(REACH * bake.world.diameter), 0, Vec::new());
    for SceneryCollider { piece, mesh, friction } in &colliders {
        let limits = CoverLimits {
            bounds: (low - reach, high + reach),
            thickness: PLATE * bake.world.diameter,
            most: MOST_SOLIDS.saturating_sub(scenery.len()),
        };
        let cover = ConvexCover::new(mesh, &limits);
        left_out += cover.left_out;
        let named = |(part, points)| (format!("scenery.{piece}.{part}"), *friction, points);
        scenery.extend(cover.solids.into_iter().enumerate().map(named));
    }
    let mut meshes = BTreeMap::new();
    for &BakedBody { prop, scale, .. } in &bake.bodies {
        let count = meshes.len();
        meshes.entry((prop, scale.to_bits())).or_insert(count);
    }
    xml.create_element("mujoco").with_attribute(("model", "pile")).write_inner_content(|xml| {
        xml.create_element("compiler")
            .with_attributes([("angle", "radian"), ("balanceinertia", "true")])
            .write_empty()?;
        if units.are_small() {
            custom(xml, units)?;
        }
        settings(xml, &bake.world)?;
        xml.create_element("asset").write_inner_content(|xml| {
            for (&(prop, scale), number) in &meshes {
                let Solid::Convex(parts) = &bake.solids[prop].solid else { continue };
                for (part, points) in parts.iter().enumerate() {
                    let corners = points.iter().map(|&point| point * f64::from_bits(scale));
                    mesh(xml, &format!("{number}.{part}"), "convex", corners)?;
                }
            }
            for (name, _, points) in &scenery {
                mesh(xml, name, "shell", points.iter().map(|&point| upright() * point))?;
            }
            Ok(())
        })?;
        xml.create_element("worldbody").write_inner_content(|xml| {
            ground(xml, &bake.world)?;
            for (name, friction, _) in &scenery {
                xml.create_element("geom")
                    .with_attributes([
                        ("name", name.as_str()),
                        ("type", "mesh"),
                        ("mesh", name),
                        ("friction", &numbers([*friction, 0.0, 0.0])),
                    ])
                    .write_empty()?;
            }
            let solids = Solids { masses, names: &names, meshes: &meshes };
            RigidGroup::all(bake, &names).iter().try_for_each(|group| solids.write(xml, group))
        })?;
        Ok(())
    })?;
    let mut encoded = Encoded::single(xml.into_inner());
    if units.are_small() {
        encoded.left_out.push(units.sentence());
    }
    if left_out > 0 {
        encoded.left_out.push(format!(
            "scenery: {left_out} of its {} triangles are not in the MuJoCo model: they are far from the pile, or there \
             are too many near it. Bodies that get there fall",
            colliders.iter().map(|collider| collider.mesh.triangles.len()).sum::<usize>()
        ));
    }
    Ok(encoded)
}

/// From Cairn's axes to MuJoCo's.
fn upright() -> DQuat {
    DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)
}

/// The units of the model, for programs.
fn custom(xml: &mut Xml, units: &ModelUnits) -> Result<()> {
    let size = number(1.0 / units.per_si);
    xml.create_element("custom").write_inner_content(|xml| {
        for name in ["meters_per_unit", "kilograms_per_unit"] {
            xml.create_element("numeric").with_attributes([("name", name), ("data", &size)]).write_empty()?;
        }
        Ok(())
    })?;
    Ok(())
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

/// A convex solid, the hull of its corners.
fn mesh(xml: &mut Xml, name: &str, inertia: &str, corners: impl Iterator<Item = DVec3>) -> Result<()> {
    let corners = numbers(corners.flat_map(|corner| corner.to_array()));
    xml.create_element("mesh")
        .with_attributes([("name", name), ("inertia", inertia), ("vertex", &corners)])
        .write_empty()?;
    Ok(())
}

/// Writes bodies that move as one.
struct Solids<'a> {
    masses: MassModel<'a>,
    names: &'a [String],
    /// The number of the meshes of a prop at a scale, by its bits.
    meshes: &'a BTreeMap<(usize, u64), usize>,
}

impl Solids<'_> {
    fn write(&self, xml: &mut Xml, group: &RigidGroup) -> Result<()> {
        let (masses, members) = (&self.masses, &group.members);
        let frame = masses.frame(members);
        let (pos, quat) = (numbers(frame.translation.to_array()), quaternion(frame.rotation));
        xml.create_element("body")
            .with_attributes([("name", group.name.as_str()), ("pos", &pos), ("quat", &quat)])
            .write_inner_content(|xml| {
                if !group.is_fixed {
                    xml.create_element("freejoint").write_empty()?;
                }
                let inertia = masses.inertia_in(members, &frame);
                let full =
                    [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|(row, column)| inertia.col(column)[row]);
                xml.create_element("inertial")
                    .with_attributes([
                        ("pos", "0 0 0"),
                        ("mass", number(masses.total(members)).as_str()),
                        ("fullinertia", &numbers(full)),
                    ])
                    .write_empty()?;
                members.iter().try_for_each(|&body| self.geoms(xml, body, &frame))
            })?;
        Ok(())
    }

    fn geoms(&self, xml: &mut Xml, body: usize, frame: &Pose) -> Result<()> {
        let bake = self.masses.bake;
        let BakedBody { prop, scale, .. } = bake.bodies[body];
        let (solid, local) = (&bake.solids[prop], self.masses.local(body, frame));
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
