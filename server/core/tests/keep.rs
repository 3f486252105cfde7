//! A bake from an earlier one: bodies that nothing new is near keep every bit.

use super::common::{block, scene};
use cairn_core::bake;
use cairn_core::report::bake::{Bake, BakedBody, BakedGlueDot};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::earlier::{EarlierBody, EarlierDot, EarlierPile, EarlierProp};
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, GlueMode, Params, Switch};
use cairn_input::scene::{Model, Prop, Scene, StaticModel};
use cairn_prepare::effects::Count;
use glam::DVec3;

/// The diameter of a brick is 0.124 m: the beam is as long as 13.
const BEAM: DVec3 = DVec3::new(1.6, 0.24, 0.24);
const BRICK: DVec3 = DVec3::new(0.1, 0.05, 0.054);
const DIAMETER: f64 = 0.124;

fn at(mut mesh: TriMesh, by: DVec3) -> TriMesh {
    mesh.points.iter_mut().for_each(|p| *p += by);
    mesh
}

/// A beam on the ground, and further boxes: their middles and edges.
fn shape(more: &[(DVec3, DVec3)]) -> TriMesh {
    let mut shape = at(block(BEAM), DVec3::Y * BEAM.y / 2.0);
    more.iter().for_each(|&(middle, size)| shape.append(&at(block(size), middle)));
    shape
}

/// A limb that stands at the right end.
fn limb(height: f64, width: f64) -> (DVec3, DVec3) {
    (DVec3::new(0.66, BEAM.y - 0.02 + height / 2.0, 0.0), DVec3::new(width, height, width))
}

fn bricks(shape: TriMesh) -> Scene {
    scene(shape, block(BRICK))
}

fn glued() -> Params {
    let mut params = Params::new(Accuracy::Draft);
    params.glue.mode = GlueMode::AsModelled;
    params
}

fn baked(scene: &Scene, params: &Params) -> Bake {
    bake(scene, params, &mut Silent).unwrap()
}

/// The result of a bake as a later one reads it.
fn earlier(bake: &Bake, scene: &Scene, reach: f64) -> EarlierPile {
    let frames = &bake.pile.frames;
    let body = |(id, body): (usize, &BakedBody)| EarlierBody {
        prop: EarlierProp::Same(body.prop),
        number: body.number,
        scale: body.scale,
        first: frames[0][id],
        last: frames.last().unwrap()[id],
    };
    let mut scenery = TriMesh::default();
    scene.statics.iter().for_each(|piece| scenery.append(&piece.model.mesh));
    EarlierPile {
        name: "earlier.glb".into(),
        bodies: bake.pile.bodies[..bake.pile.filled].iter().enumerate().map(body).collect(),
        dots: dots(bake),
        shape: scene.control.as_ref().unwrap().mesh.clone(),
        scenery,
        ground: bake.pile.world.ground,
        refills: false,
        reach,
    }
}

fn dots(bake: &Bake) -> Vec<EarlierDot> {
    let all = bake.pile.glue.iter().flat_map(|glue| &glue.dots);
    let dot = |dot: &BakedGlueDot| EarlierDot {
        body: dot.body,
        other: dot.other,
        force: dot.force.into(),
        moment: dot.moment.into(),
    };
    all.map(dot).collect()
}

fn count(bake: &Bake, count: Count) -> usize {
    bake.report.counts[&count] as usize
}

fn bits(pose: &Pose) -> [u64; 7] {
    let [x, y, z] = pose.translation.to_array();
    let [i, j, k, w] = pose.rotation.to_array();
    [x, y, z, i, j, k, w].map(f64::to_bits)
}

/// Of the earlier bodies of which `is_far` holds, those that are there again with every bit, and all.
fn kept(old: &EarlierPile, new: &Bake, first: bool, is_far: impl Fn(DVec3) -> bool) -> (usize, usize) {
    let frames = &new.pile.frames;
    let far: Vec<&EarlierBody> = old.bodies.iter().filter(|body| is_far(body.last.translation)).collect();
    let is_there = |body: &&&EarlierBody| {
        let EarlierProp::Same(prop) = body.prop else { return false };
        let same = |(id, other): (usize, &BakedBody)| {
            let (now, then) = if first { (&frames[0], &body.first) } else { (frames.last().unwrap(), &body.last) };
            (other.prop, other.number, other.scale.to_bits()) == (prop, body.number, body.scale.to_bits())
                && bits(&now[id]) == bits(then)
        };
        new.pile.bodies.iter().enumerate().any(same)
    };
    (far.iter().filter(is_there).count(), far.len())
}

