//! `hanging` of a report, against a check of its own: final poses and meshes alone, touching boxes by separating axes,
//! chains by Warshall's closure. The product takes the engine's contacts and spreads from the ground upward.

use super::common::{block, cone, scene, stick};
use cairn_core::bake;
use cairn_engine::shape;
use cairn_engine::world::{Insertion, Role, Units, World};
use cairn_geometry::contact::{self, Bearing, CARRYING_GAP};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, GlueMode, Params};
use cairn_input::scene::Scene;
use cairn_prepare::check;
use cairn_prepare::effects::Count;
use glam::DVec3;

/// What counts as carried, doubtful contacts left out or let in.
#[derive(Clone, Copy)]
struct Measure {
    /// Widest gap, m.
    gap: f64,
    /// Least rise of the direction from the lower body to the upper one.
    rise: f64,
    /// Directions whose gaps differ by less are all candidates, m.
    tie: f64,
}

struct Cuboid {
    centre: DVec3,
    axes: [DVec3; 3],
    half: DVec3,
}

impl Cuboid {
    /// Of a prop that is a box along its own axes.
    fn new(mesh: &TriMesh, pose: &Pose) -> Cuboid {
        let (lo, hi) = mesh.bounds();
        let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.rotation * axis);
        Cuboid { centre: pose.transform_point((lo + hi) / 2.0), axes, half: (hi - lo) / 2.0 }
    }

    /// Half of its extent along a direction.
    fn reach(&self, along: DVec3) -> f64 {
        (0..3).map(|k| self.half[k] * self.axes[k].dot(along).abs()).sum()
    }
}

/// The fifteen directions that can part two boxes, from `b` to `a`, with the gap along each.
fn gaps(a: &Cuboid, b: &Cuboid) -> Vec<(f64, DVec3)> {
    let crossed = a.axes.iter().flat_map(|u| b.axes.iter().map(|v| u.cross(*v)));
    let all = a.axes.iter().chain(&b.axes).copied().chain(crossed).filter_map(|axis| axis.try_normalize());
    let between = a.centre - b.centre;
    all.map(|axis| if axis.dot(between) < 0.0 { -axis } else { axis })
        .map(|axis| (axis.dot(between) - a.reach(axis) - b.reach(axis), axis))
        .collect()
}

/// Whether `a` rests on `b`.
fn rests(a: &Cuboid, b: &Cuboid, by: Measure) -> bool {
    let gaps = gaps(a, b);
    let widest = gaps.iter().map(|g| g.0).fold(f64::NEG_INFINITY, f64::max);
    widest <= by.gap && gaps.iter().any(|(gap, axis)| *gap >= widest - by.tie && axis.y > by.rise)
}

/// Those of these boxes that no chain joins to the ground at height 0.
fn hanging(boxes: &[Cuboid], by: Measure) -> Vec<usize> {
    let n = boxes.len();
    let is_down = |b: &Cuboid| b.centre.y - b.reach(DVec3::Y) <= by.gap;
    // leads[a][b]: some chain leads from a down to b.
    let mut leads: Vec<Vec<bool>> =
        (0..n).map(|a| (0..n).map(|b| a == b || rests(&boxes[a], &boxes[b], by)).collect()).collect();
    for over in 0..n {
        for a in 0..n {
            if leads[a][over] {
                let through = leads[over].clone();
                leads[a].iter_mut().zip(through).for_each(|(known, more)| *known |= more);
            }
        }
    }
    (0..n).filter(|&a| !(0..n).any(|b| leads[a][b] && is_down(&boxes[b]))).collect()
}

/// The least and the most that may hang, by this check; `diameter`: d, m.
fn bounds(mesh: &TriMesh, poses: &[Pose], diameter: f64) -> (usize, usize) {
    let boxes: Vec<Cuboid> = poses.iter().map(|pose| Cuboid::new(mesh, pose)).collect();
    let gap = CARRYING_GAP * diameter;
    let generous = Measure { gap: 1.15 * gap, rise: 0.0075, tie: gap };
    let strict = Measure { gap: 0.87 * gap, rise: 0.0135, tie: 0.0 };
    (hanging(&boxes, generous).len(), hanging(&boxes, strict).len())
}

/// How many of these bodies hang by the product's word, all of them taken for resting.
fn count_hanging(scene: &Scene, params: &Params, poses: &[Pose]) -> usize {
    let checked = check::run(scene, params).unwrap();
    let shape = &shape::run(scene, params, &checked.sizes, &mut Silent).unwrap()[0];
    let units = Units::new(checked.diameter, shape.mass, params.gravity);
    let mut world = World::new(units, &params.physics, shape.thickness() / units.length, false);
    world.add_ground(0.0, params.ground_friction);
    for pose in poses {
        let pose = units.pose_to_engine(&shape.body_pose(pose, 1.0));
        let id = world.insert(shape, &Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 });
        world.set_role(id.unwrap(), Role::Waiting);
    }
    // What waits does not move; the engine has seen it after a step.
    world.step();
    let touches = world.contact_pairs(0.2);
    let contacts: Vec<Bearing> = touches.iter().flat_map(|t| t.bearings(&world)).collect();
    contact::hanging(&vec![true; poses.len()], &contacts, 1.0).len()
}

