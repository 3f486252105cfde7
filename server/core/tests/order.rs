//! How props lie: stacked, bonded, crosswise and nested; in bands and clusters; shaken.

use super::common::{cone, scene, stick};
use cairn_core::bake;
use cairn_core::report::bake::Bake;
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, FillMethod, GlueMode, Layout, Params};
use cairn_input::scene::{Scene, Turns, UprightRule};
use cairn_prepare::effects::Count;
use glam::DVec3;
use std::f64::consts::TAU;

/// A closed box on the ground with these edges.
fn block(edges: DVec3) -> TriMesh {
    let corner = |i: u32| {
        let share = DVec3::new(f64::from(i & 1) - 0.5, f64::from(i >> 1 & 1), f64::from(i >> 2) - 0.5);
        edges * share
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh { points: (0..8).map(corner).collect(), triangles }
}

/// Stacked, with nothing glued.
fn stacked(order: f64) -> Params {
    let mut params = Params::new(Accuracy::Preview);
    params.fill.method = FillMethod::Stack;
    params.fill.order = order;
    params.glue.mode = GlueMode::Natural;
    params
}

fn baked(scene: &Scene, params: &Params) -> Bake {
    bake(scene, params, &mut Silent).unwrap()
}

fn figure(bake: &Bake, name: &str) -> f64 {
    bake.report.measures[name].unwrap_or_else(|| panic!("{name} is not measured"))
}

const CUBE: DVec3 = DVec3::splat(0.2);
const BRICK: DVec3 = DVec3::new(0.24, 0.07, 0.115);
const PLANK: DVec3 = DVec3::new(1.2, 0.05, 0.2);

#[test]
fn cubes_fill_a_box_to_the_last_one() {
    let scene = scene(block(DVec3::new(0.8, 0.6, 0.4)), block(CUBE));
    let bake = baked(&scene, &stacked(1.0));
    assert_eq!(bake.report.bodies, 4 * 3 * 2);
    assert!(figure(&bake, "fill_fraction") > 0.98, "{}", figure(&bake, "fill_fraction"));
    assert!(figure(&bake, "kept_shape") > 0.99);
    assert!(figure(&bake, "flat_share") == 1.0 && figure(&bake, "aligned_share") == 1.0);
}

#[test]
fn bricks_are_bonded_and_the_wall_stands() {
    let scene = scene(block(DVec3::new(1.57, 0.7, 0.12)), block(BRICK));
    let bake = baked(&scene, &stacked(1.0));
    // Six and a half bricks in a row, ten rows.
    assert!((58..=65).contains(&bake.report.bodies), "{}", bake.report.bodies);
    assert!(figure(&bake, "bonded_share") > 0.7, "{}", figure(&bake, "bonded_share"));
    assert!(figure(&bake, "kept_shape") > 0.95, "{}", figure(&bake, "kept_shape"));
}

#[test]
fn planks_lie_crosswise() {
    let scene = scene(block(DVec3::new(1.25, 0.5, 1.25)), block(PLANK));
    let bake = baked(&scene, &stacked(1.0));
    let along = |wanted: bool| {
        let axis = |pose: &Pose| (pose.rotation * DVec3::X).x.abs() > 0.9;
        bake.pile.frames[0].iter().filter(|pose| axis(pose) == wanted).count()
    };
    let (one, other) = (along(true), along(false));
    assert!(one.min(other) * 3 > bake.report.bodies, "{one} along, {other} across");
    assert!(figure(&bake, "kept_shape") > 0.95, "{}", figure(&bake, "kept_shape"));
}

/// A dish whose rim is higher on one side by this share: rings of 12 corners, from the middle below, out, in and to the
/// middle above.
fn dish(radius: f64, height: f64, uneven: f64) -> TriMesh {
    const N: u32 = 12;
    let rings = [(0.5, 0.0), (1.0, 1.0), (0.93, 1.0), (0.48, 0.2)];
    let mut points = vec![DVec3::ZERO, DVec3::Y * 0.2 * height];
    for (out, up) in rings {
        points.extend((0..N).map(|i| {
            let angle = TAU * f64::from(i) / f64::from(N);
            let up = up * (1.0 + uneven * angle.cos());
            DVec3::new(out * radius * angle.cos(), up * height, out * radius * angle.sin())
        }));
    }
    let at = |ring: u32, i: u32| 2 + ring * N + i % N;
    let mut triangles = Vec::new();
    for i in 0..N {
        triangles.extend([[0, at(0, i), at(0, i + 1)], [1, at(3, i + 1), at(3, i)]]);
        let side = |ring: u32| {
            [[at(ring, i), at(ring + 1, i), at(ring, i + 1)], [at(ring, i + 1), at(ring + 1, i), at(ring + 1, i + 1)]]
        };
        triangles.extend((0..3).flat_map(side));
    }
    TriMesh { points, triangles }
}

/// Each leans a little; the next one is turned so that the column stands.
#[test]
fn uneven_dishes_stand_in_a_column() {
    let scene = scene(block(DVec3::new(0.3, 1.2, 0.3)), dish(0.13, 0.05, 0.02));
    // In few parts, a dish is far more uneven than this one.
    let mut params = stacked(1.0);
    (params.physics.max_parts, params.physics.shape_tolerance) = (32, 0.01);
    let bake = baked(&scene, &params);
    assert!(bake.report.bodies > 25, "{}", bake.report.bodies);
    // By itself, undamped and not held, it leans a little: 0.94 to 0.97, by what overlaps the fill may leave.
    assert!(figure(&bake, "kept_shape") > 0.94, "{}", figure(&bake, "kept_shape"));
    assert!(figure(&bake, "flat_share") == 1.0, "{}", figure(&bake, "flat_share"));
}

#[test]
fn order_decides_how_many_lie_flat() {
    let scene = scene(block(DVec3::new(1.0, 0.6, 0.6)), block(BRICK));
    let flat = [0.0, 0.6, 1.0].map(|order| figure(&baked(&scene, &stacked(order)), "flat_share"));
    assert!(flat[0] < flat[1] && flat[1] < flat[2] && flat[2] > 0.95, "{flat:?}");
}

#[test]
fn a_prop_keeps_its_stance() {
    let mut scene = scene(block(DVec3::new(0.9, 0.6, 0.6)), block(BRICK));
    // On its end, and never turned.
    scene.props[0].stance = UprightRule { up: Some(DVec3::X), turns: Turns::None };
    let bake = baked(&scene, &stacked(1.0));
    let upright = bake.pile.frames[0].iter().filter(|pose| (pose.rotation * DVec3::X).y.abs() > 0.95).count();
    assert!(upright * 10 > bake.report.bodies * 9, "{upright} of {}", bake.report.bodies);
}

/// Mean height at the start of the bodies of each of two props.
fn heights(bake: &Bake) -> [f64; 2] {
    [0, 1].map(|prop| {
        let all = bake.pile.bodies.iter().zip(&bake.pile.frames[0]).filter(|(body, _)| body.prop == prop);
        let (sum, count) = all.fold((0.0, 0), |(sum, count), (_, pose)| (sum + pose.translation.y, count + 1));
        assert!(count > 0, "no body of prop {prop}");
        sum / f64::from(count)
    })
}

#[test]
fn bands_lie_above_each_other_in_the_order_asked_for() {
    let mut scene = scene(block(DVec3::new(1.0, 1.0, 1.0)), block(CUBE));
    let mut large = scene.props[0].clone();
    large.model.name = "large".into();
    large.scale = [1.4, 1.4];
    scene.props[0].weight = 3.0;
    scene.props.push(large);
    for method in [FillMethod::Insert, FillMethod::Stack] {
        for descending in [false, true] {
            let mut params = stacked(1.0);
            params.fill.method = method;
            params.fill.layout = Layout::Bands;
            params.fill.descending = descending;
            let [small, large] = heights(&baked(&scene, &params));
            assert_eq!(descending, large < small, "{method:?}: small at {small}, large at {large}");
        }
    }
}

#[test]
fn small_props_fill_the_gaps_of_large_ones() {
    let mut scene = scene(block(DVec3::new(1.0, 0.8, 1.0)), block(CUBE));
    let mut small = scene.props[0].clone();
    small.model.name = "small".into();
    small.scale = [0.3, 0.3];
    scene.props.push(small);
    let mut params = stacked(1.0);
    params.fill.method = FillMethod::Insert;
    let large = |params: &Params| baked(&scene, params).pile.bodies.iter().filter(|body| body.prop == 0).count();
    let mixed = large(&params);
    params.fill.gaps = true;
    let first = large(&params);
    assert!(first > mixed, "{first} large ones where they come first, {mixed} where both come together");
}

#[test]
fn only_shaking_adds_the_steps_of_it() {
    let scene = scene(block(DVec3::new(0.9, 0.6, 0.6)), block(BRICK));
    let mut params = stacked(0.2);
    let steps = |params: &Params| {
        [Count::FillSteps, Count::ShakeSteps].map(|count| baked(&scene, params).report.counts[&count])
    };
    let [still, none] = steps(&params);
    params.fill.shake = 2.0;
    let [shaken, shakes] = steps(&params);
    // Two characteristic times, and one to settle.
    assert!(none == 0 && shakes >= 25 && shaken == still + shakes, "{still} and {shaken} steps, {shakes} of the shake");
}

/// How far each body's farthest corner is outside the control mesh at the start, d.
fn protrusions(scene: &Scene, params: &Params) -> Vec<f64> {
    let bake = baked(scene, params);
    let region = MeshInterior::new(&scene.control.as_ref().unwrap().mesh);
    let corners = &scene.props[0].model.mesh.points;
    let out = |pose: &Pose, p: &DVec3| region.signed_distance(pose.transform_point(*p));
    let most = |pose: &Pose| corners.iter().map(|p| out(pose, p)).fold(f64::NEG_INFINITY, f64::max);
    let farthest = |pose| most(pose) / figure(&bake, "prop_diameter");
    bake.pile.frames[0].iter().map(farthest).collect()
}

#[test]
fn single_props_stand_out_of_a_natural_surface_and_none_of_a_cast_one() {
    let scene = scene(cone(1.1, 1.8), stick());
    let mut params = stacked(0.0);
    params.fill.method = FillMethod::Insert;
    let [natural, cast] = [0.5, 1.0].map(|surface| {
        params.fill.surface = surface;
        protrusions(&scene, &params)
    });
    // More than the fill leaves anyway, and parting adds.
    let standing_out = |all: &[f64]| all.iter().filter(|&&out| out > 0.12).count();
    let (some, none) = (standing_out(&natural), standing_out(&cast));
    assert!(some >= none + 3 && some * 4 < natural.len(), "{some} of {}, {none} of {}", natural.len(), cast.len());
    let most = natural.iter().copied().fold(0.0, f64::max);
    assert!(most < 0.3, "{most}");
}

#[test]
fn props_in_disorder_lie_straighter_where_room_is_short() {
    // Two bricks are as deep as the wall.
    let scene = scene(block(DVec3::new(1.57, 0.7, 0.245)), block(BRICK));
    let [loose, tidy] = [0.85, 1.0].map(|order| baked(&scene, &stacked(order)).report.bodies);
    assert!(loose * 2 > tidy, "{loose} and {tidy}");
}

#[test]
fn several_kinds_are_laid_in_layers_as_many_of_each_as_asked_for() {
    let mut scene = scene(block(DVec3::new(1.25, 1.5, 1.25)), block(PLANK));
    let mut posts = scene.props[0].clone();
    posts.model.name = "post".into();
    posts.model.mesh = block(DVec3::new(1.2, 0.1, 0.1));
    posts.weight = 0.5;
    scene.props.push(posts);
    let bake = baked(&scene, &stacked(1.0));
    let posts = bake.pile.bodies.iter().filter(|body| body.prop == 1).count() as f64 / bake.report.bodies as f64;
    assert!((0.2..0.47).contains(&posts), "{posts} of them are posts");
    assert!(figure(&bake, "fill_fraction") > 0.8, "{}", figure(&bake, "fill_fraction"));
    assert!(figure(&bake, "kept_shape") > 0.95, "{}", figure(&bake, "kept_shape"));
}

#[test]
fn the_same_seed_stacks_the_same_pile() {
    let scene = scene(block(DVec3::new(0.9, 0.6, 0.6)), block(BRICK));
    let [a, b] = [0, 1].map(|_| baked(&scene, &stacked(0.7)).pile.frames);
    assert_eq!(a, b);
}
