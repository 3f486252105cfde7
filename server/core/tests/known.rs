//! The analysis of meshes against closed forms: cards, a ladder, a prism, a tower with a gap, an arch. Statics judges
//! the meshes, not the skins around collision shapes.

use super::common::block;
use cairn_analysis::{AnalysisOptions, PileAnalysis, TiltLimit, WholePile};
use cairn_core::analyse;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{Model, PlacedBody, Prop, Scene, StaticModel};
use glam::{DQuat, DVec2, DVec3};

/// What single precision leaves of a closed form.
const EXACT: f64 = 1e-3;

/// Bodies of these meshes at these places, all with this friction.
fn pile(meshes: Vec<TriMesh>, bodies: &[(usize, Pose)], friction: f64) -> Scene {
    let prop = |mesh| Prop { friction, ..Prop::new(Model::new("stone", mesh)) };
    let bodies = bodies.iter().map(|&(prop, pose)| PlacedBody::new(prop, pose)).collect();
    Scene { control: None, props: meshes.into_iter().map(prop).collect(), bodies, ..Scene::default() }
}

fn analysed(scene: &Scene, friction: f64) -> PileAnalysis {
    let params = Params { ground_friction: friction, ..Params::new(Accuracy::Standard) };
    let options = AnalysisOptions { removals: false, ..AnalysisOptions::default() };
    analyse(scene, &params, &options, &mut Silent).unwrap()
}

fn whole(scene: &Scene, friction: f64) -> WholePile {
    let found = analysed(scene, friction);
    assert!(found.stands, "{:?}", found.bodies);
    found.whole.unwrap()
}

fn at(translation: DVec3, rotation: DQuat) -> Pose {
    Pose { translation, rotation }
}

/// The body of these corners in the plane of x and y, counterclockwise, this deep along z.
fn extruded(corners: &[DVec2], depth: f64) -> TriMesh {
    let count = corners.len() as u32;
    let side = |z: f64| corners.iter().map(move |p| p.extend(z * depth / 2.0));
    let caps = (1..count - 1).flat_map(|k| [[0, k + 1, k], [count, count + k, count + k + 1]]);
    let sides = (0..count).flat_map(|k| {
        let next = (k + 1) % count;
        [[k, next, count + k], [next, count + next, count + k]]
    });
    TriMesh { points: side(-1.0).chain(side(1.0)).collect(), triangles: caps.chain(sides).collect() }
}

fn tilt(whole: &WholePile, azimuth: f64) -> &TiltLimit {
    whole.tilts.iter().find(|tilt| tilt.azimuth == azimuth).unwrap()
}

fn tilts_at(whole: &WholePile, azimuth: f64, exact: f64) {
    let TiltLimit { stands_to, falls_from, .. } = *tilt(whole, azimuth);
    assert!(
        stands_to < exact * (1.0 + EXACT) && falls_from > exact * (1.0 - EXACT),
        "{stands_to} {falls_from} {exact}"
    );
    assert!(falls_from - stands_to < 0.5, "{stands_to} {falls_from}");
}

fn needs_share(whole: &WholePile, exact: f64) {
    let [falls, stands] = whole.friction;
    assert!(falls < exact * (1.0 + EXACT) && stands > exact * (1.0 - EXACT), "{falls} {stands} {exact}");
    assert!(stands - falls < 0.05, "{falls} {stands}");
}

/// Two cards meet edge on edge: by symmetry, the force there is horizontal, W (tan(angle) / 2 - t / 2 L). The other way
/// round, they lean out of the plane of their edges as well.
#[test]
fn cards_that_meet_edge_on_edge() {
    let size = DVec3::new(0.0009, 0.09, 0.06);
    for (degrees, turn) in [(30.0f64, 0.0), (20.0, 0.7)] {
        let angle = degrees.to_radians();
        let turn = DQuat::from_rotation_y(turn);
        // About the middle of the edge where they meet, which is high above the ground.
        let card = |side: f64| {
            let rotation = turn * DQuat::from_rotation_z(side * angle);
            let corner = DVec3::new(-side * size.x / 2.0, size.y / 2.0, 0.0);
            at(DVec3::Y * size.y * angle.cos() - rotation * corner, rotation)
        };
        let scene = pile(vec![block(size)], &[(0, card(1.0)), (0, card(-1.0))], 0.7);
        let found = whole(&scene, 0.7);
        needs_share(&found, (angle.tan() - size.x / size.y) / 2.0 / 0.7);
        for azimuth in [90.0, 45.0] {
            let (one, other) = (tilt(&found, azimuth), tilt(&found, azimuth + 180.0));
            assert!((one.stands_to - other.stands_to).abs() < 0.2, "{one:?} {other:?}");
        }
    }
}

/// A ladder stands against a rough wall if the lines of both forces can meet above its center.
#[test]
fn a_ladder_against_a_wall() {
    let (length, thick, angle) = (3.0, 0.08, 60f64.to_radians());
    let (sin, cos) = angle.sin_cos();
    let foot = DVec3::new(-length / 2.0, -thick / 2.0, 0.0);
    let rotation = DQuat::from_rotation_z(angle);
    let mut scene = pile(vec![block(DVec3::new(length, thick, 0.5))], &[(0, at(-(rotation * foot), rotation))], 1.0);
    let mut wall = block(DVec3::new(0.4, 8.0, 4.0));
    wall.points.iter_mut().for_each(|p| p.x += length * cos + 0.2);
    scene.statics = vec![StaticModel { model: Model::new("wall", wall), friction: 1.0, keys: Vec::new() }];
    let center = (length * cos - thick * sin) / 2.0;
    let is_enough = |mu: f64| length * sin + mu * length * cos >= center * (mu + 1.0 / mu);
    let (mut less, mut more) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = (less + more) / 2.0;
        if is_enough(middle) { more = middle } else { less = middle }
    }
    needs_share(&whole(&scene, 1.0), more);
}

