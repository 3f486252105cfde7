//! The events of a bake on disk. One writer appends; any number of readers follow at their own pace.
//!
//! The simulation never waits for a reader, and a slow reader misses nothing.
//!
//! A log begins with a mark. Each event follows a check, a hash of it and of the check before, so that a disk that
//! changes a byte, or loses or repeats events, is noticed before anybody gets them. Logs of version 0.1.0 have neither
//! mark nor checks, and are read as they are.

use crate::seal::CHANGED;
use bytes::BytesMut;
use cairn_files::failpoints;
use cairn_wire::proto::{BakeEvent, bake_event::Kind};
use prost::Message;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Result, Write};
use std::path::Path;
use tokio::io::{AsyncReadExt, AsyncSeekExt, Take};
use tokio_stream::StreamExt;
use tokio_util::codec::{Encoder, FramedRead, LengthDelimitedCodec};

/// Largest event, bytes: gRPC's usual limit less the response around the event. A frame of 100,000 bodies, the most
/// that a scene may have, takes 3.9 MB.
pub const MAX_EVENT: usize = (4 << 20) - 64;

/// The framing of messages, in the log and between server and worker: each after its length.
pub fn codec() -> LengthDelimitedCodec {
    LengthDelimitedCodec::builder().max_frame_length(MAX_EVENT).new_codec()
}

/// The beginning of a log with checks: as the length of a message, it would be too large.
const MARK: &[u8; 8] = b"\xffcairn\x02\n";
/// Bytes of a check.
const CHECK: usize = 8;

/// The check of an event behind another one's.
fn check(before: &[u8; CHECK], event: &[u8]) -> [u8; CHECK] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(before).update(event);
    let mut check = [0; CHECK];
    hasher.finalize_xof().fill(&mut check);
    check
}

/// The framing of a log.
fn log_codec() -> LengthDelimitedCodec {
    LengthDelimitedCodec::builder().max_frame_length(MAX_EVENT + CHECK).new_codec()
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
    /// Of the last event.
    check: [u8; CHECK],
}

impl LogWriter {
    /// Begins a new log with its first event, in place of an old one.
    pub fn create(path: &Path, first: Kind) -> Result<LogWriter> {
        failpoints::at("log-create")?;
        let extent = Extent { bytes: MARK.len() as u64, last: 0 };
        let mut writer = LogWriter { file: BufWriter::new(File::create(path)?), extent, check: [0; CHECK] };
        failpoints::write("log-append", &mut writer.file, MARK)?;
        writer.append(first)?;
        Ok(writer)
    }

    /// Continues a log that holds only its first event.
    pub fn resume(path: &Path) -> Result<LogWriter> {
        /// Bytes of the length of an event.
        const LENGTH: usize = 4;
        let written = std::fs::read(path)?;
        let check = written.get(MARK.len() + LENGTH..).and_then(|rest| rest.first_chunk::<CHECK>());
        let check = *check.filter(|_| written.starts_with(MARK)).ok_or(std::io::ErrorKind::InvalidData)?;
        let file = OpenOptions::new().append(true).open(path)?;
        // Frames are written in large pieces.
        let file = BufWriter::with_capacity(1 << 20, file);
        Ok(LogWriter { file, extent: Extent { bytes: written.len() as u64, last: 1 }, check })
    }

    pub fn append(&mut self, kind: Kind) -> Result<()> {
        self.extent.last += 1;
        let event = BakeEvent { sequence_number: self.extent.last, kind: Some(kind) }.encode_to_vec();
        self.check = check(&self.check, &event);
        let mut framed = BytesMut::new();
        log_codec().encode(&[&self.check[..], &event].concat()[..], &mut framed)?;
        failpoints::write("log-append", &mut self.file, &framed)?;
        self.extent.bytes += framed.len() as u64;
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
    /// Of the last event; `None`: a log without checks.
    check: Option<[u8; CHECK]>,
}

impl LogReader {
    pub async fn open(path: &Path) -> Result<LogReader> {
        /// Bytes read at once.
        const PIECE: usize = 64 << 10;
        let file = tokio::fs::File::open(path).await?.take(0);
        Ok(LogReader { framed: FramedRead::with_capacity(file, log_codec(), PIECE), granted: 0, check: None })
    }

