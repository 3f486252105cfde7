//! Problems that no scene file reaches, since files are read before: meshes without faces, props by a wrong number.

use super::run;
use crate::testing::says_only;
use cairn_engine::shape::{Shape, Size};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{
    Emitter, EmitterVolume, Model, PlacedBody, Prop, RemovalChoice, RemovalRequest, Scene, StaticModel,
};
use glam::DVec3;

fn cube(size: f64) -> Model {
    let corner = |i: u32| size * DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Model::new("cube", TriMesh { points: (0..8).map(corner).collect(), triangles })
}

/// Triangles, each a little above the one before.
fn layers(count: usize) -> Model {
    let corners = |i: usize| {
        let y = 1e-7 * i as f64;
        [DVec3::new(0.0, y, 0.0), DVec3::new(0.0, y, 0.2), DVec3::new(0.2, y, 0.0)]
    };
    let triangle = |i: usize| [0, 1, 2].map(|k| 3 * i as u32 + k);
    let points = (0..count).flat_map(corners).collect();
    Model::new("layers", TriMesh { points, triangles: (0..count).map(triangle).collect() })
}

fn empty() -> Model {
    Model::new("empty", TriMesh::default())
}

#[test]
fn each_problem_of_a_scene_has_its_cause() {
    let whole = Scene { control: Some(cube(4.0)), props: vec![Prop::new(cube(0.2))], ..Scene::default() };
    let scenery = |model: Model| vec![StaticModel { model, friction: 0.7, keys: Vec::new() }];
    let body = |prop: usize| vec![PlacedBody::new(prop, Pose::IDENTITY)];
    let emitters = |count: u32, of: usize| {
        let place = EmitterVolume::Box { center: DVec3::Y, size: DVec3::ONE };
        vec![Emitter { place, props: vec![], rate: 1.0, count, velocity: DVec3::ZERO, start: 0.0 }; of]
    };
    let removals = |count: usize| vec![RemovalRequest { choice: RemovalChoice::Any { most: 1 }, start: None }; count];
    for (case, scene, words) in [
        ("when the scene is whole", whole.clone(), &[] as &[&str]),
        ("when scenery has faces", Scene { statics: scenery(cube(1.0)), ..whole.clone() }, &[]),
        ("when a body has a prop", Scene { bodies: body(0), ..whole.clone() }, &[]),
        ("when as many bodies as are taken are emitted", Scene { emitters: emitters(50_000, 2), ..whole.clone() }, &[]),
        (
            "when the control mesh is empty",
            Scene { control: Some(empty()), ..whole.clone() },
            &["empty: the control mesh has no triangles; model the pile's rough shape as a closed mesh"],
        ),
        (
            "when the layers of a prop nearly touch",
            Scene { props: vec![Prop::new(layers(20_000))], ..whole.clone() },
            &["layers: too many of its 20000 triangles are in nearly the same place, 19844 on average; remove copies \
                 of its parts (in Blender: Mesh, Clean Up, Merge by Distance)"],
        ),
        (
            "when a prop is empty",
            Scene { props: vec![Prop::new(empty())], ..whole.clone() },
            &["empty: the prop has no triangles with area; give it a mesh"],
        ),
        (
            "when scenery is empty",
            Scene { statics: scenery(empty()), ..whole.clone() },
            &["empty: the static geometry has no triangles; remove it or give it a mesh"],
        ),
        (
            "when a body has another prop",
            Scene { bodies: body(7), ..whole.clone() },
            &["bodies.0.prop: there is no props.7; the scene's last is props.0"],
        ),
        ("when a thousand removals are asked for", Scene { removals: removals(1000), ..whole.clone() }, &[]),
        (
            "when more removals are asked for",
            Scene { removals: removals(1001), ..whole.clone() },
            &["remove: 1001 entries; give 1000 at most"],
        ),
        (
            "when more bodies are emitted",
            Scene { emitters: emitters(50_001, 2), ..whole },
            &["bodies, emitters: 100002 bodies in all; place and emit at most 100000"],
        ),
    ] {
        let problems = run(&scene, &Params::new(Accuracy::Draft)).err().unwrap_or_default();
        let said: Vec<String> = problems.into_iter().map(|problem| problem.text).collect();
        says_only(case, &said, words);
    }
}

#[test]
fn a_shape_without_a_volume_is_refused() {
    let sheet = TriMesh { points: vec![DVec3::ZERO, DVec3::X, DVec3::Z], triangles: vec![[0, 1, 2]] };
    for (case, model, words) in [
        ("when a prop is a cube", cube(0.2), &[] as &[&str]),
        ("when a prop is flat", Model::new("sheet", sheet), &[]),
        (
            "when a volume is beyond numbers",
            cube(1e110),
            &["cube: no volume could be found for this prop; close the mesh or give it thickness"],
        ),
    ] {
        let prop = Prop::new(model);
        let made = Shape::new(&prop, Size::of(&prop.model.mesh), &Params::new(Accuracy::Draft).physics);
        says_only(case, &made.err().into_iter().collect::<Vec<_>>(), words);
    }
}
