//! The service without sockets, for tests that send it arbitrary bytes.

use crate::api::pile_service_server::PileServiceServer;
use crate::calls::Service;
use crate::config::Config;
use crate::jobs::Bakes;
use crate::store::Store;
use bytes::Bytes;
use http_body_util::{BodyExt, Full};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Runtime;
use tonic::body::Body;
use tonic::codec::CompressionEncoding;
use tonic::codegen::{Service as _, http};

/// A service on a data directory.
pub struct InProcess {
    runtime: Runtime,
    bakes: Arc<Bakes>,
    service: PileServiceServer<Service>,
}

impl InProcess {
    pub fn new(data: &Path) -> std::io::Result<InProcess> {
        InProcess::with(Config { data: data.to_owned(), asset_mib: 1, ..Config::default() })
    }

    pub fn with(config: Config) -> std::io::Result<InProcess> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let store = Store::open(&config)?;
        let bakes = Bakes::new(config, store, None);
        let service = PileServiceServer::new(Service::new(bakes.clone()));
        Ok(InProcess { runtime, bakes, service: service.accept_compressed(CompressionEncoding::Gzip) })
    }

    /// Waits until no bake runs or waits.
    pub fn rest(&self) {
        self.runtime.block_on(async {
            while self.bakes.are_at_work() {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        });
    }

    /// Calls a method with these bytes. Returns the gRPC status code, if there is one.
    pub fn call(&mut self, method: &str, encoding: &str, bytes: Vec<u8>) -> Option<i32> {
        self.answer(method, encoding, bytes)?.0
    }

    /// As `call`, with the bytes of the answer.
    pub fn answer(&mut self, method: &str, encoding: &str, bytes: Vec<u8>) -> Option<(Option<i32>, Bytes)> {
        let request = http::Request::post(format!("/cairn.v1.PileService/{method}"))
            .header("content-type", "application/grpc")
            .header("grpc-encoding", encoding)
            .body(Body::new(Full::new(bytes.into())))
            .ok()?;
        let InProcess { runtime, service, .. } = self;
        runtime.block_on(async {
            let response = service.call(request).await.ok()?;
            let status = |headers: &http::HeaderMap| headers.get("grpc-status")?.to_str().ok()?.parse().ok();
            let (head, body) = response.into_parts();
            let body = body.collect().await.ok()?;
            let trailers = body.trailers().cloned();
            let code = status(&head.headers).or_else(|| status(&trailers?));
            Some((code, body.to_bytes()))
        })
    }
}
