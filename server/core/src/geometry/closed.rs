//! A mesh that encloses a volume.

use super::mesh::TriMesh;
use super::topology::{self, Topology};

/// A closed mesh, welded and facing outward.
#[derive(Clone, Debug)]
pub struct Closed {
    pub mesh: TriMesh,
    pub topology: Topology,
}

impl Closed {
    /// A mesh that is known to be closed and to face outward.
    pub fn of(mesh: TriMesh) -> Closed {
        Closed { topology: topology::inspect(&mesh), mesh }
    }

    /// m^3.
    pub fn volume(&self) -> f64 {
        self.mesh.signed_volume().abs()
    }
}
