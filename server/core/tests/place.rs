//! Piles among scenery: nothing lies in it, and what carries a pile is known. Long: each kind of scenery has its own
//! scene.

use super::common::{block, scene};
use cairn_core::report::bake::Bake;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, FillMethod, GlueMode, Params, Switch};
use cairn_input::scene::Model;
use cairn_input::scene::{Keyframe, Prop, Scene, StaticModel};
use cairn_prepare::check::{self, CheckedScene};
use cairn_prepare::inside::inside;
use glam::{DQuat, DVec3};

const ANGLES: u32 = 24;

fn at(mesh: TriMesh, place: DVec3) -> TriMesh {
    TriMesh { points: mesh.points.iter().map(|&p| p + place).collect(), ..mesh }
}

/// A square sheet about the y axis at this height, facing up.
fn sheet(half: f64, y: f64) -> TriMesh {
    let corner = |[x, z]: [f64; 2]| DVec3::new(x * half, y, z * half);
    let points = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner).to_vec();
    TriMesh { points, triangles: vec![[0, 2, 1], [0, 3, 2]] }
}

/// A round wall without thickness and, where it has a bottom, that of a bowl.
fn ring(radius: f64, low: f64, high: f64, has_bottom: bool) -> TriMesh {
    let angle = |k: u32| f64::from(k % ANGLES) / f64::from(ANGLES) * std::f64::consts::TAU;
    let rim = |y: f64| (0..ANGLES).map(move |k| DVec3::new(radius * angle(k).cos(), y, radius * angle(k).sin()));
    let points = rim(low).chain(rim(high)).chain([DVec3::Y * low]).collect();
    let wall = |k: u32| {
        let (a, b) = (k, (k + 1) % ANGLES);
        [[a, a + ANGLES, b], [b, a + ANGLES, b + ANGLES]]
    };
    let bottom = (0..ANGLES).filter(|_| has_bottom).map(|k| [k, (k + 1) % ANGLES, 2 * ANGLES]);
    TriMesh { points, triangles: (0..ANGLES).flat_map(wall).chain(bottom).collect() }
}

fn piece(name: &str, mesh: TriMesh) -> StaticModel {
    StaticModel { model: Model::new(name, mesh), friction: 0.7, keys: Vec::new() }
}

/// Bricks in a box of 0.6 x 0.5 x 0.6 m on the ground, with this scenery.
fn bricks(statics: Vec<StaticModel>) -> Scene {
    let shape = at(block(DVec3::new(0.6, 0.5, 0.6)), DVec3::Y * 0.25);
    let brick = block(DVec3::new(0.16, 0.08, 0.1));
    Scene { statics, ..scene(shape, brick) }
}

fn draft(method: FillMethod) -> Params {
    let mut params = Params::new(Accuracy::Draft);
    params.fill.method = method;
    params
}

fn bake(scene: &Scene, params: &Params) -> Bake {
    cairn_core::bake(scene, params, &mut Silent).unwrap()
}

fn checked(scene: &Scene, params: &Params) -> CheckedScene {
    check::run(scene, params).unwrap()
}

/// The corners of each body in the last frame.
fn corners(scene: &Scene, bake: &Bake) -> Vec<Vec<DVec3>> {
    let frame = bake.pile.frames.last().unwrap();
    let body = |(body, pose): (&cairn_core::report::bake::BakedBody, &Pose)| {
        let points = &scene.props[body.prop].model.mesh.points;
        points.iter().map(|&p| pose.transform_point(p * body.scale)).collect()
    };
    bake.pile.bodies.iter().zip(frame).map(body).collect()
}

/// A tenth of a brick's thickness.
const CUT: f64 = 0.008;

