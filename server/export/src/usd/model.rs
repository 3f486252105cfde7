//! Models as prims: the nodes of a source, its triangles, and materials beside them.

use super::super::copy::Copier;
use super::super::hierarchy::{Branch, BranchFrame, BranchNode};
use super::super::sources::Sources;
use super::super::{ExportError, PartPrim, SourceModel};
use super::bounding_box::BoundingBox;
use super::layer::{Encoding, Layer, quaternion, vector};
use super::material::{self, Materials};
use super::textures::Textures;
use cairn_gltf::document::{self, DocumentError, LocalTransform, Object, Triangles, reference};
use glam::{DAffine3, DMat4, DVec3};
use openusd::gf;
use openusd::sdf::{FieldKey, Path};
use openusd::tf::Token;
use std::collections::{BTreeMap, BTreeSet};

/// The stage under construction: its layer and textures, and the source files.
pub struct UsdStage<'a> {
    pub layer: Layer,
    pub textures: Textures,
    /// Prims between the default prim and assets are groups, as the model hierarchy has it.
    pub has_groups: bool,
    /// What is left out of a model, by its name.
    pub left_out: BTreeSet<(String, String)>,
    sources: Sources<'a>,
}

impl<'a> UsdStage<'a> {
    pub fn new(layer: Layer) -> UsdStage<'a> {
        let textures = Textures::default();
        UsdStage { layer, textures, has_groups: false, left_out: BTreeSet::new(), sources: Sources::default() }
    }

    /// Marks a prim above assets.
    pub fn group(&mut self, prim: &Path) {
        if self.has_groups {
            self.layer.set(prim, FieldKey::Kind, Token::from("group"));
        }
    }

    /// Whether a model is referred to, not copied.
    pub fn refers(&self, model: &SourceModel) -> bool {
        model.asset.is_some() && !self.layer.layout.embeds
    }

    /// Places a model below a prim, moved by `place` in the stage, and gives its bounding box in that prim's frame: as
    /// a reference where it is an asset, otherwise as a copy.
    pub fn put(
        &mut self,
        at: &Path,
        model: &'a SourceModel,
        frame: BranchFrame,
        place: DAffine3,
    ) -> Result<BoundingBox, ExportError> {
        let to_stage = place * self.layer.layout.to_stage();
        let mut bounds = BoundingBox::default();
        let Some(asset) = model.asset.as_ref().filter(|_| self.refers(model)) else {
            self.layer.transform(at, to_stage);
            bounds.join(&self.model(at, model, frame)?, to_stage);
            return Ok(bounds);
        };
        // What it takes up is known by a copy in a layer that is thrown away.
        let layout = self.layer.layout.clone();
        let layer = std::mem::replace(&mut self.layer, Layer::new(Encoding::Crate, layout));
        let (textures, left_out) = (std::mem::take(&mut self.textures), std::mem::take(&mut self.left_out));
        let scratch = self.layer.prim(&Path::abs_root(), "Copy", "Xform");
        let copied = self.model(&scratch, model, frame);
        (self.layer, self.textures, self.left_out) = (layer, textures, left_out);
        bounds.join(&copied?, to_stage);

        self.group(at);
        let is_whole = matches!(self.layer.layout.kind(true), "component" | "subcomponent");
        for PartPrim { path, place, off } in asset.prims {
            let name = path.rsplit('/').next().unwrap_or("Asset");
            // The prim below has transforms of its own.
            let mut parent = at.clone();
            let transform = to_stage * DAffine3::from_mat4(*place);
            if asset.prims.len() == 1 {
                self.layer.transform(at, transform);
            } else {
                parent = self.layer.prim(at, name, "Xform");
                self.layer.transform(&parent, transform);
            }
            let own = self.layer.prim(&parent, name, "");
            self.layer.refer(&own, asset.path, (!asset.is_default).then_some(path));
            off.iter().for_each(|other| self.layer.switch_off(&own, other));
            if is_whole {
                self.layer.set(&own, FieldKey::Kind, Token::from("subcomponent"));
            }
        }
        Ok(bounds)
    }

    /// Writes a model below an existing prim, and gives its bounding box in that prim's frame. Its materials stand
    /// below the prim, too, so that others can refer to the prim alone.
    pub fn model(&mut self, at: &Path, model: &'a SourceModel, frame: BranchFrame) -> Result<BoundingBox, ExportError> {
        let (source, branch) = self.sources.open(model, frame)?;
        let source = &*self.sources.get(source);
        let (layer, textures) = (&mut self.layer, &mut self.textures);
        let (materials, left_out) = (BTreeMap::new(), BTreeSet::new());
        let mut writer = ModelWriter { layer, textures, source, top: at, scope: None, materials, left_out };
        let bounds = writer.branch(&branch).map_err(|error| ExportError::source(model, error));
        self.left_out.extend(writer.left_out.into_iter().map(|what| (model.name.to_owned(), what)));
        bounds
    }
}

