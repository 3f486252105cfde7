//! The bakes of a server: their entries, all changes of which are under one lock, and what is saved of them.
//!
//! Each bake has one entry, however many callers it has. The entry's task holds its permit, and later its worker slot,
//! until the worker process has ended.

mod analysis;
mod earlier;
mod entry;
mod limits;
mod listing;
mod plan;
mod restart;
mod result;
mod submission;
mod task;
mod tidying;
mod verdicts;
mod withdrawal;

use crate::access::{Access, Caller};
use crate::config::Config;
use crate::hook::Hook;
use crate::memory::MemoryBudget;
use crate::process::{Worker, WorkerTask};
use crate::quotas::Quota;
use crate::scheduler::{Scheduler, Waiting};
use crate::status::Fault;
use crate::store::Store;
pub use analysis::NewAnalysis;
use cairn_wire::proto::{BakeState, BakeStatus, Failure};
pub use entry::{Entry, EntryState, ListPosition};
use prost_types::Timestamp;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, SystemTime};
pub use submission::{BakeSubmission, bake_id};
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::warn;
use verdicts::Verdicts;

/// All bakes of a server.
pub struct Bakes {
    pub config: Config,
    pub store: Store,
    hook: Option<Hook>,
    /// Who may call now, with which limits.
    access: RwLock<Access>,
    entries: Mutex<BTreeMap<String, Arc<Entry>>>,
    /// Running and waiting bakes.
    bake_quota: Quota,
    /// Running bakes.
    scheduler: Arc<Scheduler>,
    /// Running and waiting plans.
    plan_quota: Quota,
    /// Running plans: twice as many as running bakes, so that no caller can hold them all.
    planner_quota: Quota,
    verdicts: Verdicts,
    /// What their processes may take.
    pub memory: Arc<MemoryBudget>,
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
            memory: MemoryBudget::new(&config),
            config,
            store,
            hook,
            access: RwLock::default(),
            entries: Mutex::default(),
            bake_quota: Quota::new(places, places - places / 4),
            scheduler: Scheduler::new(workers),
            plan_quota: Quota::new(places, places.div_ceil(2)),
            planner_quota: Quota::new(2 * workers, workers),
            verdicts: Verdicts::default(),
            draining: CancellationToken::new(),
            ending: CancellationToken::new(),
            tasks: TaskTracker::new(),
            trim: Notify::new(),
            last_time: Mutex::new(Duration::from_secs(1)),
        })
    }

    /// Takes over who may call, with which limits. Bakes that wait have them, too.
    pub fn set_access(&self, access: Access) {
        // Nobody enters the queue between the two.
        let mut now = self.access.write().unwrap_or_else(PoisonError::into_inner);
        *now = access;
        self.scheduler.set_limits(|caller| now.caller(&caller.name, caller.project()));
    }

    /// A caller by its name, with its limits and those of its project as they are now.
    fn caller(&self, name: &str, project: &str) -> Caller {
        self.access.read().unwrap_or_else(PoisonError::into_inner).caller(name, project)
    }

    /// Enters the queue of bakes, with the limits that a caller has now.
    fn enter_queue(&self, caller: &Caller, priority: i32) -> Waiting {
        let access = self.access.read().unwrap_or_else(PoisonError::into_inner);
        self.scheduler.enter(access.caller(&caller.name, caller.project()), priority)
    }

    fn entries(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Entry>>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
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

    /// Saves the status of a bake. If that fails, the next server repeats what this one found.
    fn save_status(&self, status: &BakeStatus) {
        if let Err(error) = self.store.write_status(status) {
            warn!(bake_id = %status.bake_id, %error, "the status of a bake could not be saved");
        }
    }

    /// Saves who wants a bake. The summary of one that has ended is only on disk, and stays.
    fn save_callers(&self, entry: &Entry) {
        let _alone = entry.saving();
        if entry.state.borrow().accepted
            && let Ok(status) = self.status(entry)
        {
            self.save_status(&status);
        }
    }

    /// Marks a bake as damaged if the sizes of its files have changed.
    fn check_files(&self, entry: &Entry) -> Result<(), Fault> {
        let damage = {
            let now = entry.state.borrow();
            self.store.damage(&now.status, now.result_bytes)?
        };
        if let Some(damage) = damage {
            self.mark_damaged(entry, damage);
        }
        Ok(())
    }

    /// Marks a bake as damaged: the next request for it bakes again. While the data directory is away, nothing is.
    pub fn mark_damaged(&self, entry: &Entry, damage: String) -> Fault {
        if !self.store.is_here() {
            return Fault::DataAway;
        }
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

    /// Starts a worker for a project, or for none, with its share of the cores.
    fn start_worker(&self, task: WorkerTask, folder: &Path, project: &str) -> Result<Worker, Fault> {
        if !self.store.is_here() {
            return Err(Fault::DataAway);
        }
        // All others hold a permit of their own.
        let is_beside = matches!(task, WorkerTask::Plan | WorkerTask::Export(_));
        let bakes = self.bake_quota.held() + usize::from(is_beside);
        let cache = self.config.reuse.then(|| self.store.cache(project));
        Worker::start(&self.config, &self.memory, task, folder, cache, self.config.threads_among(bakes))
    }
}

fn now() -> Timestamp {
    Timestamp::from(SystemTime::now())
}

fn end_with(status: &mut BakeStatus, state: BakeState, fault: Option<&Fault>) {
    status.set_state(state);
    status.end_time = Some(now());
    status.failure = fault.map(Failure::from);
}