/// All earlier bodies are kept, moved or gone, all bodies of the fill kept, moved or new, and no name is there twice.
fn check_counts(old: &EarlierPile, new: &Bake) {
    let [kept, moved, added, gone] =
        [Count::BodiesKept, Count::BodiesMoved, Count::BodiesNew, Count::BodiesGone].map(|of| count(new, of));
    assert_eq!(kept + moved + gone, old.bodies.len(), "{kept} kept, {moved} moved, {gone} gone");
    assert_eq!(kept + moved + added, new.pile.filled, "{kept} kept, {moved} moved, {added} new");
    let mut numbers: Vec<usize> = new.pile.bodies.iter().map(|body| body.number).collect();
    numbers.sort_unstable();
    numbers.dedup();
    assert_eq!(numbers.len(), new.pile.bodies.len());
}

/// Bakes one scene, and another one from it. Far from x = 0.66 m, where they differ, at least 95 % keep every bit.
fn changed(before: &Scene, after: &Scene, reach: f64) -> (EarlierPile, Bake) {
    let old = earlier(&baked(before, &glued()), before, reach);
    let new = baked(&Scene { earlier: Some(old.clone()), ..after.clone() }, &glued());
    check_counts(&old, &new);
    let far = |p: DVec3| p.x < 0.66 - 0.15 - 3.0 * DIAMETER;
    let (there, all) = kept(&old, &new, false, far);
    assert!(all > 40 && there as f64 >= 0.95 * all as f64, "{there} of {all} bodies are kept");
    (old, new)
}

#[test]
fn a_limb_is_added_removed_and_scaled() {
    let [plain, short, large] = [vec![], vec![limb(0.2, 0.2)], vec![limb(0.3, 0.3)]].map(|more| bricks(shape(&more)));
    for (case, before, after) in [("added", &plain, &short), ("removed", &short, &plain), ("scaled", &short, &large)] {
        let (old, new) = changed(before, after, 1.0);
        let high = |poses: &mut dyn Iterator<Item = DVec3>| poses.filter(|p| p.y > BEAM.y + 0.02).count();
        let was = high(&mut old.bodies.iter().map(|body| body.last.translation));
        let is = high(&mut new.pile.frames.last().unwrap().iter().map(|pose| pose.translation));
        match case {
            "added" => assert!(was == 0 && is > 5, "{is} bodies in the limb"),
            "removed" => assert!(was > 5 && is == 0, "{is} bodies where the limb was"),
            _ => assert!(is > 2 * was, "{is} bodies in the larger limb, {was} before"),
        }
    }
}

/// With a wider reach less is kept; without a change, all is.
#[test]
fn the_reach_says_how_much_is_exchanged() {
    let (plain, limbed) = (bricks(shape(&[])), bricks(shape(&[limb(0.2, 0.2)])));
    let (_, narrow) = changed(&plain, &limbed, 1.0);
    let (_, wide) = changed(&plain, &limbed, 3.0);
    let [narrow, wide] = [narrow, wide].map(|bake| count(&bake, Count::BodiesGone));
    assert!(narrow < wide, "{narrow} gone, {wide} with a wide reach");
    let (old, same) = changed(&plain, &plain, 1.0);
    let kept = count(&same, Count::BodiesKept);
    assert!(kept as f64 >= 0.95 * old.bodies.len() as f64, "{kept} of {} kept", old.bodies.len());
    assert_eq!((count(&same, Count::BodiesGone), count(&same, Count::BodiesNew)), (0, 0));
}

/// A bin at the right end is moved by half of its width.
#[test]
fn what_is_near_moved_scenery_is_exchanged() {
    let with_bin = |x: f64| {
        let bin = Model::new("bin", at(block(DVec3::new(0.3, 0.3, 0.4)), DVec3::new(x, 0.15, 0.0)));
        let statics = vec![StaticModel { model: bin, friction: 0.7, keys: Vec::new() }];
        Scene { statics, ..bricks(shape(&[])) }
    };
    let (old, new) = changed(&with_bin(0.9), &with_bin(0.75), 1.0);
    let inside = |p: DVec3| (p.x - 0.75).abs() < 0.14;
    let last = new.pile.frames.last().unwrap();
    assert!(old.bodies.iter().any(|body| inside(body.last.translation)));
    assert!(!last.iter().any(|pose| inside(pose.translation) && pose.translation.y < 0.28));
}

