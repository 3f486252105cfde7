//! Who uses a server that belongs to programs of this machine: each of them holds a lock on a file of its own, which
//! the system releases also when it is killed.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Interval between checks.
const CHECK: Duration = Duration::from_secs(2);

/// Resolves once no program holds a lock in the folder; never, without a folder.
pub async fn all_gone(folder: Option<PathBuf>) {
    let Some(folder) = folder else { return std::future::pending().await };
    loop {
        tokio::time::sleep(CHECK).await;
        let folder = folder.clone();
        if tokio::task::spawn_blocking(move || !is_used(&folder)).await.unwrap_or(false) {
            return;
        }
    }
}

/// Whether a program holds a lock on a file in a folder. A folder that is gone has no users; what cannot be read counts
/// as used, so that no server ends by mistake.
fn is_used(folder: &Path) -> bool {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) => return error.kind() != std::io::ErrorKind::NotFound,
    };
    entries.flatten().any(|entry| match File::open(entry.path()).map(|file| file.try_lock()) {
        Ok(Ok(())) => false,
        Ok(Err(TryLockError::WouldBlock | TryLockError::Error(_))) => true,
        Err(error) => error.kind() != std::io::ErrorKind::NotFound,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_used_while_one_of_its_files_is_locked() {
        let folder = tempfile::tempdir().unwrap();
        assert!(!is_used(&folder.path().join("none")));
        assert!(!is_used(folder.path()));
        let held = [1, 2].map(|number| File::create(folder.path().join(format!("{number}.lock"))).unwrap());
        assert!(!is_used(folder.path()));
        held.iter().for_each(|file| file.lock().unwrap());
        assert!(is_used(folder.path()));
        let [first, second] = held;
        drop(first);
        assert!(is_used(folder.path()));
        drop(second);
        assert!(!is_used(folder.path()));
    }
}
