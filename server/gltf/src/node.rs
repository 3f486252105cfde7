//! The hierarchy: which nodes are read, and where each stands.
//!
//! Every node is visited once, at the place that its chain of parents gives it, also when a scene lists it beside its
//! parent. Walks keep their own stack: a chain of a hundred thousand nodes is a valid file.

use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use gltf::json::Index;
use gltf::json::scene::{Node, Scene};

use crate::gate::{Gate, MAY, Member, MemberKind, NODES, NUMBER, Piece, SCENES};
use crate::log::{Log, Logged};
use crate::problem::{ProblemKind, clip};

/// A quaternion whose length is further from 1 gets a note; exporters round to single precision.
const UNIT_TOLERANCE: f64 = 1e-3;

/// Names listed when one is not found.
const MOST_NAMES: usize = 8;

/// Names compared with one that is not found.
const MOST_COMPARED: usize = 20_000;

/// Likeness (Jaro-Winkler, 1 is equal) from which a name is offered for a mistyped one.
const NEAR: f64 = 0.8;

/// Draws a node's mesh many times; its attributes are accessors.
pub const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Hides a node with all that is below it: collision proxies, parts of a kit that are switched off.
pub const VISIBILITY: &str = "KHR_node_visibility";

const NODE: &[Member] = &[("children", MemberKind::Nodes, MAY), ("mesh", NUMBER, MAY), ("name", MemberKind::Name, MAY)];

const SCENE: &[Member] = &[("nodes", MemberKind::Nodes, MAY)];

/// A node that is read, and where it stands in the frame of the result.
pub(crate) struct PlacedNode {
    pub index: usize,
    pub map: DAffine3,
}

/// The nodes to read.
pub(crate) struct Selection {
    pub placed: Vec<PlacedNode>,
    /// The chosen node.
    pub root: Option<usize>,
    /// The linear part of its world transform.
    pub linear: DMat3,
    /// Where its origin is in the world.
    pub origin: DVec3,
    /// Hidden nodes that were met, and left out with all that is below them.
    pub hidden: usize,
}

/// All nodes of a file, with the first parent of each.
pub(crate) struct Nodes<'a, 'g> {
    gate: &'g Gate<'a>,
    /// Without their faulty members; and whether a node has any: a visit of the node reports them.
    pub items: Vec<Node>,
    faulty: Vec<bool>,
    parents: Vec<Option<usize>>,
    /// Transforms relative to the parent, as far as they were needed.
    locals: Vec<Option<DAffine3>>,
}

impl<'a, 'g> Nodes<'a, 'g> {
    pub fn new(gate: &'g Gate<'a>, limit: usize, log: &mut Log) -> Logged<Self> {
        let count = gate.count(NODES, log)?;
        if count > limit {
            let what = ProblemKind::Limit { what: "nodes", found: count as u64, limit: limit as u64 };
            return Err(log.refuse("/nodes", what));
        }
        let (mut items, mut faulty) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for node in (0..count).filter_map(|i| gate.find(NODES, i)) {
            let mut faults = Log::new("");
            items.push(gate.read_good::<Node>(&node, NODE, &mut faults).unwrap_or_default());
            faulty.push(faults.any());
        }
        let mut parents = vec![None; count];
        for (parent, node) in items.iter().enumerate() {
            for child in children(node) {
                parents[child].get_or_insert(parent);
            }
        }
        Ok(Nodes { gate, items, faulty, parents, locals: vec![None; count] })
    }

    /// The name of node `i` in messages.
    pub fn place(&self, i: usize) -> String {
        match self.items[i].name.as_deref() {
            Some(name) if !name.is_empty() => format!("node `{}`", clip(name)),
            _ => format!("node {i}"),
        }
    }

