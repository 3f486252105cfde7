//! Entrances of small piles: they end at the pile that the bake delivers without one, fall as bodies fall, and cut
//! nothing. All is computed again from the frames.

use super::common::{block, cone, scene, stick};
use cairn_core::Error;
use cairn_core::bake;
use cairn_core::report::bake::{Bake, BakedPile};
use cairn_geometry::crossing::Surface;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, EntranceKind, EntranceOrder, Params};
use cairn_input::scene::{Emitter, EmitterVolume, Model, PlacedBody, Prop, Scene};
use glam::{DAffine3, DVec3};

fn params(kind: EntranceKind) -> Params {
    let mut params = Params::new(Accuracy::Draft);
    (params.entrance.kind, params.entrance.duration) = (kind, 2.0);
    params.output.fps = 48.0;
    params
}

/// A wall of 20 bricks, in bond, five courses high.
fn wall() -> Scene {
    let mut bodies = Vec::new();
    for course in 0..5 {
        let shift = if course % 2 == 0 { 0.0 } else { 0.21 };
        bodies.extend((0..4).map(|k| {
            let place = DVec3::new(shift + 0.42 * f64::from(k), 0.1 + 0.2 * f64::from(course), 0.0);
            PlacedBody::new(0, Pose { translation: place, ..Pose::IDENTITY })
        }));
    }
    let prop = Prop::new(Model::new("brick", block(DVec3::new(0.4, 0.2, 0.2))));
    cairn_engine::invariants::check_always();
    Scene { props: vec![prop], bodies, ..Scene::default() }
}

fn sticks() -> Scene {
    scene(cone(0.45, 0.6), stick())
}

/// What the frames show: triples of frames in which a body in the air does not fall as gravity makes it fall, and all
/// that were looked at.
fn falls(pile: &BakedPile) -> (usize, usize, f64) {
    let (mut touched, mut all, mut worst) = (0, 0, 0.0f64);
    for (id, body) in pile.bodies.iter().enumerate() {
        let center = pile.solids[body.prop].center * body.scale;
        let at = |frame: usize| pile.frames[frame][id].transform_point(center);
        let end = at(pile.frames.len() - 1);
        let mut own = 0;
        for frame in body.first_frame + 1..pile.frames.len() - 1 {
            if at(frame + 1) == end {
                break;
            }
            let bend = (at(frame - 1) + at(frame + 1) - 2.0 * at(frame)) * pile.fps * pile.fps / pile.world.gravity;
            let error = (bend + DVec3::Y).length();
            all += 1;
            // Where it touches something it is slowed down: in the two triples around that moment.
            if error > 0.01 {
                assert!(bend.y > -1.0, "body {id}, frame {frame}: it is pushed down: {bend}");
                own += 1;
            } else {
                worst = worst.max(error);
            }
        }
        assert!(own <= 2, "body {id} is touched in {own} triples of frames");
        touched += own;
    }
    (touched, all, worst)
}

/// Pairs of bodies, with their frames, that cut each other by more than in the last frame and a fiftieth of their
/// thickness: blocks that are smaller by that still cross. `size`: of the block.
fn cuts(pile: &BakedPile, size: DVec3) -> Vec<(usize, usize, usize)> {
    let (whole, last) = (Surface::new(&block(size)), pile.frames.len() - 1);
    let between = |frame: usize, i: usize, j: usize| {
        let pose = |id: usize| pile.frames[frame][id];
        let map = |pose: Pose| DAffine3::from_rotation_translation(pose.rotation, pose.translation);
        map(pose(i)).inverse() * map(pose(j))
    };
    let mut found = Vec::new();
    for i in 0..pile.bodies.len() {
        for j in 0..i {
            let depth = whole.overlap(&whole, &between(last, i, j)).map_or(0.0, |found| found.depth);
            let smaller = Surface::new(&block(size - (depth + 0.02 * size.min_element())));
            let from = pile.bodies[i].first_frame.max(pile.bodies[j].first_frame);
            for frame in from..last {
                let [a, b] = [i, j].map(|id| pile.frames[frame][id]);
                let moves = a != pile.frames[last][i] || b != pile.frames[last][j];
                let is_near = a.translation.distance(b.translation) < size.length();
                if moves && is_near && smaller.crosses(&smaller, &between(frame, i, j)) {
                    found.push((i, j, frame));
                }
            }
        }
    }
    found
}

fn figure(bake: &Bake, name: &str) -> f64 {
    bake.report.measures[name].unwrap_or_else(|| panic!("{name} is not measured"))
}

