//! A client of the service: a connection to a `cairn serve`.

use crate::api::pile_service_client::PileServiceClient;
use bytes::Bytes;
use cairn_wire::proto::{
    AnalysePileRequest, AnalysePileResponse, Artifact, AssetHeader, BakeEvent, BakeRequest, BakeSpec, BakeStatus,
    CancelBakeRequest, DeleteBakeRequest, DownloadResultRequest, DownloadResultResponse, FrameSelection,
    GetBakeRequest, GetServerInfoRequest, HaveAssetsRequest, ListBakesRequest, PlanBakeRequest, PlanBakeResponse,
    UploadAssetRequest, WatchBakeRequest, bake_event::Kind,
};
use cairn_wire::versions::PROTOCOL;
use std::collections::BTreeMap;
use std::time::Duration;
use tokio_stream::StreamExt;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint, Identity};
use tonic::{Code, Request, Status};
use tonic_types::StatusExt;

/// How to reach a server.
#[derive(Clone, Debug, Default)]
pub struct Target {
    /// `HOST:PORT` or `unix:PATH`; `https://HOST:PORT` encrypts the connection without a `ca`.
    pub address: String,
    pub token: Option<String>,
    /// Certificate of the authority that signed the server's certificate, PEM. Encrypts the connection.
    pub ca: Option<Vec<u8>>,
    /// Certificate and key of the caller, PEM.
    pub identity: Option<(Vec<u8>, Vec<u8>)>,
    /// Text by which a proxy in front of several servers chooses one.
    pub route: Option<String>,
}

#[derive(Clone)]
pub struct Connection {
    pub service: PileServiceClient<InterceptedService<Channel, CallHeaders>>,
}

