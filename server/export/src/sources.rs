//! The models' own files.

use super::copy::Copier;
use super::hierarchy::{Branch, BranchFrame, branch};
use super::{ExportError, SourceModel};
use cairn_gltf::Document;

/// Each distinct file once.
#[derive(Default)]
pub struct Sources<'a>(Vec<(&'a SourceModel<'a>, Copier<'a>)>);

impl<'a> Sources<'a> {
    /// The file of a model, parsed once however often it is used, and the part of it that is wanted.
    pub fn open(&mut self, model: &'a SourceModel, frame: BranchFrame) -> Result<(usize, Branch), ExportError> {
        let wrap = |error| ExportError::source(model, error);
        let same = |(other, source): &(&SourceModel, Copier)| {
            other.bytes == model.bytes && (other.file == model.file || source.document.is_self_contained())
        };
        let index = match self.0.iter().position(same) {
            Some(index) => index,
            None => {
                let document = Document::open(model.bytes, model.resolve).map_err(wrap)?;
                self.0.push((model, Copier::new(document, model.resolve)));
                self.0.len() - 1
            }
        };
        let document = &self.0[index].1.document;
        let chosen = model.node.map(|name| document.part(name)).transpose().map_err(wrap)?;
        Ok((index, branch(document, chosen, frame).map_err(wrap)?))
    }

    pub fn get(&mut self, index: usize) -> &mut Copier<'a> {
        &mut self.0[index].1
    }
}
