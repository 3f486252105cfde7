//! The kinds of collision shapes.

/// The kind of a prop's collision shape, as far as it is known without a decomposition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, strum::Display)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum ShapeKind {
    Box,
    Ball,
    /// One convex shape.
    Hull,
    /// Several convex shapes.
    Parts,
}

impl ShapeKind {
    /// Simulated as the engine's own box or ball, not as hulls.
    pub fn is_primitive(self) -> bool {
        matches!(self, ShapeKind::Box | ShapeKind::Ball)
    }
}
