//! Where the tools may write: below one folder alone.

use crate::cli::Failure;
use cairn_export::SIDECAR_FOLDER;
use std::path::{Component, Path, PathBuf};

/// Longest chain of links, as in operating systems.
const MOST_LINKS: usize = 40;

/// The folder that the tools write below, without links.
pub struct WriteFolder(PathBuf);

impl WriteFolder {
    /// Takes a folder, which must not hold the whole file system.
    pub fn new(folder: &Path) -> Result<WriteFolder, Failure> {
        let fail = |what: String, remedy| Failure::usage("--folder", what, remedy);
        let real = folder.canonicalize().ok().filter(|real| real.is_dir());
        let Some(real) = real else {
            return Err(fail(format!("there is no folder {}", folder.display()), "Name a folder that is there."));
        };
        if real.parent().is_none() {
            let what = format!("{} holds every file of this machine, and the tools could write any", real.display());
            return Err(fail(what, "Name the folder of your piles by --folder."));
        }
        Ok(WriteFolder(real))
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Checks that a file or folder lies below the folder, with all links followed, and so do the files beside it.
    pub fn check(&self, field: &str, path: &str) -> Result<(), String> {
        let fail = |what| Err(format!("{field}: {path} {what}; name a place below {}", self.0.display()));
        let Some(target) = self.target(path) else {
            return fail("leads to no place in the folder that this server writes below");
        };
        if !self.has(&target) {
            return fail("is outside of the folder that this server writes below");
        }
        let sidecars = target.parent().map(|folder| folder.join(SIDECAR_FOLDER));
        let inside = target.read_dir().into_iter().flatten().flatten().map(|entry| entry.path());
        match sidecars.into_iter().chain(inside).any(|path| path.canonicalize().is_ok_and(|real| !self.has(&real))) {
            true => fail("has a link beside it or in it that leads out of the folder that this server writes below"),
            false => Ok(()),
        }
    }

    /// Checks a report: it replaces reports alone.
    pub fn check_report(&self, path: &str) -> Result<(), String> {
        self.check("report", path)?;
        let is_json = Path::new(path).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
        if !is_json {
            return Err(format!("report: {path} is not the name of a report; end it in .json"));
        }
        let is_report = |bytes: &[u8]| {
            let found = serde_json::from_slice::<serde_json::Value>(bytes);
            found.is_ok_and(|report| report.get("measures").is_some() && report.get("counts").is_some())
        };
        match std::fs::read(self.0.join(path)) {
            Ok(bytes) if !is_report(&bytes) => {
                Err(format!("report: {path} is there, and is no report of Cairn; give another name"))
            }
            _ => Ok(()),
        }
    }

    fn has(&self, real: &Path) -> bool {
        real.starts_with(&self.0) && *real != self.0
    }

    /// Where a file will be written, without links. Its last folders may be new.
    fn target(&self, path: &str) -> Option<PathBuf> {
        let mut path = self.0.join(path);
        for _ in 0..MOST_LINKS {
            let Ok(target) = path.read_link() else { break };
            path = path.parent()?.join(target);
        }
        let mut new = Vec::new();
        loop {
            if let Ok(mut real) = path.canonicalize() {
                real.extend(new.iter().rev());
                return Some(real);
            }
            // A link that leads nowhere may lead somewhere later.
            if path.is_symlink() {
                return None;
            }
            match path.components().next_back()? {
                Component::Normal(name) => new.push(name.to_owned()),
                _ => return None,
            }
            path.pop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_places_below_the_folder_are_written() {
        let top = tempfile::tempdir().unwrap();
        let folder = top.path().join("piles");
        std::fs::create_dir_all(folder.join("sub")).unwrap();
        std::fs::write(top.path().join("secret"), "x").unwrap();
        let write = WriteFolder::new(&folder).unwrap_or_else(|_| panic!("it is there"));
        let outside = top.path().join("a.glb").display().to_string();
        for (path, is_admitted) in [
            ("a.glb", true),
            ("sub/new/a.glb", true),
            ("sub/../a.glb", true),
            ("", false),
            (".", false),
            ("..", false),
            ("../a.glb", false),
            ("new/../../a.glb", false),
            (&*outside, false),
        ] {
            assert_eq!(write.check("output", path).is_ok(), is_admitted, "{path}");
        }
        let inside = folder.join("b.glb").display().to_string();
        assert_eq!(write.check("output", &inside), Ok(()));
    }

    #[cfg(unix)]
    #[test]
    fn links_that_lead_out_are_no_way_out() {
        use std::os::unix::fs::symlink;
        let top = tempfile::tempdir().unwrap();
        let folder = top.path().join("piles");
        std::fs::create_dir_all(folder.join("pack")).unwrap();
        std::fs::create_dir_all(folder.join("usd")).unwrap();
        std::fs::write(top.path().join("secret"), "x").unwrap();
        let write = WriteFolder::new(&folder).unwrap_or_else(|_| panic!("it is there"));
        symlink("../secret", folder.join("a.glb")).unwrap();
        symlink("../none", folder.join("b.glb")).unwrap();
        symlink("..", folder.join("up")).unwrap();
        symlink("../..", folder.join("usd/textures")).unwrap();
        symlink("../../secret", folder.join("pack/c.glb")).unwrap();
        for path in ["a.glb", "b.glb", "up/d.glb", "usd/e.usda", "pack"] {
            let refused = write.check("output", path).expect_err(path);
            assert!(refused.contains("that this server writes below"), "{refused}");
        }
    }

    #[test]
    fn a_report_replaces_reports_alone() {
        let top = tempfile::tempdir().unwrap();
        let write = WriteFolder::new(top.path()).unwrap_or_else(|_| panic!("it is there"));
        let put = |name: &str, text: &str| std::fs::write(top.path().join(name), text).unwrap();
        put("package.json", r#"{ "name": "mine" }"#);
        put("old.json", r#"{ "measures": {}, "counts": {} }"#);
        put("notes.txt", "mine");
        assert_eq!(write.check_report("old.json"), Ok(()));
        assert_eq!(write.check_report("new.json"), Ok(()));
        let refused = write.check_report("package.json").unwrap_err();
        assert!(refused.contains("is no report of Cairn; give another name"), "{refused}");
        let refused = write.check_report("notes.txt").unwrap_err();
        assert!(refused.contains("is not the name of a report; end it in .json"), "{refused}");
    }
}
