//! Results of finished bakes: in which layout, and made by a worker where they were not made before.

use super::{Bakes, Entry};
use crate::access::Caller;
use crate::folder::{EARLIER_PILE, PILE, ResultKind};
use crate::process::WorkerTask;
use crate::seal::CHANGED;
use crate::status::Fault;
use crate::worker_message::{ResultHead, WorkerMessage};
use cairn_export::{Format, Layout, is_asset_folder};
use cairn_wire::proto::{DownloadResultRequest, DownloadResultResponse, FieldProblem, Summary, UsdLayout};
use prost::Message;
use std::time::Duration;

impl Bakes {
    /// The layout of a result in a format, if it is not that of the bake's request: a request that states it.
    pub fn other_layout(
        &self,
        entry: &Entry,
        format: Format,
        usd: Option<UsdLayout>,
        asset_folder: String,
    ) -> Result<Option<Vec<u8>>, Fault> {
        if !format.is_usd() {
            return Ok(None);
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
        let asked = self.store.spec(&entry.id())?.scene.and_then(|scene| scene.usd).unwrap_or_default();
        let usd = usd.unwrap_or_else(|| asked.clone());
        let is_own = asked == usd && asset_folder.is_empty();
        let request = || DownloadResultRequest { usd: Some(usd), asset_folder, ..Default::default() };
        Ok((!is_own).then(|| request().encode_to_vec()))
    }

    /// Describes a finished bake's result. If it was not made before, a worker makes it now. `layout`: the request that
    /// states it, where the result has another one than the bake's.
    pub async fn result(
        &self,
        caller: &Caller,
        entry: &Entry,
        kind: &ResultKind,
        layout: Option<&[u8]>,
    ) -> Result<ResultHead, Fault> {
        /// A result is written in seconds; only a huge one takes longer.
        const LONGEST: Duration = Duration::from_secs(600);
        let _alone = entry.export.lock().await;
        let id = entry.id();
        if let (Some(request), Some(layout)) = (layout, &kind.layout) {
            self.store.keep_layout(&id, layout, request)?;
        }
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
        let mut worker = self.start_worker(WorkerTask::Export(kind.clone()), &folder, &status.project)?;
        let message = tokio::time::timeout(LONGEST, worker.next()).await;
        self.request_trim();
        let stored_bytes = self.store.bake_bytes(&id);
        entry.state.send_modify(|now| now.stored_bytes = stored_bytes);
        let message = message.map_err(|_| Fault::TimeLimit(LONGEST.as_secs()))?;
        let message = message.map_err(|fault| match fault {
            Fault::DataDirectory(why) if why == CHANGED => self.mark_damaged(entry, format!("its pile: {why}")),
            fault => fault,
        });
        match message? {
            Some(WorkerMessage::Exported(head)) => Ok(head),
            Some(WorkerMessage::Invalid(invalid)) => Err(Fault::SceneInvalid(invalid.problems)),
            Some(_) => Err(Fault::Internal("the worker did not export".into())),
            None => Err(worker.fault().await),
        }
    }
}
