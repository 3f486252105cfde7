//! The events of a bake on disk: one writer appends, any number of readers follow, each at its own pace.
//!
//! The physics never waits for a reader, and a reader that fell behind finds everything here.

use crate::trouble;
use crate::wire::proto::{BakeEvent, bake_event::Kind};
use bytes::BytesMut;
use prost::Message;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Result, Write};
use std::path::Path;
use tokio::io::{AsyncReadExt, Take};
use tokio_stream::StreamExt;
use tokio_util::codec::{Encoder, FramedRead, LengthDelimitedCodec};

/// Bytes of one event: gRPC's usual limit, less what a response adds to its event. A frame of the most bodies that a scene
/// may have, 100,000, takes 3.9 MB.
pub const MAX_EVENT: usize = (4 << 20) - 64;

/// How messages are set apart, in the log and between server and worker.
pub fn codec() -> LengthDelimitedCodec {
    LengthDelimitedCodec::builder().max_frame_length(MAX_EVENT).new_codec()
}

/// Writes one message, its length before it. `place`: where faults may happen, see [`trouble`].
pub fn write_message(place: &str, to: &mut impl Write, message: &impl Message) -> Result<usize> {
    let mut framed = BytesMut::new();
    codec().encode(&message.encode_to_vec()[..], &mut framed)?;
    trouble::write(place, to, &framed)?;
    Ok(framed.len())
}

/// How far a log is written.
#[derive(Clone, Copy, PartialEq, Eq, prost::Message)]
pub struct Extent {
    #[prost(uint64, tag = "1")]
    pub bytes: u64,
    /// Number of the last event.
    #[prost(int64, tag = "2")]
    pub last: i64,
}

/// Appends events, numbered from 1.
pub struct Writer {
    file: BufWriter<File>,
    extent: Extent,
}

impl Writer {
    /// A new log with its first event; what was there is gone.
    pub fn create(path: &Path, first: Kind) -> Result<Writer> {
        trouble::at("log-create")?;
        let mut writer = Writer { file: BufWriter::new(File::create(path)?), extent: Extent::default() };
        writer.append(first)?;
        Ok(writer)
    }

    /// A log that holds its first event only.
    pub fn resume(path: &Path) -> Result<Writer> {
        let file = OpenOptions::new().append(true).open(path)?;
        let bytes = file.metadata()?.len();
        // Frames are written in large pieces.
        Ok(Writer { file: BufWriter::with_capacity(1 << 20, file), extent: Extent { bytes, last: 1 } })
    }

    pub fn append(&mut self, kind: Kind) -> Result<()> {
        self.extent.last += 1;
        let event = BakeEvent { sequence_number: self.extent.last, kind: Some(kind) };
        self.extent.bytes += write_message("log-append", &mut self.file, &event)? as u64;
        Ok(())
    }

    /// From now on, readers may see everything appended.
    pub fn flush(&mut self) -> Result<Extent> {
        trouble::at("log-flush")?;
        self.file.flush()?;
        Ok(self.extent)
    }

    /// The same, and everything appended outlives a power cut.
    pub fn sync(&mut self) -> Result<Extent> {
        let extent = self.flush()?;
        trouble::at("log-sync")?;
        self.file.get_ref().sync_all()?;
        Ok(extent)
    }
}

/// Reads a log that may still grow.
pub struct Reader {
    framed: FramedRead<Take<tokio::fs::File>, LengthDelimitedCodec>,
    /// How far it may read.
    granted: u64,
}

impl Reader {
    pub async fn open(path: &Path) -> Result<Reader> {
        /// Bytes read at once.
        const PIECE: usize = 64 << 10;
        let file = tokio::fs::File::open(path).await?.take(0);
        Ok(Reader { framed: FramedRead::with_capacity(file, codec(), PIECE), granted: 0 })
    }

    /// The next event among the first `bytes` of the log. An error if it has fewer.
    pub async fn next(&mut self, bytes: u64) -> Result<Option<BakeEvent>> {
        trouble::at("log-read")?;
        let more = bytes.saturating_sub(self.granted);
        self.granted += more;
        let file = self.framed.get_mut();
        file.set_limit(file.limit() + more);
        match self.framed.next().await.transpose()? {
            Some(message) => Ok(Some(BakeEvent::decode(message)?)),
            None if self.framed.get_ref().limit() > 0 => Err(std::io::ErrorKind::UnexpectedEof.into()),
            None => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::frame_delta::FrameDelta;
    use cairn_core::geometry::pose::Pose;
    use cairn_core::input::observer::{Frame, Shown, Stage, State};
    use glam::{DQuat, DVec3};

    /// The largest frame that there may be: all bodies are new, have moved and changed their size, and say how they are held.
    #[test]
    fn a_frame_of_the_most_bodies_is_one_event() {
        const MOST_BODIES: usize = 100_000;
        let body = |number: usize| {
            let turn = DQuat::from_rotation_y(number as f64);
            let pose = Pose { translation: DVec3::splat(-0.1 * number as f64 - 1.0), rotation: turn };
            Some(Shown { prop: 1000, scale: 0.7 + 1e-6 * number as f64, pose, state: State::Held })
        };
        let bodies: Vec<_> = (0..MOST_BODIES).map(body).collect();
        for stage in [Stage::Fill, Stage::Release] {
            let frame = Frame { stage, number: 10_000, time: 1000.0, bodies: &bodies };
            let mut told = 0;
            for kind in FrameDelta::default().next(&frame) {
                if let Kind::Frame(frame) = &kind {
                    told = frame.states.len().min(frame.body_indices.len());
                }
                let event = BakeEvent { sequence_number: 10_000, kind: Some(kind) };
                assert!(event.encoded_len() <= MAX_EVENT, "{stage:?}: {} bytes", event.encoded_len());
            }
            assert_eq!(told, MOST_BODIES);
        }
    }
}