/// What takes the place of bodies, fill by fill: a solid pole, a wall without thickness through the whole shape, and a
/// landscape that the shape is sunk into.
#[test]
fn no_body_lies_in_scenery() {
    let radius = 0.1;
    let pole = at(super::common::disc(radius, 1.0), DVec3::Y * 0.3);
    for method in [FillMethod::Insert, FillMethod::Stack, FillMethod::Pour] {
        let scene = bricks(vec![piece("pole", pole.clone())]);
        let done = bake(&scene, &draft(method));
        for body in corners(&scene, &done) {
            let nearest = body.iter().map(|p| DVec3::new(p.x, 0.0, p.z).length()).fold(f64::INFINITY, f64::min);
            assert!(nearest > radius - CUT, "{method:?}: a corner is {nearest} m from the axis of the pole");
        }
        assert!(done.report.measures["scenery_penetration_max_rel"].is_some_and(|depth| depth < 0.1));
        assert!(done.pile.bodies.len() > 20, "{method:?}: {} bodies", done.pile.bodies.len());
    }

    let wall = TriMesh {
        points: sheet(1.0, 0.0).points.iter().map(|p| DVec3::new(p.y, p.x, p.z)).collect(),
        ..sheet(1.0, 0.0)
    };
    let scene = bricks(vec![piece("wall", wall)]);
    let done = bake(&scene, &draft(FillMethod::Insert));
    let sides = corners(&scene, &done).into_iter().map(|body| {
        let (left, right) = body.iter().fold((0.0, 0.0), |(l, r): (f64, f64), p| (l.max(-p.x), r.max(p.x)));
        assert!(left.min(right) < CUT, "a body is on both sides of the wall: {left}, {right}");
        right > left
    });
    let right = sides.filter(|right| *right).count();
    assert!((10..done.pile.bodies.len() - 10).contains(&right), "both sides are room: {right} on the right");

    let scene = bricks(vec![piece("land", sheet(3.0, 0.2))]);
    let done = bake(&scene, &draft(FillMethod::Insert));
    for body in corners(&scene, &done) {
        let lowest = body.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        assert!(lowest > 0.2 - CUT, "a body reaches {lowest} m: below the landscape");
    }
    // The score and the expected count are those of the room, as of a shape that is no larger.
    let room = at(block(DVec3::new(0.6, 0.3, 0.6)), DVec3::Y * 0.35);
    let void = bake(&Scene { control: Some(Model::new("room", room)), ..bricks(vec![]) }, &draft(FillMethod::Insert));
    let figure = |bake: &Bake, name: &str| bake.report.measures[name].unwrap();
    let (with, without) = (figure(&done, "shape_iou_start"), figure(&void, "shape_iou_start"));
    assert!((with - without).abs() < 0.1, "{with} on the landscape, {without} in the void");
    assert!(void.report.measures["scenery_penetration_max_rel"].is_none());
    let expected = |bake: &Bake| bake.report.plan.expected_bodies as f64;
    let share = expected(&done) / expected(&void);
    assert!((0.9..1.1).contains(&share), "{share} of the bodies are expected");
}

/// Arches that were poured before a sheet was there, which may have it between their parts, do not keep it.
#[test]
fn no_body_has_a_sheet_through_its_middle() {
    let part = |x: f64, y: f64, size: [f64; 2]| at(block(DVec3::new(size[0], size[1], 0.02)), DVec3::new(x, y, 0.0));
    let mut arch = part(-0.07, 0.0, [0.02, 0.16]);
    arch.append(&part(0.07, 0.0, [0.02, 0.16]));
    arch.append(&part(0.0, 0.07, [0.16, 0.02]));
    let shape = at(block(DVec3::new(0.7, 0.5, 0.7)), DVec3::Y * 0.25);
    let scene = Scene { statics: vec![piece("shelf", sheet(0.3, 0.2))], ..scene(shape, arch) };
    let done = bake(&scene, &draft(FillMethod::Pour));
    assert!(done.report.counts["removed_cutting"] > 0);
    let cuts = done.report.warnings.iter().find(|text| text.contains("shelf, by up to"));
    assert!(cuts.is_none(), "{cuts:?}");
    for body in corners(&scene, &done) {
        let is_inside = body.iter().all(|p| p.x.abs() < 0.3 && p.z.abs() < 0.3);
        let (above, below) = body.iter().fold((0.0, 0.0), |(a, b): (f64, f64), p| (a.max(p.y - 0.2), b.max(0.2 - p.y)));
        assert!(!is_inside || above.min(below) < CUT, "a body is on both sides of the shelf: {above}, {below}");
    }
}

