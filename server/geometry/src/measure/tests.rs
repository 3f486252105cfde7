//! Known answers, with shapes simple enough to work them out by hand.

use super::*;
use crate::interior::MeshInterior;
use crate::testing::says_only;
use glam::{DAffine3, DQuat, DVec3};
use std::f64::consts::PI;

/// A box between two corners.
fn cuboid(lo: [f64; 3], hi: [f64; 3]) -> TriMesh {
    let points = (0..8).map(|i| DVec3::from_array([0, 1, 2].map(|a| if i >> a & 1 == 1 { hi[a] } else { lo[a] })));
    #[rustfmt::skip]
    let triangles = vec![
        [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6],
    ];
    TriMesh { points: points.collect(), triangles }
}

/// A body of revolution around Y through the profile's (radius, height) points, from a point on the axis to another.
fn revolved(profile: &[(f64, f64)], sides: u32) -> TriMesh {
    let mut mesh = TriMesh::default();
    for &(r, y) in profile {
        for k in 0..sides {
            let turn = k as f64 / sides as f64 * 2.0 * PI;
            mesh.points.push(DVec3::new(r * turn.cos(), y, r * turn.sin()));
        }
    }
    for ring in 0..profile.len() as u32 - 1 {
        for k in 0..sides {
            let [a, b] = [ring * sides + k, ring * sides + (k + 1) % sides];
            mesh.triangles.extend([[a, a + sides, b], [b, a + sides, b + sides]]);
        }
    }
    mesh
}

fn cone(radius: f64, height: f64) -> TriMesh {
    revolved(&[(0.0, 0.0), (radius, 0.0), (0.0, height)], 64)
}

fn dome(radius: f64) -> TriMesh {
    let arc = (0..=24).map(|k| k as f64 / 24.0 * PI / 2.0).map(|t| (radius * t.cos(), radius * t.sin()));
    revolved(&std::iter::once((0.0, 0.0)).chain(arc).collect::<Vec<_>>(), 64)
}

fn torus(major: f64, minor: f64) -> TriMesh {
    let arc = (0..=32).map(|k| k as f64 / 32.0 * 2.0 * PI);
    revolved(&arc.map(|t| (major + minor * t.cos(), minor * t.sin())).collect::<Vec<_>>(), 64)
}

/// Two overlapping boxes.
fn letter_t() -> TriMesh {
    let mut mesh = cuboid([-0.5, 0.0, -0.5], [0.5, 3.5, 0.5]);
    mesh.append(&cuboid([-2.0, 3.0, -0.5], [2.0, 4.0, 0.5]));
    mesh
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose { translation: DVec3::new(x, y, z), rotation: DQuat::IDENTITY }
}

fn measured(control: &TriMesh, props: &[TriMesh], bodies: &[(usize, f64, Pose)]) -> ShapeMeasures {
    seen(control, props, bodies).0
}

/// Shape and pictures.
fn seen(control: &TriMesh, props: &[TriMesh], bodies: &[(usize, f64, Pose)]) -> (ShapeMeasures, PictureMeasures) {
    let region = MeshInterior::new(control);
    let pile = Instances { props, bodies };
    let measurer = ShapeMeasurer::new(control, &region, &pile);
    (measurer.measure(&pile), measurer.look(&pile))
}

/// Bricks of 0.5 x 0.25 x 0.25 that fill a box of 3 x 2 x 1 exactly, every second course shifted.
fn wall() -> (TriMesh, Vec<TriMesh>, Vec<(usize, f64, Pose)>) {
    let props = vec![cuboid([0.0; 3], [0.5, 0.25, 0.25]), cuboid([0.0; 3], [0.25; 3])];
    let mut bodies = Vec::new();
    for (course, depth) in (0..8).flat_map(|c| (0..4).map(move |d| (c, d))) {
        let (y, z) = (course as f64 * 0.25, depth as f64 * 0.25);
        if (course + depth) % 2 == 0 {
            bodies.extend((0..6).map(|k| (0, 1.0, at(k as f64 * 0.5, y, z))));
        } else {
            bodies.extend((0..5).map(|k| (0, 1.0, at(k as f64 * 0.5 + 0.25, y, z))));
            bodies.extend([(1, 1.0, at(0.0, y, z)), (1, 1.0, at(2.75, y, z))]);
        }
    }
    (cuboid([0.0; 3], [3.0, 2.0, 1.0]), props, bodies)
}

