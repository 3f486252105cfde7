//! A bake of the server: its state, and waiting for changes of it.

use crate::accounts::Account;
use crate::status::status_of;
use cairn_wire::proto::{BakeState, BakeStatus, Failure};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// Creation time in seconds and nanoseconds, and id: the sort key of lists, latest first.
pub type ListPosition = (i64, i32, String);

/// One bake.
pub struct Entry {
    pub position: ListPosition,
    pub(super) state: watch::Sender<EntryState>,
    pub(super) cancelled: CancellationToken,
    /// The latest deadline of its callers; `None` if a caller has none.
    deadline: Mutex<Option<Instant>>,
    /// Held while its result is made in a further format.
    pub(super) export: tokio::sync::Mutex<()>,
    /// Held while its status is saved, so that the last one is the latest.
    saving: Mutex<()>,
}

/// The state of a bake.
#[derive(Clone)]
pub struct EntryState {
    /// Without the summary of an ended bake, which is on disk to save memory ([`super::Bakes::status`]), unless it
    /// could not be written.
    pub status: BakeStatus,
    /// Size of the result of a bake that has succeeded.
    pub(super) result_bytes: i64,
    /// Size of all that is kept of a bake that has ended: events, pile, and results of all formats.
    pub(super) stored_bytes: u64,
    /// Readable bytes of the event log.
    pub log_bytes: u64,
    /// The request was accepted: the bake has an id, a folder and a log.
    pub accepted: bool,
}

impl EntryState {
    pub(super) fn of(status: BakeStatus) -> EntryState {
        EntryState { status, result_bytes: 0, stored_bytes: 0, log_bytes: 0, accepted: false }
    }

    /// Who pays for its bytes: the owner while it wants it, otherwise the first of those who do.
    pub(super) fn payer(&self) -> Account {
        let BakeStatus { owner, callers, project, .. } = &self.status;
        let is_wanted = callers.iter().any(|known| known.name == *owner);
        let payer = callers.first().filter(|_| !is_wanted).map_or(owner, |other| &other.name);
        Account::new(project, payer)
    }

    /// What it takes in the store.
    pub(super) fn bytes(&self) -> u64 {
        self.stored_bytes.max(self.status.event_bytes.unsigned_abs())
    }

    pub fn has_ended(&self) -> bool {
        matches!(self.status.state(), BakeState::Succeeded | BakeState::Failed | BakeState::Cancelled)
    }
}

impl Entry {
    pub(super) fn new(state: EntryState, deadline: Option<Instant>) -> Arc<Entry> {
        let time = state.status.create_time.unwrap_or_default();
        let position = (time.seconds, time.nanos, state.status.bake_id.clone());
        let (state, _) = watch::channel(state);
        Arc::new(Entry {
            position,
            state,
            cancelled: CancellationToken::new(),
            deadline: Mutex::new(deadline),
            export: tokio::sync::Mutex::default(),
            saving: Mutex::default(),
        })
    }

    /// Keeps others from saving its status.
    pub(super) fn saving(&self) -> MutexGuard<'_, ()> {
        self.saving.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds the deadline of another caller.
    pub(super) fn extend_deadline(&self, deadline: Option<Instant>) {
        let mut own = self.deadline.lock().unwrap_or_else(PoisonError::into_inner);
        *own = own.zip(deadline).map(|(a, b)| a.max(b));
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        *self.deadline.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn state(&self) -> watch::Ref<'_, EntryState> {
        self.state.borrow()
    }

    pub fn watch(&self) -> watch::Receiver<EntryState> {
        self.state.subscribe()
    }

    pub fn id(&self) -> String {
        self.position.2.clone()
    }

    /// Waits until the request is accepted or refused.
    pub async fn wait_accepted(&self) -> Result<(), tonic::Status> {
        self.accepted().await.map_err(|failure| status_of(&failure))
    }

    /// Waits until the request is accepted, or gives the reason why it is refused.
    pub async fn accepted(&self) -> Result<(), Failure> {
        let mut now = self.watch();
        // The sender is ours.
        let Ok(now) = now.wait_for(|now| now.accepted || now.has_ended()).await else { return Ok(()) };
        match &now.status.failure {
            Some(failure) if !now.accepted => Err(failure.clone()),
            _ => Ok(()),
        }
    }

    pub(super) async fn wait_ended(&self) {
        let _ = self.watch().wait_for(EntryState::has_ended).await;
    }
}
