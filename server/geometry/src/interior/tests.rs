use super::*;
use rand::SeedableRng;
use std::f64::consts::PI;

fn cuboid(lo: [f64; 3], hi: [f64; 3]) -> TriMesh {
    let points = (0..8).map(|i| DVec3::from_array([0, 1, 2].map(|a| if i >> a & 1 == 1 { hi[a] } else { lo[a] })));
    #[rustfmt::skip]
    let triangles = vec![
        [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6],
    ];
    TriMesh { points: points.collect(), triangles }
}

/// A torus around Y.
fn torus(major: f64, minor: f64, n: u32) -> TriMesh {
    let point = |i: u32| {
        let (u, v) = ((i / n) as f64 * 2.0 * PI / n as f64, (i % n) as f64 * 2.0 * PI / n as f64);
        let r = major + minor * v.cos();
        DVec3::new(r * u.cos(), minor * v.sin(), r * u.sin())
    };
    let quad = |i: u32| {
        let (u, v) = (i / n, i % n);
        let (u1, v1) = ((u + 1) % n, (v + 1) % n);
        [[u * n + v, u * n + v1, u1 * n + v1], [u * n + v, u1 * n + v1, u1 * n + v]]
    };
    TriMesh { points: (0..n * n).map(point).collect(), triangles: (0..n * n).flat_map(quad).collect() }
}

fn reversed(mesh: &TriMesh) -> TriMesh {
    let triangles = mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    TriMesh { points: mesh.points.clone(), triangles }
}

fn random_points(n: usize, half: f64) -> Vec<DVec3> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(7);
    let mut one = || (rng.random::<f64>() * 2.0 - 1.0) * half;
    (0..n).map(|_| DVec3::new(one(), one(), one())).collect()
}

#[test]
fn a_box_knows_its_inside() {
    let region = MeshInterior::new(&cuboid([0.0; 3], [1.0, 2.0, 3.0]));
    assert!((region.volume() - 6.0).abs() < 1e-12);
    assert!(region.contains(DVec3::new(0.5, 1.0, 1.5)) && !region.contains(DVec3::new(1.1, 1.0, 1.5)));
    assert!((region.signed_distance(DVec3::new(0.1, 1.0, 1.5)) + 0.1).abs() < 1e-12);
    assert!((region.signed_distance(DVec3::new(4.0, 6.0, 1.5)) - 5.0).abs() < 1e-12);
    let (point, distance, triangle) = region.nearest(DVec3::new(0.5, 2.5, 1.5));
    assert_eq!((point, distance), (DVec3::new(0.5, 2.0, 1.5), 0.5));
    assert!(triangle == 6 || triangle == 7);
}

#[test]
fn the_winding_number_agrees_with_the_exact_sum() {
    let region = MeshInterior::new(&torus(1.0, 0.4, 60));
    assert!((region.volume() - 2.0 * PI * PI * 0.16).abs() < 0.02);
    for p in random_points(2000, 1.6) {
        let exact = region.all.tree.winding_number(p, f64::INFINITY);
        assert!((region.winding_number(p) - exact).abs() < 0.03, "{p}");
        assert!((exact - exact.round()).abs() < 1e-9 && region.all.at(p) == exact.round());
        let ring = DVec3::new(p.x, 0.0, p.z).length() - 1.0;
        let distance = ring.hypot(p.y) - 0.4;
        assert!((region.signed_distance(p) - distance).abs() < 0.01, "{p}");
    }
}

/// What the tree leaves out is farther, to the last bit: also among slivers, and triangles without an area.
#[test]
fn the_nearest_triangle_is_the_nearest_of_all() {
    let ring = torus(1.0, 0.4, 40);
    let mut triangles: Vec<[DVec3; 3]> = (0..ring.triangles.len()).map(|i| ring.corners(i)).collect();
    for (i, p) in random_points(300, 1.0).into_iter().enumerate() {
        let along = DVec3::new(p.y, -p.x, p.z * p.x);
        let aside = along.any_orthogonal_vector() * [0.0, 1e-17, 1e-9, 1e-6, 1e-4, 0.3][i % 6];
        triangles.push([p, p + along, p + along / 3.0 + aside]);
    }
    let offset = DVec3::new(3000.0, -200.0, 0.7);
    for (scale, offset) in [(1.0, DVec3::ZERO), (1e-4, DVec3::ZERO), (1e4, DVec3::ZERO), (1.0, offset)] {
        let moved: Vec<_> = triangles.iter().map(|t| t.map(|p| p * scale + offset)).collect();
        let tree = Bvh::new(moved.iter().enumerate().map(|(i, &t)| (i as u32, t)).collect());
        for (i, p) in random_points(900, 1.0).into_iter().enumerate() {
            let p = p * [0.01, 1.5, 40.0][i % 3] * scale + offset;
            let distances = moved.iter().map(|t| p.distance_squared(bvh::closest_on_triangle(p, t)));
            let least = distances.fold(f64::INFINITY, f64::min);
            assert_eq!(tree.nearest(p, i as u32).unwrap().squared, least, "{p}");
        }
    }
}

