//! The pictures of a USD result: files beside it, or inside the package.
//!
//! A picture's name is a hash of its content: results in one folder share their pictures, and none replaces another's.

use super::super::copy::Copier;
use std::collections::BTreeMap;

/// The folder that they are in, beside the layer.
pub const FOLDER: &str = "textures";

/// Pictures by their path from the layer's folder.
#[derive(Default)]
pub struct Textures(pub BTreeMap<String, Vec<u8>>);

impl Textures {
    /// Takes in a picture of a source, and gives its path. `None` for one that cannot be found, or that is of a kind
    /// which USD's programs do not read: they read PNG and JPEG.
    pub fn add(&mut self, source: &Copier, image: usize) -> Option<String> {
        let picture = source.document.picture(image, source.resolve).ok()?;
        let ending = match picture.media? {
            "image/png" => "png",
            "image/jpeg" => "jpg",
            _ => return None,
        };
        let path = format!("{FOLDER}/{}.{ending}", &blake3::hash(&picture.bytes).to_hex()[..16]);
        self.0.insert(path.clone(), picture.bytes.into_owned());
        Some(path)
    }
}
