//! glTF materials as `UsdPreviewSurface`.
//!
//! Base colour, metallic and roughness, normal, occlusion, emission, alpha, index of refraction and clear coat; what
//! else a material has, a preview surface does not. Vertex colours tint a material without a base-colour picture only:
//! a preview surface multiplies nothing.

use super::super::copy::Copier;
use super::layer::Layer;
use super::textures::Textures;
use cairn_gltf::document::{Object, reference};
use glam::DVec2;
use openusd::gf;
use openusd::sdf::{AssetPath, Path};
use openusd::tf::Token;
use serde_json::Value;
use std::collections::BTreeSet;

/// Writes materials of one source below one prim.
pub struct Materials<'w, 'a> {
    pub layer: &'w mut Layer,
    pub textures: &'w mut Textures,
    pub source: &'w Copier<'a>,
    /// What a preview surface does not have.
    pub left_out: &'w mut BTreeSet<String>,
}

/// Extensions of materials that are written.
const WRITTEN: [&str; 4] =
    ["KHR_materials_unlit", "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_clearcoat"];

/// The use of a picture's values: `value * scale + bias`.
struct Use {
    color_space: &'static str,
    scale: [f64; 4],
    bias: [f64; 4],
}

impl Use {
    fn raw(scale: [f64; 4], bias: [f64; 4]) -> Use {
        Use { color_space: "raw", scale, bias }
    }

    fn color(scale: [f64; 4]) -> Use {
        Use { color_space: "sRGB", scale, bias: [0.0; 4] }
    }
}

/// The name of a set of texture coordinates.
pub fn coordinates(set: usize) -> String {
    if set == 0 { "st".into() } else { format!("st{set}") }
}

/// The base colour of a material and its alpha, linear.
pub fn base_color(material: &Object) -> [f64; 4] {
    numbers(object(material, "pbrMetallicRoughness").and_then(|pbr| pbr.get("baseColorFactor"))).unwrap_or([1.0; 4])
}

impl Materials<'_, '_> {
    /// Writes a material, and gives its prim. `is_tinted`: by the colours of its mesh, in which its own is already.
    pub fn write(&mut self, scope: &Path, index: usize, is_tinted: bool) -> Option<Path> {
        let source = self.source;
        let json = source.document.get("materials", index).ok()?;
        let name = json.get("name").and_then(Value::as_str).unwrap_or("Material");
        let material = self.layer.prim(scope, name, "Material");
        let surface = self.shader(&material, "Surface", "UsdPreviewSurface");
        self.layer.connect(&material, "token outputs:surface", &output(&surface, "surface"));
        self.layer.declare(&surface, "token outputs:surface");
        self.base(&material, &surface, json, is_tinted);
        self.metal(&material, &surface, json);
        self.details(&material, &surface, json);
        self.extensions(&surface, json);
        Some(material)
    }

    fn base(&mut self, material: &Path, surface: &Path, json: &Object, is_tinted: bool) {
        let factor = base_color(json);
        let is_unlit = extension(json, "KHR_materials_unlit").is_some();
        let input = if is_unlit { "color3f inputs:emissiveColor" } else { "color3f inputs:diffuseColor" };
        if is_unlit {
            self.layer.attribute(surface, "color3f inputs:diffuseColor", color([0.0; 3]));
        }
        let info = object(json, "pbrMetallicRoughness").and_then(|pbr| object(pbr, "baseColorTexture"));
        let texture = info.and_then(|info| self.texture(material, "BaseColor", info, &Use::color(factor)));
        match &texture {
            Some(texture) => self.wire(surface, input, texture, "float3", "rgb"),
            None if is_tinted => {
                let reader = self.shader(material, "Tint", "UsdPrimvarReader_float3");
                self.layer.attribute(&reader, "string inputs:varname", "displayColor".to_owned());
                self.wire(surface, input, &reader, "float3", "result");
            }
            None => self.layer.attribute(surface, input, color([factor[0], factor[1], factor[2]])),
        }
        let mode = json.get("alphaMode").and_then(Value::as_str).unwrap_or("OPAQUE");
        if mode == "OPAQUE" {
            return;
        }
        match &texture {
            Some(texture) => self.wire(surface, "float inputs:opacity", texture, "float", "a"),
            None => self.layer.attribute(surface, "float inputs:opacity", factor[3] as f32),
        }
        if mode == "MASK" {
            let cutoff = number(json, "alphaCutoff", 0.5);
            self.layer.attribute(surface, "float inputs:opacityThreshold", cutoff as f32);
        }
    }

