//! How large results are at most.

/// Upper bounds of the size of a result's parts, bytes, besides its models. A test of the room `job` holds
/// results against them.
#[derive(Clone, Copy)]
pub struct FormatSize {
    /// Of what every result has.
    pub file: u64,
    /// Of a body, at rest.
    pub body: u64,
    /// Of a body in one frame.
    pub pose: u64,
}

impl FormatSize {
    /// Nodes, channels and accessors as JSON; times, places and turns as floats.
    pub const GLB: FormatSize = FormatSize { file: 16 << 10, body: 1500, pose: 32 };
    /// Places, turns and velocities as floats.
    pub const USD: FormatSize = FormatSize { file: 64 << 10, body: 200, pose: 52 };
    /// The same as text.
    pub const USDA: FormatSize = FormatSize { pose: 260, ..FormatSize::USD };
    /// Numbers with all their digits.
    pub const TABLE: FormatSize = FormatSize { file: 16 << 10, body: 200, pose: 220 };
    /// Each body's geoms, and the corners of a hull, since each may have a scale of its own. Props of many parts and
    /// many scales take more.
    pub const MODEL: FormatSize = FormatSize { file: 16 << 10, body: 5 << 10, pose: 0 };
    /// Nodes of the body, its look and its parts. Props of many parts take more.
    pub const GLB_PHYSICS: FormatSize = FormatSize { file: 64 << 10, body: 3 << 10, pose: 0 };
    /// A node and a joint of each body, twice, and its motion twice.
    pub const PACK: FormatSize = FormatSize { file: 256 << 10, body: 3 << 10, pose: 80 };
    /// As a `.glb`, and the corners of all hulls.
    pub const GLB_HULLS: FormatSize = FormatSize { file: 64 << 10, ..FormatSize::GLB };
}
