//! Connections over a Unix socket, from clients of all gRPC libraries.
//!
//! gRPC of Python and C++ sends the socket's path as the authority of each call, percent-encoded:
//! `tmp%2Fcairn%2Fsocket`. That is no valid HTTP authority, and the HTTP library refuses the call. The server does not
//! use the authority, so this filter replaces the percent signs in place where the authority stands in plain letters in
//! the headers.

use std::io::Result;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::UnixStream;
use tonic::transport::server::{Connected, UdsConnectInfo};

pub struct UnixConnection {
    stream: UnixStream,
    filter: AuthorityFilter,
}

impl UnixConnection {
    pub fn new(stream: UnixStream) -> UnixConnection {
        UnixConnection { stream, filter: AuthorityFilter::default() }
    }
}

impl Connected for UnixConnection {
    type ConnectInfo = UdsConnectInfo;

    fn connect_info(&self) -> UdsConnectInfo {
        self.stream.connect_info()
    }
}

impl AsyncRead for UnixConnection {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context, buffer: &mut ReadBuf) -> Poll<Result<()>> {
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.stream).poll_read(context, buffer))?;
        self.filter.pass(&mut buffer.filled_mut()[before..]);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for UnixConnection {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context, bytes: &[u8]) -> Poll<Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context) -> Poll<Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

/// Length of the preface of an HTTP/2 connection: `PRI * HTTP/2.0`, and so on.
const PREFACE: usize = 24;
const FRAME_HEADER: usize = 9;
/// Frame types that hold headers: HEADERS and CONTINUATION.
const WITH_HEADERS: [u8; 2] = [1, 9];
/// The header's name as it is encoded: its length, then its letters.
const NAME: &[u8] = b"\x0a:authority";
/// Lengths from here on take more bytes, and no socket path is so long. The upper bit marks Huffman-coded letters.
const LONG: u8 = 127;

/// Follows the bytes of a connection.
#[derive(Default)]
struct AuthorityFilter {
    /// Bytes so far, up to the end of the preface.
    preface: usize,
    frame: [u8; FRAME_HEADER],
    /// Bytes of `frame` so far.
    known: usize,
    /// Bytes of the frame's content still to come.
    left: usize,
    /// Bytes of [`NAME`] just seen. After all of them, the length follows.
    matched: usize,
    /// Bytes of the authority still to come.
    authority: u8,
}

impl AuthorityFilter {
    fn pass(&mut self, mut bytes: &mut [u8]) {
        while !bytes.is_empty() {
            let taken = self.take(bytes);
            bytes = &mut bytes[taken..];
        }
    }

    /// Processes some of the bytes and returns how many.
    fn take(&mut self, bytes: &mut [u8]) -> usize {
        if self.preface < PREFACE {
            let taken = bytes.len().min(PREFACE - self.preface);
            self.preface += taken;
            return taken;
        }
        if self.left > 0 {
            let taken = bytes.len().min(self.left);
            self.left -= taken;
            if WITH_HEADERS.contains(&self.frame[3]) {
                bytes[..taken].iter_mut().for_each(|byte| self.header_byte(byte));
            }
            return taken;
        }
        self.frame[self.known] = bytes[0];
        self.known = (self.known + 1) % FRAME_HEADER;
        if self.known == 0 {
            self.left = usize::from(self.frame[0]) << 16 | usize::from(self.frame[1]) << 8 | usize::from(self.frame[2]);
        }
        1
    }

    fn header_byte(&mut self, byte: &mut u8) {
        if self.authority > 0 {
            self.authority -= 1;
            if *byte == b'%' {
                *byte = b'.';
            }
        } else if self.matched == NAME.len() {
            self.matched = 0;
            self.authority = if *byte < LONG { *byte } else { 0 };
        } else if *byte == NAME[self.matched] {
            self.matched += 1;
        } else {
            self.matched = usize::from(*byte == NAME[0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::AuthorityFilter;

    fn frame(kind: u8, content: &[u8]) -> Vec<u8> {
        [&[0, 0, content.len() as u8, kind, 4, 0, 0, 0, 1], content].concat()
    }

    /// As grpcio sends it, in pieces of any size.
    #[test]
    fn an_authority_that_is_a_path_becomes_one() {
        let preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec();
        let call = |authority: &[u8]| {
            let headers = [b"@\x05:path\x02/x@\x0a:authority\x0f", authority, b"\x83\x86@\x02te\x02%%"].concat();
            [preface.clone(), frame(4, b"%%%%%%"), frame(1, &headers), frame(0, b"\x0a:authority\x03%%%")].concat()
        };
        for piece in [1, 2, 7, 1000] {
            let mut bytes = call(b"tmp%2Fs%2F.sock");
            let mut headers = AuthorityFilter::default();
            bytes.chunks_mut(piece).for_each(|piece| headers.pass(piece));
            assert_eq!(bytes, call(b"tmp.2Fs.2F.sock"), "only the authority has changed");
        }
    }
}
