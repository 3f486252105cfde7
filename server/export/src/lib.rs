//! Writers of a finished bake: an animated `.glb`, USD, tables as `.json` and `.csv`. Long: all formats meet here.
//!
//! Also MuJoCo's `.xml` and a `.glb` with physics, to be simulated further; and a `.glb` of the collision shapes.
//!
//! The same bake and sources give the same bytes. A file appears complete or not at all.
//!
//! It must never know a request or a server. Only `usd` names the `openusd` crate.
//!
//! Invariants: what a result leaves out is recorded by the writer that leaves it out, and rehearsed before the bake.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod analysis;
mod archive;
pub mod arrays;
mod convex_cover;
mod copy;
mod glb;
mod glue;
mod hierarchy;
mod left_out;
mod mjcf;
pub mod pack;
mod physics;
pub mod resting;
mod size;
mod sources;
mod table;
mod tracks;
mod usd;

pub use glb::state;

pub use convex_cover::{ConvexCover, CoverLimits};

use cairn_core::report::Name;
use cairn_core::report::bake::BakedPile;
use cairn_files::{FileSource, folder_of, write_atomically};
use cairn_geometry::mesh::TriMesh;
use cairn_gltf::document::DocumentError;
use cairn_gltf::{Document, Resolver};
use cairn_input::scene::StaticModel;
use cairn_wire::proto::OutputFormat;
use size::FormatSize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The models of a bake's bodies and scenery.
#[derive(Default)]
pub struct ExportScene<'a> {
    /// In the order of the scene's props: `Body::prop` is an index into this.
    pub props: Vec<SourceModel<'a>>,
    /// Static geometry, as placed in the world.
    pub scenery: Vec<SourceModel<'a>>,
    /// What the bodies met besides each other and the ground, where it was placed: the scenery, then earlier results.
    pub colliders: &'a [StaticModel],
    /// The shape that was filled, for formats that hold what a later bake needs to change the pile.
    pub shape: Option<&'a TriMesh>,
    /// The origin of the result, which the result states.
    pub origin: Option<&'a serde_json::Value>,
    /// The figures of the pile, for formats that hold them.
    pub measures: Option<&'a Measures>,
    /// A `.glb` keeps EXT_mesh_gpu_instancing where a prop has it. Otherwise each copy is a node, which every program
    /// shows.
    pub keeps_instancing: bool,
    /// Of a result in USD.
    pub layout: Layout,
}

/// Figures by name, as in the report.
pub type Measures = BTreeMap<Name, Option<f64>>;

/// A result.
pub struct Encoded {
    pub bytes: Vec<u8>,
    /// Files that it names, by their paths from its folder. Results in one folder may share them: equal names have
    /// equal content.
    pub sidecars: BTreeMap<String, Vec<u8>>,
    /// What this format leaves out besides [`Rehearsal::left_out`], or has otherwise than others, one sentence each.
    pub left_out: Vec<String>,
}

impl Encoded {
    fn single(bytes: Vec<u8>) -> Encoded {
        Encoded { bytes, sidecars: BTreeMap::new(), left_out: Vec::new() }
    }

    /// Writes the sidecars of a result at `path`. Unchanged ones are not written again.
    pub fn write_sidecars(&self, path: &Path) -> std::io::Result<()> {
        for (name, bytes) in &self.sidecars {
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

/// The folder of the sidecars, next to the result.
pub const SIDECAR_FOLDER: &str = usd::FOLDER;

/// The key of a result's origin.
pub const ORIGIN: &str = "cairn";

/// A model in its original file. A prop is the whole file in its scene's frame, or a node with everything below it, in
/// a frame at that node's origin. The node keeps the rotation and scale that it has in the world.
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
    /// The asset that it was read from, to which a result in USD refers.
    pub asset: Option<UsdAsset<'a>>,
}

/// Prims of a file of USD, which show a model.
#[derive(Clone, Copy)]
pub struct UsdAsset<'a> {
    /// From the result's folder.
    pub path: &'a str,
    pub prims: &'a [PartPrim],
    /// A reference to the file without a prim takes it.
    pub is_default: bool,
}

/// The format of a result. A new one needs a row in [`Format::row`], a place in [`Format::ALL`], and a value of
/// `OutputFormat` in the schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Glb,
    Usdc,
    Usda,
    Usdz,
    Json,
    Csv,
    Mjcf,
    GlbPhysics,
    GlbHulls,
    Pack,
}

