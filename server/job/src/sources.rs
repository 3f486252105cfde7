//! The files of a scene, in memory.

use cairn_export::{ConvertedStage, PartChoice, StagePart};
use cairn_files::problem::Problem;
use cairn_files::{FileSource, split_node};
use cairn_gltf::{Resolver, document};
use cairn_wire::proto;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// A model as a scene names it: `kit.glb#Brick`, `kit.usd#/Kit/Brick`.
pub struct Reference {
    pub name: String,
    pub file: PathBuf,
    /// The node or prim.
    pub node: Option<String>,
    /// Shown in a frame at the origin of its prim: a prop.
    pub at_origin: bool,
    /// Its name in the result.
    pub portable: String,
    /// The path by which a result in USD refers to its file.
    pub asset: String,
}

impl Reference {
    pub fn new(path: &str) -> Reference {
        let (file, node) = split_node(path);
        Reference {
            name: path.to_owned(),
            file: file.into(),
            node: node.map(str::to_owned),
            at_origin: false,
            portable: path.to_owned(),
            asset: file.to_owned(),
        }
    }

    /// Of a prop.
    pub fn of_prop(path: &str) -> Reference {
        Reference { at_origin: true, ..Reference::new(path) }
    }

    /// The part of a file of USD that it means.
    pub fn part(&self) -> PartChoice {
        PartChoice { prim: self.node.clone(), at_origin: self.at_origin }
    }
}

/// Names of files in results. They do not depend on the machine or the location of the scene: they are relative to the
/// scene's folder or, if a file outside it has an absolute path, to the common folder of all files.
#[derive(Clone, Debug, Default)]
pub struct PortableNames {
    base: PathBuf,
    from_root: bool,
}

impl PortableNames {
    /// For the models of a scene.
    pub fn new<'a>(models: impl Iterator<Item = &'a Path> + Clone, folder: &Path) -> PortableNames {
        // `starts_with` an empty folder is always true, so absolute paths are compared first.
        let is_inside = |file: &Path| folder.is_relative() == file.is_relative() && file.starts_with(folder);
        let is_elsewhere = |file: &Path| file.is_absolute() && !is_inside(file);
        if !models.clone().any(is_elsewhere) {
            return PortableNames { base: folder.to_owned(), from_root: false };
        }
        let folders = models.map(|file| cairn_files::folder_of(&from_root(file)).to_owned());
        let common = |a: PathBuf, b: PathBuf| {
            a.components().zip(b.components()).take_while(|(a, b)| a == b).map(|(a, _)| a).collect()
        };
        PortableNames { base: folders.reduce(common).unwrap_or_default(), from_root: true }
    }

    /// The name of a file, with its node if the path has one.
    pub fn of(&self, path: &str) -> String {
        let (file, node) = split_node(path);
        let file = if self.from_root { from_root(Path::new(file)) } else { file.into() };
        let inside = file.strip_prefix(&self.base).unwrap_or(&file);
        let parts = inside.components().map(|part| part.as_os_str().to_string_lossy());
        let name = parts.collect::<Vec<_>>().join("/");
        node.map_or(name.clone(), |node| format!("{name}#{node}"))
    }

    /// The folder that names are from.
    pub fn base(&self) -> &Path {
        &self.base
    }

    /// The name of a file that a model names by this path from its folder.
    pub fn beside(&self, model: &str, relative: &str) -> String {
        if Path::new(relative).is_absolute() {
            return relative.to_owned();
        }
        let model = self.of(model);
        let folder = model.rfind('/').map_or("", |at| &model[..=at]);
        let path = cairn_files::normalized(Path::new(&format!("{folder}{relative}")));
        path.components().map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
    }
}

fn from_root(file: &Path) -> PathBuf {
    std::path::absolute(file).unwrap_or_else(|_| file.to_owned())
}

/// Changes each path of a scene by `change`.
pub fn rename(scene: &mut proto::Scene, change: impl Fn(&str) -> String) {
    let shapes = scene.control_mesh.iter_mut().chain(&mut scene.region).map(|shape| &mut shape.path);
    let props = scene.props.iter_mut().map(|prop| &mut prop.path);
    let statics = scene.statics.iter_mut().map(|model| &mut model.path);
    let piles = scene.piles.iter_mut().map(|pile| &mut pile.path);
    let around = scene.around.iter_mut().map(|result| &mut result.path);
    let meshes = scene.emitters.iter_mut().filter_map(|emitter| emitter.mesh.as_mut());
    let former = scene.from.iter_mut().map(|result| &mut result.path);
    shapes
        .chain(props)
        .chain(statics)
        .chain(meshes)
        .chain(piles)
        .chain(around)
        .chain(former)
        .filter(|path| !path.is_empty())
        .for_each(|path| *path = change(path));
}

