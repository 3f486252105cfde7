//! Nothing of a model is lost in silence: whatever the input has and the result has not, a note says.
//!
//! The inputs are generated, and the files of a collection (see `collection.rs`).

use crate::output::collection::collection;
use crate::output::files::{PNG, encode, no_files, pile_of};
use crate::output::reader::json_of;
use cairn_export::{ExportScene, Format, SourceModel, rehearse};
use cairn_files::{Disk, FileSource};
use cairn_geometry::pose::Pose;
use cairn_input::asset::{self, Limits, Source};
use cairn_job::InputFile;
use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// What a file shows, and what hangs on that.
#[derive(Debug, Default)]
struct Inventory {
    /// Times that a mesh is shown.
    shown: u64,
    hidden: bool,
    meshes: BTreeSet<u64>,
    materials: BTreeSet<u64>,
    /// Images that are in use; and those that are inside the file.
    images: BTreeSet<u64>,
    embedded: BTreeSet<u64>,
    /// Names of vertex attributes, each with the number of primitives that have it.
    attributes: BTreeMap<String, usize>,
    morphs: usize,
    has_weights: bool,
    skins: usize,
    cameras: usize,
    animations: usize,
    extensions: BTreeSet<String>,
}

/// Extensions whose data is decoded, unfolded or obeyed: the result does not need them.
const DECODED: [&str; 5] = [
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "EXT_mesh_gpu_instancing",
    "KHR_node_visibility",
];

/// The inventory of the default scene. Written without the product's own walk.
fn inventory(json: &Value) -> Inventory {
    let mut found = Inventory::default();
    let list = |name: &str| json[name].as_array().cloned().unwrap_or_default();
    let numbers = |of: &Value| of.as_array().into_iter().flatten().filter_map(Value::as_u64).collect::<Vec<_>>();
    let (nodes, scenes) = (list("nodes"), list("scenes"));
    let mut open = match scenes.get(json["scene"].as_u64().unwrap_or(0) as usize) {
        Some(scene) => {
            found.extensions_of(scene);
            numbers(&scene["nodes"])
        }
        None => {
            let children: BTreeSet<u64> = nodes.iter().flat_map(|node| numbers(&node["children"])).collect();
            (0..nodes.len() as u64).filter(|node| !children.contains(node)).collect()
        }
    };
    found.extensions_of(json);
    found.animations = list("animations").len();
    let mut seen = BTreeSet::new();
    while let Some(index) = open.pop() {
        let node = &nodes[index as usize];
        if !seen.insert(index) {
            continue;
        }
        if node["extensions"]["KHR_node_visibility"]["visible"] == false {
            found.hidden = true;
            continue;
        }
        open.extend(numbers(&node["children"]));
        found.extensions_of(node);
        found.cameras += usize::from(node.get("camera").is_some());
        let Some(mesh) = node["mesh"].as_u64() else { continue };
        found.meshes.insert(mesh);
        let copies = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"].as_object().map_or(1, |attributes| {
            let poses = attributes.iter().filter(|(name, _)| !name.starts_with('_'));
            poses
                .map(|(_, at)| json["accessors"][at.as_u64().unwrap() as usize]["count"].as_u64().unwrap())
                .min()
                .unwrap_or(0)
        });
        found.shown += copies;
        found.skins += usize::from(node.get("skin").is_some());
        found.weights_of(node);
    }
    for mesh in found.meshes.clone() {
        let mesh = &list("meshes")[mesh as usize];
        found.extensions_of(mesh);
        found.weights_of(mesh);
        for primitive in mesh["primitives"].as_array().into_iter().flatten() {
            found.extensions_of(primitive);
            found.morphs += primitive["targets"].as_array().map_or(0, Vec::len);
            for name in primitive["attributes"].as_object().into_iter().flat_map(|all| all.keys()) {
                *found.attributes.entry(name.clone()).or_default() += 1;
            }
            found.materials.extend(primitive["material"].as_u64());
        }
    }
    for material in found.materials.clone() {
        let material = list("materials").get(material as usize).cloned().unwrap_or_default();
        let mut textures = Vec::new();
        found.below(&material, &mut textures);
        for texture in textures {
            let texture = list("textures").get(texture as usize).cloned().unwrap_or_default();
            found.extensions_of(&texture);
            let sampler = texture["sampler"].as_u64().and_then(|at| list("samplers").get(at as usize).cloned());
            found.extensions_of(&sampler.unwrap_or_default());
            found.images.extend(texture["source"].as_u64());
            for extension in texture["extensions"].as_object().into_iter().flat_map(|all| all.values()) {
                found.images.extend(extension["source"].as_u64());
            }
        }
    }
    for image in found.images.clone() {
        let image_json = list("images").get(image as usize).cloned().unwrap_or_default();
        found.extensions_of(&image_json);
        let is_data = image_json["uri"].as_str().is_some_and(|uri| uri.starts_with("data:"));
        if image_json.get("bufferView").is_some() || is_data {
            found.embedded.insert(image);
        }
    }
    found
}

