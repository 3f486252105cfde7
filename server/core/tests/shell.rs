//! Piles of which only the surface is made of props: the core, the room that it leaves, and its effect on the figures.

use super::common::{cone, scene, stick};
use cairn_core::report::bake::Bake;
use cairn_core::{Error, bake, plan};
use cairn_geometry::ClosedMesh;
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::topology::inspect;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, FillMethod, Params};
use cairn_input::scene::Scene;
use cairn_prepare::container::core::Core;
use cairn_prepare::effects::{Count, EffectName};
use glam::DVec3;

fn closed(mesh: &TriMesh) -> ClosedMesh {
    ClosedMesh::new(inspect(mesh), mesh.clone())
}

/// A ball of radius 1 on the ground.
fn ball() -> TriMesh {
    const SIDES: u32 = 24;
    let point = |ring: u32, k: u32| {
        let (down, around) = (f64::from(ring) / f64::from(SIDES), f64::from(k) / f64::from(SIDES));
        let (sin, cos) = (down * std::f64::consts::PI).sin_cos();
        let (s, c) = (around * std::f64::consts::TAU).sin_cos();
        DVec3::new(sin * c, 1.0 + cos, sin * s)
    };
    let mut mesh = TriMesh::default();
    for (ring, k) in (0..SIDES).flat_map(|ring| (0..SIDES).map(move |k| (ring, k))) {
        let first = mesh.points.len() as u32;
        mesh.points.extend([point(ring, k), point(ring, k + 1), point(ring + 1, k), point(ring + 1, k + 1)]);
        let halves = [[0, 1, 2], [1, 3, 2]].map(|t: [u32; 3]| t.map(|v| first + v));
        let cap = |t: &[u32; 3]| t.map(|v| mesh.points[v as usize]);
        let has_area = |t: &&[u32; 3]| (cap(t)[1] - cap(t)[0]).cross(cap(t)[2] - cap(t)[0]).length() > 1e-9;
        let halves: Vec<_> = halves.iter().filter(has_area).copied().collect();
        mesh.triangles.extend(halves);
    }
    cairn_geometry::topology::weld(&mesh, 1e-9)
}

#[test]
fn a_core_keeps_its_distance_from_the_surface_and_reaches_into_the_ground() {
    let control = closed(&cone(2.0, 2.0));
    let (shell, d) = (0.5, 0.5);
    let core = Core::new(&control, 0.0, 0.04, shell, d).unwrap();
    assert!(core.is_convex && core.mesh.signed_volume() > 0.0, "closed, facing outward");
    let region = MeshInterior::new(&control.mesh);
    let (low, high) = core.mesh.bounds();
    assert!(low.y < 0.0, "no prop gets under it: {low}");
    // A cone whose tip is lower by the shell times the root of two.
    let wanted = 2.0 - shell * 2f64.sqrt();
    assert!((high.y - wanted).abs() < 0.1 * d, "{high}");
    for p in core.mesh.points.iter().filter(|p| p.y > 0.0) {
        // As deep as the shell, but where the cone's own underside is nearer.
        let depth = -region.signed_distance(*p);
        assert!(depth > shell - 0.1 * d || depth > p.y - 1e-9, "{p} is {depth} deep");
    }
    let volume = std::f64::consts::PI / 3.0 * wanted.powi(3);
    assert!((core.volume - volume).abs() < 0.1 * volume, "{} of {volume}", core.volume);
    let area = std::f64::consts::PI * wanted * wanted * 2f64.sqrt();
    assert!((core.area - area).abs() < 0.15 * area, "{} of {area}", core.area);
}

#[test]
fn the_core_of_a_ball_hangs_in_its_middle() {
    let control = closed(&ball());
    let core = Core::new(&control, 0.0, 0.04, 0.4, 0.3).unwrap();
    let (low, high) = core.mesh.bounds();
    let near = |a: f64, b: f64| (a - b).abs() < 0.05;
    assert!(near(low.y, 0.4) && near(high.y, 1.6) && near(high.x, 0.6), "{low} {high}");
    assert!(Core::new(&control, 0.0, 0.04, 1.1, 0.3).is_none(), "no place is so deep");
}

