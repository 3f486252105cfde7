//! Bakes: who may run, where they stand, how they end.
//!
//! One entry per bake, however many callers it has. An entry's task holds its place in the queue, and later its worker,
//! until the process has ended.

mod entry;
mod order;
mod task;

use crate::service::access::Caller;
use crate::service::config::{Config, Unfinished};
use crate::service::event_log;
use crate::service::news::News;
use crate::service::process::{Task, Worker};
use crate::service::shares::Shares;
use crate::service::status::Fault;
use crate::service::store::Store;
use crate::service::turns::Turns;
use crate::wire::proto::{self, BakeSpec, BakeState, BakeStatus};
use crate::wire::versions::versions;
pub use entry::{Entry, Now, Place};
pub use order::{Order, bake_id};
use prost_types::Timestamp;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};
use task::New;
use tokio::sync::Notify;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{info, warn};

/// Bakes that failed or were cancelled, and are kept to be told of.
const MOST_WITHOUT_RESULT: usize = 1000;

/// All bakes of a server.
pub struct Bakes {
    pub config: Config,
    pub store: Store,
    entries: Mutex<BTreeMap<String, Arc<Entry>>>,
    /// Bakes that run or wait.
    places: Shares,
    /// Whose bakes run.
    turns: Arc<Turns>,
    /// Plans that are made or wait.
    plan_places: Shares,
    /// Plans that are made: twice as many as bakes run, so that no caller can hold them all.
    planners: Shares,
    /// No more bakes are taken.
    draining: CancellationToken,
    /// Running bakes end, unfinished.
    ending: CancellationToken,
    tasks: TaskTracker,
    trim: Notify,
    /// How long the last bake ran: a guess at when a place will be free.
    last_time: Mutex<Duration>,
}

