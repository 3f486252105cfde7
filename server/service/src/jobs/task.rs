//! The task of a bake: plan, wait, run, end.

use super::restart::accepted_before;
use super::{Bakes, Entry, EntryState, bake_id, end_with, now};
use crate::access::Caller;
use crate::blocking::in_place;
use crate::event_log::{Extent, LogWriter};
use crate::folder::{ASSETS, EVENTS, write_scene};
use crate::metrics::METRICS;
use crate::process::{Worker, WorkerTask};
use crate::quotas::Permit;
use crate::status::Fault;
use crate::worker_message::WorkerMessage;
use cairn_files::failpoints;
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{Accepted, AssetReference, BakeCaller, BakeSpec, BakeState, Summary};
use cairn_wire::versions::versions;
use std::path::Path;
use std::sync::{Arc, PoisonError};
use std::time::Duration;
use tokio::time::Instant;
use tracing::{Instrument, info, info_span, warn};

/// A bake to be accepted.
pub(super) struct NewBake {
    pub spec: BakeSpec,
    pub caller: Caller,
    /// Counts it among the running and waiting bakes.
    pub permit: Permit,
}

/// Why a bake ends without a result.
enum EndReason {
    Fault(Fault),
    /// The server shuts down; the next one may resume the bake.
    Unfinished,
}

impl<E: Into<Fault>> From<E> for EndReason {
    fn from(error: E) -> EndReason {
        EndReason::Fault(error.into())
    }
}

impl Bakes {
    /// Starts the task of a bake: a new one, or one of an earlier server, whose request is on disk.
    pub(super) fn spawn(self: &Arc<Self>, entry: Arc<Entry>, new: Option<NewBake>) {
        let span = info_span!("bake", bake_id = %entry.id());
        let bakes = self.clone();
        let life = async move {
            METRICS.bakes_pending.inc();
            let _guard = EndGuard(&bakes, &entry);
            let mut worker = None;
            let result = tokio::select! {
                result = bakes.run(&entry, new, &mut worker) => result,
                end = bakes.stopped(&entry) => Err(end),
            };
            if let Some(mut worker) = worker {
                worker.kill().await;
            }
            in_place(|| bakes.finish(&entry, result));
            bakes.request_trim();
        };
        self.tasks.spawn(life.instrument(span));
    }

    /// Resolves when the bake has to stop early.
    async fn stopped(&self, entry: &Entry) -> EndReason {
        let passed = async {
            // The deadline may be extended meanwhile, but never moves closer.
            while let Some(at) = entry.deadline() {
                if at <= Instant::now() {
                    return;
                }
                tokio::time::sleep_until(at).await;
            }
            std::future::pending().await
        };
        tokio::select! {
            () = entry.cancelled.cancelled() => EndReason::Fault(Fault::BakeCancelled),
            () = passed => EndReason::Fault(Fault::Deadline),
            () = self.ending.cancelled() => EndReason::Unfinished,
        }
    }

    async fn run(&self, entry: &Entry, new: Option<NewBake>, slot: &mut Option<Worker>) -> Result<Summary, EndReason> {
        let id = entry.id();
        let folder = self.store.folder(&id);
        let (caller, priority) = match &new {
            Some(new) => (new.caller.clone(), entry.state.borrow().status.priority),
            None => {
                let now = entry.state.borrow();
                // With the limits that it has now.
                (self.caller(&now.status.owner, &now.status.project), now.status.priority)
            }
        };
        let (_permit, accepted) = match new {
            Some(NewBake { spec, caller, permit }) => {
                let accepted = self.accept(&id, &folder, &caller, &spec, slot).await?;
                (permit, accepted)
            }
            // A bake of an earlier server waits for its permit, because there is no caller to refuse it to.
            None => {
                let permit = self.bake_quota.acquire(&caller).await;
                let accepted = match accepted_before(&folder.join(EVENTS)).await {
                    Some(accepted) => accepted,
                    None => self.accept_again(&id, &folder, caller.project(), slot).await?,
                };
                (permit, accepted)
            }
        };
        // A power cut may take the event: the next server then makes it again.
        let first = || LogWriter::create(&folder.join(EVENTS), Kind::Accepted(Box::new(accepted)))?.flush();
        let extent = in_place(first)?;
        entry.state.send_modify(|now| {
            now.status.set_state(BakeState::Queued);
            now.reached(extent);
        });
        let saved = in_place(|| {
            let _alone = entry.saving();
            let status = entry.state.borrow().status.clone();
            self.store.keep_accepted(&status).map(|()| status.callers)
        })?;
        entry.state.send_modify(|now| now.accepted = true);
        self.save_new_callers(entry, &saved);
        info!(owner = &*caller.name, "accepted");

        let _slot = self.enter_queue(&caller, priority).slot().await;
        entry.state.send_modify(|bake| {
            bake.status.set_state(BakeState::Running);
            bake.status.start_time = Some(now());
        });
        in_place(|| {
            let _alone = entry.saving();
            let status = entry.state.borrow().status.clone();
            self.store.write_status(&status)
        })?;
        info!("started");
        let _running = Running::new();
        failpoints::at("bake-task")?;
        let run = self.follow_worker(entry, &folder, slot);
        match self.config.bake_time() {
            Some(longest) => {
                let passed = |_| Err(Fault::TimeLimit(longest.as_secs()).into());
                tokio::time::timeout(longest, run).await.unwrap_or_else(passed)
            }
            None => run.await,
        }
    }