impl Inventory {
    fn extensions_of(&mut self, entry: &Value) {
        self.extensions.extend(entry["extensions"].as_object().into_iter().flat_map(|all| all.keys().cloned()));
    }

    fn weights_of(&mut self, entry: &Value) {
        self.has_weights |= entry["weights"].as_array().is_some_and(|all| all.iter().any(|weight| *weight != json!(0)));
    }

    /// Extensions and textures of a material, at any depth.
    fn below(&mut self, object: &Value, textures: &mut Vec<u64>) {
        self.extensions_of(object);
        for (key, value) in object.as_object().into_iter().flatten().filter(|(key, _)| *key != "extras") {
            if value.is_object() {
                if key != "extensions" {
                    textures.extend(value["index"].as_u64());
                }
                self.below(value, textures);
            }
        }
    }

    /// Every difference from a result, with a word that one of the notes must have.
    fn lost(&self, result: &Inventory) -> Vec<(String, String)> {
        let mut lost = Vec::new();
        let mut differ = |what: &str, is: bool, word: &str| {
            if is {
                lost.push((what.to_owned(), word.to_owned()));
            }
        };
        differ("a hidden node", self.hidden, "is hidden");
        differ("shown meshes", self.shown != result.shown, "(nothing may be said instead)");
        differ("meshes", self.meshes.len() != result.meshes.len(), "(nothing may be said instead)");
        differ("materials", self.materials.len() != result.materials.len(), "material");
        differ("images", self.images.len() > result.embedded.len(), "image");
        differ("morph targets", self.morphs != result.morphs, "morph targets");
        differ("default weights", self.has_weights && !result.has_weights, "default weights");
        differ("skins", self.skins > 0, "skin is not applied");
        differ("cameras", self.cameras > 0, "camera");
        differ("animations", self.animations > 0, "animation");
        for (name, count) in &self.attributes {
            let is_of_skin = name.starts_with("JOINTS_") || name.starts_with("WEIGHTS_");
            if !is_of_skin {
                differ(name, result.attributes.get(name) != Some(count), name);
            }
        }
        for name in self.extensions.iter().filter(|name| !DECODED.contains(&name.as_str())) {
            differ(name, !result.extensions.contains(name), name);
        }
        lost
    }
}

/// All notes of a model, and its result.
fn noted(model: &SourceModel, source: &dyn FileSource) -> Option<(Vec<String>, Value)> {
    let SourceModel { file, bytes, resolve, .. } = *model;
    let read = asset::read(&Source { name: file, bytes, node: None, resolve, limits: Limits::default() });
    let mut notes = read.ok()?.notes;
    let rehearsal = rehearse(&[*model], false, source);
    let rehearsal = rehearsal.unwrap_or_else(|errors| panic!("{file}: {errors:?}"));
    notes.extend(rehearsal.left_out);
    let pose = Pose { translation: DVec3::Y, rotation: DQuat::IDENTITY };
    let scene = ExportScene { props: vec![*model], ..Default::default() };
    let result = encode(Format::Glb, &pile_of(&[(0, 1.0)], vec![vec![pose]]), &scene);
    let result = json_of(&result.unwrap_or_else(|error| panic!("{file}: {error}")));
    assert!(rehearsal.bytes <= result["buffers"][0]["byteLength"].as_u64().unwrap_or(0) as usize, "{file}");
    Some((notes, result))
}

