//! How a random scene is made: few numbers, so that a failure shrinks to few.

use super::super::rows::scenes::{ball, block, cone, cylinder, prop};
use cairn_engine::shape;
use cairn_engine::world::{ContactPair, Insertion, PairSide, Units, World};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, ControlMode, GlueMode, Params, ReleaseOrder, Switch};
use cairn_input::scene::{Model, PlacedBody, Prop, Scene};
use cairn_prepare::check;
use glam::{DAffine3, DQuat, DVec3};
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::f64::consts::TAU;

#[derive(Clone, Debug)]
pub struct Recipe {
    /// Diameter of the first prop, m.
    pub size: f64,
    pub props: Vec<PropKind>,
    pub friction: f64,
    /// Placed by hand, if nothing is filled.
    pub bodies: Vec<Placed>,
    pub control: Option<Target>,
    pub mode: ControlMode,
    pub at_once: bool,
    pub seed: u64,
}

#[derive(Clone, Debug)]
pub struct PropKind {
    pub form: Form,
    /// Longest over shortest extent.
    pub aspect: f64,
    /// Times the first prop's size.
    pub relative: f64,
}

#[derive(Clone, Copy, Debug)]
pub enum Form {
    Block,
    Rod,
    Sheet,
    Cone,
    Ball,
    Ell,
}

#[derive(Clone, Debug)]
pub struct Placed {
    pub prop: usize,
    /// In sizes.
    pub place: [f64; 3],
    /// Of the rotation about y and then x, turns.
    pub turn: [f64; 2],
    /// kg per cubed size, 1 to 1000.
    pub mass: f64,
}

/// A control mesh of a few times the props' size.
#[derive(Clone, Debug)]
pub struct Target {
    pub form: TargetForm,
    pub width: f64,
    pub height: f64,
    pub count: u32,
}

#[derive(Clone, Copy, Debug)]
pub enum TargetForm {
    Cone,
    Cylinder,
    Block,
    /// Two blocks that overlap.
    Union,
    /// Inside out.
    Inverted,
    /// Stands on an edge.
    Tilted,
}

/// Any value between two, evenly in its logarithm; shrinks to the smaller.
fn decades(from: f64, to: f64) -> impl Strategy<Value = f64> {
    (from.log10()..to.log10()).prop_map(|exponent: f64| 10f64.powf(exponent))
}

fn prop_kind() -> impl Strategy<Value = PropKind> {
    let form = prop_oneof![
        Just(Form::Block),
        Just(Form::Rod),
        Just(Form::Sheet),
        Just(Form::Cone),
        Just(Form::Ball),
        Just(Form::Ell)
    ];
    (form, decades(1.0, 200.0), decades(1.0, 5.0)).prop_map(|(form, aspect, relative)| PropKind {
        form,
        aspect,
        relative,
    })
}

fn placed(props: usize) -> impl Strategy<Value = Placed> {
    let place = [-2.0..2.0f64, 0.1..6.0f64, -2.0..2.0f64];
    (0..props, place, [0.0..1.0f64, 0.0..1.0f64], decades(1.0, 1000.0)).prop_map(|(prop, place, turn, mass)| Placed {
        prop,
        place,
        turn,
        mass,
    })
}

fn target() -> impl Strategy<Value = Target> {
    let form = prop_oneof![
        Just(TargetForm::Block),
        Just(TargetForm::Cone),
        Just(TargetForm::Cylinder),
        Just(TargetForm::Union),
        Just(TargetForm::Inverted),
        Just(TargetForm::Tilted)
    ];
    (form, 2.0..4.0f64, 2.0..4.0f64, 5..15u32).prop_map(|(form, width, height, count)| Target {
        form,
        width,
        height,
        count,
    })
}