#[test]
fn a_brick_wall_that_fills_a_box_is_the_box() {
    let (control, props, bodies) = wall();
    let (m, look) = seen(&control, &props, &bodies);
    assert!(m.shape_iou.value >= 0.98 && !m.shape_iou.capped, "{:?}", m.shape_iou);
    assert!((m.fill_fraction - 1.0).abs() < 0.01, "{}", m.fill_fraction);
    assert!((m.height_p95_rel - 0.95).abs() < 0.01 && (m.height_p95_rel_solid - 0.95).abs() < 0.01);
    assert!(m.inside_fraction == 1.0 && m.protrusion_rel < 1e-9 && look.height_rms_rel < 1e-6);
    assert!(look.silhouette_iou > 0.99, "{}", look.silhouette_iou);
    assert!(m.caveats(|_| "prop").is_empty(), "{:?}", m.caveats(|_| "prop"));
}

#[test]
fn gaps_between_props_are_not_missing_shape() {
    let (control, props, mut bodies) = wall();
    bodies.iter_mut().for_each(|b| b.1 = 0.9);
    let m = measured(&control, &props, &bodies);
    assert!(m.shape_iou.value > 0.9, "{:?}", m.shape_iou);
    assert!((m.fill_fraction - 0.729).abs() < 0.01, "{}", m.fill_fraction);
}

#[test]
fn a_solid_control_mesh_is_itself() {
    let pebble = cuboid([-0.08; 3], [0.08; 3]);
    for (name, control) in
        [("cone", cone(1.0, 2.8)), ("dome", dome(1.0)), ("T", letter_t()), ("torus", torus(1.0, 0.4))]
    {
        // Both as the measurer's own reference, and as a pile of one body that is the control mesh.
        let props = [pebble.clone(), control.clone()];
        let region = MeshInterior::new(&control);
        let pebbles = [(0, 1.0, Pose::IDENTITY), (0, 1.0, Pose::IDENTITY), (1, 1.0, Pose::IDENTITY)];
        let measurer = ShapeMeasurer::new(&control, &region, &Instances { props: &props, bodies: &pebbles });
        let pile = Instances { props: &props, bodies: &pebbles[2..] };
        let (m, look) = (measurer.measure(&pile), measurer.look(&pile));
        assert!(m.shape_iou.solid >= 0.98 && m.shape_iou.value >= 0.98, "{name} {:?}", m.shape_iou);
        assert!((m.height_p95_rel - m.height_p95_rel_solid).abs() < 0.03, "{name}");
        assert!(m.protrusion_rel < 1e-6 && look.height_rms_rel < 1e-6 && look.silhouette_iou == 1.0, "{name}");
        assert!((m.fill_fraction - 1.0).abs() < 0.01, "{name} {}", m.fill_fraction);
        // A torus has its centre of mass in its hole.
        assert_eq!(m.inside_fraction, if name == "torus" { 0.0 } else { 1.0 }, "{name}");
    }
}

#[test]
fn a_box_shifted_by_half_has_a_third() {
    let props = [cuboid([0.0; 3], [1.0; 3]), cuboid([0.0; 3], [0.1; 3])];
    let region = MeshInterior::new(&props[0]);
    let small = [(0, 1.0, at(0.5, 0.0, 0.0)), (1, 1.0, Pose::IDENTITY), (1, 1.0, Pose::IDENTITY)];
    let measurer = ShapeMeasurer::new(&props[0], &region, &Instances { props: &props, bodies: &small });
    let pile = Instances { props: &props, bodies: &small[..1] };
    let (m, look) = (measurer.measure(&pile), measurer.look(&pile));
    assert!((m.shape_iou.value - 1.0 / 3.0).abs() < 0.01, "{:?}", m.shape_iou);
    assert!((m.fill_fraction - 0.5).abs() < 0.03, "{}", m.fill_fraction);
    assert!((m.protrusion_rel * m.prop_diameter - 0.5).abs() < 1e-9);
    // From azimuth a the widths overlap in all but |cos a| / 2.
    let wide = |a: f64| a.sin().abs() + a.cos().abs();
    let iou = |a: f64| (wide(a) - a.cos().abs() / 2.0) / (wide(a) + a.cos().abs() / 2.0);
    let expected: f64 = (0..8).map(|k| iou(k as f64 * PI / 8.0)).sum::<f64>() / 8.0;
    assert!((look.silhouette_iou - expected).abs() < 0.01, "{} {expected}", look.silhouette_iou);
    // Half of the footprint is bare: sqrt(1/2) of the height.
    assert!((look.height_rms_rel * m.prop_diameter - 0.5f64.sqrt()).abs() < 0.02);
}

