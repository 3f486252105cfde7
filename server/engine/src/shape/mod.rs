//! Props as the engine sees them: collision shape, mass properties, and the shape's distance from the mesh.
//!
//! A body's frame has its origin in the centre of mass and the prop's own axes; [`Shape::body_pose`] and
//! [`Shape::prop_pose`] convert. Sizes are those of the prop at scale 1, in metres.

mod bare;
mod choose;
mod convex;
mod corners;
mod deviation;
mod enclose;
mod facets;
mod fit;
mod hull;
mod kind;
mod lanes;
mod mass;
mod nest;
mod outer;
#[cfg(test)]
mod random_props;
mod round;
mod size;
mod skeleton;
mod summary;

use cairn_geometry::HOLLOW;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::error::{Error, SceneProblem};
use cairn_input::observer::{Observer, Progress, Stage, observe};
use cairn_input::params::{Params, Physics};
use cairn_input::scene::{Prop, Scene};
use convex::Fitted;
use glam::{DMat3, DQuat, DVec3};
use mass::Moments;
use rapier3d::math::{Pose as EnginePose, Vector};
use rapier3d::prelude::{MassProperties, SharedShape};
use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;

pub use convex::hull_mesh;
pub use corners::corners;
pub use facets::{EdgesAround, Facet, HullEdge};
pub use fit::{OrientedBox, oriented_box};
pub use hull::Hull;
pub use kind::ShapeKind;
pub(crate) use lanes::{
    CornerLanes, LANES, PlaneLanes, dot, eight, flat, greater, greatest, heights, outermost, position, top,
};
pub use mass::principal;
pub use nest::NestingPose;
pub use outer::outer_hulls;
pub use size::Size;
pub use summary::{ShapeSummary, summaries};

/// The error for a prop, from its text.
pub fn fault(index: usize) -> impl Fn(String) -> Error {
    move |text| Error::Invalid(vec![SceneProblem::new(format!("props.{index}"), text)])
}

/// The collision shapes of all props.
pub fn run(scene: &Scene, params: &Params, sizes: &[Size], observer: &mut dyn Observer) -> Result<Vec<Shape>, Error> {
    let mut shapes = Vec::new();
    for (i, (prop, size)) in scene.props.iter().zip(sizes).enumerate() {
        let fraction = i as f64 / scene.props.len() as f64;
        observe(
            observer,
            &Progress { stage: Stage::Shape, fraction, bodies: 0, released: 0, at_rest: 0, nails: 0, frames: 0 },
        )?;
        shapes.push(Shape::new(prop, *size, &params.physics).map_err(fault(i))?);
    }
    Ok(shapes)
}

/// The collision shape of a prop, for the report.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ShapeFit {
    pub prop: String,
    pub kind: ShapeKind,
    pub parts: usize,
    /// Largest distance between the mesh and its collision shape, relative to the prop's diameter.
    pub deviation_rel: f64,
    /// kg at scale 1.
    pub mass: f64,
    /// Source of the mass properties, if the mesh is open or flat.
    pub mass_fallback: Option<String>,
}

/// A prop, ready to be simulated.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Shape {
    /// Centre of mass in the prop's frame, m.
    pub center: DVec3,
    /// m^3.
    pub volume: f64,
    /// kg.
    pub mass: f64,
    /// Principal moments of inertia about the centre of mass, kg m^2, and the rotation from their axes.
    pub inertia: (DVec3, DQuat),
    /// Radius of the sphere about the centre of mass that holds the prop, m.
    pub radius: f64,
    pub size: Size,
    /// The direction in which the prop is thinnest, in the body's frame; unit.
    pub thin_axis: DVec3,
    pub solid: Solid,
    /// The same without the skin around its hulls, for other engines: what presses there lets bodies overlap by less
    /// than the skin.
    pub bare: Solid,
    /// How far its solid stood out before the skin was taken off ([`Shape::bared`]), m; 0 where that was not done.
    #[serde(default)]
    pub skin: f64,
    pub report: ShapeFit,
    /// The hulls of a convex solid's parts, at a size of about 1: those of each scale are made from these.
    #[serde(skip)]
    hulls: OnceLock<Option<Vec<Hull>>>,
    #[serde(skip)]
    skeleton: OnceLock<Vec<[DVec3; 2]>>,
}

/// The collision shape, about the centre of mass, m.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub enum Solid {
    Box(OrientedBox),
    Ball {
        center: DVec3,
        radius: f64,
    },
    /// One or more convex parts, each the hull of its points.
    Convex(Vec<Vec<DVec3>>),
}

/// No one sees less, in prop diameters: the thickness of a sheet of paper on a book. A mesh within it of a box is one;
/// a hull leaves out corners that stand out by less.
const INVISIBLE: f32 = 1.0 / 500.0;
/// The share of [`Physics::shape_gap`] that is a skin around a hull: less of what the engine lets overlap is seen.
const SKIN: f64 = 0.25;
/// Flat props are given this thickness, as a share of their diameter.
const FLAT_THICKNESS: f64 = 0.01;

