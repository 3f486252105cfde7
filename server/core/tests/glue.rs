//! Glued piles, end to end: any shape stands, with few dots, and breaks where it is hit.

use super::common::{cone, scene, stick};
use cairn_core::bake;
use cairn_core::report::bake::Bake;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, GlueMode, Params, ReleaseOrder, Switch};
use cairn_input::scene::{CollapseRequest, Model, PlacedBody, Prop, Scene};
use glam::{DQuat, DVec3};

fn params() -> Params {
    let mut params = Params::new(Accuracy::Draft);
    params.release.order = ReleaseOrder::AtOnce;
    params
}

/// A cone on its tip: nothing that friction carries.
fn top(radius: f64, height: f64) -> TriMesh {
    let cone = cone(radius, height);
    let points = cone.points.iter().map(|p| DVec3::new(p.x, height - p.y, -p.z)).collect();
    TriMesh { points, ..cone }
}

/// Cubes of 0.2 m.
fn cubes(bodies: Vec<PlacedBody>) -> Scene {
    let stick = stick();
    let points = stick.points.iter().map(|p| p / DVec3::new(0.25, 0.03, 0.03) * 0.1).collect();
    let model = Model::new("cube", TriMesh { points, ..stick });
    let prop = Prop { density: 500.0, ..Prop::new(model) };
    Scene { props: vec![prop], bodies, ..Scene::default() }
}

fn cube(x: f64, y: f64) -> PlacedBody {
    PlacedBody::new(0, Pose { translation: DVec3::new(x, y, 0.0), rotation: DQuat::IDENTITY })
}

/// A gallows: a post of four cubes, and an arm of two at its top.
fn gallows() -> Vec<PlacedBody> {
    let post = (0..4).map(|k| cube(0.0, 0.1 + 0.2 * f64::from(k)));
    post.chain([cube(0.2, 0.7), cube(0.4, 0.7)]).collect()
}

fn baked(scene: &Scene, params: &Params) -> Bake {
    bake(scene, params, &mut Silent).unwrap()
}

fn figure(bake: &Bake, name: &str) -> f64 {
    bake.report.measures[name].unwrap()
}

/// How far a body has come down, m.
fn fell(bake: &Bake, body: usize) -> f64 {
    bake.pile.frames[0][body].translation.y - bake.pile.frames.last().unwrap()[body].translation.y
}

/// Glue reaches across what is seen as a gap. The few bodies that would hover are left out, and said; many are not.
#[test]
fn what_would_hover_is_left_out() {
    let two = |height: f64, size: DVec3| {
        let [mut ground, above] = [DVec3::new(1.2, 0.6, 0.8), size].map(super::common::block);
        ground.points.iter_mut().for_each(|p| p.y += 0.3);
        let lift = DVec3::Y * (0.6 + height + size.y / 2.0);
        let count = ground.points.len() as u32;
        ground.points.extend(above.points.iter().map(|p| *p + lift));
        ground.triangles.extend(above.triangles.iter().map(|t| t.map(|corner| corner + count)));
        scene(ground, super::common::block(DVec3::new(0.2, 0.06, 0.1)))
    };
    let plain =
        scene(super::common::block(DVec3::new(1.2, 0.6, 0.8)), super::common::block(DVec3::new(0.2, 0.06, 0.1)));
    let mut params = params();
    params.output.frames = Some(10);
    for (case, scene, words) in [
        (
            "when few bodies would hover",
            two(0.3, DVec3::new(0.28, 0.1, 0.15)),
            Some(
                "left out, since no chain of meshes that touch led from what would hover to what stands: smaller props \
                  reach further into thin parts",
            ),
        ),
        ("when a whole limb would", two(0.3, DVec3::new(0.7, 0.3, 0.5)), None),
        ("when a whole limb does, since glue reaches it", two(0.12, DVec3::new(0.7, 0.3, 0.5)), None),
        ("when nothing does", plain, None),
    ] {
        let bake = baked(&scene, &params);
        let warnings = &bake.report.warnings;
        let words = words.unwrap_or("left out, since");
        assert_eq!(warnings.iter().any(|text| text.contains(words)), case.contains("few"), "{case}: {warnings:?}");
        if case.contains("few") {
            assert_eq!(figure(&bake, "hanging_visible"), 0.0);
            let highest = bake.pile.frames[0].iter().map(|pose| pose.translation.y).fold(0.0, f64::max);
            assert!(highest < 0.8, "{highest} m");
        }
        if case.contains("reaches") {
            // As if it were a part of the ground.
            assert!(figure(&bake, "hanging_visible") > 10.0, "{}", figure(&bake, "hanging_visible"));
            assert!(figure(&bake, "foot_load") > 3.0, "{}", figure(&bake, "foot_load"));
        }
    }
}

