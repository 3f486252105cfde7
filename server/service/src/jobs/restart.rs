//! The end of a server and the start of the next: bakes are drained, and those of an earlier server restored.

use super::{Bakes, Entry, EntryState, end_with};
use crate::config::Unfinished;
use crate::event_log::LogReader;
use crate::status::Fault;
use cairn_export::Format;
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{Accepted, BakeState};
use cairn_wire::versions::versions;
use std::path::Path;
use std::sync::Arc;
use tokio::time::Instant;
use tracing::{info, warn};

impl Bakes {
    /// Restores the bakes of an earlier server: finished bakes as they are, unfinished ones as configured.
    pub fn restore(self: &Arc<Self>) -> std::io::Result<()> {
        let mut found = self.store.load()?;
        found.sort_by_key(|status| status.create_time.map(|time| (time.seconds, time.nanos)));
        for mut status in found {
            let id = status.bake_id.clone();
            let result_bytes = status.summary.as_ref().map_or(0, |summary| summary.result_bytes);
            if let Some(damage) = self.store.damage(&status, result_bytes)? {
                warn!(bake_id = %id, damage, "a bake is damaged; the next request bakes it again");
                end_with(&mut status, BakeState::Failed, Some(&Fault::BakeDamaged(damage)));
                self.save_status(&status);
            }
            if let Ok(spec) = self.store.spec(&id) {
                status.set_format(Format::from_wire(spec.format()).wire());
            }
            let was_unfinished = matches!(status.state(), BakeState::Queued | BakeState::Running);
            if was_unfinished && self.config.unfinished == Unfinished::Fail {
                end_with(&mut status, BakeState::Failed, Some(&Fault::ServerRestarted));
                self.save_status(&status);
            }
            let resume = was_unfinished && self.config.unfinished == Unfinished::Restart;
            if resume {
                // Its log is written again; the old one must not be read.
                (status.event_bytes, status.last_sequence_number) = (0, 0);
            } else {
                self.store.tidy(&status);
            }
            let log_bytes = u64::try_from(status.event_bytes).unwrap_or(0);
            status.summary = None;
            let stored_bytes = if resume { 0 } else { self.store.bake_bytes(&id) };
            let state = EntryState { log_bytes, accepted: true, result_bytes, stored_bytes, ..EntryState::of(status) };
            let entry = Entry::new(state, None);
            self.entries().insert(id.clone(), entry.clone());
            if resume {
                info!(bake_id = %id, "resuming an unfinished bake");
                self.spawn(entry, None);
            }
        }
        Ok(())
    }

    /// Whether a bake runs or waits.
    pub fn are_at_work(&self) -> bool {
        !self.tasks.is_empty()
    }

    /// Accepts no more bakes, lets running ones finish until then, and stops the others. They stay unfinished on disk.
    pub async fn drain(&self, until: Instant) {
        self.draining.cancel();
        self.tasks.close();
        if tokio::time::timeout_at(until, self.tasks.wait()).await.is_err() {
            warn!("stopping unfinished bakes");
        }
        self.ending.cancel();
        self.tasks.wait().await;
    }
}

/// The first event of a bake that an earlier server accepted.
pub(super) async fn accepted_before(log: &Path) -> Option<Accepted> {
    let bytes = tokio::fs::metadata(log).await.ok()?.len();
    let event = LogReader::open(log).await.ok()?.next(bytes).await.ok()??;
    match event.kind? {
        Kind::Accepted(accepted) if accepted.versions == Some(versions()) => Some(*accepted),
        // Another version would bake another result.
        _ => None,
    }
}
