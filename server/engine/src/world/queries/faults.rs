//! Bodies deep in each other, too fast, or below the ground.

use crate::world::{BodyId, BodySize, World};
use rapier3d::prelude::{ContactPair as EnginePair, RigidBody};

impl World {
    /// Pairs that overlap by more than `share` of the thinner one's thickness, as the engine's contacts have it.
    pub fn deep_pairs(&self, share: f64) -> Vec<(BodyId, Option<BodyId>)> {
        let deepest = |pair: &EnginePair| {
            let points = pair.manifolds().iter().flat_map(|m| &m.points);
            f64::from(points.map(|p| -p.dist).fold(0.0, f32::max))
        };
        let mut deep = Vec::new();
        for pair in self.engine.narrow_phase.contact_pairs() {
            let depth = deepest(pair);
            if depth <= 0.0 {
                continue;
            }
            let (a, b) = match (self.body_of(pair.collider1), self.body_of(pair.collider2)) {
                (Some(a), b) => (a, b),
                (None, Some(b)) => (b, None),
                (None, None) => continue,
            };
            let thickness = |id: BodyId| self.bodies[id].thickness;
            if depth > share * b.map_or(f64::INFINITY, thickness).min(thickness(a)) {
                deep.push((a.min(b.unwrap_or(a)), b.map(|b| a.max(b))));
            }
        }
        deep.sort_unstable();
        deep.dedup();
        deep
    }

    /// Awake free bodies that exceed the speed limits, or that sink faster than `sinking` at more than one radius below
    /// `ground`. The flag says that a speed limit was exceeded. Spin is converted to the speed of equal kinetic energy.
    pub fn runaway_bodies(&self, most: f64, most_spin: f64, ground: f64, sinking: f64) -> Vec<(BodyId, bool)> {
        let mut runaway = Vec::new();
        for (id, rigid) in self.bodies.moving(&self.engine) {
            let BodySize { mass, radius, .. } = self.bodies.carried(id);
            // The rim is faster than the speed of equal energy: most bodies need no more than this look.
            let may_spin = f64::from(rigid.angvel().length()) * radius > most_spin;
            let too_fast = f64::from(rigid.linvel().length()) > most || may_spin && spin(rigid, mass) > most_spin;
            let below = f64::from(rigid.translation().y) < ground - radius && f64::from(rigid.linvel().y) < -sinking;
            if too_fast || below {
                runaway.push((id, too_fast));
            }
        }
        runaway
    }
}

/// The speed at which a body of this mass has as much energy as it has by turning.
fn spin(rigid: &RigidBody, mass: f64) -> f64 {
    let inertia = rigid.mass_properties().local_mprops.reconstruct_inertia_matrix();
    let spin = rigid.rotation().inverse() * rigid.angvel();
    (f64::from(spin.dot(inertia * spin)) / mass).sqrt()
}