/// Writes one model.
struct ModelWriter<'w, 'a> {
    layer: &'w mut Layer,
    textures: &'w mut Textures,
    source: &'w Copier<'a>,
    /// The prim that it is below.
    top: &'w Path,
    /// The prim of its materials, once there is one.
    scope: Option<Path>,
    /// By index, and whether they are tinted; `None` for one that the source lacks.
    materials: BTreeMap<(usize, bool), Option<Path>>,
    left_out: BTreeSet<String>,
}

impl ModelWriter<'_, '_> {
    fn branch(&mut self, branch: &Branch) -> Result<BoundingBox, DocumentError> {
        let mut bounds = BoundingBox::default();
        if let Some(lone) = branch.lone_mesh() {
            self.meshes(self.top, lone, DAffine3::IDENTITY, &mut bounds)?;
            return Ok(bounds);
        }
        let top = (self.top.clone(), DAffine3::IDENTITY);
        let mut open: Vec<_> = branch.roots.iter().rev().map(|&root| (root, top.clone())).collect();
        while let Some((place, (parent, above))) = open.pop() {
            let node = &branch.nodes[place];
            let prim = self.layer.prim(&parent, name(&node.json, "Node"), "Xform");
            let world = above * self.transform(&prim, &node.json);
            self.meshes(&prim, node, world, &mut bounds)?;
            open.extend(node.children.iter().rev().map(|&child| (child, (prim.clone(), world))));
        }
        Ok(bounds)
    }

    /// Places a node's prim as the node, and gives the transform.
    fn transform(&mut self, prim: &Path, node: &Object) -> DAffine3 {
        let (ops, transform) = match document::matrix(node) {
            Some(matrix) => {
                // By rows, and points stand before their matrix: the same sixteen numbers.
                let op = "xformOp:transform";
                self.layer.attribute(prim, &format!("matrix4d {op}"), gf::Matrix4d(matrix));
                (vec![op], DAffine3::from_mat4(DMat4::from_cols_array(&matrix)))
            }
            None => {
                let local = LocalTransform::of(node);
                let ops = ["xformOp:translate", "xformOp:orient", "xformOp:scale"];
                self.layer.attribute(prim, "double3 xformOp:translate", gf::Vec3d::from(local.translation.to_array()));
                self.layer.attribute(prim, "quatf xformOp:orient", quaternion(local.rotation));
                self.layer.attribute(prim, "float3 xformOp:scale", vector(local.scale));
                (ops.to_vec(), local.affine())
            }
        };
        self.layer.order(prim, &ops);
        transform
    }

    /// A node's mesh, as often as the node shows it.
    fn meshes(
        &mut self,
        prim: &Path,
        node: &BranchNode,
        world: DAffine3,
        bounds: &mut BoundingBox,
    ) -> Result<(), DocumentError> {
        let Some(mesh) = node.mesh else { return Ok(()) };
        let Some(copies) = self.source.document.instances(&node.json)? else {
            bounds.join(&self.mesh(prim, mesh)?, world);
            return Ok(());
        };
        let instancer = self.layer.prim(prim, "Copies", "PointInstancer");
        let prototype = self.layer.prim(&instancer, "Prototype", "Xform");
        let own = self.mesh(&prototype, mesh)?;
        let mut all = BoundingBox::default();
        copies.iter().for_each(|copy| all.join(&own, copy.affine()));
        bounds.join(&all, world);
        let layer = &mut *self.layer;
        layer.relationship(&instancer, "prototypes", &[prototype]);
        layer.attribute(&instancer, "int[] protoIndices", vec![0; copies.len()]);
        let positions: Vec<gf::Vec3f> = copies.iter().map(|copy| vector(copy.translation)).collect();
        layer.attribute(&instancer, "point3f[] positions", positions);
        let rotations: Vec<gf::Quatf> = copies.iter().map(|c| quaternion(c.rotation)).collect();
        layer.orientations(&instancer, vec![(0.0, rotations)], true);
        let scales: Vec<gf::Vec3f> = copies.iter().map(|copy| vector(copy.scale)).collect();
        layer.attribute(&instancer, "float3[] scales", scales);
        layer.attribute(&instancer, "float3[] extent", all.extent());
        Ok(())
    }

    /// A prim for each of a mesh's primitives that has triangles.
    fn mesh(&mut self, parent: &Path, index: usize) -> Result<BoundingBox, DocumentError> {
        let mut bounds = BoundingBox::default();
        let json = self.source.document.get("meshes", index)?;
        for primitive in self.source.document.primitives(index)? {
            if primitive.contains_key("targets") {
                self.left_out.insert("morph targets".into());
            }
            let triangles = Triangles::read(&self.source.document, index, primitive)?;
            if !triangles.corners.is_empty() {
                let prim = self.layer.prim(parent, name(json, "Mesh"), "Mesh");
                let own = self.triangles(&prim, &triangles, reference(primitive, "material"));
                bounds.join(&own, DAffine3::IDENTITY);
            }
        }
        Ok(bounds)
    }

