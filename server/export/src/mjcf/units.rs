//! Units of a model in which MuJoCo takes even the lightest body.

use cairn_core::report::bake::{BakedBody, BakedPile, BakedSolid, BakedWorld};
use cairn_engine::shape::Solid;
use cairn_geometry::pose::Pose;
use std::borrow::Cow;

/// MuJoCo refuses bodies with a moment of inertia below this, in the model's units (`mjEPS` of MuJoCo 4.0).
const LEAST_INERTIA: f64 = 1e-14;
/// It refuses meshes of less volume than this, and bodies of less mass (`mjMINVAL` of MuJoCo 4.0).
const LEAST_VOLUME: f64 = 1e-15;
/// Bodies are this many times above these limits: its solver takes what is near to them for zero, too.
const CLEAR_OF_LIMIT: f64 = 10.0;

/// Units of length, mass and time; a second is always the unit of time. Of lengths and masses by the same factor, so
/// that a step of a factor of 1000 is one of 1e9 for a moment of inertia.
#[derive(Debug, PartialEq)]
pub struct ModelUnits {
    /// Units in a metre, and in a kilogram.
    pub per_si: f64,
    /// Of length and mass.
    names: [&'static str; 2],
}

/// The last ones are enough for grains of a fifth of a micrometer.
const ALL: [ModelUnits; 3] = [
    ModelUnits { per_si: 1.0, names: ["meters", "kilograms"] },
    ModelUnits { per_si: 1e3, names: ["millimeters", "grams"] },
    ModelUnits { per_si: 1e6, names: ["micrometers", "milligrams"] },
];

impl ModelUnits {
    /// The first in which MuJoCo takes all bodies.
    pub fn of(bake: &BakedPile) -> &'static ModelUnits {
        let (inertia, volume, mass) = least(bake);
        let is_taken = |units: &&ModelUnits| {
            let factor = units.per_si;
            inertia * factor.powi(3) >= CLEAR_OF_LIMIT * LEAST_INERTIA
                && volume * factor.powi(3) >= CLEAR_OF_LIMIT * LEAST_VOLUME
                && mass * factor >= CLEAR_OF_LIMIT * LEAST_VOLUME
        };
        ALL.iter().find(is_taken).unwrap_or(&ALL[ALL.len() - 1])
    }

    /// Whether they are not those of all other formats.
    pub fn are_small(&self) -> bool {
        self.per_si > 1.0
    }

    pub fn sentence(&self) -> String {
        let [length, mass] = self.names;
        format!(
            "the MuJoCo model is in {length} and {mass}: in meters and kilograms, MuJoCo refuses bodies whose moment \
             of inertia is below {LEAST_INERTIA:e} kg m^2. Gravity is in these units, too; divide lengths and masses \
             by {:e}",
            self.per_si
        )
    }

    /// The last frame in these units. Places of glue are left as they are: no model has them.
    pub fn applied<'a>(&self, bake: &'a BakedPile) -> Cow<'a, BakedPile> {
        if !self.are_small() {
            return Cow::Borrowed(bake);
        }
        let factor = self.per_si;
        let mut last = bake.last_frame();
        let moved = |pose: &mut Pose| pose.translation *= factor;
        last.frames.iter_mut().chain(&mut last.scenery).flatten().for_each(moved);
        for BakedSolid { pivot, center, mass, inertia, friction: _, restitution: _, solid } in &mut last.solids {
            *pivot *= factor;
            *center *= factor;
            *mass *= factor;
            inertia.0 *= factor.powi(3);
            *solid = solid.scaled(factor);
        }
        let BakedWorld { gravity, ground, ground_friction: _, diameter } = &mut last.world;
        *gravity *= factor;
        *diameter *= factor;
        ground.iter_mut().for_each(|height| *height *= factor);
        Cow::Owned(last)
    }
}

/// The least moment of inertia, volume of a convex part and mass of any body, SI. Several that are one body have more.
fn least(bake: &BakedPile) -> (f64, f64, f64) {
    let volume = |solid: &BakedSolid| match &solid.solid {
        Solid::Convex(_) => solid.solid.meshes().iter().map(|part| part.signed_volume().abs()).fold(f64::MAX, f64::min),
        Solid::Box(_) | Solid::Ball { .. } => f64::MAX,
    };
    let volumes: Vec<f64> = bake.solids.iter().map(volume).collect();
    let mut found = (f64::MAX, f64::MAX, f64::MAX);
    for &BakedBody { prop, scale, mass_factor, .. } in &bake.bodies {
        let (inertia, mass) = (bake.solids[prop].inertia.0.min_element(), bake.solids[prop].mass);
        found.0 = found.0.min(inertia * scale.powi(5) * mass_factor);
        found.1 = found.1.min(volumes[prop] * scale.powi(3));
        found.2 = found.2.min(mass * scale.powi(3) * mass_factor);
    }
    found
}