#[test]
fn a_draft_is_tried_before_it_is_released() {
    let [mut mushroom, mut cap] = [DVec3::new(0.3, 0.7, 0.3), DVec3::new(1.0, 0.3, 1.0)].map(super::common::block);
    mushroom.points.iter_mut().for_each(|p| p.y += 0.35);
    cap.points.iter_mut().for_each(|p| p.y += 0.8);
    mushroom.append(&cap);
    let bake = baked(&scene(mushroom, super::common::block(DVec3::splat(0.14))), &params());
    assert!(bake.report.counts["glue_proof_steps"] > 0);
    assert!(figure(&bake, "kept_shape") > 0.9, "kept {}", figure(&bake, "kept_shape"));
}

#[test]
fn a_pile_on_its_tip_stands_as_it_was_modelled() {
    let scene = scene(top(0.7, 1.4), stick());
    let mut params = params();
    params.glue.proof = Switch::On;
    let glued = baked(&scene, &params);
    assert!(figure(&glued, "kept_shape") > 0.9, "kept {}", figure(&glued, "kept_shape"));
    assert!(figure(&glued, "kept_shape_freed") > 0.9, "freed {}", figure(&glued, "kept_shape_freed"));
    assert!(figure(&glued, "moved_freed") <= 0.02, "moved {}", figure(&glued, "moved_freed"));
    assert!(figure(&glued, "kept_shape_natural") < 0.5, "natural {}", figure(&glued, "kept_shape_natural"));
    assert!(figure(&glued, "glue_imbalance") <= 1e-5, "{}", figure(&glued, "glue_imbalance"));
    assert!(figure(&glued, "anchored") >= 1.0);
    let glue = glued.pile.glue.as_ref().unwrap();
    assert_eq!(glue.dots.len() as u64, glued.report.counts["glue_dots"]);
    assert!(glue.dots.iter().all(|dot| !dot.is_broken));
    assert_eq!(glued.report.counts["control_cycles"], 0, "what is glued is not held");
    // 20 characteristic times in steps of 0.05 would be 400 for each trial; four of five trials are of a tilted pile.
    let whole = 5 * 400;
    let steps = glued.report.counts["glue_proof_steps"];
    assert!(steps > 0 && steps < whole * 2 / 3, "a trial ends once nothing moves: {steps} steps");

    assert_eq!(baked(&scene, &params).pile.frames, glued.pile.frames, "the same bytes");

    params.glue.mode = GlueMode::Natural;
    let natural = baked(&scene, &params);
    assert_eq!(natural.report.counts["glue_dots"], 0);
    assert!(figure(&natural, "kept_shape") < 0.6, "{}", figure(&natural, "kept_shape"));
}

#[test]
fn what_friction_carries_is_not_glued() {
    let params = params();
    let mut glued = params.clone();
    glued.glue.mode = GlueMode::AsModelled;
    let tower = (0..4).map(|k| cube(0.0, 0.1 + 0.2 * f64::from(k))).collect();
    let bake = baked(&cubes(tower), &glued);
    assert_eq!(bake.report.counts["glue_dots"], 0);
    let one = baked(&cubes(vec![cube(0.0, 0.1)]), &glued);
    assert_eq!((one.report.counts["glue_dots"], one.report.counts["glue_clusters"]), (0, 0));
    // Placed by hand, nothing is glued unless that is asked for.
    assert!(!baked(&cubes(gallows()), &params).report.measures.contains_key("touches"));
}

