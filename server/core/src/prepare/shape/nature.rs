//! What decides on effects, of each prop, before its collision shape is made.

use super::{Outline, Shape, Size, choose, fault, mass};
use crate::error::Error;
use crate::input::params::{Params, Physics};
use crate::input::scene::{Prop, Scene};

/// What decides on effects, of one prop at scale 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nature {
    pub outline: Outline,
    /// kg.
    pub mass: f64,
    /// Smallest extent, m.
    pub thickness: f64,
}

/// What the collision shape of a checked prop will be, without splitting it where that can be known so. An open prop has the
/// mass of its collision shape, which must be made.
fn nature(prop: &Prop, size: &Size, physics: &Physics) -> Result<Nature, String> {
    let mesh = &prop.model.mesh.outward();
    if !size.closed {
        return Ok(Shape::new(prop, *size, physics)?.nature());
    }
    let outline = choose::outline(mesh, size.diameter, physics);
    let mass = mass::moments(mesh).volume * prop.density;
    Ok(Nature { outline, mass, thickness: size.extents.x })
}

/// [`Nature`] of each of a scene's props.
pub fn natures(scene: &Scene, params: &Params, sizes: &[Size]) -> Result<Vec<Nature>, Error> {
    let of = |(i, (prop, size)): (usize, (&Prop, &Size))| nature(prop, size, &params.physics).map_err(fault(i));
    scene.props.iter().zip(sizes).enumerate().map(of).collect()
}
