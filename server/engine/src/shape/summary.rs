//! The part of a prop's collision shape that decides on effects, known before the shape is made.

use super::{Shape, ShapeKind, Size, choose, fault, mass};
use cairn_input::error::Error;
use cairn_input::params::{Params, Physics};
use cairn_input::scene::{Prop, Scene};

/// The kind, mass and thickness of a prop's collision shape, at scale 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeSummary {
    pub kind: ShapeKind,
    /// kg.
    pub mass: f64,
    /// Smallest extent, m.
    pub thickness: f64,
}

/// The summary of a checked prop, without splitting the prop where it is closed. An open prop has the mass of its
/// collision shape, which must be made.
fn summary(prop: &Prop, size: &Size, physics: &Physics) -> Result<ShapeSummary, String> {
    let mesh = &prop.model.mesh.outward();
    if !size.closed {
        return Ok(Shape::new(prop, *size, physics)?.summary());
    }
    let kind = choose::kind(mesh, size.diameter, physics);
    let mass = mass::moments(mesh).volume * prop.density;
    Ok(ShapeSummary { kind, mass, thickness: size.extents.x })
}

/// [`ShapeSummary`] of each of a scene's props.
pub fn summaries(scene: &Scene, params: &Params, sizes: &[Size]) -> Result<Vec<ShapeSummary>, Error> {
    let of = |(i, (prop, size)): (usize, (&Prop, &Size))| summary(prop, size, &params.physics).map_err(fault(i));
    scene.props.iter().zip(sizes).enumerate().map(of).collect()
}
