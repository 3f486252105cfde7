//! A log line for each call when it ends: caller, call, bake and status.

use crate::status::detailed;
use bytes::Bytes;
use http_body_util::BodyExt;
use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::{Body as HttpBody, Service, StdError, http};
use tonic::server::NamedService;
use tracing::info;

/// Logs and counts the calls of a service. It wraps the authentication, so that refused calls are logged, too.
#[derive(Clone)]
pub struct Audit<S> {
    pub service: S,
    pub open: Arc<OpenCalls>,
}

/// The number of calls that have not ended.
#[derive(Default)]
pub struct OpenCalls(watch::Sender<usize>);

impl OpenCalls {
    pub fn are_some(&self) -> bool {
        *self.0.borrow() > 0
    }

    /// Resolves once no call has been open for a while: a caller whose bake has ended fetches its report and its result
    /// one after the other.
    pub async fn all_ended(&self) {
        const WHILE: Duration = Duration::from_secs(1);
        let mut count = self.0.subscribe();
        loop {
            let _ = count.wait_for(|count| *count == 0).await;
            if tokio::time::timeout(WHILE, count.changed()).await.is_err() {
                return;
            }
        }
    }
}

/// Details for a call's log line, kept in the call's extensions and filled in while the call is processed.
#[derive(Default)]
struct CallDetails {
    caller: OnceLock<String>,
    project: OnceLock<String>,
    bake: OnceLock<String>,
}

/// Records the caller and its project; an empty one is none.
pub fn caller(call: &http::Extensions, name: &str, project: &str) {
    if let Some(known) = call.get::<Arc<CallDetails>>() {
        let _ = known.caller.set(name.to_owned());
        if !project.is_empty() {
            let _ = known.project.set(project.to_owned());
        }
    }
}

/// Records the bake that a call is about.
pub fn bake(call: &http::Extensions, id: &str) {
    /// Longest id in a log line. Callers may send any text.
    const LONGEST: usize = 64;
    if let Some(known) = call.get::<Arc<CallDetails>>() {
        let _ = known.bake.set(id.chars().take(LONGEST).collect());
    }
}

/// A call. Dropping it writes the log line.
struct Call {
    name: String,
    began: Instant,
    known: Arc<CallDetails>,
    /// The gRPC status code that was sent. `None`: the caller left before.
    status: Option<String>,
    open: Arc<OpenCalls>,
}

impl Call {
    fn ends(&mut self, head: &http::HeaderMap) {
        if let Some(status) = head.get("grpc-status").and_then(|status| status.to_str().ok()) {
            self.status = Some(status.to_owned());
        }
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        const CANCELLED: &str = "1";
        self.open.0.send_modify(|count| *count -= 1);
        let CallDetails { caller, project, bake } = &*self.known;
        info!(
            target: "cairn::audit",
            caller = caller.get().map_or("", String::as_str),
            project = project.get().map(String::as_str),
            call = self.name,
            status = self.status.as_deref().unwrap_or(CANCELLED),
            bake = bake.get().map(String::as_str),
            milliseconds = self.began.elapsed().as_millis() as u64,
            "call"
        );
    }
}

impl<S: NamedService> NamedService for Audit<S> {
    const NAME: &'static str = S::NAME;
}

impl<S, Sent, Answer> Service<http::Request<Sent>> for Audit<S>
where
    S: Service<http::Request<Sent>, Response = http::Response<Answer>>,
    S::Future: Send + 'static,
    Answer: HttpBody<Data = Bytes> + Send + 'static,
    Answer::Error: Into<StdError>,
{
    type Response = http::Response<Body>;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, S::Error>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.service.poll_ready(context)
    }

    fn call(&mut self, mut request: http::Request<Sent>) -> Self::Future {
        let known = Arc::<CallDetails>::default();
        request.extensions_mut().insert(known.clone());
        let name = request.uri().path().rsplit('/').next().unwrap_or_default().to_owned();
        self.open.0.send_modify(|count| *count += 1);
        let mut call = Call { name, began: Instant::now(), known, status: None, open: self.open.clone() };
        let answer = self.service.call(request);
        Box::pin(async move {
            let answer = answer.await?;
            let error = Status::from_header_map(answer.headers());
            if let Some(error) = error.as_ref().and_then(detailed) {
                let answer = error.into_http::<Body>();
                call.ends(answer.headers());
                return Ok(answer);
            }
            // A status before the first message is in the headers, one after the last message in the trailers.
            call.ends(answer.headers());
            Ok(answer.map(|body| {
                Body::new(body.map_frame(move |frame| {
                    frame.trailers_ref().into_iter().for_each(|trailers| call.ends(trailers));
                    frame
                }))
            }))
        })
    }
}
