//! The geometry that a scene shows: primitives with checked accessors, and where each stands.
//!
//! Each mesh is checked once, for all nodes that show it. The number of triangles is known and held against its limit
//! before any is made.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use glam::{DAffine3, DMat3, DVec3};
use gltf::accessor::DataType;
use gltf::json::mesh::Primitive as Described;
use gltf::json::validation::Checked::Valid;
use gltf::mesh::{Mode, Semantic};
use serde_json::Value;

use crate::accessor::{Accessors, Elements, Purpose};
use crate::buffer::Buffers;
use crate::compressed::{Attribute, DRACO, DracoMesh, MOST_BROKEN};
use crate::gate::{ACCESSORS, Gate, MAY, MESHES, MUST, Member, MemberKind, NODES, NUMBER, Piece};
use crate::log::{Log, Logged, counted};
use crate::node::{INSTANCING, Nodes, PlacedNode, Selection, unit};
use crate::problem::{ProblemKind, clip};
use crate::source::Source;
use crate::triangulate;

/// Above this many triangles, their corners could not be numbered in 32 bits.
const MOST_TRIANGLES: u64 = 1_000_000_000;

const PRIMITIVE: &[Member] =
    &[("attributes", MemberKind::Part(&[("POSITION", NUMBER, MAY)]), MAY), ("indices", NUMBER, MAY)];

const STREAM: &[Member] =
    &[("bufferView", NUMBER, MUST), ("attributes", MemberKind::Part(&[("POSITION", NUMBER, MUST)]), MAY)];

/// The triangles that a file, or a node of it, shows.
pub struct Geometry<'a> {
    /// Each with its transforms into the frame of the result, one for each time that it is shown.
    pub parts: Vec<(Primitive<'a>, Rc<Vec<DAffine3>>)>,
    /// Number of the chosen node in the file.
    pub root: Option<usize>,
    /// The linear part (rotation, scale, shear) of the chosen node's world transform; identity for a whole file.
    ///
    /// The parts of a whole file stand in its scene's frame. Those of a chosen node stand in a frame with the node's
    /// own origin and the world's axes: the rotation and scale of all that is above the node are applied, the
    /// translation is not.
    pub linear: DMat3,
    /// Where the chosen node's origin is in the world, m; zero for a whole file.
    pub origin: DVec3,
    /// The reason, if there is no triangle.
    pub why_empty: Option<String>,
    /// A node with a skin shows one of the meshes. Skins are not applied.
    pub is_skinned: bool,
    /// Not in the log yet: call [`UnreadExtensions::check`].
    pub unread: UnreadExtensions,
}

/// Extensions that the file requires and that are not read; and whether anything with geometry uses them.
pub struct UnreadExtensions(Vec<(String, bool)>);

/// A primitive of triangles whose accessors are good.
pub struct Primitive<'a> {
    pub positions: Rc<Elements<'a>>,
    indices: Option<Rc<Elements<'a>>>,
    mode: Mode,
    /// Where it stands, for messages.
    pub place: String,
}

impl<'a> Geometry<'a> {
    /// Reads the geometry that a file shows. Every problem is in the log: `Ok` does not mean that there is none (see
    /// [`Log::any`]). Once all triangles are read, call [`UnreadExtensions::check`] of [`Geometry::unread`].
    pub fn open(source: &Source<'a>, log: &mut Log) -> Logged<Geometry<'a>> {
        let limits = source.limits;
        let (gate, bin) = source.open(log)?;
        let gate = &gate;
        let most_triangles = limits.triangles.min(MOST_TRIANGLES);
        let buffers = Buffers::new(gate, bin, source.resolve, limits.bytes, source.bytes.len() as u64);
        let mut reader = Reader {
            gate,
            accessors: Accessors::new(gate, buffers, 3 * most_triangles),
            quantized: gate.declares("KHR_mesh_quantization"),
            most_triangles,
            most_instances: limits.nodes as u64,
            broken: 0,
            is_skinned: false,
        };
        let mut nodes = Nodes::new(gate, limits.nodes, log)?;
        let selection = nodes.place_all(source.node, log)?;
        let (parts, why_empty) = reader.parts(&nodes, &selection, log)?;
        let unread = UnreadExtensions(gate.unread().map(|(name, met)| (name.to_owned(), met)).collect());
        let is_skinned = reader.is_skinned;
        Ok(Geometry {
            parts,
            root: selection.root,
            linear: selection.linear,
            origin: selection.origin,
            why_empty,
            is_skinned,
            unread,
        })
    }
}

impl UnreadExtensions {
    /// Adds these extensions to the log: as a problem if something with geometry uses it, otherwise as a note.
    pub fn check(&self, log: &mut Log) {
        for (name, met) in &self.0 {
            if *met {
                log.refuse("/extensionsRequired", ProblemKind::Extension { name: clip(name) });
            } else {
                log.note(
                    "it requires an extension that is not read, but nothing with geometry uses it",
                    "/extensionsRequired",
                );
            }
        }
    }
}

impl Primitive<'_> {
    fn corners(&self) -> u64 {
        self.indices.as_ref().map_or(self.positions.count, |i| i.count)
    }

