//! The request of a bake: everything that decides its result. By it, a finished result is recognized and can be
//! repeated.

use super::report;
use super::sources::{InputFile, PortableNames, rename};
use cairn_export::Format;
use cairn_wire::digest::hex;
use cairn_wire::proto::{AssetReference, BakeSpec, OutputFormat, Scene};
use cairn_wire::scene_file::SceneTree;
use cairn_wire::versions::versions;
use prost::Message;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// A file of a scene.
#[derive(Clone, Debug)]
pub struct Asset {
    /// The model's name.
    model: String,
    /// The path from the model's folder, of a file that it names.
    beside: Option<String>,
    pub sha256: String,
}

impl Asset {
    /// Its name in results and on servers.
    pub fn uri(&self, names: &PortableNames) -> String {
        match &self.beside {
            Some(relative) => names.beside(&self.model, relative),
            None => names.of(&self.model),
        }
    }
}

/// A file and the files that it names and that are there, with their hashes.
pub fn assets(file: &InputFile) -> Vec<Asset> {
    let asset = |beside: Option<String>, bytes: &[u8]| Asset {
        model: file.name.clone(),
        beside,
        sha256: hex(&Sha256::digest(bytes)),
    };
    let beside = file.sidecars().into_iter().map(|(relative, bytes)| asset(Some(relative), &bytes));
    std::iter::once(asset(None, &file.bytes)).chain(beside).collect()
}

/// A request with all defaults filled in.
pub fn request(mut scene: Scene, assets: Vec<Asset>, format: Format, names: &PortableNames) -> BakeSpec {
    rename(&mut scene, |path| names.of(path));
    // Sorted by name, without repetitions.
    let assets = assets.into_iter().map(|asset| (asset.uri(names), asset.sha256));
    let assets: BTreeMap<String, String> = assets.collect();
    let assets = assets.into_iter().map(|(uri, sha256)| AssetReference { uri, sha256 }).collect();
    BakeSpec { scene: Some(scene), assets, format: format.wire().into(), ..Default::default() }
}

/// The hash of a request, without its format, layout and goal, and of the versions. Equal hashes have equal piles, to
/// the last byte.
pub fn hash(request: &BakeSpec) -> blake3::Hash {
    let mut bake = BakeSpec { format: OutputFormat::Unspecified.into(), ..request.clone() };
    bake.scene.iter_mut().for_each(|scene| (scene.usd, scene.goal) = (None, None));
    let mut all = versions().encode_length_delimited_to_vec();
    all.extend(bake.encode_to_vec());
    blake3::hash(&all)
}

/// The provenance that a result holds. With it and the files, the result can be baked again.
pub fn origin(request: &BakeSpec, result: blake3::Hash) -> Value {
    let scene = request.scene.as_ref().map(|scene| SceneTree::from_message(scene).to_value());
    let assets = request.assets.iter().map(|asset| json!({ "uri": asset.uri, "sha256": asset.sha256 }));
    json!({
        "scene": scene,
        "assets": assets.collect::<Vec<_>>(),
        "versions": report::versions_json(),
        "request_blake3": hash(request).to_hex().as_str(),
        "result_blake3": result.to_hex().as_str(),
    })
}
