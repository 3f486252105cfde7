//! The animated `.glb`.
//!
//! Two nodes at the top: `pile` holds one node per body, in the bodies' order, named `<prop>.<number>`: the
//! body's index, unless a bake from an earlier result has kept its name;
//! `scenery` holds the static geometry and is absent when there is none. A body's node places the prop's own origin:
//! translation, rotation and uniform scale at frame 0; the animation `pile` moves it. Where that origin is far from the
//! prop, the node places the prop's centre of mass, and the prop hangs below it with its offset, so that what players
//! show between two frames is right, too. All bodies of a prop share its
//! mesh data: the body's node carries the mesh itself where the prop is one mesh in its own frame, else the prop's
//! nodes stand below it. The `pile` node's extras have `fps` and `frames`.
//!
//! Where bodies may be glued, the `pile` node's extras have `cairn.glue` for programs that simulate the pile further;
//! poses are those of the last frame, in metres, newtons and newton metres. `dots`, each with `bodies` (its indices
//! among the children of `pile`; the second is `null` for the ground or scenery), `point`, `normal` (into the first
//! body), `force` and `moment` (on the first body, about the point: what the dot carried where it was placed) and
//! `broken`. `clusters`: bodies that move as one. `anchored`: bodies that dots join to the ground or to scenery. A body
//! of these has the extras `cairn`: `cluster`, the number of its cluster or `null`, and `anchored`. A prop's own extras
//! stay.
//!
//! Where a shape was filled, `cairn.state` there is the buffer view of what a later bake needs to keep what fits of it:
//! [`state`] has its layout.
//!
//! The extras `cairn` of the file's `asset` state where the result comes from: scene, files with their hashes,
//! versions.
//!
//! A body that appears later has scale 0 until then, by keys that do not blend: glTF's own way to hide a node, which
//! every player and importer follows. Moving scenery is moved by the same animation.

mod hulls;
pub(super) mod motion;
mod physics;
pub mod state;

use super::copy::GlbOutput;
use super::glue::GlueMembership;
use super::hierarchy::{Branch, BranchFrame};
use super::sources::Sources;
use super::tracks;
use super::{Encoded, ExportError, ExportScene, ORIGIN, Rehearsal, SourceModel, glue};
use cairn_core::report::bake::{BakedBody, BakedPile};
use cairn_files::FileSource;
use cairn_geometry::pose::Pose;
use cairn_gltf::INSTANCING;
use cairn_gltf::document::{DocumentError, Object};
use glam::DVec3;
use motion::animate;
pub use physics::encode as encode_physics;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The bytes of the file.
pub fn encode(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    GlbFile { keeps_instancing: scene.keeps_instancing, ..GlbFile::default() }.animated(bake, scene)
}

/// The bytes of the `.hulls.glb`: the same nodes and animation, but every body and piece of scenery shows its collision
/// shape. A body of several convex parts has a node below it for each, `NAME.PART`. Earlier results around the pile,
/// which it met, are among the scenery.
pub fn encode_hulls(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    GlbFile { shows_hulls: true, ..GlbFile::default() }.animated(bake, scene)
}

/// Copies models into nothing.
pub fn rehearse(
    models: &[SourceModel],
    keeps_instancing: bool,
    source: &dyn FileSource,
) -> Result<Rehearsal, Vec<ExportError>> {
    let mut file = GlbFile { out: GlbOutput::rehearsal(), keeps_instancing, ..GlbFile::default() };
    let (mut sentences, mut errors) = (Vec::new(), Vec::new());
    for model in models {
        let placed = file.open(model, BranchFrame::Origin).and_then(|(source, mut branch)| {
            file.out.left_out = std::mem::take(&mut branch.left_out);
            file.place(source, &branch).map_err(|error| ExportError::source(model, error))
        });
        match placed {
            Ok(_) => sentences.extend(std::mem::take(&mut file.out.left_out).sentences(model, source)),
            Err(error) => errors.push(error),
        }
        file.nodes.clear();
    }
    let bytes = file.out.rehearsed.unwrap_or(0);
    if errors.is_empty() { Ok(Rehearsal { left_out: sentences, bytes }) } else { Err(errors) }
}

/// The file and the sources that it draws from.
#[derive(Default)]
struct GlbFile<'a> {
    out: GlbOutput,
    /// Nodes whose final content is known later than their place.
    nodes: BTreeMap<usize, Value>,
    sources: Sources<'a>,
    keeps_instancing: bool,
    /// Bodies and scenery are their collision shapes.
    shows_hulls: bool,
    /// Of the file itself.
    extensions: Object,
}

