//! The world: props lie flat, and nails start without strain, carry and break.

use super::common::{cone, disc, scene, stick};
use cairn_engine::shape::{Shape, ShapeKind, Size, Solid, hull_mesh};
use cairn_engine::world::{ContactPair, ContactPoint, Insertion, PairSide, ReservedPlaces, Units, World};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::params::{Accuracy, Params};
use glam::{DQuat, DVec3};

/// A prop, the ground, and the prop's thickness in engine units.
fn world_of(prop: TriMesh) -> (World, Shape, f64) {
    let scene = scene(cone(1.0, 1.0), prop);
    let mut params = Params::new(Accuracy::Standard);
    // The shape is the mesh itself, without a skin: gaps are known exactly.
    params.physics.shape_gap = 0.0;
    let size = Size::of(&scene.props[0].model.mesh);
    let shape = Shape::new(&scene.props[0], size, &params.physics).unwrap();
    let units = Units::new(size.diameter, shape.mass, params.gravity);
    let thickness = size.extents.x / units.length;
    let mut world = World::new(units, &params.physics, thickness, shape.solid.parts() > 1);
    world.add_ground(0.0, 0.7);
    (world, shape, thickness)
}

/// Sticks lying on top of each other, each turned, on the ground; engine units.
fn stack(count: usize) -> World {
    let (mut world, shape, thickness) = world_of(stick());
    for k in 0..count {
        let pose = Pose {
            translation: DVec3::new(0.0, (k as f64 + 0.5) * thickness, 0.0),
            rotation: DQuat::from_rotation_y(1.1 * k as f64),
        };
        world.insert(&shape, &Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 }).unwrap();
    }
    world.zero_step();
    world
}

fn nail_all(world: &mut World) -> usize {
    let pairs = world.contact_pairs(0.05);
    for t in &pairs {
        let other = match t.b {
            PairSide::Body(b) => Some(b),
            _ => None,
        };
        world.drive_nail(t.a, other, t.points[0].point, t.points[0].normal);
    }
    pairs.len()
}

/// Contact pairs of bodies that stay where they are can be taken from before: the answer is the same.
#[test]
fn bodies_that_have_not_moved_have_the_same_contact_pairs() {
    let mut world = stack(12);
    let before = world.contact_pairs(0.05);
    assert!(before.len() >= 12);
    let moved = 5;
    let pose = world.pose(moved);
    world.put(moved, &Pose { translation: pose.translation + DVec3::new(0.3, 0.0, 0.0), ..pose });
    world.zero_step();
    let still: Vec<bool> = (0..12).map(|id| id != moved).collect();
    let summary = |pairs: Vec<ContactPair>| pairs.iter().map(|t| (t.a, t.b, t.points.len())).collect::<Vec<_>>();
    assert_eq!(summary(world.contact_pairs_since(0.05, &before, &still)), summary(world.contact_pairs(0.05)));
    // Nothing is computed where nothing has moved: the pairs that are handed in come back.
    let all = vec![true; 12];
    let strange: Vec<ContactPair> = before.into_iter().take(3).collect();
    assert_eq!(summary(world.contact_pairs_since(0.05, &strange, &all)), summary(strange));
}

#[test]
fn no_point_of_a_body_moves_farther_than_the_bound() {
    let (a, b) = (DQuat::from_rotation_x(0.4), DQuat::from_rotation_z(-2.9) * DQuat::from_rotation_y(0.7));
    let at = |translation: DVec3, rotation: DQuat| Pose { translation, rotation };
    for (from, to) in [(a, b), (a, a), (b, -a), (DQuat::IDENTITY, b)] {
        let (from, to) = (at(DVec3::new(1.0, 2.0, 3.0), from), at(DVec3::new(1.1, 1.8, 3.0), to));
        let bound = from.moved(&to, 2.0);
        let displacement = |p: DVec3| from.transform_point(p).distance(to.transform_point(p));
        let farthest = (0..500).map(|i| {
            let (u, v) = (f64::from(i) * 2.399963, 1.0 - f64::from(i) / 250.0);
            let out = (1.0 - v * v).max(0.0).sqrt();
            displacement(2.0 * DVec3::new(out * u.cos(), v, out * u.sin()))
        });
        let farthest = farthest.fold(0.0, f64::max);
        assert!(farthest <= bound + 1e-12 && bound < farthest + 0.5, "{farthest} within {bound}");
    }
}