/// A tub whose wall is so thick that all corners of the shape are in it takes room all the same.
#[test]
fn a_shape_may_reach_into_a_thick_wall() {
    let rim = |radius: f64, y: f64| ring(radius, y, 1.0, false).points.into_iter().take(ANGLES as usize);
    let (radius, wall) = (0.3, 0.2);
    let rings = [rim(radius + wall, -wall), rim(radius + wall, 0.5), rim(radius, 0.5), rim(radius, 0.0)];
    let middles = [DVec3::Y * -wall, DVec3::ZERO];
    let band = |i: u32| {
        (0..ANGLES).flat_map(move |k| {
            let (a, b) = (i * ANGLES + k, i * ANGLES + (k + 1) % ANGLES);
            [[a, a + ANGLES, b], [b, a + ANGLES, b + ANGLES]]
        })
    };
    let floor = (0..ANGLES).map(|k| [3 * ANGLES + k, 4 * ANGLES + 1, 3 * ANGLES + (k + 1) % ANGLES]);
    let foot = (0..ANGLES).map(|k| [k, (k + 1) % ANGLES, 4 * ANGLES]);
    let tub = TriMesh {
        points: rings.into_iter().flatten().chain(middles).collect(),
        triangles: (0..3).flat_map(band).chain(floor).chain(foot).collect(),
    };
    let shape = at(block(DVec3::new(0.66, 0.4, 0.66)), DVec3::Y * 0.21);
    let brick = block(DVec3::new(0.16, 0.08, 0.1));
    let scene = Scene { statics: vec![piece("tub", tub)], ..scene(shape, brick) };
    let done = bake(&scene, &draft(FillMethod::Insert));
    assert!(done.pile.bodies.len() > 20, "{} bodies", done.pile.bodies.len());
    // The wall is a polygon.
    let most = radius + CUT;
    for p in corners(&scene, &done).concat() {
        assert!(p.x.hypot(p.z) < most || p.y > 0.5, "a corner is at {p}, in the wall");
    }
}

/// A body that is put into scenery is reported with the scenery's name, their count and the depth.
#[test]
fn bodies_that_cut_scenery_are_named() {
    let pole = at(super::common::disc(0.1, 1.0), DVec3::Y * 0.3);
    let (with, without) = (bricks(vec![piece("Column.glb", pole)]), bricks(vec![]));
    let params = draft(FillMethod::Insert);
    let filled = cairn_core::fill_container(&without, &params, &mut cairn_core::cache::NoCache, &mut Silent);
    let filled = filled.unwrap();
    let report = cairn_core::release_pile(&with, &params, &filled, &mut Silent).unwrap();
    let report = report.measured(&mut Silent).unwrap().report;
    let warning = report.warnings.iter().find(|text| text.contains("Column.glb, by up to"));
    assert!(warning.is_some_and(|text| text.contains("bodies cut")), "{:?}", report.warnings);
    assert!(report.measures["scenery_penetration_max_rel"].unwrap() > 0.1);
}

/// The ground is at the lowest of what carries the pile; scenery that carries nothing does not move it.
#[test]
fn the_ground_is_below_what_carries() {
    let params = draft(FillMethod::Insert);
    let ground = |statics: Vec<StaticModel>| checked(&bricks(statics), &params).ground;
    let table = || {
        let legs = [-1.0, 1.0].map(|side| at(block(DVec3::new(0.05, 0.7, 0.05)), DVec3::new(0.4 * side, -0.4, 0.0)));
        let top = at(block(DVec3::new(0.9, 0.05, 0.5)), DVec3::Y * -0.025);
        legs.into_iter().chain([top]).map(|mesh| piece("table", mesh)).collect::<Vec<_>>()
    };
    assert!((ground(table()) + 0.75).abs() < 1e-9, "at the foot of its legs: {}", ground(table()));
    let pole = at(super::common::disc(0.1, 2.0), DVec3::Y * 0.3);
    assert_eq!(ground(vec![piece("pole", pole)]), 0.0, "the pile stands beside the pole");
    assert_eq!(ground(vec![]), 0.0);
    let mut given = params.clone();
    given.ground_height = Some(-2.0);
    assert_eq!(checked(&bricks(table()), &given).ground, -2.0);
}

