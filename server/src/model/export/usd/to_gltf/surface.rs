//! Materials of a stage as those of a `.glb`: base colour, its picture, metallic and roughness.

use super::Converter;
use super::values::{number, rows, vector};
use cairn_gltf::document::Object;
use openusd::sdf::{FieldKey, Path, Value};
use serde_json::json;
use std::io::{Cursor, Read};

/// Bytes of a picture in a package.
const MOST_PICTURE: u64 = 256 << 20;

/// A file of a package.
pub fn file_in(package: &[u8], name: &str) -> Option<Vec<u8>> {
    let mut archive = zip::ZipArchive::new(Cursor::new(package)).ok()?;
    let file = archive.by_name(name).ok()?;
    let mut bytes = Vec::new();
    file.take(MOST_PICTURE).read_to_end(&mut bytes).ok()?;
    Some(bytes)
}

impl Converter<'_> {
    pub(super) fn material(&mut self, prim: &Path) -> Option<usize> {
        if let Some(known) = self.materials.get(prim.as_str()) {
            return *known;
        }
        let made = self.surface(prim).map(|material| self.out.push("materials", material));
        self.materials.insert(prim.as_str().to_owned(), made);
        made
    }

    fn surface(&mut self, prim: &Path) -> Option<serde_json::Value> {
        let source = |prim: &Path, name: &str| -> Option<Path> {
            Some(self.targets(prim, name, FieldKey::ConnectionPaths).first()?.prim_path())
        };
        let surface = source(prim, "outputs:surface")?;
        let color = |name: &str| self.value(&surface, name).and_then(vector);
        let texture = source(&surface, "inputs:diffuseColor").or_else(|| source(&surface, "inputs:emissiveColor"));
        let plain = color("inputs:diffuseColor").filter(|color| *color != [0.0; 3]);
        let mut factor = plain.or_else(|| color("inputs:emissiveColor")).unwrap_or([1.0; 3]).to_vec();
        factor.push(1.0);
        let share = |name: &str, otherwise: f64| self.value(&surface, name).and_then(number).unwrap_or(otherwise);
        let (metallic, roughness) = (share("inputs:metallic", 0.0), share("inputs:roughness", 0.5));
        let mut pbr = json!({ "metallicFactor": metallic, "roughnessFactor": roughness });
        if let Some(texture) = texture {
            if let Some(scale) = self.value(&texture, "inputs:scale").and_then(rows) {
                factor = scale.into_iter().next().filter(|scale| scale.len() == 4).unwrap_or(factor);
            }
            if let Some(Value::AssetPath(file)) = self.value(&texture, "inputs:file") {
                let image = self.image(file.as_str().trim_start_matches("./"));
                pbr["baseColorTexture"] = json!({ "index": image });
            }
        }
        pbr["baseColorFactor"] = json!(factor);
        Some(json!({ "name": prim.name().unwrap_or_default(), "pbrMetallicRoughness": pbr }))
    }

    /// The texture of a picture; one that cannot be had keeps its name, so that this can be said.
    fn image(&mut self, name: &str) -> usize {
        if let Some(known) = self.images.get(name) {
            return *known;
        }
        let image = match (self.pictures)(name) {
            Ok(bytes) => {
                let media = if bytes.starts_with(b"\x89PNG") { "image/png" } else { "image/jpeg" };
                json!({ "bufferView": self.out.push_view(&bytes, Object::new()), "mimeType": media })
            }
            Err(_) => json!({ "uri": name }),
        };
        let image = self.out.push("images", image);
        let texture = self.out.push("textures", json!({ "source": image }));
        self.images.insert(name.to_owned(), texture);
        texture
    }
}