/// The files of a scene, without nodes.
pub fn model_files(scene: &proto::Scene) -> BTreeSet<PathBuf> {
    let shapes = scene.control_mesh.iter().chain(&scene.region).map(|shape| &shape.path);
    let props = scene.props.iter().map(|prop| &prop.path);
    let statics = scene.statics.iter().map(|model| &model.path);
    let results = scene.around.iter().map(|result| &result.path);
    let results = results.chain(scene.from.iter().map(|result| &result.path));
    let others = scene.piles.iter().map(|pile| &pile.path).chain(results);
    let shapes = shapes.chain(others);
    let paths = shapes.chain(props).chain(statics).chain(scene.emitters.iter().flat_map(|emitter| &emitter.mesh));
    paths.map(|path| Reference::new(path).file).filter(|file| !file.as_os_str().is_empty()).collect()
}

/// The parts of files of USD that a scene's models mean.
pub fn usd_parts(scene: &proto::Scene) -> BTreeMap<PathBuf, BTreeSet<PartChoice>> {
    let props = scene.props.iter().map(|prop| Reference::of_prop(&prop.path));
    let shapes = scene.control_mesh.iter().chain(&scene.region).map(|shape| &shape.path);
    let others = shapes.chain(scene.statics.iter().map(|model| &model.path));
    let others = others.chain(scene.around.iter().map(|result| &result.path));
    let others = others.chain(scene.piles.iter().map(|pile| &pile.path));
    let others = others.chain(scene.emitters.iter().flat_map(|emitter| &emitter.mesh));
    let mut parts: BTreeMap<PathBuf, BTreeSet<PartChoice>> = BTreeMap::new();
    for reference in props.chain(others.map(|path| Reference::new(path))) {
        parts.entry(reference.file.clone()).or_default().insert(reference.part());
    }
    parts
}

/// One file of models in memory.
pub struct InputFile {
    /// Its name in messages.
    pub name: String,
    /// Where it lies.
    pub path: PathBuf,
    pub bytes: Vec<u8>,
    /// Reads files that it names.
    pub resolve: Box<Resolver<'static>>,
    /// Of a file of USD.
    usd: Option<UsdInput>,
    source: Arc<dyn FileSource>,
    beside: Arc<SidecarReader>,
}

/// A file of USD as glTF.
struct UsdInput {
    stage: ConvertedStage,
    parts: Vec<PartChoice>,
}

impl InputFile {
    pub fn read(path: &Path, source: &Arc<dyn FileSource>) -> Result<InputFile, Problem> {
        InputFile::read_parts(path, source, None)
    }

    /// Reads a file; of one of USD, these parts as glTF.
    pub fn read_parts(
        path: &Path,
        source: &Arc<dyn FileSource>,
        parts: Option<&BTreeSet<PartChoice>>,
    ) -> Result<InputFile, Problem> {
        let bytes = source.read(path)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let beside = SidecarReader { folder, model: path.to_owned(), source: source.clone(), read: Mutex::default() };
        let beside = Arc::new(beside);
        let sidecars = beside.clone();
        let resolve = Box::new(move |relative: &str| sidecars.read(relative));
        let found = source.find(path).unwrap_or_else(|| path.to_owned());
        let name = path.display().to_string();
        let mut file = InputFile { name, path: found, bytes, resolve, usd: None, source: source.clone(), beside };
        if let Some(parts) = parts.filter(|_| cairn_files::is_usd(&file.name)) {
            let parts: Vec<PartChoice> = parts.iter().cloned().collect();
            let stage = cairn_export::convert_usd(&file.bytes, &*file.resolve, &parts).map_err(|what| {
                Problem::at(path, what, "Put what it names where it looks for it, or name another prim.")
            })?;
            file.usd = Some(UsdInput { stage, parts });
        }
        Ok(file)
    }

    /// The file as glTF.
    pub fn gltf(&self) -> &[u8] {
        self.usd.as_ref().map_or(&self.bytes, |usd| &usd.stage.glb)
    }

    /// What is not read of a file of USD, one sentence each.
    pub fn notes(&self) -> &[String] {
        self.usd.as_ref().map_or(&[], |usd| &usd.stage.notes)
    }