    /// Everything below the node called `wanted`, or the scene of that name where no node has it; or the default scene.
    ///
    /// A faulty value is reported and replaced by a default, so that the meshes below are checked all the same.
    pub fn place_all(&mut self, wanted: Option<&str>, log: &mut Log) -> Logged<Selection> {
        let has_name = |scene: &usize, name: &str| {
            let word = self.gate.find(SCENES, *scene).and_then(|scene| scene.member("name")?.word());
            word.as_deref() == Some(name)
        };
        let scene = match wanted {
            None => Some(None),
            Some(name) if self.items.iter().any(|node| node.name.as_deref() == Some(name)) => None,
            Some(name) => (0..self.gate.count(SCENES, log)?).find(|scene| has_name(scene, name)).map(Some),
        };
        if let Some(scene) = scene {
            let roots = self.scene_roots(scene, log)?;
            let worlds = self.worlds(&roots, log);
            let starts: Vec<_> = roots.into_iter().zip(worlds).collect();
            let count = starts.len();
            let starts: Vec<_> = starts.into_iter().filter(|(root, _)| !self.is_hidden(*root, log)).collect();
            let hidden = count - starts.len();
            let (placed, below) = self.descend(starts, log);
            return Ok(Selection {
                placed,
                root: None,
                linear: DMat3::IDENTITY,
                origin: DVec3::ZERO,
                hidden: hidden + below,
            });
        }
        let chosen = self.find(wanted.unwrap_or_default(), log)?;
        let world = self.worlds(&[chosen], log).first().copied().unwrap_or(DAffine3::IDENTITY);
        let (linear, origin) = (world.matrix3, world.translation);
        // What is chosen by its name is wanted, hidden or not.
        let (placed, hidden) = self.descend(vec![(chosen, DAffine3::from_mat3(linear))], log);
        Ok(Selection { placed, root: Some(chosen), linear, origin, hidden })
    }

    fn find(&self, wanted: &str, log: &mut Log) -> Logged<usize> {
        let names = || self.items.iter().map(|node| node.name.as_deref());
        let found: Vec<usize> = names().enumerate().filter(|(_, name)| *name == Some(wanted)).map(|(i, _)| i).collect();
        match found[..] {
            [only] => Ok(only),
            [] => {
                let mut known: Vec<&str> = names().flatten().filter(|name| !name.is_empty()).collect();
                known.sort_unstable();
                known.dedup();
                let likeness = |name: &str| strsim::jaro_winkler(&name.to_lowercase(), &wanted.to_lowercase());
                // The time goes with the product of the lengths, so only so many names of usual length are compared.
                let usual = |name: &&&str| name.len() <= 64 && wanted.len() <= 64;
                let mut near: Vec<(f64, &str)> = known
                    .iter()
                    .filter(usual)
                    .take(MOST_COMPARED)
                    .map(|n| (likeness(n), *n))
                    .filter(|(l, _)| *l >= NEAR)
                    .collect();
                near.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
                let what = ProblemKind::UnknownNode {
                    name: clip(wanted),
                    near: near.iter().take(3).map(|(_, n)| clip(n)).collect(),
                    known: known.iter().take(MOST_NAMES).map(|n| clip(n)).collect(),
                };
                Err(log.refuse("/nodes", what))
            }
            _ => Err(log.refuse("/nodes", ProblemKind::AmbiguousNode { name: clip(wanted), nodes: found })),
        }
    }