/// A prism stands on an edge's side until its center is above the edge.
#[test]
fn a_prism_tips_about_its_edge() {
    let (base, height) = (0.06, 0.2);
    let corners = [DVec2::new(-base / 2.0, 0.0), DVec2::new(base / 2.0, 0.0), DVec2::new(0.0, height)];
    let found = whole(&pile(vec![extruded(&corners, 0.1)], &[(0, Pose::IDENTITY)], 1.5), 1.5);
    let exact = (base / 2.0 / (height / 3.0)).atan().to_degrees();
    for azimuth in [90.0, 270.0] {
        tilts_at(&found, azimuth, exact);
    }
}

/// A tower of blocks, three a layer, of whose second layer only the middle one is left: it tips about that.
#[test]
fn a_tower_on_its_middle_block() {
    const LAYERS: usize = 5;
    let size = DVec3::new(0.025, 0.015, 0.075);
    let mut bodies = Vec::new();
    for layer in 0..LAYERS {
        // The blocks of the second layer are aligned with z.
        let turn = DQuat::from_rotation_y(if layer % 2 == 1 { 0.0 } else { std::f64::consts::FRAC_PI_2 });
        for k in [-1.0, 0.0, 1.0] {
            if layer != 1 || k == 0.0 {
                let height = size.y * (layer as f64 + 0.5);
                bodies.push((0, at(turn * DVec3::X * k * size.x + DVec3::Y * height, turn)));
            }
        }
    }
    let found = whole(&pile(vec![block(size)], &bodies, 1.5), 1.5);
    // All above the lower face of that block, in blocks.
    let above = 3.0 * (LAYERS - 2) as f64;
    let center = size.y * (0.5 + above * (1.0 + (LAYERS - 2) as f64 / 2.0)) / (1.0 + above);
    let exact = (size.x / 2.0 / center).atan().to_degrees();
    for azimuth in [90.0, 270.0] {
        tilts_at(&found, azimuth, exact);
    }
}

/// A half circle of voussoirs stands if a line of thrust is within each joint (Heyman 1966).
#[test]
fn an_arch_of_the_least_thickness() {
    const STONES: usize = 12;
    let step = std::f64::consts::PI / STONES as f64;
    let ends = |thick: f64| [1.0 - thick / 2.0, 1.0 + thick / 2.0];
    // From the upright radius on, clockwise; and the center of such a stone, and its weight.
    let stone = |thick: f64| {
        let [inner, outer] = ends(thick);
        let way = DVec2::new(step.sin(), step.cos());
        [DVec2::Y * inner, way * inner, way * outer, DVec2::Y * outer]
    };
    let center = |thick: f64| {
        let corners = stone(thick);
        let (mut area, mut sum) = (0.0, DVec2::ZERO);
        for (k, a) in corners.iter().enumerate() {
            let b = corners[(k + 1) % corners.len()];
            area += a.perp_dot(b);
            sum += (*a + b) * a.perp_dot(b) / 3.0;
        }
        (sum / area, area.abs())
    };
    // Thrust H at the height q / H at the crown passes a joint between its ends, if the moment of all above it about
    // the inner end, H y - q + S, is not positive, and that about the outer end is not negative.
    let shortfall = |thick: f64, thrust: f64| {
        let ([inner, outer], (middle, weight)) = (ends(thick), center(thick));
        let (mut least, mut most) = (thrust * inner, thrust * outer);
        for joint in 1..=STONES / 2 {
            let turned = |p: DVec2, k: usize| DVec2::from_angle(-step * k as f64).rotate(p);
            let moment = |x: f64| (0..joint).map(|k| weight * (x - turned(middle, k).x)).sum::<f64>();
            let [low, high] = [inner, outer].map(|radius| turned(DVec2::Y * radius, joint));
            least = least.max(thrust * low.y + moment(low.x));
            most = most.min(thrust * high.y + moment(high.x));
        }
        least - most
    };
    let stands = |thick: f64| {
        let weight = center(thick).1 * STONES as f64;
        (1..4000).any(|k| shortfall(thick, weight * f64::from(k) / 8000.0) <= 0.0)
    };
    let (mut less, mut more) = (0.01, 0.3);
    for _ in 0..30 {
        let middle = (less + more) / 2.0;
        if stands(middle) { more = middle } else { less = middle }
    }
    assert!((0.09..0.12).contains(&more), "Heyman: 0.106 for a smooth arch; {more}");
    for (factor, expected) in [(1.003, true), (0.997, false)] {
        let bodies: Vec<(usize, Pose)> = (0..STONES)
            .map(|k| (0, at(DVec3::ZERO, DQuat::from_rotation_z(step * (STONES as f64 / 2.0 - k as f64)))))
            .collect();
        let scene = pile(vec![extruded(&stone(factor * more), 0.3)], &bodies, 1.5);
        assert_eq!(analysed(&scene, 1.5).stands, expected, "{factor} of {more}");
    }
}