#[test]
fn a_collapsed_cone_is_seen_by_every_figure() {
    let props = [cone(2.0, 0.7), cuboid([0.0; 3], [0.2; 3])];
    let control = cone(1.0, 2.8);
    let region = MeshInterior::new(&control);
    let bodies = [(0, 1.0, Pose::IDENTITY), (1, 1.0, Pose::IDENTITY), (1, 1.0, Pose::IDENTITY)];
    let measurer = ShapeMeasurer::new(&control, &region, &Instances { props: &props, bodies: &bodies });
    let pile = Instances { props: &props, bodies: &bodies[..1] };
    let (m, look) = (measurer.measure(&pile), measurer.look(&pile));
    // The silhouettes are triangles of half width 1 and 2. Below a height of 0.4, where both have the half width 6/7,
    // the control mesh's is the narrower: (1 + 6/7) * 0.4 + 6/7 * 0.3 = 1 in common, of areas 2.8 and 1.4.
    let expected = 1.0 / (2.8 + 1.4 - 1.0);
    assert!((look.silhouette_iou - expected).abs() < 0.01, "{} {expected}", look.silhouette_iou);
    assert!(m.height_p95_rel < 0.25 && m.shape_iou.value < 0.4);
    assert!(m.height_p95_rel_solid > 0.5);
    assert_eq!(m.inside_fraction, 1.0);
}

#[test]
fn bodies_that_flew_away_count_by_volume() {
    let (control, props, mut bodies) = wall();
    let n = bodies.len();
    bodies.truncate(n / 2);
    for k in 0..bodies.len() {
        bodies.push((bodies[k].0, 1.0, at(1e7 + k as f64, 1e9, 0.0)));
    }
    let m = measured(&control, &props, &bodies);
    assert_eq!(m.shape_iou.beyond, n / 2);
    assert!(m.shape_iou.value < 0.36 && m.shape_iou.value > 0.25, "{:?}", m.shape_iou);
    assert!((m.inside_fraction - 0.5).abs() < 0.01 && m.protrusion_rel > 1e8);
    assert_eq!(m.caveats(|_| "prop").len(), 1);
}

#[test]
fn a_capped_grid_says_so() {
    // A sheet a thousandth as thick as wide: the wanted cell would need 10^12 of them.
    let props = [cuboid([-0.5, 0.0, -0.5], [0.5, 0.001, 0.5])];
    let bodies: Vec<_> = (0..200).map(|k| (0, 1.0, at((k % 5) as f64 - 2.0, k as f64 * 0.02, 0.0))).collect();
    let m = measured(&cuboid([-3.0, 0.0, -3.0], [3.0, 4.0, 3.0]), &props, &bodies);
    assert!(m.shape_iou.capped && (m.shape_iou.wanted_cell - 0.0005).abs() < 1e-9);
    assert!(m.caveats(|_| "prop")[0].contains("shape_iou"));
    assert!(m.shape_iou.solid >= 0.98, "{:?}", m.shape_iou);
}

#[test]
fn scale_and_a_turn_change_nothing() {
    let (control, props, mut bodies) = wall();
    bodies.truncate(bodies.len() - 50);
    let reference = measured(&control, &props, &bodies);
    for scale in [1e-3, 1e3] {
        let map = DAffine3::from_scale(DVec3::splat(scale));
        let scaled: Vec<_> = bodies
            .iter()
            .map(|&(p, s, pose)| (p, s * scale, Pose { translation: pose.translation * scale, ..pose }))
            .collect();
        same(&measured(&control.transformed(&map), &props, &scaled), &reference, 0.002);
    }
    // Everything turned about Y by a quarter, and the props authored in another frame.
    let turn = DQuat::from_rotation_y(PI / 2.0);
    let frame = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, -1.1);
    let props: Vec<_> = props.iter().map(|p| p.transformed(&DAffine3::from_quat(frame))).collect();
    let turned: Vec<_> = bodies
        .iter()
        .map(|&(p, s, pose)| (p, s, Pose { translation: turn * pose.translation, rotation: turn * frame.inverse() }))
        .collect();
    same(&measured(&control.transformed(&DAffine3::from_quat(turn)), &props, &turned), &reference, 0.02);
}

fn same(a: &ShapeMeasures, b: &ShapeMeasures, tolerance: f64) {
    for ((name, a), (_, b)) in a.figures().into_iter().zip(b.figures()).filter(|f| f.0.0 != "prop_diameter") {
        assert!((a - b).abs() < tolerance, "{name}: {a} {b}");
    }
}