/// Everything that is particular to a format.
struct FormatRow {
    /// The extension of its files, and its name on the command line.
    extension: &'static str,
    wire: OutputFormat,
    writer: fn(&BakedPile, &ExportScene) -> Result<Encoded, ExportError>,
    /// Whether a result states where it comes from, so that it can be given as a scene.
    states_origin: bool,
    /// Whether a result has the models of its bodies, so that it can be shown.
    holds_models: bool,
    /// Whether a result is one file. Others have sidecars, so they need a folder.
    is_single_file: bool,
    /// Whether a result holds the pile's figures, so that it is written after the measures.
    holds_measures: bool,
    size: FormatSize,
}

impl Format {
    /// In the order in which help and messages list them.
    pub const ALL: [Format; 10] = [
        Format::Glb,
        Format::Usdc,
        Format::Usda,
        Format::Usdz,
        Format::Json,
        Format::Csv,
        Format::Mjcf,
        Format::GlbPhysics,
        Format::GlbHulls,
        Format::Pack,
    ];

    fn row(self) -> FormatRow {
        let row = |extension, wire, writer| FormatRow {
            extension,
            wire,
            writer,
            states_origin: true,
            holds_models: true,
            is_single_file: true,
            holds_measures: true,
            size: FormatSize::USD,
        };
        match self {
            Format::Glb => {
                FormatRow { holds_measures: false, size: FormatSize::GLB, ..row("glb", OutputFormat::Glb, glb::encode) }
            }
            Format::Usdc => FormatRow { is_single_file: false, ..row("usdc", OutputFormat::Usdc, usd::encode_crate) },
            Format::Usda => FormatRow {
                is_single_file: false,
                size: FormatSize::USDA,
                ..row("usda", OutputFormat::Usda, usd::encode_text)
            },
            Format::Usdz => row("usdz", OutputFormat::Usdz, usd::encode_package),
            Format::Json => FormatRow {
                holds_models: false,
                holds_measures: false,
                size: FormatSize::TABLE,
                ..row("json", OutputFormat::Json, table::encode_json)
            },
            Format::Csv => FormatRow {
                states_origin: false,
                holds_models: false,
                holds_measures: false,
                size: FormatSize::TABLE,
                ..row("csv", OutputFormat::Csv, table::encode_csv)
            },
            Format::Mjcf => FormatRow {
                states_origin: false,
                holds_models: false,
                holds_measures: false,
                size: FormatSize::MODEL,
                ..row("xml", OutputFormat::Mjcf, mjcf::encode)
            },
            Format::GlbPhysics => FormatRow {
                holds_measures: false,
                size: FormatSize::GLB_PHYSICS,
                ..row("physics.glb", OutputFormat::GlbPhysics, glb::encode_physics)
            },
            Format::GlbHulls => FormatRow {
                holds_measures: false,
                size: FormatSize::GLB_HULLS,
                ..row("hulls.glb", OutputFormat::GlbHulls, glb::encode_hulls)
            },
            Format::Pack => FormatRow {
                states_origin: false,
                holds_models: false,
                holds_measures: false,
                size: FormatSize::PACK,
                ..row("pack.zip", OutputFormat::Pack, pack::encode)
            },
        }
    }

