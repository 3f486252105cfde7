//! Streams to callers: events of the log with progress, and files. A slow caller delays nobody else.

use crate::event_log::LogReader;
use crate::folder::EVENTS;
use crate::jobs::{Bakes, Entry, NewAnalysis};
use crate::quotas::Permit;
use crate::status::{Fault, no_more_files, status_of};
use cairn_files::failpoints;
use cairn_files::plain_reason;
use cairn_wire::digest::hex;
use cairn_wire::proto::{
    AnalysePileResponse, BakeEvent, DownloadResultResponse, FrameSelection, Stage, bake_event::Kind,
};
use cairn_wire::to_proto;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tokio_util::io::ReaderStream;
use tonic::Status;

pub type ResponseStream<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// Messages buffered for a slow caller. A frame may have megabytes.
const WAITING: usize = 4;
/// Bytes of a chunk of a download.
const CHUNK: usize = 64 << 10;

/// Sends a message. Returns whether the caller is still there.
async fn send<T>(sender: &mpsc::Sender<Result<T, Status>>, message: T) -> bool {
    failpoints::at("stream-send").is_ok() && sender.send(Ok(message)).await.is_ok()
}

/// A caller's view of a bake's events.
pub struct Follow {
    /// First event.
    pub from: i64,
    pub frames: FrameSelection,
    /// End of the call, even if the bake goes on.
    pub deadline: Option<Instant>,
}

impl Follow {
    /// Streams past and future events until the bake ends.
    pub fn start(
        self,
        bakes: &Arc<Bakes>,
        entry: Arc<Entry>,
        permit: Permit,
    ) -> ReceiverStream<Result<BakeEvent, Status>> {
        let (sender, receiver) = mpsc::channel(WAITING);
        let bakes = bakes.clone();
        let log = bakes.store.folder(&entry.id()).join(EVENTS);
        tokio::spawn(async move {
            let _permit = permit;
            let run = self.run(&bakes, &log, &entry, &sender);
            let ended = match self.deadline {
                Some(deadline) => {
                    tokio::time::timeout_at(deadline, run).await.unwrap_or_else(|_| Err(Fault::Deadline.into()))
                }
                None => run.await,
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
        bakes: &Bakes,
        log: &Path,
        entry: &Entry,
        sender: &mpsc::Sender<Result<BakeEvent, Status>>,
    ) -> Result<(), Status> {
        // A bake may be deleted at any time.
        let gone = || Fault::BakeNotFound(entry.id());
        let damaged = |error: std::io::Error| match bakes.knows(&entry.id()) {
            true if no_more_files(&error) => Fault::from(error),
            true => bakes.mark_damaged(entry, format!("its events cannot be read ({})", plain_reason(&error))),
            false => gone(),
        };
        let mut reader = LogReader::open(log).await.map_err(damaged)?;
        let mut watch = entry.watch();
        let mut sent = None;
        loop {
            let (bytes, has_ended, progress, failure) = {
                let now = watch.borrow_and_update();
                let failure = now.status.failure.clone();
                (now.log_bytes, now.has_ended(), now.status.progress.filter(|_| !now.has_ended()), failure)
            };
            while let Some(event) = reader.next(bytes).await.map_err(damaged)? {
                if event.sequence_number >= self.from && self.wants(&event) && !send(sender, event).await {
                    return Ok(());
                }
            }
            if has_ended {
                return failure.map_or(Ok(()), |failure| Err(status_of(&failure)));
            }
            if progress.is_some() && progress != sent {
                sent = progress;
                let event = BakeEvent { sequence_number: 0, kind: progress.map(Kind::Progress) };
                if !send(sender, event).await {
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

/// Streams an analysis. It ends with its caller, and at the deadline.
pub fn analysis(
    bakes: &Arc<Bakes>,
    new: NewAnalysis,
    deadline: Option<Instant>,
    permit: Permit,
) -> ResponseStream<AnalysePileResponse> {
    let (sender, receiver) = mpsc::channel(WAITING);
    let bakes = bakes.clone();
    tokio::spawn(async move {
        let _permit = permit;
        let passed = async {
            match deadline {
                Some(deadline) => tokio::time::sleep_until(deadline).await,
                None => std::future::pending().await,
            }
        };
        let run = bakes.run_analysis(new, &sender);
        let ended = tokio::select! {
            ended = run => ended,
            () = passed => Err(Fault::Deadline),
            () = sender.closed() => Ok(()),
        };
        if let Err(fault) = ended {
            // A caller that is gone needs no reason.
            let _ = sender.send(Err(fault.into())).await;
        }
    });
    Box::pin(ReceiverStream::new(receiver))
}

/// A file in chunks. The last chunk is sent only if the whole file has its hash.
pub struct Download {
    pub path: PathBuf,
    /// The first message, with neither size nor bytes. Without a SHA-256, that is unknown.
    pub first: DownloadResultResponse,
}

impl Download {
    pub async fn start(
        self,
        bakes: &Arc<Bakes>,
        entry: Arc<Entry>,
        permit: Permit,
    ) -> Result<ResponseStream<DownloadResultResponse>, Fault> {
        let damaged = |error: std::io::Error| match no_more_files(&error) {
            true => Fault::from(error),
            false => bakes.mark_damaged(&entry, format!("a file cannot be read ({})", plain_reason(&error))),
        };
        failpoints::at("download-open").map_err(damaged)?;
        let file = tokio::fs::File::open(&self.path).await.map_err(damaged)?;
        let size = file.metadata().await.map_err(damaged)?.len();
        let (sender, receiver) = mpsc::channel(WAITING);
        let bakes = bakes.clone();
        tokio::spawn(async move {
            let _permit = permit;
            if let Err(damage) = self.send(file, size, &sender).await {
                let _ = sender.send(Err(bakes.mark_damaged(&entry, damage).into())).await;
            }
        });
        Ok(Box::pin(ReceiverStream::new(receiver)))
    }

    /// The error describes damage of the file.
    async fn send(
        self,
        file: tokio::fs::File,
        size: u64,
        sender: &mpsc::Sender<Result<DownloadResultResponse, Status>>,
    ) -> Result<(), String> {
        let mut chunks = ReaderStream::with_capacity(file, CHUNK);
        let mut hasher = Sha256::new();
        let sha256 = self.first.sha256.clone();
        let mut held = DownloadResultResponse { size_bytes: to_proto::signed(size), ..self.first };
        while let Some(chunk) = chunks.next().await {
            let chunk = failpoints::at("download-read")
                .and(chunk)
                .map_err(|error| format!("a file cannot be read ({})", plain_reason(&error)))?;
            hasher.update(&chunk);
            if !held.chunk.is_empty() && !send(sender, std::mem::take(&mut held)).await {
                return Ok(());
            }
            held.chunk = chunk;
        }
        if !sha256.is_empty() && hex(&hasher.finalize()) != sha256 {
            return Err("a file has changed since it was written".into());
        }
        send(sender, held).await;
        Ok(())
    }
}
