//! The glue joints as points, for programs that simulate the pile further. Renderers do not show them.

use super::bounding_box::BoundingBox;
use super::layer::{Layer, vector};
use cairn_core::report::{BakedGlue, BakedGlueDot};
use glam::DVec3;
use openusd::gf;
use openusd::sdf::Path;
use openusd::tf::Token;

/// m.
const WIDTH: f32 = 0.01;

/// Writes the joints below the pile's prim.
pub fn write(layer: &mut Layer, pile: &Path, glue: &BakedGlue) {
    let prim = layer.prim(pile, "Glue", "Points");
    let vectors = |of: fn(&BakedGlueDot) -> [f64; 3]| -> Vec<gf::Vec3f> {
        glue.dots.iter().map(|dot| vector(DVec3::from(of(dot)))).collect()
    };
    let points = vectors(|dot| dot.point);
    let mut bounds = BoundingBox::default();
    let half = DVec3::splat(f64::from(WIDTH) / 2.0);
    for point in glue.dots.iter().map(|dot| DVec3::from(dot.point)) {
        bounds.add(point - half);
        bounds.add(point + half);
    }
    // Its points, normals and forces stay in metres and the pile's axes.
    layer.transform(&prim, layer.layout.to_stage());
    layer.attribute(&prim, "uniform token purpose", Token::from("guide"));
    layer.attribute(&prim, "float3[] extent", bounds.extent());
    layer.attribute(&prim, "point3f[] points", points);
    layer.primvar(&prim, "float[] widths", "constant", vec![WIDTH]);
    let bodies = |dot: &BakedGlueDot| gf::Vec2i::from([dot.body as i32, dot.other.map_or(-1, |body| body as i32)]);
    layer.primvar(&prim, "int2[] primvars:cairn:bodies", "vertex", glue.dots.iter().map(bodies).collect::<Vec<_>>());
    layer.primvar(&prim, "normal3f[] primvars:cairn:normal", "vertex", vectors(|dot| dot.normal));
    layer.primvar(&prim, "vector3f[] primvars:cairn:force", "vertex", vectors(|dot| dot.force));
    layer.primvar(&prim, "vector3f[] primvars:cairn:moment", "vertex", vectors(|dot| dot.moment));
    let broken: Vec<bool> = glue.dots.iter().map(|dot| dot.is_broken).collect();
    layer.primvar(&prim, "bool[] primvars:cairn:broken", "vertex", broken);
}
