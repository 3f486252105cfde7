//! One bake among those of a server: how it stands, and who waits for that.

use crate::wire::proto::{BakeState, BakeStatus};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// When a bake was asked for, in seconds and nanoseconds, and its id: the order of lists, the latest first.
pub type Place = (i64, i32, String);

/// One bake.
pub struct Entry {
    pub place: Place,
    pub(super) now: watch::Sender<Now>,
    pub(super) cancelled: CancellationToken,
    /// The latest of its callers' deadlines; `None` if one of them has none.
    deadline: Mutex<Option<Instant>>,
}

/// How a bake stands.
#[derive(Clone)]
pub struct Now {
    /// A server keeps thousands of bakes: the summary of one that has ended is on the disk, and here only where the disk did not take
    /// it ([`super::Bakes::status`]).
    pub status: BakeStatus,
    /// Of the result of a bake that has succeeded.
    pub(super) result_bytes: i64,
    /// Bytes of the event log that may be read.
    pub log_bytes: u64,
    /// Its request was found right: it has an id, a folder and a log.
    pub accepted: bool,
}

impl Now {
    pub(super) fn of(status: BakeStatus) -> Now {
        Now { status, result_bytes: 0, log_bytes: 0, accepted: false }
    }

    pub fn has_ended(&self) -> bool {
        matches!(self.status.state(), BakeState::Succeeded | BakeState::Failed | BakeState::Cancelled)
    }
}

impl Entry {
    pub(super) fn new(now: Now, deadline: Option<Instant>) -> Arc<Entry> {
        let time = now.status.create_time.unwrap_or_default();
        let place = (time.seconds, time.nanos, now.status.bake_id.clone());
        let (now, _) = watch::channel(now);
        Arc::new(Entry { place, now, cancelled: CancellationToken::new(), deadline: Mutex::new(deadline) })
    }

    /// Another caller waits for it, with a deadline of its own.
    pub(super) fn put_off(&self, deadline: Option<Instant>) {
        let mut own = self.deadline.lock().unwrap_or_else(PoisonError::into_inner);
        *own = own.zip(deadline).map(|(a, b)| a.max(b));
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        *self.deadline.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn now(&self) -> watch::Ref<'_, Now> {
        self.now.borrow()
    }

    pub fn watch(&self) -> watch::Receiver<Now> {
        self.now.subscribe()
    }

    pub fn id(&self) -> String {
        self.place.2.clone()
    }

    /// Waits until the request was found right, or not.
    pub async fn accepted(&self) -> Result<(), tonic::Status> {
        let mut now = self.watch();
        // The sender is ours.
        let Ok(now) = now.wait_for(|now| now.accepted || now.has_ended()).await else { return Ok(()) };
        match &now.status.failure {
            Some(failure) if !now.accepted => Err(failure.into()),
            _ => Ok(()),
        }
    }

    pub(super) async fn ended(&self) {
        let _ = self.watch().wait_for(Now::has_ended).await;
    }
}
