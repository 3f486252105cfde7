//! Props of very many triangles: simplified once, before anything is computed with them.

use cairn_engine::shape::oriented_box;
use cairn_geometry::simplify::{self, Simplified};
use cairn_input::params::Physics;
use cairn_input::scene::Scene;

/// Fewer triangles cost next to nothing.
const DENSE: usize = 50_000;
/// The share of [`Physics::shape_gap`] that a simplified mesh may be off: the skin around collision shapes is as thick.
const SHARE: f64 = 0.25;

/// A prop that was simplified.
pub struct DenseProp {
    /// Its place among the props.
    pub index: usize,
    pub triangles: usize,
    pub left: usize,
    /// The largest distance of a removed corner from the simplified mesh, m; by a sample of the corners.
    pub deviation: f64,
}

/// Simplifies dense props, for all that is computed. What shows the pile keeps their own meshes.
pub fn run(scene: &mut Scene, physics: &Physics) -> Vec<DenseProp> {
    let mut found = Vec::new();
    for (index, prop) in scene.props.iter_mut().enumerate() {
        let mesh = &prop.model.mesh;
        let triangles = mesh.triangles.len();
        if triangles <= DENSE {
            continue;
        }
        let thickness = 2.0 * oriented_box(mesh).half.min_element();
        let light = simplify::dense(mesh, SHARE * physics.shape_gap * thickness);
        if let Some(Simplified { mesh, deviation, .. }) = light {
            found.push(DenseProp { index, triangles, left: mesh.triangles.len(), deviation });
            (prop.model.mesh, prop.mesh_deviation) = (mesh, deviation);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_engine::shape::{Hull, Shape, Size, Solid};
    use cairn_geometry::mesh::TriMesh;
    use cairn_input::params::{Accuracy, Params};
    use cairn_input::scene::{Model, Prop};
    use glam::DVec3;
    use std::f64::consts::{PI, TAU};

    /// An egg of so many meridians, twice as long as thick.
    fn egg(meridians: u32) -> TriMesh {
        let at = |row: u32, k: u32| {
            let (down, turn) = (PI * f64::from(row) / f64::from(meridians), TAU * f64::from(k) / f64::from(meridians));
            DVec3::new(0.1 * down.sin() * turn.cos(), 0.2 * down.cos(), 0.1 * down.sin() * turn.sin())
        };
        let points = (0..=meridians).flat_map(|row| (0..meridians).map(move |k| at(row, k))).collect();
        let number = |row: u32, k: u32| row * meridians + k % meridians;
        let quad = |row: u32, k: u32| {
            let [a, b, c, d] = [number(row, k), number(row, k + 1), number(row + 1, k + 1), number(row + 1, k)];
            [[a, b, c], [a, c, d]]
        };
        let triangles = (0..meridians).flat_map(|row| (0..meridians).flat_map(move |k| quad(row, k))).collect();
        cairn_geometry::topology::weld(&TriMesh { points, triangles }, 1e-9)
    }

    #[test]
    fn a_dense_prop_is_made_light_and_its_shape_holds_all_of_it() {
        let physics = Params::new(Accuracy::Standard).physics;
        let prop = |meridians| Prop::new(Model::new("egg", egg(meridians)));
        let mut scene = Scene { props: vec![prop(20), prop(200)], ..Scene::default() };
        let own = scene.props[1].model.mesh.clone();
        let found = run(&mut scene, &physics);
        assert_eq!((found.len(), found[0].index), (1, 1), "the other one is light");
        let prop = &scene.props[1];
        assert!(found[0].left < found[0].triangles / 3 && found[0].left == prop.model.mesh.triangles.len());
        assert!(prop.mesh_deviation > 0.0 && prop.mesh_deviation <= SHARE * physics.shape_gap * 0.2 * 1.01);
        let shape = Shape::new(prop, Size::of(&prop.model.mesh), &physics).unwrap();
        for solid in [&shape.solid, &shape.bare] {
            let Solid::Convex(parts) = solid else { panic!("an egg is no ball") };
            let hull = Hull::new(&parts[0].iter().map(|p| p.as_vec3()).collect::<Vec<_>>()).unwrap();
            let outside = |p: &DVec3| {
                let p = (*p - shape.center).as_vec3();
                let out = |facet: &cairn_engine::shape::Facet| {
                    (p - hull.points()[facet.corners[0] as usize]).dot(facet.normal)
                };
                hull.facets().iter().map(out).fold(f32::NEG_INFINITY, f32::max)
            };
            let worst = own.points.iter().map(outside).fold(f32::NEG_INFINITY, f32::max);
            assert!(worst <= 1e-6, "{worst} m of the egg is outside");
        }
    }
}
