//! Primitives of the placed nodes, made into one welded mesh.
//!
//! Each mesh is checked once and then laid down for each node that shows it. The number of triangles is known and held
//! against its limit before any is made.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use glam::{DAffine3, DVec3};

use super::accessor::{Accessors, Elements, Role};
use super::compressed::{Attribute, DRACO, DracoMesh};
use super::json::{Json, element};
use super::log::{Checked, Log};
use super::node::{Nodes, Placed, unit};
use super::problem::{ProblemKind, clip};
use super::strip::{self, Mode};
use crate::geometry::mesh::TriMesh;
use crate::geometry::weld::Welder;

/// Metres from the origin beyond which a point is taken for a mistake: the sun is nearer.
const FARTHEST: f64 = 1e12;

/// Draco streams of one file that may turn out to be broken: decoding one that is may take as long as one that is not,
/// and its length does not tell how long.
const MOST_BROKEN: u32 = 8;

const INSTANCING: &str = "EXT_mesh_gpu_instancing";

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

pub(super) struct Builder<'a, 'j> {
    pub root: &'j Json<'a>,
    pub accessors: Accessors<'a, 'j>,
    pub quantized: bool,
    pub most_triangles: u64,
    pub most_instances: u64,
    /// Extensions met on nodes, meshes and primitives.
    pub extensions: BTreeSet<String>,
    /// Draco streams that could not be decoded.
    pub broken: u32,
}

impl<'a, 'j> Builder<'a, 'j> {
    pub fn build(&mut self, nodes: &Nodes<'a, 'j>, placed: &[Placed], log: &mut Log) -> Checked<Built> {
        // Nodes by mesh, in the order in which the meshes are met.
        let mut order: Vec<(u64, Vec<&Placed>)> = Vec::new();
        let mut known: BTreeMap<u64, usize> = BTreeMap::new();
        for place in placed {
            let node = &nodes.items[place.index];
            self.meet(node);
            let Ok(Some(mesh)) = node.natural_at("mesh", &format!("/nodes/{}", place.index), log) else { continue };
            if node.get("skin").is_some() {
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
        built.why_empty = why_empty(placed, &order, &left_out, self.root);
        Ok(built)
    }

    fn meet(&mut self, object: &Json<'a>) {
        self.extensions.extend(object.get("extensions").into_iter().flat_map(Json::keys).map(str::to_owned));
    }

    /// The primitives of a mesh that make triangles, with good accessors.
    fn primitives(
        &mut self,
        mesh: u64,
        place: &str,
        left_out: &mut BTreeSet<&'static str>,
        log: &mut Log,
    ) -> Checked<Vec<Primitive<'a>>> {
        let (_, mesh, path) = element(self.root, "meshes", "mesh", mesh, place, log)?;
        self.meet(mesh);
        let list = mesh.list_at("primitives", &path, log)?;
        let mut good = Vec::new();
        for (k, item) in list.iter().enumerate() {
            let (place, path) = (format!("{place}, primitive {k}"), format!("{path}/primitives/{k}"));
            if let Ok(Some(primitive)) = self.primitive(item, place, &path, left_out, log) {
                good.push(primitive);
            }
        }
        Ok(good)
    }

    fn primitive(
        &mut self,
        item: &Json<'a>,
        place: String,
        path: &str,
        left_out: &mut BTreeSet<&'static str>,
        log: &mut Log,
    ) -> Checked<Option<Primitive<'a>>> {
        self.meet(item);
        let mode = match item.natural_at("mode", path, log)?.unwrap_or(4) {
            4 => Mode::Triangles,
            5 => Mode::Strip,
            6 => Mode::Fan,
            0..=3 => {
                left_out.insert("points and lines");
                log.note("points and lines are left out", &place);
                return Ok(None);
            }
            other => {
                let what = ProblemKind::Type { expected: "a mode, 0 to 6", found: other.to_string() };
                return Err(log.refuse(format!("{path}/mode"), what));
            }
        };
        let nothing = Json::Null;
        let attributes = item.get("attributes").unwrap_or(&nothing);
        let position = attributes.natural_at("POSITION", &format!("{path}/attributes"), log);
        let indices = item.natural_at("indices", path, log);
        let (position, indices) = (position?, indices?);

        // Compressed geometry may stand beside a plain copy: then the accessors have views.
        let draco = item.get("extensions").and_then(|e| e.get(DRACO));
        let plain =
            position.is_some_and(|p| self.accessors.has_data(p)) && indices.is_none_or(|i| self.accessors.has_data(i));
        let Some(position) = position else {
            left_out.insert("primitives without positions");
            log.note("it has no POSITION and is left out", &place);
            return Ok(None);
        };
        if item.get("targets").is_some() {
            log.note("its morph targets are not applied: the base shape is read", &place);
        }
        let role = Role::Position { quantized: self.quantized };
        if let Some(draco) = draco.filter(|_| !plain) {
            let (positions, indices) = self.draco(draco, role, position, &place, path, log)?;
            // The stream holds triangles, whatever they were made from.
            return Ok(Some(Primitive { positions, indices: Some(indices), mode: Mode::Triangles, place }));
        }
        let positions = self.accessors.get(position, role, &place, log);
        let indices = indices.map(|i| self.accessors.get(i, Role::Index, &place, log)).transpose();
        Ok(Some(Primitive { positions: positions?, indices: indices?, mode, place }))
    }

