//! What requests hold in memory while they arrive: bounded for each caller and for all, in bytes and in time.

use crate::access::Caller;
use crate::calls::pace::{LEAST, UploadPace};
use crate::status::Fault;
use bytes::Bytes;
use std::collections::BTreeMap;
use std::future::Future as _;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};
use tokio::time::{Instant, Sleep, sleep_until};
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::{Body as HttpBody, Service, http};
use tonic::server::NamedService;

/// Bytes of requests that have not arrived in full: of one caller, and of all.
const MOST: [usize; 2] = [96 << 20, 256 << 20];
/// The call whose messages are used up as they arrive, and which has bounds of its own.
const UPLOAD: &str = "/UploadAsset";

/// Bounds the requests of a service. Within the authentication, so that callers are known.
#[derive(Clone)]
pub struct Incoming<S> {
    service: S,
    held: Arc<Held>,
    pace: UploadPace,
    most: [usize; 2],
}

impl<S> Incoming<S> {
    pub fn new(service: S) -> Incoming<S> {
        Incoming { service, held: Arc::default(), pace: LEAST, most: MOST }
    }
}

/// Bytes that are held, by caller.
#[derive(Default)]
struct Held(Mutex<BTreeMap<Arc<str>, usize>>);

impl Held {
    /// Adds bytes of a caller, unless that is too much.
    fn take(&self, caller: &Arc<str>, bytes: usize, [of_one, of_all]: [usize; 2]) -> bool {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let all: usize = held.values().sum();
        let own = held.entry(caller.clone()).or_default();
        let fits = *own + bytes <= of_one && all + bytes <= of_all;
        if fits {
            *own += bytes;
        }
        fits
    }

    fn give_back(&self, caller: &Arc<str>, bytes: usize) {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = held.get_mut(caller) {
            *own -= bytes;
            if *own == 0 {
                held.remove(caller);
            }
        }
    }
}

impl<S: NamedService> NamedService for Incoming<S> {
    const NAME: &'static str = S::NAME;
}

impl<S: Service<http::Request<Body>>> Service<http::Request<Body>> for Incoming<S> {
    type Response = S::Response;
    type Error = S::Error;
    type Future = S::Future;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.service.poll_ready(context)
    }

    fn call(&mut self, request: http::Request<Body>) -> S::Future {
        if request.uri().path().ends_with(UPLOAD) {
            return self.service.call(request);
        }
        let caller = request.extensions().get::<Caller>().map_or_else(|| "".into(), |caller| caller.name.clone());
        let now = Instant::now();
        let request = request.map(|body| {
            Body::new(HeldBody {
                body,
                held: self.held.clone(),
                caller,
                bytes: 0,
                began: now,
                until: Box::pin(sleep_until(self.pace.until(now, now, 0))),
                pace: self.pace,
                most: self.most,
            })
        });
        self.service.call(request)
    }
}

/// The body of a request that counts what has arrived of it.
struct HeldBody {
    body: Body,
    held: Arc<Held>,
    caller: Arc<str>,
    bytes: usize,
    began: Instant,
    /// When the next piece must be here.
    until: Pin<Box<Sleep>>,
    pace: UploadPace,
    most: [usize; 2],
}

impl HttpBody for HeldBody {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<http_body::Frame<Bytes>, Status>>> {
        if self.until.as_mut().poll(context).is_ready() {
            return Poll::Ready(Some(Err(Fault::Deadline.into())));
        }
        let Some(frame) = ready!(Pin::new(&mut self.body).poll_frame(context)).transpose()? else {
            return Poll::Ready(None);
        };
        if let Some(data) = frame.data_ref() {
            let bytes = data.len();
            if !self.held.take(&self.caller, bytes, self.most) {
                return Poll::Ready(Some(Err(Fault::TooManyCalls.into())));
            }
            self.bytes += bytes;
            let until = self.pace.until(self.began, Instant::now(), self.bytes as u64);
            self.until.as_mut().reset(until);
        }
        Poll::Ready(Some(Ok(frame)))
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> http_body::SizeHint {
        self.body.size_hint()
    }
}

impl Drop for HeldBody {
    fn drop(&mut self) {
        self.held.give_back(&self.caller, self.bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was answered to a request of these chunks: bytes, or the status.
    async fn sent(incoming: &Incoming<Take>, caller: &str, chunks: usize, each: usize) -> Result<usize, Status> {
        let chunk = move |_| Ok::<_, Status>(http_body::Frame::data(Bytes::from(vec![0; each])));
        let body = http_body_util::StreamBody::new(tokio_stream::StreamExt::map(tokio_stream::iter(0..chunks), chunk));
        let mut request = http::Request::new(Body::new(body));
        *request.uri_mut() = "/cairn.v1.PileService/PlanBake".parse().unwrap();
        request.extensions_mut().insert(Caller {
            name: caller.into(),
            role: crate::access::CallerRole::Artist,
            limits: crate::access::CallerLimits::default(),
            project: None,
        });
        incoming.clone().call(request).await
    }

    /// Reads a body to its end, and keeps it until then.
    #[derive(Clone)]
    struct Take;

    impl Service<http::Request<Body>> for Take {
        type Response = usize;
        type Error = Status;
        type Future = Pin<Box<dyn Future<Output = Result<usize, Status>> + Send>>;

        fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Status>> {
            Poll::Ready(Ok(()))
        }

        fn call(&mut self, request: http::Request<Body>) -> Self::Future {
            Box::pin(async move {
                let whole = http_body_util::BodyExt::collect(request.into_body()).await?;
                Ok(whole.to_bytes().len())
            })
        }
    }

    #[tokio::test]
    async fn a_caller_holds_no_more_than_its_share() {
        let incoming = Incoming { most: [1000, 1500], ..Incoming::new(Take) };
        assert_eq!(sent(&incoming, "anna", 10, 100).await.unwrap(), 1000);
        let refused = sent(&incoming, "anna", 11, 100).await.unwrap_err();
        assert_eq!(refused.code(), tonic::Code::ResourceExhausted);
        assert!(incoming.held.0.lock().unwrap().is_empty(), "all is given back");
        assert!(incoming.held.take(&"bob".into(), 900, incoming.most));
        assert_eq!(sent(&incoming, "anna", 6, 100).await.unwrap(), 600);
        assert!(sent(&incoming, "anna", 7, 100).await.is_err(), "of all together");
        incoming.held.give_back(&"bob".into(), 900);
        assert_eq!(sent(&incoming, "anna", 7, 100).await.unwrap(), 700);
    }

    #[tokio::test]
    async fn a_request_that_does_not_go_on_is_ended() {
        let pace = UploadPace { pause: std::time::Duration::from_millis(50), ..LEAST };
        let incoming = Incoming { pace, ..Incoming::new(Take) };
        let mut request = http::Request::new(Body::new(http_body_util::StreamBody::new(tokio_stream::pending::<
            Result<http_body::Frame<Bytes>, Status>,
        >())));
        *request.uri_mut() = "/cairn.v1.PileService/PlanBake".parse().unwrap();
        let refused = incoming.clone().call(request).await.unwrap_err();
        assert_eq!(refused.code(), tonic::Code::DeadlineExceeded);
    }
}