    /// The roots of a scene, of the default one if none is `wanted`; of the first, if none is the default; or all
    /// roots, if there is no scene.
    fn scene_roots(&self, wanted: Option<usize>, log: &mut Log) -> Logged<Vec<usize>> {
        let count = self.gate.count(SCENES, log)?;
        let chosen = self.gate.root("scene").map(|scene| scene.whole(log)).transpose()?.map(|scene| scene as usize);
        if count == 0 && chosen.is_none() {
            log.note("the file has no scene: all its nodes are read", "");
            let mut roots: Vec<usize> = (0..self.items.len()).filter(|&i| self.parents[i].is_none()).collect();
            if roots.is_empty() && !self.items.is_empty() {
                roots.push(0); // only cycles: the walk reports which
            }
            return Ok(roots);
        }
        if count > 1 && wanted.is_none() {
            log.note("the file has several scenes: only the default one is read; #NAME reads another", "");
        }
        let scene = self.gate.entry(SCENES, wanted.or(chosen).unwrap_or(0), "/scene", log)?;
        let scene: Option<Scene> = self.gate.read_good(&scene, SCENE, log);
        Ok(scene.iter().flat_map(|scene| &scene.nodes).map(Index::value).collect())
    }

    /// World transforms of `starts`, through all their parents. Each node's is computed once.
    fn worlds(&mut self, starts: &[usize], log: &mut Log) -> Vec<DAffine3> {
        let mut known: Vec<Option<DAffine3>> = vec![None; self.items.len()];
        let mut on_chain = vec![false; self.items.len()];
        let mut result = Vec::with_capacity(starts.len());
        for &start in starts {
            let mut chain = Vec::new();
            let mut at = Some(start);
            while let Some(i) = at.filter(|&i| known[i].is_none()) {
                if std::mem::replace(&mut on_chain[i], true) {
                    self.refuse_cycle(i, self.parents[i].unwrap_or(i), log);
                    break;
                }
                chain.push(i);
                at = self.parents[i];
            }
            let mut world = at.and_then(|i| known[i]).unwrap_or(DAffine3::IDENTITY);
            for &i in chain.iter().rev() {
                world *= self.local(i, log);
                known[i] = Some(world);
            }
            result.push(world);
        }
        result
    }

    /// Whether a node is hidden, which is noted.
    fn is_hidden(&self, node: usize, log: &mut Log) -> bool {
        let visible = self.gate.find(NODES, node).and_then(|piece| piece.extension(VISIBILITY)?.member("visible"));
        let is_hidden = visible.is_some_and(|visible| visible.text == "false");
        if is_hidden {
            log.note(
                "it is hidden (KHR_node_visibility): it is left out, with all that is below it",
                &self.place(node),
            );
        }
        is_hidden
    }

    /// Every node at and below `starts` that is not hidden, in the order of the file's lists; and how many are hidden.
    fn descend(&mut self, starts: Vec<(usize, DAffine3)>, log: &mut Log) -> (Vec<PlacedNode>, usize) {
        let mut visited = vec![false; self.items.len()];
        let (mut placed, mut hidden) = (Vec::new(), 0);
        // A node that hangs below another start is found from there, with the same transform.
        for start in starts {
            let mut stack = vec![start];
            while let Some((index, mut map)) = stack.pop() {
                if std::mem::replace(&mut visited[index], true) {
                    continue;
                }
                if !map.is_finite() {
                    let fault = "the transforms down to this node multiply to no finite number".to_owned();
                    log.refuse(self.place(index), ProblemKind::Transform { fault });
                    map = DAffine3::IDENTITY;
                }
                placed.push(PlacedNode { index, map });
                if let Some(node) = self.gate.find(NODES, index).filter(|_| self.faulty[index]) {
                    self.gate.read_good::<Node>(&node, NODE, log);
                }
                for child in children(&self.items[index]).rev().collect::<Vec<_>>() {
                    if self.parents[child] == Some(index) {
                        if self.is_hidden(child, log) {
                            hidden += 1;
                            continue;
                        }
                        stack.push((child, map * self.local(child, log)));
                    } else if !log.is_full() {
                        self.refuse_child(child, index, log);
                    }
                }
            }
        }
        (placed, hidden)
    }

    /// A child that has another parent is part of a circle, or has two.
    fn refuse_child(&self, child: usize, index: usize, log: &mut Log) {
        if self.is_above(child, index) {
            self.refuse_cycle(child, index, log);
        } else {
            let first = self.parents[child].map_or_else(String::new, |p| self.place(p));
            let what = ProblemKind::TwoParents { first, second: self.place(index) };
            log.refuse(self.place(child), what);
        }
    }

