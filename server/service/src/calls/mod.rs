//! The calls of `cairn.v1.PileService`. No simulation and no long work happens here.

pub mod pace;
mod request;
mod stream;

use crate::access::{Caller, caller};
use crate::accounts::Account;
use crate::api::pile_service_server::PileService;
use crate::audit;
use crate::blocking::on_disk;
use crate::config::MAX_CHUNK;
use crate::deadline;
use crate::folder::{REPORT, ResultKind, SCENE};
use crate::jobs::{Bakes, Entry};
use crate::quotas::{Permit, Quota};
use crate::status::Fault;
use cairn_export::Format;
use cairn_wire::proto::created_bake::Outcome;
use cairn_wire::proto::{
    AnalysePileRequest, AnalysePileResponse, Artifact, BakeRequest, BakeResponse, BakeState, BakeStatus,
    BatchCreateBakesRequest, BatchCreateBakesResponse, CancelBakeRequest, CancelBakeResponse, CreateBakeRequest,
    CreateBakeResponse, CreatedBake, DeleteBakeRequest, DeleteBakeResponse, DownloadResultRequest,
    DownloadResultResponse, GetBakeRequest, GetBakeResponse, GetServerInfoRequest, GetServerInfoResponse,
    HaveAssetsRequest, HaveAssetsResponse, Limits, ListBakesRequest, ListBakesResponse, OutputFormat, PlanBakeRequest,
    PlanBakeResponse, UploadAssetRequest, UploadAssetResponse, WatchBakeRequest, WatchBakeResponse,
};
use cairn_wire::to_proto;
use cairn_wire::versions::{PROTOCOL, versions};
use pace::UploadPace;
use std::sync::Arc;
use stream::{Download, Follow, ResponseStream};
use tokio::time::Instant;
use tokio_stream::StreamExt;
use tonic::{Request, Response, Status, Streaming};

/// Open streams. Each takes some memory.
const MAX_STREAMS: usize = 4096;
/// Open uploads. Each may take as much disk as the largest asset.
const MAX_UPLOADS: usize = 16;

pub struct Service {
    bakes: Arc<Bakes>,
    stream_quota: Quota,
    upload_quota: Quota,
    /// The slowest permitted upload.
    pace: UploadPace,
}

impl Service {
    pub fn new(bakes: Arc<Bakes>) -> Service {
        let stream_quota = Quota::new(MAX_STREAMS, MAX_STREAMS / 4 * 3);
        Service { bakes, stream_quota, upload_quota: Quota::new(MAX_UPLOADS, MAX_UPLOADS / 2), pace: pace::LEAST }
    }

    /// A permit that a stream holds until it ends.
    fn stream_permit<T>(&self, request: &Request<T>) -> Result<Permit, Fault> {
        self.stream_quota.try_acquire(&caller(request)).ok_or(Fault::TooManyCalls)
    }

    /// Begins a bake that nobody follows.
    async fn create(&self, caller: &Caller, request: CreateBakeRequest) -> Result<Arc<Entry>, Fault> {
        let CreateBakeRequest { spec, labels, priority } = request;
        let request = BakeRequest { spec, labels, priority, ..Default::default() };
        self.submit(caller, request, None).await
    }

    /// The bake of a request, with a preset in the place of the accuracy `auto`.
    async fn submit(
        &self,
        caller: &Caller,
        request: BakeRequest,
        deadline: Option<Instant>,
    ) -> Result<Arc<Entry>, Fault> {
        let of = caller.clone();
        let mut submission = on_disk(move || request::submission(&of, request)).await??;
        submission.spec = self.bakes.with_earlier(caller, submission.spec).await?;
        let submission = self.bakes.with_preset(caller, submission).await?;
        let (bakes, caller) = (self.bakes.clone(), caller.clone());
        on_disk(move || bakes.submit(&caller, submission, deadline)).await?
    }

    fn limits(&self) -> Limits {
        let config = &self.bakes.config;
        Limits {
            max_asset_bytes: to_proto::signed(config.asset_bytes()),
            max_chunk_bytes: to_proto::signed(MAX_CHUNK),
            worker_count: to_proto::signed(config.workers()),
            queue_size: to_proto::signed(config.queue),
            max_bake_memory_bytes: to_proto::signed(self.bakes.memory.each.unwrap_or(0)),
            max_bake_seconds: config.bake_time().unwrap_or_default().as_secs_f64(),
            max_store_bytes: to_proto::signed(config.store_bytes()),
            max_age_seconds: config.store_time().unwrap_or_default().as_secs_f64(),
        }
    }
}