#[test]
fn stronger_glue_holds_more() {
    let held = |strength: f64| {
        let mut params = params();
        (params.glue.mode, params.glue.strength) = (GlueMode::Tacky, Some(strength));
        let bake = baked(&cubes(gallows()), &params);
        (4..6).filter(|&body| fell(&bake, body) < 0.1).count()
    };
    let held: Vec<usize> = [0.0, 0.5, 100.0].map(held).to_vec();
    assert!(held.is_sorted() && held[0] == 0 && held[2] == 2, "{held:?}");
}

#[test]
fn a_hit_breaks_what_a_touch_does_not() {
    let mut params = params();
    params.glue.mode = GlueMode::AsModelled;
    params.output.frames = Some(60);
    let thrown = |mass: f64| {
        let projectile =
            PlacedBody { velocity: DVec3::new(0.0, -8.0, 0.0), mass: Some(mass), start: 1.0, ..cube(0.4, 1.5) };
        let mut bodies = gallows();
        bodies.push(projectile);
        baked(&cubes(bodies), &params)
    };
    let (light, heavy) = (thrown(0.01), thrown(400.0));
    assert_eq!(light.report.counts["glue_dots_broken"], 0);
    assert!(fell(&light, 5) < 0.05, "the arm stands: {}", fell(&light, 5));
    assert!(heavy.report.counts["glue_dots_broken"] > 0);
    assert!(fell(&heavy, 5) > 0.3, "the arm comes down: {}", fell(&heavy, 5));
    assert!(heavy.pile.glue.as_ref().unwrap().dots.iter().any(|dot| dot.is_broken));
    params.control.until = Some(1.0);
    assert!(fell(&baked(&cubes(gallows()), &params), 5) > 0.3, "the glue ends with the control");
}

#[test]
fn no_ground_and_no_touch_are_no_fault() {
    let mut params = params();
    params.glue.mode = GlueMode::AsModelled;
    let apart = baked(&cubes(vec![cube(0.0, 0.1), cube(0.0, 1.0)]), &params);
    assert_eq!(apart.report.counts["glue_dots"], 0);
    assert!(
        apart.report.warnings.iter().any(|text| text.contains("could not be glued")),
        "{:?}",
        apart.report.warnings
    );
    assert!(fell(&apart, 1) > 0.5);
}

/// A gap that the fill left is no reason to fall; it is reported.
#[test]
fn what_touches_nothing_is_glued_across_a_narrow_gap() {
    let mut params = params();
    params.glue.mode = GlueMode::AsModelled;
    let bridged = baked(&cubes(vec![cube(0.0, 0.1), cube(0.0, 0.45), cube(0.0, 0.65)]), &params);
    assert!(fell(&bridged, 1) < 0.01 && fell(&bridged, 2) < 0.01, "{} {}", fell(&bridged, 1), fell(&bridged, 2));
    let warnings = &bridged.report.warnings;
    assert!(warnings.iter().any(|text| text.contains("1 dot of glue bridges a gap of up to 0.150 m")), "{warnings:?}");
}

/// Statics knows nothing of overlaps: bodies that were left pressed into each other are balanced, and spring apart.
#[test]
fn what_is_pressed_into_its_neighbours_is_held_by_glue_alone() {
    let wall = || cubes((0..15).map(|k| cube(0.12 * f64::from(k % 5), 0.1 + 0.2 * f64::from(k / 5))).collect());
    let way = |bake: &Bake, body: usize| {
        bake.pile.frames[0][body].translation.distance(bake.pile.frames.last().unwrap()[body].translation)
    };
    let farthest = |bake: &Bake| (0..15).map(|body| way(bake, body)).fold(0.0, f64::max);
    let mut params = params();
    let natural = farthest(&baked(&wall(), &params));
    assert!(natural > 0.06, "{natural}");
    (params.glue.mode, params.glue.proof) = (GlueMode::AsModelled, Switch::On);
    let glued = baked(&wall(), &params);
    assert!(farthest(&glued) < 0.01, "{} of {natural}", farthest(&glued));
    assert_eq!(figure(&glued, "moved_freed"), 0.0);
    // Fifteen cubes and the ground are one solid by fifteen dots.
    assert!(glued.report.counts["glue_dots"] <= 15, "{}", glued.report.counts["glue_dots"]);
}