    pub fn extension(self) -> &'static str {
        self.row().extension
    }

    /// The schema's value for the format.
    pub fn wire(self) -> OutputFormat {
        self.row().wire
    }

    pub fn states_origin(self) -> bool {
        self.row().states_origin
    }

    pub fn holds_models(self) -> bool {
        self.row().holds_models
    }

    pub fn is_usd(self) -> bool {
        matches!(self, Format::Usdc | Format::Usda | Format::Usdz)
    }

    pub fn is_single_file(self) -> bool {
        self.row().is_single_file
    }

    pub fn size(self) -> FormatSize {
        self.row().size
    }

    pub fn holds_measures(self) -> bool {
        self.row().holds_measures
    }

    /// The format of a file extension, upper or lower case.
    pub fn from_extension(extension: &str) -> Option<Format> {
        Format::ALL.into_iter().find(|format| extension.eq_ignore_ascii_case(format.extension()))
    }

    /// The format that a path's ending names: the longest that is one, `.hulls.glb` before `.glb`.
    pub fn of(path: &Path) -> Option<Format> {
        let name = path.file_name()?.to_str()?;
        let endings = name.match_indices('.').map(|(at, _)| &name[at + 1..]);
        endings.skip(usize::from(name.starts_with('.'))).find_map(Format::from_extension)
    }

    /// The format of the schema's value. Unset, it is `.glb`.
    pub fn from_wire(wire: OutputFormat) -> Format {
        Format::ALL.into_iter().find(|format| format.wire() == wire).unwrap_or(Format::Glb)
    }

    /// All extensions, for messages: ".glb, .usdc or .csv".
    pub fn endings() -> String {
        let [others @ .., last] = Format::ALL.map(|format| format!(".{}", format.extension()));
        format!("{} or {last}", others.join(", "))
    }
}

/// Why a bake was not written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error("{}: the format is unknown; end the name in {}", .0.display(), Format::endings())]
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
    /// A pile that cannot be packed.
    #[error("the pack: {0}")]
    Pack(String),
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
    encoded.write_sidecars(path).map_err(fail)?;
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
    (format.row().writer)(bake, scene)
}

/// The origin that a result states: a `.glb`, one of USD's formats, or a table in JSON.
pub fn origin(result: &[u8]) -> Option<serde_json::Value> {
    if let Some(origin) = table::origin(result) {
        return Some(origin);
    }
    match Document::parse(result, &|_| Err(String::new())) {
        Ok(document) => Some(document.json().get("asset")?.get("extras")?.get(ORIGIN)?.clone()),
        Err(_) => usd::read_origin(result),
    }
}

pub use usd::layout::{Layout, is_asset_folder};
pub use usd::{ConvertedStage, PartChoice, PartPrim, StagePart, convert as convert_usd, is_usd as is_usd_content};

/// A file as glTF has it: one of USD's formats as a `.glb` of what it shows, any other as it is.
pub fn as_gltf<'a>(bytes: &'a [u8], resolve: &Resolver) -> Result<Cow<'a, [u8]>, String> {
    if usd::is_usd(bytes) { usd::to_gltf(bytes, resolve).map(Cow::Owned) } else { Ok(Cow::Borrowed(bytes)) }
}

/// What a `.glb` of some models will be.
pub struct Rehearsal {
    /// Everything that it leaves out, one sentence each.
    pub left_out: Vec<String>,
    /// Bytes of the models' data in it.
    pub bytes: usize,
}

/// Copies models as [`encode`] does, but into nothing; or gives the reasons why some cannot be copied. Callers do this
/// before a long bake. `keeps_instancing`: see [`ExportScene::keeps_instancing`].
pub fn rehearse(
    models: &[SourceModel],
    keeps_instancing: bool,
    source: &dyn FileSource,
) -> Result<Rehearsal, Vec<ExportError>> {
    glb::rehearse(models, keeps_instancing, source)
}

/// The name of each body in the result.
fn body_names(bake: &BakedPile, scene: &ExportScene) -> Vec<String> {
    let named =
        |body: &cairn_core::report::bake::BakedBody| format!("{}.{:04}", scene.props[body.prop].name, body.number);
    bake.bodies.iter().map(named).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_format_of_the_schema_has_a_row() {
        let schema: Vec<OutputFormat> = (1..).map_while(|number| OutputFormat::try_from(number).ok()).collect();
        for &wire in &schema {
            assert_eq!(Format::from_wire(wire).wire(), wire);
        }
        assert_eq!(schema.len(), Format::ALL.len());
        let endings = ".glb, .usdc, .usda, .usdz, .json, .csv, .xml, .physics.glb, .hulls.glb or .pack.zip";
        assert_eq!(Format::endings(), endings);
    }
}
