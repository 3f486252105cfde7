//! The life of one bake: planned, queued, run, ended.

use super::{Bakes, Entry, Now, accepted_before, bake_id, now};
use crate::service::access::Caller;
use crate::service::event_log::{Extent, Writer};
use crate::service::folder::EVENTS;
use crate::service::news::News;
use crate::service::process::{Task, Worker};
use crate::service::shares::Held;
use crate::service::status::Fault;
use crate::trouble;
use crate::wire::proto::bake_event::Kind;
use crate::wire::proto::{Accepted, BakeSpec, BakeState, Summary};
use crate::wire::versions::versions;
use std::path::Path;
use std::sync::{Arc, PoisonError};
use std::time::Duration;
use tokio::time::Instant;
use tracing::{Instrument, info, info_span, warn};

/// What a new bake begins with.
pub(super) struct New {
    pub spec: BakeSpec,
    pub caller: Caller,
    /// Its place among those that run or wait.
    pub place: Held,
}

/// Why a bake ends without a result.
enum End {
    Fault(Fault),
    /// The server ends; another one may take the bake up.
    Unfinished,
}

impl<E: Into<Fault>> From<E> for End {
    fn from(error: E) -> End {
        End::Fault(error.into())
    }
}

impl Bakes {
    /// Starts a bake's task. One that is not new has its request on the disk.
    pub(super) fn spawn(self: &Arc<Self>, entry: Arc<Entry>, new: Option<New>) {
        let span = info_span!("bake", bake_id = %entry.id());
        let bakes = self.clone();
        let life = async move {
            metrics::gauge!("cairn_bakes_pending").increment(1);
            let _certain = CertainEnd(&bakes, &entry);
            let mut worker = None;
            let result = tokio::select! {
                result = bakes.run(&entry, new, &mut worker) => result,
                end = bakes.stopped(&entry) => Err(end),
            };
            if let Some(mut worker) = worker {
                worker.kill().await;
            }
            bakes.finish(&entry, result);
            bakes.grown();
        };
        self.tasks.spawn(life.instrument(span));
    }

    /// Resolves when the bake has to end before its time.
    async fn stopped(&self, entry: &Entry) -> End {
        let passed = async {
            // It may have been put off meanwhile, and never comes nearer.
            while let Some(at) = entry.deadline() {
                if at <= Instant::now() {
                    return;
                }
                tokio::time::sleep_until(at).await;
            }
            std::future::pending().await
        };
        tokio::select! {
            () = entry.cancelled.cancelled() => End::Fault(Fault::BakeCancelled),
            () = passed => End::Fault(Fault::Deadline),
            () = self.ending.cancelled() => End::Unfinished,
        }
    }

    async fn run(&self, entry: &Entry, new: Option<New>, slot: &mut Option<Worker>) -> Result<Summary, End> {
        let id = entry.id();
        let folder = self.store.folder(&id);
        let (caller, priority) = match &new {
            Some(new) => (new.caller.clone(), entry.now.borrow().status.priority),
            None => {
                let now = entry.now.borrow();
                (Caller::named(&now.status.owner), now.status.priority)
            }
        };
        let (_place, accepted) = match new {
            Some(New { spec, caller, place }) => {
                let accepted = self.accept(&id, &folder, &caller, &spec, slot).await?;
                (place, accepted)
            }
            // What an earlier server had accepted waits for its place; nobody is there to be refused.
            None => {
                let place = self.places.hold(&caller).await;
                let accepted = match accepted_before(&folder.join(EVENTS)).await {
                    Some(accepted) => accepted,
                    None => self.accept_again(&id, &folder, slot).await?,
                };
                (place, accepted)
            }
        };
        let extent = Writer::create(&folder.join(EVENTS), Kind::Accepted(Box::new(accepted)))?.sync()?;
        entry.now.send_modify(|now| {
            now.accepted = true;
            now.status.set_state(BakeState::Queued);
            now.reached(extent);
        });
        self.write_status(entry)?;
        info!(owner = &*caller.name, "accepted");

        let _turn = self.turns.take(&caller, priority).await;
        entry.now.send_modify(|bake| {
            bake.status.set_state(BakeState::Running);
            bake.status.start_time = Some(now());
        });
        self.write_status(entry)?;
        info!("started");
        let _running = Running::new();
        trouble::at("bake-task")?;
        match self.config.bake_time() {
            Some(longest) => match tokio::time::timeout(longest, self.follow_worker(entry, &folder, slot)).await {
                Ok(result) => result,
                Err(_) => Err(Fault::TimeLimit(longest.as_secs()).into()),
            },
            None => self.follow_worker(entry, &folder, slot).await,
        }
    }

    /// Has a new bake planned.
    async fn accept(
        &self,
        id: &str,
        folder: &Path,
        caller: &Caller,
        spec: &BakeSpec,
        slot: &mut Option<Worker>,
    ) -> Result<Accepted, Fault> {
        let _planner = self.planners.hold(caller).await;
        self.store.prepare(id, spec)?;
        self.plan_in(id, folder, slot).await
    }

    /// An earlier server had accepted this bake, and its events are gone or of another version. This version would bake
    /// something else under another id.
    async fn accept_again(&self, id: &str, folder: &Path, slot: &mut Option<Worker>) -> Result<Accepted, Fault> {
        match self.store.spec(id) {
            Ok(spec) if bake_id(&spec) == id => {
                warn!("its events are damaged; it is planned again");
                self.plan_in(id, folder, slot).await
            }
            _ => Err(Fault::ServerRestarted),
        }
    }