impl<'a> GlbFile<'a> {
    fn animated(mut self, bake: &BakedPile, scene: &'a ExportScene) -> Result<Encoded, ExportError> {
        let pile = self.out.push("nodes", Value::Null);
        // Bodies come first, so that body `i` is node `i + 1`.
        for _ in &bake.bodies {
            self.out.push("nodes", Value::Null);
        }
        let bodies = self.bodies(bake, scene, pile)?;
        let mut tops = vec![pile];
        let mut moving = Vec::new();
        if let Some(scenery) = self.scenery(bake, scene, &mut moving)? {
            tops.push(scenery);
        }
        let mut node = json!({ "name": "pile", "extras": { "fps": bake.fps, "frames": bake.frames.len() } });
        if let Some(glue) = &bake.glue {
            node["extras"][glue::KEY] = json!({ "glue": glue::whole(glue) });
        }
        if let Some(shape) = scene.shape.filter(|_| bake.filled > 0 && !self.shows_hulls) {
            let view = self.out.push_view(&state::encode(bake, shape, scene.colliders), Object::new());
            node["extras"][glue::KEY][state::KEY] = json!(view);
        }
        if !bodies.is_empty() {
            node["children"] = json!(bodies);
        }
        self.nodes.insert(pile, node);
        animate(bake, pile, &moving, &mut self.out);
        self.finish(&tops, scene.origin).map(Encoded::single)
    }

    /// The file of a model, and the part of it that is wanted.
    fn open(&mut self, model: &'a SourceModel, frame: BranchFrame) -> Result<(usize, Branch), ExportError> {
        let (source, mut branch) = self.sources.open(model, frame)?;
        if !self.keeps_instancing {
            let document = &self.sources.get(source).document;
            branch.unfold_instances(document).map_err(|error| ExportError::source(model, error))?;
        }
        Ok((source, branch))
    }

    /// Fills the bodies' nodes and gives their indices.
    fn bodies(&mut self, bake: &BakedPile, scene: &'a ExportScene, pile: usize) -> Result<Vec<usize>, ExportError> {
        let names = super::body_names(bake, scene);
        let held = bake.glue.as_ref().map(|glue| GlueMembership::all(glue, bake.bodies.len()));
        let mut props: BTreeMap<usize, (usize, Branch)> = BTreeMap::new();
        let mut hulls: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (i, body) in bake.bodies.iter().enumerate() {
            let model = &scene.props[body.prop];
            let at = pile + 1 + i;
            let mut node = Object::from_iter([("name".to_string(), json!(names[i]))]);
            if self.shows_hulls {
                let parts = hulls.entry(body.prop).or_insert_with(|| self.hulls(model.name, &bake.solids[body.prop]));
                if let [lone] = parts[..] {
                    node.insert("mesh".into(), json!(lone));
                } else {
                    let part = |(number, mesh)| json!({ "name": format!("{}.{number}", names[i]), "mesh": mesh });
                    let nodes = parts.iter().enumerate().map(part).map(|node| self.out.push("nodes", node));
                    node.insert("children".into(), nodes.collect());
                }
                self.finish_body(bake, i, at, node, held.as_deref());
                continue;
            }
            if let std::collections::btree_map::Entry::Vacant(slot) = props.entry(body.prop) {
                slot.insert(self.open(model, BranchFrame::Origin)?);
            }
            let (source, branch) = &props[&body.prop];
            let wrap = |error| ExportError::source(model, error);
            let pivot = bake.solids[body.prop].pivot;
            match branch.lone_mesh() {
                _ if pivot != DVec3::ZERO => {
                    let children = self.place(*source, branch).map_err(wrap)?;
                    let offset = json!({
                        "name": format!("{}.offset", names[i]), "translation": (-pivot).as_vec3().to_array(),
                        "children": children,
                    });
                    node.insert("children".into(), json!([self.out.push("nodes", offset)]));
                }
                Some(lone) => {
                    let mut json = lone.json.clone();
                    json.remove("name");
                    node.extend(self.node(*source, json, lone.mesh).map_err(wrap)?);
                }
                None => {
                    let children = self.place(*source, branch).map_err(wrap)?;
                    node.insert("children".into(), json!(children));
                }
            }
            self.finish_body(bake, i, at, node, held.as_deref());
        }
        Ok((0..bake.bodies.len()).map(|i| pile + 1 + i).collect())
    }

    /// Places the node of a body at the beginning.
    fn finish_body(
        &mut self,
        bake: &BakedPile,
        body: usize,
        at: usize,
        mut node: Object,
        held: Option<&[GlueMembership]>,
    ) {
        let BakedBody { scale, first_frame, .. } = bake.bodies[body];
        if !bake.frames.is_empty() {
            place_node(&mut node, bake.pivot_pose(0, body));
        }
        let scale = [if first_frame > 0 { 0.0 } else { scale as f32 }; 3];
        node.insert("scale".into(), json!(scale));
        if let Some(held) = held {
            held[body].add_to(&mut node);
        }
        self.nodes.insert(at, Value::Object(node));
    }