#[test]
fn size_changes_nothing() {
    let normal = scene(top(0.6, 1.2), stick());
    let dots = |factor: f64| {
        let mut scene = normal.clone();
        let control = scene.control.as_mut().unwrap();
        control.mesh = control.mesh.scaled(factor);
        scene.props[0].model.mesh = scene.props[0].model.mesh.scaled(factor);
        let mut params = params();
        params.output.fps = (40.0 / factor.sqrt()).clamp(1.0, 1000.0);
        let bake = baked(&scene, &params);
        (bake.report.counts["glue_dots"], figure(&bake, "glue_force_max"))
    };
    let (here, small, large) = (dots(1.0), dots(1.0 / 1024.0), dots(1024.0));
    assert!(here.0 > 0);
    for other in [small, large] {
        assert_eq!(here.0, other.0);
        assert!((here.1 / other.1 - 1.0).abs() < 1e-3, "{} {}", here.1, other.1);
    }
}

/// Two cubes wide and deep, and so many high.
fn tower(height: u32) -> Vec<PlacedBody> {
    let places = (0..height).flat_map(|y| (0..4).map(move |k| (k % 2, y, k / 2)));
    let place = |(x, y, z): (u32, u32, u32)| DVec3::Y * 0.1 + 0.2 * DVec3::new(x.into(), y.into(), z.into());
    places.map(|at| PlacedBody::new(0, Pose { translation: place(at), rotation: DQuat::IDENTITY })).collect()
}

#[test]
fn a_pile_comes_down_to_the_side_that_is_asked_for_and_the_named_body_goes_first() {
    let request = CollapseRequest { prop: None, number: None, azimuth: 0.0, start: None, duration: None, speed: None };
    // Of the lowest, the first at +Z.
    for (azimuth, number, first) in [(0.0, None, 2), (90.0, Some(1), 1), (270.0, Some(0), 0)] {
        let collapse = Some(CollapseRequest { azimuth, number, ..request });
        let bake = baked(&Scene { collapse, ..cubes(tower(7)) }, &params());
        let fall = bake.report.collapse.as_ref().expect("it comes down");
        assert_eq!((fall.first, &fall.moved_first), (first, &vec![first]), "{azimuth}");
        assert!(fall.deviation().unwrap() < 20.0, "{azimuth}: {:?}", fall.fell_to);
        assert!(fall.push > 0.0 && fall.came_down > 14, "{azimuth}: {fall:?}");
        assert!(fall.at_rest && fall.frame < fall.last_joint_frame && fall.last_joint_frame < fall.rest_frame);
        assert_eq!(bake.report.measures["second_collapse"], Some(0.0), "nothing falls that was not released");
    }
    // Lower than it is wide: nothing to topple over.
    let bake = baked(&Scene { collapse: Some(request), ..cubes(tower(1)) }, &params());
    assert_eq!(bake.report.collapse.unwrap().push, 0.0);
    let bake = baked(&cubes(tower(2)), &params());
    assert!(bake.report.collapse.is_none());
    // What is placed to stay does: the pile falls beside it.
    let pinned = PlacedBody { pinned: true, ..cube(0.4, 0.1) };
    let bodies = tower(5).into_iter().chain([pinned]).collect();
    let bake = baked(&Scene { collapse: Some(request), ..cubes(bodies) }, &params());
    assert!(fell(&bake, 20).abs() < 1e-6 && bake.report.collapse.unwrap().came_down > 10);
    let nobody = CollapseRequest { number: Some(99), ..request };
    let bake = baked(&Scene { collapse: Some(nobody), ..cubes(tower(1)) }, &params());
    assert!(bake.report.collapse.is_none());
    assert!(bake.report.warnings.iter().any(|warning| warning.starts_with("collapse: there is no")));
}
