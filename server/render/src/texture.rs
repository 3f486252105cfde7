//! Base colours: a factor, and a picture where there is one that can be read.

use cairn_gltf::document::{Object, reference};
use cairn_gltf::{Document, Resolver};
use glam::{Vec2, Vec3, vec3};
use image::{ImageDecoder, ImageReader, RgbImage};
use serde_json::Value;
use std::io::Cursor;

/// Larger pictures are skipped: a still has no use for them, and they may be bombs.
const MOST_PIXELS_PER_SIDE: u32 = 8192;

/// The look of a surface. Colours are linear.
#[derive(Clone)]
pub struct Material {
    pub color: Vec3,
    pub roughness: f32,
    pub metallic: f32,
    pub texture: Option<Texture>,
}

/// A base-colour picture and how it is laid on.
#[derive(Clone)]
pub struct Texture {
    /// Index into the file's pictures.
    pub picture: usize,
    /// Which set of texture coordinates.
    pub set: usize,
    wrap: [Wrap; 2],
}

#[derive(Clone, Copy, PartialEq)]
enum Wrap {
    Repeat,
    Clamp,
    Mirror,
}

impl Material {
    /// A replacement for a material that a file lacks: the same for the same place in the file.
    pub fn fallback(index: usize) -> Material {
        const PALETTE: [[f32; 3]; 8] = [
            [0.74, 0.45, 0.23],
            [0.22, 0.42, 0.54],
            [0.62, 0.56, 0.34],
            [0.56, 0.21, 0.16],
            [0.30, 0.47, 0.32],
            [0.73, 0.60, 0.46],
            [0.38, 0.33, 0.48],
            [0.60, 0.62, 0.62],
        ];
        Material { color: PALETTE[index % PALETTE.len()].into(), roughness: 0.6, metallic: 0.0, texture: None }
    }

    /// A material of the file; an unreadable member takes glTF's default.
    pub fn read(document: &Document, index: usize) -> Option<Material> {
        let material = document.get("materials", index).ok()?;
        let empty = Object::new();
        let pbr = material.get("pbrMetallicRoughness").and_then(Value::as_object).unwrap_or(&empty);
        let number = |key: &str| pbr.get(key).and_then(Value::as_f64).map_or(1.0, |v| v.clamp(0.0, 1.0) as f32);
        let factor = pbr.get("baseColorFactor").and_then(Value::as_array);
        let channel = |i: usize| {
            let value = factor.and_then(|f| f.get(i)).and_then(Value::as_f64);
            value.map_or(1.0, |v| v.clamp(0.0, 1.0) as f32)
        };
        Some(Material {
            color: vec3(channel(0), channel(1), channel(2)),
            roughness: number("roughnessFactor"),
            metallic: number("metallicFactor"),
            texture: pbr.get("baseColorTexture").and_then(Value::as_object).and_then(|t| Texture::read(document, t)),
        })
    }
}

impl Texture {
    fn read(document: &Document, info: &Object) -> Option<Texture> {
        let texture = document.get("textures", reference(info, "index")?).ok()?;
        let sampler = reference(texture, "sampler").and_then(|s| document.get("samplers", s).ok());
        let wrap = |key: &str| match sampler.and_then(|s| s.get(key)).and_then(Value::as_u64) {
            Some(33071) => Wrap::Clamp,
            Some(33648) => Wrap::Mirror,
            _ => Wrap::Repeat,
        };
        Some(Texture {
            picture: reference(texture, "source")?,
            set: reference(info, "texCoord").unwrap_or(0),
            wrap: [wrap("wrapS"), wrap("wrapT")],
        })
    }

    /// The linear colour at a texture coordinate, between the four nearest pixels.
    pub fn sample(&self, picture: &Picture, at: Vec2) -> Vec3 {
        let (width, height) = picture.pixels.dimensions();
        let (x, y) = (at.x * width as f32 - 0.5, at.y * height as f32 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let pixel = |dx: f32, dy: f32| {
            let px = self.wrap[0].apply(x0 + dx, width);
            let py = self.wrap[1].apply(y0 + dy, height);
            picture.linear(px, py)
        };
        let upper = pixel(0.0, 0.0).lerp(pixel(1.0, 0.0), fx);
        let lower = pixel(0.0, 1.0).lerp(pixel(1.0, 1.0), fx);
        upper.lerp(lower, fy)
    }
}

impl Wrap {
    /// The pixel that stands for a place on the unbounded picture.
    fn apply(self, at: f32, size: u32) -> u32 {
        let size_f = size as f32;
        let inside = match self {
            Wrap::Repeat => at.rem_euclid(size_f),
            Wrap::Clamp => at,
            Wrap::Mirror => {
                let period = at.rem_euclid(2.0 * size_f);
                if period < size_f { period } else { 2.0 * size_f - 1.0 - period }
            }
        };
        (inside.max(0.0) as u32).min(size - 1)
    }
}

/// A decoded picture, not empty.
pub struct Picture {
    pixels: RgbImage,
    /// The linear value of each byte.
    linear: [f32; 256],
}

impl Picture {
    /// PNG or JPEG; `None` for a picture that cannot be found or decoded, or is too large.
    pub fn read(document: &Document, index: usize, resolve: &Resolver) -> Option<Picture> {
        let bytes = document.picture(index, resolve).ok()?.bytes;
        let mut limits = image::Limits::default();
        limits.max_image_width = Some(MOST_PIXELS_PER_SIDE);
        limits.max_image_height = Some(MOST_PIXELS_PER_SIDE);
        let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok()?;
        reader.limits(limits);
        let decoder = reader.into_decoder().ok()?;
        if decoder.dimensions().0 == 0 || decoder.dimensions().1 == 0 {
            return None;
        }
        let pixels = image::DynamicImage::from_decoder(decoder).ok()?.into_rgb8();
        Some(Picture { pixels, linear: std::array::from_fn(|byte| linear(byte as u8)) })
    }

    fn linear(&self, x: u32, y: u32) -> Vec3 {
        Vec3::from(self.pixels.get_pixel(x, y).0.map(|byte| self.linear[byte as usize]))
    }
}

/// From the sRGB byte of a picture.
fn linear(byte: u8) -> f32 {
    let value = f32::from(byte) / 255.0;
    if value <= 0.04045 { value / 12.92 } else { libm::powf((value + 0.055) / 1.055, 2.4) }
}
