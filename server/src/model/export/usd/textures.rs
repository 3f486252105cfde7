//! The pictures of a USD result: files beside it, or inside the package.
//!
//! A picture's name is a hash of its content: results in one folder share their pictures, and none replaces another's.

use super::super::copy::Source;
use super::super::images;
use crate::model::document::reference;
use std::collections::BTreeMap;

/// The folder that they are in, beside the layer.
pub const FOLDER: &str = "textures";

/// Pictures by their path from the layer's folder.
#[derive(Default)]
pub struct Textures(pub BTreeMap<String, Vec<u8>>);

impl Textures {
    /// Takes in a picture of a source, and gives its path. `None` for one that cannot be found, or that is of a kind which USD's
    /// programs do not read: they read PNG and JPEG.
    pub fn add(&mut self, source: &Source, image: usize) -> Option<String> {
        let image = source.document.get("images", image).ok()?;
        let bytes = match reference(image, "bufferView") {
            Some(view) => source.document.view(view).ok()?.to_vec(),
            None => images::external(image, source.resolve)?.1,
        };
        let ending = match images::media_type(&bytes)? {
            "image/png" => "png",
            "image/jpeg" => "jpg",
            _ => return None,
        };
        let path = format!("{FOLDER}/{}.{ending}", &blake3::hash(&bytes).to_hex()[..16]);
        self.0.insert(path.clone(), bytes);
        Some(path)
    }
}
