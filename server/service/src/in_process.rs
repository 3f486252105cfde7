//! The service without sockets, for tests that send it arbitrary bytes.

use crate::api::pile_service_server::PileServiceServer;
use crate::calls::Service;
use crate::config::Config;
use crate::jobs::Bakes;
use crate::store::Store;
use http_body_util::{BodyExt, Full};
use std::path::Path;
use tokio::runtime::Runtime;
use tonic::body::Body;
use tonic::codec::CompressionEncoding;
use tonic::codegen::{Service as _, http};

/// A service on a data directory.
pub struct InProcess {
    runtime: Runtime,
    service: PileServiceServer<Service>,
}

impl InProcess {
    pub fn new(data: &Path) -> std::io::Result<InProcess> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let config = Config { data: data.to_owned(), asset_mib: 1, ..Config::default() };
        let store = Store::open(&config)?;
        let service = PileServiceServer::new(Service::new(Bakes::new(config, store, None)));
        Ok(InProcess { runtime, service: service.accept_compressed(CompressionEncoding::Gzip) })
    }

    /// Calls a method with these bytes. Returns the gRPC status code, if there is one.
    pub fn call(&mut self, method: &str, encoding: &str, bytes: Vec<u8>) -> Option<i32> {
        let request = http::Request::post(format!("/cairn.v1.PileService/{method}"))
            .header("content-type", "application/grpc")
            .header("grpc-encoding", encoding)
            .body(Body::new(Full::new(bytes.into())))
            .ok()?;
        let InProcess { runtime, service } = self;
        runtime.block_on(async {
            let response = service.call(request).await.ok()?;
            let status = |headers: &http::HeaderMap| headers.get("grpc-status")?.to_str().ok()?.parse().ok();
            let (head, body) = response.into_parts();
            let trailers = body.collect().await.ok()?.trailers().cloned();
            status(&head.headers).or_else(|| status(&trailers?))
        })
    }
}