    /// Plans a new bake, unless the same scene was planned with another seed.
    async fn accept(
        &self,
        id: &str,
        folder: &Path,
        caller: &Caller,
        spec: &BakeSpec,
        slot: &mut Option<Worker>,
    ) -> Result<Accepted, Fault> {
        in_place(|| self.store.prepare(id, spec, caller.project()))?;
        let mut is_new = false;
        let plan = async {
            is_new = true;
            let _planner = self.planner_quota.acquire(caller).await;
            self.plan_in(id, folder, caller.project(), slot).await
        };
        let is_there = |asset: &AssetReference| folder.join(ASSETS).join(&asset.sha256).is_file();
        if !in_place(|| spec.assets.iter().all(is_there)) {
            // Its worker says which.
            return plan.await;
        }
        let mut accepted = self.verdicts.get_or_try_make(spec, caller.project(), plan).await?;
        if !is_new && let Some(scene) = &accepted.effective_scene {
            in_place(|| write_scene(folder, scene))?;
        }
        accepted.bake_id = id.to_owned();
        Ok(accepted)
    }

    /// Plans a bake that an earlier server had accepted and whose events are gone or of another version. Fails if this
    /// version would give the bake another id, and so another result.
    async fn accept_again(
        &self,
        id: &str,
        folder: &Path,
        project: &str,
        slot: &mut Option<Worker>,
    ) -> Result<Accepted, Fault> {
        match self.store.spec(id) {
            Ok(spec) if bake_id(&spec, project) == id => {
                warn!("the events are damaged; planning the bake again");
                self.plan_in(id, folder, project, slot).await
            }
            _ => Err(Fault::ServerRestarted),
        }
    }

    async fn plan_in(
        &self,
        id: &str,
        folder: &Path,
        project: &str,
        slot: &mut Option<Worker>,
    ) -> Result<Accepted, Fault> {
        let mut accepted = self.run_plan(WorkerTask::Accept, folder, project, slot).await?;
        // The planner has finished its work.
        if let Some(mut planner) = slot.take() {
            planner.kill().await;
        }
        accepted.bake_id = id.to_owned();
        accepted.versions = Some(versions());
        Ok(accepted)
    }

    /// Runs the bake's process and processes its messages.
    async fn follow_worker(
        &self,
        entry: &Entry,
        folder: &Path,
        slot: &mut Option<Worker>,
    ) -> Result<Summary, EndReason> {
        let project = entry.state.borrow().status.project.clone();
        let worker = slot.insert(self.start_worker(WorkerTask::Bake, folder, &project)?);
        loop {
            match worker.next().await? {
                Some(WorkerMessage::Progress(progress)) => {
                    entry.state.send_modify(|now| now.status.progress = Some(progress))
                }
                Some(WorkerMessage::Logged(extent)) if extent.bytes > self.config.store_bytes() => {
                    return Err(Fault::StorageLimit(format!("its events take {} bytes", extent.bytes)).into());
                }
                Some(WorkerMessage::Logged(extent)) => entry.state.send_modify(|now| now.reached(extent)),
                Some(WorkerMessage::Done(summary)) => return Ok(summary),
                Some(WorkerMessage::Invalid(invalid)) => return Err(Fault::SceneInvalid(invalid.problems).into()),
                Some(
                    WorkerMessage::Planned(_)
                    | WorkerMessage::Exported(_)
                    | WorkerMessage::Analysed(_)
                    | WorkerMessage::NotWritten(_)
                    | WorkerMessage::Broken(_),
                ) => {}
                None => break,
            }
        }
        let worker = slot.take().expect("it was started");
        Err(worker.fault().await.into())
    }