#[test]
fn slopes_that_are_too_steep_are_named_with_their_angle() {
    let slope = |angle: f64| {
        let turn = DQuat::from_rotation_z(angle.to_radians());
        let mesh = TriMesh { points: sheet(3.0, 0.0).points.iter().map(|&p| turn * p).collect(), ..sheet(3.0, 0.0) };
        checked(&bricks(vec![piece("slope", mesh)]), &draft(FillMethod::Insert)).warnings
    };
    let is_slope = |text: &&String| text.contains("slopes that friction does not hold, of 41 degrees on slope");
    assert!(slope(41.0).iter().any(|text| is_slope(&text)), "{:?}", slope(41.0));
    assert!(!slope(20.0).iter().any(|text| text.contains("slopes")), "{:?}", slope(20.0));
    // The steep sides of a funnel hold a pile.
    let mut funnel = ring(1.0, 0.0, 1.2, true);
    funnel.points.iter_mut().take(ANGLES as usize).for_each(|p| *p *= DVec3::new(0.05, 1.0, 0.05));
    let scene = bricks(vec![piece("funnel", funnel)]);
    let warnings = checked(&scene, &draft(FillMethod::Insert)).warnings;
    assert!(!warnings.iter().any(|text| text.contains("slopes")), "{warnings:?}");
}

/// A shape in the air starts there and falls, and that is said.
#[test]
fn what_floats_starts_where_it_is_modelled() {
    let mut params = draft(FillMethod::Insert);
    params.ground_height = Some(-1.0);
    params.glue.mode = GlueMode::AsModelled;
    params.output.frames = Some(2);
    let scene = bricks(vec![]);
    let done = bake(&scene, &params);
    let lowest = done.pile.frames[0].iter().map(|pose| pose.translation.y).fold(f64::INFINITY, f64::min);
    assert!(lowest > 0.0, "the lowest body starts at {lowest} m");
    let falls = |text: &String| text.contains("m above the ground (ground_height): the pile starts there and falls");
    assert!(done.report.warnings.iter().any(falls), "{:?}", done.report.warnings);

    let over_table = bricks(vec![piece("table", at(block(DVec3::splat(1.0)), DVec3::Y * -1.0))]);
    let warnings = checked(&over_table, &draft(FillMethod::Insert)).warnings;
    let onto = |text: &String| text.contains("it touches nothing: the pile starts there and falls 0.500 m onto table");
    assert!(warnings.iter().any(onto), "{warnings:?}");
    let mut no_ground = draft(FillMethod::Insert);
    no_ground.ground = false;
    let beside = bricks(vec![piece("table", at(block(DVec3::splat(0.3)), DVec3::X * 0.6))]);
    let warnings = checked(&beside, &no_ground).warnings;
    assert!(warnings.iter().any(|text| text.contains("nothing is below it: the pile starts there")), "{warnings:?}");
}

/// Scenery that moves takes the room that it has in the first frame.
#[test]
fn moving_scenery_is_where_it_starts() {
    let pole = super::common::disc(0.1, 1.0);
    let key =
        |time, x| Keyframe { time, pose: Pose { translation: DVec3::new(x, 0.3, 0.0), rotation: DQuat::IDENTITY } };
    let moving = StaticModel { keys: vec![key(5.0, 0.15), key(6.0, 1.0)], ..piece("pole", pole) };
    let mut params = draft(FillMethod::Insert);
    params.output.frames = Some(1);
    let scene = bricks(vec![moving]);
    let done = bake(&scene, &params);
    for body in corners(&scene, &done) {
        let nearest = body.iter().map(|p| DVec3::new(p.x - 0.15, 0.0, p.z).length()).fold(f64::INFINITY, f64::min);
        assert!(nearest > 0.1 - CUT, "a corner is {nearest} m from the axis of the pole");
    }
}

