//! The pile of a file whose nodes are bodies, to be analysed by the command line or by a worker.

use super::InputFile;
use cairn_export::analysis::{self, FoundPile, Selection};
use cairn_files::problem::Problem;
use cairn_gltf::Document;

/// Reads the pile of a file, and does this work with it.
pub fn with_pile<T>(
    file: &InputFile,
    selection: &Selection,
    work: impl FnOnce(&Document, &FoundPile) -> T,
) -> Result<T, Problem> {
    let bad = |what: String| {
        Problem::new(&file.name, what, "Choose another file, or other nodes as scenery or to be left out.")
    };
    let bytes = cairn_export::as_gltf(&file.bytes, &*file.resolve).map_err(bad)?;
    let document = Document::open(&bytes, &*file.resolve).map_err(|error| bad(error.to_string()))?;
    let pile = analysis::read(&document, selection).map_err(|error| bad(error.to_string()))?;
    Ok(work(&document, &pile))
}