#[tonic::async_trait]
impl PileService for Service {
    async fn get_server_info(
        &self,
        request: Request<GetServerInfoRequest>,
    ) -> Result<Response<GetServerInfoResponse>, Status> {
        let theirs = request.get_ref().protocol_version;
        if theirs > PROTOCOL {
            let what = format!(
                "the client speaks protocol {theirs}, this server (cairn {}) only {PROTOCOL}: update the server",
                cairn_files::version::VERSION
            );
            return Err(Fault::ProtocolMismatch(what).into());
        }
        if theirs < 0 {
            return Err(Fault::field("protocol_version", "it is negative; give 1, or 0 to skip the check").into());
        }
        Ok(Response::new(GetServerInfoResponse {
            versions: Some(versions()),
            protocol_version: PROTOCOL,
            limits: Some(self.limits()),
            accuracy_presets: to_proto::accuracy_presets(),
        }))
    }

    async fn have_assets(&self, request: Request<HaveAssetsRequest>) -> Result<Response<HaveAssetsResponse>, Status> {
        let caller = caller(&request);
        let HaveAssetsRequest { sha256 } = request.into_inner();
        request::check_digests("sha256", &sha256)?;
        let bakes = self.bakes.clone();
        let is_missing = move |sha256: &String| !bakes.store.has(sha256, caller.project());
        let missing_sha256 = on_disk(move || sha256.into_iter().filter(is_missing).collect()).await?;
        Ok(Response::new(HaveAssetsResponse { missing_sha256 }))
    }

    async fn upload_asset(
        &self,
        request: Request<Streaming<UploadAssetRequest>>,
    ) -> Result<Response<UploadAssetResponse>, Status> {
        self.bakes.accepts_work()?;
        let caller = caller(&request);
        let _permit = self.upload_quota.try_acquire(&caller).ok_or(Fault::TooManyCalls)?;
        let began = Instant::now();
        let mut chunks = request.into_inner();
        let most = self.bakes.config.asset_bytes();
        let mut upload = self.bakes.store.upload().map_err(Fault::from)?;
        let mut header = None;
        let mut room = None;
        loop {
            let until = self.pace.until(began, Instant::now(), upload.bytes);
            let next = tokio::time::timeout_at(until, chunks.message()).await;
            let Some(message) = next.map_err(|_| Fault::UploadStalled)?? else { break };
            if let Some(first) = message.header {
                request::check_header(&first, header.is_some(), most)?;
                let (bakes, of, bytes) = (self.bakes.clone(), caller.clone(), first.size_bytes.unsigned_abs());
                room = Some(on_disk(move || bakes.make_room(&of, bytes)).await??);
                header = Some(first);
            }
            let announced = header.as_ref().ok_or_else(|| Fault::field("header", "the first message needs one"))?;
            let bytes = upload.bytes + message.chunk.len() as u64;
            if message.chunk.len() > MAX_CHUNK {
                return Err(Fault::field("chunk", format!("larger than {MAX_CHUNK} bytes; send smaller ones")).into());
            }
            if bytes > announced.size_bytes.unsigned_abs() {
                let what = format!("more than the announced {} bytes", announced.size_bytes);
                return Err(Fault::AssetCorrupt(what).into());
            }
            let written = on_disk(move || upload.write(&message.chunk).map(|()| upload));
            upload = written.await?.map_err(Fault::from)?;
        }
        let header = header.ok_or_else(|| Fault::field("header", "the first message needs one"))?;
        if upload.bytes != header.size_bytes.unsigned_abs() {
            let what = format!("{} bytes instead of the announced {}", upload.bytes, header.size_bytes);
            return Err(Fault::AssetCorrupt(what).into());
        }
        let (bakes, sha256) = (self.bakes.clone(), header.sha256.clone());
        let account = Account::new(caller.project(), &caller.name);
        let kept = on_disk(move || bakes.store.keep(upload, &sha256, &account)).await?;
        drop(room);
        if !kept.map_err(Fault::from)? {
            return Err(Fault::AssetCorrupt("the content does not match the announced SHA-256".into()).into());
        }
        self.bakes.request_trim();
        Ok(Response::new(UploadAssetResponse { sha256: header.sha256, size_bytes: header.size_bytes }))
    }

    async fn plan_bake(&self, request: Request<PlanBakeRequest>) -> Result<Response<PlanBakeResponse>, Status> {
        let caller = caller(&request);
        let spec = on_disk(|| request::checked(request.into_inner().spec)).await??;
        let spec = self.bakes.with_earlier(&caller, spec).await?;
        Ok(Response::new(self.bakes.plan(&caller, spec).await?))
    }

