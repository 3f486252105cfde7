//! Nodes as bodies: a scene in which they are placed as they stand in a file.

use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_geometry::topology::{drop_flat, weld};
use cairn_gltf::Document;
use cairn_gltf::document::{self, DocumentError, Triangles, reference, references};
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{Model, PlacedBody, Prop, Scene, StaticModel};
use cairn_render::{animation, nodes};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// What is a body, and of which material.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Names of nodes that stand still with all below them; `*` at the end stands for any rest.
    pub scenery: Vec<String>,
    /// Names of nodes that are not there.
    pub left_out: Vec<String>,
    /// For all bodies; `None`: as the result of a bake says, or else 0.7 and 1000 kg/m^3.
    pub friction: Option<f64>,
    pub density: Option<f64>,
    /// Height of the ground, m; `None`: 0 where the lowest body or piece of scenery stands about there, else its lowest
    /// point.
    pub ground: Option<f64>,
    /// There is no ground, only scenery.
    pub no_ground: bool,
    /// Seconds into the animation; `None`: its end.
    pub seconds: Option<f64>,
    /// Most triangles of the different meshes together.
    pub most_triangles: u64,
}

/// A body of the file.
#[derive(Clone, Debug)]
pub struct FoundBody {
    pub name: String,
    /// Index of its node.
    pub node: usize,
    /// Its meshes, and where they stand.
    pub parts: Vec<(usize, DAffine3)>,
}

/// The pile in a file.
pub struct FoundPile {
    pub bodies: Vec<FoundBody>,
    /// What stands still.
    pub scenery: Vec<FoundBody>,
    /// The same, for an analysis. Its bodies are in the order of `bodies`.
    pub scene: Scene,
    pub params: Params,
    /// What was assumed or left aside, one sentence each.
    pub notes: Vec<String>,
}

/// Why there is no pile.
#[derive(Debug, thiserror::Error)]
pub enum NoBodies {
    #[error(transparent)]
    Document(#[from] DocumentError),
    #[error("no node with triangles is a body")]
    Empty,
    #[error("no node has the name \"{0}\"")]
    NoSuchNode(String),
    #[error("has more than {0} triangles")]
    TooManyTriangles(u64),
    #[error("node \"{0}\": a point of it is not finite, or farther than 1e9 m from the origin")]
    TooFar(String),
}

/// Bodies farther from the origin than this are taken for a mistake, m.
const FARTHEST: f64 = 1e9;
/// The lowest thing stands at height 0 if its lowest point is no farther from it than this, in the scene's extent.
const ABOUT: f64 = 0.01;
/// A stretched rotation whose axes are no more oblique than this is one without shear.
const OBLIQUE: f64 = 1e-4;
/// Stretches that differ by no more than this are the same.
const SAME: f64 = 1e-5;

/// A matching name, or one that begins so where the pattern ends in `*`.
fn is_named(pattern: &str, name: &str) -> bool {
    pattern.strip_suffix('*').map_or(pattern == name, |begin| name.starts_with(begin))
}

/// What a node belongs to: whether it stands still, and its number among such.
type Owner = (bool, usize);

/// Reads the pile of a file. Where it has a node `pile`, as results of Cairn have, the children of that are the bodies,
/// and all other meshes are scenery. Otherwise the topmost node with a mesh is a body, with all below it.
pub fn read(document: &Document, selection: &Selection) -> Result<FoundPile, NoBodies> {
    let end = animation::duration(document)?;
    let locals = nodes::locals(document, selection.seconds.unwrap_or(end))?;
    let pile = nodes::pile(document);
    let mut pile_children: Vec<usize> = pile.map_or(Vec::new(), |(_, pile)| references(pile, "children"));
    pile_children.sort_unstable();
    let (mut bodies, mut scenery): (Vec<FoundBody>, Vec<FoundBody>) = (Vec::new(), Vec::new());
    let mut met = BTreeSet::new();
    let mut seen = vec![false; locals.len()];
    let mut open: Vec<(usize, DAffine3, Option<Owner>)> =
        document.roots().into_iter().rev().map(|root| (root, DAffine3::IDENTITY, None)).collect();
    while let Some((index, above, owner)) = open.pop() {
        let node = document.get("nodes", index)?;
        if std::mem::replace(&mut seen[index], true) || document::is_hidden(node) {
            continue;
        }
        let name = node.get("name").and_then(Value::as_str).map_or_else(|| format!("node {index}"), str::to_owned);
        let mut matches = |patterns: &[String]| {
            let found: Vec<&String> = patterns.iter().filter(|pattern| is_named(pattern, &name)).collect();
            met.extend(found.iter().map(|pattern| (*pattern).clone()));
            !found.is_empty()
        };
        if matches(&selection.left_out) {
            continue;
        }
        let is_scenery = matches(&selection.scenery);
        let world = above * locals[index];
        let is_child = pile_children.binary_search(&index).is_ok();
        let mesh = reference(node, "mesh");
        let begins = is_scenery || is_child || mesh.is_some();
        let mut own = owner;
        if begins && owner.is_none() {
            let stands = is_scenery || pile.is_some() && !is_child;
            let list = if stands { &mut scenery } else { &mut bodies };
            own = Some((stands, list.len()));
            list.push(FoundBody { name: name.clone(), node: index, parts: Vec::new() });
        }
        if let (Some(mesh), Some((stands, number))) = (mesh, own) {
            let list = if stands { &mut scenery } else { &mut bodies };
            match document.instances(node)? {
                // Each copy of a node that is drawn several times is a body of its own.
                Some(copies) => {
                    for (k, copy) in copies.into_iter().enumerate() {
                        let part = (mesh, world * copy.affine());
                        match k {
                            0 => list[number].parts.push(part),
                            _ => list.push(FoundBody { name: format!("{name}.{k}"), node: index, parts: vec![part] }),
                        }
                    }
                }
                None => list[number].parts.push((mesh, world)),
            }
        }
        open.extend(references(node, "children").into_iter().rev().map(|child| (child, world, own)));
    }
    if let Some(pattern) = selection.scenery.iter().chain(&selection.left_out).find(|pattern| !met.contains(*pattern)) {
        return Err(NoBodies::NoSuchNode(pattern.clone()));
    }
    // A scale of 0 hides a body that is not there at that moment.
    let shows = |body: &mut FoundBody| {
        body.parts.retain(|(_, place)| place.matrix3.determinant() != 0.0);
        !body.parts.is_empty()
    };
    bodies.retain_mut(shows);
    scenery.retain_mut(shows);
    to_scene(document, selection, bodies, scenery)
}

/// What a result of Cairn says of its bodies.
#[derive(Default)]
struct Baked {
    gravity: Option<f64>,
    ground: Option<bool>,
    ground_height: Option<f64>,
    ground_friction: Option<f64>,
    /// File name, friction and density of each prop.
    props: Vec<(String, f64, f64)>,
    is_glued: bool,
}

impl Baked {
    fn of(document: &Document) -> Baked {
        let Some(scene) = document.json().get("asset").and_then(|asset| asset.pointer("/extras/cairn/scene")) else {
            return Baked::default();
        };
        let prop = |prop: &Value| {
            let path = prop.get("path")?.as_str()?;
            let name = path.rsplit(['/', '\\']).next().unwrap_or(path).to_owned();
            Some((name, prop.get("friction")?.as_f64()?, prop.get("density")?.as_f64()?))
        };
        let props = scene.get("props").and_then(Value::as_array).into_iter().flatten().filter_map(prop).collect();
        let number = |key: &str| scene.get(key).and_then(Value::as_f64).filter(|number| number.is_finite());
        let dots =
            nodes::pile(document).and_then(|(_, pile)| pile.get("extras")?.pointer("/cairn/glue/dots")?.as_array());
        Baked {
            gravity: number("gravity").filter(|gravity| *gravity > 0.0),
            ground: scene.get("ground").and_then(Value::as_bool),
            ground_height: number("ground_height"),
            ground_friction: number("ground_friction"),
            props,
            is_glued: dots.is_some_and(|dots| !dots.is_empty()),
        }
    }

