//! Shapes of random polyhedra, fans and bent sheets: each has the extents and the volume of its mesh, within the
//! deviation that it states.

use super::{Shape, ShapeKind, Size, Solid, hull_mesh, oriented_box};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::{SINGLE_PRECISION, topology};
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{Model, Prop};
use glam::{DMat3, DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Meshes of each kind.
const MESHES: u64 = 40;

fn anywhere(random: &mut Pcg64) -> DVec3 {
    DVec3::from_array([(); 3].map(|()| random.random_range(-1.0..1.0)))
}

/// Half of all props are aligned with the axes, as programs make them.
fn any_turn(random: &mut Pcg64) -> DQuat {
    match random.random_range(0..4) {
        0 => DQuat::IDENTITY,
        1 => DQuat::from_rotation_x(TAU / 4.0),
        _ => DQuat::from_scaled_axis(anywhere(random) * 4.0),
    }
}

/// As files have it: in single precision, turned.
fn in_a_file(mesh: TriMesh, turn: DQuat) -> TriMesh {
    let points = mesh.points.iter().map(|&p| (turn * p).as_vec3().as_dvec3()).collect();
    topology::weld(&TriMesh { points, ..mesh }, 0.0)
}

/// Triangles around a middle corner.
fn fan(rim: &[DVec3], middle: DVec3) -> TriMesh {
    let count = rim.len() as u32;
    let points = std::iter::once(middle).chain(rim.iter().copied()).collect();
    TriMesh { points, triangles: (0..count).map(|i| [0, 1 + (i + 1) % count, 1 + i]).collect() }
}

fn around(count: usize, at: impl Fn(f64) -> DVec3) -> Vec<DVec3> {
    (0..count).map(|i| at(i as f64 / count as f64 * TAU)).collect()
}

/// A leaf of 60 x 40 mm whose ends are this much higher than its middle.
fn leaf(bend: f64) -> TriMesh {
    let lifted = |p: DVec3| p.with_y(bend * (p.x / 0.03).abs());
    fan(&around(8, |turn| lifted(DVec3::new(0.03 * turn.cos(), 0.0, 0.02 * turn.sin()))), DVec3::ZERO)
}

fn tetrahedron() -> TriMesh {
    hull_mesh(
        &[[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(|p| DVec3::from(p) * 0.01),
    )
}

fn random_polyhedron(random: &mut Pcg64) -> TriMesh {
    let (count, size) = (random.random_range(4..14), anywhere(random).abs() + 0.02);
    hull_mesh(&(0..count).map(|_| anywhere(random) * size).collect::<Vec<_>>())
}

fn random_fan(random: &mut Pcg64) -> TriMesh {
    let (width, is_bent) = (random.random_range(0.2..1.0), random.random_bool(0.5));
    let bend = if is_bent { random.random_range(0.0..0.3) } else { 0.0 };
    let count = random.random_range(3..12);
    let rim = around(count, |turn| DVec3::new(turn.cos(), bend * turn.cos().abs(), width * turn.sin()));
    fan(&rim, DVec3::ZERO)
}

/// A grid bent about an axis.
fn random_sheet(random: &mut Pcg64) -> TriMesh {
    let (columns, rows) = (random.random_range(1..8_u32), random.random_range(1..8_u32));
    let (width, bend) = (random.random_range(0.1..1.0), random.random_range(0.0..0.4));
    let skew = random.random_range(-0.3..0.3);
    let at = |k: u32| {
        let [x, z] =
            [f64::from(k % (columns + 1)) / f64::from(columns), f64::from(k / (columns + 1)) / f64::from(rows)];
        DVec3::new(x + skew * z, bend * x * x, width * z)
    };
    let quad = |column: u32, row: u32| {
        let first = row * (columns + 1) + column;
        let next = first + columns + 1;
        [[first, next, first + 1], [first + 1, next, next + 1]]
    };
    let triangles = (0..rows).flat_map(|row| (0..columns).flat_map(move |column| quad(column, row))).collect();
    TriMesh { points: (0..(columns + 1) * (rows + 1)).map(at).collect(), triangles }
}

/// A box with a cut corner, or with all of its corners cut a little.
fn random_cut_box(random: &mut Pcg64) -> TriMesh {
    let size = anywhere(random).abs() + 0.2;
    let (cut, is_one) = (random.random_range(0.01..0.4), random.random_bool(0.5));
    let corners = (0..8).flat_map(|corner| {
        let at = DVec3::new(f64::from(corner & 1), f64::from(corner >> 1 & 1), f64::from(corner >> 2));
        let inward = DVec3::ONE - 2.0 * at;
        let depth = if !is_one {
            0.1 * cut
        } else if corner == 0 {
            cut
        } else {
            0.0
        };
        DVec3::AXES.map(move |axis| (at + axis * inward * depth) * size)
    });
    hull_mesh(&corners.collect::<Vec<_>>())
}

fn shape(mesh: &TriMesh) -> Shape {
    let prop = Prop::new(Model::new("prop", mesh.clone()));
    Shape::new(&prop, Size::of(mesh), &Params::new(Accuracy::Standard).physics).unwrap()
}

/// The corners of the solid, in the mesh's frame.
fn solid_corners(shape: &Shape) -> Vec<DVec3> {
    let meshes = shape.bare.meshes();
    meshes.iter().flat_map(|mesh| mesh.points.iter().map(|&p| p + shape.center)).collect()
}

fn span(points: &[DVec3], direction: DVec3) -> [f64; 2] {
    let heights = || points.iter().map(|p| p.dot(direction));
    [heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max)]
}

/// Holds a prop's shape against its mesh.
fn check(case: &str, mesh: &TriMesh, random: &mut Pcg64) {
    let (shape, around) = (shape(mesh), oriented_box(mesh));
    let Size { diameter, .. } = shape.size;
    let rounding = 10.0 * SINGLE_PRECISION * diameter;
    let frame = DMat3::from_quat(around.rotation);
    assert!((frame.determinant() - 1.0).abs() < 1e-9, "{case}: its box has no frame");
    for &p in &mesh.points {
        let inside = around.half - (around.rotation.inverse() * (p - around.center)).abs();
        assert!(inside.min_element() > -rounding, "{case}: a corner is outside of its box");
    }
    let stated = shape.report.deviation_rel * diameter + rounding;
    // A ball's mesh lies within it.
    if shape.report.kind == ShapeKind::Ball {
        return;
    }
    let corners = solid_corners(&shape);
    for _ in 0..50 {
        let direction = anywhere(random).normalize_or(DVec3::Y);
        let ([low, high], [from, to]) = (span(&mesh.points, direction), span(&corners, direction));
        let off = (from - low).abs().max((to - high).abs());
        assert!(off <= stated, "{case}: {off} off, {stated} stated, a {}", shape.report.kind);
    }
    if shape.size.closed {
        let area: f64 = shape.bare.meshes().iter().map(TriMesh::area).sum();
        let solid = shape.bare.meshes().iter().map(TriMesh::signed_volume).sum::<f64>();
        let off = (solid - shape.volume).abs();
        assert!(off <= stated * area, "{case}: {off} m^3 off, a {}", shape.report.kind);
    }
}

/// A random mesh of one kind.
type Maker = fn(&mut Pcg64) -> TriMesh;

#[test]
fn extents_and_volume_are_those_of_the_mesh() {
    let makers: [(&str, Maker); 5] = [
        ("polyhedron", random_polyhedron),
        ("fan", random_fan),
        ("sheet", random_sheet),
        ("cut box", random_cut_box),
        ("regular tetrahedron", |random| {
            let size = random.random_range(0.3..3.0);
            TriMesh { points: tetrahedron().points.iter().map(|&p| p * size).collect(), ..tetrahedron() }
        }),
    ];
    for (kind, make) in makers {
        for seed in 0..MESHES {
            let mut random = Pcg64::seed_from_u64(seed);
            let mesh = make(&mut random);
            let mesh = in_a_file(mesh, any_turn(&mut random));
            check(&format!("{kind} {seed}"), &mesh, &mut random);
        }
    }
}

#[test]
fn a_regular_tetrahedron_is_its_own_hull() {
    let shape = shape(&in_a_file(tetrahedron(), DQuat::IDENTITY));
    assert_eq!(shape.report.kind, ShapeKind::Hull);
    assert_eq!(shape.bare.corners(), 4);
    // An eighth of the cube that it stands in, and two eighths more.
    assert!((shape.volume - 0.02_f64.powi(3) / 3.0).abs() < 1e-9, "{}", shape.volume);
    assert!((shape.size.extents - 0.02).abs().max_element() < 1e-6, "{}", shape.size.extents);
}

#[test]
fn a_flat_leaf_is_a_plate_however_it_is_turned() {
    let turns = [0.0, 0.25, 0.1].map(|turn| DQuat::from_rotation_x(turn * TAU) * DQuat::from_rotation_y(turn * TAU));
    for turn in turns {
        let shape = shape(&in_a_file(leaf(0.0), turn));
        let Solid::Box(plate) = &shape.solid else { panic!("it is flat") };
        let mut half = plate.half.to_array();
        half.sort_by(f64::total_cmp);
        let right = [0.0003, 0.02, 0.03];
        assert!(half.iter().zip(right).all(|(found, right)| (found - right).abs() < 1e-5), "{half:?}");
        assert!(shape.report.deviation_rel > 0.1, "its corners are stated: {}", shape.report.deviation_rel);
    }
    let bent = shape(&in_a_file(leaf(0.004), DQuat::IDENTITY));
    let [low, high] = span(&solid_corners(&bent), DVec3::X);
    assert!((high - low - 0.06).abs() < 0.003, "{}", high - low);
}

#[test]
fn a_square_sheet_has_its_edges_however_it_lies() {
    for degrees in [0.0_f64, 10.0, 30.0, 45.0] {
        let square = fan(&around(4, |turn| DVec3::new(turn.cos(), 0.0, turn.sin())), DVec3::ZERO);
        let Solid::Box(plate) = shape(&in_a_file(square, DQuat::from_rotation_y(degrees.to_radians()))).solid else {
            panic!("it is flat")
        };
        assert!((plate.half.max_element() - 0.5_f64.sqrt()).abs() < 1e-5, "{degrees}: {}", plate.half);
    }
}

#[test]
fn a_flat_triangle_is_no_box() {
    let rim = around(3, |turn| DVec3::new(turn.cos(), 0.0, turn.sin()));
    let shape = shape(&in_a_file(fan(&rim, DVec3::ZERO), DQuat::IDENTITY));
    assert_eq!(shape.report.kind, ShapeKind::Hull);
    let area = 0.75 * 3.0_f64.sqrt();
    let thickness = 0.01 * shape.size.diameter;
    assert!((shape.volume / (area * thickness) - 1.0).abs() < 0.05, "{}", shape.volume);
}

#[test]
fn a_box_without_a_corner_is_no_box() {
    let cut = |depth: f64| {
        let corners = (1..8).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)));
        let corners = corners.chain(DVec3::AXES.map(|axis| axis * depth)).collect::<Vec<_>>();
        shape(&in_a_file(hull_mesh(&corners), DQuat::IDENTITY)).report
    };
    // 4 % of its volume.
    assert_eq!(cut(0.62).kind, ShapeKind::Hull);
    let chipped = cut(0.1);
    assert_eq!(chipped.kind, ShapeKind::Box);
    // Its corner is 0.1 / sqrt(3) from the cut.
    assert!((chipped.deviation_rel - 0.1 / 3.0).abs() < 1e-3, "{}", chipped.deviation_rel);
}