fn check(name: &str, json: &Value, notes: &[String], result: &Value) -> usize {
    let (given, made) = (inventory(json), inventory(result));
    let lost = given.lost(&made);
    for (what, word) in &lost {
        assert!(notes.iter().any(|note| note.contains(word)), "{name}: {what} lost in silence: {notes:#?}\n{json:#}");
    }
    // Each image that is not embedded has a note of its own.
    let missing = given.images.len().saturating_sub(made.embedded.len());
    let reported = notes.iter().filter(|note| note.contains("the image \"")).count();
    assert!(reported >= missing.min(1), "{name}: {missing} images, {reported} notes");
    // And nothing is said of a model that loses nothing.
    let left_out = notes.iter().filter(|note| note.contains("left out of the result"));
    assert!(!lost.is_empty() || left_out.count() == 0, "{name}: {notes:#?}");
    lost.len()
}

/// A file with things of every kind in random places, without data that could not be read.
fn generated(rng: &mut Pcg64Mcg) -> Value {
    let data: Vec<u8> =
        [0.0f32, 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.].iter().flat_map(|x| x.to_le_bytes()).collect();
    let faces: [u16; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
    let data: Vec<u8> = data.into_iter().chain(faces.iter().flat_map(|i| i.to_le_bytes())).collect();
    let percent = |bytes: &[u8]| bytes.iter().map(|byte| format!("%{byte:02x}")).collect::<String>();
    let mut maybe = |chance: f64| rng.random_bool(chance);
    let mut extension = |entry: &mut Value, name: &str, chance: f64| {
        if maybe(chance) {
            entry["extensions"][name] = json!({ "any": [1, 2] });
        }
    };
    let mut images = vec![
        json!({ "uri": format!("data:image/png,{}", percent(PNG)) }),
        json!({ "uri": "gone.png" }),
        json!({ "uri": "https://example.org/far.png" }),
        json!({ "uri": "here.png" }),
        json!({ "uri": "text.png" }),
    ];
    images.iter_mut().for_each(|image| extension(image, "ACME_image", 0.1));
    let mut samplers = vec![json!({ "wrapS": 33071 })];
    extension(&mut samplers[0], "ACME_sampler", 0.2);
    let mut textures: Vec<Value> = (0..5).map(|source| json!({ "source": source, "sampler": 0 })).collect();
    textures.iter_mut().for_each(|texture| extension(texture, "ACME_texture", 0.1));
    textures[0]["extensions"]["EXT_texture_webp"] = json!({ "source": 3 });
    let mut materials: Vec<Value> = (0..5)
        .map(|index| {
            let pbr = json!({ "baseColorTexture": { "index": index } });
            json!({ "name": format!("m{index}"), "pbrMetallicRoughness": pbr })
        })
        .collect();
    for material in &mut materials {
        extension(material, "KHR_materials_sheen", 0.3);
        extension(material, "KHR_xmp_json_ld", 0.2);
        extension(&mut material["pbrMetallicRoughness"]["baseColorTexture"], "KHR_texture_transform", 0.3);
    }
    let mut rng = Pcg64Mcg::seed_from_u64(rng.random());
    let mut meshes = Vec::new();
    for _ in 0..3 {
        let mut primitive = json!({ "attributes": { "POSITION": 0 }, "indices": 1 });
        if rng.random_bool(0.7) {
            primitive["material"] = json!(rng.random_range(0..5));
        }
        if rng.random_bool(0.3) {
            primitive["attributes"]["NORMAL"] = json!(0);
        }
        if rng.random_bool(0.2) {
            primitive["attributes"]["_OWN"] = json!(0);
        }
        if rng.random_bool(0.2) {
            primitive["attributes"]["JOINTS_0"] = json!(0);
            primitive["attributes"]["WEIGHTS_0"] = json!(0);
        }
        if rng.random_bool(0.3) {
            primitive["targets"] = json!([{ "POSITION": 0 }]);
        }
        if rng.random_bool(0.2) {
            primitive["extensions"]["KHR_materials_variants"] = json!({ "mappings": [] });
        }
        let mut mesh = json!({ "primitives": [primitive] });
        if rng.random_bool(0.2) {
            mesh["weights"] = json!([rng.random_range(0..2)]);
        }
        if rng.random_bool(0.2) {
            mesh["extensions"]["ACME_mesh"] = json!({});
        }
        meshes.push(mesh);
    }
    let mut nodes = vec![json!({ "mesh": 0 })];
    for at in 1..8 {
        let mut node = json!({});
        for (key, value, chance) in [
            ("mesh", json!(rng.random_range(0..3)), 0.6),
            ("camera", json!(0), 0.1),
            ("skin", json!(0), 0.1),
            ("weights", json!([1]), 0.1),
        ] {
            if rng.random_bool(chance) {
                node[key] = value;
            }
        }
        for (name, value, chance) in [
            ("KHR_lights_punctual", json!({ "light": 0 }), 0.1),
            ("ACME_node", json!({}), 0.1),
            ("KHR_node_visibility", json!({ "visible": rng.random_bool(0.5) }), 0.2),
            ("EXT_mesh_gpu_instancing", json!({ "attributes": { "TRANSLATION": 0 } }), 0.2),
        ] {
            if rng.random_bool(chance) {
                node["extensions"][name] = value;
            }
        }
        nodes.push(node);
        let parent = &mut nodes[rng.random_range(0..at)];
        let mut children = parent["children"].as_array().cloned().unwrap_or_default();
        children.push(json!(at));
        parent["children"] = json!(children);
    }
    let mut file = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": nodes, "meshes": meshes,
        "materials": materials, "textures": textures, "samplers": samplers, "images": images,
        "cameras": [{ "type": "perspective" }], "skins": [{ "joints": [0] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4 },
            { "bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 12 },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 24 },
        ],
        "buffers": [{ "byteLength": 72, "uri": format!("data:,{}", percent(&data)) }],
    });
    for (name, chance) in [("KHR_lights_punctual", 0.2), ("ACME_root", 0.1)] {
        if rng.random_bool(chance) {
            file["extensions"][name] = json!({});
        }
    }
    if rng.random_bool(0.2) {
        file["scenes"][0]["extensions"] = json!({ "EXT_lights_image_based": {} });
    }
    if rng.random_bool(0.2) {
        file["animations"] = json!([{ "channels": [], "samplers": [] }]);
    }
    file
}

