//! The scenes of the study: shapes among scenery, made in code. Metres, Y up.

use cairn_geometry::mesh::TriMesh;
use cairn_input::scene::{Model, Prop, Scene, StaticModel};
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// A scene with its name.
pub struct Case {
    pub name: String,
    pub scene: Scene,
}

pub fn block(low: DVec3, high: DVec3) -> TriMesh {
    let corner = |i: u32| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low);
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { points: (0..8).map(corner).collect(), triangles }
}

/// The surface of revolution of a profile of radii and heights; closed where the profile begins and ends at the axis.
pub fn turned(profile: &[(f64, f64)], sides: u32) -> TriMesh {
    let ring = |&(r, y): &(f64, f64)| {
        let angle = move |k: u32| f64::from(k) / f64::from(sides) * TAU;
        (0..sides).map(move |k| DVec3::new(r * angle(k).cos(), y, r * angle(k).sin()))
    };
    let points: Vec<DVec3> = profile.iter().flat_map(ring).collect();
    let band = |i: u32| {
        (0..sides).flat_map(move |k| {
            let (a, b) = (i * sides + k, i * sides + (k + 1) % sides);
            let (c, d) = (a + sides, b + sides);
            [[a, c, b], [b, c, d]]
        })
    };
    let mut triangles: Vec<[u32; 3]> = (0..profile.len() as u32 - 1).flat_map(band).collect();
    triangles.retain(|t| {
        let [a, b, c] = t.map(|v| points[v as usize]);
        (b - a).cross(c - a).length() > 1e-12
    });
    TriMesh { points, triangles }
}

pub fn cylinder(radius: f64, low: f64, high: f64) -> TriMesh {
    turned(&[(0.0, low), (radius, low), (radius, high), (0.0, high)], 24)
}

fn at(mesh: TriMesh, place: DVec3) -> TriMesh {
    TriMesh { points: mesh.points.iter().map(|&p| p + place).collect(), ..mesh }
}

fn tilted(mesh: TriMesh, angle: f64) -> TriMesh {
    let turn = DMat3::from_rotation_z(angle.to_radians());
    TriMesh { points: mesh.points.iter().map(|&p| turn * p).collect(), ..mesh }
}

/// A box open at its top, of inner size `size` and with walls of this thickness; 0: sheets.
fn bin(size: DVec3, wall: f64) -> TriMesh {
    let (w, h, d) = (size.x / 2.0, size.y, size.z / 2.0);
    let ring = |x: f64, z: f64, y: f64| {
        [DVec3::new(-x, y, -z), DVec3::new(x, y, -z), DVec3::new(x, y, z), DVec3::new(-x, y, z)]
    };
    let sides = |a: u32, b: u32| {
        (0..4).flat_map(move |k| {
            let n = (k + 1) % 4;
            [[a + k, b + k, a + n], [a + n, b + k, b + n]]
        })
    };
    if wall == 0.0 {
        let points = [ring(w, d, 0.0), ring(w, d, h)].concat();
        let triangles = sides(0, 4).chain([[0, 1, 2], [0, 2, 3]]).collect();
        return TriMesh { points, triangles };
    }
    let (x, z) = (w + wall, d + wall);
    let points = [ring(x, z, -wall), ring(x, z, h), ring(w, d, h), ring(w, d, 0.0)].concat();
    let triangles =
        sides(0, 4).chain(sides(4, 8)).chain(sides(8, 12)).chain([[0, 1, 2], [0, 2, 3], [12, 14, 13], [12, 15, 14]]);
    TriMesh { points, triangles: triangles.collect() }
}

/// Hills: a sheet, or closed by a skirt.
fn hills(seed: u32, rough: f64, closed: bool) -> TriMesh {
    const N: u32 = 48;
    let height = |x: f64, z: f64| {
        let s = f64::from(seed);
        rough * ((1.9 * x + s).sin() * (1.7 * z - s).cos() + 0.4 * (4.3 * x - 2.0 * s).cos() * (3.9 * z).sin())
    };
    let place = |i: u32, k: u32| {
        let (x, z) = (f64::from(i) / f64::from(N) * 5.0 - 2.5, f64::from(k) / f64::from(N) * 5.0 - 2.5);
        DVec3::new(x, height(x, z), z)
    };
    let index = |i: u32, k: u32| i * (N + 1) + k;
    let mut points: Vec<DVec3> = (0..=N).flat_map(|i| (0..=N).map(move |k| place(i, k))).collect();
    let mut triangles = Vec::new();
    for (i, k) in (0..N).flat_map(|i| (0..N).map(move |k| (i, k))) {
        let [a, b, c, d] = [index(i, k), index(i, k + 1), index(i + 1, k), index(i + 1, k + 1)];
        triangles.extend([[a, b, c], [b, d, c]]);
    }
    if closed {
        let first = points.len() as u32;
        points.extend(points.clone().iter().map(|p| p.with_y(-2.0)));
        let bottom: Vec<[u32; 3]> = triangles.iter().map(|&[a, b, c]| [a + first, c + first, b + first]).collect();
        triangles.extend(bottom);
        for k in 0..N {
            for (a, b) in [
                (index(0, k + 1), index(0, k)),
                (index(N, k), index(N, k + 1)),
                (index(k, 0), index(k + 1, 0)),
                (index(k + 1, N), index(k, N)),
            ] {
                triangles.extend([[a, b, a + first], [b, b + first, a + first]]);
            }
        }
    }
    TriMesh { points, triangles }
}