    /// The part of a stage that a model means.
    pub fn part(&self, reference: &Reference) -> Option<&StagePart> {
        let usd = self.usd.as_ref()?;
        let place = usd.parts.iter().position(|part| *part == reference.part())?;
        usd.stage.parts.get(place)
    }

    /// The name of a model in the file as glTF.
    pub fn node<'a>(&'a self, reference: &'a Reference) -> Option<&'a str> {
        match self.part(reference) {
            Some(part) => Some(&part.scene),
            None => reference.node.as_deref(),
        }
    }

    /// Where the file lies, and those that it names.
    pub fn paths(&self) -> Vec<PathBuf> {
        let folder = Path::new(&self.name).parent().unwrap_or(Path::new(""));
        let beside = self.sidecars().into_keys().filter_map(|relative| place(folder, &relative));
        let beside = beside.map(|path| self.source.find(&path).unwrap_or(path));
        std::iter::once(self.path.clone()).chain(beside).collect()
    }

    /// The files that were read of those that it names, by their paths from its folder.
    pub fn read_so_far(&self) -> BTreeMap<String, Vec<u8>> {
        self.beside.read.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether it is what models are, by its content: glTF, or USD, which was read as glTF.
    pub fn recognise(&self) -> Result<(), Problem> {
        if self.usd.is_some() {
            return Ok(());
        }
        document::recognise(&self.bytes).map_err(|(what, remedy)| Problem::new(&self.name, what.to_string(), remedy))
    }

    /// The files that it names and that are there, by their paths from its folder. Missing ones are left out, because
    /// only bakes that use them need them.
    pub fn sidecars(&self) -> BTreeMap<String, Vec<u8>> {
        if let Some(usd) = &self.usd {
            return usd.stage.files.clone();
        }
        document::external_files(&self.bytes, &*self.resolve).unwrap_or_default()
    }
}

/// The place of a file that a model in a folder names. A stage may name one by its whole path.
pub fn place(folder: &Path, relative: &str) -> Option<PathBuf> {
    if Path::new(relative).is_absolute() { Some(relative.into()) } else { cairn_files::beside(folder, relative) }
}

/// The files that a glTF file names. They stay in memory, so that the export uses what the bake has read.
struct SidecarReader {
    folder: PathBuf,
    /// The file that names them.
    model: PathBuf,
    source: Arc<dyn FileSource>,
    read: Mutex<BTreeMap<String, Vec<u8>>>,
}

impl SidecarReader {
    fn read(&self, relative: &str) -> Result<Vec<u8>, String> {
        let path = place(&self.folder, relative).ok_or("it is not beside the file")?;
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bytes) = read.get(relative) {
            return Ok(bytes.clone());
        }
        let path = self.source.find(&path).unwrap_or(path);
        let bytes = self.source.read_beside(&self.model, &path).map_err(|problem| problem.to_string())?;
        read.insert(relative.to_owned(), bytes.clone());
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(files: &[&str], folder: &str) -> Vec<String> {
        let names = PortableNames::new(files.iter().map(Path::new), Path::new(folder));
        files.iter().map(|file| names.of(&format!("{file}#Node"))).collect()
    }

    #[test]
    fn files_beside_a_model_are_named_from_its_folder() {
        let names = |base: &str, from_root| PortableNames { base: base.into(), from_root };
        let red = "../textures/red.png";
        assert_eq!(names("", false).beside("kit/gltf/a.gltf", red), "kit/textures/red.png");
        assert_eq!(names("kit/gltf", false).beside("kit/gltf/a.gltf", red), "../textures/red.png");
        assert_eq!(names("/kit/gltf", true).beside("/kit/gltf/a.gltf", red), "../textures/red.png");
        assert_eq!(names("", false).beside("a.gltf", "sub/a.bin"), "sub/a.bin");
    }

    #[test]
    fn files_are_named_below_the_scene_or_below_what_holds_all() {
        assert_eq!(names(&["scenes/kit/a.glb", "scenes/../b.glb"], "scenes"), ["kit/a.glb#Node", "../b.glb#Node"]);
        assert_eq!(names(&["/me/scenes/a.glb"], "/me/scenes"), ["a.glb#Node"]);
        assert_eq!(names(&["/kit/a.glb"], ""), ["a.glb#Node"]);
        // Two files of the same name stay distinct.
        assert_eq!(names(&["/me/one/a.glb", "/me/two/a.glb"], "/me/scenes"), ["one/a.glb#Node", "two/a.glb#Node"]);
        assert_eq!(names(&["/me/scenes/a.glb", "/me/a.glb"], "/me/scenes"), ["scenes/a.glb#Node", "a.glb#Node"]);
    }
}
