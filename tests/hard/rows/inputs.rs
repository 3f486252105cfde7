//! Meshes that nobody would model on purpose.

use super::engines::{Engine, baked, params};
use super::scenes::{at, block, filled, placed, prop};
use super::{Extent, Outcome, all};
use cairn_core::Error;
use cairn_engine::shape::{Shape, Size};
use cairn_geometry::mesh::TriMesh;
use cairn_input::asset::{self, Source};
use cairn_input::params::ReleaseOrder;
use cairn_prepare::check;
use glam::{DAffine3, DVec3};

fn turned_over(mut mesh: TriMesh) -> TriMesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh
}

fn of(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> TriMesh {
    TriMesh { points: points.iter().map(|&p| DVec3::from_array(p)).collect(), triangles: triangles.to_vec() }
}

pub fn degenerate_mesh(engine: Engine, _: Extent) -> Outcome {
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
    let cases = [
        ("no_area", of(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], &[[0, 1, 2]])),
        ("one_point", of(&[[0.5; 3]; 3], &[[0, 1, 2]])),
        ("flat", of(&square, &[[0, 2, 1], [0, 3, 2]])),
        ("empty", TriMesh::default()),
        ("one_triangle", of(&square[..3], &[[0, 2, 1]])),
        ("inside_out", turned_over(block(DVec3::ONE))),
    ];
    let part = |(name, mesh): (&str, TriMesh)| {
        let scene = placed(prop(name, mesh.clone(), 0.5), [at(0.0, 1.0, 0.0)]);
        let params = params(engine, 0.2);
        match check::run(&scene, &params) {
            Err(problems) => {
                let summary = problems.iter().any(|p| p.text.contains(name));
                (format!("{name}: refused by name"), summary)
            }
            Ok(_) => {
                let motion = baked(&scene, &params);
                let shape = &motion.report.as_ref().expect("a bake").shapes[0];
                let how = shape.mass_fallback.as_deref().unwrap_or("as its outward twin");
                let sound =
                    motion.is_finite() && shape.mass > 0.0 && (shape.mass_fallback.is_some() || !is_open(&mesh));
                (format!("{name}: {how}"), sound)
            }
        }
    };
    all(cases.map(part))
}

fn is_open(mesh: &TriMesh) -> bool {
    !Size::of(mesh).closed
}

pub fn bad_container(engine: Engine, _: Extent) -> Outcome {
    let moved = |by: DVec3| block(DVec3::ONE).transformed(&DAffine3::from_translation(by + DVec3::Y * 0.5));
    let pair = |by: DVec3| {
        let mut both = moved(DVec3::ZERO);
        both.append(&moved(by));
        both
    };
    let mut open = moved(DVec3::ZERO);
    open.triangles.pop();
    let cases = [
        ("open", open),
        ("inverted", turned_over(moved(DVec3::ZERO))),
        ("two parts", pair(DVec3::X * 1.5)),
        ("edge shared by four faces", pair(DVec3::new(1.0, 0.0, 1.0))),
        ("self-intersecting", pair(DVec3::new(0.5, 0.0, 0.3))),
    ];
    let part = |(name, mesh): (&str, TriMesh)| {
        let scene = filled(mesh, prop("brick", block(DVec3::new(0.4, 0.3, 0.2)), 0.7));
        let mut params = params(engine, 0.5);
        params.release.order = ReleaseOrder::BottomUp;
        match cairn_core::bake(&scene, &params, &mut cairn_input::observer::Silent) {
            Err(Error::Invalid(problems)) => {
                let summary = problems.iter().any(|p| p.text.contains("open"));
                (format!("{name}: refused, {}", if summary { "as open" } else { "without a reason" }), summary)
            }
            Err(other) => (format!("{name}: {other}"), false),
            Ok(bake) => {
                let count = |name: &str| bake.report.counts[name];
                // What grows in a crowd may be squeezed through a wall. The fill takes it out, as what overlaps, and
                // plants another.
                let lost = count("bodies_lost");
                let fill = bake.report.measures["fill_fraction"].unwrap_or(0.0);
                (
                    format!("{name}: {} bodies fill {fill:.2}, {lost} lost", bake.pile.bodies.len()),
                    lost == 0 && fill > 0.25,
                )
            }
        }
    };
    all(cases.map(part))
}

/// A glTF file of a box below a scaled and mirrored node.
pub fn scaled_node(_: Engine, _: Extent) -> Outcome {
    let mesh = block(DVec3::new(0.2, 0.4, 0.6));
    let mut bytes: Vec<u8> = Vec::new();
    mesh.points.iter().flat_map(|p| p.to_array()).for_each(|v| bytes.extend((v as f32).to_le_bytes()));
    mesh.triangles.iter().flatten().for_each(|v| bytes.extend((*v as u16).to_le_bytes()));
    let (indices, total) = (mesh.points.len() * 12, bytes.len());
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"mesh":0,"scale":[2,0.5,-3],"rotation":[0.1,0.2,0.3,0.927]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3",
          "min":[-0.1,-0.2,-0.3],"max":[0.1,0.2,0.3]}},
        {{"bufferView":1,"componentType":5123,"count":{},"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":{indices}}},
        {{"buffer":0,"byteOffset":{indices},"byteLength":{}}}],
        "buffers":[{{"byteLength":{total},"uri":"box.bin"}}]}}"#,
        mesh.points.len(),
        mesh.triangles.len() * 3,
        total - indices
    );
    let resolve = |_: &str| Ok(bytes.clone());
    let limits = Default::default();
    let source = Source { name: "box.gltf", bytes: json.as_bytes(), node: None, resolve: &resolve, limits };
    let read = asset::read(&source).expect("a sound file").mesh;
    let prop = prop("box", read.clone(), 0.5);
    let size = Size::of(&read);
    let shape =
        Shape::new(&prop, size, &cairn_input::params::Params::new(cairn_input::params::Accuracy::Standard).physics);
    let mass = shape.expect("a prop with volume").mass;
    let exact = 1000.0 * 0.2 * 0.4 * 0.6 * 3.0;
    let error = (mass / exact - 1.0).abs();
    all([
        (format!("mass off by {:.4} %", 100.0 * error), error < 0.01),
        (format!("signed volume {:.3} m3", read.signed_volume()), read.signed_volume() > 0.0),
    ])
}
