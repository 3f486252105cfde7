//! Bakes that are removed: those that callers delete, old ones, and those above the limits of the store.

use super::Bakes;
use crate::metrics::METRICS;
use cairn_wire::proto::BakeState;
use cairn_wire::to_proto::signed;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::Instant;
use tracing::warn;

/// Failed and cancelled bakes that are kept for callers to query.
const MOST_WITHOUT_RESULT: usize = 1000;

impl Bakes {
    /// Removes a bake unless it is unfinished. The lock keeps new callers away meanwhile. Returns whether it is gone.
    pub(super) fn remove_ended(&self, id: &str) -> std::io::Result<bool> {
        let mut entries = self.entries();
        let is_at_work = entries.get(id).is_some_and(|entry| !entry.state.borrow().has_ended());
        if !is_at_work {
            // If this fails, the entry stays for another attempt.
            self.store.remove(id)?;
            entries.remove(id);
        }
        Ok(!is_at_work)
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
            if let Err(error) = self.remove_ended(&entry.id()) {
                warn!(bake_id = %entry.id(), %error, "an old bake could not be removed");
            }
        }
    }

    /// Keeps the store within its limits, for as long as the server runs.
    pub async fn keep_limits(self: Arc<Self>) {
        /// Interval of checks while nothing is added: files also become too old.
        const PAUSE: Duration = Duration::from_secs(600);
        /// A check of a large store takes long; the pause after it is this many times as long.
        const LEFT_ALONE: u32 = 20;
        loop {
            let (bakes, began) = (self.clone(), Instant::now());
            let trim = move || {
                bakes.forget_old();
                bakes.store.trim(|id| bakes.remove_ended(id))
            };
            let trimmed = tokio::task::spawn_blocking(trim).await;
            match trimmed {
                Ok(Ok(bytes)) => METRICS.store_bytes.set(signed(bytes)),
                Ok(Err(error)) => warn!(%error, "the store could not be trimmed"),
                Err(error) => warn!(%error, "the store could not be trimmed"),
            }
            tokio::time::sleep(began.elapsed() * LEFT_ALONE).await;
            let _ = tokio::time::timeout(PAUSE, self.trim.notified()).await;
        }
    }
}
