//! Writers of a finished bake: an animated `.glb`, USD, and tables as `.json` and `.csv`.
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
mod usd;

use crate::files::{folder_of, write_atomically};
use cairn_core::report::Name;
use cairn_core::report::bake::BakedPile;
use cairn_gltf::document::DocumentError;
use cairn_gltf::{Document, Resolver};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The models of a bake's bodies and scenery.
#[derive(Default)]
pub struct ExportScene<'a> {
    /// In the order of the scene's props: `Body::prop` is an index into this.
    pub props: Vec<SourceModel<'a>>,
    /// Static geometry, as placed in the world.
    pub scenery: Vec<SourceModel<'a>>,
    /// Where the result comes from, to be stated in it.
    pub origin: Option<&'a serde_json::Value>,
    /// The figures of the pile, for formats that hold them.
    pub measures: Option<&'a Measures>,
}

/// Figures by name, as in the report.
pub type Measures = BTreeMap<Name, Option<f64>>;

/// A result.
pub struct Encoded {
    pub bytes: Vec<u8>,
    /// Files that it names, by their paths from its folder. Results in one folder may share them: equal names have
    /// equal content.
    pub beside: BTreeMap<String, Vec<u8>>,
}

impl Encoded {
    fn alone(bytes: Vec<u8>) -> Encoded {
        Encoded { bytes, beside: BTreeMap::new() }
    }

    /// Writes the files beside a result of that path. Those that exist already stay.
    pub fn write_beside(&self, path: &Path) -> std::io::Result<()> {
        for (name, bytes) in &self.beside {
            let path = folder_of(path).join(name);
            if std::fs::read(&path).is_ok_and(|there| there == *bytes) {
                continue;
            }
            std::fs::create_dir_all(folder_of(&path))?;
            write_atomically(&path, bytes)?;
        }
        Ok(())
    }
}

/// The folder of the files beside results.
pub const BESIDE: &str = usd::FOLDER;

/// The key below which a result states where it comes from.
pub const ORIGIN: &str = "cairn";

/// A model in its original file. As a prop: the whole file in its scene's frame, or a node with all that is below it,
/// seen from that node's origin, with the rotation and scale that it has in the world.
#[derive(Clone, Copy)]
pub struct SourceModel<'a> {
    /// Its name in the result.
    pub name: &'a str,
    /// The file's name in messages; models of the same file share their data in the result.
    pub file: &'a str,
    /// The file's content, glTF or GLB.
    pub bytes: &'a [u8],
    /// The chosen node's name, or a scene's; `None` takes the default scene.
    pub node: Option<&'a str>,
    /// Reads the file's external buffers and images.
    pub resolve: &'a Resolver<'a>,
}

/// The format of a result, by the output's extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Glb,
    Json,
    Csv,
    Usda,
    Usdc,
    Usdz,
}

impl Format {
    /// For messages.
    pub const ENDINGS: &str = ".glb, .usdc, .usda, .usdz, .json or .csv";
    /// Their names on the command line.
    pub const NAMES: [&str; 6] = ["glb", "usdc", "usda", "usdz", "json", "csv"];

    /// The format of a file name's ending.
    pub fn named(ending: &str) -> Option<Format> {
        use Format::*;
        let named = Format::NAMES.iter().zip([Glb, Usdc, Usda, Usdz, Json, Csv]);
        named.into_iter().find(|(name, _)| ending.eq_ignore_ascii_case(name)).map(|(_, format)| format)
    }

    /// The format of a file's name.
    pub fn of(path: &Path) -> Option<Format> {
        Format::named(path.extension()?.to_str()?)
    }

    /// Whether the format states where a result comes from, and its ending is not a scene file's.
    pub fn states_origin(self) -> bool {
        !matches!(self, Format::Json | Format::Csv)
    }

    /// Whether a result may have files beside it, so that it must be a file itself.
    pub fn has_files_beside(self) -> bool {
        matches!(self, Format::Usda | Format::Usdc)
    }

    /// Whether the format holds the pile's figures, so that results are written after the measures.
    pub fn holds_measures(self) -> bool {
        matches!(self, Format::Usda | Format::Usdc | Format::Usdz)
    }
}

/// Why a bake was not written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error("{}: the format is not clear from the name; end it in {}", .0.display(), Format::ENDINGS)]
    UnknownFormat(PathBuf),
    #[error("{}: is a directory; name a file in it", .0.display())]
    IsDirectory(PathBuf),
    #[error("{}: the folder does not exist; make it first", .0.display())]
    NoFolder(PathBuf),
    /// A model that cannot be copied.
    #[error("{file}: {error}")]
    Source { file: String, error: DocumentError },
    /// A fault of the program, not of the input.
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

/// The format that a path asks for, and whether a file can appear there. Callers check this before a long bake.
pub fn check_destination(path: &Path) -> Result<Format, ExportError> {
    let format = Format::of(path).ok_or_else(|| ExportError::UnknownFormat(path.into()))?;
    if path.is_dir() {
        return Err(ExportError::IsDirectory(path.into()));
    }
    if !folder_of(path).is_dir() {
        return Err(ExportError::NoFolder(folder_of(path).into()));
    }
    Ok(format)
}

/// Writes a bake in the format that the path's extension names. Each file is written aside, synced and then moved to
/// its place, the result's own last, so that an error or a crash leaves nothing half-written.
pub fn write(path: &Path, bake: &BakedPile, scene: &ExportScene) -> Result<(), ExportError> {
    let format = check_destination(path)?;
    let encoded = encode(format, bake, scene)?;
    let fail = |error| ExportError::Write { path: path.into(), error };
    encoded.write_beside(path).map_err(fail)?;
    write_atomically(path, &encoded.bytes).map_err(fail)
}

/// The files that [`write()`] writes.
pub fn encode(format: Format, bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    for (frame, poses) in bake.frames.iter().enumerate() {
        assert_eq!(poses.len(), bake.bodies.len(), "every frame has a pose per body");
        if let Some(body) = poses.iter().position(|p| !(p.translation.is_finite() && p.rotation.is_normalized())) {
            return Err(ExportError::NotFinite { body, frame });
        }
    }
    match format {
        Format::Glb => glb::encode(bake, scene).map(Encoded::alone),
        Format::Json => table::encode_json(bake, scene).map(Encoded::alone),
        Format::Csv => table::encode_csv(bake, scene).map(Encoded::alone),
        Format::Usda => usd::encode(usd::Encoding::Text, bake, scene),
        Format::Usdc => usd::encode(usd::Encoding::Crate, bake, scene),
        Format::Usdz => usd::encode_package(bake, scene),
    }
}

/// Where a result comes from, as it states: a `.glb`, or one of USD's formats.
pub fn origin(result: &[u8]) -> Option<serde_json::Value> {
    match Document::parse(result, &|_| Err(String::new())) {
        Ok(document) => Some(document.json().get("asset")?.get("extras")?.get(ORIGIN)?.clone()),
        Err(_) => usd::read_origin(result),
    }
}

/// The name of each body in the result.
fn body_names(bake: &BakedPile, scene: &ExportScene) -> Vec<String> {
    let named =
        |(i, body): (usize, &cairn_core::report::bake::BakedBody)| format!("{}.{i:04}", scene.props[body.prop].name);
    bake.bodies.iter().enumerate().map(named).collect()
}
