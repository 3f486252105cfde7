//! A mesh that encloses a volume.

use super::interior::MeshInterior;
use super::mesh::TriMesh;
use super::topology::{self, Topology};

/// A closed mesh, welded and facing outward.
#[derive(Clone, Debug)]
pub struct ClosedMesh {
    pub mesh: TriMesh,
    pub topology: Topology,
    /// m^3; where parts of the mesh overlap, once.
    pub volume: f64,
}

impl ClosedMesh {
    /// A mesh that is known to be closed and to face outward.
    pub fn of(mesh: TriMesh) -> ClosedMesh {
        ClosedMesh::new(topology::inspect(&mesh), mesh)
    }

    /// The same, of a mesh that was inspected before.
    pub fn new(topology: Topology, mesh: TriMesh) -> ClosedMesh {
        let volume =
            if topology.components > 1 { MeshInterior::new(&mesh).volume() } else { mesh.signed_volume().abs() };
        ClosedMesh { mesh, topology, volume }
    }
}