/// The engine by itself lets a face touch by its first four corners only.
#[test]
fn a_disc_of_many_corners_lies_flat() {
    let (mut world, shape, thickness) = world_of(disc(0.2, 0.04));
    assert_eq!(shape.report.kind, ShapeKind::Hull);
    assert!(shape.report.deviation_rel < 0.02, "{}", shape.report.deviation_rel);
    for k in 0..4 {
        let translation = DVec3::new(2.0 * f64::from(k), 0.6, 0.0);
        let rotation = DQuat::from_rotation_z(0.3 * f64::from(k)) * DQuat::from_rotation_x(0.2);
        let pose = Pose { translation, rotation };
        world.insert(&shape, &Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 }).unwrap();
    }
    for _ in 0..400 {
        world.step();
    }
    for id in 0..4 {
        let height = world.pose(id).translation.y;
        assert!((height - thickness / 2.0).abs() < 0.1 * thickness, "disc {id} is at {height}");
        assert_eq!(world.speed(id), 0.0, "disc {id}");
    }
}

/// Discs on top of each other, every second one shifted, by engine units.
fn discs(count: usize, shift: f64) -> (World, f64) {
    let (mut world, shape, thickness) = world_of(disc(0.2, 0.04));
    for k in 0..count {
        let translation = DVec3::new(shift * (k % 2) as f64, (k as f64 + 0.5) * thickness, 0.0);
        let pose = Pose { translation, rotation: DQuat::from_rotation_y(0.4 * k as f64) };
        world.insert(&shape, &Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 }).unwrap();
    }
    world.zero_step();
    (world, thickness)
}

/// The engine sets its tree aside for optimization, and finds nothing meanwhile.
#[test]
fn moving_bodies_are_found_after_every_step() {
    let (mut world, shape, thickness) = world_of(stick());
    for k in 0..32 {
        let translation = DVec3::new(2.0 * f64::from(k), 3.0 * thickness, 0.0);
        let pose = Pose { translation, rotation: DQuat::IDENTITY };
        world.insert(&shape, &Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 }).unwrap();
    }
    for step in 0..60 {
        world.step();
        world.zero_step();
        for id in 0..32 {
            assert!(
                !world.reserve(&shape, 1.0, &world.pose(id), &mut ReservedPlaces::default()),
                "step {step}: body {id} is not found"
            );
        }
    }
}

/// An L of 1 x 1 m, 0.4 m wide.
fn angle_plate(height: f64) -> TriMesh {
    let outline = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.4), (0.4, 0.4), (0.4, 1.0), (0.0, 1.0)];
    let points =
        [-height / 2.0, height / 2.0].iter().flat_map(|&y| outline.map(|(x, z)| DVec3::new(x, y, z))).collect();
    let bottom = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
    let top = bottom.map(|[a, b, c]| [a + 6, c + 6, b + 6]);
    let side = |k: u32| [[k, k + 6, (k + 1) % 6], [(k + 1) % 6, k + 6, (k + 1) % 6 + 6]];
    TriMesh { points, triangles: [bottom, top].concat().into_iter().chain((0..6).flat_map(side)).collect() }
}

/// 80 plates rain down. Share of the final contact pairs that overlap by more than half of the thickness.
fn deep_share(plate: TriMesh) -> f64 {
    let (mut world, shape, thickness) = world_of(plate);
    for k in 0..80 {
        let turn = f64::from(k);
        let translation = DVec3::new(0.6 * (2.0 * turn).sin(), 0.8 + 0.3 * turn, 0.6 * (3.0 * turn).cos());
        let rotation = DQuat::from_rotation_x(0.7 * turn) * DQuat::from_rotation_z(1.9 * turn);
        let pose = Pose { translation, rotation };
        world.insert(&shape, &Insertion { prop: 0, scale: 1.0, pose, friction: 0.5, restitution: 0.0 }).unwrap();
    }
    for _ in 0..800 {
        world.step();
    }
    world.zero_step();
    let pairs = world.contact_pairs(0.0);
    assert!(pairs.len() > 80);
    pairs.iter().filter(|t| t.depth() > 0.5 * thickness).count() as f64 / pairs.len() as f64
}