#[test]
fn a_replaced_prop_is_exchanged_and_the_other_stays() {
    let mut before = bricks(shape(&[]));
    let cube = |edge: f64| Prop { density: 500.0, ..Prop::new(Model::new("cube", block(DVec3::splat(edge)))) };
    before.props.push(cube(0.06));
    let mut old = earlier(&baked(&before, &glued()), &before, 1.0);
    let count_of = |of: EarlierProp| old.bodies.iter().filter(|body| body.prop == of).count();
    let (bricks, cubes) = (count_of(EarlierProp::Same(0)), count_of(EarlierProp::Same(1)));
    for body in &mut old.bodies {
        if body.prop == EarlierProp::Same(1) {
            body.prop = EarlierProp::Replaced(1);
        }
    }
    before.props[1] = cube(0.05);
    let new = baked(&Scene { earlier: Some(old.clone()), ..before }, &glued());
    check_counts(&old, &new);
    let kept = count(&new, Count::BodiesKept);
    // Those that lay on a larger cube may sink.
    assert!(kept as f64 >= 0.9 * bricks as f64, "{kept} of {bricks} bricks are kept");
    // Most cubes have a smaller one in their place.
    let near = |body: &&EarlierBody| {
        let now = new.pile.bodies.iter().zip(new.pile.frames.last().unwrap());
        now.filter(|(other, _)| other.prop == 1)
            .any(|(_, pose)| pose.translation.distance(body.last.translation) < 0.4 * DIAMETER)
    };
    let there = old.bodies.iter().filter(|body| body.prop == EarlierProp::Replaced(1)).filter(near).count();
    assert!(there * 4 > cubes * 3, "{there} of {cubes} cubes have one in their place");
}

#[test]
fn more_bodies_join_those_that_are_there_and_fewer_leave_the_lowest() {
    let scene = bricks(shape(&[]));
    let of = |count: u32| {
        let mut params = glued();
        params.fill.count = Some(count);
        params
    };
    let mut old = earlier(&baked(&scene, &of(60)), &scene, 1.0);
    old.refills = true;
    assert_eq!(old.bodies.len(), 60);
    for (wanted, most_gone) in [(80, 0), (40, 20)] {
        let new = baked(&Scene { earlier: Some(old.clone()), ..scene.clone() }, &of(wanted));
        check_counts(&old, &new);
        let stays = 60 - most_gone;
        assert_eq!(count(&new, Count::BodiesGone), most_gone);
        assert!(count(&new, Count::BodiesKept) * 20 >= stays * 19, "{} kept", count(&new, Count::BodiesKept));
        assert!(new.pile.filled as u32 <= wanted && new.pile.filled as u32 * 10 >= wanted * 9, "{}", new.pile.filled);
    }
}

/// A pile that falls keeps its poses in frame 0.
#[test]
fn a_natural_pile_keeps_frame_0() {
    let mut params = Params::new(Accuracy::Draft);
    params.glue.mode = GlueMode::Natural;
    params.control.mode = cairn_input::params::ControlMode::Off;
    params.output.settled = Switch::Off;
    params.output.frames = Some(6);
    let before = bricks(shape(&[]));
    let old = earlier(&baked(&before, &params), &before, 1.0);
    let new = baked(&Scene { earlier: Some(old.clone()), ..bricks(shape(&[limb(0.2, 0.2)])) }, &params);
    check_counts(&old, &new);
    let far = |p: DVec3| p.x < 0.3;
    let (there, all) = kept(&old, &new, true, far);
    assert!(all > 40 && there == all, "{there} of {all} bodies are kept");
}

#[test]
fn threads_do_not_change_what_is_kept() {
    let (plain, limbed) = (bricks(shape(&[])), bricks(shape(&[limb(0.2, 0.2)])));
    let old = earlier(&baked(&plain, &glued()), &plain, 1.0);
    let scene = Scene { earlier: Some(old), ..limbed };
    let [one, two] = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| baked(&scene, &glued()))
    });
    let all = |bake: &Bake| bake.pile.frames.iter().flatten().map(bits).collect::<Vec<_>>();
    assert_eq!(all(&one), all(&two));
}
