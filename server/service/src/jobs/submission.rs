//! Requests for bakes: their id, and the bake that each gets, which may be one of before.

use super::limits::within_limits;
use super::task::NewBake;
use super::{Bakes, Entry, EntryState, now};
use crate::access::Caller;
use crate::metrics::METRICS;
use crate::status::Fault;
use cairn_export::Format;
use cairn_job::request;
use cairn_wire::effective::effective;
use cairn_wire::from_proto;
use cairn_wire::proto::{Accuracy, BakeCaller, BakeSpec, BakeState, BakeStatus, Scene};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::Instant;

/// A request for a bake.
pub struct BakeSubmission {
    pub spec: BakeSpec,
    pub labels: BTreeMap<String, String>,
    pub priority: i32,
}

impl Bakes {
    /// The bake of this request: an existing one, or a new one if the quotas permit.
    pub fn submit(
        self: &Arc<Self>,
        caller: &Caller,
        submission: BakeSubmission,
        deadline: Option<Instant>,
    ) -> Result<Arc<Entry>, Fault> {
        let BakeSubmission { spec, labels, priority } = submission;
        let id = bake_id(&spec, caller.project());
        let mut entries = self.entries();
        if let Some(entry) = entries.get(&id) {
            self.check_files(entry)?;
            let state = entry.state.borrow().status.state();
            if !matches!(state, BakeState::Failed | BakeState::Cancelled) && !entry.cancelled.is_cancelled() {
                entry.extend_deadline(deadline);
                let mut is_new = false;
                entry.state.send_modify(|now| is_new = add_caller(&mut now.status, caller, labels));
                let entry = entry.clone();
                // Others need not wait until it is saved.
                drop(entries);
                if is_new {
                    self.save_callers(&entry);
                }
                METRICS.bakes_shared.inc();
                return Ok(entry);
            }
            if !entry.state.borrow().has_ended() {
                // It was just cancelled, and its folder is still in use.
                return Err(Fault::QueueFull { retry: Duration::from_secs(1) });
            }
        }
        self.accepts_work()?;
        within_limits(caller, self.config.workers(), entries.values(), &self.store.owners)?;
        let Some(permit) = self.bake_quota.try_acquire(caller) else {
            METRICS.bakes_refused.inc();
            return Err(self.queue_full());
        };
        let mut status = BakeStatus {
            bake_id: id.clone(),
            create_time: Some(now()),
            owner: caller.name.to_string(),
            project: caller.project().to_owned(),
            labels: labels.clone(),
            priority,
            ..Default::default()
        };
        status.set_format(Format::from_wire(spec.format()).wire());
        add_caller(&mut status, caller, labels);
        status.set_state(BakeState::Queued);
        let entry = Entry::new(EntryState::of(status), deadline);
        entries.insert(id, entry.clone());
        self.spawn(entry.clone(), Some(NewBake { spec, caller: caller.clone(), permit }));
        Ok(entry)
    }

    /// The submission with a preset in the place of the accuracy `auto`: the one that its goal calls for on this
    /// machine. From here on, it is the bake of that preset.
    pub async fn with_preset(&self, caller: &Caller, mut submission: BakeSubmission) -> Result<BakeSubmission, Fault> {
        if let Some(scene) = &submission.spec.scene
            && scene.accuracy() == Accuracy::Auto
        {
            let plan = self.plan(caller, submission.spec.clone()).await?;
            set_accuracy(&mut submission.spec, plan.effective_scene.as_ref());
        }
        Ok(submission)
    }
}

/// Adds a caller, or its new labels. Returns whether that changes anything.
fn add_caller(status: &mut BakeStatus, caller: &Caller, labels: BTreeMap<String, String>) -> bool {
    let new = BakeCaller { name: caller.name.to_string(), labels };
    if status.callers.contains(&new) {
        return false;
    }
    status.callers.retain(|known| known.name != new.name);
    status.callers.push(new);
    true
}

/// Puts the preset of the effective scene in the place of the accuracy `auto`.
pub(super) fn set_accuracy(spec: &mut BakeSpec, effective: Option<&Scene>) {
    if let (Some(scene), Some(effective)) = (&mut spec.scene, effective) {
        scene.accuracy = effective.accuracy;
    }
}

/// The id of a bake: a hash of everything that its pile depends on, and of the project, so that no project meets the
/// bakes of another one.
pub fn bake_id(spec: &BakeSpec, project: &str) -> String {
    let mut spec = spec.clone();
    spec.assets.sort_by(|a, b| a.uri.cmp(&b.uri));
    // An unset field and one set to its default give the same id.
    if let Some(scene) = &spec.scene
        && let Ok(params) = from_proto::params(scene)
    {
        spec.scene = Some(effective(scene, &params));
    }
    let hash = request::hash(&spec);
    let id = if project.is_empty() { hash } else { blake3::keyed_hash(hash.as_bytes(), project.as_bytes()) };
    id.to_hex().to_string()
}