    /// Friction and density of a body of this name: the prop's file, a dot, a number.
    fn material(&self, name: &str) -> Option<(f64, f64)> {
        let begin = name.rsplit_once('.').map_or(name, |(begin, _)| begin);
        let prop =
            self.props.iter().find(|(prop, ..)| prop == begin).or(self.props.first().filter(|_| self.props.len() == 1));
        prop.map(|&(_, friction, density)| (friction, density))
    }
}

/// The rigid pose of a place, and the scale of its first axis: what is left between the two makes the shape.
fn rigid(place: &DAffine3) -> (Pose, f64) {
    let m = place.matrix3;
    let lengths = DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length());
    let axes = DMat3::from_cols(m.x_axis / lengths.x, m.y_axis / lengths.y, m.z_axis / lengths.z);
    let oblique = axes.x_axis.dot(axes.y_axis).abs().max(axes.y_axis.dot(axes.z_axis).abs());
    let oblique = oblique.max(axes.z_axis.dot(axes.x_axis).abs());
    if oblique.is_nan() || oblique > OBLIQUE {
        // Sheared: the shape is as it stands.
        return (Pose { translation: place.translation, rotation: DQuat::IDENTITY }, 1.0);
    }
    let mirror = if axes.determinant() < 0.0 { -1.0 } else { 1.0 };
    let rotation = DQuat::from_mat3(&DMat3::from_cols(axes.x_axis, axes.y_axis, mirror * axes.z_axis)).normalize();
    (Pose { translation: place.translation, rotation }, lengths.x)
}

/// The triangles of a mesh, each mesh read once.
struct Meshes<'a> {
    document: &'a Document<'a>,
    read: BTreeMap<usize, TriMesh>,
    left: u64,
    most: u64,
}