    type BakeStream = ResponseStream<BakeResponse>;

    async fn bake(&self, request: Request<BakeRequest>) -> Result<Response<Self::BakeStream>, Status> {
        let deadline = deadline::of(request.metadata());
        let (permit, caller) = (self.stream_permit(&request)?, caller(&request));
        let (_, call, request) = request.into_parts();
        let frames = request.frames;
        let of_bake = deadline.filter(|_| request.deadline_ends_bake);
        let entry = self.submit(&caller, request, of_bake).await?;
        audit::bake(&call, &entry.id());
        entry.wait_accepted().await?;
        self.bakes.store.touch(&entry.id());
        let follow = Follow { from: 1, frames: request::frames(frames)?, deadline };
        let events = follow.start(&self.bakes, entry, permit);
        Ok(Response::new(Box::pin(events.map(|event| Ok(BakeResponse { event: Some(event?) })))))
    }

    async fn create_bake(&self, request: Request<CreateBakeRequest>) -> Result<Response<CreateBakeResponse>, Status> {
        let caller = caller(&request);
        let (_, call, request) = request.into_parts();
        let entry = self.create(&caller, request).await?;
        audit::bake(&call, &entry.id());
        entry.wait_accepted().await?;
        self.bakes.store.touch(&entry.id());
        let bakes = self.bakes.clone();
        let bake = Some(on_disk(move || bakes.status(&entry)).await??);
        Ok(Response::new(CreateBakeResponse { bake }))
    }

    async fn batch_create_bakes(
        &self,
        request: Request<BatchCreateBakesRequest>,
    ) -> Result<Response<BatchCreateBakesResponse>, Status> {
        let caller = caller(&request);
        let requests = request.into_inner().requests;
        request::check_batch(requests.len())?;
        let mut begun = Vec::new();
        for request in requests {
            begun.push(self.create(&caller, request).await);
        }
        let mut bakes = Vec::new();
        for begun in begun {
            let outcome = match begun {
                Ok(entry) => match entry.accepted().await {
                    Ok(()) => {
                        self.bakes.store.touch(&entry.id());
                        Outcome::Bake(Box::new(BakeStatus { summary: None, ..entry.state().status.clone() }))
                    }
                    Err(failure) => Outcome::Failure(failure),
                },
                Err(fault) => Outcome::Failure((&fault).into()),
            };
            bakes.push(CreatedBake { outcome: Some(outcome) });
        }
        Ok(Response::new(BatchCreateBakesResponse { bakes }))
    }

    type WatchBakeStream = ResponseStream<WatchBakeResponse>;

    async fn watch_bake(&self, request: Request<WatchBakeRequest>) -> Result<Response<Self::WatchBakeStream>, Status> {
        let deadline = deadline::of(request.metadata());
        audit::bake(request.extensions(), &request.get_ref().bake_id);
        let (permit, caller) = (self.stream_permit(&request)?, caller(&request));
        let WatchBakeRequest { bake_id, from_sequence_number: from, frames } = request.into_inner();
        if from < 0 {
            return Err(Fault::field(
                "from_sequence_number",
                format!("{from} is negative; give 0 or 1 for all events"),
            )
            .into());
        }
        let entry = self.bakes.find(&caller, &bake_id)?;
        self.bakes.store.touch(&entry.id());
        let follow = Follow { from, frames: request::frames(frames)?, deadline };
        let events = follow.start(&self.bakes, entry, permit);
        Ok(Response::new(Box::pin(events.map(|event| Ok(WatchBakeResponse { event: Some(event?) })))))
    }

    type AnalysePileStream = ResponseStream<AnalysePileResponse>;

    async fn analyse_pile(
        &self,
        request: Request<AnalysePileRequest>,
    ) -> Result<Response<Self::AnalysePileStream>, Status> {
        let deadline = deadline::of(request.metadata());
        let (permit, caller) = (self.stream_permit(&request)?, caller(&request));
        audit::bake(request.extensions(), &request.get_ref().bake_id);
        let request = request::analysis(request.into_inner())?;
        let mut bake = None;
        if !request.bake_id.is_empty() {
            let entry = self.bakes.find(&caller, &request.bake_id)?;
            let (bakes, of) = (self.bakes.clone(), entry.clone());
            if on_disk(move || bakes.status(&of)).await??.state() != BakeState::Succeeded {
                return Err(Fault::BakeNotDone.into());
            }
            self.bakes.store.touch(&entry.id());
            bake = Some(entry);
        }
        let new = self.bakes.accept_analysis(&caller, request, bake).await?;
        Ok(Response::new(stream::analysis(&self.bakes, new, deadline, permit)))
    }

