//! Cubes, alone, joined, nested, doubled and turned.

use glam::{DAffine3, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::testing::says_only;

/// A cube of edge `size` with its lowest corner at `at`, outward.
fn cube(size: f64, at: DVec3) -> TriMesh {
    let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { points: (0..8).map(|i| at + size * corner(i)).collect(), triangles }
}

fn joined(meshes: &[TriMesh]) -> TriMesh {
    let mut all = TriMesh::default();
    meshes.iter().for_each(|mesh| all.append(mesh));
    all
}

fn inside_out(mesh: &TriMesh) -> TriMesh {
    TriMesh { points: mesh.points.clone(), triangles: mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect() }
}

#[test]
fn a_cube() {
    let found = inspect(&cube(2.0, DVec3::splat(128.0)));
    assert!((found.signed_volume - 8.0).abs() < 1e-12, "{found:?}");
    let expected = Topology {
        triangles: 12,
        boundary_edges: 0,
        nonmanifold_edges: 0,
        misoriented_edges: 0,
        unbalanced_edges: 0,
        components: 1,
        signed_volume: found.signed_volume,
        area: 24.0,
        closed: true,
        diagonal: 12f64.sqrt(),
    };
    assert_eq!(found, expected);
    assert!(found.is_watertight());
    assert!(inspect(&inside_out(&cube(2.0, DVec3::ZERO))).signed_volume < -7.9);
    assert_eq!(inspect(&TriMesh::default()), Topology::default());
}

#[test]
fn split_points_are_welded() {
    let whole = cube(1.0, DVec3::ZERO);
    let points: Vec<DVec3> = (0..12).flat_map(|i| whole.corners(i)).collect();
    let soup = TriMesh { points, triangles: (0..12).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect() };
    assert!(inspect(&soup).is_watertight());
    assert_eq!(weld(&soup, 0.0).points.len(), 8);

    // Noise of single precision opens it; welding within a tolerance closes it again.
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut noisy = soup.clone();
    let mut noise = || rng.random_range(-1e-7..1e-7);
    noisy.points.iter_mut().for_each(|p| *p += DVec3::new(noise(), noise(), noise()));
    assert_eq!(inspect(&noisy).components, 12);
    assert!(inspect(&weld(&noisy, WELD_TOLERANCE)).is_watertight());
    assert!(!inspect(&weld(&noisy, 1e-9)).closed);
    // All of it within reach is nothing.
    assert_eq!(weld(&noisy, 2.0), TriMesh::default());
}

#[test]
fn holes_and_turned_faces() {
    let mut open = cube(1.0, DVec3::ZERO);
    open.triangles.pop();
    let found = inspect(&open);
    assert!(found.boundary_edges == 3 && !found.closed, "{found:?}");

    let mut turned = cube(1.0, DVec3::ZERO);
    turned.triangles[5].swap(0, 1);
    let found = inspect(&turned);
    assert!(found.misoriented_edges == 3 && found.closed && !found.is_watertight(), "{found:?}");
}

#[test]
fn cubes_that_share_an_edge_or_a_corner() {
    let edge = joined(&[cube(1.0, DVec3::ZERO), cube(1.0, DVec3::new(1.0, 1.0, 0.0))]);
    let found = inspect(&edge);
    assert!(found.nonmanifold_edges == 1 && found.closed && found.components == 1, "{found:?}");
    assert!(!found.is_watertight());
    let corner = joined(&[cube(1.0, DVec3::ZERO), cube(1.0, DVec3::ONE)]);
    let found = inspect(&corner);
    assert!(found.is_watertight() && found.components == 2, "{found:?}");
}

/// Orients `mesh`, which must give something watertight of this volume, and the same if done once more.
#[track_caller]
fn repaired(mesh: &TriMesh, volume: f64) -> Repair {
    let (result, repair) = oriented(mesh);
    let found = inspect(&result);
    assert!(found.is_watertight(), "{found:?} {repair:?}");
    assert!((found.signed_volume - volume).abs() < 1e-12, "{found:?} {repair:?}");
    let (again, nothing) = oriented(&result);
    assert_eq!(again, result);
    assert_eq!(nothing, Repair { cavities: repair.cavities, ..Repair::default() });
    repair
}

#[test]
fn a_clean_mesh_stays_as_it_is() {
    let mesh = cube(1.0, DVec3::new(3.0, 4.0, 5.0));
    assert_eq!(oriented(&mesh), (mesh, Repair::default()));
    assert!(Repair::default().describe().is_empty());
}

#[test]
fn faces_at_random_become_consistent_and_outward() {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    for _ in 0..100 {
        let mut mesh = cube(1.0, DVec3::ZERO);
        mesh.triangles.iter_mut().filter(|_| rng.random()).for_each(|t| t.swap(0, 1));
        repaired(&mesh, 1.0);
    }
    let mut mesh = cube(1.0, DVec3::ZERO);
    mesh.triangles[3].swap(0, 1);
    let repair = repaired(&mesh, 1.0);
    assert_eq!((repair.turned, repair.inside_out), (1, 0));
    assert_eq!(repair.describe(), ["1 triangle turned to face the same way as those around them"]);
    let repair = repaired(&inside_out(&cube(1.0, DVec3::ZERO)), 1.0);
    assert_eq!((repair.turned, repair.inside_out), (0, 1));
}

#[test]
fn cavities_are_those_that_faced_the_other_way() {
    let (outer, inner) = (cube(3.0, DVec3::ZERO), cube(1.0, DVec3::ONE));
    let hollow = joined(&[inside_out(&inner), outer.clone()]);
    assert_eq!(repaired(&hollow, 26.0), Repair { cavities: 1, ..Repair::default() });
    // Everything mirrored: still hollow.
    let repair = repaired(&inside_out(&hollow), 26.0);
    assert_eq!((repair.inside_out, repair.cavities), (2, 1));
    // Both outward: a solid in a solid, as a bolt in a plank.
    assert_eq!(repaired(&joined(&[outer.clone(), inner.clone()]), 28.0), Repair::default());
    // An island in the cavity is solid whichever way it faced.
    let island = cube(0.5, DVec3::splat(1.25));
    for island in [inside_out(&island), island] {
        assert_eq!(repaired(&joined(&[hollow.clone(), island]), 26.125).cavities, 1);
    }
    // Beside each other, or crossing, nothing is a cavity.
    let beside = joined(&[outer.clone(), inside_out(&cube(1.0, DVec3::new(5.0, 0.0, 0.0)))]);
    assert_eq!(repaired(&beside, 28.0), Repair { inside_out: 1, ..Repair::default() });
    let crossing = joined(&[outer, inside_out(&cube(1.0, DVec3::new(2.5, 1.1, 1.1)))]);
    assert_eq!(repaired(&crossing, 28.0).cavities, 0);
}

#[test]
fn open_parts_face_outward_and_flat_ones_stay() {
    let mut bowl = cube(1.0, DVec3::ZERO);
    bowl.triangles.drain(6..8); // without its lid
    let (result, repair) = oriented(&inside_out(&bowl));
    assert_eq!((result.triangles, repair.inside_out), (bowl.triangles.clone(), 1));
    assert_eq!(oriented(&bowl).1, Repair::default());
    let sheet = weld(&TriMesh { triangles: bowl.triangles[..2].to_vec(), ..bowl }, 0.0);
    assert_eq!(oriented(&sheet), (sheet.clone(), Repair::default()));
    assert_eq!(oriented(&inside_out(&sheet)).1, Repair::default());
}

#[test]
fn a_surface_of_one_side_is_told() {
    let count = 16;
    let at = |i: u32, side: f64| {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(count);
        let out = DVec3::new(angle.cos(), 0.0, angle.sin());
        3.0 * out + side * ((angle / 2.0).cos() * out + (angle / 2.0).sin() * DVec3::Y)
    };
    let points = (0..count).flat_map(|i| [at(i, 1.0), at(i, -1.0)]).collect();
    let quad = |i: u32| {
        let (a, b) = (2 * i, 2 * i + 1);
        // The strip closes with its sides exchanged.
        let (c, d) = if i + 1 == count { (1, 0) } else { (a + 2, b + 2) };
        [[a, b, c], [b, d, c]]
    };
    let (_, repair) = oriented(&TriMesh { points, triangles: (0..count).flat_map(quad).collect() });
    assert_eq!(repair.unorientable, 1);
    assert!(repair.describe().iter().any(|t| t.contains("one side only")), "{:?}", repair.describe());
}

#[test]
fn doubled_triangles() {
    let plain = cube(1.0, DVec3::ZERO);
    // Exported twice, double-sided, three times, and one face only.
    assert_eq!(repaired(&joined(&[plain.clone(), plain.clone()]), 1.0).duplicates, 12);
    assert_eq!(repaired(&joined(&[inside_out(&plain), plain.clone()]), 1.0).duplicates, 12);
    assert_eq!(repaired(&joined(&[plain.clone(), plain.clone(), plain.clone()]), 1.0).duplicates, 24);
    let mut patch = plain.clone();
    patch.triangles.extend_from_within(2..6);
    assert_eq!(repaired(&patch, 1.0).duplicates, 4);

    // Two cubes that share a wall, kept by both: nothing is opened.
    let wall = joined(&[plain.clone(), cube(1.0, DVec3::X)]);
    let (result, repair) = oriented(&wall);
    let found = inspect(&result);
    assert!(found.closed && found.misoriented_edges == 0, "{found:?}");
    assert!((found.signed_volume - 2.0).abs() < 1e-12 && repair == Repair::default(), "{repair:?}");

    // A double-sided sheet is a sheet.
    let sheet = TriMesh { triangles: plain.triangles[..2].to_vec(), ..plain };
    let (result, repair) = oriented(&joined(&[sheet.clone(), inside_out(&sheet)]));
    assert_eq!((result.triangles.len(), repair.duplicates), (2, 2));
    assert_eq!(inspect(&result).boundary_edges, 4);
}

#[test]
fn triangles_of_no_area_leave_without_opening_the_surface() {
    // Points along an edge of the cube, with a fan of flat triangles from its first end, as triangulators make it.
    let mut mesh = cube(1.0, DVec3::ZERO);
    let along = mesh.points.len() as u32;
    mesh.points.extend([0.25, 0.5, 0.75].map(|x| DVec3::new(x, 0.0, 0.0)));
    let face = mesh.triangles.iter().position(|t| *t == [0, 1, 5]).expect("the face at this edge");
    mesh.triangles[face] = [0, along, 5];
    mesh.triangles.extend([[along, along + 1, 5], [along + 1, along + 2, 5], [along + 2, 1, 5]]);
    mesh.triangles.extend([[along, 0, along + 1], [along + 1, 0, along + 2], [along + 2, 0, 1]]);
    assert!(inspect(&mesh).is_watertight());
    let repair = repaired(&mesh, 1.0);
    assert_eq!(repair.flat, Flat { folded: 3, dropped: 0, left: 0 });

    let slanted = DAffine3::from_rotation_z(0.7) * DAffine3::from_rotation_x(0.4);
    assert_eq!(repaired(&mesh.transformed(&slanted), 1.0).flat.folded, 3);
    // At a rim there is no neighbour to split.
    let points = vec![DVec3::ZERO, DVec3::X, 2.0 * DVec3::X, DVec3::Y];
    let mut rim = TriMesh { points, triangles: vec![[0, 1, 3], [0, 2, 1]] };
    assert_eq!(drop_flat(&mut rim), Flat { folded: 0, dropped: 1, left: 0 });
    assert_eq!(rim.triangles, [[0, 1, 3]]);
}

#[test]
fn soups_at_random_are_survived() {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for case in 0..5000 {
        // Few places, so that points, edges and triangles coincide and lie on lines.
        let (points, side) = (rng.random_range(3..9), rng.random_range(2..4));
        let mut place = || DVec3::from([0; 3].map(|_| f64::from(rng.random_range(0..side))));
        let points: Vec<DVec3> = (0..points).map(|_| place()).collect();
        let count = rng.random_range(0..30);
        let triangles = (0..count).map(|_| [0; 3].map(|_| rng.random_range(0..points.len() as u32))).collect();
        let mesh = TriMesh { points, triangles };
        let before = inspect(&mesh);
        let (result, repair) = oriented(&mesh);
        let after = inspect(&result);
        assert!(after.triangles <= before.triangles, "case {case}");
        assert!((after.misoriented_edges == 0) == (repair.unorientable == 0), "case {case}: {after:?} {repair:?}");
        assert_eq!(weld(&result, 0.0), result, "case {case}");
    }
}

#[test]
fn each_repair_is_described() {
    let none = Repair::default();
    for (case, repair, words) in [
        ("when the mesh is clean", none.clone(), &[] as &[&str]),
        (
            "when corners are equal",
            Repair { degenerate: 1, ..none.clone() },
            &["1 triangle removed, because two corners are equal"],
        ),
        (
            "when triangles are lines",
            Repair { flat: Flat { folded: 1, dropped: 1, left: 0 }, ..none.clone() },
            &["2 triangles of no area merged with those beside them"],
        ),
        (
            "when lines hold the surface",
            Repair { flat: Flat { folded: 0, dropped: 0, left: 1 }, ..none.clone() },
            &["1 triangle of no area left, which could not be taken away"],
        ),
        (
            "when the surface has one side",
            Repair { unorientable: 1, ..none.clone() },
            &["1 edge left inconsistent: the surface has one side only"],
        ),
        (
            "when there are very many parts",
            Repair { cavities_not_sought: true, ..none },
            &["there are too many parts to look for cavities: all count as solids"],
        ),
    ] {
        says_only(case, &repair.describe(), words);
    }
}
