//! Contacts between bodies, computed from the poses: the engine's own are recycled, clustered and predicted, and may be
//! gone between two bodies that it does not move.

mod hits;
mod meeting;
mod pairs;
mod reserved_places;

pub use hits::ComingHit;
pub(super) use pairs::points;
pub use reserved_places::ReservedPlaces;

use super::{BodyId, World, WorldBody, colliders::Owner};
use crate::shape::Shape;
use cairn_geometry::contact::{self, Bearing};
use glam::DVec3;
use rapier3d::parry::query::DefaultQueryDispatcher;
use rapier3d::prelude::*;

/// The other side of a contact of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PairSide {
    Body(BodyId),
    Ground,
    Scenery,
    /// Scenery that is moving.
    Moving,
}

/// Two things in contact.
#[derive(Clone, Debug)]
pub struct ContactPair {
    pub a: BodyId,
    /// A body behind `a` in the order, or a thing that is no body.
    pub b: PairSide,
    /// Friction coefficient of the pair: the mean of both.
    pub friction: f64,
    pub points: Vec<ContactPoint>,
}

/// One point of a contact, engine units.
#[derive(Clone, Copy, Debug)]
pub struct ContactPoint {
    /// Halfway between the two surfaces.
    pub point: DVec3,
    /// Unit, into `a`.
    pub normal: DVec3,
    /// Negative where they overlap.
    pub gap: f64,
}

impl ContactPair {
    /// Largest overlap of the pair, 0 where there is none.
    pub fn depth(&self) -> f64 {
        self.points.iter().map(|p| -p.gap).fold(0.0, f64::max)
    }

    /// Its points as bearings. A pinned or anchored body carries like scenery.
    pub fn bearings<'a>(&'a self, world: &World) -> impl Iterator<Item = Bearing> + 'a {
        let side = |id: BodyId| match world.bodies[id].role {
            role if role.stands() => contact::End::Fixed,
            _ => contact::End::Body(id),
        };
        let a = side(self.a);
        let b = match self.b {
            PairSide::Body(id) => side(id),
            PairSide::Ground | PairSide::Scenery | PairSide::Moving => contact::End::Fixed,
        };
        self.points.iter().map(move |p| Bearing { a, b, normal: p.normal, gap: p.gap })
    }
}

impl World {
    /// The engine's spatial index of all colliders. It has the boxes of the beginning of the last step: a slow body has
    /// moved by [`PREDICTION`](super::settings::PREDICTION) at most since then.
    pub(super) fn query(&self) -> QueryPipeline<'_> {
        self.engine.broad_phase.as_query_pipeline(
            &DefaultQueryDispatcher,
            &self.engine.bodies,
            &self.engine.colliders,
            QueryFilter::default(),
        )
    }

    /// The side that a collider is in a contact pair; `None` for a container.
    pub(super) fn side_of(&self, collider: &Collider) -> Option<PairSide> {
        match Owner::of(collider) {
            Owner::Container => None,
            Owner::Ground => Some(PairSide::Ground),
            Owner::Scenery(_) | Owner::Core => Some(PairSide::Scenery),
            Owner::Body(id) => Some(PairSide::Body(id)),
            Owner::Moving(id) if self.moving[id].moves => Some(PairSide::Moving),
            Owner::Moving(_) => Some(PairSide::Scenery),
        }
    }

    /// The body that a collider is of. `None`, too, for one that has been removed since the last step: the engine's
    /// contacts still name it.
    pub(super) fn body_of(&self, collider: ColliderHandle) -> Option<BodyId> {
        match Owner::of(self.engine.colliders.get(collider)?) {
            Owner::Body(id) => Some(id),
            _ => None,
        }
    }

    /// Bodies glued to each other, as if each rested on the others.
    pub fn glue_bearings(&self) -> Vec<Bearing> {
        let bearing = |a: BodyId, b: BodyId| Bearing {
            a: contact::End::Body(a),
            b: contact::End::Body(b),
            normal: DVec3::Y,
            gap: 0.0,
        };
        let leaders = self.present().filter(|&id| self.bodies[id].cluster.is_some() && self.bodies.leads(id));
        let both = leaders.flat_map(|id| self.bodies.glued_with(id)[1..].iter().map(move |&other| (id, other)));
        both.flat_map(|(a, b)| [bearing(a, b), bearing(b, a)]).collect()
    }

    /// Thickness of the thinner one of a pair.
    pub fn pair_thickness(&self, pair: &ContactPair) -> f64 {
        self.thinner(pair.a, pair.b)
    }

    /// Thickness of the thinner one's material: overlaps of hollow bodies are seen as shares of their walls.
    pub fn pair_wall(&self, pair: &ContactPair) -> f64 {
        let wall = self.bodies[pair.a].wall;
        if let PairSide::Body(b) = pair.b { wall.min(self.bodies[b].wall) } else { wall }
    }

    /// From now on, contacts are those of the bodies' meshes, for statics: `shapes` of the props are bare
    /// ([`Shape::bared`]), what touched with its skin touches, and where edges meet, the normal is theirs.
    pub fn judge_meshes(&mut self, shapes: &[Shape]) {
        self.judges_meshes = true;
        for id in self.present().collect::<Vec<_>>() {
            let WorldBody { prop, scale, .. } = self.bodies[id];
            let skin = shapes[prop].skin * scale / self.units.length;
            self.bodies[id].skin = skin;
            self.most_skin = self.most_skin.max(skin);
        }
    }

    /// The skins of both of a pair that were taken off.
    fn skins(&self, a: BodyId, b: PairSide) -> f64 {
        let other = if let PairSide::Body(b) = b { self.bodies[b].skin } else { 0.0 };
        self.bodies[a].skin + other
    }

    fn thinner(&self, a: BodyId, b: PairSide) -> f64 {
        match b {
            PairSide::Body(b) => self.bodies[a].thickness.min(self.bodies[b].thickness),
            PairSide::Ground | PairSide::Scenery | PairSide::Moving => self.bodies[a].thickness,
        }
    }
}