#[test]
fn bodies_come_into_the_places_of_the_finished_pile() {
    let (brick, rod) = (DVec3::new(0.4, 0.2, 0.2), DVec3::new(0.5, 0.06, 0.06));
    for (name, scene, size, kind) in [
        ("wall", wall(), brick, EntranceKind::Rain),
        ("stream", wall(), brick, EntranceKind::Pour),
        ("thrown", wall(), brick, EntranceKind::Throw),
        ("sticks", sticks(), rod, EntranceKind::Rain),
    ] {
        let plain = bake(&scene, &params(EntranceKind::None), &mut Silent).unwrap();
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bake(&scene, &params(kind), &mut Silent).unwrap())
        };
        let [entered, again] = [1, 2].map(run);
        assert_eq!(entered.pile.frames, again.pile.frames, "{name}");
        assert_eq!(entered.pile.bodies, again.pile.bodies, "{name}");
        assert!(!plain.report.measures.contains_key("entrance_guided_impulse"));
        assert_eq!(plain.report.counts["entrance_bodies"], 0);

        let pile = &entered.pile;
        assert_eq!(pile.frames.last(), plain.pile.frames.last(), "{name}");
        assert_eq!(entered.report.counts["entrance_bodies"], pile.bodies.len() as u64, "{name}: all come in");
        assert!(pile.bodies.len() >= 20, "{name}: {} bodies", pile.bodies.len());
        assert!(pile.bodies.iter().any(|body| body.first_frame > 0), "{name}: some appear later");
        let landed = |body: usize| pile.frames.iter().position(|f| f[body] == pile.frames[pile.frames.len() - 1][body]);
        let landings: Vec<usize> = (0..pile.bodies.len()).filter_map(landed).collect();
        let (first, last) = (landings.iter().min().unwrap(), landings.iter().max().unwrap());
        assert!((last - first) as f64 / pile.fps > 1.5, "{name}: they land from frame {first} to {last}");
        let (touched, all, worst) = falls(pile);
        let cut = cuts(pile, size);
        println!(
            "{name}: {} frames, {touched} of {all} triples touched, ballistic {worst}, {cut:?}, {:?} {:?}",
            pile.frames.len(),
            entered.report.measures.iter().filter(|(name, _)| name.starts_with("entrance")).collect::<Vec<_>>(),
            entered.report.counts.iter().filter(|(c, _)| c.name().starts_with("entrance")).collect::<Vec<_>>(),
        );
        println!("{:?} {:?}", entered.report.seconds, entered.report.warnings);
        assert!(all > 10 * pile.bodies.len(), "{name}: bodies are seen to fall");
        assert!(worst < 0.01, "{name}: {worst}");
        assert!(cut.is_empty(), "{name}: {cut:?}");
        assert!(figure(&entered, "entrance_ballistic_error_max") < 0.01);
        assert!(figure(&entered, "entrance_cut_max_rel") < 0.02);
        assert!(figure(&entered, "entrance_energy_growth_rel") < 1e-4);
        assert!(figure(&entered, "entrance_guided_impulse") < 0.02);
    }
}

/// Bodies lie around the place of the pile, leap one after another, and end in it.
#[test]
fn bodies_that_lie_about_assemble_into_the_finished_pile() {
    let plain = bake(&wall(), &params(EntranceKind::None), &mut Silent).unwrap();
    let entered = bake(&wall(), &params(EntranceKind::Assemble), &mut Silent).unwrap();
    let pile = &entered.pile;
    assert_eq!(pile.frames.last(), plain.pile.frames.last());
    let (first, last) = (&pile.frames[0], &pile.frames[pile.frames.len() - 1]);
    let low = last.iter().map(|pose| pose.translation).reduce(DVec3::min).unwrap();
    let high = last.iter().map(|pose| pose.translation).reduce(DVec3::max).unwrap();
    let (middle, reach) = ((low + high) / 2.0, (high.x - low.x) / 2.0 + 0.2);
    for (id, pose) in first.iter().enumerate() {
        assert_eq!(pile.bodies[id].first_frame, 0, "body {id} is there from the beginning");
        assert!((pose.translation.y - 0.1).abs() < 0.01, "body {id} lies on the ground: {pose:?}");
        let from_middle = (pose.translation - middle).with_y(0.0).length();
        assert!(from_middle > reach, "body {id} lies beside the pile: {pose:?}");
        let others = first[..id].iter().map(|other| other.translation.distance(pose.translation));
        assert!(others.fold(f64::INFINITY, f64::min) > 0.4, "body {id} lies apart from others");
    }
    // Each frame shows each body lie, fall freely, or stand; it may turn in the air once, in two triples of frames.
    let moves = |id: usize, k: usize| pile.frames[k][id] != first[id] && pile.frames[k][id] != last[id];
    for id in 0..pile.bodies.len() {
        let at = |k: usize| pile.frames[k][id].transform_point(pile.solids[pile.bodies[id].prop].center);
        let flies = (1..pile.frames.len() - 1).filter(|&k| (k - 1..=k + 1).all(|k| moves(id, k)));
        let turns = flies.filter(|&k| {
            let bend = (at(k - 1) + at(k + 1) - 2.0 * at(k)) * pile.fps * pile.fps / pile.world.gravity;
            (bend + DVec3::Y).length() > 0.01
        });
        let turns: Vec<usize> = turns.collect();
        assert!(turns.len() <= 2, "body {id} turns in the air at frames {turns:?}");
    }
    assert!(figure(&entered, "entrance_cut_max_rel") < 0.02);
    assert!(figure(&entered, "entrance_guided_impulse") > 0.5, "what makes it leap is guiding");
    assert!(entered.report.warnings.iter().all(|text| !text.contains("momentum")), "{:?}", entered.report.warnings);
}