#[test]
fn an_inside_out_mesh_is_turned() {
    let region = MeshInterior::new(&reversed(&torus(1.0, 0.4, 20)));
    assert!(region.was_inside_out() && region.volume() > 0.0);
    assert!(region.contains(DVec3::X) && !region.contains(DVec3::ZERO));
}

#[test]
fn overlapping_boxes_are_their_union() {
    // A corner of one in the other: no triangle lies wholly inside.
    let mut mesh = cuboid([0.0; 3], [1.0; 3]);
    mesh.append(&cuboid([0.5; 3], [1.5; 3]));
    let region = MeshInterior::new(&mesh);
    assert!((region.winding_number(DVec3::splat(0.75)) - 2.0).abs() < 1e-6);
    assert!(region.contains(DVec3::splat(0.75)));
    assert!((region.volume() - 1.875).abs() < 0.03, "{}", region.volume());
    // A letter T of two boxes: the end of the stem inside the bar is no surface.
    let mut letter = cuboid([-0.5, 0.0, -0.5], [0.5, 3.5, 0.5]);
    letter.append(&cuboid([-2.0, 3.0, -0.5], [2.0, 4.0, 0.5]));
    let letter = MeshInterior::new(&letter);
    assert!((letter.volume() - 7.0).abs() < 0.1, "{}", letter.volume());
    assert!((letter.nearest(DVec3::new(0.0, 3.5, 0.0)).1 - 0.5).abs() < 1e-9);
}

#[test]
fn a_hole_is_capped() {
    let mut mesh = cuboid([0.0; 3], [1.0; 3]);
    mesh.triangles.truncate(10);
    let region = MeshInterior::new(&mesh);
    assert!(region.is_open());
    assert!(region.contains(DVec3::new(0.5, 0.5, 0.3)) && !region.contains(DVec3::new(0.5, 0.5, 1.2)));
    assert!(region.volume() > 0.7 && region.volume() < 1.0 + 1e-9, "{}", region.volume());
}

#[test]
fn cracks_of_rounding_are_no_holes() {
    // Every triangle with its own corners, each moved a little.
    let whole = torus(1.0, 0.4, 30);
    let mut jitter = random_points(3 * whole.triangles.len(), 1e-8).into_iter();
    let mut soup = TriMesh::default();
    for i in 0..whole.triangles.len() {
        let base = soup.points.len() as u32;
        soup.points.extend(whole.corners(i).map(|p| p + jitter.next().unwrap()));
        soup.triangles.push([base, base + 1, base + 2]);
    }
    let region = MeshInterior::new(&soup);
    assert!(!region.is_open() && (region.volume() - MeshInterior::new(&whole).volume()).abs() < 1e-6);
    soup.triangles.pop();
    assert!(MeshInterior::new(&soup).is_open());
}

#[test]
fn rays_through_edges_and_corners_count_once() {
    // Points below the corners and edges of a cube, along every ray that may be used.
    let region = MeshInterior::new(&cuboid([0.0; 3], [1.0; 3]));
    assert!(!region.is_open());
    for (x, y) in ray::SLOPES {
        for i in 0..9 {
            let target = DVec3::new((i % 3) as f64 / 2.0, (i / 3) as f64 / 2.0, 1.0);
            for depth in [0.25, 0.5, 2.0] {
                let p = target - DVec3::new(x, y, 1.0) * depth;
                let strictly = p.cmpgt(DVec3::ZERO).all() && p.cmplt(DVec3::ONE).all();
                assert_eq!(region.contains(p), strictly, "{p}");
            }
        }
    }
}