impl Bakes {
    pub fn new(config: Config, store: Store) -> Arc<Bakes> {
        let workers = config.workers();
        let places = workers.saturating_add(config.queue);
        Arc::new(Bakes {
            config,
            store,
            entries: Mutex::default(),
            places: Shares::new(places, places - places / 4),
            turns: Turns::new(workers),
            plan_places: Shares::new(places, places.div_ceil(2)),
            planners: Shares::new(2 * workers, workers),
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

    /// Takes up what an earlier server left: finished bakes as they are, the others as configured.
    pub fn restore(self: &Arc<Self>) -> std::io::Result<()> {
        let mut found = self.store.load()?;
        found.sort_by_key(|status| status.create_time.map(|time| (time.seconds, time.nanos)));
        for mut status in found {
            let id = status.bake_id.clone();
            let result_bytes = status.summary.as_ref().map_or(0, |summary| summary.result_bytes);
            if let Some(damage) = self.store.damage(&status, result_bytes) {
                warn!(bake_id = %id, damage, "a bake is damaged; it is made again when it is asked for");
                status.end(BakeState::Failed, Some(&Fault::BakeDamaged(damage)));
                self.write_down(&status);
            }
            let was_unfinished = matches!(status.state(), BakeState::Queued | BakeState::Running);
            if was_unfinished && self.config.unfinished == Unfinished::Fail {
                status.end(BakeState::Failed, Some(&Fault::ServerRestarted));
                self.write_down(&status);
            }
            let resume = was_unfinished && self.config.unfinished == Unfinished::Restart;
            if resume {
                // Its log is written anew: nothing of it may be read before.
                (status.event_bytes, status.last_sequence_number) = (0, 0);
            } else {
                self.store.tidy(&status);
            }
            let log_bytes = u64::try_from(status.event_bytes).unwrap_or(0);
            status.summary = None;
            let entry = Entry::new(Now { log_bytes, accepted: true, result_bytes, ..Now::of(status) }, None);
            self.entries().insert(id.clone(), entry.clone());
            if resume {
                info!(bake_id = %id, "unfinished bake is taken up again");
                self.spawn(entry, None);
            }
        }
        Ok(())
    }

    /// The bake of this request: the one that there is, or a new one, if there is a place for it.
    pub fn submit(
        self: &Arc<Self>,
        caller: &Caller,
        order: Order,
        deadline: Option<Instant>,
    ) -> Result<Arc<Entry>, Fault> {
        let Order { spec, labels, priority } = order;
        if self.is_draining() {
            return Err(Fault::ShuttingDown);
        }
        let id = bake_id(&spec);
        let mut entries = self.entries();
        if let Some(entry) = entries.get(&id) {
            self.look_at(entry);
            let state = entry.now.borrow().status.state();
            if !matches!(state, BakeState::Failed | BakeState::Cancelled) && !entry.cancelled.is_cancelled() {
                entry.put_off(deadline);
                metrics::counter!("cairn_bakes_shared_total").increment(1);
                return Ok(entry.clone());
            }
            if !entry.now.borrow().has_ended() {
                // It was cancelled a moment ago, and its folder is still in use.
                return Err(Fault::QueueFull { retry: Duration::from_secs(1) });
            }
        }
        order::within_limits(caller, self.config.workers(), entries.values())?;
        let Some(place) = self.places.try_hold(caller) else {
            metrics::counter!("cairn_bakes_refused_total").increment(1);
            return Err(self.queue_full());
        };
        let mut status = BakeStatus {
            bake_id: id.clone(),
            create_time: Some(now()),
            owner: caller.name.to_string(),
            labels,
            priority,
            ..Default::default()
        };
        status.set_state(BakeState::Queued);
        let entry = Entry::new(Now::of(status), deadline);
        entries.insert(id, entry.clone());
        self.spawn(entry.clone(), Some(New { spec, caller: caller.clone(), place }));
        Ok(entry)
    }

    /// A bake whose files are not as long as they were is damaged.
    fn look_at(&self, entry: &Entry) {
        let damage = {
            let now = entry.now.borrow();
            self.store.damage(&now.status, now.result_bytes)
        };
        if let Some(damage) = damage {
            self.damaged(entry, damage);
        }
    }

    /// What is kept of a bake was found to be damaged: who asks for it next has it made again.
    pub fn damaged(&self, entry: &Entry, damage: String) -> Fault {
        let fault = Fault::BakeDamaged(damage);
        let mut status = entry.now.borrow().status.clone();
        if status.state() == BakeState::Succeeded {
            warn!(bake_id = %status.bake_id, %fault, "a bake is damaged");
            status.end(BakeState::Failed, Some(&fault));
            status.summary = None;
            self.write_down(&status);
            entry.now.send_modify(|now| (now.status, now.result_bytes) = (status, 0));
        }
        fault
    }

    /// How a bake stands, with the summary of one that has succeeded.
    pub fn status(&self, entry: &Entry) -> Result<BakeStatus, Fault> {
        let status = entry.now.borrow().status.clone();
        if status.state() != BakeState::Succeeded || status.summary.is_some() {
            return Ok(status);
        }
        let kept = self.store.status(&status.bake_id)?;
        kept.ok_or_else(|| self.damaged(entry, "its summary is cut off or gone".into()))
    }

    /// Where the disk does not take it, the next server finds it out as this one did.
    fn write_down(&self, status: &BakeStatus) {
        if let Err(error) = self.store.write_status(status) {
            warn!(bake_id = %status.bake_id, %error, "how the bake stands could not be written down");
        }
    }

    fn queue_full(&self) -> Fault {
        let last = *self.last_time.lock().unwrap_or_else(PoisonError::into_inner);
        Fault::QueueFull { retry: last.clamp(Duration::from_secs(1), Duration::from_secs(60)) }
    }

    /// What a bake would do.
    pub async fn plan(&self, caller: &Caller, spec: BakeSpec) -> Result<proto::PlanBakeResponse, Fault> {
        let _place = self.plan_places.try_hold(caller).ok_or_else(|| self.queue_full())?;
        let _planner = self.planners.hold(caller).await;
        let folder = self.store.prepare_plan(&spec)?;
        let mut worker = None;
        let accepted = self.run_plan(Task::Plan, folder.path(), &mut worker).await?;
        Ok(proto::PlanBakeResponse {
            bake_id: bake_id(&spec),
            plan: accepted.plan,
            effective_scene: accepted.effective_scene,
            has_parameters_only: accepted.has_parameters_only,
        })
    }

    /// Lets a worker plan. `slot` holds the process, so that the caller may wait for its end.
    async fn run_plan(
        &self,
        task: Task,
        folder: &std::path::Path,
        slot: &mut Option<Worker>,
    ) -> Result<proto::Accepted, Fault> {
        /// A plan reads files and measures meshes; what takes longer is hostile.
        const LONGEST: Duration = Duration::from_secs(120);
        let worker = slot.insert(Worker::start(&self.config, task, folder)?);
        let news = tokio::time::timeout(LONGEST, worker.next()).await;
        match news.map_err(|_| Fault::TimeLimit(LONGEST.as_secs()))?? {
            Some(News::Planned(accepted)) => Ok(*accepted),
            Some(News::Invalid(invalid)) if invalid.only_missing => Err(Fault::AssetsMissing(invalid.problems)),
            Some(News::Invalid(invalid)) => Err(Fault::SceneInvalid(invalid.problems)),
            Some(News::NotWritten(why)) => Err(Fault::StorageLimit(why)),
            Some(News::Broken(why)) => Err(Fault::DataDirectory(why)),
            Some(_) => Err(Fault::Internal("the worker did not plan".into())),
            None => Err(slot.take().expect("it was started").fault().await),
        }
    }

    /// A bake that was accepted.
    pub fn find(&self, id: &str) -> Result<Arc<Entry>, Fault> {
        let found = self.entries().get(id).filter(|entry| entry.now.borrow().accepted).cloned();
        found.ok_or_else(|| Fault::BakeNotFound(id.chars().take(64).collect()))
    }

    /// All bakes that were accepted, the latest first.
    pub fn list(&self) -> Vec<Arc<Entry>> {
        let entries = self.entries();
        let mut list: Vec<_> = entries.values().filter(|entry| entry.now.borrow().accepted).cloned().collect();
        drop(entries);
        list.sort_by(|a, b| b.place.cmp(&a.place));
        list
    }

    /// Ends a bake, and waits for that.
    pub async fn cancel(&self, caller: &Caller, id: &str) -> Result<BakeStatus, Fault> {
        let entry = self.find(id)?;
        let owner = entry.now.borrow().status.owner.clone();
        if !caller.may_change(&owner) {
            return Err(Fault::NotYours(owner));
        }
        entry.cancelled.cancel();
        entry.ended().await;
        self.status(&entry)
    }

    /// Ends a bake and removes all of it.
    pub async fn delete(&self, caller: &Caller, id: &str) -> Result<(), Fault> {
        self.cancel(caller, id).await?;
        self.remove_ended(id)?;
        Ok(())
    }

    /// Removes a bake, unless it is at work. Under the lock, so that nobody attaches to it meanwhile.
    fn remove_ended(&self, id: &str) -> std::io::Result<bool> {
        let mut entries = self.entries();
        let is_at_work = entries.get(id).is_some_and(|entry| !entry.now.borrow().has_ended());
        if !is_at_work {
            // One that cannot be removed is still there, to be removed again.
            self.store.remove(id)?;
            entries.remove(id);
        }
        Ok(!is_at_work)
    }

    /// An asset or a bake was added: the limits are to be looked after.
    pub fn grown(&self) {
        self.trim.notify_one();
    }

    /// Forgets those that ended without a result longest ago: callers that cancel all day leave no crowd of them.
    fn forget(&self) {
        let mut list = self.list();
        list.retain(|entry| matches!(entry.now().status.state(), BakeState::Failed | BakeState::Cancelled));
        list.drain(..list.len().min(MOST_WITHOUT_RESULT));
        for entry in list {
            if let Err(error) = self.remove_ended(&entry.id()) {
                warn!(bake_id = %entry.id(), %error, "it is over the limits and cannot be removed");
            }
        }
    }

    /// Keeps the store within its limits, for as long as the server lives.
    pub async fn keep_limits(self: Arc<Self>) {
        /// For what grows old without anything being added.
        const PAUSE: Duration = Duration::from_secs(600);
        /// Looking through a large store takes long: so many times as long, it is left alone then.
        const LEFT_ALONE: u32 = 20;
        loop {
            let (bakes, began) = (self.clone(), Instant::now());
            let trim = move || {
                bakes.forget();
                bakes.store.trim(|id| bakes.remove_ended(id))
            };
            let trimmed = tokio::task::spawn_blocking(trim).await;
            match trimmed {
                Ok(Ok(bytes)) => metrics::gauge!("cairn_store_bytes").set(bytes as f64),
                Ok(Err(error)) => warn!(%error, "the store could not be trimmed"),
                Err(error) => warn!(%error, "the store could not be trimmed"),
            }
            tokio::time::sleep(began.elapsed() * LEFT_ALONE).await;
            let _ = tokio::time::timeout(PAUSE, self.trim.notified()).await;
        }
    }

    /// Whether the server is about to end.
    pub fn is_draining(&self) -> bool {
        self.draining.is_cancelled()
    }

    /// Takes no more bakes and lets those that run end, for so long; then ends them. What is unfinished stays so on the
    /// disk.
    pub async fn drain(&self, longest: Duration) {
        self.draining.cancel();
        self.tasks.close();
        if tokio::time::timeout(longest, self.tasks.wait()).await.is_err() {
            warn!("bakes are left unfinished");
        }
        self.ending.cancel();
        self.tasks.wait().await;
    }
}

fn now() -> Timestamp {
    Timestamp::from(SystemTime::now())
}

impl BakeStatus {
    fn end(&mut self, state: BakeState, fault: Option<&Fault>) {
        self.set_state(state);
        self.end_time = Some(now());
        self.failure = fault.map(proto::Failure::from);
    }
}

/// The first event of a bake that an earlier server accepted.
async fn accepted_before(log: &std::path::Path) -> Option<proto::Accepted> {
    let bytes = tokio::fs::metadata(log).await.ok()?.len();
    let event = event_log::Reader::open(log).await.ok()?.next(bytes).await.ok()??;
    match event.kind? {
        proto::bake_event::Kind::Accepted(accepted) if accepted.versions == Some(versions()) => Some(*accepted),
        // Another version would give another result.
        _ => None,
    }
}