#[test]
fn plates_of_several_parts_do_not_end_in_one_another() {
    let share = deep_share(angle_plate(0.025));
    // Plates that are swept along their path jam: 0.14.
    assert!(share < 0.08, "{share}");
}

#[test]
fn discs_touch_wherever_they_overlap() {
    for shift in [0.0, 0.3, 0.6, 0.9] {
        let (world, _) = discs(2, shift);
        let pairs = world.contact_pairs(0.05);
        let pair = pairs.iter().find(|t| (t.a, t.b) == (0, PairSide::Body(1))).expect("they touch");
        let spread = |of: fn(&ContactPoint) -> f64| {
            let all = || pair.points.iter().map(of);
            all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min)
        };
        // A lens of two circles, of the diameter that a disc has in engine units.
        let diameter = 1.0 / (1.0f64 + 0.1 * 0.1).sqrt();
        let (wide, long) = (diameter - shift, (diameter.powi(2) - shift.powi(2)).max(0.0).sqrt());
        let found = (spread(|p| p.point.x), spread(|p| p.point.z));
        assert!(found.0.max(found.1) > 0.9 * long, "shift {shift}: {found:?} of {wide} x {long}");
        assert!(found.0.min(found.1) > 0.6 * wide, "shift {shift}: {found:?} of {wide} x {long}");
        assert!(pair.points.iter().all(|p| p.gap.abs() < 1e-4 && p.normal.y.abs() > 0.9999), "{:?}", pair.points);
    }
}

#[test]
fn a_tower_of_shifted_discs_stands() {
    let (mut world, thickness) = discs(8, 0.3);
    for _ in 0..400 {
        world.step();
    }
    for id in 0..8 {
        let pose = world.pose(id);
        assert!((pose.translation.y - (id as f64 + 0.5) * thickness).abs() < 0.1 * thickness, "disc {id}: {pose:?}");
        assert_eq!(world.speed(id), 0.0, "disc {id}");
    }
}

/// Of a slope that the engine takes for flat; also where the two just touch.
#[test]
fn a_plate_lies_on_the_ridge_of_a_gentle_roof() {
    let ridge = 0.02;
    let end = |z: f64| {
        [(-1.0, 0.0), (-1.0, 0.1), (0.0, 0.1 + ridge), (1.0, 0.1), (1.0, 0.0)].map(|(x, y)| DVec3::new(x, y, z))
    };
    let roof = hull_mesh(&[end(-0.5), end(0.5)].concat());
    for (turn, gap) in
        [0.0, 0.1, 0.3, 1.0, 1.5].iter().flat_map(|t| [-1e-3, -1e-6, 0.0, 1e-7, 1e-6, 1e-3].map(|g| (*t, g)))
    {
        let (mut world, shape, thickness) = world_of(roof.clone());
        for k in [0.0, 1.0] {
            let pose =
                Pose { translation: DVec3::Y * (thickness + gap) * k, rotation: DQuat::from_rotation_y(turn * k) };
            let pose = shape.body_pose(&pose, 1.0 / world.units.length);
            world.insert(&shape, &Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 }).unwrap();
        }
        world.zero_step();
        let pairs = world.contact_pairs(0.05);
        let pair = pairs.iter().find(|t| t.b == PairSide::Body(1)).unwrap_or_else(|| panic!("{turn} {gap}: {pairs:?}"));
        // Beside the ridge, the gap grows by its slope.
        let expected = |p: &ContactPoint| gap + p.point.x.abs() * ridge;
        for p in &pair.points {
            assert!((p.gap - expected(p)).abs() < 2e-5 && p.normal.y < -0.9999, "{turn} {gap}: {p:?}");
        }
        for end in [-0.5, 0.5] {
            let ends = |p: &&ContactPoint| (p.point - DVec3::Z * end / world.units.length).with_y(0.0).length() < 1e-3;
            assert!(pair.points.iter().any(|p| ends(&p)), "{turn} {gap}: {:?}", pair.points);
        }
    }
}

