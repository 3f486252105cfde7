//! The part of a source file's node tree that is copied: the nodes that carry a mesh, and their ancestors.

use super::glue;
use super::left_out::LeftOut;
use cairn_gltf::document::{DocumentError, Object, Part, is_hidden, reference, references};
use cairn_gltf::{Document, INSTANCING, VISIBILITY};
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// Ancestors that the listed nodes of one scene may have in total: real files list nodes that have none, and each of
/// them may become a node of the result.
const MOST_ANCESTORS: usize = 1_000_000;

/// Copies of a node's mesh that may be written as nodes. A forest of ten thousand trees is one mesh for the programs
/// that made it; as nodes of every body it would be larger than any viewer takes.
const MOST_COPIES: usize = 1000;

/// A forest of nodes cut out of a source file. Animations, cameras, skins and lights are left behind, and with them
/// hidden nodes and the branches that carry no mesh.
pub struct Branch {
    pub nodes: Vec<BranchNode>,
    /// Indices into `nodes`.
    pub roots: Vec<usize>,
    pub left_out: LeftOut,
}

/// One node of a [`Branch`].
pub struct BranchNode {
    /// Name, transform, extras, and the extensions that draw geometry.
    pub json: Object,
    /// Index into the source's meshes.
    pub mesh: Option<usize>,
    /// Indices into the branch's nodes.
    pub children: Vec<usize>,
}

/// The frame of a chosen node.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum BranchFrame {
    /// The node's own origin; the rotation and scale of its world transform apply, its translation does not.
    Origin,
    /// The scene's.
    World,
}

/// The nodes of the default scene, or those of `chosen`: at least one with a mesh.
pub fn branch(document: &Document, chosen: Option<Part>, frame: BranchFrame) -> Result<Branch, DocumentError> {
    // A scene's frame is that of the world.
    let (listed, frame) = match chosen {
        Some(Part::Node(node)) => (vec![node], frame),
        Some(Part::Scene(scene)) => (document.roots_of(scene), BranchFrame::World),
        None => (document.roots(), BranchFrame::World),
    };
    let parents = document.parents();
    let mut branch = Branch { nodes: Vec::new(), roots: Vec::new(), left_out: LeftOut::default() };
    branch.left_out.count("animation", document.array("animations").len());
    if !matches!(chosen, Some(Part::Node(_))) {
        let scene = match chosen {
            Some(Part::Scene(scene)) => scene,
            _ => reference(document.json(), "scene").unwrap_or(0),
        };
        for entry in [Some(document.json()), document.get("scenes", scene).ok()].into_iter().flatten() {
            let extensions = entry.get("extensions").and_then(Value::as_object);
            extensions.into_iter().flat_map(Object::keys).for_each(|name| branch.left_out.extension(name));
        }
    }
    let mut seen = vec![false; parents.len()];
    let starts: BTreeSet<usize> = listed.iter().copied().collect();
    let mut steps = 0;
    for root in listed {
        document.get("nodes", root)?;
        let above = ancestors(&parents, root);
        steps += above.len();
        if steps > MOST_ANCESTORS {
            return Err(DocumentError::malformed("nodes", root, "is nested too deeply"));
        }
        // A scene may list a node twice, or beside one that stands above it: it is found from there.
        if seen[root] || above.iter().any(|a| starts.contains(a)) {
            continue;
        }
        // What is chosen by its name is wanted, hidden or not.
        if is_hidden(document.get("nodes", root)?) && !matches!(chosen, Some(Part::Node(_))) {
            continue;
        }
        let Some(mut top) = cut(document, root, &mut seen, &mut branch)? else { continue };
        // The linear part of a product is the product of the linear parts, so the ancestors are kept as a chain of
        // nodes: that also expresses a shear, which no single node can.
        if frame == BranchFrame::Origin {
            drop_translation(&mut branch.nodes[top].json);
        }
        for ancestor in above {
            let mut json = transform_of(document.get("nodes", ancestor)?);
            if frame == BranchFrame::Origin {
                drop_translation(&mut json);
            }
            if !json.is_empty() {
                branch.nodes.push(BranchNode { json, mesh: None, children: vec![top] });
                top = branch.nodes.len() - 1;
            }
        }
        branch.roots.push(top);
    }
    if branch.roots.is_empty() {
        return Err(DocumentError::NoMesh);
    }
    Ok(branch)
}

/// From the parent upward. Ends at a cycle.
fn ancestors(parents: &[Option<usize>], node: usize) -> Vec<usize> {
    let mut chain = Vec::new();
    let mut at = parents[node];
    while let Some(parent) = at.filter(|_| chain.len() < parents.len()) {
        chain.push(parent);
        at = parents[parent];
    }
    chain
}