    async fn get_bake(&self, request: Request<GetBakeRequest>) -> Result<Response<GetBakeResponse>, Status> {
        audit::bake(request.extensions(), &request.get_ref().bake_id);
        let entry = self.bakes.find(&caller(&request), &request.get_ref().bake_id)?;
        let bakes = self.bakes.clone();
        let bake = Some(on_disk(move || bakes.status(&entry)).await??);
        Ok(Response::new(GetBakeResponse { bake }))
    }

    async fn list_bakes(&self, request: Request<ListBakesRequest>) -> Result<Response<ListBakesResponse>, Status> {
        Ok(Response::new(request::page(self.bakes.seen(&caller(&request)), request.get_ref())?))
    }

    async fn cancel_bake(&self, request: Request<CancelBakeRequest>) -> Result<Response<CancelBakeResponse>, Status> {
        audit::bake(request.extensions(), &request.get_ref().bake_id);
        let bake = Some(self.bakes.cancel(&caller(&request), &request.get_ref().bake_id).await?);
        Ok(Response::new(CancelBakeResponse { bake }))
    }

    async fn delete_bake(&self, request: Request<DeleteBakeRequest>) -> Result<Response<DeleteBakeResponse>, Status> {
        audit::bake(request.extensions(), &request.get_ref().bake_id);
        self.bakes.delete(&caller(&request), &request.get_ref().bake_id).await?;
        Ok(Response::new(DeleteBakeResponse {}))
    }

    type DownloadResultStream = ResponseStream<DownloadResultResponse>;

    async fn download_result(
        &self,
        request: Request<DownloadResultRequest>,
    ) -> Result<Response<Self::DownloadResultStream>, Status> {
        audit::bake(request.extensions(), &request.get_ref().bake_id);
        let (permit, caller) = (self.stream_permit(&request)?, caller(&request));
        let DownloadResultRequest { bake_id, artifact, format, file, usd, asset_folder } = request.into_inner();
        let entry = self.bakes.find(&caller, &bake_id)?;
        let Ok(artifact) = Artifact::try_from(artifact) else {
            return Err(Fault::field("artifact", format!("there is no artifact {artifact}")).into());
        };
        let Ok(format) = OutputFormat::try_from(format) else {
            return Err(Fault::field("format", format!("there is no format {format}; see OutputFormat")).into());
        };
        let (bakes, of) = (self.bakes.clone(), entry.clone());
        let status = on_disk(move || bakes.status(&of)).await??;
        if artifact != Artifact::Scene && status.state() != BakeState::Succeeded {
            return Err(Fault::BakeNotDone.into());
        }
        self.bakes.store.touch(&entry.id());
        let own = Format::from_wire(status.format());
        let format = if format == OutputFormat::Unspecified { own } else { Format::from_wire(format) };
        let (bakes, of) = (self.bakes.clone(), entry.clone());
        let layout = on_disk(move || bakes.other_layout(&of, format, usd, asset_folder)).await??;
        let kind =
            layout.as_ref().map_or_else(|| ResultKind::of(format), |layout| ResultKind::laid_out(format, layout));
        let (name, first) = match artifact {
            Artifact::Unspecified | Artifact::Result => {
                let head = self.bakes.result(&caller, &entry, &kind, layout.as_deref()).await?.result;
                match head.files.iter().find(|beside| beside.name == file) {
                    _ if file.is_empty() => (kind.result_name(), head),
                    Some(beside) => {
                        let sha256 = beside.sha256.clone();
                        (beside.name.clone(), DownloadResultResponse { sha256, ..Default::default() })
                    }
                    None => {
                        let what = format!("no file beside the result has the name {file:?}; `files` lists them");
                        return Err(Fault::field("file", what).into());
                    }
                }
            }
            Artifact::Report => {
                let name = if kind == ResultKind::of(own) { REPORT.to_owned() } else { kind.report_name() };
                (name, self.bakes.result(&caller, &entry, &kind, layout.as_deref()).await?.report)
            }
            Artifact::Scene => (SCENE.to_owned(), DownloadResultResponse::default()),
        };
        let path = self.bakes.store.folder(&entry.id()).join(name);
        Ok(Response::new(Download { path, first }.start(&self.bakes, entry, permit).await?))
    }
}
