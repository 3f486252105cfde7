//! Contacts of convex polyhedra against a reference in double precision: all faces, all pairs of edges, no bounds.

use super::{Manifolds, REPORTED};
use crate::shape::Hull;
use glam::{DMat3, DVec3, Quat};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rapier3d::math::{Pose, Vector};
use rapier3d::parry::query::{ContactManifold, PersistentQueryDispatcher};
use rapier3d::parry::shape::{Cuboid, Shape, SharedShape, Triangle};

/// Contacts are looked for up to this gap.
const PREDICTION: f32 = 0.05;
/// A direction may be this much worse than the best one: see `EDGE_IS_BETTER`, and single precision.
const CLOSE: f64 = 3e-4;

fn direction(rng: &mut Pcg64Mcg) -> Vector {
    loop {
        let p = Vector::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        if (0.01..1.0).contains(&p.length_squared()) {
            return p.normalize();
        }
    }
}

/// Points of a body: round, a needle, a plate, a box with all its corners cut off, or one of few corners.
fn points(kind: u32, rng: &mut Pcg64Mcg) -> Vec<Vector> {
    let (count, shape) = match kind % 5 {
        0 => (48, Vector::new(0.5, 0.4, 0.3)),
        1 => (20, Vector::new(0.5, 0.04, 0.03)),
        2 => (24, Vector::new(0.5, 0.4, 0.01)),
        3 => (30, Vector::splat(0.5)),
        _ => (5, Vector::new(0.5, 0.3, 0.4)),
    };
    let of = |_| {
        let p = direction(rng);
        let p = if kind % 5 == 3 { (p * 3.0).clamp(Vector::splat(-1.0), Vector::ONE) } else { p };
        p * shape
    };
    (0..count).map(of).collect()
}

/// A polyhedron in double precision, in the frame of the first shape.
struct Exact {
    corners: Vec<DVec3>,
    normals: Vec<DVec3>,
    edges: Vec<DVec3>,
}

impl Exact {
    fn new(hull: &Hull, pose: &Pose) -> Exact {
        let turn = DMat3::from_quat(pose.rotation.as_dquat());
        let at = |p: Vector| turn * p.as_dvec3() + pose.translation.as_dvec3();
        Exact {
            corners: hull.points().iter().map(|&p| at(p)).collect(),
            normals: hull.facets().iter().map(|f| (turn * f.normal.as_dvec3()).normalize()).collect(),
            edges: hull
                .edges()
                .iter()
                .map(|e| at(hull.points()[e.corners[1] as usize]) - at(hull.points()[e.corners[0] as usize]))
                .collect(),
        }
    }

