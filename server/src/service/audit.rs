//! One line in the log for each call: who called what, and what came of it.

use crate::service::access::Caller;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Instant;
use tonic::codegen::{Service, http};
use tonic::server::NamedService;
use tracing::info;

/// A service whose calls are told. It stands behind what lets calls in, which knows the caller.
#[derive(Clone)]
pub struct Audit<S>(pub S);

impl<S: NamedService> NamedService for Audit<S> {
    const NAME: &'static str = S::NAME;
}

impl<S, Body, Answer> Service<http::Request<Body>> for Audit<S>
where
    S: Service<http::Request<Body>, Response = http::Response<Answer>>,
    S::Future: Send + 'static,
{
    type Response = S::Response;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<S::Response, S::Error>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.0.poll_ready(context)
    }

    fn call(&mut self, request: http::Request<Body>) -> Self::Future {
        let began = Instant::now();
        let call = request.uri().path().rsplit('/').next().unwrap_or_default().to_owned();
        let caller = request.extensions().get::<Caller>().map(|caller| caller.name.clone()).unwrap_or_default();
        let answer = self.0.call(request);
        Box::pin(async move {
            let answer = answer.await?;
            // An error before the first message is told in the headers.
            let status = answer.headers().get("grpc-status").and_then(|status| status.to_str().ok()).unwrap_or("0");
            let milliseconds = began.elapsed().as_millis() as u64;
            info!(target: "cairn::audit", caller = &*caller, call, status, milliseconds, "call");
            Ok(answer)
        })
    }
}
