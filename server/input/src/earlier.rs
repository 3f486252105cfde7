//! An earlier pile, of which a bake keeps what fits.

use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use glam::DVec3;

/// What an earlier bake filled, and with what. SI.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct EarlierPile {
    /// The result's name in messages.
    pub name: String,
    /// The bodies of its fill, in its order.
    pub bodies: Vec<EarlierBody>,
    /// Its glue: where joints of the next pile's are looked for first.
    pub dots: Vec<EarlierDot>,
    /// The shape that was filled, as placed in the world; coordinates in single precision.
    pub shape: TriMesh,
    /// Scenery near the shape, as it stood in the first frame; coordinates in single precision.
    pub scenery: TriMesh,
    /// Height of the ground, m; `None`: there was none.
    pub ground: Option<f64>,
    /// A body stays if nothing is new within this distance of its centre, d.
    pub reach: f64,
    /// The fill may add bodies anywhere in the shape: its parameters, or weights of props, differ from the earlier
    /// ones.
    pub refills: bool,
}

/// A body of an earlier pile.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EarlierBody {
    pub prop: EarlierProp,
    /// The number in its name.
    pub number: usize,
    /// Uniform, > 0.
    pub scale: f64,
    /// From the prop's own frame, scaled, to the world; metres: in the first frame, and in the last one.
    pub first: Pose,
    pub last: Pose,
}

/// A glue joint of an earlier pile.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EarlierDot {
    /// Index among the bodies.
    pub body: usize,
    /// The other body; `None`: the ground or scenery.
    pub other: Option<usize>,
    /// On `body`, N; and about the joint, N m.
    pub force: DVec3,
    pub moment: DVec3,
}

/// What became of the prop of an earlier body. The numbers are indices into the scene's props.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum EarlierProp {
    /// It is still there.
    Same(usize),
    /// Another one has its place in the list.
    Replaced(usize),
    Gone,
}
