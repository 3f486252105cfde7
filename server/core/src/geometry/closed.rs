//! A mesh that encloses a volume.

use super::mesh::TriMesh;
use super::region::Region;
use super::topology::{self, Topology};

/// A closed mesh, welded and facing outward.
#[derive(Clone, Debug)]
pub struct Closed {
    pub mesh: TriMesh,
    pub topology: Topology,
    /// m^3; where parts of the mesh overlap, once.
    pub volume: f64,
}

impl Closed {
    /// A mesh that is known to be closed and to face outward.
    pub fn of(mesh: TriMesh) -> Closed {
        Closed::new(topology::inspect(&mesh), mesh)
    }

    /// The same, of a mesh that was inspected before.
    pub fn new(topology: Topology, mesh: TriMesh) -> Closed {
        let volume = if topology.components > 1 { Region::new(&mesh).volume() } else { mesh.signed_volume().abs() };
        Closed { mesh, topology, volume }
    }
}