#[test]
fn nothing_of_generated_files_is_lost_in_silence() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let resolve = |path: &str| match path {
        "here.png" => Ok(PNG.to_vec()),
        "text.png" => Ok(b"no picture".to_vec()),
        path => no_files(path),
    };
    let mut lost = 0;
    for number in 0..400 {
        let file = generated(&mut rng);
        let (name, text) = (format!("file {number}"), file.to_string());
        let model = SourceModel {
            name: &name,
            file: &name,
            bytes: text.as_bytes(),
            node: None,
            resolve: &resolve,
            asset: None,
        };
        let (notes, result) = noted(&model, &Disk::default()).expect("it has triangles");
        lost += check(&name, &file, &notes, &result);
    }
    assert!(lost > 400, "the generator makes little that can be lost: {lost}");
}

#[test]
fn nothing_of_a_collection_is_lost_in_silence() {
    let (folder, names) = collection();
    let disk: Arc<dyn FileSource> = Arc::new(Disk::default());
    let mut read = 0;
    for name in names {
        let Ok(file) = InputFile::read(&folder.join(&name), &disk) else { continue };
        let model = SourceModel {
            name: &name,
            file: &file.name,
            bytes: &file.bytes,
            node: None,
            resolve: &*file.resolve,
            asset: None,
        };
        let Some((notes, result)) = noted(&model, &*disk) else { continue };
        let json = if file.bytes.starts_with(b"glTF") {
            json_of(&file.bytes)
        } else {
            serde_json::from_slice(&file.bytes).unwrap()
        };
        check(&name, &json, &notes, &result);
        read += 1;
    }
    assert!(read >= 10);
}