impl Shape {
    /// Builds the shape of a prop.
    pub fn new(prop: &Prop, size: Size, physics: &Physics) -> Result<Shape, String> {
        // An inside-out prop is its outward twin.
        let mesh = &prop.model.mesh.outward();
        let Size { diameter, closed, .. } = size;
        let around = fit::oriented_box(mesh);
        let Fitted { solid, bare, deviation } = choose::solid(mesh, &around, &size, prop.mesh_deviation, physics);
        let own = if closed { mass::of_solid(mesh, size.has_parts) } else { mass::moments(mesh) };
        let solid_moments = solid.moments();
        let (moments, fallback) = match no_inside(closed, &own, mesh, solid_moments.volume) {
            None => (own, None),
            Some(why) if solid_moments.are_of_a_body(mesh.bounds()) => {
                (solid_moments, Some(format!("{why}: mass and inertia are those of its collision shape")))
            }
            // The volume of parts as thin as paper is rounding.
            Some(why) => {
                let text = format!("{why}: mass and inertia are those of the box around it");
                (Solid::Box(around).moments(), Some(text))
            }
        };
        if !(moments.volume > 0.0 && moments.volume.is_finite() && moments.inertia.is_finite()) {
            return Err(format!(
                "{}: no volume could be found for this prop; close the mesh or give it thickness",
                prop.model.name
            ));
        }
        let radius = mesh.points.iter().map(|p| p.distance(moments.center)).fold(0.0, f64::max);
        let (principal, frame) = mass::principal(moments.inertia);
        // A needle's smallest moment may round to zero, which an engine takes for infinity.
        let principal = principal.max(DVec3::splat(principal.max_element() * 1e-6));
        let mass = moments.volume * prop.density;
        let [solid, bare] = [solid, bare].map(|solid| solid.moved(-moments.center));
        let report = ShapeFit {
            prop: prop.model.name.clone(),
            kind: solid.kind(),
            parts: solid.parts(),
            deviation_rel: deviation / diameter,
            mass,
            mass_fallback: fallback,
        };
        Ok(Shape {
            center: moments.center,
            volume: moments.volume,
            mass,
            inertia: (principal * prop.density, frame),
            radius,
            size,
            thin_axis: around.thin_axis(),
            solid,
            bare,
            skin: 0.0,
            report,
            hulls: OnceLock::new(),
            skeleton: OnceLock::new(),
        })
    }

    pub fn summary(&self) -> ShapeSummary {
        let Shape { solid, mass, .. } = self;
        ShapeSummary { kind: solid.kind(), mass: *mass, thickness: self.thickness() }
    }

    /// Smallest extent, m.
    pub fn thickness(&self) -> f64 {
        self.size.extents.x
    }

    /// The body's pose (origin in the centre of mass) of a prop placed at `pose` with this scale.
    pub fn body_pose(&self, pose: &Pose, scale: f64) -> Pose {
        Pose { translation: pose.transform_point(self.center * scale), rotation: pose.rotation }
    }

    /// The inverse of [`Shape::body_pose`].
    pub fn prop_pose(&self, body: &Pose, scale: f64) -> Pose {
        Pose { translation: body.transform_point(-self.center * scale), rotation: body.rotation }
    }

    /// The point about which programs should turn the prop between two poses, in the prop's frame, m: its origin where
    /// that is on the prop or near it; else its center of mass, since a straight way of a far origin would take the
    /// prop off its own.
    pub fn pivot(&self) -> DVec3 {
        if self.center.length() > self.radius { self.center } else { DVec3::ZERO }
    }

    /// The engine's shape and its place in the body's frame, `scale` engine units per metre of the prop. `None` where
    /// the engine finds no volume.
    pub fn collider(&self, scale: f64) -> Option<(EnginePose, SharedShape)> {
        match &self.solid {
            Solid::Box(b) => {
                let half = (b.half * scale).as_vec3();
                let cuboid = SharedShape::cuboid(half.x, half.y, half.z);
                let place = EnginePose::from_parts((b.center * scale).as_vec3(), b.rotation.as_quat());
                Some((place, cuboid))
            }
            Solid::Ball { center, radius } => {
                let place = EnginePose::from_translation((*center * scale).as_vec3());
                Some((place, SharedShape::ball((radius * scale) as f32)))
            }
            Solid::Convex(_) => {
                let hulls = self.unit_hulls()?;
                let scaled = |hull: &Hull| SharedShape::new(hull.scaled((scale * self.size.diameter) as f32));
                let whole = match hulls {
                    [hull] => scaled(hull),
                    hulls => SharedShape::compound(hulls.iter().map(|h| (EnginePose::IDENTITY, scaled(h))).collect()),
                };
                Some((EnginePose::IDENTITY, whole))
            }
        }
    }

    /// The hulls of a convex solid's parts, in the prop's diameter.
    fn unit_hulls(&self) -> Option<&[Hull]> {
        let Solid::Convex(parts) = &self.solid else { return None };
        let hull = |points: &Vec<DVec3>| {
            let points: Vec<Vector> = points.iter().map(|&p| (p / self.size.diameter).as_vec3()).collect();
            Hull::new(&points)
        };
        self.hulls.get_or_init(|| parts.iter().map(hull).collect()).as_deref()
    }

