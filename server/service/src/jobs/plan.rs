//! Plans: each in a process of its own, of a request alone or of a bake that is to be accepted.

use super::submission::set_accuracy;
use super::{Bakes, bake_id};
use crate::access::Caller;
use crate::blocking::in_place;
use crate::process::{Worker, WorkerTask};
use crate::status::Fault;
use crate::worker_message::WorkerMessage;
use cairn_wire::proto::{Accepted, BakeSpec, PlanBakeResponse};
use std::path::Path;
use std::time::Duration;

impl Bakes {
    /// Plans a bake without running it.
    pub async fn plan(&self, caller: &Caller, mut spec: BakeSpec) -> Result<PlanBakeResponse, Fault> {
        self.accepts_work()?;
        let _permit = self.plan_quota.try_acquire(caller).ok_or_else(|| self.queue_full())?;
        let _planner = self.planner_quota.acquire(caller).await;
        let folder = in_place(|| self.store.prepare_plan(&spec, caller.project()))?;
        let mut worker = None;
        let accepted = self.run_plan(WorkerTask::Plan, folder.path(), caller.project(), &mut worker).await?;
        set_accuracy(&mut spec, accepted.effective_scene.as_ref());
        Ok(PlanBakeResponse {
            bake_id: bake_id(&spec, caller.project()),
            plan: accepted.plan,
            effective_scene: accepted.effective_scene,
            has_parameters_only: accepted.has_parameters_only,
        })
    }

    /// Lets a worker plan. `slot` receives the process, so that the caller can wait for its end.
    pub(super) async fn run_plan(
        &self,
        task: WorkerTask,
        folder: &Path,
        project: &str,
        slot: &mut Option<Worker>,
    ) -> Result<Accepted, Fault> {
        /// A plan reads files and measures meshes; only hostile input takes longer.
        const LONGEST: Duration = Duration::from_secs(120);
        let worker = slot.insert(self.start_worker(task, folder, project)?);
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
}