#[test]
fn what_does_not_go_with_an_entrance_is_refused_at_once() {
    let mut scene = wall();
    scene.bodies[3].start = 1.0;
    scene.emitters.push(Emitter {
        place: EmitterVolume::Box { center: DVec3::Y, size: DVec3::ONE },
        props: Vec::new(),
        rate: 1.0,
        count: 1,
        velocity: DVec3::ZERO,
        start: 0.0,
    });
    let mut hostile = params(EntranceKind::Rain);
    let entrance = &mut hostile.entrance;
    (entrance.duration, entrance.start, entrance.spread) = (f64::NAN, -1.0, 90.0);
    (entrance.distance, entrance.plausibility) = (f64::INFINITY, 2.0);
    (entrance.source, entrance.curve) = (vec![1.0, 2.0], vec![f64::NAN; 4]);
    hostile.output.frames = Some(10);
    let Err(Error::Invalid(problems)) = bake(&scene, &hostile, &mut Silent) else { panic!("it was baked") };
    let fields: Vec<&str> = problems.iter().map(|problem| &*problem.field).collect();
    for field in [
        "entrance.duration",
        "entrance.start",
        "entrance.spread",
        "entrance.distance",
        "entrance.plausibility",
        "entrance.source",
        "entrance.curve",
        "bodies.3",
        "emitters",
        "output.frames",
    ] {
        assert!(fields.contains(&field), "{field}: {fields:?}");
    }
    let mut long = params(EntranceKind::Rain);
    (long.entrance.duration, long.output.fps) = (100.0, 1000.0);
    long.entrance.start = 100.0;
    let Err(Error::Invalid(problems)) = bake(&wall(), &long, &mut Silent) else { panic!("it was baked") };
    assert_eq!(problems[0].field, "entrance.duration");
}

/// The order is obeyed as far as what carries others allows it.
#[test]
fn bodies_land_in_the_order_that_is_asked_for() {
    let mut scene = wall();
    scene.bodies.truncate(4);
    let mut along = params(EntranceKind::Rain);
    along.entrance.order = EntranceOrder::Along;
    let pile = bake(&scene, &along, &mut Silent).unwrap().pile;
    let landed = |body: usize| pile.frames.iter().position(|f| f[body] == pile.frames[pile.frames.len() - 1][body]);
    let landings: Vec<Option<usize>> = (0..4).map(landed).collect();
    assert!(landings.is_sorted() && landings[0] < landings[3], "{landings:?}");
}

/// From the right to the left, and all from one place beside the wall.
#[test]
fn bodies_follow_a_line_and_come_from_a_place() {
    let mut scene = wall();
    scene.bodies.truncate(4);
    let mut given = params(EntranceKind::Pour);
    given.entrance.order = EntranceOrder::Along;
    given.entrance.curve = vec![2.0, 0.1, 0.0, -1.0, 0.1, 0.0];
    given.entrance.spread = 1.0;
    let source = DVec3::new(0.5, 1.2, -1.0);
    given.entrance.source = source.to_array().to_vec();
    let pile = bake(&scene, &given, &mut Silent).unwrap().pile;
    let landed = |body: usize| pile.frames.iter().position(|f| f[body] == pile.frames[pile.frames.len() - 1][body]);
    let landings: Vec<Option<usize>> = (0..4).rev().map(landed).collect();
    assert!(landings.is_sorted() && landings[0] < landings[3], "{landings:?}");
    for (id, body) in pile.bodies.iter().enumerate() {
        let first = pile.frames[body.first_frame][id].translation;
        // A frame may begin a little later than the flight does.
        assert!(first.distance(source) < 0.15, "{id} appears at {first}");
    }
}