    /// Does the chain of parents of `node` lead through `above`? It also ends when it runs in a circle.
    fn is_above(&self, above: usize, node: usize) -> bool {
        let mut at = Some(node);
        for _ in 0..=self.items.len() {
            match at {
                None => return false,
                Some(i) if i == above => return true,
                Some(i) => at = self.parents[i],
            }
        }
        false
    }

    /// Reports the circle from `top` down to `bottom`, its descendant, which lists `top` among its children.
    fn refuse_cycle(&self, top: usize, bottom: usize, log: &mut Log) {
        let mut path = vec![bottom];
        let mut at = bottom;
        while at != top
            && path.len() < MOST_NAMES
            && let Some(parent) = self.parents[at]
        {
            path.push(parent);
            at = parent;
        }
        let mut names: Vec<String> = path.iter().map(|&i| self.place(i)).collect();
        if at != top {
            names.extend(["...".to_owned(), self.place(top)]);
        }
        names.reverse();
        names.push(self.place(top));
        log.refuse(self.place(top), ProblemKind::Cycle { path: names.join(" > ") });
    }

    /// The transform of node `i` relative to its parent.
    fn local(&mut self, i: usize, log: &mut Log) -> DAffine3 {
        if let Some(known) = self.locals[i] {
            return known;
        }
        let piece = self.gate.find(NODES, i);
        let read = piece.map_or(Ok(DAffine3::IDENTITY), |piece| self.read_local(&piece, &self.place(i), log));
        *self.locals[i].insert(read.unwrap_or(DAffine3::IDENTITY))
    }

    /// In double precision: the crate's types hold single, which moves parts visibly far from the origin.
    fn read_local(&self, node: &Piece<'a>, place: &str, log: &mut Log) -> Logged<DAffine3> {
        let [matrix, translation, rotation, scale] = node.members_of(["matrix", "translation", "rotation", "scale"]);
        if let Some(matrix) = matrix {
            let matrix = DMat4::from_cols_array(&matrix.numbers("sixteen numbers", log)?);
            if matrix.row(3) != glam::DVec4::W {
                let fault = "its matrix is not affine: the last row must be 0 0 0 1".to_owned();
                return Err(log.refuse(place, ProblemKind::Transform { fault }));
            }
            return Ok(DAffine3::from_mat4(matrix));
        }
        let translation = translation.map_or(Ok([0.0; 3]), |t| t.numbers("three numbers", log));
        let rotation = rotation.map(|q| q.numbers("four numbers", log)).transpose();
        let scale = scale.map_or(Ok([1.0; 3]), |s| s.numbers("three numbers", log));
        let (translation, rotation, scale) = (DVec3::from(translation?), rotation?, DVec3::from(scale?));
        let rotation = rotation.map_or(Ok(DQuat::IDENTITY), |q| unit(q, place, log))?;
        Ok(DAffine3::from_scale_rotation_translation(scale, rotation, translation))
    }
}

fn children(node: &Node) -> impl DoubleEndedIterator<Item = usize> {
    node.children.iter().flatten().map(Index::value)
}

/// A quaternion made exactly unit; one of length zero has no direction to keep.
pub(crate) fn unit(q: [f64; 4], place: &str, log: &mut Log) -> Logged<DQuat> {
    let q = DQuat::from_array(q);
    let length = q.length();
    if !length.is_normal() {
        let fault = format!("its rotation, a quaternion of length {length}, is none");
        return Err(log.refuse(place, ProblemKind::Transform { fault }));
    }
    if (length - 1.0).abs() > UNIT_TOLERANCE {
        log.note("its rotation is not a unit quaternion: it was normalised", place);
    }
    Ok(q.normalize())
}
