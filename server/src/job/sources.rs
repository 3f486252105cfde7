//! The files that a scene names, in memory.

use crate::files::{self, split_node};
use crate::model::document::Resolver;
use crate::problem::Problem;
use crate::wire::proto;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Gives the content of a file that a scene names, or that a file of it names.
pub type Open = Arc<dyn Fn(&Path) -> Result<Vec<u8>, Problem> + Send + Sync>;

/// A model as a scene names it: `kit.glb#Brick`.
pub struct Reference {
    pub name: String,
    pub file: PathBuf,
    pub node: Option<String>,
    /// What the result calls it.
    pub portable: String,
}

impl Reference {
    pub fn new(path: &str) -> Reference {
        let (file, node) = split_node(path);
        Reference { name: path.to_owned(), file: file.into(), node: node.map(str::to_owned), portable: path.to_owned() }
    }
}

/// Names of files as results have them: the same wherever the scene lies and whoever bakes it. They are relative to the scene's
/// folder; where a file lies elsewhere, and is named from the root, to the folder that all files are below.
#[derive(Clone, Debug, Default)]
pub struct Names {
    base: PathBuf,
    from_root: bool,
}

impl Names {
    /// For the models that a scene names.
    pub fn new<'a>(models: impl Iterator<Item = &'a Path> + Clone, folder: &Path) -> Names {
        // Every path starts with the empty one.
        let is_inside = |file: &Path| folder.is_relative() == file.is_relative() && file.starts_with(folder);
        let is_elsewhere = |file: &Path| file.is_absolute() && !is_inside(file);
        if !models.clone().any(is_elsewhere) {
            return Names { base: folder.to_owned(), from_root: false };
        }
        let folders = models.map(|file| files::folder_of(&from_root(file)).to_owned());
        let common = |a: PathBuf, b: PathBuf| {
            a.components().zip(b.components()).take_while(|(a, b)| a == b).map(|(a, _)| a).collect()
        };
        Names { base: folders.reduce(common).unwrap_or_default(), from_root: true }
    }

    /// Of a file, with its node if one is named.
    pub fn of(&self, path: &str) -> String {
        let (file, node) = split_node(path);
        let file = if self.from_root { from_root(Path::new(file)) } else { file.into() };
        let inside = file.strip_prefix(&self.base).unwrap_or(&file);
        let parts = inside.components().map(|part| part.as_os_str().to_string_lossy());
        let name = parts.collect::<Vec<_>>().join("/");
        node.map_or(name.clone(), |node| format!("{name}#{node}"))
    }
}

fn from_root(file: &Path) -> PathBuf {
    std::path::absolute(file).unwrap_or_else(|_| file.to_owned())
}

/// The paths of a scene, each changed by `change`.
pub fn rename(scene: &mut proto::Scene, change: impl Fn(&str) -> String) {
    let shapes = scene.control_mesh.iter_mut().chain(&mut scene.region).map(|shape| &mut shape.path);
    let props = scene.props.iter_mut().map(|prop| &mut prop.path);
    let statics = scene.statics.iter_mut().map(|model| &mut model.path);
    let meshes = scene.emitters.iter_mut().filter_map(|emitter| emitter.mesh.as_mut());
    shapes
        .chain(props)
        .chain(statics)
        .chain(meshes)
        .filter(|path| !path.is_empty())
        .for_each(|path| *path = change(path));
}

/// The files that a scene names, without their nodes.
pub fn model_files(scene: &proto::Scene) -> BTreeSet<PathBuf> {
    let shapes = scene.control_mesh.iter().chain(&scene.region).map(|shape| &shape.path);
    let props = scene.props.iter().map(|prop| &prop.path);
    let statics = scene.statics.iter().map(|model| &model.path);
    let paths = shapes.chain(props).chain(statics).chain(scene.emitters.iter().flat_map(|emitter| &emitter.mesh));
    paths.map(|path| Reference::new(path).file).filter(|file| !file.as_os_str().is_empty()).collect()
}

/// One glTF file in memory.
pub struct InputFile {
    /// What messages call it.
    pub name: String,
    pub bytes: Vec<u8>,
    /// Reads the files beside it.
    pub resolve: Box<Resolver<'static>>,
}

impl InputFile {
    pub fn read(path: &Path, open: &Open) -> Result<InputFile, Problem> {
        let bytes = open(path)?;
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let beside = Beside { folder, open: open.clone(), read: Mutex::default() };
        let resolve = Box::new(move |relative: &str| beside.read(relative));
        Ok(InputFile { name: path.display().to_string(), bytes, resolve })
    }
}

/// The files beside a glTF file. Kept once read: the export, long after, must find what the bake saw.
struct Beside {
    folder: PathBuf,
    open: Open,
    read: Mutex<BTreeMap<String, Vec<u8>>>,
}

impl Beside {
    fn read(&self, relative: &str) -> Result<Vec<u8>, String> {
        let path = files::below(&self.folder, relative).ok_or("it leads out of the file's own folder")?;
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bytes) = read.get(relative) {
            return Ok(bytes.clone());
        }
        let bytes = (self.open)(&path).map_err(|problem| problem.to_string())?;
        read.insert(relative.to_owned(), bytes.clone());
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(files: &[&str], folder: &str) -> Vec<String> {
        let names = Names::new(files.iter().map(Path::new), Path::new(folder));
        files.iter().map(|file| names.of(&format!("{file}#Node"))).collect()
    }

    #[test]
    fn files_are_named_below_the_scene_or_below_what_holds_all() {
        assert_eq!(names(&["scenes/kit/a.glb", "scenes/../b.glb"], "scenes"), ["kit/a.glb#Node", "../b.glb#Node"]);
        assert_eq!(names(&["/me/scenes/a.glb"], "/me/scenes"), ["a.glb#Node"]);
        assert_eq!(names(&["/kit/a.glb"], ""), ["a.glb#Node"]);
        // Two of one name stay two.
        assert_eq!(names(&["/me/one/a.glb", "/me/two/a.glb"], "/me/scenes"), ["one/a.glb#Node", "two/a.glb#Node"]);
        assert_eq!(names(&["/me/scenes/a.glb", "/me/a.glb"], "/me/scenes"), ["scenes/a.glb#Node", "a.glb#Node"]);
    }
}