    fn metal(&mut self, material: &Path, surface: &Path, json: &Object) {
        let empty = Object::new();
        let pbr = object(json, "pbrMetallicRoughness").unwrap_or(&empty);
        let (metallic, roughness) = (number(pbr, "metallicFactor", 1.0), number(pbr, "roughnessFactor", 1.0));
        let used = Use::raw([1.0, roughness, metallic, 1.0], [0.0; 4]);
        let info = object(pbr, "metallicRoughnessTexture");
        match info.and_then(|info| self.texture(material, "MetallicRoughness", info, &used)) {
            Some(texture) => {
                self.wire(surface, "float inputs:metallic", &texture, "float", "b");
                self.wire(surface, "float inputs:roughness", &texture, "float", "g");
            }
            None => {
                self.layer.attribute(surface, "float inputs:metallic", metallic as f32);
                self.layer.attribute(surface, "float inputs:roughness", roughness as f32);
            }
        }
    }

    /// Normal, occlusion and emission.
    fn details(&mut self, material: &Path, surface: &Path, json: &Object) {
        if let Some(info) = object(json, "normalTexture") {
            let scale = number(info, "scale", 1.0);
            let used = Use::raw([2.0 * scale, 2.0 * scale, 2.0, 1.0], [-scale, -scale, -1.0, 0.0]);
            if let Some(texture) = self.texture(material, "Normal", info, &used) {
                self.wire(surface, "normal3f inputs:normal", &texture, "float3", "rgb");
            }
        }
        if let Some(info) = object(json, "occlusionTexture") {
            let strength = number(info, "strength", 1.0);
            let used = Use::raw([strength; 4], [1.0 - strength; 4]);
            if let Some(texture) = self.texture(material, "Occlusion", info, &used) {
                self.wire(surface, "float inputs:occlusion", &texture, "float", "r");
            }
        }
        let strength = extension(json, "KHR_materials_emissive_strength");
        let strength = strength.map_or(1.0, |extension| number(extension, "emissiveStrength", 1.0));
        let emitted = numbers(json.get("emissiveFactor")).unwrap_or([0.0; 3]).map(|channel| channel * strength);
        if emitted == [0.0; 3] || extension(json, "KHR_materials_unlit").is_some() {
            return;
        }
        let used = Use::color([emitted[0], emitted[1], emitted[2], 1.0]);
        let info = object(json, "emissiveTexture");
        match info.and_then(|info| self.texture(material, "Emissive", info, &used)) {
            Some(texture) => self.wire(surface, "color3f inputs:emissiveColor", &texture, "float3", "rgb"),
            None => self.layer.attribute(surface, "color3f inputs:emissiveColor", color(emitted)),
        }
    }

    fn extensions(&mut self, surface: &Path, json: &Object) {
        let names = object(json, "extensions").into_iter().flat_map(Object::keys);
        let lost = names.filter(|name| !WRITTEN.contains(&name.as_str()));
        self.left_out.extend(lost.map(|name| format!("material extension {name}")));
        if let Some(ior) = extension(json, "KHR_materials_ior") {
            self.layer.attribute(surface, "float inputs:ior", number(ior, "ior", 1.5) as f32);
        }
        if let Some(coat) = extension(json, "KHR_materials_clearcoat") {
            self.layer.attribute(surface, "float inputs:clearcoat", number(coat, "clearcoatFactor", 0.0) as f32);
            let roughness = number(coat, "clearcoatRoughnessFactor", 0.0) as f32;
            self.layer.attribute(surface, "float inputs:clearcoatRoughness", roughness);
        }
    }

