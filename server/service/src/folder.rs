//! File names in a bake's folder. The server makes the folder, and the worker fills it.

use cairn_export::Format;
use cairn_wire::proto::Scene;
use cairn_wire::scene_file::SceneTree;
use std::path::Path;

pub const SPEC: &str = "spec.binpb";
/// Files named by their SHA-256.
pub const ASSETS: &str = "assets";
pub const EVENTS: &str = "events.log";
pub const REPORT: &str = "report.json";
/// The scene with every parameter set.
pub const SCENE: &str = "scene.json";

/// Writes the scene with every parameter set. Whoever saves that the bake is accepted syncs the folder.
pub fn write_scene(folder: &Path, effective: &Scene) -> std::io::Result<()> {
    let scene = SceneTree::from_message(effective).to_json();
    cairn_files::Staged::write(&folder.join(SCENE), scene.as_bytes())?.publish().map(drop)
}

/// The pile itself, of which results in further formats are made.
pub const PILE: &str = "baked.postcard";
/// The same as version 0.1.0 wrote it at first, with all parameters after it.
pub const EARLIER_PILE: &str = "pile.postcard";

/// A result of a bake: its format, and of one in USD the layout, where it is not that of the bake's request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResultKind {
    pub format: Format,
    /// The number of the layout: a hash of it.
    pub layout: Option<String>,
}

impl ResultKind {
    pub fn of(format: Format) -> ResultKind {
        ResultKind { format, layout: None }
    }

    /// Of a layout, by the request that states it.
    pub fn laid_out(format: Format, request: &[u8]) -> ResultKind {
        /// Digits that distinguish the few layouts of a bake.
        const DIGITS: usize = 16;
        let layout = blake3::hash(request).to_hex()[..DIGITS].to_owned();
        ResultKind { format, layout: Some(layout) }
    }

    fn tag(&self) -> String {
        self.layout.as_ref().map_or(String::new(), |layout| format!("{LAID_OUT}{layout}"))
    }

    /// The name of the result file.
    pub fn result_name(&self) -> String {
        format!("result{}.{}", self.tag(), self.format.extension())
    }

    /// The name of the report of a result that was not made with the bake.
    pub fn report_name(&self) -> String {
        format!("report{}.{}.json", self.tag(), self.format.extension())
    }

    /// The name of the file that describes a result and its report. It is written last.
    pub fn head_name(&self) -> String {
        format!("result{}.{}.head", self.tag(), self.format.extension())
    }
}

/// In the names of what has a layout of its own.
const LAID_OUT: &str = "-layout-";

/// The name of a layout.
pub fn layout_name(layout: &str) -> String {
    format!("usd{LAID_OUT}{layout}.binpb")
}

/// Whether a file belongs to a layout.
pub fn is_laid_out(name: &str) -> bool {
    name.contains(LAID_OUT)
}
