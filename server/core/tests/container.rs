//! Containers: touching parts stay as they are, overlapping ones become one, and fine meshes become coarser.

use super::common::cone;
use cairn_engine::shape::{Shape, Size};
use cairn_engine::units::Units;
use cairn_geometry::ClosedMesh;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_geometry::topology::{close_holes, inspect, weld};
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{Model, Prop, Scene, StaticModel};
use cairn_prepare::container::{Container, has_fine_walls};
use cairn_prepare::effects::EffectName;
use cairn_prepare::surroundings::Surroundings;
use glam::{DQuat, DVec3};

/// A box from `low` to `high`, each side cut into `cuts` x `cuts` squares; faces outward.
fn block(low: DVec3, high: DVec3, cuts: u32) -> TriMesh {
    let mut mesh = TriMesh::default();
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let corner = |i: u32, j: u32| {
                let mut share = DVec3::ZERO;
                share[axis] = side;
                share[(axis + 1) % 3] = f64::from(i) / f64::from(cuts);
                share[(axis + 2) % 3] = f64::from(j) / f64::from(cuts);
                low + (high - low) * share
            };
            for (i, j) in (0..cuts).flat_map(|i| (0..cuts).map(move |j| (i, j))) {
                let first = mesh.points.len() as u32;
                mesh.points.extend([corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]);
                let quad = [[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|v| first + v));
                let outward = |[a, b, c]: [u32; 3]| if side == 1.0 { [a, b, c] } else { [a, c, b] };
                mesh.triangles.extend(quad.map(outward));
            }
        }
    }
    weld(&mesh, 1e-9)
}

fn joined(parts: &[TriMesh]) -> TriMesh {
    let mut mesh = TriMesh::default();
    parts.iter().for_each(|part| mesh.append(part));
    mesh
}

fn container(mesh: &TriMesh, tolerance: f64) -> Container {
    Container::new(&ClosedMesh::new(inspect(mesh), mesh.clone()), &Units::new(1.0, 1.0, 1.0), 0.0, tolerance)
}

fn unit(x: f64, edge: f64) -> TriMesh {
    let low = DVec3::new(x, 0.0, 0.0);
    block(low, low + edge, 2)
}

#[test]
fn parts_that_touch_or_lie_apart_stay_as_they_are() {
    for gap in [0.0, 0.5, 1e-4] {
        let mesh = joined(&[unit(0.0, 4.0), unit(4.0 + gap, 3.0)]);
        assert!(!container(&mesh, 0.0).remeshed, "gap {gap}");
    }
    let hollow = joined(&[unit(0.0, 4.0), {
        let mut hole = unit(1.0, 2.0);
        hole.points.iter_mut().for_each(|p| p.y += 1.0);
        hole.points.iter_mut().for_each(|p| p.z += 1.0);
        hole.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        hole
    }]);
    let hollow = container(&hollow, 0.0);
    assert!(!hollow.remeshed);
    assert!((hollow.volume - 56.0).abs() < 1e-6, "{}", hollow.volume);
}

#[test]
fn parts_that_overlap_become_one() {
    let overlapping = joined(&[unit(0.0, 4.0), unit(3.5, 4.0)]);
    let inside = joined(&[unit(0.0, 4.0), block(DVec3::ONE, DVec3::splat(2.0), 1)]);
    let beams = joined(&[
        block(DVec3::new(0.0, 2.0, 2.0), DVec3::new(9.0, 3.0, 3.0), 1),
        block(DVec3::new(4.0, 0.0, 2.2), DVec3::new(5.0, 9.0, 2.8), 1),
    ]);
    for (name, mesh) in [("overlapping", overlapping), ("one in the other", inside), ("crossing", beams)] {
        assert!(container(&mesh, 0.0).remeshed, "{name}");
    }
}

#[test]
fn a_fine_container_becomes_coarser_within_the_tolerance() {
    let mesh = block(DVec3::ZERO, DVec3::splat(5.0), 40);
    let container = container(&mesh, 0.02);
    assert!(!container.remeshed);
    let closed = container.closed(0.0);
    assert!(closed.mesh.triangles.len() < 200, "{} of {}", closed.mesh.triangles.len(), mesh.triangles.len());
    assert_eq!(closed.saved, mesh.triangles.len() - closed.mesh.triangles.len());
    assert!(closed.deviation < 1e-6, "flat faces stay where they are: {}", closed.deviation);
    let found = inspect(&closed.mesh);
    assert!(found.is_watertight());
    assert!((found.signed_volume + 125.0).abs() < 1e-3, "facing inward: {}", found.signed_volume);
    let opened = container.opened(0.1, 2.0);
    assert!(opened.saved > 0 && opened.mesh.bounds().0.y == -2.0);
}

