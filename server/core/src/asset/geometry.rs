//! Primitives of the placed nodes, made into one welded mesh.
//!
//! Each mesh is checked once and then laid down for each node that shows it. The number of triangles is known and held
//! against its limit before any is made.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use glam::{DAffine3, DVec3};
use gltf::accessor::DataType;
use gltf::json::mesh::Primitive as Described;
use gltf::json::validation::Checked::Valid;
use gltf::mesh::{Mode, Semantic};
use serde_json::Value;

use super::accessor::{Accessors, Elements, Role};
use super::compressed::{Attribute, DRACO, DracoMesh};
use super::gate::{ACCESSORS, Gate, Kind, MAY, MESHES, MUST, Member, NODES, NUMBER, Piece};
use super::log::{Checked, Log};
use super::node::{Nodes, Placed, unit};
use super::problem::{ProblemKind, clip};
use super::strip;
use crate::geometry::mesh::TriMesh;
use crate::geometry::weld::Welder;

/// Metres from the origin beyond which a point is taken for a mistake: the sun is nearer.
const FARTHEST: f64 = 1e12;

/// Draco streams of one file that may turn out to be broken: decoding one that is may take as long as one that is not,
/// and its length does not tell how long.
const MOST_BROKEN: u32 = 8;

const INSTANCING: &str = "EXT_mesh_gpu_instancing";

const PRIMITIVE: &[Member] = &[("attributes", Kind::Part(&[("POSITION", NUMBER, MAY)]), MAY), ("indices", NUMBER, MAY)];

const STREAM: &[Member] =
    &[("bufferView", NUMBER, MUST), ("attributes", Kind::Part(&[("POSITION", NUMBER, MUST)]), MAY)];

/// What came of the primitives.
#[derive(Default)]
pub(super) struct Built {
    pub mesh: TriMesh,
    /// Triangles with two equal corners, left out.
    pub degenerate: usize,
    /// Why there may be no triangle.
    pub why_empty: Option<String>,
}

/// A primitive whose accessors are good.
struct Primitive<'a> {
    positions: Rc<Elements<'a>>,
    indices: Option<Rc<Elements<'a>>>,
    mode: Mode,
    place: String,
}

impl Primitive<'_> {
    fn corners(&self) -> u64 {
        self.indices.as_ref().map_or(self.positions.count, |i| i.count)
    }
}

pub(super) struct Builder<'a, 'g> {
    pub gate: &'g Gate<'a>,
    pub accessors: Accessors<'a, 'g>,
    pub quantized: bool,
    pub most_triangles: u64,
    pub most_instances: u64,
    /// Draco streams that could not be decoded.
    pub broken: u32,
}

impl<'a, 'g> Builder<'a, 'g> {
    pub fn build(&mut self, nodes: &Nodes<'a, 'g>, placed: &[Placed], log: &mut Log) -> Checked<Built> {
        // Nodes by mesh, in the order in which the meshes are met.
        let mut order: Vec<(usize, Vec<&Placed>)> = Vec::new();
        let mut known: BTreeMap<usize, usize> = BTreeMap::new();
        for place in placed {
            let node = &nodes.items[place.index];
            let Some(piece) = self.gate.find(NODES, place.index) else { continue };
            self.gate.meet(&piece);
            let Some(mesh) = node.mesh.map(|mesh| mesh.value()) else { continue };
            if piece.member("skin").is_some() {
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
        let mut work = Vec::new();
        let mut left_out = BTreeSet::new();
        for (mesh, places) in &order {
            let Some(first) = places.first() else { continue };
            let place = format!("{}, mesh {mesh}", nodes.place(first.index));
            let Ok(primitives) = self.primitives(*mesh, &place, &mut left_out, log) else { continue };
            let Ok(maps) = self.instances(nodes, places, log) else { continue };
            for primitive in primitives {
                let triangles = strip::at_most(primitive.mode, primitive.corners());
                match triangles.checked_mul(maps.len() as u64).and_then(|n| left.checked_sub(n)) {
                    Some(rest) => left = rest,
                    None => {
                        let (limit, found) = (self.most_triangles, self.most_triangles - left);
                        let found = found.saturating_add(triangles.saturating_mul(maps.len() as u64));
                        return Err(log.refuse(primitive.place, ProblemKind::Limit { what: "triangles", found, limit }));
                    }
                }
                if triangles > 0 {
                    work.push((primitive, Rc::clone(&maps)));
                }
            }
        }
        let mut welder = Welder::default();
        let mut built = Built::default();
        for (primitive, maps) in work {
            lay(&primitive, &maps, &mut welder, &mut built, log);
        }
        built.mesh.points = welder.into_points();
        let meshes = self.gate.count(MESHES, &mut Log::new("")).unwrap_or(0);
        built.why_empty = why_empty(placed, &order, &left_out, meshes);
        Ok(built)
    }

    /// The primitives of a mesh that make triangles, with good accessors.
    fn primitives(
        &mut self,
        mesh: usize,
        place: &str,
        left_out: &mut BTreeSet<&'static str>,
        log: &mut Log,
    ) -> Checked<Vec<Primitive<'a>>> {
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
    ) -> Checked<Option<Primitive<'a>>> {
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
        let role = Role::Position { quantized: self.quantized };
        // Compressed geometry may stand beside a plain copy: then the accessors have views.
        let has_data = |accessor| self.accessor(accessor, "bufferView").is_some();
        if let Some(stream) = extensions.and_then(|extensions| extensions.member(DRACO))
            && !(has_data(position) && indices.is_none_or(has_data))
        {
            let (positions, indices) = self.draco(&stream, role, position, &place, log)?;
            // The stream holds triangles, whatever they were made from.
            return Ok(Some(Primitive { positions, indices: Some(indices), mode: Mode::Triangles, place }));
        }
        let positions = self.accessors.get(position, role, &place, log);
        let indices = indices.map(|i| self.accessors.get(i, Role::Index, &place, log)).transpose();
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
        role: Role,
        position: usize,
        place: &str,
        log: &mut Log,
    ) -> Checked<(Rc<Elements<'a>>, Rc<Elements<'a>>)> {
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
        let positions = Elements::decoded(attribute, role, normalized);
        let indices = Elements::decoded(corners, Role::Index, false);
        let mut good = |elements: Result<_, _>| elements.map(Rc::new).map_err(|what| log.refuse(place, what));
        Ok((good(positions)?, good(indices)?))
    }