    /// Three vertices of each triangle. Every vertex is there, and its position is finite.
    pub fn triangles(&self, log: &mut Log) -> Logged<Vec<[u32; 3]>> {
        let Primitive { positions, indices, mode, place } = self;
        let triangles = triangulate::triangles(*mode, positions, indices.as_deref(), place, log)?;
        let bad = triangles.iter().flatten().find(|&&v| !positions.vector(u64::from(v)).is_finite());
        if let Some(&vertex) = bad {
            let value = positions.vector(u64::from(vertex)).to_string();
            return Err(log.refuse(place.clone(), ProblemKind::NotFinite { vertex: u64::from(vertex), value }));
        }
        Ok(triangles)
    }
}

/// Reads the primitives that nodes show.
struct Reader<'a, 'g> {
    gate: &'g Gate<'a>,
    accessors: Accessors<'a, 'g>,
    quantized: bool,
    most_triangles: u64,
    most_instances: u64,
    /// Draco streams that could not be decoded.
    broken: u32,
    is_skinned: bool,
}

/// Primitives with their transforms; and why there may be no triangle.
type Parts<'a> = (Vec<(Primitive<'a>, Rc<Vec<DAffine3>>)>, Option<String>);

impl<'a, 'g> Reader<'a, 'g> {
    fn parts(&mut self, nodes: &Nodes<'a, 'g>, selection: &Selection, log: &mut Log) -> Logged<Parts<'a>> {
        let placed = &selection.placed;
        // Nodes by mesh, in the order in which the meshes are met.
        let mut order: Vec<(usize, Vec<&PlacedNode>)> = Vec::new();
        let mut known: BTreeMap<usize, usize> = BTreeMap::new();
        for place in placed {
            let node = &nodes.items[place.index];
            let Some(piece) = self.gate.find(NODES, place.index) else { continue };
            self.gate.meet(&piece);
            let Some(mesh) = node.mesh.map(|mesh| mesh.value()) else { continue };
            if piece.member("skin").is_some() {
                self.is_skinned = true;
                log.note(
                    "its skin is not applied: the mesh stands as modelled, in the node's frame",
                    &nodes.place(place.index),
                );
            }
            let at = *known.entry(mesh).or_insert_with(|| {
                order.push((mesh, Vec::new()));
                order.len() - 1
            });
            order[at].1.push(place);
        }