#[test]
fn a_union_stays_within_the_tolerance() {
    let ball = |x: f64| {
        let mut ball = block(DVec3::splat(-1.0), DVec3::ONE, 10);
        ball.points.iter_mut().for_each(|p| *p = p.normalize() * 2.0 + DVec3::new(x, 2.0, 0.0));
        ball
    };
    let union = |tolerance| container(&joined(&[ball(0.0), ball(3.0)]), tolerance).closed(0.0);
    let exact = union(0.0);
    let mut before = exact.mesh.triangles.len();
    assert_eq!((exact.saved, exact.deviation), (0, 0.0));
    for tolerance in [0.005, 0.02, 0.1] {
        let found = union(tolerance);
        assert!(found.mesh.triangles.len() < before / 2, "{tolerance}: {}", found.mesh.triangles.len());
        assert!(found.deviation <= tolerance, "{tolerance}: {}", found.deviation);
        before = found.mesh.triangles.len();
    }
}

#[test]
fn a_coarse_container_is_left_alone() {
    let mesh = cone(3.0, 6.0);
    assert!(!has_fine_walls(&inspect(&mesh), 1.0));
    let mut params = Params::new(Accuracy::Standard);
    params.fill.wall_tolerance = 0.5;
    let scene = super::common::scene(mesh, super::common::stick());
    let plan = cairn_core::plan(&scene, &params).unwrap();
    let effect = plan.effects.iter().find(|effect| effect.name == EffectName::WallSimplification).unwrap();
    assert!(!effect.on, "{}", effect.reason);
    params.fill.count = Some(4);
    let counts = cairn_core::bake(&scene, &params, &mut Silent).unwrap().report.counts;
    assert_eq!(counts["wall_triangles_saved"], 0);
}

/// A mesh without some of its triangles.
fn without(mesh: &TriMesh, is_removed: impl Fn([DVec3; 3]) -> bool) -> TriMesh {
    let kept = (0..mesh.triangles.len()).filter(|&i| !is_removed(mesh.corners(i))).map(|i| mesh.triangles[i]);
    weld(&TriMesh { points: mesh.points.clone(), triangles: kept.collect() }, 0.0)
}

#[test]
fn small_and_flat_holes_are_closed() {
    let cube = block(DVec3::ZERO, DVec3::splat(2.0), 8);
    let volume = cube.signed_volume();
    // Without its lid; with two holes that share a corner; with a hole around a corner of the cube, whose rim is not
    // flat.
    let lid = without(&cube, |corners| corners.iter().all(|p| p.y == 2.0));
    let two = without(&cube, |corners| {
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        let (column, row) = ((4.0 * middle.x) as i32, (4.0 * middle.z) as i32);
        corners.iter().all(|p| p.y == 0.0) && [(2, 2), (3, 3)].contains(&(column, row))
    });
    let corner = without(&cube, |corners| corners.contains(&DVec3::ZERO));
    for (open, count, deviation) in [(&lid, 1, 0.0), (&two, 2, 0.0), (&corner, 1, 0.15)] {
        assert!(!inspect(open).closed);
        let (closed, holes) = close_holes(open).unwrap();
        let found = inspect(&closed);
        assert!(found.is_watertight(), "{found:?}");
        assert_eq!(holes.count, count);
        assert!(holes.deviation <= deviation && holes.area < 0.2, "{holes:?}");
        assert!((closed.signed_volume() - volume).abs() < 0.01 * volume, "{holes:?}");
    }
    // Half of a ball's surface is missing, along a rim that is neither small nor flat.
    let wavy = without(&cube, |corners| corners.iter().any(|p| p.y > 1.0 + 0.8 * (p.x - 1.0) * (p.z - 1.0)));
    assert!(close_holes(&wavy).is_none());
}

#[test]
fn an_open_control_mesh_that_has_an_inside_is_filled() {
    let mut scene = super::common::scene(cone(0.8, 1.2), super::common::stick());
    let control = &mut scene.control.as_mut().unwrap().mesh;
    let low = control.bounds().0.y;
    *control = without(&weld(control, 1e-9), |corners| corners.iter().all(|p| p.y == low));
    let plan = cairn_core::plan(&scene, &Params::new(Accuracy::Draft)).unwrap();
    assert!(plan.warnings.iter().any(|w| w.contains("1 hole was closed")), "{:?}", plan.warnings);
}

