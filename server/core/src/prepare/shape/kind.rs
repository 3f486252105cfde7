//! The kinds of collision shapes.

/// What a prop's collision shape is or will be, as far as that is known without a decomposition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
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

impl std::fmt::Display for ShapeKind {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            ShapeKind::Box => "box",
            ShapeKind::Ball => "ball",
            ShapeKind::Hull => "hull",
            ShapeKind::Parts => "parts",
        })
    }
}
