//! What the store gives up: entries that are too old, and those of who is furthest above its share of a full one.

use super::{CACHE, Kept, Store, bytes_below, entries, is_asset, is_bake};
use crate::accounts::{Account, Limits, Usage};
use crate::asset_owners::counted;
use std::collections::BTreeMap;
use std::fs;
use std::io::Result;
use std::path::Path;
use tracing::{info, warn};

/// What the store asks of those that know its bakes.
pub trait BakeKeeper {
    /// Who pays for a bake.
    fn account(&self, id: &str) -> Account;
    /// Whether others want it than those who pay for it.
    fn is_shared(&self, id: &str) -> bool;
    /// Removes a bake unless it is unfinished. Returns whether it did.
    fn remove(&self, id: &str) -> Result<bool>;
    /// Notes what a bake takes now: it has its assets alone once they are no longer among the uploads.
    fn measured(&self, id: &str, bytes: u64);
    /// Lets somebody else pay who wants it, too. Returns whether there is one.
    fn pass_on(&self, id: &str) -> bool;
}

impl Store {
    /// Removes assets of an account, the least recently used ones first, until so many bytes are free.
    pub fn free(&self, account: &Account, bytes: u64) {
        let mut freed = 0;
        let own = self.owners.assets_of(account).into_iter().map(|name| self.root.join("assets").join(name));
        let mut own: Vec<Kept> = own.filter_map(|path| Kept::of(path).ok()).collect();
        own.sort_by_key(|kept| kept.used);
        for kept in own {
            if freed >= bytes {
                break;
            }
            match self.remove_asset(&kept.path) {
                Ok(()) => kept.log(account, "its owner uploads more than it may keep"),
                Err(error) => warn!(path = %kept.path.display(), %error, "an asset could not be removed"),
            }
            freed += counted(kept.bytes);
        }
    }

    fn remove_asset(&self, path: &Path) -> Result<()> {
        self.check_here()?;
        fs::remove_file(path)?;
        self.owners.remove(&path.file_name().unwrap_or_default().to_string_lossy());
        Ok(())
    }

    /// Removes entries that are too old. While the rest takes too much, those of who is furthest above its share of
    /// the store, the least recently used first. Returns the remaining bytes.
    pub fn trim(&self, bakes: &impl BakeKeeper, limits: Limits) -> Result<u64> {
        self.check_here()?;
        self.save_clock();
        let mut cached = bytes_below(&self.root.join(CACHE));
        let (mut usage, mut queues) = (Usage::default(), BTreeMap::<Account, Vec<Kept>>::new());
        let mut total = 0;
        for kept in
            entries(&self.root.join("assets"), is_asset)?.into_iter().chain(entries(&self.root.join("bakes"), is_bake)?)
        {
            let account = if kept.is_bake { bakes.account(&kept.name()) } else { self.owners.of(&kept.name()) };
            if self.is_too_old(&kept) && self.remove_entry(&kept, bakes) {
                kept.log(&account, "nobody has used it for store_days");
                continue;
            }
            if kept.is_bake {
                bakes.measured(&kept.name(), kept.bytes);
            }
            total += kept.bytes;
            usage.add(&account, kept.bytes);
            queues.entry(account).or_default().push(kept);
        }
        if cached > 0 && total + cached > self.most_bytes {
            // Results are worth more than the cache, which only saves time.
            info!(bytes = cached, "the cache goes: the store is full");
            let _ = fs::remove_dir_all(self.root.join(CACHE));
            cached = 0;
        }
        total += cached;
        for queue in queues.values_mut() {
            // The last one goes first. What others want, too, is last.
            queue.sort_by_key(|kept| (kept.is_bake && bakes.is_shared(&kept.name()), kept.used));
            queue.reverse();
        }
        while total > self.most_bytes {
            let has_entries = |account: &Account| queues.get(account).is_some_and(|queue| !queue.is_empty());
            let Some(account) = usage.furthest_over(self.most_bytes, limits, has_entries) else {
                warn!(bytes = total, limit = self.most_bytes, "the store is full of bakes that are not finished");
                break;
            };
            let Some(kept) = queues.get_mut(&account).and_then(Vec::pop) else { break };
            if kept.is_bake && bakes.is_shared(&kept.name()) && bakes.pass_on(&kept.name()) {
                let other = bakes.account(&kept.name());
                usage.remove(&account, kept.bytes);
                usage.add(&other, kept.bytes);
                info!(
                    bake_id = kept.name(),
                    from = account.caller,
                    to = other.caller,
                    "another caller pays for a bake"
                );
                queues.entry(other).or_default().insert(0, kept);
            } else if self.remove_entry(&kept, bakes) {
                kept.log(&account, "the store is full, and its owner is furthest above its share");
                usage.remove(&account, kept.bytes);
                total -= kept.bytes;
            }
        }
        Ok(total)
    }

    fn is_too_old(&self, kept: &Kept) -> bool {
        let oldest = self.longest.and_then(|longest| self.clock.now().checked_sub(longest));
        oldest.is_some_and(|oldest| kept.used < oldest)
    }

    /// Removes an entry if that is possible. One failure does not protect the other entries.
    fn remove_entry(&self, kept: &Kept, bakes: &impl BakeKeeper) -> bool {
        let name = kept.name();
        let removed = if kept.is_bake { bakes.remove(&name) } else { self.remove_asset(&kept.path).map(|()| true) };
        removed.unwrap_or_else(|error| {
            warn!(path = %kept.path.display(), %error, "an entry over the limits could not be removed");
            false
        })
    }
}

impl Kept {
    /// A line of the log that it was removed, and why.
    fn log(&self, account: &Account, reason: &str) {
        let Account { project, caller } = account;
        let kind = if self.is_bake { "bake" } else { "asset" };
        info!(kind, name = self.name(), owner = caller, project, bytes = self.bytes, reason, "evicted");
    }
}