#[test]
fn overlapping_parts_are_filled_once() {
    // Cubes of edge 2, and a bar of 1.4 x 1.4 whose half is in one of them.
    let volume = |parts: &[TriMesh]| {
        let mesh = joined(parts);
        ClosedMesh::new(inspect(&mesh), mesh).volume
    };
    let beyond = block(DVec3::new(1.01, 0.3, 0.3), DVec3::new(3.01, 1.7, 1.7), 2);
    let [one, apart, overlapping] =
        [vec![unit(0.0, 2.0)], vec![unit(0.0, 2.0), unit(3.0, 2.0)], vec![unit(0.0, 2.0), beyond]]
            .map(|parts| volume(&parts));
    assert!((one - 8.0).abs() < 1e-9 && (apart - 16.0).abs() < 1e-9, "{one} {apart}");
    assert!((overlapping - 8.0 - 1.01 * 1.96).abs() < 0.2, "{overlapping}");
}

/// A hollow prop takes the room of its hull; one that is merely long does not.
#[test]
fn hollow_props_take_the_room_of_their_hull() {
    let cup = joined(&[
        block(DVec3::new(-0.1, 0.0, -0.1), DVec3::new(0.1, 0.01, 0.1), 1),
        block(DVec3::new(-0.1, 0.011, -0.1), DVec3::new(-0.09, 0.2, 0.1), 1),
        block(DVec3::new(0.09, 0.011, -0.1), DVec3::new(0.1, 0.2, 0.1), 1),
    ]);
    let crate_ = block(DVec3::new(-0.1, 0.0, -0.1), DVec3::new(0.1, 0.2, 0.1), 1);
    let size = |mesh: &TriMesh| cairn_engine::shape::Size::of(mesh);
    let hull = 0.2 * 0.2 * 0.2;
    assert!((size(&cup).hull_volume - hull).abs() < 1e-3 * hull, "{}", size(&cup).hull_volume);
    assert!(size(&cup).volume < 0.2 * hull);
    let expected = |mesh: &TriMesh| {
        let scene = super::common::scene(cone(1.0, 2.0), mesh.clone());
        cairn_core::plan(&scene, &Params::new(Accuracy::Standard)).unwrap().expected_bodies as f64
    };
    let (cups, crates) = (expected(&cup), expected(&crate_));
    assert!((cups / crates - 1.0).abs() < 0.1, "{cups} {crates}");
}

/// An arch over a sheet that goes through both of its feet, or through its top, or that it stands on.
#[test]
fn what_has_a_sheet_through_its_middle_is_known() {
    let part = |x: f64, y: f64, half: [f64; 2]| {
        let (middle, half) = (DVec3::new(x, y, 0.0), DVec3::new(half[0], half[1], 0.05));
        block(middle - half, middle + half, 1)
    };
    let arch = joined(&[part(-0.4, 0.0, [0.1, 0.4]), part(0.4, 0.0, [0.1, 0.4]), part(0.0, 0.35, [0.45, 0.05])]);
    let sizes = [Size::of(&arch)];
    let prop = Prop::new(Model::new("arch", arch));
    let shape = Shape::new(&prop, sizes[0], &Params::new(Accuracy::Draft).physics).unwrap();
    let side = 3.0;
    let points = [[-side, -side], [-side, side], [side, side], [side, -side]].map(|[x, z]| DVec3::new(x, 1.0, z));
    let sheet = TriMesh { points: points.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]] };
    let still = StaticModel { model: Model::new("sheet", sheet), friction: 0.5, keys: Vec::new() };
    let mesh = block(DVec3::new(-2.0, 0.0, -2.0), DVec3::new(2.0, 4.0, 2.0), 2);
    let scene = Scene { props: vec![prop], statics: vec![still], ..Scene::default() };
    let surroundings = Surroundings::new(&scene, &mesh, Some(0.0)).unwrap();
    let container = container(&mesh, 0.0).apart_from(surroundings, &scene, &sizes);
    let reaches = |height: f64, turn: f64| {
        let pose = Pose { translation: DVec3::new(0.3, height, 0.2), rotation: DQuat::from_rotation_x(turn) };
        container.pierced(&shape, 1.0, &shape.body_pose(&pose, 1.0)).map(|(piece, depth)| {
            assert_eq!(piece, 0);
            depth
        })
    };
    assert_eq!([reaches(1.42, 0.0), reaches(0.58, 0.0), reaches(1.055, 1.57)], [None; 3], "above, below, lying beside");
    let near = |found: Option<f64>, depth: f64| found.is_some_and(|found| (found - depth).abs() < 0.05);
    assert!(near(reaches(1.2, 0.0), 0.2), "{:?}", reaches(1.2, 0.0));
    assert!(near(reaches(0.65, 0.0), 0.05), "{:?}", reaches(0.65, 0.0));
}
