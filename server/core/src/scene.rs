//! What a bake is asked to do, with every mesh already read: plain values, no files.

use crate::mesh::TriMesh;

/// Everything a bake needs besides its [`Params`](crate::params::Params).
#[derive(Clone, Debug)]
pub struct Scene {
    /// The pile's shape, as placed by the artist. Closed.
    pub control: Model,
    /// At least one. A body is one of these, scaled and placed.
    pub props: Vec<Prop>,
    /// Static scenery (besides the ground), as placed in the world.
    pub statics: Vec<StaticModel>,
}

/// A named mesh.
#[derive(Clone, Debug)]
pub struct Model {
    /// What messages call it: the file, and the node if one was chosen (`kit.glb#Brick`).
    pub name: String,
    pub mesh: TriMesh,
}

/// A thing that the pile is made of. Its mesh stands in the prop's own frame.
#[derive(Clone, Debug)]
pub struct Prop {
    pub model: Model,
    /// Relative frequency among the props, > 0.
    pub weight: f64,
    /// Coulomb friction coefficient, 0 to 2. A pair has the mean of its two.
    pub friction: f64,
    /// kg/m^3, > 0.
    pub density: f64,
    /// 0 to 1.
    pub restitution: f64,
    /// Uniform scale drawn between these two, both > 0.
    pub scale: [f64; 2],
}

/// A piece of scenery that never moves.
#[derive(Clone, Debug)]
pub struct StaticModel {
    pub model: Model,
    /// Coulomb friction coefficient, 0 to 2.
    pub friction: f64,
}