    /// Saves how the bake ended, then notifies its callers.
    fn finish(&self, entry: &Entry, result: Result<Summary, EndReason>) {
        let mut bake = entry.state.borrow().clone();
        let id = bake.status.bake_id.clone();
        match result {
            Ok(summary) => {
                info!(bodies = summary.body_count, cpu_seconds = summary.cpu_seconds, "succeeded");
                count(&summary);
                end_with(&mut bake.status, BakeState::Succeeded, None);
                bake.result_bytes = summary.result_bytes;
                bake.status.summary = Some(summary);
            }
            Err(EndReason::Fault(fault)) => {
                let state = if fault == Fault::BakeCancelled { BakeState::Cancelled } else { BakeState::Failed };
                warn!(%fault, "ended without a result");
                end_with(&mut bake.status, state, Some(&fault));
            }
            Err(EndReason::Unfinished) => {
                info!("unfinished at shutdown");
                end_with(&mut bake.status, BakeState::Failed, Some(&Fault::ShuttingDown));
                entry.state.send_replace(bake);
                return;
            }
        }
        let outcome = bake.status.state().as_str_name().trim_start_matches("BAKE_STATE_").to_lowercase();
        METRICS.bakes.with_label_values(&[&outcome]).inc();
        if let Some(time) = duration(&bake) {
            METRICS.bake_seconds.observe(time.as_secs_f64());
            *self.last_time.lock().unwrap_or_else(PoisonError::into_inner) = time;
        }
        if bake.accepted {
            let alone = entry.saving();
            bake.status.callers = entry.state.borrow().status.callers.clone();
            let saved = bake.status.callers.clone();
            self.hook.iter().for_each(|hook| hook.report(&bake.status));
            match self.store.write_status(&bake.status) {
                Ok(()) => {
                    self.store.tidy(&bake.status);
                    bake.stored_bytes = self.store.bake_bytes(&id);
                    bake.status.summary = None;
                }
                // Keep the assets: the next server will resume the bake.
                Err(error) => warn!(%error, "the end of the bake could not be saved"),
            }
            entry.state.send_modify(|now| {
                bake.status.callers = std::mem::take(&mut now.status.callers);
                *now = bake;
            });
            drop(alone);
            self.save_new_callers(entry, &saved);
        } else {
            // A refused request leaves nothing behind.
            let mut entries = self.entries();
            entries.remove(&id);
            let files = self.store.take_away(&id);
            drop(entries);
            match files {
                Ok(files) => drop(files),
                Err(error) => warn!(%error, "the folder of a refused bake could not be removed"),
            }
            entry.state.send_replace(bake);
        }
    }

    /// Saves the status of a bake again if others want it now than those that were saved.
    fn save_new_callers(&self, entry: &Entry, saved: &[BakeCaller]) {
        let has_changed = entry.state.borrow().status.callers != saved;
        if has_changed {
            in_place(|| self.save_callers(entry));
        }
    }
}

impl EntryState {
    fn reached(&mut self, extent: Extent) {
        self.log_bytes = extent.bytes;
        self.status.event_bytes = cairn_wire::to_proto::signed(extent.bytes);
        self.status.last_sequence_number = extent.last;
    }
}

fn duration(bake: &EntryState) -> Option<Duration> {
    let seconds = |time: prost_types::Timestamp| time.seconds as f64 + f64::from(time.nanos) * 1e-9;
    let time = seconds(bake.status.end_time?) - seconds(bake.status.start_time?);
    Duration::try_from_secs_f64(time).ok()
}

/// Ends the bake if its task panics, so that its callers do not wait forever.
struct EndGuard<'a>(&'a Bakes, &'a Entry);

impl Drop for EndGuard<'_> {
    fn drop(&mut self) {
        let EndGuard(bakes, entry) = self;
        let has_ended = entry.state.borrow().has_ended();
        if !has_ended && std::thread::panicking() {
            bakes.finish(entry, Err(EndReason::Fault(Fault::Internal("the bake's task ended early".into()))));
        }
        METRICS.bakes_pending.dec();
    }
}

/// Counts a running bake while it lives.
struct Running;

impl Running {
    fn new() -> Running {
        METRICS.bakes_running.inc();
        Running
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        METRICS.bakes_running.dec();
    }
}

/// Adds a finished bake to the metrics.
fn count(summary: &Summary) {
    METRICS.bodies.inc_by(summary.body_count.unsigned_abs().into());
    let analyses = summary.counts.get("analyses").copied().unwrap_or(0);
    METRICS.solves.inc_by(analyses.unsigned_abs());
    for (stage, seconds) in &summary.stage_seconds {
        let milliseconds = (seconds * 1e3).round() as u64;
        METRICS.stage_cpu_milliseconds.with_label_values(&[stage]).inc_by(milliseconds);
    }
    METRICS.bake_peak_memory_bytes.observe(summary.peak_memory_bytes as f64);
}
