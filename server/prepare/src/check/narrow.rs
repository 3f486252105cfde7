//! Control meshes that are thinner than the props: shells, sheets, frames. The fill would search for long, and find
//! next to no room in them.

use cairn_geometry::ClosedMesh;
use cairn_geometry::interior::MeshInterior;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Points of the inside that are tested.
const SAMPLES: usize = 1000;
/// Props count as this much thinner than they are: a rounded one fits where its box does not.
const ROUNDING: f64 = 0.9;

/// Share of a mesh's volume that is as thick as `thickness` (m), where it may be small: 1 where the mesh is thick by
/// its volume and area.
///
/// A place is thick enough if a ball of that diameter fits there: around it, or inside the surface that is nearest to
/// it.
pub fn thick_share(control: &ClosedMesh, thickness: f64) -> f64 {
    let radius = ROUNDING * thickness / 2.0;
    // Of a slab, its thickness; of a ball, a third of its diameter.
    let mean = 2.0 * control.volume / control.topology.area;
    if mean > 2.0 * radius {
        return 1.0;
    }
    let region = MeshInterior::new(&control.mesh);
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    let points: Vec<_> = (0..SAMPLES).map_while(|_| region.sample_inside(&mut rng)).collect();
    let is_thick = |&p: &_| {
        let (surface, depth, _) = region.nearest(p);
        let center = if depth < radius { surface + (p - surface).normalize_or_zero() * radius } else { p };
        // The ball just fits: rounding must not decide.
        region.signed_distance(center) <= -0.999 * radius
    };
    match points.len() {
        0 => 1.0,
        n => points.iter().filter(|p| is_thick(p)).count() as f64 / n as f64,
    }
}
