//! Contacts of pairs of hulls, beside the engine's own: `cargo bench --package cairn-benches --bench pairs`. README.md
//! beside this file describes the rows.

use anyhow::{Context, Result};
use cairn_engine::shape::Hull;
use cairn_engine::world::{Manifolds, SOLVED};
use glam::{Quat, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rapier3d::math::Pose;
use rapier3d::parry::query::{ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher};
use rapier3d::parry::shape::{ConvexPolyhedron, Shape};
use std::hint::black_box;
use std::time::{Duration, Instant};

const PAIRS: usize = 400;
const BODIES: usize = 4;
const ROUNDS: usize = 25;
/// Up to which gap contacts are looked for, in sizes of a hull.
const PREDICTION: f32 = 0.02;
/// Gap of the pairs of each row.
const ROWS: [(&str, [f32; 2]); 4] =
    [("apart", [0.03, 0.1]), ("near", [0.002, 0.015]), ("touching", [-0.002, 0.002]), ("deep", [-0.1, -0.03])];
/// From step to step, a pair moves by so much.
const MOTION: f32 = 0.004;

/// A hull of exactly so many corners, about 1 in size.
fn hull(corners: usize, rng: &mut Pcg64Mcg) -> Vec<Vec3> {
    let shape = Vec3::new(rng.random_range(0.5..1.0), rng.random_range(0.3..1.0), rng.random_range(0.3..1.0)) * 0.5;
    (0..corners).map(|_| direction(rng) * shape).collect()
}

fn direction(rng: &mut Pcg64Mcg) -> Vec3 {
    loop {
        let p = Vec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        if p.length_squared() < 1.0 && p.length_squared() > 0.01 {
            return p.normalize();
        }
    }
}

/// A body, as both engines have it.
struct Body {
    own: Hull,
    engines: ConvexPolyhedron,
}

impl Body {
    fn new(corners: usize, rng: &mut Pcg64Mcg) -> Result<Body> {
        let points = hull(corners, rng);
        let engines = ConvexPolyhedron::from_convex_hull(&points).context("a polyhedron")?;
        Ok(Body { own: Hull::new(&points).context("a hull")?, engines })
    }
}

struct Pair<'b> {
    bodies: [&'b Body; 2],
    pose: Pose,
    /// The same a step earlier.
    before: Pose,
}

fn pair<'b>(bodies: [&'b Body; 2], gap: [f32; 2], rng: &mut Pcg64Mcg) -> Result<Pair<'b>> {
    let turn = |rng: &mut Pcg64Mcg| Quat::from_axis_angle(direction(rng), rng.random_range(0.0..3.0));
    let (rotation, way) = (turn(rng), direction(rng));
    let engines = bodies.map(|body| &body.engines);
    let wanted = rng.random_range(gap[0]..gap[1]);
    // The engine's own distance grows along the way.
    let (mut near, mut far) = (0.0f32, 3.0f32);
    let at = |t: f32| Pose::from_parts(way * t, rotation);
    for _ in 0..40 {
        let middle = (near + far) / 2.0;
        let contact = rapier3d::parry::query::contact(&Pose::IDENTITY, engines[0], &at(middle), engines[1], 5.0)?;
        if contact.is_none_or(|c| c.dist > wanted) { far = middle } else { near = middle }
    }
    let pose = at(far);
    let before =
        Pose::from_parts(pose.translation + direction(rng) * MOTION, turn(rng).slerp(Quat::IDENTITY, 0.997) * rotation);
    Ok(Pair { bodies, pose, before })
}

/// Nanoseconds a call, by the least round.
fn time<'p>(
    pairs: &'p [Pair<'p>],
    remembers: bool,
    dispatcher: &dyn PersistentQueryDispatcher<(), ()>,
    shapes: impl Fn(&'p Pair<'p>) -> [&'p dyn Shape; 2],
) -> (f64, f64) {
    let (mut least, mut points) = (Duration::MAX, 0);
    for _ in 0..ROUNDS {
        let mut manifolds: Vec<ContactManifold<(), ()>> = pairs.iter().map(|_| ContactManifold::new()).collect();
        let run = |manifolds: &mut [ContactManifold<(), ()>], earlier: bool| {
            for (pair, manifold) in pairs.iter().zip(manifolds) {
                let [a, b] = shapes(pair);
                let pose = if earlier { &pair.before } else { &pair.pose };
                let _ = dispatcher.contact_manifold_convex_convex(pose, a, b, None, None, PREDICTION, manifold);
            }
        };
        if remembers {
            run(&mut manifolds, true);
        }
        let begin = Instant::now();
        run(black_box(&mut manifolds), false);
        least = least.min(begin.elapsed());
        points = manifolds.iter().map(|m| m.points.len()).sum();
    }
    (least.as_nanos() as f64 / pairs.len() as f64, points as f64 / pairs.len() as f64)
}

fn main() -> Result<()> {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    println!("| corners | row | memory | ours, ns | engine's, ns | ratio | points | engine's |");
    println!("| ---: | --- | --- | ---: | ---: | ---: | ---: | ---: |");
    for corners in [12, 24, 40] {
        // Few, as a pile has few props.
        let bodies: Vec<Body> = (0..BODIES).map(|_| Body::new(corners, &mut rng)).collect::<Result<_>>()?;
        for (name, gap) in ROWS {
            let of = |k: usize, rng: &mut Pcg64Mcg| pair([&bodies[k % BODIES], &bodies[k / BODIES % BODIES]], gap, rng);
            let pairs: Vec<Pair> = (0..PAIRS).map(|k| of(k, &mut rng)).collect::<Result<_>>()?;
            for (remembers, memory) in [(false, "none"), (true, "a step before")] {
                let (own, points) =
                    time(&pairs, remembers, &Manifolds::new(SOLVED), |p| p.bodies.map(|b| &b.own as &dyn Shape));
                let (engines, theirs) =
                    time(&pairs, remembers, &DefaultQueryDispatcher, |p| p.bodies.map(|b| &b.engines as &dyn Shape));
                let times = format!("{own:.0} | {engines:.0} | {:.2}", own / engines);
                println!("| {corners} | {name} | {memory} | {times} | {points:.1} | {theirs:.1} |");
            }
        }
    }
    Ok(())
}
