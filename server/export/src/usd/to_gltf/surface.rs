//! Materials of a stage as those of a `.glb`: base colour, its picture, metallic and roughness.

use super::Converter;
use super::values::{number, rows, vector};
use cairn_gltf::document::Object;
use cairn_gltf::media::media_type;
use openusd::sdf::{AssetPath, Path, Value};
use serde_json::json;

impl Converter<'_> {
    pub(super) fn material(&mut self, prim: &Path) -> Option<usize> {
        if let Some(known) = self.materials.get(prim.as_str()) {
            return *known;
        }
        let surface = self.surface(prim);
        if surface.is_none() {
            self.note("its materials other than UsdPreviewSurface are left out of copies and of pictures", prim);
        }
        let made = surface.map(|material| self.out.push("materials", material));
        self.materials.insert(prim.as_str().to_owned(), made);
        made
    }

    fn surface(&mut self, prim: &Path) -> Option<serde_json::Value> {
        let source =
            |prim: &Path, name: &str| -> Option<Path> { Some(self.stage.sources(prim, name).first()?.prim_path()) };
        let surface = source(prim, "outputs:surface")?;
        if self.token(&surface, "info:id").is_none_or(|id| id != "UsdPreviewSurface") {
            return None;
        }
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
                let image = self.image(&file);
                pbr["baseColorTexture"] = json!({ "index": image });
            }
        }
        pbr["baseColorFactor"] = json!(factor);
        Some(json!({ "name": prim.name().unwrap_or_default(), "pbrMetallicRoughness": pbr }))
    }

    /// The texture of a picture; one that cannot be had keeps its name, so that this can be said.
    fn image(&mut self, file: &AssetPath) -> usize {
        let name = file.resolved_path().unwrap_or_else(|| file.asset_path().trim_start_matches("./"));
        if let Some(known) = self.images.get(name) {
            return *known;
        }
        let image = match self.stage.file(name) {
            Some(bytes) => {
                let media = media_type(&bytes).unwrap_or("image/png");
                json!({ "bufferView": self.out.push_view(&bytes, Object::new()), "mimeType": media })
            }
            None => json!({ "uri": name }),
        };
        let image = self.out.push("images", image);
        let texture = self.out.push("textures", json!({ "source": image }));
        self.images.insert(name.to_owned(), texture);
        texture
    }
}