impl Meshes<'_> {
    fn get(&mut self, index: usize) -> Result<&TriMesh, NoBodies> {
        if !self.read.contains_key(&index) {
            let mut mesh = TriMesh::default();
            for primitive in self.document.primitives(index)? {
                let Triangles { points, corners, .. } = Triangles::read(self.document, index, primitive)?;
                self.left = self.left.checked_sub(corners.len() as u64).ok_or(NoBodies::TooManyTriangles(self.most))?;
                let base = mesh.points.len();
                mesh.points.extend(points);
                mesh.triangles.extend(corners.iter().map(|c| c.map(|i| (base + i) as u32)));
            }
            self.read.insert(index, mesh);
        }
        Ok(&self.read[&index])
    }

    /// The meshes of a body in a frame: a point as modelled -> the frame, by `map` after each part's place.
    fn joined(&mut self, body: &FoundBody, map: &DAffine3) -> Result<TriMesh, NoBodies> {
        let mut all = TriMesh::default();
        for (mesh, place) in &body.parts {
            all.append(&self.get(*mesh)?.transformed(&(*map * *place)));
        }
        let is_near = |p: &DVec3| p.is_finite() && p.abs().max_element() <= FARTHEST;
        if !all.points.iter().all(is_near) {
            return Err(NoBodies::TooFar(body.name.clone()));
        }
        let mut welded = weld(&all, 0.0);
        drop_flat(&mut welded);
        Ok(weld(&welded, 0.0))
    }
}

fn to_scene(
    document: &Document,
    selection: &Selection,
    bodies: Vec<FoundBody>,
    scenery: Vec<FoundBody>,
) -> Result<FoundPile, NoBodies> {
    let baked = Baked::of(document);
    let (mut scene, mut notes) = (Scene::default(), Vec::new());
    let most = selection.most_triangles;
    let mut meshes = Meshes { document, read: BTreeMap::new(), left: most, most };
    // Props by what makes their shape: meshes with their places in the body's own frame, and material.
    let mut known: BTreeMap<Vec<i64>, usize> = BTreeMap::new();
    let mut kept = Vec::new();
    let mut empty = Vec::new();
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for body in bodies {
        let first = body.parts[0].1;
        let (pose, scale) = rigid(&first);
        let (of_prop, of_density) =
            baked.material(&body.name).unwrap_or((Prop::new(Model::default()).friction, 1000.0));
        let (friction, density) = (selection.friction.unwrap_or(of_prop), selection.density.unwrap_or(of_density));
        let world = DAffine3::from_scale_rotation_translation(DVec3::splat(scale), pose.rotation, pose.translation);
        let to_frame = world.inverse();
        let quantum = |x: f64| (x / SAME).round() as i64;
        let mut key = vec![quantum(friction), quantum(density)];
        for (mesh, place) in &body.parts {
            let local = to_frame * *place;
            key.push(*mesh as i64);
            key.extend(local.to_cols_array().map(quantum));
        }
        let prop = match known.get(&key) {
            Some(&prop) => prop,
            None => {
                let mesh = meshes.joined(&body, &to_frame)?;
                if mesh.triangles.is_empty() {
                    empty.push(body.name.clone());
                    continue;
                }
                let prop = Prop { weight: 0.0, friction, density, ..Prop::new(Model::new(body.name.clone(), mesh)) };
                scene.props.push(prop);
                known.insert(key, scene.props.len() - 1);
                scene.props.len() - 1
            }
        };
        for p in &scene.props[prop].model.mesh.points {
            let p = world.transform_point3(*p);
            (low, high) = (low.min(p), high.max(p));
        }
        scene.bodies.push(PlacedBody { scale, ..PlacedBody::new(prop, pose) });
        kept.push(body);
    }
    let mut kept_scenery = Vec::new();
    let ground_friction = baked.ground_friction.or(selection.friction);
    let mut params = Params::new(Accuracy::Standard);
    params.ground_friction = selection.friction.or(ground_friction).unwrap_or(params.ground_friction);
    for piece in scenery {
        let mesh = meshes.joined(&piece, &DAffine3::IDENTITY)?;
        if mesh.triangles.is_empty() {
            continue;
        }
        let (from, to) = mesh.bounds();
        (low, high) = (low.min(from), high.max(to));
        let model = Model::new(piece.name.clone(), mesh);
        scene.statics.push(StaticModel { model, friction: params.ground_friction, keys: Vec::new() });
        kept_scenery.push(piece);
    }
    if kept.is_empty() {
        return Err(NoBodies::Empty);
    }
    if !empty.is_empty() {
        notes.push(format!("nodes without triangles are no bodies: {}", empty.join(", ")));
    }
    if baked.is_glued {
        notes.push("the pile is glued; it is analysed as if it had no glue".into());
    }
    params.gravity = baked.gravity.unwrap_or(params.gravity);
    params.ground = !selection.no_ground && baked.ground.unwrap_or(true);
    let about = if low.y.abs() <= ABOUT * (high - low).max_element() { 0.0 } else { low.y };
    params.ground_height = Some(selection.ground.or(baked.ground_height).unwrap_or(about));
    Ok(FoundPile { bodies: kept, scenery: kept_scenery, scene, params, notes })
}