    /// The static geometry below one node, each file below a node of its name.
    /// Adds each moving piece to `moving`: its number in the bake's scenery, and its node.
    fn scenery(
        &mut self,
        bake: &BakedPile,
        scene: &'a ExportScene,
        moving: &mut Vec<(usize, usize)>,
    ) -> Result<Option<usize>, ExportError> {
        let mut children = Vec::new();
        let count = if self.shows_hulls { scene.colliders.len() } else { scene.scenery.len() };
        for i in 0..count {
            let name = scene.scenery.get(i).map_or("around", |model| model.name);
            let mut node = Object::from_iter([("name".to_string(), json!(name))]);
            if self.shows_hulls {
                node.insert("mesh".into(), json!(self.mesh(name, &scene.colliders[i].model.mesh)));
            } else {
                let model = &scene.scenery[i];
                let (source, branch) = self.open(model, BranchFrame::World)?;
                let nodes = self.place(source, &branch).map_err(|error| ExportError::source(model, error))?;
                node.insert("children".into(), json!(nodes));
            }
            let first = bake.scenery.get(i).and_then(|poses| poses.first()).copied();
            if let Some(pose) = first {
                place_node(&mut node, pose);
            }
            children.push(self.out.push("nodes", node));
            moving.extend(first.map(|_| (i, children[i])));
        }
        if children.is_empty() {
            return Ok(None);
        }
        Ok(Some(self.out.push("nodes", json!({ "name": "scenery", "children": children }))))
    }

    /// A node's members with everything it refers to copied.
    fn node(&mut self, source: usize, mut json: Object, mesh: Option<usize>) -> Result<Object, DocumentError> {
        let source = self.sources.get(source);
        if let Some(mesh) = mesh {
            json.insert("mesh".into(), json!(source.mesh(mesh, &mut self.out)?));
        }
        if let Some(instancing) = json.get_mut("extensions").and_then(|e| e.get_mut(INSTANCING)) {
            if let Some(Value::Object(attributes)) = instancing.get_mut("attributes") {
                source.accessors(attributes, &mut self.out)?;
            }
            source.use_extension(INSTANCING, &mut self.out);
        }
        Ok(json)
    }

    /// Writes the nodes of a branch once more and gives the new roots.
    fn place(&mut self, source: usize, branch: &Branch) -> Result<Vec<usize>, DocumentError> {
        let mut placed: BTreeMap<usize, usize> = BTreeMap::new();
        let mut order = Vec::new();
        let mut open: Vec<usize> = branch.roots.iter().rev().copied().collect();
        while let Some(at) = open.pop() {
            placed.insert(at, self.out.push("nodes", Value::Null));
            order.push(at);
            open.extend(branch.nodes[at].children.iter().rev());
        }
        for at in order {
            let node = &branch.nodes[at];
            let mut json = self.node(source, node.json.clone(), node.mesh)?;
            if !node.children.is_empty() {
                let children: Vec<usize> = node.children.iter().map(|c| placed[c]).collect();
                json.insert("children".into(), json!(children));
            }
            self.nodes.insert(placed[&at], Value::Object(json));
        }
        Ok(branch.roots.iter().map(|r| placed[r]).collect())
    }

    fn finish(self, tops: &[usize], origin: Option<&Value>) -> Result<Vec<u8>, ExportError> {
        let (mut json, bin) = self.out.into_json();
        if let Some(Value::Array(nodes)) = json.get_mut("nodes") {
            for (at, node) in self.nodes {
                nodes[at] = node;
            }
        }
        let generator = concat!("cairn ", env!("CARGO_PKG_VERSION"));
        let mut asset = json!({ "version": "2.0", "generator": generator });
        if let Some(origin) = origin {
            asset["extras"] = json!({ ORIGIN: origin });
        }
        json.insert("asset".into(), asset);
        json.insert("scene".into(), json!(0));
        json.insert("scenes".into(), json!([{ "nodes": tops }]));
        if !self.extensions.is_empty() {
            json.insert("extensions".into(), Value::Object(self.extensions));
        }
        if !bin.is_empty() {
            json.insert("buffers".into(), json!([{ "byteLength": bin.len() }]));
        }
        container(&serde_json::to_vec(&json).map_err(std::io::Error::from)?, &bin)
    }
}

/// Gives a node its pose at the beginning.
fn place_node(node: &mut Object, pose: Pose) {
    let once = || std::iter::once(pose);
    node.insert("translation".into(), json!(tracks::translations(once())[0]));
    node.insert("rotation".into(), json!(tracks::rotations(once())[0]));
}

/// A GLB of the two chunks; the binary one is left out when there is nothing in it.
pub fn container(json: &[u8], bin: &[u8]) -> Result<Vec<u8>, ExportError> {
    let padded = |bytes: &[u8]| bytes.len().next_multiple_of(4);
    let bin_chunk = if bin.is_empty() { 0 } else { 8 + padded(bin) };
    let length = 12 + 8 + padded(json) + bin_chunk;
    let word = |n: usize| u32::try_from(n).map(u32::to_le_bytes).map_err(|_| ExportError::TooLarge);
    let mut glb = Vec::with_capacity(length);
    glb.extend_from_slice(b"glTF");
    glb.extend_from_slice(&2u32.to_le_bytes());
    glb.extend_from_slice(&word(length)?);
    for (kind, bytes, pad) in [(b"JSON", json, b' '), (b"BIN\0", bin, 0)] {
        if bytes.is_empty() {
            continue;
        }
        glb.extend_from_slice(&word(padded(bytes))?);
        glb.extend_from_slice(kind);
        glb.extend_from_slice(bytes);
        glb.resize(glb.len().next_multiple_of(4), pad);
    }
    Ok(glb)
}