    /// Where a mesh is shown: once for each node, or more often if the node is instanced.
    fn instances(&mut self, nodes: &Nodes<'a, 'g>, places: &[&Placed], log: &mut Log) -> Checked<Rc<Vec<DAffine3>>> {
        let mut maps = Vec::new();
        for place in places {
            let node = self.gate.find(NODES, place.index);
            let Some(extension) = node.and_then(|node| node.extension(INSTANCING)) else {
                maps.push(place.map);
                continue;
            };
            let name = nodes.place(place.index);
            let attributes = extension.member("attributes");
            let mut read = |key: &'static str, role| -> Checked<Option<Rc<Elements<'a>>>> {
                let Some(attributes) = &attributes else { return Ok(None) };
                let members = self.gate.members(attributes, &[(key, NUMBER, MAY)], log)?;
                let index = members.get(key).and_then(Value::as_u64);
                index.map(|index| self.accessors.get(index as usize, role, &name, log)).transpose()
            };
            let (translation, scale) = (read("TRANSLATION", Role::Vector)?, read("SCALE", Role::Vector)?);
            let rotation = read("ROTATION", Role::Rotation)?;
            let counts = [&translation, &scale, &rotation].map(|e| e.as_ref().map(|e| e.count));
            let found = counts.into_iter().flatten().min().unwrap_or(0);
            if found > self.most_instances.saturating_sub(maps.len() as u64) {
                let what = ProblemKind::Limit { what: "instances of a node", found, limit: self.most_instances };
                return Err(log.refuse(name, what));
            }
            for i in 0..found {
                let t = translation.as_ref().map_or(DVec3::ZERO, |e| e.vector(i));
                let s = scale.as_ref().map_or(DVec3::ONE, |e| e.vector(i));
                let q = rotation.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |e| e.quaternion(i));
                let local = DAffine3::from_scale_rotation_translation(s, unit(q, &name, log)?, t);
                maps.push(place.map * local);
            }
        }
        Ok(Rc::new(maps))
    }
}

/// Adds a primitive to the mesh, once for each of `maps`.
fn lay(primitive: &Primitive<'_>, maps: &[DAffine3], welder: &mut Welder, built: &mut Built, log: &mut Log) {
    let Primitive { positions, indices, mode, place } = primitive;
    let Ok(triangles) = strip::triangles(*mode, positions, indices.as_deref(), place, log) else { return };
    let bad = triangles.iter().flatten().find(|&&v| !positions.vector(u64::from(v)).is_finite());
    if let Some(&vertex) = bad {
        let value = positions.vector(u64::from(vertex)).to_string();
        log.refuse(place.clone(), ProblemKind::NotFinite { vertex: u64::from(vertex), value });
        return;
    }
    // Welded numbers by vertex; without the memory if few of many vertices are used.
    const UNKNOWN: u32 = u32::MAX;
    let remember = positions.count <= 8 * triangles.len() as u64 + 1024;
    let mut numbers = vec![UNKNOWN; if remember { positions.count as usize } else { 0 }];
    for map in maps {
        let mirrored = map.matrix3.determinant() < 0.0;
        numbers.fill(UNKNOWN);
        for &triangle in &triangles {
            let mut welded = [0; 3];
            for (corner, vertex) in welded.iter_mut().zip(triangle) {
                if let Some(&number) = numbers.get(vertex as usize)
                    && number != UNKNOWN
                {
                    *corner = number;
                    continue;
                }
                let point = map.transform_point3(positions.vector(u64::from(vertex)));
                if !point.is_finite() || point.abs().max_element() > FARTHEST {
                    let (vertex, value) = (u64::from(vertex), point.to_string());
                    log.refuse(place.clone(), ProblemKind::TooFar { vertex, value, limit: FARTHEST });
                    return;
                }
                *corner = welder.insert(point);
                if let Some(number) = numbers.get_mut(vertex as usize) {
                    *number = *corner;
                }
            }
            let [a, b, c] = welded;
            if a == b || b == c || c == a {
                built.degenerate += 1;
            } else {
                built.mesh.triangles.push(if mirrored { [a, c, b] } else { [a, b, c] });
            }
        }
    }
}

/// Why a file without triangles has none.
fn why_empty(
    placed: &[Placed],
    order: &[(usize, Vec<&Placed>)],
    left_out: &BTreeSet<&'static str>,
    meshes: usize,
) -> Option<String> {
    if !left_out.is_empty() {
        let parts: Vec<&str> = left_out.iter().copied().collect();
        Some(format!("only {}", parts.join(" and ")))
    } else if !order.is_empty() {
        None
    } else if meshes == 0 {
        Some("it has no mesh at all".to_owned())
    } else if placed.is_empty() {
        Some(format!("it has {meshes} mesh(es), but its scene has no nodes"))
    } else {
        Some(format!("it has {meshes} mesh(es), but none of the {} node(s) read shows one", placed.len()))
    }
}
