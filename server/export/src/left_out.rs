//! What a result leaves out of its models: recorded by the writers where they leave it out, so that nothing is lost in
//! silence.

use super::SourceModel;
use cairn_files::FileSource;
use cairn_gltf::document::{DocumentError, Object};
use cairn_gltf::log::counted;
use cairn_gltf::picture::PictureFault;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Characters of a name of others in a message.
const MOST_TEXT: usize = 120;

/// Everything that is left out of one model.
#[derive(Default)]
pub struct LeftOut {
    /// By kind, in the singular.
    counts: BTreeMap<&'static str, usize>,
    extensions: BTreeSet<String>,
    images: Vec<MissingImage>,
    /// What decorates and cannot be read, and why.
    broken: BTreeMap<String, String>,
    has_weights: bool,
    /// Copies that are not written as nodes, because they are too many.
    pub instances: usize,
}

/// An image that is not embedded.
pub struct MissingImage {
    pub uri: String,
    pub material: String,
    pub fault: PictureFault,
}

impl LeftOut {
    /// Things of a kind that no result has: `animation`, `camera`.
    pub fn count(&mut self, kind: &'static str, count: usize) {
        if count > 0 {
            *self.counts.entry(kind).or_default() += count;
        }
    }

    pub fn extension(&mut self, name: &str) {
        self.extensions.insert(clip(name));
    }

    /// Takes the extensions off an entry. `decoded`: extensions of which nothing is lost.
    pub fn extensions_of(&mut self, entry: &mut Object, decoded: &[&str]) {
        if let Some(Value::Object(extensions)) = entry.remove("extensions") {
            extensions.keys().filter(|name| !decoded.contains(&name.as_str())).for_each(|name| self.extension(name));
        }
    }

    /// Takes the default weights of morph targets off a node or mesh: bodies have the base shape.
    pub fn weights_of(&mut self, entry: &mut Object) {
        let weights = entry.remove("weights");
        let weights = weights.as_ref().and_then(Value::as_array).into_iter().flatten();
        self.has_weights |= weights.filter_map(Value::as_f64).any(|weight| weight != 0.0);
    }

    pub fn image(&mut self, image: MissingImage) {
        self.images.push(image);
    }

    /// Whether an image is among it.
    pub fn has_images(&self) -> bool {
        !self.images.is_empty()
    }

    pub fn broken(&mut self, what: String, error: &DocumentError) {
        self.broken.entry(clip(&what)).or_insert_with(|| clip(&error.to_string()));
    }

    /// One sentence for each loss.
    pub fn sentences(&self, model: &SourceModel, source: &dyn FileSource) -> Vec<String> {
        let name = model.name;
        let mut sentences: Vec<String> = self.images.iter().map(|image| image.sentence(model, source)).collect();
        if self.has_weights {
            let text = "the default weights of its morph targets are not applied: bodies have the base shape";
            sentences.push(format!("{name}: {text}; apply the weights before export"));
        }
        if self.instances > 0 {
            sentences.push(format!(
                "{name}: it has {} copies by EXT_mesh_gpu_instancing, too many to write each as a node: the result \
                 keeps the extension, which some programs do not show",
                self.instances
            ));
        }
        for (what, why) in &self.broken {
            sentences.push(format!("{name}: {what} cannot be read and is left out of the result: {why}"));
        }
        let things = self.counts.iter().map(|(kind, count)| counted(*count, kind, &format!("{kind}s")));
        let extensions: Vec<&str> = self.extensions.iter().map(String::as_str).collect();
        let extensions = match &extensions[..] {
            [] => None,
            [one] => Some(format!("the extension {one}")),
            all => Some(format!("the extensions {}", all.join(", "))),
        };
        let listed: Vec<String> = things.chain(extensions).collect();
        if !listed.is_empty() {
            sentences.push(format!("{name}: left out of the result: {}", listed.join(", ")));
        }
        sentences
    }
}

impl MissingImage {
    fn sentence(&self, model: &SourceModel, source: &dyn FileSource) -> String {
        let (name, uri, material) = (model.name, clip(&self.uri), clip(&self.material));
        let image = format!("{name}: the image \"{uri}\" of material `{material}`");
        let without = "the result shows the material without it";
        match &self.fault {
            PictureFault::NotFound { why, tried } if tried.is_empty() => {
                let remedy = "Put it beside the model and write its plain name as the URI.";
                format!("{image} is not read, because {why}: {without}. {remedy}")
            }
            PictureFault::NotFound { tried, .. } => {
                let folder = cairn_files::folder_of(Path::new(model.file));
                let places = tried.iter().map(|path| cairn_files::normalized(&folder.join(path)).display().to_string());
                let (what, remedy) = source.absence();
                format!("{image} {what} (looked for {}): {without}. {remedy}", places.collect::<Vec<_>>().join(", "))
            }
            fault => {
                format!("{image} is not embedded: {fault}, and programs may not show it. Save it as PNG or JPEG.")
            }
        }
    }
}

/// Text of others made fit for a message: one line, of bounded length.
fn clip(text: &str) -> String {
    let clean = |c: char| if c.is_control() { '\u{fffd}' } else { c };
    let mut clipped: String = text.chars().take(MOST_TEXT).map(clean).collect();
    if text.chars().nth(MOST_TEXT).is_some() {
        clipped.push_str("...");
    }
    clipped
}
