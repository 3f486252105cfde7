//! The part of a source file's node tree that is copied: the nodes that carry a mesh, and what stands above them.

use crate::document::{Document, DocumentError, reference, references};
use serde_json::{Map, Value, json};

/// A forest of nodes cut out of a source file. Animations, cameras, skins and lights are left behind, and with them
/// the branches that carry no mesh.
pub struct Branch {
    pub nodes: Vec<BranchNode>,
    /// Indices into `nodes`.
    pub roots: Vec<usize>,
}

/// One node of a [`Branch`].
pub struct BranchNode {
    /// Name, transform, morph weights, extras, and the extensions that draw geometry.
    pub json: Map<String, Value>,
    /// Index into the source's meshes.
    pub mesh: Option<usize>,
    /// Indices into the branch's nodes.
    pub children: Vec<usize>,
}

/// Which frame a chosen node is seen in.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// The node's own origin; the rotation and scale of its world transform apply, its translation does not.
    Origin,
    /// The scene's.
    World,
}

/// The nodes of the default scene, or those at and below `chosen`.
pub fn branch(document: &Document, chosen: Option<usize>, frame: Frame) -> Result<Branch, DocumentError> {
    let Some(chosen) = chosen else {
        return cut(document, &document.roots());
    };
    document.get("nodes", chosen)?;
    let mut branch = cut(document, &[chosen])?;
    if branch.roots.is_empty() {
        return Ok(branch);
    }
    // The linear part of a product is the product of the linear parts, so the ancestors are kept as a chain of nodes:
    // that also expresses a shear, which no single node can.
    if frame == Frame::Origin {
        drop_translation(&mut branch.nodes[branch.roots[0]].json);
    }
    for ancestor in ancestors(document, chosen) {
        let mut json = transform_of(document.get("nodes", ancestor)?);
        if frame == Frame::Origin {
            drop_translation(&mut json);
        }
        if !json.is_empty() {
            branch.nodes.push(BranchNode { json, mesh: None, children: std::mem::take(&mut branch.roots) });
            branch.roots = vec![branch.nodes.len() - 1];
        }
    }
    Ok(branch)
}

/// From the parent upward. Ends at a cycle.
fn ancestors(document: &Document, node: usize) -> Vec<usize> {
    let parents = document.parents();
    let mut seen = vec![false; parents.len()];
    let mut chain = Vec::new();
    let mut at = parents[node];
    while let Some(parent) = at.filter(|&p| !std::mem::replace(&mut seen[p], true)) {
        chain.push(parent);
        at = parents[parent];
    }
    chain
}

/// Copies the trees below `roots`, each node once, and prunes what carries no mesh.
fn cut(document: &Document, roots: &[usize]) -> Result<Branch, DocumentError> {
    let mut seen = vec![false; document.array("nodes").len()];
    // Parents before children: (source node, its parent's place in `nodes`).
    let mut open: Vec<(usize, Option<usize>)> = roots.iter().rev().map(|&r| (r, None)).collect();
    let mut nodes: Vec<BranchNode> = Vec::new();
    let mut parents: Vec<Option<usize>> = Vec::new();
    while let Some((index, parent)) = open.pop() {
        let source = document.get("nodes", index)?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(DocumentError::malformed("nodes", index, "has two parents, or is its own ancestor"));
        }
        let place = nodes.len();
        nodes.push(BranchNode { json: kept(source), mesh: reference(source, "mesh"), children: Vec::new() });
        parents.push(parent);
        open.extend(references(source, "children").into_iter().rev().map(|c| (c, Some(place))));
    }
    let mut needed: Vec<bool> = nodes.iter().map(|n| n.mesh.is_some()).collect();
    for place in (0..nodes.len()).rev() {
        if let (true, Some(parent)) = (needed[place], parents[place]) {
            needed[parent] = true;
        }
    }
    let mut branch = Branch { nodes, roots: Vec::new() };
    for place in (0..needed.len()).filter(|&p| needed[p]) {
        match parents[place] {
            Some(parent) => branch.nodes[parent].children.push(place),
            None => branch.roots.push(place),
        }
    }
    Ok(branch)
}

/// What a copied node keeps besides mesh and children.
fn kept(source: &Map<String, Value>) -> Map<String, Value> {
    let mut json = transform_of(source);
    for key in ["name", "weights", "extras"] {
        if let Some(value) = source.get(key) {
            json.insert(key.into(), value.clone());
        }
    }
    let extensions = source.get("extensions").and_then(Value::as_object);
    if let Some(instancing) = extensions.and_then(|e| e.get(INSTANCING)) {
        json.insert("extensions".into(), json!({ INSTANCING: instancing }));
    }
    json
}

/// Draws a node's mesh many times; its attributes are accessors.
pub const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// A node's transform without the members that say nothing.
fn transform_of(source: &Map<String, Value>) -> Map<String, Value> {
    const IDENTITY: [(&str, &[f64]); 4] = [
        ("matrix", &[1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]),
        ("translation", &[0., 0., 0.]),
        ("rotation", &[0., 0., 0., 1.]),
        ("scale", &[1., 1., 1.]),
    ];
    let mut json = Map::new();
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
fn drop_translation(json: &mut Map<String, Value>) {
    json.remove("translation");
    if let Some(Value::Array(matrix)) = json.get_mut("matrix") {
        matrix[12..15].fill(json!(0.0));
        let transform = transform_of(json);
        json.remove("matrix");
        json.extend(transform);
    }
}

impl Branch {
    /// Whether the branch is one mesh in the branch's own frame, so that whoever places it can carry the mesh.
    pub fn lone_mesh(&self) -> Option<&BranchNode> {
        let [root] = self.roots[..] else { return None };
        let node = &self.nodes[root];
        let placed = ["matrix", "translation", "rotation", "scale"].iter().any(|k| node.json.contains_key(*k));
        (!placed && node.children.is_empty()).then_some(node)
    }
}
