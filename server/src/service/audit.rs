//! One line in the log for each call, once it has ended: who called what, of which bake, and what came of it.

use bytes::Bytes;
use http_body_util::BodyExt;
use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, OnceLock};
use std::task::{Context, Poll};
use std::time::Instant;
use tonic::body::Body;
use tonic::codegen::{Body as HttpBody, Service, StdError, http};
use tonic::server::NamedService;
use tracing::info;

/// A service whose calls are told, refused ones, too: it stands before what lets calls in.
#[derive(Clone)]
pub struct Audit<S>(pub S);

/// What a call's line will tell, among the call's extensions: whoever finds it out adds it.
#[derive(Default)]
struct Known {
    caller: OnceLock<String>,
    bake: OnceLock<String>,
}

/// Who makes this call.
pub fn caller(call: &http::Extensions, name: &str) {
    if let Some(known) = call.get::<Arc<Known>>() {
        let _ = known.caller.set(name.to_owned());
    }
}

/// The bake that this call is about.
pub fn bake(call: &http::Extensions, id: &str) {
    /// Letters of an id. Callers may give any text for one.
    const LONGEST: usize = 64;
    if let Some(known) = call.get::<Arc<Known>>() {
        let _ = known.bake.set(id.chars().take(LONGEST).collect());
    }
}

/// A call, told when the value goes.
struct Call {
    name: String,
    began: Instant,
    known: Arc<Known>,
    /// gRPC's number, as it was sent. `None`: the caller went away before.
    status: Option<String>,
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
        let Known { caller, bake } = &*self.known;
        info!(
            target: "cairn::audit",
            caller = caller.get().map_or("", String::as_str),
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

impl<S, Asked, Answer> Service<http::Request<Asked>> for Audit<S>
where
    S: Service<http::Request<Asked>, Response = http::Response<Answer>>,
    S::Future: Send + 'static,
    Answer: HttpBody<Data = Bytes> + Send + 'static,
    Answer::Error: Into<StdError>,
{
    type Response = http::Response<Body>;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, S::Error>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.0.poll_ready(context)
    }

    fn call(&mut self, mut request: http::Request<Asked>) -> Self::Future {
        let known = Arc::<Known>::default();
        request.extensions_mut().insert(known.clone());
        let name = request.uri().path().rsplit('/').next().unwrap_or_default().to_owned();
        let mut call = Call { name, began: Instant::now(), known, status: None };
        let answer = self.0.call(request);
        Box::pin(async move {
            let answer = answer.await?;
            // A status before the first message is told in the headers, one after the last in the trailers.
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