    /// Positions and indices of a primitive that is a Draco stream.
    fn draco(
        &mut self,
        draco: &Json<'a>,
        role: Role,
        position: u64,
        place: &str,
        path: &str,
        log: &mut Log,
    ) -> Checked<(Rc<Elements<'a>>, Rc<Elements<'a>>)> {
        let path = format!("{path}/extensions/{DRACO}");
        let nothing = Json::Null;
        let attributes = draco.get("attributes").unwrap_or(&nothing);
        let view = draco.required_at("bufferView", &path, log);
        let id = attributes.required_at("POSITION", &format!("{path}/attributes"), log);
        let (view, id) = (self.accessors.buffers.view(view?, &path, log)?, id?);
        if self.broken >= MOST_BROKEN {
            let why = format!("{MOST_BROKEN} before it are broken, so it is not tried");
            return Err(log.refuse(place, ProblemKind::Compressed { extension: DRACO.to_owned(), why }));
        }
        let left = self.accessors.buffers.left();
        let mesh = DracoMesh::decode(view.bytes(), self.most_triangles, left).map_err(|why| {
            self.broken += 1;
            log.refuse(place, ProblemKind::Compressed { extension: DRACO.to_owned(), why: clip(&why) })
        })?;
        self.accessors.buffers.take(mesh.bytes(), &path, log)?;
        let Some(attribute) = u32::try_from(id).ok().and_then(|id| mesh.attribute(id)) else {
            let why = format!("it has no attribute {id}, which should be the positions");
            return Err(log.refuse(place, ProblemKind::Compressed { extension: DRACO.to_owned(), why }));
        };
        let corners = mesh.corners().flat_map(u32::to_le_bytes).collect();
        let corners = Attribute { components: 1, component_type: 5125, bytes: corners };
        let positions = Elements::decoded(attribute, role, self.accessors.is_normalized(position));
        let indices = Elements::decoded(corners, Role::Index, false);
        let mut good = |elements: Result<_, _>| elements.map(Rc::new).map_err(|what| log.refuse(place, what));
        Ok((good(positions)?, good(indices)?))
    }

    /// Where a mesh is shown: once for each node, or more often if the node is instanced.
    fn instances(&mut self, nodes: &Nodes<'a, 'j>, places: &[&Placed], log: &mut Log) -> Checked<Rc<Vec<DAffine3>>> {
        let mut maps = Vec::new();
        for place in places {
            let node = &nodes.items[place.index];
            let Some(extension) = node.get("extensions").and_then(|e| e.get(INSTANCING)) else {
                maps.push(place.map);
                continue;
            };
            let (name, path) = (nodes.place(place.index), format!("/nodes/{}/extensions/{INSTANCING}", place.index));
            let nothing = Json::Null;
            let attributes = extension.get("attributes").unwrap_or(&nothing);
            let mut read = |key: &str, role| -> Checked<Option<Rc<Elements<'a>>>> {
                let index = attributes.natural_at(key, &format!("{path}/attributes"), log)?;
                index.map(|index| self.accessors.get(index, role, &name, log)).transpose()
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
    order: &[(u64, Vec<&Placed>)],
    left_out: &BTreeSet<&'static str>,
    root: &Json<'_>,
) -> Option<String> {
    let meshes = root.get("meshes").and_then(Json::items).map_or(0, <[_]>::len);
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
