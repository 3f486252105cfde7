//! The bakes of a server: admission, state and end. Long: all that changes the entries is under one lock.
//!
//! Each bake has one entry, however many callers it has. The entry's task holds its permit, and later its worker slot,
//! until the worker process has ended.

mod analysis;
mod entry;
mod submission;
mod task;

use crate::access::{Caller, CallerRole};
use crate::config::{Config, Unfinished};
use crate::event_log;
use crate::folder::{EARLIER_PILE, PILE, ResultKind};
use crate::hook::Hook;
use crate::metrics::METRICS;
use crate::process::{Worker, WorkerTask};
use crate::quotas::Quota;
use crate::scheduler::Scheduler;
use crate::status::Fault;
use crate::store::Store;
use crate::worker_message::{ResultHead, WorkerMessage};
pub use analysis::NewAnalysis;
use cairn_export::{Format, Layout, is_asset_folder};
use cairn_wire::proto::{
    self, BakeSpec, BakeState, BakeStatus, DownloadResultRequest, DownloadResultResponse, FieldProblem, Summary,
    UsdLayout,
};
use cairn_wire::to_proto::signed;
use cairn_wire::versions::versions;
pub use entry::{Entry, EntryState, ListPosition};
use prost::Message;
use prost_types::Timestamp;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};
use submission::set_accuracy;
pub use submission::{BakeSubmission, bake_id};
use task::NewBake;
use tokio::sync::Notify;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{info, warn};

/// Failed and cancelled bakes that are kept for callers to query.
const MOST_WITHOUT_RESULT: usize = 1000;

/// All bakes of a server.
pub struct Bakes {
    pub config: Config,
    pub store: Store,
    hook: Option<Hook>,
    entries: Mutex<BTreeMap<String, Arc<Entry>>>,
    /// Running and waiting bakes.
    bake_quota: Quota,
    /// Running bakes.
    scheduler: Arc<Scheduler>,
    /// Running and waiting plans.
    plan_quota: Quota,
    /// Running plans: twice as many as running bakes, so that no caller can hold them all.
    planner_quota: Quota,
    /// Cancelled when the server accepts no more bakes.
    draining: CancellationToken,
    /// Cancelled when running bakes have to stop unfinished.
    ending: CancellationToken,
    tasks: TaskTracker,
    trim: Notify,
    /// Duration of the last bake, as an estimate of when a permit will be free.
    last_time: Mutex<Duration>,
}

impl Bakes {
    pub fn new(config: Config, store: Store, hook: Option<Hook>) -> Arc<Bakes> {
        let workers = config.workers();
        let places = workers.saturating_add(config.queue);
        Arc::new(Bakes {
            config,
            store,
            hook,
            entries: Mutex::default(),
            bake_quota: Quota::new(places, places - places / 4),
            scheduler: Scheduler::new(workers),
            plan_quota: Quota::new(places, places.div_ceil(2)),
            planner_quota: Quota::new(2 * workers, workers),
            draining: CancellationToken::new(),
            ending: CancellationToken::new(),
            tasks: TaskTracker::new(),
            trim: Notify::new(),
            last_time: Mutex::new(Duration::from_secs(1)),
        })
    }