pub fn recipe() -> impl Strategy<Value = Recipe> {
    let mode = prop_oneof![Just(ControlMode::Off), Just(ControlMode::Hold), Just(ControlMode::Nails)];
    let props = prop::collection::vec(prop_kind(), 1..4);
    props.prop_flat_map(move |props| {
        let bodies = prop::collection::vec(placed(props.len()), 1..30);
        let control = prop::option::weighted(0.2, target());
        (decades(1e-4, 100.0), Just(props), 0.0..2.0f64, bodies, control, mode.clone(), any::<bool>(), 1..1000u64)
            .prop_map(|(size, props, friction, bodies, control, mode, at_once, seed)| {
                let bodies = if control.is_some() { Vec::new() } else { bodies };
                Recipe { size, props, friction, bodies, control, mode, at_once, seed }
            })
    })
}

impl PropKind {
    /// Longest extent 1.
    fn mesh(&self) -> TriMesh {
        let thin = 1.0 / self.aspect;
        match self.form {
            Form::Block => block(DVec3::new(1.0, thin.sqrt(), thin)),
            Form::Rod => block(DVec3::new(1.0, thin, thin)),
            Form::Sheet => block(DVec3::new(1.0, thin, 0.8)),
            Form::Cone => cone(thin.max(0.02) / 2.0, 1.0),
            Form::Ball => ball(0.5),
            Form::Ell => ell(thin.max(0.05) / 2.0),
        }
    }
}

/// A bent bar, its arms `thick` wide.
fn ell(thick: f64) -> TriMesh {
    let outline = [[0.0, 0.0], [1.0, 0.0], [1.0, thick], [thick, thick], [thick, 0.8], [0.0, 0.8]];
    let layer = |z: f64| outline.map(|[x, y]| DVec3::new(x - 0.5, y - 0.4, z));
    let points = [layer(-thick / 2.0), layer(thick / 2.0)].concat();
    let caps = [[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 5, 4]];
    let mut triangles: Vec<[u32; 3]> = caps.to_vec();
    triangles.extend(caps.map(|[a, b, c]| [a + 6, c + 6, b + 6]));
    for k in 0..6 {
        let next = (k + 1) % 6;
        triangles.extend([[k, next, next + 6], [k, next + 6, k + 6]]);
    }
    TriMesh { points, triangles }
}

impl Target {
    fn mesh(&self) -> TriMesh {
        let (w, h) = (self.width, self.height);
        let standing =
            |by: DVec3| block(DVec3::new(w, h, w)).transformed(&DAffine3::from_translation(by + DVec3::Y * h / 2.0));
        match self.form {
            TargetForm::Cone => cone(w, h),
            TargetForm::Cylinder => cylinder(w / 2.0, h),
            TargetForm::Block => standing(DVec3::ZERO),
            TargetForm::Union => {
                let mut both = standing(DVec3::ZERO);
                both.append(&standing(DVec3::new(w * 0.6, 0.0, w * 0.3)));
                both
            }
            TargetForm::Inverted => {
                let mut mesh = standing(DVec3::ZERO);
                mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
                mesh
            }
            TargetForm::Tilted => standing(DVec3::ZERO).transformed(&DAffine3::from_rotation_z(0.5)),
        }
    }
}

/// Bodies placed by hand overlap by at most this share of the thinner one's thickness.
pub const MOST_OVERLAP: f64 = 0.5;

/// The contacts of the bodies placed by hand, and the world that they are in.
fn overlaps(scene: &Scene, params: &Params) -> (World, Vec<ContactPair>) {
    let checked = check::run(scene, params).expect("a sound recipe");
    let shapes = shape::run(scene, params, &checked.sizes, &mut Silent).expect("props with volume");
    let units = Units::new(checked.diameter, shapes[0].mass, params.gravity);
    let mut world = World::new(units, &params.physics, 0.01, true);
    world.add_ground(0.0, 0.0);
    for given in &scene.bodies {
        let pose = units.pose_to_engine(&shapes[given.prop].body_pose(&given.pose, given.scale));
        let body = Insertion { prop: given.prop, scale: given.scale, pose, friction: 0.0, restitution: 0.0 };
        world.insert(&shapes[given.prop], &body).expect("props with volume");
    }
    world.zero_step();
    let touches = world.contact_pairs(0.0);
    (world, touches)
}

