//! Engine units: the one place of the conversion.

use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::params::Time;
use glam::DVec3;

/// Distance of a scene's middle from its origin, in d, from which on the engine gets an origin of its own: nearer ones
/// are as exact as 1e-5 d.
const FAR: f64 = 100.0;

/// SI value of one engine unit, and the place of the engine's origin.
///
/// The engine computes in single precision: far from its origin, it would place bodies as coarsely as a millimeter. So
/// its origin is the middle of a scene that is far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    /// m: the diameter d of the median prop.
    pub length: f64,
    /// s: the characteristic time sqrt(d / g).
    pub time: f64,
    /// kg.
    pub mass: f64,
    /// m, of the scene.
    pub origin: DVec3,
}

impl Units {
    /// Units in which the median prop has size, mass and gravity 1.
    pub fn new(diameter: f64, mass: f64, gravity: f64) -> Units {
        Units { length: diameter, time: (diameter / gravity).sqrt(), mass, origin: DVec3::ZERO }
    }

    /// The same units for a scene with this middle, m: the engine's origin is there along each axis on which it is far.
    pub fn about(self, middle: DVec3) -> Units {
        let is_far = middle.abs().cmpgt(DVec3::splat(FAR * self.length));
        Units { origin: DVec3::select(is_far, middle, DVec3::ZERO), ..self }
    }

    /// A duration in engine units.
    pub fn duration(&self, time: Time) -> f64 {
        match time {
            Time::Natural(t) => t,
            Time::Seconds(s) => s / self.time,
        }
    }

    pub fn pose_to_engine(&self, pose: &Pose) -> Pose {
        Pose { translation: self.point_to_engine(pose.translation), ..*pose }
    }

    pub fn pose_to_si(&self, pose: &Pose) -> Pose {
        Pose { translation: self.point_to_si(pose.translation), ..*pose }
    }

    pub fn point_to_engine(&self, point: DVec3) -> DVec3 {
        (point - self.origin) / self.length
    }

    pub fn point_to_si(&self, point: DVec3) -> DVec3 {
        point * self.length + self.origin
    }

    /// A height above the scene's origin, m -> above the engine's.
    pub fn height_to_engine(&self, height: f64) -> f64 {
        (height - self.origin.y) / self.length
    }

    pub fn mesh_to_engine(&self, mesh: &TriMesh) -> TriMesh {
        let points = mesh.points.iter().map(|&p| self.point_to_engine(p)).collect();
        TriMesh { points, triangles: mesh.triangles.clone() }
    }
}
