//! A pile for games and the web: merged static meshes in levels of detail, colliders, instances, a skeleton with a
//! clip, textures of the motion, and a manifest that states all sizes.

mod file;
mod motion;
mod outside;
mod pile;
mod still;
mod surface;

use super::{Encoded, ExportError, ExportScene, archive};
use cairn_core::report::bake::BakedPile;
use cairn_gltf::document::DocumentError;
use cairn_render::{RenderError, RenderModel, SilhouetteDifference};
use file::Looks;
use pile::PackedPile;
use serde::Serialize;
use std::collections::BTreeSet;
use zip::CompressionMethod;

/// The manifest's name, the last file of a pack that is written.
pub const MANIFEST: &str = "manifest.json";

/// What a pack is to have.
#[derive(Clone, Copy, Debug)]
pub struct PackOptions {
    /// Levels of detail, at most.
    pub levels: u32,
    /// Meshes are compressed by EXT_meshopt_compression.
    pub is_compressed: bool,
}

impl Default for PackOptions {
    fn default() -> Self {
        PackOptions { levels: 4, is_compressed: false }
    }
}

/// A file of a pack, by its path in the pack's folder.
#[derive(Clone, Debug, Serialize)]
pub struct PackedFile {
    pub file: String,
    pub what: &'static str,
    pub bytes: usize,
    #[serde(skip_serializing_if = "is_zero")]
    pub triangles: usize,
    #[serde(skip_serializing_if = "is_zero")]
    pub vertices: usize,
    /// Draw calls.
    #[serde(skip_serializing_if = "is_zero")]
    pub draws: usize,
    #[serde(skip)]
    pub content: Vec<u8>,
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

impl PackedFile {
    fn new(file: &str, what: &'static str, content: Vec<u8>) -> PackedFile {
        PackedFile { file: file.into(), what, bytes: content.len(), triangles: 0, vertices: 0, draws: 0, content }
    }
}

/// A level of detail of the static mesh.
#[derive(Clone, Debug, Serialize)]
pub struct Level {
    pub triangles: usize,
    pub vertices: usize,
    pub draws: usize,
    /// The error for which props were simplified, in picture elements of a picture of 1080 rows that the pile fills.
    pub error_px: f64,
    /// The share of this level's triangles that nobody sees from outside; they are removed.
    pub hidden_share: f64,
    /// Triangles, as a share of those of all bodies.
    pub triangle_share: f64,
    /// Of the first level, against the result itself, at 1920 x 1080.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub silhouette: Option<SilhouetteDifference>,
}

/// Where the textures of the motion have what.
#[derive(Clone, Debug, Serialize)]
pub struct MotionLayout {
    pub fps: f64,
    pub frames: usize,
    pub bodies: usize,
    /// Texels.
    pub width: usize,
    pub height: usize,
    /// Bodies in a column; the next ones are `frames` columns further.
    pub rows: usize,
}

/// The box around a pile, m.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PileBounds {
    pub low: [f64; 3],
    pub high: [f64; 3],
}

/// What a pack has, and how large it is.
#[derive(Clone, Debug, Serialize)]
pub struct Manifest {
    pub format: u32,
    pub generator: &'static str,
    pub bodies: usize,
    pub props: usize,
    /// Of all bodies, as the result shows them.
    pub triangles: usize,
    /// Of the pile at rest.
    pub bounds: PileBounds,
    pub files: Vec<PackedFile>,
    pub levels: Vec<Level>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionLayout>,
    pub left_out: Vec<String>,
}

