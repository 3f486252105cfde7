//! Who has uploaded what is in the store: a small file for each asset, and the bytes of each caller in memory.

use crate::accounts::{Account, Usage};
use cairn_files::failpoints;
use std::collections::BTreeMap;
use std::fs;
use std::io::Result;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What an asset counts at least, bytes: a block of a disk, so that many small ones are not free.
const LEAST: u64 = 4096;

/// The owners of assets, by the names of their files.
#[derive(Debug)]
pub struct AssetOwners {
    folder: PathBuf,
    table: Mutex<Table>,
}

#[derive(Debug, Default)]
struct Table {
    assets: BTreeMap<String, (Account, u64)>,
    usage: Usage,
}

/// Room that an upload holds until it is dropped.
#[derive(Debug)]
pub struct Reservation {
    owners: Arc<AssetOwners>,
    account: Account,
    bytes: u64,
}

/// What an asset of this size counts.
pub fn counted(bytes: u64) -> u64 {
    bytes.max(LEAST)
}

impl AssetOwners {
    /// Reads the owners of these assets: names and sizes of their files. Forgets those of others.
    pub fn open(folder: PathBuf, assets: impl Iterator<Item = (String, u64)>) -> Result<AssetOwners> {
        fs::create_dir_all(&folder)?;
        let mut table = Table::default();
        for (name, bytes) in assets {
            let kept = fs::read(folder.join(&name)).ok().and_then(|text| serde_json::from_slice(&text).ok());
            let (project, caller): (String, String) = kept.unwrap_or_default();
            table.add(name, Account { project, caller }, bytes);
        }
        for entry in fs::read_dir(&folder)?.flatten() {
            if !table.assets.contains_key(&*entry.file_name().to_string_lossy()) {
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(AssetOwners { folder, table: Mutex::new(table) })
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds an asset, which keeps the owner that it may have already. Returns whether it is new.
    pub fn add(&self, name: &str, account: &Account, bytes: u64) -> Result<bool> {
        let mut table = self.table();
        if table.assets.get(name).is_some_and(|(known, _)| !known.caller.is_empty()) {
            return Ok(false);
        }
        let text = serde_json::to_vec(&(&account.project, &account.caller))?;
        // A part of it is nobody's name.
        failpoints::at("owner-write")?;
        fs::write(self.folder.join(name), text)?;
        table.remove(name);
        table.add(name.to_owned(), account.clone(), bytes);
        Ok(true)
    }

    pub fn remove(&self, name: &str) {
        self.table().remove(name);
        let _ = fs::remove_file(self.folder.join(name));
    }

    /// Who pays for an asset.
    pub fn of(&self, name: &str) -> Account {
        self.table().assets.get(name).map_or_else(Account::default, |(account, _)| account.clone())
    }

    /// The assets of an account.
    pub fn assets_of(&self, account: &Account) -> Vec<String> {
        let table = self.table();
        let own = table.assets.iter().filter(|(_, (owner, _))| owner == account);
        own.map(|(name, _)| name.clone()).collect()
    }

    /// Bytes of an account, and of its project, uploads that go on included.
    pub fn bytes(&self, account: &Account) -> [u64; 2] {
        let table = self.table();
        [table.usage.of(account), table.usage.of_project(&account.project)]
    }

    /// Bytes of the assets of an account, which may go.
    pub fn bytes_of_assets(&self, account: &Account) -> u64 {
        self.table().assets.values().filter(|(owner, _)| owner == account).map(|(_, bytes)| bytes).sum()
    }

    /// Holds room for an upload.
    pub fn reserve(self: &Arc<Self>, account: &Account, bytes: u64) -> Reservation {
        let bytes = counted(bytes);
        self.table().usage.add(account, bytes);
        Reservation { owners: self.clone(), account: account.clone(), bytes }
    }
}

impl Table {
    fn add(&mut self, name: String, account: Account, bytes: u64) {
        let bytes = counted(bytes);
        self.usage.add(&account, bytes);
        self.assets.insert(name, (account, bytes));
    }

    fn remove(&mut self, name: &str) {
        if let Some((account, bytes)) = self.assets.remove(name) {
            self.usage.remove(&account, bytes);
        }
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.owners.table().usage.remove(&self.account, self.bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn owners_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let open = |assets: &[(&str, u64)]| {
            let assets = assets.iter().map(|&(name, bytes)| (name.to_owned(), bytes));
            Arc::new(AssetOwners::open(folder.path().join("owners"), assets).unwrap())
        };
        let (anna, ben) = (Account::new("dune", "anna"), Account::new("dune", "ben"));
        let owners = open(&[]);
        owners.add("a", &anna, 10_000).unwrap();
        owners.add("a", &ben, 10_000).unwrap();
        owners.add("b", &ben, 1).unwrap();
        assert_eq!(owners.bytes(&anna), [10_000, 10_000 + LEAST]);
        let held = owners.reserve(&anna, 5000);
        assert_eq!(owners.bytes(&anna)[0], 15_000);
        drop(held);
        // The next server knows them; what an older one has stored is nobody's, until somebody uploads it again.
        let owners = open(&[("a", 10_000), ("c", 7000)]);
        assert_eq!(
            (owners.of("a"), owners.of("b"), owners.of("c")),
            (anna.clone(), Account::default(), Account::default())
        );
        owners.add("c", &ben, 7000).unwrap();
        assert_eq!((owners.bytes(&ben)[0], owners.bytes(&Account::default())[0]), (7000, 0));
        assert_eq!(owners.assets_of(&anna), ["a"]);
        owners.remove("a");
        assert_eq!(owners.bytes(&anna), [0, 7000]);
        assert!(!folder.path().join("owners/b").exists(), "it is gone, and so is its owner");
    }
}