        let mut left = self.most_triangles;
        let mut parts = Vec::new();
        let mut left_out = BTreeSet::new();
        for (mesh, places) in &order {
            let Some(first) = places.first() else { continue };
            let place = format!("{}, mesh {mesh}", nodes.place(first.index));
            let Ok(primitives) = self.primitives(*mesh, &place, &mut left_out, log) else { continue };
            let Ok(maps) = self.instances(nodes, places, log) else { continue };
            for primitive in primitives {
                let triangles = triangulate::at_most(primitive.mode, primitive.corners());
                match triangles.checked_mul(maps.len() as u64).and_then(|n| left.checked_sub(n)) {
                    Some(rest) => left = rest,
                    None => {
                        let (limit, found) = (self.most_triangles, self.most_triangles - left);
                        let found = found.saturating_add(triangles.saturating_mul(maps.len() as u64));
                        return Err(log.refuse(primitive.place, ProblemKind::Limit { what: "triangles", found, limit }));
                    }
                }
                if triangles > 0 {
                    parts.push((primitive, Rc::clone(&maps)));
                }
            }
        }
        let meshes = self.gate.count(MESHES, &mut Log::new("")).unwrap_or(0);
        Ok((parts, why_empty(selection, &order, &left_out, meshes)))
    }

    /// The primitives of a mesh that make triangles, with good accessors.
    fn primitives(
        &mut self,
        mesh: usize,
        place: &str,
        left_out: &mut BTreeSet<&'static str>,
        log: &mut Log,
    ) -> Logged<Vec<Primitive<'a>>> {
        let mesh = self.gate.entry(MESHES, mesh, place, log)?;
        self.gate.meet(&mesh);
        let mut good = Vec::new();
        for (k, item) in self.gate.items(&mesh, "primitives", log)?.enumerate() {
            if let Ok(Some(primitive)) = self.primitive(&item, format!("{place}, primitive {k}"), left_out, log) {
                good.push(primitive);
            }
        }
        Ok(good)
    }

    fn primitive(
        &mut self,
        piece: &Piece<'a>,
        place: String,
        left_out: &mut BTreeSet<&'static str>,
        log: &mut Log,
    ) -> Logged<Option<Primitive<'a>>> {
        self.gate.meet(piece);
        let mode = match piece.member("mode").map_or(Ok(4), |mode| mode.whole(log))? {
            4 => Mode::Triangles,
            5 => Mode::TriangleStrip,
            6 => Mode::TriangleFan,
            0..=3 => {
                left_out.insert("points and lines");
                log.note("points and lines are left out", &place);
                return Ok(None);
            }
            other => {
                let what = ProblemKind::Type { expected: "a mode, 0 to 6", found: other.to_string() };
                return Err(log.refuse(format!("{}/mode", piece.path), what));
            }
        };
        let primitive: Described = self.gate.read(piece, PRIMITIVE, log)?;
        let position = primitive.attributes.get(&Valid(Semantic::Positions)).map(|position| position.value());
        let indices = primitive.indices.map(|indices| indices.value());

        let Some(position) = position else {
            left_out.insert("primitives without positions");
            log.note("it has no POSITION and is left out", &place);
            return Ok(None);
        };
        let [targets, extensions] = piece.members_of(["targets", "extensions"]);
        if targets.is_some() {
            log.note("its morph targets are not applied: the base shape is read", &place);
        }
        let purpose = Purpose::Position { quantized: self.quantized };
        // Compressed geometry may stand beside a plain copy: then the accessors have views.
        let has_data = |accessor| self.accessor(accessor, "bufferView").is_some();
        if let Some(stream) = extensions.and_then(|extensions| extensions.member(DRACO))
            && !(has_data(position) && indices.is_none_or(has_data))
        {
            let (positions, indices) = self.draco(&stream, purpose, position, &place, log)?;
            // The stream holds triangles, whatever they were made from.
            return Ok(Some(Primitive { positions, indices: Some(indices), mode: Mode::Triangles, place }));
        }
        let positions = self.accessors.get(position, purpose, &place, log);
        let indices = indices.map(|i| self.accessors.get(i, Purpose::Index, &place, log)).transpose();
        Ok(Some(Primitive { positions: positions?, indices: indices?, mode, place }))
    }

    /// A member of an accessor, if both are there.
    fn accessor(&self, index: usize, member: &str) -> Option<Piece<'a>> {
        self.gate.find(ACCESSORS, index)?.member(member)
    }

    /// Positions and indices of a primitive that is a Draco stream.
    fn draco(
        &mut self,
        piece: &Piece<'a>,
        purpose: Purpose,
        position: usize,
        place: &str,
        log: &mut Log,
    ) -> Logged<(Rc<Elements<'a>>, Rc<Elements<'a>>)> {
        let stream = Value::Object(self.gate.members(piece, STREAM, log)?);
        let number = |pointer: &str| stream.pointer(pointer).and_then(Value::as_u64).unwrap_or_default();
        let (view, id) = (number("/bufferView") as usize, number("/attributes/POSITION"));
        let view = self.accessors.buffers.view(view, &piece.path, log)?;
        if self.broken >= MOST_BROKEN {
            let why = format!("{MOST_BROKEN} before it are broken, so it is not tried");
            return Err(log.refuse(place, ProblemKind::Compressed { extension: DRACO.to_owned(), why }));
        }
        let left = self.accessors.buffers.left();
        let mesh = DracoMesh::decode(view.bytes(), self.most_triangles, left).map_err(|why| {
            self.broken += 1;
            log.refuse(place, ProblemKind::Compressed { extension: DRACO.to_owned(), why: clip(&why) })
        })?;
        self.accessors.buffers.take(mesh.bytes(), &piece.path, log)?;
        let Some(attribute) = u32::try_from(id).ok().and_then(|id| mesh.attribute(id)) else {
            let why = format!("it has no attribute {id}, which should be the positions");
            return Err(log.refuse(place, ProblemKind::Compressed { extension: DRACO.to_owned(), why }));
        };
        let normalized = self.accessor(position, "normalized").is_some_and(|normalized| normalized.text == "true");
        let corners = mesh.corners().flat_map(u32::to_le_bytes).collect();
        let corners = Attribute { components: 1, component_type: DataType::U32, bytes: corners };
        let positions = Elements::decoded(attribute, purpose, normalized);
        let indices = Elements::decoded(corners, Purpose::Index, false);
        let mut good = |elements: Result<_, _>| elements.map(Rc::new).map_err(|what| log.refuse(place, what));
        Ok((good(positions)?, good(indices)?))
    }

    /// The transforms of a mesh: one for each node, or more if the node is instanced.
    fn instances(&mut self, nodes: &Nodes<'a, 'g>, places: &[&PlacedNode], log: &mut Log) -> Logged<Rc<Vec<DAffine3>>> {
        let mut maps = Vec::new();
        for place in places {
            let node = self.gate.find(NODES, place.index);
            let Some(extension) = node.and_then(|node| node.extension(INSTANCING)) else {
                maps.push(place.map);
                continue;
            };
            let name = nodes.place(place.index);
            let attributes = extension.member("attributes");
            let mut read = |key: &'static str, purpose| -> Logged<Option<Rc<Elements<'a>>>> {
                let Some(attributes) = &attributes else { return Ok(None) };
                let members = self.gate.members(attributes, &[(key, NUMBER, MAY)], log)?;
                let index = members.get(key).and_then(Value::as_u64);
                index.map(|index| self.accessors.get(index as usize, purpose, &name, log)).transpose()
            };
            let (translation, scale) = (read("TRANSLATION", Purpose::Vector)?, read("SCALE", Purpose::Vector)?);
            let rotation = read("ROTATION", Purpose::Rotation)?;
            let counts = [&translation, &scale, &rotation].map(|e| e.as_ref().map(|e| e.count));
            let found = counts.into_iter().flatten().min().unwrap_or(0);
            if found > self.most_instances.saturating_sub(maps.len() as u64) {
                let what = ProblemKind::Limit { what: "instances of a node", found, limit: self.most_instances };
                return Err(log.refuse(name, what));
            }
            for i in 0..found {
                let t = translation.as_ref().map_or(DVec3::ZERO, |e| e.vector(i));
                let s = scale.as_ref().map_or(DVec3::ONE, |e| e.vector(i));
                let q = rotation.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |e| e.numbers(i));
                let local = DAffine3::from_scale_rotation_translation(s, unit(q, &name, log)?, t);
                maps.push(place.map * local);
            }
        }
        Ok(Rc::new(maps))
    }
}

/// The reason why a file has no triangles.
fn why_empty(
    selection: &Selection,
    order: &[(usize, Vec<&PlacedNode>)],
    left_out: &BTreeSet<&'static str>,
    meshes: usize,
) -> Option<String> {
    let placed = &selection.placed;
    if !left_out.is_empty() {
        let parts: Vec<&str> = left_out.iter().copied().collect();
        Some(format!("only {}", parts.join(" and ")))
    } else if !order.is_empty() {
        None
    } else if meshes == 0 {
        Some("it has no mesh at all".to_owned())
    } else if selection.hidden > 0 {
        Some(format!("its meshes are hidden (KHR_node_visibility, {})", counted(selection.hidden, "node", "nodes")))
    } else if placed.is_empty() {
        Some(format!("its scene shows none of {}", counted(meshes, "mesh", "meshes")))
    } else {
        let meshes = counted(meshes, "mesh", "meshes");
        Some(format!("it has {meshes}, but none of the nodes read ({}) shows one", placed.len()))
    }
}
