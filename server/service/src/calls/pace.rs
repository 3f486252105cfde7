//! The slowest permitted upload. Only a few uploads may be open, so a stalled one has to end.

use std::time::Duration;
use tokio::time::Instant;

#[derive(Clone, Copy)]
pub struct UploadPace {
    /// Longest wait for a chunk.
    pub pause: Duration,
    /// Bytes required for each second after the first pause.
    pub bytes_per_second: u64,
}

/// Lower bound on upload speed.
pub const LEAST: UploadPace = UploadPace { pause: Duration::from_secs(60), bytes_per_second: 16 << 10 };

impl UploadPace {
    /// The deadline of the next chunk, for an upload that began at `began` and has sent `bytes` until `now`.
    pub fn until(&self, began: Instant, now: Instant, bytes: u64) -> Instant {
        let slowest = began + self.pause + Duration::from_secs(bytes / self.bytes_per_second);
        slowest.min(now + self.pause)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::pile_service_client::PileServiceClient;
    use crate::api::pile_service_server::PileServiceServer;
    use crate::calls::Service;
    use crate::config::Config;
    use crate::jobs::Bakes;
    use crate::store::Store;
    use cairn_wire::digest::hex;
    use cairn_wire::proto::{AssetHeader, UploadAssetRequest};
    use sha2::{Digest, Sha256};
    use tokio_stream::StreamExt;
    use tonic_types::StatusExt;

    #[test]
    fn a_fast_enough_upload_continues() {
        let began = Instant::now();
        let after = |seconds: u64| began + Duration::from_secs(seconds);
        assert_eq!(LEAST.until(began, after(0), 0), after(60));
        assert_eq!(LEAST.until(began, after(50), 0), after(60), "a byte now and then does not put it off");
        assert_eq!(LEAST.until(began, after(50), 100 * (16 << 10)), after(110), "no pause is longer");
        assert_eq!(LEAST.until(began, after(150), 100 * (16 << 10)), after(160));
    }

    /// A byte each hundredth of a second, without a pause between them.
    #[tokio::test]
    async fn an_upload_that_drips_is_ended() {
        const BYTES: usize = 1000;
        let folder = tempfile::tempdir().unwrap();
        let config = Config { data: folder.path().join("data"), ..Config::default() };
        let store = Store::open(&config).unwrap();
        let pace = UploadPace { pause: Duration::from_millis(300), ..LEAST };
        let service = Service { pace, ..Service::new(Bakes::new(config, store, None)) };
        let sha256 = hex(&Sha256::digest([7; BYTES]));
        let header = Some(AssetHeader { sha256, size_bytes: BYTES as i64 });
        let first = UploadAssetRequest { header, ..Default::default() };
        let drops = tokio_stream::iter(0..BYTES).then(|_| async {
            tokio::time::sleep(Duration::from_millis(10)).await;
            UploadAssetRequest { chunk: vec![7].into(), ..Default::default() }
        });
        let upload = tokio_stream::once(first).chain(drops);
        let refused = PileServiceClient::new(PileServiceServer::new(service)).upload_asset(upload).await.unwrap_err();
        assert_eq!(refused.get_error_details().error_info().unwrap().reason, "UPLOAD_STALLED", "{refused:?}");
        assert_eq!(folder.path().join("data/partial").read_dir().unwrap().count(), 0, "nothing of it is left");
    }
}