    fn top(&self, direction: DVec3) -> f64 {
        self.corners.iter().map(|p| p.dot(direction)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// How far a point is outside of the planes of the faces.
    fn outside(&self, p: DVec3) -> f64 {
        self.normals.iter().map(|&n| p.dot(n) - self.top(n)).fold(f64::NEG_INFINITY, f64::max)
    }
}

fn distance_along(a: &Exact, b: &Exact, direction: DVec3) -> f64 {
    -b.top(-direction) - a.top(direction)
}

/// Along the best of all candidates.
fn separation(a: &Exact, b: &Exact) -> f64 {
    let faces = a.normals.iter().copied().chain(b.normals.iter().map(|n| -*n));
    let across = a.edges.iter().flat_map(|e| b.edges.iter().filter_map(|f| e.cross(*f).try_normalize()));
    let edges = across.flat_map(|n| [n, -n]);
    faces.chain(edges).map(|n| distance_along(a, b, n)).fold(f64::NEG_INFINITY, f64::max)
}

fn contact(pose: &Pose, a: &dyn Shape, b: &dyn Shape, manifold: &mut ContactManifold<(), ()>) {
    let dispatcher = Manifolds::new(REPORTED);
    dispatcher.contact_manifold_convex_convex(pose, a, b, None, None, PREDICTION, manifold).expect("it is supported");
}

/// Random pairs at random gaps: a third apart, a third near, a third overlapping.
fn pairs(count: u32, mut check: impl FnMut([&Hull; 2], &Pose, f64, &mut Pcg64Mcg)) {
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    for k in 0..count {
        let hulls = [points(k, &mut rng), points(k / 5, &mut rng)].map(|points| Hull::new(&points));
        let [Some(a), Some(b)] = &hulls else { continue };
        let rotation = Quat::from_axis_angle(direction(&mut rng), rng.random_range(0.0..3.0));
        let way = direction(&mut rng);
        let wanted = match k % 3 {
            0 => rng.random_range(0.06..0.3),
            1 => rng.random_range(-0.002..0.04),
            _ => rng.random_range(-0.05..-0.002),
        };
        let at = |t: f32| Pose::from_parts(way * t, rotation);
        let first = Exact::new(a, &Pose::IDENTITY);
        let (mut near, mut far) = (0.0, 3.0);
        for _ in 0..14 {
            let middle = (near + far) / 2.0;
            if separation(&first, &Exact::new(b, &at(middle))) > wanted { far = middle } else { near = middle }
        }
        let pose = at(far);
        let exact = separation(&first, &Exact::new(b, &pose));
        check([a, b], &pose, exact, &mut rng);
    }
}

#[test]
fn normals_and_depths_are_the_best_of_all_candidates() {
    pairs(150, |[a, b], pose, exact, rng| {
        let (first, second) = (Exact::new(a, &Pose::IDENTITY), Exact::new(b, pose));
        // From nothing, and from a wrong direction.
        for guess in [Vector::ZERO, direction(rng)] {
            let mut manifold = ContactManifold::<(), ()> { local_n1: guess, ..ContactManifold::new() };
            contact(pose, a, b, &mut manifold);
            if exact > f64::from(PREDICTION) + CLOSE {
                assert!(manifold.points.is_empty(), "{exact}");
                continue;
            }
            let normal = manifold.local_n1.as_dvec3();
            assert!((normal.length() - 1.0).abs() < 1e-5);
            let found = distance_along(&first, &second, normal);
            assert!(found >= exact - CLOSE, "{found} along {normal}, and {exact} is possible");
            for c in &manifold.points {
                let (p, q) = (c.local_p1.as_dvec3(), pose.transform_point(c.local_p2).as_dvec3());
                assert!(first.outside(p) < 1e-4 && second.outside(q) < 1e-4, "on both surfaces");
                assert!((q - p).cross(normal).length() < 1e-4, "opposite each other along the normal");
                assert!(((q - p).dot(normal) - f64::from(c.dist)).abs() < 1e-4);
            }
            if exact < 0.0 {
                let deepest = manifold.points.iter().map(|c| f64::from(c.dist)).fold(f64::INFINITY, f64::min);
                assert!((deepest - found).abs() < 2e-4, "deepest {deepest} of {found}");
            }
        }
    });
}

#[test]
fn what_turns_round_is_the_same_contact() {
    pairs(60, |[a, b], pose, exact, _| {
        let (mut one, mut other) = (ContactManifold::<(), ()>::new(), ContactManifold::<(), ()>::new());
        contact(pose, a, b, &mut one);
        contact(&pose.inverse(), b, a, &mut other);
        let deepest = |m: &ContactManifold<(), ()>| m.points.iter().map(|c| c.dist).fold(f32::INFINITY, f32::min);
        if exact < 0.0 {
            assert!((deepest(&one) - deepest(&other)).abs() < 6e-4, "{} {}", deepest(&one), deepest(&other));
        }
    });
}

/// A stone on a box, on a triangle of a mesh, and on itself: heights by hand.
#[test]
fn boxes_and_triangles_are_polyhedra_too() {
    let cut = |x: f32, y: f32, z: f32| Vector::new(x, y, z);
    let block: Vec<Vector> = (0..8)
        .flat_map(|k| {
            let s = |bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let (x, y, z) = (s(0), s(1), s(2));
            [cut(0.3 * x, 0.2 * y, 0.25 * z), cut(0.25 * x, 0.2 * y, 0.3 * z)]
        })
        .collect();
    let block = Hull::new(&block).expect("a block");
    let table = Cuboid::new(Vector::new(2.0, 0.5, 2.0));
    let face = Triangle::new(Vector::new(-5.0, 0.5, -5.0), Vector::new(0.0, 0.5, 8.0), Vector::new(5.0, 0.5, -5.0));
    for gap in [-0.01f32, 0.0, 0.004] {
        for below in [&table as &dyn Shape, &face] {
            let mut manifold = ContactManifold::<(), ()>::new();
            contact(&Pose::from_translation(Vector::new(0.1, 0.7 + gap, -0.2)), below, &block, &mut manifold);
            assert!((manifold.local_n1 - Vector::Y).length() < 1e-5, "{}", manifold.local_n1);
            assert!(manifold.points.len() >= 4 && manifold.points.iter().all(|c| (c.dist - gap).abs() < 1e-5));
            let across = manifold.points.iter().map(|c| c.local_p2.x).fold(f32::NEG_INFINITY, f32::max)
                - manifold.points.iter().map(|c| c.local_p2.x).fold(f32::INFINITY, f32::min);
            assert!(across > 0.59, "the whole face: {across}");
        }
    }
}

/// Two shapes move past each other; what is skipped is what a fresh look finds empty.
#[test]
fn parts_that_are_skipped_are_apart() {
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    let several = |rng: &mut Pcg64Mcg| {
        let part = |k: u32, rng: &mut Pcg64Mcg| {
            let shift = Vector::new(0.3 * k as f32, 0.1 * (k * k) as f32, 0.0);
            let moved: Vec<Vector> = points(0, rng).into_iter().map(|p| p * 0.4 + shift).collect();
            (Pose::IDENTITY, SharedShape::new(Hull::new(&moved).expect("a hull")))
        };
        SharedShape::compound((0..4).map(|k| part(k, rng)).collect())
    };
    let dispatcher = Manifolds::new(REPORTED);
    for _ in 0..12 {
        let (a, b) = (several(&mut rng), several(&mut rng));
        let (start, way, axis) = (direction(&mut rng) * 1.6, direction(&mut rng), direction(&mut rng));
        let (mut manifolds, mut memory) = (Vec::<ContactManifold<(), ()>>::new(), None);
        for step in 0..120 {
            let t = step as f32;
            let place = start * (1.0 - t / 60.0) + way * 0.002 * t;
            let pose = Pose::from_parts(place, Quat::from_axis_angle(axis, 0.02 * t));
            dispatcher.contact_manifolds(&pose, &*a, &*b, PREDICTION, &mut manifolds, &mut memory).expect("supported");
            let (mut fresh, mut nothing) = (Vec::<ContactManifold<(), ()>>::new(), None);
            dispatcher.contact_manifolds(&pose, &*a, &*b, PREDICTION, &mut fresh, &mut nothing).expect("supported");
            let touching = |all: &[ContactManifold<(), ()>]| {
                let in_contact = all.iter().filter(|m| m.points.iter().any(|c| c.dist < PREDICTION - 0.01));
                in_contact.map(|m| [m.subshape1, m.subshape2]).collect::<Vec<_>>()
            };
            let (now, then) = (touching(&manifolds), touching(&fresh));
            // Where two directions are as good, memory may choose the other one.
            assert!(then.iter().filter(|pair| !now.contains(pair)).count() <= then.len() / 8, "{now:?} {then:?}");
        }
    }
}

/// The engine sets such bodies aside after its step; until then, a look at them must end.
#[test]
fn places_that_are_no_numbers_end_the_look() {
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let [a, b] = [points(0, &mut rng), points(3, &mut rng)].map(|points| Hull::new(&points).expect("a hull"));
    let huge = Vector::splat(f32::MAX);
    for translation in [Vector::NAN, Vector::INFINITY, huge] {
        for rotation in [Quat::IDENTITY, Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0)] {
            let pose = Pose::from_parts(translation, rotation);
            contact(&pose, &a, &b, &mut ContactManifold::new());
            let several = SharedShape::compound(vec![(Pose::IDENTITY, SharedShape::new(a.clone()))]);
            let (mut manifolds, mut memory) = (Vec::<ContactManifold<(), ()>>::new(), None);
            for _ in 0..3 {
                let dispatcher = Manifolds::new(REPORTED);
                dispatcher
                    .contact_manifolds(&pose, &*several, &b, PREDICTION, &mut manifolds, &mut memory)
                    .expect("it ends");
            }
        }
    }
}