    fn triangles(&mut self, prim: &Path, triangles: &Triangles, material: Option<usize>) -> BoundingBox {
        let json = material.and_then(|index| self.source.document.get("materials", index).ok());
        let is_double = json.and_then(|json| json.get("doubleSided")).and_then(serde_json::Value::as_bool);
        let mut bounds = BoundingBox::default();
        triangles.points.iter().for_each(|point| bounds.add(*point));
        let layer = &mut *self.layer;
        layer.attribute(prim, "uniform token subdivisionScheme", Token::from("none"));
        layer.attribute(prim, "uniform bool doubleSided", is_double.unwrap_or(false));
        layer.attribute(prim, "float3[] extent", bounds.extent());
        layer.attribute(prim, "int[] faceVertexCounts", vec![3; triangles.corners.len()]);
        let corners: Vec<i32> = triangles.corners.iter().flatten().map(|&i| i as i32).collect();
        layer.attribute(prim, "int[] faceVertexIndices", corners);
        let points: Vec<gf::Vec3f> = triangles.points.iter().map(|&point| vector(point)).collect();
        layer.attribute(prim, "point3f[] points", points);
        // An unreadable attribute that only decorates is left out.
        let (normals, of) = match triangles.vectors::<3>("NORMAL") {
            Ok(Some(normals)) => (normals.into_iter().map(DVec3::from).collect(), "vertex"),
            // glTF has flat triangles then, other programs would round them off.
            _ => (flat_normals(triangles), "uniform"),
        };
        let normals: Vec<gf::Vec3f> = normals.into_iter().map(vector).collect();
        layer.primvar(prim, "normal3f[] normals", of, normals);
        for set in 0.. {
            let Ok(Some(coordinates)) = triangles.vectors::<2>(&format!("TEXCOORD_{set}")) else { break };
            let flipped: Vec<gf::Vec2f> =
                coordinates.into_iter().map(|[u, v]| [u as f32, (1.0 - v) as f32].into()).collect();
            let name = material::coordinates(set);
            layer.primvar(prim, &format!("texCoord2f[] primvars:{name}"), "vertex", flipped);
        }
        let is_tinted = self.colors(prim, triangles, json);
        if let Some(material) = material.and_then(|index| self.material(index, is_tinted)) {
            self.layer.apply(prim, "MaterialBindingAPI");
            self.layer.relationship(prim, "material:binding", &[material]);
        }
        bounds
    }

    /// The colours of the vertices, times that of the material; whether there are any.
    fn colors(&mut self, prim: &Path, triangles: &Triangles, material: Option<&Object>) -> bool {
        let Ok(Some(colors)) = triangles.vectors::<3>("COLOR_0") else { return false };
        let base = material.map_or([1.0; 4], material::base_color);
        let tint = DVec3::new(base[0], base[1], base[2]);
        let colors: Vec<gf::Vec3f> = colors.into_iter().map(|color| vector(DVec3::from(color) * tint)).collect();
        self.layer.primvar(prim, "color3f[] primvars:displayColor", "vertex", colors);
        if let Ok(Some(colors)) = triangles.vectors::<4>("COLOR_0") {
            let opacities: Vec<f32> = colors.into_iter().map(|[.., alpha]| (alpha * base[3]) as f32).collect();
            self.layer.primvar(prim, "float[] primvars:displayOpacity", "vertex", opacities);
        }
        true
    }

    fn material(&mut self, index: usize, is_tinted: bool) -> Option<Path> {
        if let Some(known) = self.materials.get(&(index, is_tinted)) {
            return known.clone();
        }
        let scope = self.scope.get_or_insert_with(|| self.layer.prim(self.top, "Materials", "Scope")).clone();
        let (layer, textures, left_out) = (&mut *self.layer, &mut *self.textures, &mut self.left_out);
        let mut materials = Materials { layer, textures, source: self.source, left_out };
        let written = materials.write(&scope, index, is_tinted);
        self.materials.insert((index, is_tinted), written.clone());
        written
    }
}

/// The normal of each triangle; zero where it has no area.
fn flat_normals(triangles: &Triangles) -> Vec<DVec3> {
    let point = |i: usize| triangles.points[i];
    let normal = |&[a, b, c]: &[usize; 3]| (point(b) - point(a)).cross(point(c) - point(a)).normalize_or_zero();
    triangles.corners.iter().map(normal).collect()
}

/// The name of a source's entry.
fn name<'j>(entry: &'j Object, default: &'j str) -> &'j str {
    entry.get("name").and_then(serde_json::Value::as_str).filter(|name| !name.is_empty()).unwrap_or(default)
}