/// The inside of a bowl is where water would stay, up to a level, a share or heaped.
#[test]
fn a_container_is_filled_up_to_its_rim() {
    let bowl = piece("bowl", ring(0.3, 0.0, 0.2, true));
    let props = [Prop::new(Model::new("cube", block(DVec3::splat(0.06))))];
    let volume = |change: &dyn Fn(&mut Params)| {
        let mut params = draft(FillMethod::Insert);
        change(&mut params);
        inside(&bowl, &params.fill, &props).unwrap().mesh.signed_volume()
    };
    let full = std::f64::consts::PI * 0.3 * 0.3 * 0.2;
    // The mesh reaches into the wall by up to a cell, a tenth of a prop.
    let of_full = |volume: f64, share: f64| (0.95..1.25).contains(&(volume / (share * full)));
    let (whole, half) = (volume(&|_| ()), volume(&|params| params.fill.share = 0.5));
    let level = volume(&|params| params.fill.level = Some(0.1));
    let heaped = volume(&|params| params.fill.heap = 30.0);
    assert!(of_full(whole, 1.0), "{whole} of {full} m^3");
    assert!(of_full(half, 0.5) && of_full(level, 0.5), "{half} and {level} of {full} m^3");
    // A cone of 30 degrees.
    let cone = std::f64::consts::PI * 0.3 * 0.3 * 0.3 * 30f64.to_radians().tan() / 3.0;
    assert!(((heaped - whole) / cone - 1.0).abs() < 0.15, "{} of {cone} m^3 on top", heaped - whole);

    let params = draft(FillMethod::Insert);
    for (name, mesh) in [("plate", sheet(0.3, 0.0)), ("block", block(DVec3::splat(0.3)))] {
        let error = inside(&piece(name, mesh), &params.fill, &props).unwrap_err();
        assert!(error.starts_with(&format!("{name} holds nothing")), "{error}");
    }
}

/// A pile in a bowl lies in it, whatever the seed.
#[test]
fn a_bowl_keeps_what_it_is_filled_with() {
    for seed in 1..=3 {
        let bowl = piece("bowl", ring(0.3, 0.0, 0.2, true));
        let mut params = draft(FillMethod::Insert);
        params.seed = seed;
        let props = vec![Prop::new(Model::new("cube", block(DVec3::splat(0.08))))];
        let control = Some(inside(&bowl, &params.fill, &props).unwrap());
        let scene = Scene { control, props, statics: vec![bowl], ..Scene::default() };
        let done = bake(&scene, &params);
        for body in corners(&scene, &done) {
            let farthest = body.iter().map(|p| DVec3::new(p.x, 0.0, p.z).length()).fold(0.0, f64::max);
            assert!(farthest < 0.3 + CUT, "seed {seed}: a corner is {farthest} m from the axis");
            assert!(body.iter().all(|p| p.y > -CUT), "seed {seed}: a body is below the bottom");
        }
        assert!(done.pile.bodies.len() > 20, "seed {seed}: {} bodies", done.pile.bodies.len());
    }
}