    /// The engine's mass properties for a body at this scale: `length` engine units per metre, `mass` engine units
    /// per kg.
    pub fn mass_properties(&self, scale: f64, length: f64, mass: f64) -> MassProperties {
        let (principal, frame) = self.inertia;
        let moment = principal * scale.powi(5) * length * length * mass;
        let kg = self.mass * scale.powi(3) * mass;
        MassProperties::with_principal_inertia_frame(Vector::ZERO, kg as f32, moment.as_vec3(), frame.as_quat())
    }
}

impl Solid {
    pub fn kind(&self) -> ShapeKind {
        match self {
            Solid::Box(_) => ShapeKind::Box,
            Solid::Ball { .. } => ShapeKind::Ball,
            Solid::Convex(parts) if parts.len() == 1 => ShapeKind::Hull,
            Solid::Convex(_) => ShapeKind::Parts,
        }
    }

    /// Corners of all parts; 1 for a ball.
    pub fn corners(&self) -> usize {
        match self {
            Solid::Box(_) => 8,
            Solid::Ball { .. } => 1,
            Solid::Convex(parts) => parts.iter().map(Vec::len).sum(),
        }
    }

    /// Convex pieces.
    pub fn parts(&self) -> usize {
        match self {
            Solid::Convex(parts) => parts.len(),
            _ => 1,
        }
    }

    /// A box or a ball, this much larger on all sides, m.
    fn larger(self, by: f64) -> Solid {
        match self {
            Solid::Box(b) => Solid::Box(OrientedBox { half: b.half + by, ..b }),
            Solid::Ball { center, radius } => Solid::Ball { center, radius: radius + by },
            convex => convex,
        }
    }

    /// A closed mesh of each convex piece. That of a ball lies within it.
    pub fn meshes(&self) -> Vec<TriMesh> {
        let hull = |points: Vec<DVec3>| convex::hull_mesh(&points);
        match self {
            Solid::Box(b) => vec![hull(b.corners().collect())],
            Solid::Ball { center, radius } => vec![hull(sphere().map(|p| *center + p * *radius).collect())],
            Solid::Convex(parts) => parts.iter().map(|part| convex::hull_mesh(part)).collect(),
        }
    }

    /// The same, `factor` times as large about the origin.
    pub fn scaled(&self, factor: f64) -> Solid {
        match self {
            &Solid::Box(OrientedBox { center, rotation, half }) => {
                Solid::Box(OrientedBox { center: center * factor, rotation, half: half * factor })
            }
            Solid::Ball { center, radius } => Solid::Ball { center: *center * factor, radius: radius * factor },
            Solid::Convex(parts) => {
                Solid::Convex(parts.iter().map(|part| part.iter().map(|&p| p * factor).collect()).collect())
            }
        }
    }

    fn moved(self, by: DVec3) -> Solid {
        match self {
            Solid::Box(b) => Solid::Box(OrientedBox { center: b.center + by, ..b }),
            Solid::Ball { center, radius } => Solid::Ball { center: center + by, radius },
            Solid::Convex(parts) => {
                Solid::Convex(parts.into_iter().map(|p| p.into_iter().map(|v| v + by).collect()).collect())
            }
        }
    }

    /// Volume, centre and inertia of the collision shape; overlapping parts count twice.
    fn moments(&self) -> mass::Moments {
        match self {
            Solid::Box(b) => {
                let d = b.half * b.half * 4.0 / 12.0;
                let local = DMat3::from_diagonal(DVec3::new(d.y + d.z, d.x + d.z, d.x + d.y) * b.volume());
                let r = DMat3::from_quat(b.rotation);
                mass::Moments { volume: b.volume(), center: b.center, inertia: r * local * r.transpose() }
            }
            Solid::Ball { center, radius } => {
                let volume = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
                let inertia = DMat3::from_diagonal(DVec3::splat(0.4 * volume * radius * radius));
                mass::Moments { volume, center: *center, inertia }
            }
            Solid::Convex(parts) => {
                let mut all = TriMesh::default();
                for part in parts {
                    all.append(&convex::hull_mesh(part));
                }
                mass::moments(&all)
            }
        }
    }
}

/// Points of the unit sphere.
pub fn sphere() -> impl Iterator<Item = DVec3> {
    (0..=8).flat_map(|i| {
        let (height, out) = (libm::cos(PI * f64::from(i) / 8.0), libm::sin(PI * f64::from(i) / 8.0));
        (0..16).map(move |k| {
            let turn = TAU * f64::from(k) / 16.0;
            DVec3::new(out * libm::cos(turn), height, out * libm::sin(turn))
        })
    })
}

/// The reason, if a mesh has no usable inside.
fn no_inside(closed: bool, own: &Moments, mesh: &TriMesh, solid: f64) -> Option<&'static str> {
    if !closed {
        return Some("the mesh is open");
    }
    if own.volume < HOLLOW * solid {
        return Some("the mesh encloses next to no volume");
    }
    (!own.are_of_a_body(mesh.bounds())).then_some("the mesh crosses itself")
}