fn jar(radius: f64, height: f64, neck: f64, wall: f64) -> TriMesh {
    let inner = [(0.0, 0.0), (radius, 0.0), (radius, 0.7 * height), (neck, 0.85 * height), (neck, height)];
    if wall == 0.0 {
        return turned(&inner, 32);
    }
    let outer = [
        (neck + wall, height),
        (neck + wall, 0.85 * height),
        (radius + wall, 0.72 * height),
        (radius + wall, -wall),
        (0.0, -wall),
    ];
    let mut profile: Vec<(f64, f64)> = outer.iter().rev().copied().collect();
    profile.extend(inner.iter().rev());
    turned(&profile, 32)
}

/// Props by number.
pub fn prop(number: usize) -> (&'static str, TriMesh) {
    match number % 4 {
        0 => ("can", cylinder(0.03, -0.055, 0.055)),
        1 => ("book", block(DVec3::new(-0.07, -0.015, -0.05), DVec3::new(0.07, 0.015, 0.05))),
        2 => (
            "ball",
            turned(
                &(0..=12)
                    .map(|k| (f64::from(k) / 24.0 * TAU).sin_cos())
                    .map(|(s, c)| (0.04 * s.abs(), -0.04 * c))
                    .collect::<Vec<_>>(),
                20,
            ),
        ),
        _ => ("stick", block(DVec3::new(-0.09, -0.012, -0.012), DVec3::new(0.09, 0.012, 0.012))),
    }
}

fn case(kind: &str, name: String, shape: TriMesh, scenery: Vec<(&str, TriMesh)>, number: usize) -> Case {
    let (prop_name, mesh) = prop(number);
    let statics = scenery.into_iter().map(|(name, mesh)| StaticModel {
        model: Model::new(name, mesh),
        friction: 0.7,
        keys: vec![],
    });
    let scene = Scene {
        control: Some(Model::new("shape", shape)),
        props: vec![Prop::new(Model::new(prop_name, mesh))],
        statics: statics.collect(),
        ..Scene::default()
    };
    Case { name: format!("{kind}: {name}, {prop_name}s"), scene }
}