#[test]
fn the_face_where_two_parts_touch_is_inside() {
    // The two have different diagonals there, and a part that reaches over both.
    let mut mesh = cuboid([0.0; 3], [1.0, 0.7, 1.0]);
    let mut upper = cuboid([0.0, 0.7, 0.0], [1.0, 1.9, 1.0]);
    upper.triangles[4..6].copy_from_slice(&[[1, 5, 4], [1, 4, 0]]);
    mesh.append(&upper);
    let region = MeshInterior::new(&mesh);
    assert!(!region.is_open() && (region.volume() - 1.9).abs() < 1e-9);
    for p in random_points(500, 0.5) {
        let p = DVec3::new(p.x + 0.5, 0.7, p.z + 0.5);
        assert!(region.contains(p), "{p}");
        assert!(region.signed_distance(p) < 0.0);
    }
}

#[test]
fn degenerate_triangles_do_no_harm() {
    let mut mesh = cuboid([0.0; 3], [1.0; 3]);
    mesh.triangles.extend([[0, 0, 0], [0, 1, 1], [0, 1, 0]]);
    let region = MeshInterior::new(&mesh);
    for p in random_points(200, 2.0).into_iter().chain(mesh.points.clone()) {
        assert!(region.winding_number(p).is_finite() && region.signed_distance(p).is_finite());
    }
    assert!((region.signed_distance(DVec3::splat(0.5)) + 0.5).abs() < 1e-12);
    let flat = TriMesh { points: vec![DVec3::ZERO, DVec3::X, DVec3::Y], triangles: vec![[0, 1, 2]] };
    assert!(MeshInterior::new(&flat).signed_distance(DVec3::Z) == 1.0);
}

#[test]
fn scale_changes_nothing() {
    for scale in [1e-3, 1e3] {
        let mut mesh = torus(1.0, 0.4, 30);
        mesh.points.iter_mut().for_each(|p| *p *= scale);
        let region = MeshInterior::new(&mesh);
        let unit = MeshInterior::new(&torus(1.0, 0.4, 30));
        for p in random_points(300, 1.6) {
            assert!((region.signed_distance(p * scale) / scale - unit.signed_distance(p)).abs() < 1e-9);
        }
    }
}

#[test]
fn points_drawn_inside_are_inside() {
    let region = MeshInterior::new(&torus(1.0, 0.4, 30));
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
    let points: Vec<DVec3> = (0..2000).map(|_| region.sample_inside(&mut rng).unwrap()).collect();
    assert!(points.iter().all(|&p| region.contains(p)));
    assert!((points.iter().sum::<DVec3>() / 2000.0).length() < 0.1);
}

#[test]
fn the_grid_agrees_with_the_region() {
    let region = MeshInterior::new(&torus(1.0, 0.4, 40));
    let grid = DistanceGrid::new(&region, 0.05, 1 << 20, [0.1, 0.3]);
    assert!(!grid.capped() && grid.spacing() == 0.05);
    for p in random_points(2000, 1.5) {
        let exact = region.signed_distance(p);
        let error = (grid.signed_distance(p) - exact).abs();
        // Far from the surface, nodes four cells apart are enough: the error is largest on ridges.
        let most = if (-0.1..0.3).contains(&exact) { 0.05 } else { 0.17 };
        assert!(error < most || p.y.abs() > 0.45, "{p}: {error}");
    }
    let all = DistanceGrid::new(&region, 0.05, 1 << 20, [10.0; 2]);
    let (values, exact) = (grid.nodes().2, all.nodes().2);
    let differ = values.iter().zip(exact).filter(|(value, exact)| (*value - *exact).abs() > 1e-12);
    assert!(differ.clone().all(|(_, exact)| !(-0.1..0.3).contains(exact)));
    assert!(differ.clone().count() * 6 > values.len(), "{} of {}", differ.count(), values.len());
    assert!(values.iter().zip(exact).all(|(value, exact)| (*value < 0.0) == (*exact < 0.0)));
    let outward = grid.gradient(DVec3::new(1.3, 0.0, 0.0));
    assert!(outward.dot(DVec3::X) > 0.9, "{outward}");
    assert!(grid.gradient(DVec3::new(9.0, 0.0, 0.0)).dot(DVec3::X) > 0.9);
    assert!(grid.signed_distance(DVec3::new(9.0, 0.0, 0.0)) > 7.0);
}

#[test]
fn a_capped_grid_says_so() {
    let region = MeshInterior::new(&cuboid([0.0; 3], [1.0; 3]));
    let grid = DistanceGrid::new(&region, 1e-6, 5000, [1.0; 2]);
    assert!(grid.capped() && grid.spacing() > 0.04 && grid.spacing() < 0.1);
    assert!((grid.signed_distance(DVec3::splat(0.5)) + 0.5).abs() < grid.spacing());
}