    /// The shaders that read a picture; the last one's prim. `None` where the picture cannot be used.
    fn texture(&mut self, material: &Path, name: &str, info: &Object, used: &Use) -> Option<Path> {
        let source = self.source;
        let texture = source.document.get("textures", reference(info, "index")?).ok()?;
        let image = reference(texture, "source")?;
        let Some(file) = self.textures.add(source, image) else {
            // Missing ones were reported before the bake.
            if let Ok(Some(media)) = source.document.picture(image, source.resolve).map(|picture| picture.media) {
                self.left_out.insert(format!("pictures of the type {media}, only PNG and JPEG"));
            }
            return None;
        };
        let moved = extension(info, "KHR_texture_transform");
        let set = moved.and_then(|moved| reference(moved, "texCoord")).or_else(|| reference(info, "texCoord"));

        let reader = self.shader(material, &format!("{name}Coordinates"), "UsdPrimvarReader_float2");
        self.layer.attribute(&reader, "string inputs:varname", coordinates(set.unwrap_or(0)));
        self.layer.declare(&reader, "float2 outputs:result");
        let mut at = reader;
        if let Some(moved) = moved {
            let transform = self.shader(material, &format!("{name}Transform"), "UsdTransform2d");
            self.layer.connect(&transform, "float2 inputs:in", &output(&at, "result"));
            self.place(&transform, moved);
            self.layer.declare(&transform, "float2 outputs:result");
            at = transform;
        }

        let shader = self.shader(material, name, "UsdUVTexture");
        self.layer.attribute(&shader, "asset inputs:file", AssetPath::new(format!("./{file}")));
        self.layer.connect(&shader, "float2 inputs:st", &output(&at, "result"));
        self.layer.attribute(&shader, "token inputs:sourceColorSpace", Token::from(used.color_space));
        let sampler = reference(texture, "sampler").and_then(|at| source.document.get("samplers", at).ok());
        for axis in ["wrapS", "wrapT"] {
            let wrap = match sampler.and_then(|sampler| reference(sampler, axis)) {
                Some(33071) => "clamp",
                Some(33648) => "mirror",
                _ => "repeat",
            };
            self.layer.attribute(&shader, &format!("token inputs:{axis}"), Token::from(wrap));
        }
        for (what, values) in [("scale", used.scale), ("bias", used.bias)] {
            let values = gf::Vec4f::from(values.map(|value| value as f32));
            self.layer.attribute(&shader, &format!("float4 inputs:{what}"), values);
        }
        Some(shader)
    }

    /// The second axis of texture coordinates points down in glTF and up in USD. The same transform, seen on the
    /// picture, has another translation in USD.
    fn place(&mut self, transform: &Path, moved: &Object) {
        let offset = DVec2::from(numbers(moved.get("offset")).unwrap_or([0.0; 2]));
        let scale = DVec2::from(numbers(moved.get("scale")).unwrap_or([1.0; 2]));
        let angle = number(moved, "rotation", 0.0);
        let edge = scale.y * DVec2::new(libm::sin(angle), libm::cos(angle));
        let translation = DVec2::new(offset.x + edge.x, 1.0 - edge.y - offset.y);
        let pair = |v: DVec2| gf::Vec2f::from(v.as_vec2().to_array());
        self.layer.attribute(transform, "float inputs:rotation", angle.to_degrees() as f32);
        self.layer.attribute(transform, "float2 inputs:scale", pair(scale));
        self.layer.attribute(transform, "float2 inputs:translation", pair(translation));
    }

    fn shader(&mut self, material: &Path, name: &str, id: &str) -> Path {
        let shader = self.layer.prim(material, name, "Shader");
        self.layer.attribute(&shader, "uniform token info:id", Token::from(id));
        shader
    }

    /// Connects an input to an output. Declares the output if it is new.
    fn wire(&mut self, surface: &Path, input: &str, from: &Path, kind: &str, name: &str) {
        self.layer.declare(from, &format!("{kind} outputs:{name}"));
        self.layer.connect(surface, input, &output(from, name));
    }
}

fn output(shader: &Path, name: &str) -> Path {
    shader.append_property(format!("outputs:{name}")).expect("it is a name")
}

fn color(channels: [f64; 3]) -> gf::Vec3f {
    gf::Vec3f::from(channels.map(|channel| channel as f32))
}

fn object<'a>(of: &'a Object, key: &str) -> Option<&'a Object> {
    of.get(key)?.as_object()
}

fn extension<'a>(of: &'a Object, name: &str) -> Option<&'a Object> {
    object(object(of, "extensions")?, name)
}

fn number(of: &Object, key: &str, default: f64) -> f64 {
    of.get(key).and_then(Value::as_f64).unwrap_or(default)
}

/// The first `N` numbers of a list.
fn numbers<const N: usize>(list: Option<&Value>) -> Option<[f64; N]> {
    let list: Vec<f64> = list?.as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
    list.get(..N)?.try_into().ok()
}
