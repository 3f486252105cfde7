//! The events of a bake on disk. One writer appends; any number of readers follow at their own pace.
//!
//! The simulation never waits for a reader, and a slow reader misses nothing.

use bytes::BytesMut;
use cairn_files::failpoints;
use cairn_wire::proto::{BakeEvent, bake_event::Kind};
use prost::Message;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Result, Write};
use std::path::Path;
use tokio::io::{AsyncReadExt, Take};
use tokio_stream::StreamExt;
use tokio_util::codec::{Encoder, FramedRead, LengthDelimitedCodec};

/// Largest event, bytes: gRPC's usual limit less the response around the event. A frame of 100,000 bodies, the most
/// that a scene may have, takes 3.9 MB.
pub const MAX_EVENT: usize = (4 << 20) - 64;

/// The framing of messages, in the log and between server and worker: each after its length.
pub fn codec() -> LengthDelimitedCodec {
    LengthDelimitedCodec::builder().max_frame_length(MAX_EVENT).new_codec()
}

/// Writes one message after its length. Returns the bytes written. `place`: see [`failpoints`].
pub fn write_message(place: &str, to: &mut impl Write, message: &impl Message) -> Result<usize> {
    let mut framed = BytesMut::new();
    codec().encode(&message.encode_to_vec()[..], &mut framed)?;
    failpoints::write(place, to, &framed)?;
    Ok(framed.len())
}

/// The written part of a log.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct Extent {
    #[prost(uint64, tag = "1")]
    pub bytes: u64,
    /// Number of the last event.
    #[prost(int64, tag = "2")]
    pub last: i64,
}

/// Appends events, numbered from 1.
pub struct LogWriter {
    file: BufWriter<File>,
    extent: Extent,
}

impl LogWriter {
    /// Begins a new log with its first event, in place of an old one.
    pub fn create(path: &Path, first: Kind) -> Result<LogWriter> {
        failpoints::at("log-create")?;
        let mut writer = LogWriter { file: BufWriter::new(File::create(path)?), extent: Extent::default() };
        writer.append(first)?;
        Ok(writer)
    }

    /// Continues a log that holds only its first event.
    pub fn resume(path: &Path) -> Result<LogWriter> {
        let file = OpenOptions::new().append(true).open(path)?;
        let bytes = file.metadata()?.len();
        // Frames are written in large pieces.
        Ok(LogWriter { file: BufWriter::with_capacity(1 << 20, file), extent: Extent { bytes, last: 1 } })
    }

    pub fn append(&mut self, kind: Kind) -> Result<()> {
        self.extent.last += 1;
        let event = BakeEvent { sequence_number: self.extent.last, kind: Some(kind) };
        self.extent.bytes += write_message("log-append", &mut self.file, &event)? as u64;
        Ok(())
    }

    /// Makes everything appended visible to readers.
    pub fn flush(&mut self) -> Result<Extent> {
        failpoints::at("log-flush")?;
        self.file.flush()?;
        Ok(self.extent)
    }

    /// Flushes, and makes everything appended outlive a power cut.
    pub fn sync(&mut self) -> Result<Extent> {
        let extent = self.flush()?;
        failpoints::at("log-sync")?;
        self.file.get_ref().sync_all()?;
        Ok(extent)
    }
}

/// Reads a log that may still grow.
pub struct LogReader {
    framed: FramedRead<Take<tokio::fs::File>, LengthDelimitedCodec>,
    /// Bytes that it may read so far.
    granted: u64,
}

impl LogReader {
    pub async fn open(path: &Path) -> Result<LogReader> {
        /// Bytes read at once.
        const PIECE: usize = 64 << 10;
        let file = tokio::fs::File::open(path).await?.take(0);
        Ok(LogReader { framed: FramedRead::with_capacity(file, codec(), PIECE), granted: 0 })
    }

    /// The next event among the first `bytes` of the log. Fails if the log is shorter.
    pub async fn next(&mut self, bytes: u64) -> Result<Option<BakeEvent>> {
        failpoints::at("log-read")?;
        let more = bytes.saturating_sub(self.granted);
        self.granted += more;
        let file = self.framed.get_mut();
        file.set_limit(file.limit() + more);
        match self.framed.next().await.transpose()? {
            Some(message) => Ok(Some(BakeEvent::decode(message.freeze())?)),
            None if self.framed.get_ref().limit() > 0 => Err(std::io::ErrorKind::UnexpectedEof.into()),
            None => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::pose::Pose;
    use cairn_input::observer::{Frame, FrameBody, Stage, State};
    use cairn_wire::frame_delta::FrameDelta;
    use glam::{DQuat, DVec3};

    /// The largest possible frame: every body is new, has moved, has another size and has a state.
    #[test]
    fn a_frame_of_the_most_bodies_is_one_event() {
        const MOST_BODIES: usize = 100_000;
        let body = |number: usize| {
            let turn = DQuat::from_rotation_y(number as f64);
            let pose = Pose { translation: DVec3::splat(-0.1 * number as f64 - 1.0), rotation: turn };
            Some(FrameBody { prop: 1000, scale: 0.7 + 1e-6 * number as f64, pose, state: State::Held })
        };
        let bodies: Vec<_> = (0..MOST_BODIES).map(body).collect();
        for stage in [Stage::Fill, Stage::Release] {
            let frame = Frame { stage, number: 10_000, time: 1000.0, bodies: &bodies };
            let mut count = 0;
            for kind in FrameDelta::default().next(&frame) {
                if let Kind::Frame(frame) = &kind {
                    count = frame.states.len().min(frame.body_indices.len());
                }
                let event = BakeEvent { sequence_number: 10_000, kind: Some(kind) };
                assert!(event.encoded_len() <= MAX_EVENT, "{stage:?}: {} bytes", event.encoded_len());
            }
            assert_eq!(count, MOST_BODIES);
        }
    }
}
