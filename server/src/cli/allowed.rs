//! The arguments that say which files may be taken from outside of a scene's folder.

use super::Failure;
use cairn_files::Disk;
use cairn_files::fence::Fence;
use cairn_files::problem::Problem;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Clone, Default, clap::Args)]
pub struct AllowArgs {
    /// Folder from which files may be sent to a server, with all below it, although only the scene names them; repeat
    /// it for several, or set CAIRN_ALLOW to folders as in PATH [default: the scene's own folder]
    #[arg(long, value_name = "FOLDER", help_heading = "Files")]
    allow: Vec<PathBuf>,

    /// Read no other files here either, as for a scene of somebody whom you do not know
    #[arg(long, help_heading = "Files")]
    only_allowed: bool,
}

/// Folders as in `PATH`.
pub const VARIABLE: &str = "CAIRN_ALLOW";

/// The folders of the flag, and those of the environment.
pub fn folders(given: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let set = std::env::var_os(VARIABLE).unwrap_or_default();
    let set: Vec<PathBuf> = std::env::split_paths(&set).filter(|folder| !folder.as_os_str().is_empty()).collect();
    let named = given.iter().map(|folder| ("--allow", folder)).chain(set.iter().map(|folder| (VARIABLE, folder)));
    for (flag, folder) in named {
        if !folder.is_dir() {
            let what = format!("there is no folder {}", folder.display());
            return Err(Failure::usage(flag, what, "Name a folder that is there."));
        }
    }
    Ok(given.iter().cloned().chain(set).collect())
}

impl AllowArgs {
    pub fn folders(&self) -> Result<Vec<PathBuf>, Failure> {
        folders(&self.allow)
    }

    /// The fence around what a scene or a model of this folder names. `named`: by the user.
    pub fn fence(&self, home: &Path, named: impl IntoIterator<Item = PathBuf>) -> Result<Fence, Failure> {
        Ok(Fence::new(home, &self.folders()?, named))
    }

    /// Whether files are fenced also where nothing is sent.
    pub fn is_strict(&self) -> bool {
        self.only_allowed
    }

    /// The files of a command that takes models. `sends`: to a server.
    pub fn disk(&self, models: &[&PathBuf], sends: bool) -> Result<Arc<Disk>, Failure> {
        let named = || models.iter().map(|&path| path.clone());
        let fence = (sends || self.only_allowed).then(|| self.fence(Path::new(""), named())).transpose()?;
        Ok(Arc::new(Disk { fence: fence.map(Arc::new), ..Disk::default() }))
    }

    /// The arguments for another process.
    pub fn to_args(&self) -> Vec<OsString> {
        let folders = self.allow.iter().flat_map(|folder| ["--allow".into(), folder.clone().into_os_string()]);
        folders.chain(self.only_allowed.then(|| "--only-allowed".into())).collect()
    }
}

/// An error if files were refused that models name.
pub fn check_refused(refused: Vec<Problem>) -> Result<(), Failure> {
    if refused.is_empty() { Ok(()) } else { Err(Failure::Input(refused)) }
}
