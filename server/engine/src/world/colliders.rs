//! The owner of each collider, kept in the collider's user data.

use rapier3d::prelude::*;

/// Index of a body, in the order of insertion; never reused.
pub type BodyId = usize;

/// Index of a piece of moving scenery, in the order of insertion.
pub type MovingId = usize;

/// Index of a piece of scenery that stands still, in the order of insertion.
pub type PieceId = usize;

/// The owner of a collider.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    Ground,
    /// The core of a pile.
    Core,
    Container,
    Body(BodyId),
    Moving(MovingId),
    Scenery(PieceId),
}

/// User data: these, or [`FIRST_BODY`] plus a body's index.
const GROUND: u128 = 0;
const CORE: u128 = 1;
const CONTAINER: u128 = 2;
const FIRST_BODY: u128 = 3;
/// Plus the index of a piece of moving scenery: above all bodies.
const FIRST_MOVING: u128 = 1 << 64;
/// Plus the index of a piece that stands still: above those.
const FIRST_PIECE: u128 = 1 << 65;

impl Owner {
    pub fn user_data(self) -> u128 {
        match self {
            Owner::Ground => GROUND,
            Owner::Core => CORE,
            Owner::Container => CONTAINER,
            Owner::Body(id) => FIRST_BODY + id as u128,
            Owner::Moving(id) => FIRST_MOVING + id as u128,
            Owner::Scenery(id) => FIRST_PIECE + id as u128,
        }
    }

    pub fn of(collider: &Collider) -> Owner {
        match collider.user_data {
            GROUND => Owner::Ground,
            CORE => Owner::Core,
            CONTAINER => Owner::Container,
            data if data < FIRST_MOVING => Owner::Body((data - FIRST_BODY) as BodyId),
            data if data < FIRST_PIECE => Owner::Moving((data - FIRST_MOVING) as MovingId),
            data => Owner::Scenery((data - FIRST_PIECE) as PieceId),
        }
    }
}

/// Bodies that the container keeps in, and those that it lets through.
pub const INSIDE: Group = Group::GROUP_1;
pub const OUTSIDE: Group = Group::GROUP_2;