/// All scenes.
pub fn all() -> Vec<Case> {
    let mut cases = Vec::new();
    let size = DVec3::new(0.58, 0.3, 0.38);
    for (i, wall) in [0.0, 0.002, 0.005, 0.01, 0.02, 0.05].into_iter().enumerate() {
        for (k, (what, gap)) in [("a millimetre inside", -0.001), ("through the wall", 0.03)].into_iter().enumerate() {
            let half = DVec3::new(size.x / 2.0 + gap, 0.0, size.z / 2.0 + gap);
            let shape = block(-half + DVec3::Y * gap.min(0.0).abs(), half + DVec3::Y * 0.26);
            let name = format!("bin, walls {:.0} mm, shape {what}", wall * 1e3);
            cases.push(case("bin", name, shape, vec![("bin", bin(size, wall))], i + k));
        }
    }
    let drum = || cylinder(0.3, 0.0, 0.5);
    for (i, radius) in [0.01, 0.03, 0.08, 0.15].into_iter().enumerate() {
        let pole = cylinder(radius, -0.1, 1.1);
        cases.push(case("pole", format!("pole of {:.0} mm", radius * 2e3), drum(), vec![("pole", pole)], i));
    }
    let leaning = at(tilted(cylinder(0.05, -0.5, 0.9), 25.0), DVec3::new(0.05, 0.1, 0.0));
    cases.push(case("pole", "leaning pole".into(), drum(), vec![("pole", leaning)], 0));
    let beam = at(tilted(cylinder(0.05, -0.8, 0.8), 90.0), DVec3::Y * 0.25);
    cases.push(case("pole", "beam".into(), drum(), vec![("beam", beam)], 1));
    let two = vec![
        ("left", at(cylinder(0.05, -0.1, 1.0), DVec3::X * -0.15)),
        ("right", at(cylinder(0.05, -0.1, 1.0), DVec3::X * 0.15)),
    ];
    cases.push(case("pole", "two poles".into(), drum(), two, 3));
    let pipe = turned(&[(0.08, -0.1), (0.08, 1.0)], 24);
    cases.push(case("pole", "pipe, a sheet".into(), drum(), vec![("pipe", pipe)], 2));
    let mound = |sunk: f64| {
        at(
            turned(
                &(0..=16)
                    .map(|k| (f64::from(k) / 32.0 * TAU).sin_cos())
                    .map(|(s, c)| (0.45 * s.abs(), -0.35 * c))
                    .collect::<Vec<_>>(),
                32,
            ),
            DVec3::Y * (0.35 - sunk),
        )
    };
    for (i, angle) in [10.0, 20.0, 30.0, 40.0].into_iter().enumerate() {
        let slab = tilted(block(DVec3::new(-2.0, -0.1, -2.0), DVec3::new(2.0, 0.0, 2.0)), angle);
        cases.push(case("slope", format!("slab at {angle:.0} degrees"), mound(0.15), vec![("slab", slab)], i));
        let plane = TriMesh {
            points: [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]].map(|[x, z]| DVec3::new(x, 0.0, z)).to_vec(),
            triangles: vec![[0, 2, 1], [0, 3, 2]],
        };
        cases.push(case(
            "slope",
            format!("sheet at {angle:.0} degrees"),
            mound(0.15),
            vec![("sheet", tilted(plane, angle))],
            i + 1,
        ));
    }
    for i in 0..12u32 {
        let (closed, rough) = (i % 2 == 1, 0.06 + 0.03 * f64::from(i / 2));
        let what = if closed { "closed" } else { "sheet" };
        cases.push(case(
            "hills",
            format!("hills of {rough:.2} m, {what}"),
            mound(0.25),
            vec![("hills", hills(i, rough, closed))],
            i as usize,
        ));
    }
    for (i, board) in [0.0, 0.002, 0.01, 0.03].into_iter().enumerate() {
        let shelf = |y: f64| match board {
            0.0 => TriMesh {
                points: [[-0.5, -0.2], [0.5, -0.2], [0.5, 0.2], [-0.5, 0.2]].map(|[x, z]| DVec3::new(x, y, z)).to_vec(),
                triangles: vec![[0, 2, 1], [0, 3, 2]],
            },
            _ => block(DVec3::new(-0.5, y - board, -0.2), DVec3::new(0.5, y, 0.2)),
        };
        let whole = block(DVec3::new(-0.4, 0.0, -0.18), DVec3::new(0.4, 0.7, 0.18));
        cases.push(case(
            "shelf",
            format!("through two boards of {:.0} mm", board * 1e3),
            whole,
            vec![("upper", shelf(0.45)), ("lower", shelf(0.2))],
            i,
        ));
        let upper = block(DVec3::new(-0.4, 0.44, -0.18), DVec3::new(0.4, 0.7, 0.18));
        cases.push(case(
            "shelf",
            format!("on a board of {:.0} mm", board * 1e3),
            upper,
            vec![("board", shelf(0.45))],
            i + 2,
        ));
    }
    for (i, wall) in [0.0, 0.003, 0.006, 0.012].into_iter().enumerate() {
        let wide = cylinder(0.215, 0.001, 0.3);
        cases.push(case(
            "jar",
            format!("jar, walls {:.0} mm", wall * 1e3),
            wide,
            vec![("jar", jar(0.2, 0.5, 0.2, wall))],
            i,
        ));
        let narrow = cylinder(0.215, 0.001, 0.42);
        cases.push(case(
            "jar",
            format!("jar with a neck, walls {:.0} mm", wall * 1e3),
            narrow,
            vec![("jar", jar(0.2, 0.5, 0.1, wall))],
            i + 1,
        ));
    }
    for i in 0..4 {
        let table = vec![
            ("top", block(DVec3::new(-0.6, 0.70, -0.4), DVec3::new(0.6, 0.75, 0.4))),
            ("leg", block(DVec3::new(-0.03, 0.0, -0.03), DVec3::new(0.03, 0.7, 0.03))),
        ];
        let radius = 0.3 + 0.08 * f64::from(i);
        let heap = turned(&[(0.0, 0.75), (radius, 0.75), (0.1, 1.15), (0.0, 1.15)], 32);
        cases.push(case("table", format!("heap of {radius:.2} m on a table"), heap, table, i as usize));
    }
    cases
}