impl Manifest {
    /// The manifest as it is written.
    pub fn text(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}

/// Why there is no pack.
#[derive(Debug, thiserror::Error)]
pub enum PackError {
    #[error("it is no result of a bake: it has no node \"pile\" with frames")]
    NoPile,
    #[error("its node \"pile\" was moved; undo that, or place the pack instead")]
    Moved,
    #[error("none of its bodies shows triangles")]
    Empty,
    #[error("it has more {0} than a pack takes, {1}; bake fewer frames or bodies, or use lighter props")]
    TooMany(&'static str, usize),
    #[error(transparent)]
    Document(#[from] DocumentError),
    #[error("a mesh cannot be processed: {0}")]
    Mesh(#[from] meshoptimizer_rs::Error),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(transparent)]
    Export(#[from] ExportError),
    #[error("cannot encode the pack: {0}")]
    Io(#[from] std::io::Error),
}

/// The `.pack.zip`: the files of a pack in one, as they are, so that it has the same bytes everywhere.
pub fn encode(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    let glb = super::glb::encode(bake, scene)?;
    let nothing = |name: &str| Err(format!("{name} is not in the result"));
    let result = RenderModel { name: "the result", bytes: &glb.bytes, resolve: &nothing };
    let manifest = match pack(&result, &PackOptions::default(), &mut || true) {
        Ok(manifest) => manifest.ok_or_else(|| ExportError::Pack("cancelled".into()))?,
        Err(PackError::Export(error)) => return Err(error),
        Err(error) => return Err(ExportError::Pack(error.to_string())),
    };
    let text = manifest.text();
    let files = manifest.files.iter().map(|file| (file.file.as_str(), file.content.as_slice()));
    let files = files.chain([(MANIFEST, text.as_bytes())]);
    let bytes = archive::zip(CompressionMethod::Stored, files)?;
    Ok(Encoded { left_out: manifest.left_out, ..Encoded::single(bytes) })
}

/// Adds files to a pack.
type Step<'s> = dyn Fn(&mut Manifest) -> Result<(), PackError> + 's;

/// Packs a result, which is glTF. `is_wanted` is asked between two files; `false` ends the work.
pub fn pack(
    result: &RenderModel,
    options: &PackOptions,
    is_wanted: &mut dyn FnMut() -> bool,
) -> Result<Option<Manifest>, PackError> {
    let mut pile = PackedPile::read(result.bytes, result.resolve)?;
    let used: BTreeSet<usize> = pile.kinds.iter().flat_map(|kind| kind.surfaces.0.keys().flatten().copied()).collect();
    let looks = Looks::copy(&mut pile.source, used.into_iter());
    let mut left_out = std::mem::take(&mut pile.left_out);
    left_out.extend(looks.left_out.iter().cloned());
    let mut manifest = Manifest {
        format: 1,
        generator: cairn_files::version::BUILD,
        bodies: pile.bodies.len(),
        props: pile.kinds.len(),
        triangles: pile.triangles(),
        bounds: still::bounds(&pile),
        files: Vec::new(),
        levels: Vec::new(),
        motion: None,
        left_out,
    };
    let steps: [&Step; 5] = [
        &|manifest| {
            let levels = still::levels(&pile, result, &looks, (options.levels, options.is_compressed))?;
            for (file, level) in levels {
                manifest.files.push(file);
                manifest.levels.push(level);
            }
            Ok(())
        },
        &|manifest| {
            manifest.files.push(still::colliders(&pile)?);
            Ok(())
        },
        &|manifest| {
            manifest.files.push(still::instances(&pile, &looks, options.is_compressed)?);
            Ok(())
        },
        &|manifest| {
            match motion::skinned(&pile, &looks, options.is_compressed)? {
                Some(file) => manifest.files.push(file),
                None => manifest.left_out.push("the skeleton is left out: it would have too many joints".into()),
            }
            Ok(())
        },
        &|manifest| {
            match motion::layout(&pile) {
                Ok(layout) => {
                    manifest.files.extend(motion::textures(&pile, &layout, &looks, options.is_compressed)?);
                    manifest.motion = Some(layout);
                }
                Err(why) => manifest.left_out.push(why),
            }
            Ok(())
        },
    ];
    for step in steps {
        if !is_wanted() {
            return Ok(None);
        }
        step(&mut manifest)?;
    }
    manifest.files.extend(looks.textures.iter().cloned());
    Ok(Some(manifest))
}
