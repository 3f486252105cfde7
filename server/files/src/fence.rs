//! Which files may be taken where a scene or a model, whose author nobody knows, names them.
//!
//! A file may be taken if the user named it, or if it lies in one of some folders, with all links followed. Who may
//! read it is no test: what is private to this user is readable, too.

use crate::problem::Problem;
use crate::{folder_of, is_below, normalized};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The folders and files that may be taken.
#[derive(Debug, Default)]
pub struct Fence {
    /// The scene's own folder, as it is written.
    home: PathBuf,
    /// Without links.
    folders: Vec<PathBuf>,
    /// Files that the user named, without `.` and `..`.
    named: BTreeSet<PathBuf>,
    refused: Mutex<Vec<Problem>>,
}

impl Fence {
    /// `home`: the folder of what names files. `others`: more folders. `named`: files that the user named.
    pub fn new(home: &Path, others: &[PathBuf], named: impl IntoIterator<Item = PathBuf>) -> Fence {
        let folders = others.iter().map(PathBuf::as_path).chain([home]);
        Fence {
            home: home.to_owned(),
            folders: folders.filter_map(|folder| or_current(folder).canonicalize().ok()).collect(),
            named: named.into_iter().map(|file| normalized(&file)).collect(),
            refused: Mutex::default(),
        }
    }

    /// Whether a file may be taken, or why not. `model`: the one that names it, if no scene does.
    pub fn admit(&self, path: &Path, model: Option<&Path>) -> Result<(), Problem> {
        // What is not there is reported by whoever reads it.
        let Ok(real) = path.canonicalize() else { return Ok(()) };
        let is_named = |path: &Path| self.named.contains(&normalized(path));
        let beside = model.filter(|model| is_named(model)).map(folder_of);
        let beside = beside.and_then(|folder| folder.canonicalize().ok());
        if self.folders.iter().chain(&beside).any(|folder| real.starts_with(folder)) {
            return Ok(());
        }
        let own = model.map_or(&*self.home, folder_of);
        // A link is not visible in its name.
        let is_link = is_below(or_current(own), path) || is_below(own, path);
        if is_named(path) && model.is_none() && !is_link {
            return Ok(());
        }
        let what = match (is_link, model) {
            (true, None) => "a link that leads out of the scene's folder".to_owned(),
            (true, Some(_)) => "a link that leads out of the folder of the model that names it".to_owned(),
            (false, None) => "outside of the scene's folder, and only the scene names it".to_owned(),
            (false, Some(model)) => format!("outside of the scene's folder, and only {} names it", model.display()),
        };
        let folder = folder_of(&real).display().to_string();
        let remedy = format!(
            "If you know this file, allow its folder by --allow {folder} (or CAIRN_ALLOW), or copy it beside the scene."
        );
        let problem = Problem::at(path, what, remedy);
        let mut refused = self.refused.lock().unwrap_or_else(PoisonError::into_inner);
        if !refused.contains(&problem) {
            refused.push(problem.clone());
        }
        Err(problem)
    }

    /// What has been refused so far.
    pub fn refused(&self) -> Vec<Problem> {
        self.refused.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// The current folder is an empty path, too.
fn or_current(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with these files.
    fn folder(files: &[&str]) -> tempfile::TempDir {
        let top = tempfile::tempdir().unwrap();
        for file in files {
            let path = top.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "x").unwrap();
        }
        top
    }

    #[test]
    fn files_are_taken_from_folders_and_by_name() {
        let top = folder(&["scene/a.glb", "scene/sub/b.glb", "kit/c.gltf", "kit/c.bin", "kit/d.glb", "lib/e.glb"]);
        let at = |path: &str| top.path().join(path);
        let fence = Fence::new(&at("scene"), &[at("lib")], [at("scene/../kit/c.gltf")]);
        let kit = at("kit/c.gltf");
        for (path, model, is_admitted) in [
            ("scene/a.glb", None, true),
            ("scene/../scene/sub/b.glb", None, true),
            ("lib/e.glb", None, true),
            // Named by the user, and what it names beside itself.
            ("kit/c.gltf", None, true),
            ("kit/c.bin", Some(&*kit), true),
            ("lib/e.glb", Some(&*kit), true),
            // Named by the scene alone.
            ("kit/d.glb", None, false),
            ("kit/c.bin", None, false),
            ("scene/../kit/d.glb", None, false),
            ("kit/d.glb", Some(&*at("scene/a.glb")), false),
            ("kit/none.glb", None, true),
        ] {
            assert_eq!(fence.admit(&at(path), model).is_ok(), is_admitted, "{path} of {model:?}");
        }
        assert_eq!(fence.refused().len(), 4, "{:?}", fence.refused());
        let text = fence.refused()[0].to_string();
        assert!(text.contains("only the scene names it") && text.contains("--allow"), "{text}");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed() {
        let top = folder(&["scene/a.glb", "kit/c.glb", "kit/tex/d.png"]);
        let at = |path: &str| top.path().join(path);
        std::os::unix::fs::symlink("../kit/c.glb", at("scene/link.glb")).unwrap();
        std::os::unix::fs::symlink("a.glb", at("scene/near.glb")).unwrap();
        std::os::unix::fs::symlink("../kit/tex", at("scene/tex")).unwrap();
        let said = |fence: Fence, path: &str, model: Option<&str>| {
            let model = model.map(at);
            fence.admit(&at(path), model.as_deref()).err().map(|problem| problem.what)
        };
        let fence = || Fence::new(&at("scene"), &[], [at("scene/link.glb")]);
        assert_eq!(said(fence(), "scene/near.glb", None), None);
        let what = said(fence(), "scene/link.glb", None).expect("a link leads out");
        assert!(what.contains("a link that leads out of the scene's folder"), "{what}");
        let what = said(fence(), "scene/tex/d.png", Some("scene/a.glb")).expect("a link leads out");
        assert!(what.contains("a link that leads out of the folder of the model"), "{what}");
        // Where its target is allowed, it is as good as the file.
        assert_eq!(said(Fence::new(&at("scene"), &[at("kit")], []), "scene/link.glb", None), None);
    }
}
