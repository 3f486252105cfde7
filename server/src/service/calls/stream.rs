//! What streams to a caller: events from the log and progress, and files. A caller that is slow waits for itself alone.

use crate::service::event_log::Reader;
use crate::service::folder::EVENTS;
use crate::service::jobs::{Bakes, Entry};
use crate::service::status::Fault;
use crate::wire::proto::{BakeEvent, DownloadResultResponse, FrameSelection, Stage, bake_event::Kind};
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::time::Instant;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tokio_util::io::ReaderStream;
use tonic::Status;

pub type Events<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// Messages that wait for a slow reader: a frame may take megabytes.
const WAITING: usize = 4;
/// Bytes of a chunk of a download.
const CHUNK: usize = 64 << 10;

/// What a caller wants to see of a bake.
pub struct Follow {
    /// First event.
    pub from: i64,
    pub frames: FrameSelection,
    /// When the call ends, whether the bake does or not.
    pub deadline: Option<Instant>,
}

impl Follow {
    /// The events, past and to come. Ends with the bake.
    pub fn start(
        self,
        bakes: &Arc<Bakes>,
        entry: Arc<Entry>,
        permit: OwnedSemaphorePermit,
    ) -> ReceiverStream<Result<BakeEvent, Status>> {
        let (sender, receiver) = mpsc::channel(WAITING);
        let log = bakes.store.folder(&entry.id()).join(EVENTS);
        tokio::spawn(async move {
            let _permit = permit;
            let ended = match self.deadline {
                Some(deadline) => match tokio::time::timeout_at(deadline, self.run(&log, &entry, &sender)).await {
                    Ok(ended) => ended,
                    Err(_) => Err(Fault::Deadline.into()),
                },
                None => self.run(&log, &entry, &sender).await,
            };
            if let Err(status) = ended {
                // A caller that is gone needs no reason.
                let _ = sender.send(Err(status)).await;
            }
        });
        ReceiverStream::new(receiver)
    }

    async fn run(
        &self,
        log: &Path,
        entry: &Entry,
        sender: &mpsc::Sender<Result<BakeEvent, Status>>,
    ) -> Result<(), Status> {
        // A bake may be deleted at any time.
        let gone = |_| Fault::BakeNotFound(entry.id());
        let mut reader = Reader::open(log).await.map_err(gone)?;
        let mut watch = entry.watch();
        let mut told = None;
        loop {
            let (bytes, has_ended, progress, failure) = {
                let now = watch.borrow_and_update();
                let failure = now.status.failure.clone();
                (now.log_bytes, now.has_ended(), now.status.progress.filter(|_| !now.has_ended()), failure)
            };
            while let Some(event) = reader.next(bytes).await.map_err(Fault::from)? {
                if event.sequence_number >= self.from && self.wants(&event) && sender.send(Ok(event)).await.is_err() {
                    return Ok(());
                }
            }
            if has_ended {
                return failure.map_or(Ok(()), |failure| Err(Status::from(&failure)));
            }
            if progress.is_some() && progress != told {
                told = progress;
                let event = BakeEvent { sequence_number: 0, kind: progress.map(Kind::Progress) };
                if sender.send(Ok(event)).await.is_err() {
                    return Ok(());
                }
            }
            tokio::select! {
                changed = watch.changed() => changed.map_err(|error| Fault::Internal(error.to_string()))?,
                () = sender.closed() => return Ok(()),
            }
        }
    }

    fn wants(&self, event: &BakeEvent) -> bool {
        let stage = match &event.kind {
            Some(Kind::BodyTable(table)) => table.stage(),
            Some(Kind::Frame(frame)) => frame.stage(),
            _ => return true,
        };
        match self.frames {
            FrameSelection::Unspecified | FrameSelection::All => true,
            FrameSelection::Result => stage != Stage::Fill,
            FrameSelection::None => false,
        }
    }
}

/// A file in chunks.
pub async fn download(path: &Path, permit: OwnedSemaphorePermit) -> Result<Events<DownloadResultResponse>, Fault> {
    let file = tokio::fs::File::open(path).await?;
    let size = file.metadata().await?.len();
    let mut size_bytes = crate::wire::to_proto::signed(size);
    let chunks = ReaderStream::with_capacity(file, CHUNK).map(move |chunk| {
        let _held_to_the_end = &permit;
        let chunk = chunk.map_err(Fault::from)?;
        Ok(DownloadResultResponse { size_bytes: std::mem::take(&mut size_bytes), chunk })
    });
    Ok(Box::pin(chunks))
}