    fn entries(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Entry>>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Restores the bakes of an earlier server: finished bakes as they are, unfinished ones as configured.
    pub fn restore(self: &Arc<Self>) -> std::io::Result<()> {
        let mut found = self.store.load()?;
        found.sort_by_key(|status| status.create_time.map(|time| (time.seconds, time.nanos)));
        for mut status in found {
            let id = status.bake_id.clone();
            let result_bytes = status.summary.as_ref().map_or(0, |summary| summary.result_bytes);
            if let Some(damage) = self.store.damage(&status, result_bytes) {
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
            self.check_files(entry);
            let state = entry.state.borrow().status.state();
            if !matches!(state, BakeState::Failed | BakeState::Cancelled) && !entry.cancelled.is_cancelled() {
                entry.extend_deadline(deadline);
                let mut is_new = false;
                entry.state.send_modify(|now| is_new = add_caller(&mut now.status, caller, labels));
                if is_new {
                    self.save_callers(entry);
                }
                METRICS.bakes_shared.inc();
                return Ok(entry.clone());
            }
            if !entry.state.borrow().has_ended() {
                // It was just cancelled, and its folder is still in use.
                return Err(Fault::QueueFull { retry: Duration::from_secs(1) });
            }
        }
        self.accepts_work()?;
        submission::within_limits(caller, self.config.workers(), entries.values())?;
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

    /// Marks a bake as damaged if the sizes of its files have changed.
    fn check_files(&self, entry: &Entry) {
        let damage = {
            let now = entry.state.borrow();
            self.store.damage(&now.status, now.result_bytes)
        };
        if let Some(damage) = damage {
            self.mark_damaged(entry, damage);
        }
    }

    /// Marks a bake as damaged: the next request for it bakes again.
    pub fn mark_damaged(&self, entry: &Entry, damage: String) -> Fault {
        let fault = Fault::BakeDamaged(damage);
        let mut status = entry.state.borrow().status.clone();
        if status.state() == BakeState::Succeeded {
            warn!(bake_id = %status.bake_id, %fault, "a bake is damaged");
            end_with(&mut status, BakeState::Failed, Some(&fault));
            status.summary = None;
            self.save_status(&status);
            entry.state.send_modify(|now| (now.status, now.result_bytes) = (status, 0));
        }
        fault
    }

    /// The status of a bake, with its summary if it has succeeded.
    pub fn status(&self, entry: &Entry) -> Result<BakeStatus, Fault> {
        let status = entry.state.borrow().status.clone();
        if status.state() != BakeState::Succeeded || status.summary.is_some() {
            return Ok(status);
        }
        let kept = self.store.status(&status.bake_id)?;
        let kept = kept.ok_or_else(|| self.mark_damaged(entry, "its summary is truncated or missing".into()))?;
        Ok(BakeStatus { summary: kept.summary, ..status })
    }

    /// Saves who wants a bake. The summary of one that has ended is only on disk, and stays.
    fn save_callers(&self, entry: &Entry) {
        if entry.state.borrow().accepted
            && let Ok(status) = self.status(entry)
        {
            self.save_status(&status);
        }
    }

    /// Saves the status of a bake. If that fails, the next server repeats what this one found.
    fn save_status(&self, status: &BakeStatus) {
        if let Err(error) = self.store.write_status(status) {
            warn!(bake_id = %status.bake_id, %error, "the status of a bake could not be saved");
        }
    }

    fn queue_full(&self) -> Fault {
        let last = *self.last_time.lock().unwrap_or_else(PoisonError::into_inner);
        Fault::QueueFull { retry: last.clamp(Duration::from_secs(1), Duration::from_secs(60)) }
    }

    /// The submission with a preset in the place of the accuracy `auto`: the one that its goal calls for on this
    /// machine. From here on, it is the bake of that preset.
    pub async fn with_preset(&self, caller: &Caller, mut submission: BakeSubmission) -> Result<BakeSubmission, Fault> {
        if let Some(scene) = &submission.spec.scene
            && scene.accuracy() == proto::Accuracy::Auto
        {
            let plan = self.plan(caller, submission.spec.clone()).await?;
            set_accuracy(&mut submission.spec, plan.effective_scene.as_ref());
        }
        Ok(submission)
    }

    /// Plans a bake without running it.
    pub async fn plan(&self, caller: &Caller, mut spec: BakeSpec) -> Result<proto::PlanBakeResponse, Fault> {
        self.accepts_work()?;
        let _permit = self.plan_quota.try_acquire(caller).ok_or_else(|| self.queue_full())?;
        let _planner = self.planner_quota.acquire(caller).await;
        let folder = self.store.prepare_plan(&spec, caller.project())?;
        let mut worker = None;
        let accepted = self.run_plan(WorkerTask::Plan, folder.path(), &mut worker).await?;
        set_accuracy(&mut spec, accepted.effective_scene.as_ref());
        Ok(proto::PlanBakeResponse {
            bake_id: bake_id(&spec, caller.project()),
            plan: accepted.plan,
            effective_scene: accepted.effective_scene,
            has_parameters_only: accepted.has_parameters_only,
        })
    }

    /// The result of a bake in a format, and in this layout if one is given that is not that of the bake's request.
    pub fn result_kind(
        &self,
        entry: &Entry,
        format: Format,
        usd: Option<UsdLayout>,
        asset_folder: String,
    ) -> Result<ResultKind, Fault> {
        let own = ResultKind::of(format);
        if !format.is_usd() {
            return Ok(own);
        }
        if let Err(problems) = usd.as_ref().map_or(Ok(Layout::default()), Layout::new) {
            let fields = problems
                .into_iter()
                .map(|problem| FieldProblem { description: problem.to_string(), field: problem.field });
            return Err(Fault::RequestInvalid(fields.collect()));
        }
        if !is_asset_folder(&asset_folder) {
            return Err(Fault::field("asset_folder", "it cannot stand in an asset path; give a folder"));
        }
        let id = entry.id();
        let asked = self.store.spec(&id)?.scene.and_then(|scene| scene.usd).unwrap_or_default();
        let usd = usd.unwrap_or_else(|| asked.clone());
        if asked == usd && asset_folder.is_empty() {
            return Ok(own);
        }
        /// Digits that distinguish the few layouts of a bake.
        const DIGITS: usize = 16;
        let request = DownloadResultRequest { usd: Some(usd), asset_folder, ..Default::default() }.encode_to_vec();
        let layout = blake3::hash(&request).to_hex()[..DIGITS].to_owned();
        if !self.store.keep_layout(&id, &layout, &request)? {
            let what = "results of this bake were laid out in too many ways; delete the bake and request it again";
            return Err(Fault::field("usd", what));
        }
        Ok(ResultKind { format, layout: Some(layout) })
    }

    /// Describes a finished bake's result. If it was not made before, a worker makes it now.
    pub async fn result(&self, caller: &Caller, entry: &Entry, kind: &ResultKind) -> Result<ResultHead, Fault> {
        /// A result is written in seconds; only a huge one takes longer.
        const LONGEST: Duration = Duration::from_secs(600);
        let _alone = entry.export.lock().await;
        let id = entry.id();
        if let Some(head) = self.store.head(&id, kind)? {
            return Ok(head);
        }
        let status = self.status(entry)?;
        let folder = self.store.folder(&id);
        let own = Format::from_wire(status.format());
        if ResultKind::of(own) == *kind {
            let Summary { result_bytes, result_sha256, report_sha256, .. } = status.summary.unwrap_or_default();
            // Its server did not describe it.
            return Ok(ResultHead {
                result: DownloadResultResponse {
                    size_bytes: result_bytes,
                    sha256: result_sha256,
                    ..Default::default()
                },
                report: DownloadResultResponse { sha256: report_sha256, ..Default::default() },
            });
        }
        if ![PILE, EARLIER_PILE].iter().any(|name| folder.join(name).is_file()) {
            let (own, wanted) = (own.extension(), kind.format.extension());
            let what =
                format!("an earlier server made this bake: its result is .{own} alone; bake it again for .{wanted}");
            return Err(Fault::FormatUnavailable(what));
        }
        let _permit = self.plan_quota.try_acquire(caller).ok_or_else(|| self.queue_full())?;
        let _planner = self.planner_quota.acquire(caller).await;
        let mut worker = self.start_worker(WorkerTask::Export(kind.clone()), &folder)?;
        let message = tokio::time::timeout(LONGEST, worker.next()).await;
        self.request_trim();
        let stored_bytes = self.store.bake_bytes(&id);
        entry.state.send_modify(|now| now.stored_bytes = stored_bytes);
        match message.map_err(|_| Fault::TimeLimit(LONGEST.as_secs()))?? {
            Some(WorkerMessage::Exported(head)) => Ok(head),
            Some(WorkerMessage::Invalid(invalid)) => Err(Fault::SceneInvalid(invalid.problems)),
            Some(_) => Err(Fault::Internal("the worker did not export".into())),
            None => Err(worker.fault().await),
        }
    }

    /// Starts a worker with its share of the cores.
    fn start_worker(&self, task: WorkerTask, folder: &std::path::Path) -> Result<Worker, Fault> {
        // All others hold a permit of their own.
        let is_beside = matches!(task, WorkerTask::Plan | WorkerTask::Export(_));
        let bakes = self.bake_quota.held() + usize::from(is_beside);
        Worker::start(&self.config, task, folder, self.config.threads_among(bakes))
    }

    /// Lets a worker plan. `slot` receives the process, so that the caller can wait for its end.
    async fn run_plan(
        &self,
        task: WorkerTask,
        folder: &std::path::Path,
        slot: &mut Option<Worker>,
    ) -> Result<proto::Accepted, Fault> {
        /// A plan reads files and measures meshes; only hostile input takes longer.
        const LONGEST: Duration = Duration::from_secs(120);
        let worker = slot.insert(self.start_worker(task, folder)?);
        let message = tokio::time::timeout(LONGEST, worker.next()).await;
        match message.map_err(|_| Fault::TimeLimit(LONGEST.as_secs()))?? {
            Some(WorkerMessage::Planned(accepted)) => Ok(*accepted),
            Some(WorkerMessage::Invalid(invalid)) if invalid.only_missing => {
                Err(Fault::AssetsMissing(invalid.problems))
            }
            Some(WorkerMessage::Invalid(invalid)) => Err(Fault::SceneInvalid(invalid.problems)),

            Some(_) => Err(Fault::Internal("the worker did not plan".into())),
            None => Err(slot.take().expect("it was started").fault().await),
        }
    }

    /// An accepted bake that a caller sees, by its id or the beginning of it. Those of other projects are as if there
    /// were none.
    pub fn find(&self, caller: &Caller, id: &str) -> Result<Arc<Entry>, Fault> {
        /// Digits of an id, and the fewest of them that a caller may name.
        const DIGITS: std::ops::RangeInclusive<usize> = 6..=64;
        let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        if !(DIGITS.contains(&id.len()) && id.bytes().all(is_digit)) {
            let what =
                "not the id of a bake; give its 64 lower-case hexadecimal digits, or the first 6 or more of them";
            return Err(Fault::field("bake_id", what));
        }
        let entries = self.entries();
        let mut found = entries.range(id.to_owned()..).take_while(|(known, _)| known.starts_with(id));
        let is_seen = |now: &EntryState| now.accepted && caller.sees(&now.status.project);
        let mut found = found.by_ref().filter(|(_, entry)| is_seen(&entry.state.borrow())).map(|(_, entry)| entry);
        match (found.next(), found.next()) {
            (Some(entry), None) => Ok(entry.clone()),
            (Some(_), Some(_)) => {
                Err(Fault::field("bake_id", format!("several bakes begin with {id}; give more of it")))
            }
            (None, _) => Err(Fault::BakeNotFound(id.into())),
        }
    }

    /// Whether a bake is still there.
    pub fn knows(&self, id: &str) -> bool {
        self.entries().get(id).is_some_and(|entry| entry.state.borrow().accepted)
    }

    /// All accepted bakes that a caller sees, latest first.
    pub fn seen(&self, caller: &Caller) -> Vec<Arc<Entry>> {
        let mut list = self.list();
        list.retain(|entry| caller.sees(&entry.state.borrow().status.project));
        list
    }

    /// All accepted bakes, latest first.
    fn list(&self) -> Vec<Arc<Entry>> {
        let entries = self.entries();
        let mut list: Vec<_> = entries.values().filter(|entry| entry.state.borrow().accepted).cloned().collect();
        drop(entries);
        list.sort_by(|a, b| b.position.cmp(&a.position));
        list
    }

    /// Withdraws a caller's interest in a bake. Without any left, or if an operator asks, the bake is cancelled; this
    /// waits for its end.
    pub async fn cancel(&self, caller: &Caller, id: &str) -> Result<BakeStatus, Fault> {
        let entry = self.find(caller, id)?;
        if self.withdraw(caller, &entry)? {
            entry.cancelled.cancel();
            entry.wait_ended().await;
        }
        self.status(&entry)
    }

    /// Takes a caller out of those that want a bake. Returns whether it is to end.
    fn withdraw(&self, caller: &Caller, entry: &Entry) -> Result<bool, Fault> {
        let status = entry.state.borrow().status.clone();
        let is_known = status.owner == *caller.name || status.callers.iter().any(|known| known.name == *caller.name);
        if !is_known && !caller.is_operator() {
            return Err(Fault::NotYours(status.owner));
        }
        let others = status.callers.iter().any(|known| known.name != *caller.name);
        let leaves_it_to_others = match caller.role {
            CallerRole::Artist => others,
            CallerRole::Operator => false,
            CallerRole::Anybody => others && status.callers.iter().any(|known| known.name == *caller.name),
        };
        if !leaves_it_to_others {
            return Ok(true);
        }
        entry.state.send_modify(|now| now.status.callers.retain(|known| known.name != *caller.name));
        self.save_callers(entry);
        Ok(false)
    }

    /// Cancels a bake and removes its files, unless others want it.
    pub async fn delete(&self, caller: &Caller, id: &str) -> Result<(), Fault> {
        let entry = self.find(caller, id)?;
        if self.withdraw(caller, &entry)? {
            entry.cancelled.cancel();
            entry.wait_ended().await;
            self.remove_ended(&entry.id())?;
        }
        Ok(())
    }

    /// Removes a bake unless it is unfinished. The lock keeps new callers away meanwhile. Returns whether it is gone.
    fn remove_ended(&self, id: &str) -> std::io::Result<bool> {
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

    /// How many bakes wait for a worker, and for how long the oldest has.
    pub fn waiting(&self) -> (usize, Duration) {
        let entries = self.entries();
        let waiting = entries.values().filter(|entry| entry.state.borrow().status.state() == BakeState::Queued);
        let now = now();
        let since = |entry: &Arc<Entry>| u64::try_from(now.seconds - entry.position.0).unwrap_or(0);
        let all: Vec<u64> = waiting.map(since).collect();
        (all.len(), Duration::from_secs(all.into_iter().max().unwrap_or(0)))
    }

    /// Whether a bake runs or waits.
    pub fn are_at_work(&self) -> bool {
        !self.tasks.is_empty()
    }

    /// Refuses new work once the server is shutting down.
    pub fn accepts_work(&self) -> Result<(), Fault> {
        if self.draining.is_cancelled() { Err(Fault::ShuttingDown) } else { Ok(()) }
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

fn now() -> Timestamp {
    Timestamp::from(SystemTime::now())
}

/// Adds a caller, or its new labels. Returns whether that changes anything.
fn add_caller(status: &mut BakeStatus, caller: &Caller, labels: BTreeMap<String, String>) -> bool {
    let new = proto::BakeCaller { name: caller.name.to_string(), labels };
    if status.callers.contains(&new) {
        return false;
    }
    status.callers.retain(|known| known.name != new.name);
    status.callers.push(new);
    true
}

fn end_with(status: &mut BakeStatus, state: BakeState, fault: Option<&Fault>) {
    status.set_state(state);
    status.end_time = Some(now());
    status.failure = fault.map(proto::Failure::from);
}

/// The first event of a bake that an earlier server accepted.
async fn accepted_before(log: &std::path::Path) -> Option<proto::Accepted> {
    let bytes = tokio::fs::metadata(log).await.ok()?.len();
    let event = event_log::LogReader::open(log).await.ok()?.next(bytes).await.ok()??;
    match event.kind? {
        proto::bake_event::Kind::Accepted(accepted) if accepted.versions == Some(versions()) => Some(*accepted),
        // Another version would bake another result.
        _ => None,
    }
}