    async fn plan_in(&self, id: &str, folder: &Path, slot: &mut Option<Worker>) -> Result<Accepted, Fault> {
        let mut accepted = self.run_plan(Task::Accept, folder, slot).await?;
        // It has said all.
        if let Some(mut planner) = slot.take() {
            planner.kill().await;
        }
        accepted.bake_id = id.to_owned();
        accepted.versions = Some(versions());
        Ok(accepted)
    }

    /// Runs the bake's process and passes on what it tells.
    async fn follow_worker(&self, entry: &Entry, folder: &Path, slot: &mut Option<Worker>) -> Result<Summary, End> {
        let worker = slot.insert(Worker::start(&self.config, Task::Bake, folder)?);
        loop {
            match worker.next().await? {
                Some(News::Progress(progress)) => entry.now.send_modify(|now| now.status.progress = Some(progress)),
                Some(News::Logged(extent)) if extent.bytes > self.config.store_bytes() => {
                    return Err(Fault::StorageLimit(format!("its events take {} bytes", extent.bytes)).into());
                }
                Some(News::Logged(extent)) => entry.now.send_modify(|now| now.reached(extent)),
                Some(News::Done(summary)) => return Ok(summary),
                Some(News::Invalid(invalid)) => return Err(Fault::SceneInvalid(invalid.problems).into()),
                Some(News::NotWritten(why)) => return Err(Fault::StorageLimit(why).into()),
                Some(News::Broken(why)) => return Err(Fault::DataDirectory(why).into()),
                Some(News::Planned(_)) => {}
                None => break,
            }
        }
        let worker = slot.take().expect("it was started");
        Err(worker.fault().await.into())
    }

    /// Writes down how the bake ended, then tells its callers.
    fn finish(&self, entry: &Entry, result: Result<Summary, End>) {
        let mut bake = entry.now.borrow().clone();
        let id = bake.status.bake_id.clone();
        match result {
            Ok(summary) => {
                info!(bodies = summary.body_count, cpu_seconds = summary.cpu_seconds, "succeeded");
                count(&summary);
                bake.status.end(BakeState::Succeeded, None);
                bake.result_bytes = summary.result_bytes;
                bake.status.summary = Some(summary);
            }
            Err(End::Fault(fault)) => {
                let state = if fault == Fault::BakeCancelled { BakeState::Cancelled } else { BakeState::Failed };
                warn!(%fault, "ended without a result");
                bake.status.end(state, Some(&fault));
            }
            Err(End::Unfinished) => {
                info!("left unfinished");
                bake.status.end(BakeState::Failed, Some(&Fault::ShuttingDown));
                entry.now.send_replace(bake);
                return;
            }
        }
        let outcome = bake.status.state().as_str_name().trim_start_matches("BAKE_STATE_").to_lowercase();
        metrics::counter!("cairn_bakes_total", "outcome" => outcome).increment(1);
        if let Some(time) = duration(&bake) {
            metrics::histogram!("cairn_bake_seconds").record(time.as_secs_f64());
            *self.last_time.lock().unwrap_or_else(PoisonError::into_inner) = time;
        }
        if bake.accepted {
            match self.store.write_status(&bake.status) {
                Ok(()) => {
                    self.store.tidy(&bake.status);
                    bake.status.summary = None;
                }
                // The next server takes the bake up again, and needs its assets for that.
                Err(error) => warn!(%error, "the end of the bake could not be written down"),
            }
            entry.now.send_replace(bake);
        } else {
            // A request that was wrong leaves nothing behind.
            let mut entries = self.entries();
            entries.remove(&id);
            if let Err(error) = self.store.remove(&id) {
                warn!(%error, "the folder of a refused bake stays");
            }
            drop(entries);
            entry.now.send_replace(bake);
        }
    }

    fn write_status(&self, entry: &Entry) -> std::io::Result<()> {
        let status = entry.now.borrow().status.clone();
        self.store.write_status(&status)
    }
}

impl Now {
    fn reached(&mut self, extent: Extent) {
        self.log_bytes = extent.bytes;
        self.status.event_bytes = crate::wire::to_proto::signed(extent.bytes);
        self.status.last_sequence_number = extent.last;
    }
}

fn duration(bake: &Now) -> Option<Duration> {
    let seconds = |time: prost_types::Timestamp| time.seconds as f64 + f64::from(time.nanos) * 1e-9;
    let time = seconds(bake.status.end_time?) - seconds(bake.status.start_time?);
    Duration::try_from_secs_f64(time).ok()
}

/// A panic in a bake's task ends that bake: its callers do not wait for ever.
struct CertainEnd<'a>(&'a Bakes, &'a Entry);

impl Drop for CertainEnd<'_> {
    fn drop(&mut self) {
        let CertainEnd(bakes, entry) = self;
        let has_ended = entry.now.borrow().has_ended();
        if !has_ended && std::thread::panicking() {
            bakes.finish(entry, Err(End::Fault(Fault::Internal("the bake's task ended before its time".into()))));
        }
        metrics::gauge!("cairn_bakes_pending").decrement(1);
    }
}

/// Counts a running bake while it lives.
struct Running;

impl Running {
    fn new() -> Running {
        metrics::gauge!("cairn_bakes_running").increment(1);
        Running
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        metrics::gauge!("cairn_bakes_running").decrement(1);
    }
}

/// A finished bake's figures, for the metrics.
fn count(summary: &Summary) {
    metrics::counter!("cairn_bodies_total").increment(summary.body_count.unsigned_abs().into());
    let analyses = summary.counts.get("analyses").copied().unwrap_or(0);
    metrics::counter!("cairn_solves_total").increment(analyses.unsigned_abs());
    for (stage, seconds) in &summary.stage_seconds {
        metrics::gauge!("cairn_stage_cpu_seconds_total", "stage" => stage.clone()).increment(*seconds);
    }
    metrics::histogram!("cairn_bake_peak_memory_bytes").record(summary.peak_memory_bytes as f64);
}