/// A stone: the hull of points spread over an ellipsoid.
fn stone() -> TriMesh {
    let spread = |k: u32| {
        let (y, turn) = (1.0 - (f64::from(k) + 0.5) / 20.0, 2.399963 * f64::from(k));
        DVec3::new(0.3 * (1.0 - y * y).sqrt() * turn.cos(), 0.1 * y, 0.2 * (1.0 - y * y).sqrt() * turn.sin())
    };
    hull_mesh(&(0..40).map(spread).collect::<Vec<_>>())
}

/// The lowest corner carries, whatever face it is of.
#[test]
fn a_tilted_stone_touches_the_ground_by_its_lowest_corner() {
    for k in 0..200 {
        let (mut world, shape, _) = world_of(stone());
        let Solid::Convex(parts) = &shape.solid else { panic!("a stone is a hull") };
        let rotation = DQuat::from_rotation_x(0.37 * f64::from(k)) * DQuat::from_rotation_z(0.73 * f64::from(k));
        let height = |p: &DVec3| (rotation * *p).y / world.units.length;
        let lowest = parts.iter().flatten().map(height).fold(f64::INFINITY, f64::min);
        let pose = Pose { translation: DVec3::new(0.0, -lowest, 0.0), rotation };
        world.insert(&shape, &Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 }).unwrap();
        world.zero_step();
        let pairs = world.contact_pairs(0.05);
        let nearest = pairs.iter().flat_map(|t| &t.points).map(|p| p.gap).fold(f64::INFINITY, f64::min);
        assert!(nearest.abs() < 1e-5, "orientation {k}: nearest at {nearest}");
    }
}

/// Moves a lying disc by hand, for so many characteristic times, and counts how often it was seen to move on the spot.
fn moved_by_hand(times: f64, displacement: impl Fn(f64) -> f64) -> u64 {
    let (mut world, shape, thickness) = world_of(disc(0.2, 0.04));
    let place = |x: f64| Pose { translation: DVec3::new(x, thickness / 2.0, 0.0), rotation: DQuat::IDENTITY };
    let body = Insertion { prop: 0, scale: 1.0, pose: place(0.0), friction: 0.7, restitution: 0.0 };
    let id = world.insert(&shape, &body).unwrap();
    let step = world.step_length();
    for k in 0..(times / step) as u32 {
        world.put(id, &place(displacement(f64::from(k) * step)));
        world.step();
    }
    world.counters.rocking_looks
}

#[test]
fn rocking_is_distinguished_from_creep() {
    let rocking = |t: f64| 0.006 * (3.0 * t).sin();
    assert_eq!(moved_by_hand(20.0, rocking), 0, "too early to decide");
    assert!(moved_by_hand(60.0, rocking) > 0);
    assert_eq!(moved_by_hand(60.0, |t| 0.0016 * t), 0, "a creeping body gets somewhere");
}

#[test]
fn nails_in_a_stack_at_rest_disturb_nothing() {
    let mut world = stack(4);
    for _ in 0..40 {
        world.step();
    }
    for cycle in 0..10 {
        world.pull_all_nails();
        assert_eq!(nail_all(&mut world), 4, "cycle {cycle}");
        for step in 0..5 {
            world.step();
            let fastest = world.present().map(|id| world.speed(id)).fold(0.0, f64::max);
            assert!(fastest < 0.01, "cycle {cycle}, step {step}: {fastest}");
        }
    }
}

#[test]
fn a_nail_carries_a_hanging_body_and_breaks_beyond_its_limit() {
    let mut world = stack(2);
    for _ in 0..20 {
        world.step();
    }
    nail_all(&mut world);
    world.set_gravity(DVec3::Y);
    for _ in 0..20 {
        world.step();
        assert_eq!(world.break_nails(122.0).0, 0, "two sticks weigh less than the limit");
    }
    assert!(world.speed(1) < 0.2, "the nails hold against upward gravity: {}", world.speed(1));
    let (broken, _) = world.break_nails(1e-3);
    assert!(broken > 0, "hanging sticks pull harder than a thousandth of their weight");
}