#[test]
fn open_and_flat_props_have_a_stated_solid() {
    let mut bucket = cuboid([0.0; 3], [1.0; 3]);
    bucket.triangles.truncate(10);
    let sheet = TriMesh { points: vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 0.0, 1.0)], triangles: vec![[0, 1, 2]] };
    let mut cross = cuboid([0.0, 0.0, 0.5], [1.0, 1.0, 0.5]);
    cross.append(&cuboid([0.5, 0.0, 0.0], [0.5, 1.0, 1.0]));
    let props = [bucket, sheet, cross, cuboid([0.0; 3], [1.0; 3])];
    let bodies: Vec<_> = (0..3).map(|i| (i, 1.0, at(i as f64 * 2.0, 0.0, 0.0))).collect();
    let m = measured(&cuboid([0.0; 3], [6.0, 3.0, 3.0]), &props, &bodies);
    let solids: Vec<_> = m.solids.iter().flatten().map(|s| s.source).collect();
    assert_eq!(solids, [SolidSource::Capped, SolidSource::Plate, SolidSource::Hull]);
    assert!(m.solids[3].is_none());
    let volume = |i: usize| m.solids[i].unwrap().volume;
    assert!(volume(0) > 0.7 && volume(0) < 1.01, "{}", volume(0));
    assert!(volume(1) > 0.0 && volume(1) < 0.05, "{}", volume(1));
    // The hull of two crossed squares is a prism over a square of half the area.
    assert!((volume(2) - 0.5).abs() < 0.01, "{}", volume(2));
    assert_eq!(m.caveats(|_| "prop").len(), 2, "{:?}", m.caveats(|_| "prop"));
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let (control, props, bodies) = wall();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| measured(&control, &props, &bodies))
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(3));
}

#[test]
fn kept_shape_is_a_ratio() {
    let (control, props, bodies) = wall();
    let region = MeshInterior::new(&control);
    let measurer = ShapeMeasurer::new(&control, &region, &Instances { props: &props, bodies: &bodies });
    let start = measurer.measure(&Instances { props: &props, bodies: &bodies });
    let end = measurer.measure(&Instances { props: &props, bodies: &bodies[..bodies.len() / 2] });
    let kept = kept_shape(&start, &end.shape_iou).unwrap();
    assert!((kept - 0.5).abs() < 0.02, "{kept}");
    let centres = measurer.centres(&Instances { props: &props, bodies: &bodies[..1] });
    assert!(centres[0].distance(DVec3::new(0.25, 0.125, 0.125)) < 1e-9);
}

#[test]
fn sizes_of_a_prop() {
    let turn = DAffine3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 1.0, 0.2));
    let stick = cuboid([-0.5, -0.05, -0.05], [0.5, 0.05, 0.05]).transformed(&turn);
    assert!((smallest_extent(&stick) - 0.1).abs() < 1e-9);
    let (centre, radius) = bounding_sphere(&stick);
    assert!(centre.length() < 1e-9 && (radius - (0.25f64 + 2.0 * 0.0025).sqrt()).abs() < 1e-9);
    let (_, radius) = bounding_sphere(&torus(1.0, 0.4));
    assert!((radius - 1.4).abs() < 1e-6, "{radius}");
    assert!((smallest_extent(&torus(1.0, 0.4)) - 0.8).abs() < 0.01);
    // A regular tetrahedron is thinnest between two opposite edges.
    let points = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(DVec3::from_array);
    let tetrahedron = TriMesh { points: points.into(), triangles: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] };
    assert!((smallest_extent(&tetrahedron) - 2.0).abs() < 0.02);
    assert!((bounding_sphere(&tetrahedron).1 - 3f64.sqrt()).abs() < 1e-9);
}

#[test]
fn each_caveat_has_its_cause() {
    let control = cuboid([0.0; 3], [1.0; 3]);
    let plain = measured(&control, std::slice::from_ref(&control), &[(0, 1.0, at(0.0, 0.0, 0.0))]);
    let with = |change: &dyn Fn(&mut ShapeMeasures)| {
        let mut measures = plain.clone();
        change(&mut measures);
        measures
    };
    let of = |source: SolidSource| with(&|m| m.solids[0].as_mut().unwrap().source = source);
    for (case, measures, words) in [
        ("when all is as defined", plain.clone(), &[] as &[&str]),
        (
            "when the grid is capped",
            with(&|m| m.shape_iou = ShapeIou { capped: true, cell: 0.5, wanted_cell: 0.1, ..m.shape_iou }),
            &["shape_iou was taken on cells of 5.000e-1 m instead of 1.000e-1 m, to bound memory and time"],
        ),
        (
            "when bodies rolled away",
            with(&|m| m.shape_iou.beyond = 2),
            &["2 bodies lie beyond the grid of shape_iou: counted by volume"],
        ),
        ("when a prop is open", of(SolidSource::Capped), &[]),
        (
            "when a prop is of sheets",
            of(SolidSource::Hull),
            &["prop: the mesh encloses next to no volume: its convex hull is measured instead"],
        ),
        (
            "when a prop is a sheet",
            of(SolidSource::Plate),
            &["prop: the mesh is flat: a plate of 2 % of its diameter is measured instead"],
        ),
        (
            "when a prop is fine",
            with(&|m| m.solids[0].as_mut().unwrap().capped = true),
            &["prop: the prop is too fine for its grid: its cells are coarser than wanted"],
        ),
    ] {
        says_only(case, &measures.caveats(|_| "prop"), words);
    }
}
