//! Writers of a finished bake: an animated `.glb`, and tables as `.json` and `.csv`.
//!
//! The same bake and sources give the same bytes. A file appears complete or not at all.

mod copy;
mod glb;
mod glue;
mod hierarchy;
mod images;
mod sources;
mod table;
mod tracks;

use crate::files::{folder_of, write_atomically};
use crate::model::document::{DocumentError, Resolver};
use cairn_core::report::bake::BakedPile;
use std::path::{Path, PathBuf};

/// What a bake's bodies look like.
pub struct ExportScene<'a> {
    /// In the order of the scene's props: `Body::prop` is an index into this.
    pub props: Vec<SourceModel<'a>>,
    /// Static geometry, as placed in the world.
    pub scenery: Vec<SourceModel<'a>>,
    /// What the result tells of where it comes from.
    pub origin: Option<&'a serde_json::Value>,
}

/// Below which key a result tells where it comes from.
pub const ORIGIN: &str = "cairn";

/// A model in its original file. As a prop: the whole file in its scene's frame, or a node with all that is below it,
/// seen from that node's origin, with the rotation and scale that it has in the world.
#[derive(Clone, Copy)]
pub struct SourceModel<'a> {
    /// What the result calls it.
    pub name: &'a str,
    /// Which file this is, for messages; models of the same file share their data in the result.
    pub file: &'a str,
    /// The file's content, glTF or GLB.
    pub bytes: &'a [u8],
    /// The chosen node's name, or a scene's; `None` takes the default scene.
    pub node: Option<&'a str>,
    /// Reads the file's external buffers and images.
    pub resolve: &'a Resolver<'a>,
}

/// What is written, by the output's extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Glb,
    Json,
    Csv,
}

impl Format {
    /// For messages.
    pub const ENDINGS: &str = ".glb, .json or .csv";

    /// The format of a file name's ending.
    pub fn named(ending: &str) -> Option<Format> {
        match ending.to_ascii_lowercase().as_str() {
            "glb" => Some(Format::Glb),
            "json" => Some(Format::Json),
            "csv" => Some(Format::Csv),
            _ => None,
        }
    }
}

/// Why a bake was not written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error("{}: cannot tell the format from the name; end it in .glb, .json or .csv", .0.display())]
    UnknownFormat(PathBuf),
    #[error("{}: is a directory; name a file in it", .0.display())]
    IsDirectory(PathBuf),
    #[error("{}: the folder does not exist; make it first", .0.display())]
    NoFolder(PathBuf),
    /// A model that cannot be copied.
    #[error("{file}: {error}")]
    Source { file: String, error: DocumentError },
    /// Our fault.
    #[error("body {body} has no finite pose at frame {frame}")]
    NotFinite { body: usize, frame: usize },
    #[error("the result is larger than the 4 GiB that a .glb can hold; bake fewer frames or use lighter textures")]
    TooLarge,
    #[error("cannot write {}: {error}", path.display())]
    Write { path: PathBuf, error: std::io::Error },
    #[error("cannot encode the result: {0}")]
    Io(#[from] std::io::Error),
}

impl ExportError {
    fn source(model: &SourceModel, error: DocumentError) -> Self {
        ExportError::Source { file: model.file.into(), error }
    }
}

/// The format that a path asks for, and whether a file can appear there. To be asked before a long bake.
pub fn check_destination(path: &Path) -> Result<Format, ExportError> {
    let format = path.extension().and_then(|ending| Format::named(ending.to_str()?));
    let format = format.ok_or_else(|| ExportError::UnknownFormat(path.into()))?;
    if path.is_dir() {
        return Err(ExportError::IsDirectory(path.into()));
    }
    if !folder_of(path).is_dir() {
        return Err(ExportError::NoFolder(folder_of(path).into()));
    }
    Ok(format)
}

/// Writes a bake in the format that the path's extension names. The file is written aside, synced and then moved to
/// its place, so that an error or a crash leaves nothing half-written.
pub fn write(path: &Path, bake: &BakedPile, scene: &ExportScene) -> Result<(), ExportError> {
    let format = check_destination(path)?;
    let bytes = encode(format, bake, scene)?;
    write_atomically(path, &bytes).map_err(|error| ExportError::Write { path: path.into(), error })
}

/// The bytes that [`write`] writes.
pub fn encode(format: Format, bake: &BakedPile, scene: &ExportScene) -> Result<Vec<u8>, ExportError> {
    for (frame, poses) in bake.frames.iter().enumerate() {
        assert_eq!(poses.len(), bake.bodies.len(), "every frame has a pose per body");
        if let Some(body) = poses.iter().position(|p| !(p.translation.is_finite() && p.rotation.is_normalized())) {
            return Err(ExportError::NotFinite { body, frame });
        }
    }
    match format {
        Format::Glb => glb::encode(bake, scene),
        Format::Json => table::encode_json(bake, scene),
        Format::Csv => table::encode_csv(bake, scene),
    }
}

/// What the result calls each body.
fn body_names(bake: &BakedPile, scene: &ExportScene) -> Vec<String> {
    let named =
        |(i, body): (usize, &cairn_core::report::bake::BakedBody)| format!("{}.{i:04}", scene.props[body.prop].name);
    bake.bodies.iter().enumerate().map(named).collect()
}
