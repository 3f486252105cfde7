//! Bakes that are removed: those that callers delete, old ones, and those above the limits of the store.

use super::{Bakes, Entry};
use crate::access::CallerLimits;
use crate::accounts::Account;
use crate::heap;
use crate::metrics::METRICS;
use crate::store::BakeKeeper;
use cairn_wire::proto::BakeState;
use cairn_wire::to_proto::signed;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::Instant;
use tracing::{info, warn};

/// Failed and cancelled bakes that are kept for callers to query.
const MOST_WITHOUT_RESULT: usize = 1000;

impl Bakes {
    /// Removes a bake unless it is unfinished. The lock keeps new callers away meanwhile. Returns whether it is gone.
    pub(super) fn remove_ended(&self, id: &str) -> std::io::Result<bool> {
        let mut entries = self.entries();
        let is_at_work = entries.get(id).is_some_and(|entry| !entry.state.borrow().has_ended());
        if is_at_work {
            return Ok(false);
        }
        // If this fails, the entry stays for another attempt.
        let files = self.store.take_away(id)?;
        entries.remove(id);
        drop(entries);
        // Nobody waits for this.
        drop(files);
        Ok(true)
    }

    /// Requests a check of the store's limits, after an asset or a bake was added.
    pub fn request_trim(&self) {
        self.trim.notify_one();
    }

    /// Removes the oldest bakes without a result above [`MOST_WITHOUT_RESULT`].
    fn forget_old(&self) {
        let mut list = self.list();
        list.retain(|entry| matches!(entry.state().status.state(), BakeState::Failed | BakeState::Cancelled));
        list.drain(..list.len().min(MOST_WITHOUT_RESULT));
        for entry in list {
            match self.remove_ended(&entry.id()) {
                Ok(_) => info!(bake_id = %entry.id(), "evicted: an old bake without a result"),
                Err(error) => warn!(bake_id = %entry.id(), %error, "an old bake could not be removed"),
            }
        }
    }

    /// The limits of an account: of the caller, and of its project.
    fn limits_of(&self, account: &Account) -> [CallerLimits; 2] {
        let caller = self.caller(&account.caller, &account.project);
        [caller.limits, caller.project.map_or_else(CallerLimits::default, |project| project.limits)]
    }

    /// Keeps the store within its limits, for as long as the server runs.
    pub async fn keep_limits(self: Arc<Self>) {
        /// Interval of checks while nothing is added: files also become too old.
        const PAUSE: Duration = Duration::from_secs(600);
        /// What was in use during a check is free this much later.
        const SETTLED: Duration = Duration::from_secs(2);
        /// A check of a large store takes long; the pause after it is this many times as long.
        const LEFT_ALONE: u32 = 20;
        loop {
            let (bakes, began) = (self.clone(), Instant::now());
            let trim = move || {
                bakes.forget_old();
                let trimmed = bakes.store.trim(&*bakes, &|account| bakes.limits_of(account));
                heap::give_back();
                trimmed
            };
            let trimmed = tokio::task::spawn_blocking(trim).await;
            match trimmed {
                Ok(Ok(bytes)) => METRICS.store_bytes.set(signed(bytes)),
                Ok(Err(error)) => warn!(%error, "the store could not be trimmed"),
                Err(error) => warn!(%error, "the store could not be trimmed"),
            }
            tokio::time::sleep(began.elapsed() * LEFT_ALONE).await;
            if tokio::time::timeout(SETTLED, self.trim.notified()).await.is_ok() {
                continue;
            }
            let _ = tokio::task::spawn_blocking(heap::give_back).await;
            let _ = tokio::time::timeout(PAUSE, self.trim.notified()).await;
        }
    }
}

impl BakeKeeper for Bakes {
    fn account(&self, id: &str) -> Account {
        self.entry(id).map_or_else(Account::default, |entry| entry.state().payer())
    }

    fn is_shared(&self, id: &str) -> bool {
        self.entry(id).is_some_and(|entry| {
            let now = entry.state();
            let payer = now.payer().caller;
            now.status.callers.iter().any(|known| known.name != payer)
        })
    }

    fn remove(&self, id: &str) -> std::io::Result<bool> {
        self.remove_ended(id)
    }

    fn measured(&self, id: &str, bytes: u64) {
        if let Some(entry) = self.entry(id).filter(|entry| entry.state().stored_bytes != bytes) {
            // Nobody waits for this.
            entry.state.send_if_modified(|now| {
                now.stored_bytes = bytes;
                false
            });
        }
    }

    fn pass_on(&self, id: &str) -> bool {
        let Some(entry) = self.entry(id) else { return false };
        let payer = entry.state().payer().caller;
        entry.state.send_modify(|now| now.status.callers.retain(|known| known.name != payer));
        self.save_callers(&entry);
        true
    }
}

impl Bakes {
    fn entry(&self, id: &str) -> Option<Arc<Entry>> {
        self.entries().get(id).cloned()
    }
}