/// What is said about scenery, on its cause alone.
#[test]
fn each_warning_about_scenery_has_its_cause() {
    let params = draft(FillMethod::Insert);
    let slope = |angle: f64| {
        let turn = DQuat::from_rotation_z(f64::to_radians(angle));
        let mesh = TriMesh { points: sheet(3.0, 0.0).points.iter().map(|&p| turn * p).collect(), ..sheet(3.0, 0.0) };
        checked(&bricks(vec![piece("slope", mesh)]), &params).warnings
    };
    let beside = |ground: bool| {
        let table = piece("table", at(block(DVec3::splat(0.3)), DVec3::X * 0.6));
        checked(&bricks(vec![table]), &Params { ground, ..params.clone() }).warnings
    };
    let table = piece("table", at(block(DVec3::splat(1.0)), DVec3::Y * -1.0));
    let cut = |keys: Vec<Keyframe>| {
        let pole = StaticModel { keys, ..piece("pole", at(super::common::disc(0.1, 1.0), DVec3::Y * 0.3)) };
        let filled =
            cairn_core::fill_container(&bricks(vec![]), &params, &mut cairn_core::cache::NoCache, &mut Silent).unwrap();
        let scene = bricks(vec![pole]);
        let bake = cairn_core::release_pile(&scene, &params, &filled, &mut Silent).unwrap();
        bake.measured(&mut Silent).unwrap().report.warnings
    };
    let key = |time: f64| Keyframe { time, pose: Pose { translation: DVec3::ZERO, rotation: DQuat::IDENTITY } };
    let props = [Prop::new(Model::new("cube", block(DVec3::splat(0.06))))];
    let holds = |piece: StaticModel| inside(&piece, &params.fill, &props).err().into_iter().collect();
    let bowl = piece("bowl", ring(0.3, 0.0, 0.2, true));
    // A terrain without a back, with a hole, below whose mean height the shape begins; a tunnel under it.
    let hole = |size: f64| {
        let rim = |radius: f64| ring(radius, 0.01, 0.01, false).points.into_iter().take(ANGLES as usize);
        let face = |k: u32| {
            let next = (k + 1) % ANGLES;
            [[k, k + ANGLES, next], [next, k + ANGLES, next + ANGLES]]
        };
        let points = rim(4.0).chain(rim(size)).collect();
        let terrain = TriMesh { points, triangles: (0..ANGLES).flat_map(face).collect() };
        let tunnel = piece("tunnel", at(sheet(3.0, 0.0), DVec3::Y * -1.0));
        let scene = bricks(vec![piece("terrain", terrain), tunnel]);
        checked(&scene, &Params { ground: false, ..params.clone() }).warnings
    };
    let cases: [(&str, Vec<String>, &str); 11] = [
        ("when a slope is too steep", slope(41.0), "% of its foot is on slopes that friction does not hold, of "),
        ("when a slope holds", slope(20.0), "-"),
        (
            "when it is above a table",
            checked(&bricks(vec![table]), &params).warnings,
            "it touches nothing: the pile starts there and falls ",
        ),
        ("when a part is above a hole", hole(0.2), "% of its foot is above a hole in the scenery"),
        ("when it stands around a small hole", hole(0.02), "-"),
        (
            "when nothing is below it",
            beside(false),
            "nothing is below it: the pile starts there, and falls past the scenery",
        ),
        ("when the ground is below it", beside(true), "-"),
        (
            "when bodies are in scenery",
            cut(vec![]),
            "use more accuracy, or smaller props, or give the scenery more thickness",
        ),
        (
            "when scenery moves into bodies",
            cut(vec![key(5.0), key(6.0)]),
            "move it more slowly, or give it more thickness",
        ),
        (
            "when a container is flat",
            holds(piece("plate", sheet(0.3, 0.0))),
            "holds nothing: water would run off everywhere",
        ),
        ("when a container is a bowl", holds(bowl), "-"),
    ];
    for (case, said, words) in &cases {
        let has = |words: &str| said.iter().any(|text| text.contains(words));
        assert!(*words == "-" || has(words), "{case}: {said:?}");
        let others = cases.iter().map(|(_, _, other)| *other).filter(|other| other != words && *other != "-");
        others.for_each(|other| assert!(!has(other), "{case}: {said:?}"));
    }
}

/// A pile on a tip has room for no prop there: glued, it is set down on the table that carries its shape.
#[test]
fn a_narrow_foot_is_set_down_on_scenery() {
    let cone = super::common::cone(0.5, 0.8);
    let points = cone.points.iter().map(|p| DVec3::new(p.x, 1.3 - p.y, p.z)).collect();
    let triangles = cone.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    let tip = TriMesh { points, triangles };
    let table = piece("table", at(block(DVec3::new(2.0, 0.1, 2.0)), DVec3::Y * 0.45));
    let scene = Scene { statics: vec![table], ..scene(tip, block(DVec3::new(0.16, 0.08, 0.1))) };
    let lowest = |anchor: Switch| {
        let mut params = draft(FillMethod::Insert);
        params.glue.mode = GlueMode::AsModelled;
        params.glue.anchor = anchor;
        params.output.frames = Some(0);
        let first = bake(&scene, &params);
        corners(&scene, &first).into_iter().flatten().map(|p| p.y).fold(f64::INFINITY, f64::min)
    };
    let (free, set_down) = (lowest(Switch::Off), lowest(Switch::Auto));
    assert!(free > 0.52, "the tip has room for no brick: the lowest corner is at {free} m");
    assert!((set_down - 0.5).abs() < 0.01, "the lowest corner is at {set_down} m, the table at 0.5 m");
}
