//! Analyses of piles: each in a process of its own, with the place of a bake. Nothing of them is kept.

use super::{Bakes, Entry};
use crate::access::Caller;
use crate::blocking::in_place;
use crate::folder::ResultKind;
use crate::process::WorkerTask;
use crate::quotas::Permit;
use crate::status::Fault;
use crate::worker_message::WorkerMessage;
use cairn_export::Format;
use cairn_wire::proto::{AnalysePileRequest, AnalysePileResponse, AssetReference};
use std::sync::Arc;
use tempfile::TempDir;
use tokio::sync::mpsc;
use tokio_util::task::task_tracker::TaskTrackerToken;
use tonic::Status;

/// An analysis that was accepted. Dropping it ends its process.
pub struct NewAnalysis {
    folder: TempDir,
    caller: Caller,
    /// Counts it among running and waiting bakes.
    _permit: Permit,
    /// The server waits for it before it ends.
    _token: TaskTrackerToken,
}

impl Bakes {
    /// Accepts an analysis, if the quotas permit. `bake`: whose result is analysed, instead of the request's assets.
    pub async fn accept_analysis(
        &self,
        caller: &Caller,
        mut request: AnalysePileRequest,
        bake: Option<Arc<Entry>>,
    ) -> Result<NewAnalysis, Fault> {
        self.accepts_work()?;
        let token = self.tasks.token();
        let permit = self.bake_quota.try_acquire(caller).ok_or_else(|| self.queue_full())?;
        let mut result = None;
        if let Some(entry) = bake {
            let kind = ResultKind::of(Format::Glb);
            let sha256 = self.result(caller, &entry, &kind, None).await?.result.sha256;
            let name = kind.result_name();
            result = Some(self.store.folder(&entry.id()).join(&name));
            request.assets = vec![AssetReference { uri: name, sha256 }];
        }
        let prepare = || self.store.prepare_analysis(&request, result.as_deref(), caller.project());
        let folder = in_place(prepare)?;
        Ok(NewAnalysis { folder, caller: caller.clone(), _permit: permit, _token: token })
    }

    /// Runs an analysis, and passes on its messages while somebody listens.
    pub async fn run_analysis(
        &self,
        new: NewAnalysis,
        caller: &mpsc::Sender<Result<AnalysePileResponse, Status>>,
    ) -> Result<(), Fault> {
        let run = async {
            let _slot = self.enter_queue(&new.caller, 0).slot().await;
            let work = async {
                let mut worker = self.start_worker(WorkerTask::Analyse, new.folder.path(), new.caller.project())?;
                let mut is_whole = false;
                loop {
                    match worker.next().await? {
                        Some(WorkerMessage::Analysed(part)) => {
                            is_whole |= part.pile.is_some();
                            if caller.send(Ok(*part)).await.is_err() {
                                worker.kill().await;
                                return Ok(());
                            }
                        }
                        Some(WorkerMessage::Invalid(invalid)) if invalid.only_missing => {
                            return Err(Fault::AssetsMissing(invalid.problems));
                        }
                        Some(WorkerMessage::Invalid(invalid)) => return Err(Fault::SceneInvalid(invalid.problems)),
                        Some(_) => {}
                        None if is_whole => return Ok(()),
                        None => break,
                    }
                }
                Err(worker.fault().await)
            };
            match self.config.bake_time() {
                Some(longest) => {
                    let passed = |_| Err(Fault::TimeLimit(longest.as_secs()));
                    tokio::time::timeout(longest, work).await.unwrap_or_else(passed)
                }
                None => work.await,
            }
        };
        tokio::select! {
            ended = run => ended,
            () = self.ending.cancelled() => Err(Fault::ShuttingDown),
        }
    }
}