#[test]
fn the_core_of_a_shape_with_a_notch_has_one_too() {
    let shape = |points: &[(f64, f64)]| {
        let n = points.len() as u32;
        let at = |z: f64| points.iter().map(move |&(x, y)| DVec3::new(x, y, z));
        // The outline is a star, seen from its first corner.
        let ends = (1..n - 1).flat_map(|k| [[0, k, k + 1], [n, n + k + 1, n + k]]);
        let sides = (0..n).flat_map(|k| {
            let next = (k + 1) % n;
            [[k, n + k, next], [next, n + k, n + next]]
        });
        closed(&TriMesh { points: at(0.0).chain(at(2.0)).collect(), triangles: ends.chain(sides).collect() })
    };
    // An L.
    let notched = shape(&[(0.0, 0.0), (0.0, 3.0), (1.5, 3.0), (1.5, 1.5), (3.0, 1.5), (3.0, 0.0)]);
    let core = Core::new(&notched, 0.0, 0.04, 0.4, 0.3).unwrap();
    assert!(!core.is_convex && inspect(&core.mesh).is_watertight() && core.mesh.signed_volume() > 0.0);
    let region = MeshInterior::new(&notched.mesh);
    let depth = core.mesh.points.iter().map(|&p| -region.signed_distance(p));
    let above = core.mesh.points.iter().zip(depth).filter(|(p, _)| p.y > 0.4);
    assert!(above.clone().count() > 10 && above.into_iter().all(|(_, depth)| depth > 0.35));
}

fn draft(shell: Option<f64>) -> Params {
    let mut params = Params::new(Accuracy::Draft);
    params.fill.shell = shell;
    params
}

/// How deep the corner of a prop that is deepest in the core is there, in the first frame and the last, m.
fn depth(scene: &Scene, baked: &Bake, core: &Core) -> f64 {
    let region = MeshInterior::new(&core.mesh);
    let frames = [baked.pile.frames.first(), baked.pile.frames.last()];
    let placed = frames.into_iter().flatten().flat_map(|frame| baked.pile.bodies.iter().zip(frame));
    let corners = placed.flat_map(|(body, pose)| {
        let points = scene.props[body.prop].model.mesh.points.iter();
        points.map(|&p| pose.transform_point(p * body.scale))
    });
    corners.filter(|p| p.y > 0.0).map(|p| -region.signed_distance(p)).fold(0.0, f64::max)
}

#[test]
fn props_lie_around_the_core_and_not_in_it() {
    for method in [FillMethod::Insert, FillMethod::Pour] {
        let scene = scene(cone(1.3, 1.5), stick());
        let of = |shell| {
            let mut params = draft(shell);
            params.fill.method = method;
            // Props stand out of a natural surface: most of a thin shell is surface, and takes more of them than the
            // plan knows.
            params.fill.surface = 1.0;
            let expected = plan(&scene, &params).unwrap().expected_bodies as f64;
            (expected, bake(&scene, &params, &mut Silent).unwrap())
        };
        let ((all, full), (some, shell)) = (of(None), of(Some(0.6)));
        assert_eq!(full.report.counts[&Count::CoreTriangles], 0, "without a shell there is no core");
        assert!(shell.report.counts[&Count::CoreTriangles] > 0);
        let (bodies, fewer) = (full.report.bodies as f64, shell.report.bodies as f64);
        assert!(fewer < 0.85 * bodies, "{method:?}: {fewer} of {bodies} bodies");
        assert!((some / all - fewer / bodies).abs() < 0.2, "{method:?}: {some} of {all} expected, {fewer} of {bodies}");
        let d = shell.report.plan.prop_diameter;
        let core = Core::new(&closed(&scene.control.as_ref().unwrap().mesh), 0.0, 0.02 * 1.5, 0.6 * d, d).unwrap();
        let depth = depth(&scene, &shell, &core);
        assert!(depth < 0.1 * d, "{method:?}: {depth} m deep in the core");
        if method == FillMethod::Insert {
            let figure = |bake: &Bake, name: &str| bake.report.measures[name].unwrap();
            for name in ["shape_iou_start", "shape_iou", "height_p95_rel"] {
                let (whole, around) = (figure(&full, name), figure(&shell, name));
                assert!((whole - around).abs() < 0.12, "{name}: {around}, {whole} without a core");
            }
            let (whole, around) = (figure(&full, "fill_fraction"), figure(&shell, "fill_fraction"));
            // Seeds alone make 0.08 of a difference.
            assert!((whole - around).abs() < 0.16, "the shell is as full: {around}, {whole} without a core");
            assert_eq!(figure(&shell, "hanging"), 0.0, "bodies on the core do not hang");
        }
    }
}

#[test]
fn a_shell_of_no_use_is_reported() {
    let scene = scene(cone(1.2, 1.6), stick());
    let thin = plan(&scene, &draft(Some(0.1))).unwrap_err();
    let Error::Invalid(problems) = thin else { panic!("{thin}") };
    assert_eq!(problems.len(), 1);
    assert_eq!(problems[0].field, "fill.shell");
    assert!(problems[0].text.contains("stick is 0.060 m thick") && problems[0].text.contains("give at least 0.12"));
    let deep = plan(&scene, &draft(Some(5.0))).unwrap();
    let warned = deep.warnings.iter().filter(|text| text.contains("fill.shell")).count();
    assert_eq!(warned, 1, "{:?}", deep.warnings);
    assert!(!deep.effects.iter().any(|effect| effect.name == EffectName::Core && effect.on));
    assert_eq!(deep.expected_bodies, plan(&scene, &draft(None)).unwrap().expected_bodies);
}