    /// Looks whether it has checks, once something of it is written: it may have been opened before.
    async fn begin(&mut self) -> Result<()> {
        let file = self.framed.get_mut().get_mut();
        let mut mark = Vec::new();
        (&mut *file).take(MARK.len() as u64).read_to_end(&mut mark).await?;
        if mark == MARK {
            self.granted = MARK.len() as u64;
            self.check = Some([0; CHECK]);
        } else {
            file.seek(std::io::SeekFrom::Start(0)).await?;
        }
        Ok(())
    }

    /// The next event among the first `bytes` of the log. Fails if the log is shorter.
    pub async fn next(&mut self, bytes: u64) -> Result<Option<BakeEvent>> {
        failpoints::at("log-read")?;
        if self.granted == 0 && bytes > 0 {
            self.begin().await?;
        }
        let more = bytes.saturating_sub(self.granted);
        self.granted += more;
        let file = self.framed.get_mut();
        file.set_limit(file.limit() + more);
        match self.framed.next().await.transpose()? {
            Some(message) => {
                let mut event = message.freeze();
                if let Some(before) = &mut self.check {
                    if event.len() < CHECK {
                        return Err(changed());
                    }
                    let stated = event.split_to(CHECK);
                    *before = check(before, &event);
                    if stated != before[..] {
                        return Err(changed());
                    }
                }
                Ok(Some(BakeEvent::decode(event)?))
            }
            None if self.framed.get_ref().limit() > 0 => Err(std::io::ErrorKind::UnexpectedEof.into()),
            None => Ok(None),
        }
    }
}

fn changed() -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::InvalidData, CHANGED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_wire::proto::{Accepted, Progress, Summary};

    fn events() -> Vec<Kind> {
        let accepted = Accepted { bake_id: "a bake".into(), ..Default::default() };
        let progress = |body_count| Kind::Progress(Progress { body_count, ..Default::default() });
        vec![Kind::Accepted(Box::new(accepted)), progress(1), progress(2), Kind::Summary(Summary::default())]
    }

    /// The events of a log, or that one cannot be read.
    async fn read(path: &Path) -> Result<Vec<Kind>> {
        let bytes = std::fs::metadata(path)?.len();
        let mut reader = LogReader::open(path).await?;
        let mut found = Vec::new();
        while let Some(event) = reader.next(bytes).await? {
            found.extend(event.kind);
        }
        Ok(found)
    }

    #[tokio::test]
    async fn a_changed_log_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.log");
        let mut all = events().into_iter();
        LogWriter::create(&path, all.next().unwrap()).unwrap().sync().unwrap();
        let mut writer = LogWriter::resume(&path).unwrap();
        all.for_each(|kind| writer.append(kind).unwrap());
        let extent = writer.sync().unwrap();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!((extent.bytes, extent.last), (whole.len() as u64, 4));
        assert_eq!(read(&path).await.unwrap(), events());
        for at in 0..whole.len() {
            for bit in [1, 0x80] {
                let mut bytes = whole.clone();
                bytes[at] ^= bit;
                std::fs::write(&path, bytes).unwrap();
                assert!(read(&path).await.is_err(), "byte {at}");
            }
        }
        // An event that is there twice, or is missing.
        let frames: Vec<&[u8]> = {
            let mut rest = &whole[MARK.len()..];
            std::iter::from_fn(|| {
                let length = u32::from_be_bytes(*rest.first_chunk()?) as usize;
                let (frame, after) = rest.split_at(4 + length);
                rest = after;
                Some(frame)
            })
            .collect()
        };
        for order in [&[0, 1, 1, 2, 3][..], &[0, 2, 3], &[0, 2, 1, 3]] {
            let frames: Vec<&[u8]> = order.iter().map(|&at| frames[at]).collect();
            std::fs::write(&path, [&MARK[..], &frames.concat()].concat()).unwrap();
            assert!(read(&path).await.is_err(), "{order:?}");
        }
    }

    /// As version 0.1.0 wrote it.
    #[tokio::test]
    async fn a_log_without_checks_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.log");
        let mut file = File::create(&path).unwrap();
        for (number, kind) in (1..).zip(events()) {
            let event = BakeEvent { sequence_number: number, kind: Some(kind) };
            write_message("log-append", &mut file, &event).unwrap();
        }
        assert_eq!(read(&path).await.unwrap(), events());
    }
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
            let frame = Frame { stage, number: 10_000, time: 1000.0, bodies: &bodies, comers: &[] };
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
