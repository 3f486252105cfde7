//! Small scenes, made in code. No test needs all of them. Bakes of them check the invariants after each step.
#![allow(dead_code)]

use cairn_geometry::mesh::TriMesh;
use cairn_input::scene::{Model, Prop, Scene};
use glam::DVec3;

/// A closed cone on the ground, of this radius and height, with 32 sides.
pub fn cone(radius: f64, height: f64) -> TriMesh {
    const SIDES: u32 = 32;
    let rim = (0..SIDES).map(|k| f64::from(k) / f64::from(SIDES) * std::f64::consts::TAU);
    let mut points: Vec<DVec3> = rim.map(|a| DVec3::new(radius * a.cos(), 0.0, radius * a.sin())).collect();
    points.extend([DVec3::ZERO, DVec3::new(0.0, height, 0.0)]);
    let side = |k: u32| [[k, SIDES + 1, (k + 1) % SIDES], [SIDES, k, (k + 1) % SIDES]];
    TriMesh { points, triangles: (0..SIDES).flat_map(side).collect() }
}

/// A closed disc with 32 corners about the y axis.
pub fn disc(radius: f64, height: f64) -> TriMesh {
    const SIDES: u32 = 32;
    let angle = |k: u32| f64::from(k) / f64::from(SIDES) * std::f64::consts::TAU;
    let rim = |y: f64| (0..SIDES).map(move |k| DVec3::new(radius * angle(k).cos(), y, radius * angle(k).sin()));
    let middle = [DVec3::new(0.0, -height / 2.0, 0.0), DVec3::new(0.0, height / 2.0, 0.0)];
    let points = rim(-height / 2.0).chain(rim(height / 2.0)).chain(middle).collect();
    let (low, high) = (2 * SIDES, 2 * SIDES + 1);
    let side = |k: u32| {
        let (a, b, c, d) = (k, (k + 1) % SIDES, k + SIDES, (k + 1) % SIDES + SIDES);
        [[a, b, low], [a, c, b], [b, c, d], [c, high, d]]
    };
    TriMesh { points, triangles: (0..SIDES).flat_map(side).collect() }
}

/// A stick of 0.5 x 0.06 x 0.06 m about its middle.
pub fn stick() -> TriMesh {
    let half = DVec3::new(0.25, 0.03, 0.03);
    let corner = |i: u32| half * (DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) * 2.0 - 1.0);
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { points: (0..8).map(corner).collect(), triangles }
}

/// A block of these edges about its middle.
pub fn block(size: DVec3) -> TriMesh {
    let stick = stick();
    let points = stick.points.iter().map(|p| p / DVec3::new(0.5, 0.06, 0.06) * size).collect();
    TriMesh { points, ..stick }
}

/// A scene of one prop.
pub fn scene(control: TriMesh, prop: TriMesh) -> Scene {
    cairn_engine::invariants::check_always();
    let model = |name: &str, mesh| Model::new(name, mesh);
    Scene {
        control: Some(model("control", control)),
        props: vec![Prop { density: 500.0, ..Prop::new(model("stick", prop)) }],
        ..Scene::default()
    }
}