/// Adds token and route to each call.
#[derive(Clone)]
pub struct CallHeaders(Vec<(&'static str, MetadataValue<Ascii>)>);

impl CallHeaders {
    fn of(target: &Target) -> Result<CallHeaders, Status> {
        let token = target.token.as_ref().map(|token| ("authorization", format!("Bearer {token}")));
        let route = target.route.as_ref().map(|route| (ROUTE, route.clone()));
        let parse = |(name, value): (&'static str, String)| {
            let wrong =
                |_| Status::unauthenticated(format!("the value of `{name}` has characters that headers forbid"));
            value.parse().map(|value| (name, value)).map_err(wrong)
        };
        token.into_iter().chain(route).map(parse).collect::<Result<_, _>>().map(CallHeaders)
    }
}

impl tonic::service::Interceptor for CallHeaders {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        for (name, value) in &self.0 {
            request.metadata_mut().insert(*name, value.clone());
        }
        Ok(request)
    }
}

/// The header by which proxies choose a server.
const ROUTE: &str = "cairn-route";

/// Bytes of a chunk of an upload.
const CHUNK: usize = 64 << 10;
/// Consecutive attempts to resume a broken stream, or to repeat a call. The pause before each doubles.
const ATTEMPTS: u32 = 6;
/// The same after a server has said that it shuts down: the next one comes once its bakes have ended.
const ATTEMPTS_AT_RESTART: u32 = 9;
const FIRST_PAUSE: Duration = Duration::from_millis(200);

/// Counts the attempts since something last went well.
#[derive(Default)]
struct Attempts {
    attempts: u32,
    is_restart: bool,
}

impl Attempts {
    /// Pauses before another attempt, if there is to be one after this error: a broken connection ends with one of
    /// these codes, and so do the calls of a server that shuts down.
    async fn again(&mut self, error: Status) -> Result<(), Status> {
        let is_broken = matches!(error.code(), Code::Unavailable | Code::Unknown);
        self.is_restart |= is_shutting_down(&error);
        if !is_broken || self.attempts == if self.is_restart { ATTEMPTS_AT_RESTART } else { ATTEMPTS } {
            return Err(error);
        }
        tokio::time::sleep(FIRST_PAUSE * 2u32.pow(self.attempts)).await;
        self.attempts += 1;
        Ok(())
    }
}

/// Whether a server refuses new work, or stops a bake, because it shuts down: another one takes over.
fn is_shutting_down(status: &Status) -> bool {
    status.get_error_details().error_info().is_some_and(|info| info.reason == "SHUTTING_DOWN")
}

/// A downloaded file.
pub struct Downloaded {
    pub bytes: Vec<u8>,
    /// The first message, which describes it.
    pub first: DownloadResultResponse,
}

impl Connection {
    /// Connects, and checks that the server speaks this protocol version.
    pub async fn open(target: &Target) -> Result<Connection, Status> {
        let wrong = |error: tonic::transport::Error| {
            let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}")).unwrap_or_default();
            Status::unavailable(format!("{}: {error}{cause}", target.address))
        };
        let has_scheme = target.address.starts_with("unix:") || target.address.contains("://");
        let encrypted = target.ca.is_some() || target.identity.is_some() || target.address.starts_with("https://");
        let uri = match has_scheme {
            true => target.address.clone(),
            false if encrypted => format!("https://{}", target.address),
            false => format!("http://{}", target.address),
        };
        let mut endpoint = Endpoint::from_shared(uri).map_err(wrong)?.connect_timeout(Duration::from_secs(10));
        if encrypted {
            let mut tls = ClientTlsConfig::new();
            if let Some(ca) = &target.ca {
                tls = tls.ca_certificate(Certificate::from_pem(ca));
            }
            if let Some((certificate, key)) = &target.identity {
                tls = tls.identity(Identity::from_pem(certificate, key));
            }
            endpoint = endpoint.tls_config(tls).map_err(wrong)?;
        }
        let headers = CallHeaders::of(target)?;
        let channel = endpoint.connect().await.map_err(wrong)?;
        let mut service = PileServiceClient::with_interceptor(channel, headers);
        service.get_server_info(GetServerInfoRequest { protocol_version: PROTOCOL }).await?;
        Ok(Connection { service })
    }

    /// Uploads the contents that the server lacks. The keys are their SHA-256. If the server shuts down, this waits
    /// for the next one.
    pub async fn upload(&mut self, contents: &BTreeMap<String, Bytes>) -> Result<(), Status> {
        let mut attempts = Attempts::default();
        loop {
            match self.upload_once(contents).await {
                Err(error) if attempts.is_restart || is_shutting_down(&error) => attempts.again(error).await?,
                ended => return ended,
            }
        }
    }

    async fn upload_once(&mut self, contents: &BTreeMap<String, Bytes>) -> Result<(), Status> {
        let sha256 = contents.keys().cloned().collect();
        let missing = self.service.have_assets(HaveAssetsRequest { sha256 }).await?.into_inner().missing_sha256;
        for sha256 in missing {
            let Some(content) = contents.get(&sha256).cloned() else { continue };
            let header = AssetHeader { sha256, size_bytes: cairn_wire::to_proto::signed(content.len()) };
            let first = UploadAssetRequest { header: Some(header), chunk: Bytes::new() };
            let chunks = (0..content.len()).step_by(CHUNK).map(move |start| {
                let end = content.len().min(start + CHUNK);
                UploadAssetRequest { header: None, chunk: content.slice(start..end) }
            });
            self.service.upload_asset(tokio_stream::iter([first].into_iter().chain(chunks))).await?;
        }
        Ok(())
    }

    /// Bakes, and passes on all events except frames, to the end. Returns the bake's id.
    pub async fn bake(&mut self, request: BakeRequest, on_event: impl FnMut(BakeEvent)) -> Result<String, Status> {
        let request = BakeRequest { frames: FrameSelection::None.into(), ..request };
        let mut attempts = Attempts::default();
        let events = loop {
            match self.service.bake(request.clone()).await {
                Ok(events) => break events.into_inner(),
                Err(error) if attempts.is_restart || is_shutting_down(&error) => attempts.again(error).await?,
                Err(error) => return Err(error),
            }
        };
        let events = events.map(|response| response.map(|response| response.event));
        let ended = self.follow(Box::pin(events), String::new(), on_event).await;
        ended.map_err(|status| match status.code() {
            // Behind a proxy, another server may answer, which does not know the bake.
            Code::NotFound => Status::unavailable(format!("the bake is lost: {}", status.message())),
            _ => status,
        })
    }

    /// Passes on all events of a bake except frames, to the end.
    pub async fn watch(&mut self, id: &str, on_event: impl FnMut(BakeEvent)) -> Result<String, Status> {
        let events = self.events_from(id, 1).await?;
        self.follow(events, id.to_owned(), on_event).await
    }

    async fn events_from(&mut self, id: &str, from: i64) -> Result<EventStream, Status> {
        let frames = FrameSelection::None.into();
        let request = WatchBakeRequest { bake_id: id.to_owned(), from_sequence_number: from, frames };
        let events = self.service.watch_bake(request).await?.into_inner();
        Ok(Box::pin(events.map(|response| response.map(|response| response.event))))
    }

    /// Resumes a broken stream after the last event.
    async fn follow(
        &mut self,
        mut events: EventStream,
        mut id: String,
        mut on_event: impl FnMut(BakeEvent),
    ) -> Result<String, Status> {
        let (mut last, mut attempts) = (0, Attempts::default());
        loop {
            let broken = match events.next().await {
                None => return Ok(id),
                Some(Ok(None)) => continue,
                Some(Ok(Some(event))) => {
                    if let Some(Kind::Accepted(accepted)) = &event.kind {
                        id.clone_from(&accepted.bake_id);
                    }
                    last = last.max(event.sequence_number);
                    attempts = Attempts::default();
                    on_event(event);
                    continue;
                }
                Some(Err(status)) => status,
            };
            if id.is_empty() {
                return Err(broken);
            }
            attempts.again(broken).await?;
            events = loop {
                match self.events_from(&id, last + 1).await {
                    Ok(events) => break events,
                    Err(status) => attempts.again(status).await?,
                }
            };
        }
    }

    /// The plan of a bake whose files are there.
    pub async fn plan(&mut self, spec: BakeSpec) -> Result<PlanBakeResponse, Status> {
        Ok(self.service.plan_bake(PlanBakeRequest { spec: Some(spec) }).await?.into_inner())
    }

    /// The messages of an analysis, to the end. `on_progress`: gets the finished share.
    pub async fn analyse(
        &mut self,
        request: AnalysePileRequest,
        mut on_progress: impl FnMut(f64),
    ) -> Result<Vec<AnalysePileResponse>, Status> {
        let mut messages = self.service.analyse_pile(request).await?.into_inner();
        let mut parts = Vec::new();
        while let Some(message) = messages.message().await? {
            on_progress(message.fraction);
            if message != (AnalysePileResponse { fraction: message.fraction, ..Default::default() }) {
                parts.push(message);
            }
        }
        Ok(parts)
    }

    /// The status of a bake.
    pub async fn status(&mut self, id: &str) -> Result<BakeStatus, Status> {
        let answer = self.service.get_bake(GetBakeRequest { bake_id: id.to_owned() }).await?.into_inner();
        Ok(answer.bake.unwrap_or_default())
    }

    /// The latest bakes that a request selects, at most so many.
    pub async fn list(&mut self, mut request: ListBakesRequest, most: usize) -> Result<Vec<BakeStatus>, Status> {
        let mut bakes = Vec::new();
        loop {
            let page = self.service.list_bakes(request.clone()).await?.into_inner();
            bakes.extend(page.bakes);
            if page.next_page_token.is_empty() || bakes.len() >= most {
                bakes.truncate(most);
                return Ok(bakes);
            }
            request.page_token = page.next_page_token;
        }
    }

    pub async fn delete(&mut self, id: &str) -> Result<(), Status> {
        self.service.delete_bake(DeleteBakeRequest { bake_id: id.to_owned() }).await?;
        Ok(())
    }

    pub async fn cancel(&mut self, id: &str) -> Result<(), Status> {
        self.service.cancel_bake(CancelBakeRequest { bake_id: id.to_owned() }).await?;
        Ok(())
    }

    /// A file of a finished bake, as it was made with the bake.
    pub async fn download(&mut self, id: &str, artifact: Artifact) -> Result<Vec<u8>, Status> {
        let request = DownloadResultRequest { bake_id: id.to_owned(), artifact: artifact.into(), ..Default::default() };
        Ok(self.download_file(&request).await?.bytes)
    }

    /// A file of a finished bake. A broken transfer is repeated.
    pub async fn download_file(&mut self, request: &DownloadResultRequest) -> Result<Downloaded, Status> {
        let mut attempts = Attempts::default();
        loop {
            match self.download_once(request.clone()).await {
                Ok(file) => return Ok(file),
                Err(error) => attempts.again(error).await?,
            }
        }
    }

    async fn download_once(&mut self, request: DownloadResultRequest) -> Result<Downloaded, Status> {
        let mut parts = self.service.download_result(request).await?.into_inner();
        let (mut bytes, mut first) = (Vec::new(), None);
        while let Some(part) = parts.message().await? {
            bytes.extend_from_slice(&part.chunk);
            first.get_or_insert(part);
        }
        match first {
            Some(first) if Ok(bytes.len()) == usize::try_from(first.size_bytes) => Ok(Downloaded { bytes, first }),
            _ => Err(Status::unavailable("the transfer of a file ended early")),
        }
    }
}

type EventStream = std::pin::Pin<Box<dyn tokio_stream::Stream<Item = Result<Option<BakeEvent>, Status>> + Send>>;