/// Appends the tree below `root`, without branches that carry no mesh, and gives the root's place if anything is left.
fn cut(
    document: &Document,
    root: usize,
    seen: &mut [bool],
    branch: &mut Branch,
) -> Result<Option<usize>, DocumentError> {
    let Branch { nodes, left_out, .. } = branch;
    let first = nodes.len();
    // Parents before children: (source node, its parent's place).
    let mut open: Vec<(usize, Option<usize>)> = vec![(root, None)];
    let mut parents: Vec<Option<usize>> = Vec::new();
    while let Some((index, parent)) = open.pop() {
        let source = document.get("nodes", index)?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(DocumentError::malformed("nodes", index, "has two parents, or is its own ancestor"));
        }
        let place = nodes.len();
        nodes.push(BranchNode { json: kept(source, left_out), mesh: reference(source, "mesh"), children: Vec::new() });
        parents.push(parent);
        for child in references(source, "children").into_iter().rev() {
            if !is_hidden(document.get("nodes", child)?) {
                open.push((child, Some(place)));
            }
        }
    }
    let mut needed: Vec<bool> = nodes[first..].iter().map(|n| n.mesh.is_some()).collect();
    for place in (1..needed.len()).rev() {
        if let (true, Some(parent)) = (needed[place], parents[place]) {
            needed[parent - first] = true;
        }
    }
    for place in (1..needed.len()).filter(|&p| needed[p]) {
        if let Some(parent) = parents[place] {
            nodes[parent].children.push(first + place);
        }
    }
    Ok(needed[0].then_some(first))
}

/// The members that a copied node keeps besides mesh and children.
fn kept(source: &Object, left_out: &mut LeftOut) -> Object {
    let mut json = transform_of(source);
    left_out.count("camera", usize::from(source.contains_key("camera")));
    left_out.weights_of(&mut source.clone());
    for key in ["name", "extras"] {
        if let Some(value) = source.get(key) {
            json.insert(key.into(), value.clone());
        }
    }
    // Glue extras of an earlier bake are wrong for this one.
    if let Some(Value::Object(extras)) = json.get_mut("extras")
        && extras.remove(glue::KEY).is_some()
        && extras.is_empty()
    {
        json.remove("extras");
    }
    let extensions = source.get("extensions").and_then(Value::as_object);
    let names = extensions.into_iter().flat_map(Object::keys);
    names.filter(|name| ![INSTANCING, VISIBILITY].contains(&name.as_str())).for_each(|name| left_out.extension(name));
    if let Some(instancing) = extensions.and_then(|e| e.get(INSTANCING)) {
        json.insert("extensions".into(), json!({ INSTANCING: instancing }));
    }
    json
}

/// A node's transform without members that have their default.
fn transform_of(source: &Object) -> Object {
    const IDENTITY: [(&str, &[f64]); 4] = [
        ("matrix", &[1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]),
        ("translation", &[0., 0., 0.]),
        ("rotation", &[0., 0., 0., 1.]),
        ("scale", &[1., 1., 1.]),
    ];
    let mut json = Object::new();
    for (key, identity) in IDENTITY {
        let Some(value) = source.get(key) else { continue };
        let numbers: Option<Vec<f64>> = value.as_array().and_then(|a| a.iter().map(Value::as_f64).collect());
        if numbers.is_some_and(|n| n.len() == identity.len() && n != identity) {
            json.insert(key.into(), value.clone());
        }
    }
    json
}

/// Moves a node to its parent's origin.
fn drop_translation(json: &mut Object) {
    json.remove("translation");
    if let Some(Value::Array(matrix)) = json.get_mut("matrix") {
        matrix[12..15].fill(json!(0.0));
        let transform = transform_of(json);
        json.remove("matrix");
        json.extend(transform);
    }
}

impl Branch {
    /// Gives each copy of an instanced mesh a node of its own, which every program shows.
    pub fn unfold_instances(&mut self, document: &Document) -> Result<(), DocumentError> {
        for at in 0..self.nodes.len() {
            let Some(copies) = document.instances(&self.nodes[at].json)? else { continue };
            if copies.len() > MOST_COPIES {
                self.left_out.instances += copies.len();
                continue;
            }
            let node = &mut self.nodes[at];
            let attributes = node.json["extensions"][INSTANCING].get("attributes").and_then(Value::as_object);
            let own = attributes.into_iter().flat_map(Object::keys).filter(|name| name.starts_with('_'));
            self.left_out.count("attribute of copies", own.count());
            node.json.remove("extensions");
            let (mesh, name) = (node.mesh.take(), node.json.get("name").and_then(Value::as_str).map(str::to_owned));
            for (number, copy) in copies.iter().enumerate().filter(|_| mesh.is_some()) {
                let json = json!({
                    "translation": copy.translation.to_array(),
                    "rotation": copy.rotation.to_array(),
                    "scale": copy.scale.to_array(),
                });
                let mut json = json.as_object().map(transform_of).unwrap_or_default();
                if let Some(name) = &name {
                    json.insert("name".into(), json!(format!("{name}.{number:03}")));
                }
                self.nodes.push(BranchNode { json, mesh, children: Vec::new() });
                let child = self.nodes.len() - 1;
                self.nodes[at].children.push(child);
            }
        }
        Ok(())
    }

    /// The only node, if the branch is one mesh in the branch's own frame: then the node that places it can carry the
    /// mesh.
    pub fn lone_mesh(&self) -> Option<&BranchNode> {
        let [root] = self.roots[..] else { return None };
        let node = &self.nodes[root];
        let placed = ["matrix", "translation", "rotation", "scale"].iter().any(|k| node.json.contains_key(*k));
        (!placed && node.children.is_empty()).then_some(node)
    }
}