/// Whether a body of this number and place is left.
type Stays<'a> = &'a dyn Fn(usize, &Pose) -> bool;

#[test]
fn what_hangs_is_what_another_way_finds() {
    let (mut doubt, mut bodies, mut exact, mut found) = (0, 0, 0, Vec::new());
    for seed in 1..=6 {
        let scene = scene(cone(0.6, 1.2), stick());
        let mesh = &scene.props[0].model.mesh;
        // As full as a pile usually is: what lies loosely hangs by a hair.
        let mut params = Params { seed, ..Params::new(Accuracy::Standard) };
        params.fill.surface = 1.0;
        // Glue would carry what hangs.
        params.glue.mode = GlueMode::Natural;
        let pile = bake(&scene, &params, &mut Silent).unwrap();
        let (poses, diameter) = (pile.pile.frames.last().unwrap(), pile.report.plan.prop_diameter);
        let (least, most) = bounds(mesh, poses, diameter);
        let reported = pile.report.measures["hanging"].unwrap() as usize;
        assert!((least..=most).contains(&reported), "seed {seed}: {reported} hang, and not {least} to {most}");
        assert!(100 * least <= poses.len(), "a pile at rest, seed {seed}: {least} hang");

        // Parts of the pile are taken out from under the others.
        let top = poses.iter().map(|pose| pose.translation.y).fold(0.0, f64::max);
        let stays: [Stays; 6] = [
            &|_, _| true,
            &|_, pose| pose.translation.y > 0.15 * top,
            &|_, pose| pose.translation.y > 0.15 * top || pose.translation.x > 0.0,
            &|k, _| k % 3 != 0,
            &|k, _| k % 2 != 0,
            &|k, _| k % 3 == 0,
        ];
        for (part, stays) in stays.iter().enumerate() {
            let left: Vec<Pose> =
                poses.iter().enumerate().filter(|(k, pose)| stays(*k, pose)).map(|(_, pose)| *pose).collect();
            let (least, most) = bounds(mesh, &left, diameter);
            let count = count_hanging(&scene, &params, &left);
            println!("seed {seed}, part {part}: {count} of {} hang; {least} to {most}", left.len());
            assert!(
                (least..=most).contains(&count),
                "seed {seed}, part {part}: {count} hang, and not {least} to {most}"
            );
            doubt += most - least;
            exact += usize::from(most == least);
            bodies += left.len();
            found.push((count, left.len()));
        }
    }
    // The check is worth something: it doubts few bodies, and none in most cases; and in many cases some bodies hang
    // while others do not.
    assert!(20 * doubt <= bodies, "{doubt} of {bodies} in doubt");
    assert!(2 * exact >= found.len(), "without doubt: {exact} of {}", found.len());
    assert!(found.iter().filter(|(count, all)| (1..*all).contains(count)).count() >= 6, "{found:?}");
}

/// Towers and what stands on its tip come down. A body waits for its layer only while something carries it.
#[test]
fn no_body_waits_in_the_air() {
    let mut tip = cone(0.5, 1.2);
    tip.points.iter_mut().for_each(|p| p.y = 1.2 - p.y);
    tip.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let brick = block(DVec3::new(0.2, 0.06, 0.1));
    for (name, control) in [("tower", block(DVec3::new(0.5, 1.6, 0.5))), ("tip", tip)] {
        let scene = scene(control, brick.clone());
        let mut params = Params::new(Accuracy::Preview);
        params.glue.mode = GlueMode::Natural;
        let bake = bake(&scene, &params, &mut Silent).unwrap();
        assert!(bake.report.counts[&Count::ReleasedEarly] > 5, "{name}: {:?}", bake.report.counts);
        assert_eq!(bake.report.measures["hanging_frames"], Some(0.0), "{name}");
        // The same from frames and meshes alone.
        let thickness = 0.06;
        let wide = Measure { gap: 0.2 * thickness, rise: 0.005, tie: 0.1 * thickness };
        let frames = &bake.pile.frames;
        let hangs = |frame: usize| {
            let boxes: Vec<Cuboid> = frames[frame].iter().map(|pose| Cuboid::new(&brick, pose)).collect();
            let rests = |k: &usize| frames[frame][*k].translation.distance(frames[frame - 1][*k].translation) < 1e-5;
            hanging(&boxes, wide).into_iter().filter(rests).collect::<Vec<_>>()
        };
        let mut before = Vec::new();
        for frame in 1..frames.len() {
            let now = hangs(frame);
            let stay: Vec<&usize> = now.iter().filter(|k| before.contains(*k)).collect();
            assert!(stay.is_empty(), "{name}, frame {frame}: bodies {stay:?} of {} stand in the air", frames[0].len());
            before = now;
        }
    }
}
