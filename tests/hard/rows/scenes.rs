//! The hard cases' meshes and scenes, made in code. Metres, Y up, the ground at y = 0.

use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::scene::{Model, PlacedBody, Prop, Scene};
use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;
use std::path::Path;

/// A box of these edges about the origin.
pub fn block(size: DVec3) -> TriMesh {
    let corner = |i: u32| {
        size / 2.0 * (DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * 2.0 - DVec3::ONE)
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { points: (0..8).map(corner).collect(), triangles }
}

/// A closed surface of revolution about the y axis through these (radius, height) from the lower pole to the upper one.
pub fn turned(profile: &[(f64, f64)], sides: u32) -> TriMesh {
    let rings = profile.len() as u32;
    let at = |ring: u32, side: u32| ring * sides + side % sides;
    let mut points = Vec::new();
    for &(radius, height) in profile {
        let angle = |k: u32| f64::from(k) / f64::from(sides) * TAU;
        points.extend((0..sides).map(|k| DVec3::new(radius * angle(k).cos(), height, radius * angle(k).sin())));
    }
    let (low, high) = (points.len() as u32, points.len() as u32 + 1);
    points.extend([DVec3::Y * profile[0].1, DVec3::Y * profile[profile.len() - 1].1]);
    let mut triangles = Vec::new();
    for k in 0..sides {
        triangles.push([low, at(0, k), at(0, k + 1)]);
        triangles.push([high, at(rings - 1, k + 1), at(rings - 1, k)]);
        for ring in 0..rings - 1 {
            let [a, b, c, d] = [at(ring, k), at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1)];
            triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    TriMesh { points, triangles }
}

pub fn ball(radius: f64) -> TriMesh {
    let ring = |k: u32| {
        let (sin, cos) = (TAU / 2.0 * f64::from(k) / 12.0).sin_cos();
        (radius * sin, -radius * cos)
    };
    turned(&(1..12).map(ring).chain([(radius * 1e-3, radius)]).collect::<Vec<_>>(), 24)
}

/// A ball with poles, of so many meridians and half as many parallels.
pub fn globe(radius: f64, meridians: u32) -> TriMesh {
    let parallels = meridians / 2;
    let ring = |k: u32| {
        let (sin, cos) = (TAU / 2.0 * f64::from(k) / f64::from(parallels)).sin_cos();
        (radius * sin, -radius * cos)
    };
    let mut mesh = turned(&(1..parallels).map(ring).collect::<Vec<_>>(), meridians);
    // The last two points are the poles.
    let poles = mesh.points.len() - 2;
    mesh.points[poles] = DVec3::NEG_Y * radius;
    mesh.points[poles + 1] = DVec3::Y * radius;
    mesh
}

/// A ring in the plane of x and y: the radius of its middle line, and that of its tube.
pub fn ring(round: f64, thick: f64) -> TriMesh {
    const AROUND: u32 = 24;
    const ACROSS: u32 = 12;
    let angle = |k: u32, n: u32| (f64::from(k) / f64::from(n) * TAU).sin_cos();
    let point = |k: u32| {
        let ((s, c), (t, u)) = (angle(k / ACROSS, AROUND), angle(k % ACROSS, ACROSS));
        DVec3::new(c * (round + thick * u), s * (round + thick * u), thick * t)
    };
    let at = |i: u32, j: u32| i % AROUND * ACROSS + j % ACROSS;
    let quads = (0..AROUND).flat_map(|i| (0..ACROSS).map(move |j| (i, j)));
    let triangles = quads.flat_map(|(i, j)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
        [[a, b, c], [b, d, c]]
    });
    TriMesh { points: (0..AROUND * ACROSS).map(point).collect(), triangles: triangles.collect() }
}

pub fn disc(radius: f64, height: f64) -> TriMesh {
    turned(&[(radius, -height / 2.0), (radius, height / 2.0)], 32)
}

/// A closed cone that stands on the ground.
pub fn cone(radius: f64, height: f64) -> TriMesh {
    turned(&[(radius, 0.0), (radius * 1e-3, height)], 32)
}

/// A closed cylinder that stands on the ground.
pub fn cylinder(radius: f64, height: f64) -> TriMesh {
    turned(&[(radius, 0.0), (radius, height)], 32)
}

pub fn prop(name: &str, mesh: TriMesh, friction: f64) -> Prop {
    let model = Model::new(name, mesh);
    Prop { friction, ..Prop::new(model) }
}

pub fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose { translation: DVec3::new(x, y, z), rotation: DQuat::IDENTITY }
}

/// Bodies of one prop, placed by hand.
pub fn placed(prop: Prop, poses: impl IntoIterator<Item = Pose>) -> Scene {
    let bodies = poses.into_iter().map(|pose| PlacedBody::new(0, pose)).collect();
    Scene { props: vec![prop], bodies, ..Scene::default() }
}

/// A fill of a control mesh with one prop.
pub fn filled(control: TriMesh, prop: Prop) -> Scene {
    let control = Some(Model::new("control", control));
    Scene { control, props: vec![prop], ..Scene::default() }
}

/// Poses of a cloud of `count` bodies above the ground, `spacing` apart, turned at random, `across` side by side.
pub fn cloud(count: usize, across: usize, spacing: f64, seed: u64) -> Vec<Pose> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut unit = || rng.random::<f64>();
    let middle = (across as f64 - 1.0) / 2.0;
    let pose = |k: usize| {
        let (column, layer) = (k % (across * across), k / (across * across));
        let (x, z) = ((column % across) as f64 - middle, (column / across) as f64 - middle);
        let jitter = DVec3::new(unit(), unit(), unit()) * 0.05;
        let rotation = DQuat::from_rotation_y(TAU * unit()) * DQuat::from_rotation_x(TAU * unit());
        Pose { translation: (DVec3::new(x, layer as f64 + 0.6, z) + jitter) * spacing, rotation }
    };
    (0..count).map(pose).collect()
}

/// The model of a file in `examples/assets`.
pub fn asset(name: &str) -> TriMesh {
    let path = Path::new(env!("CAIRN_REPOSITORY")).join("examples/assets").join(name);
    let bytes = std::fs::read(&path).expect("a model of the examples");
    let resolve = |uri: &str| Err(format!("{uri}: the examples have no external files"));
    let limits = Default::default();
    let source = cairn_input::asset::Source { name, bytes: &bytes, node: None, resolve: &resolve, limits };
    cairn_input::asset::read(&source).expect("a model of the examples is sound").mesh
}

/// The house of 40 cards of `examples/cards.toml`, larger by `factor`, with another friction.
pub fn cards(factor: f64, friction: f64) -> Scene {
    let path = Path::new(env!("CAIRN_REPOSITORY")).join("examples/cards.toml");
    let tree = cairn_wire::scene_file::SceneTree::load(&path).expect("an example is sound");
    let mut scene = cairn_job::Job::read(&tree.to_message()).expect("an example's files are there").scene;
    scene.bodies.retain(PlacedBody::is_stacked);
    scene.props.truncate(1);
    scene.props[0].friction = friction;
    scene.props[0].model.mesh = scene.props[0].model.mesh.scaled(factor);
    scene.bodies.iter_mut().for_each(|body| body.pose.translation *= factor);
    scene
}