/// Leaves out the bodies that are deeper in others, or in the ground: later ones first.
fn thinned(scene: Scene, params: &Params) -> Scene {
    let (world, touches) = overlaps(&scene, params);
    let mut out = BTreeSet::new();
    for touch in touches.iter().filter(|t| t.depth() > MOST_OVERLAP * world.pair_thickness(t)) {
        let last = if let PairSide::Body(b) = touch.b { b } else { touch.a };
        if !out.contains(&touch.a) {
            out.insert(last);
        }
    }
    let kept = |(k, body): (usize, PlacedBody)| (!out.contains(&k)).then_some(body);
    Scene { bodies: scene.bodies.into_iter().enumerate().filter_map(kept).collect(), ..scene }
}

/// What pushing apart all that overlaps can raise: the sum over the contacts of depth times the masses, kg m.
pub fn overlap_moment(scene: &Scene, params: &Params) -> f64 {
    if scene.bodies.is_empty() {
        return 0.0;
    }
    let (world, touches) = overlaps(scene, params);
    let mass = |id: usize| scene.bodies[id].mass.unwrap_or(0.0);
    let moment = |t: &ContactPair| {
        let other = if let PairSide::Body(b) = t.b { mass(b) } else { 0.0 };
        t.depth() * world.units.length * (mass(t.a) + other)
    };
    touches.iter().map(moment).sum()
}

impl Recipe {
    pub fn scene(&self) -> (Scene, Params) {
        let mut scene = Scene::default();
        for (i, kind) in self.props.iter().enumerate() {
            let factor = self.size * if i == 0 { 1.0 } else { kind.relative };
            let mesh = kind.mesh().scaled(factor);
            // Where masses are not given, they differ by no more than 1000:1 either.
            let volume = mesh.signed_volume().abs();
            let first = scene.props.first().map_or(volume, |first| first.model.mesh.signed_volume().abs());
            let density = 1000.0 * (volume / first).clamp(1.0 / 30.0, 30.0) * first / volume;
            scene.props.push(Prop { density, ..prop(&format!("prop{i}"), mesh, self.friction) });
        }
        let turn = |t: [f64; 2]| DQuat::from_rotation_y(TAU * t[0]) * DQuat::from_rotation_x(TAU * t[1]);
        for body in &self.bodies {
            let pose = Pose { translation: DVec3::from_array(body.place) * self.size, rotation: turn(body.turn) };
            let mass = Some((body.mass * self.size.powi(3) * 1e3).clamp(1e-9, 1e12));
            scene.bodies.push(PlacedBody { mass, ..PlacedBody::new(body.prop, pose) });
        }
        scene.control = self.control.as_ref().map(|target| {
            let mesh = target.mesh().scaled(self.size);
            Model::new("control", mesh)
        });
        let mut params = Params::new(Accuracy::Standard);
        // It is the control that is tried, and the engine.
        params.glue.mode = GlueMode::Natural;
        params.control.stand = Switch::Off;
        params.seed = self.seed;
        params.ground_friction = self.friction;
        params.ground_height = self.control.is_none().then_some(0.0);
        params.control.mode = self.mode;
        params.fill.count = self.control.as_ref().map(|target| target.count);
        params.release.order = if self.at_once { ReleaseOrder::AtOnce } else { ReleaseOrder::BottomUp };
        // Some 20 characteristic times, in frames of a half.
        let seconds = 20.0 * (self.size / params.gravity).sqrt();
        params.output.fps = (40.0 / seconds).clamp(1.0, 1000.0);
        params.output.frames = Some((seconds * params.output.fps).ceil().max(4.0) as u32);
        if !scene.bodies.is_empty() {
            scene = thinned(scene, &params);
        }
        (scene, params)
    }
}
