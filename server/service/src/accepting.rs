//! Connections as they come in: counted, closed where they are silent, and known to the requests that come on them.

use crate::connections::{Connection, Connections};
use axum::body::Body;
use axum::extract::Request;
use axum::middleware::Next;
use axum::response::Response;
use http_body_util::BodyExt;
use std::future::Future;
use std::io::{Error, ErrorKind, Result};
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc;
use tokio::time::{Instant, Sleep, sleep_until};
use tokio_stream::wrappers::ReceiverStream;
use tokio_util::sync::WaitForCancellationFutureOwned;
#[cfg(unix)]
use tonic::transport::server::UdsConnectInfo;
use tonic::transport::server::{Connected, TcpConnectInfo, TlsConnectInfo};
use tracing::warn;

/// Accepted connections that wait to be served.
const WAITING: usize = 16;
/// Pause after a connection could not be accepted.
const PAUSE: Duration = Duration::from_millis(100);

/// The other end of a connection, in the extensions of each request.
#[derive(Clone)]
pub struct Peer {
    pub connection: Arc<Connection>,
    pub info: PeerInfo,
}

#[derive(Clone)]
pub enum PeerInfo {
    Tcp(TcpConnectInfo),
    Tls(TlsConnectInfo<TcpConnectInfo>),
    #[cfg(unix)]
    Unix(UdsConnectInfo),
}

impl From<TcpConnectInfo> for PeerInfo {
    fn from(info: TcpConnectInfo) -> PeerInfo {
        PeerInfo::Tcp(info)
    }
}

impl From<TlsConnectInfo<TcpConnectInfo>> for PeerInfo {
    fn from(info: TlsConnectInfo<TcpConnectInfo>) -> PeerInfo {
        PeerInfo::Tls(info)
    }
}

#[cfg(unix)]
impl From<UdsConnectInfo> for PeerInfo {
    fn from(info: UdsConnectInfo) -> PeerInfo {
        PeerInfo::Unix(info)
    }
}

/// Counts a call on its connection, from its beginning to its end.
pub async fn count_call(request: Request, next: Next) -> Response {
    let peer = request.extensions().get::<Peer>().cloned();
    let call = peer.map(|peer| peer.connection.begin());
    next.run(request).await.map(|body| {
        Body::new(body.map_frame(move |frame| {
            let _open = &call;
            frame
        }))
    })
}

/// A stream that ends when its connection is closed, or silent for too long.
pub struct Guarded<T> {
    stream: T,
    connection: Arc<Connection>,
    closed: Pin<Box<WaitForCancellationFutureOwned>>,
    look: Pin<Box<Sleep>>,
}

impl<T> Guarded<T> {
    fn new(stream: T, connection: Arc<Connection>) -> Guarded<T> {
        let closed = Box::pin(connection.closing.clone().cancelled_owned());
        let look = Box::pin(sleep_until(Instant::now() + connection.patience()));
        Guarded { stream, connection, closed, look }
    }

    /// Whether the connection has to end.
    fn ends(&mut self, context: &mut Context) -> bool {
        if self.closed.as_mut().poll(context).is_ready() {
            return true;
        }
        while self.look.as_mut().poll(context).is_ready() {
            let now = Instant::now();
            match self.connection.must_speak() {
                Some(until) if until <= now => return true,
                until => {
                    let next = until.unwrap_or(now + self.connection.patience());
                    self.look.as_mut().reset(next);
                }
            }
        }
        false
    }
}

impl<T: Connected> Connected for Guarded<T>
where
    T::ConnectInfo: Into<PeerInfo>,
{
    type ConnectInfo = Peer;

    fn connect_info(&self) -> Peer {
        Peer { connection: self.connection.clone(), info: self.stream.connect_info().into() }
    }
}

impl<T: AsyncRead + Unpin> AsyncRead for Guarded<T> {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context, buffer: &mut ReadBuf) -> Poll<Result<()>> {
        if self.ends(context) {
            return Poll::Ready(Err(Error::new(ErrorKind::TimedOut, "Nothing is said on this connection")));
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<T: AsyncWrite + Unpin> AsyncWrite for Guarded<T> {
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

/// What accepts connections.
pub trait Accept: Send + Sync + 'static {
    type Stream: Send + 'static;

    /// The next one, and the name of its other end.
    fn poll_accept(&self, context: &mut Context) -> Poll<Result<(Self::Stream, String)>>;
}

impl Accept for TcpListener {
    type Stream = TcpStream;

    fn poll_accept(&self, context: &mut Context) -> Poll<Result<(TcpStream, String)>> {
        TcpListener::poll_accept(self, context).map_ok(|(stream, peer)| {
            let _ = stream.set_nodelay(true);
            (stream, peer.ip().to_string())
        })
    }
}

#[cfg(unix)]
impl Accept for tokio::net::UnixListener {
    type Stream = tokio::net::UnixStream;

    fn poll_accept(&self, context: &mut Context) -> Poll<Result<(tokio::net::UnixStream, String)>> {
        tokio::net::UnixListener::poll_accept(self, context).map_ok(|(stream, _)| (stream, "this machine".into()))
    }
}

/// The connections of a listener, each after `greet`: a handshake, or nothing.
pub fn incoming<L: Accept, T: Send + 'static, G>(
    listener: L,
    connections: Arc<Connections>,
    greet: impl Fn(L::Stream) -> G + Send + 'static,
) -> ReceiverStream<Result<Guarded<T>>>
where
    G: Future<Output = Option<T>> + Send + 'static,
{
    let (sender, receiver) = mpsc::channel(WAITING);
    tokio::spawn(async move {
        loop {
            let accepted = tokio::select! {
                accepted = std::future::poll_fn(|context| listener.poll_accept(context)) => accepted,
                () = sender.closed() => return,
            };
            let (stream, owner) = match accepted {
                Ok(accepted) => accepted,
                Err(error) => {
                    // A broken connection, or no file handle left: the next one may succeed.
                    warn!(%error, "a connection could not be accepted");
                    tokio::time::sleep(PAUSE).await;
                    continue;
                }
            };
            let Some(connection) = connections.open(owner) else {
                continue;
            };
            let (greeted, sender) = (greet(stream), sender.clone());
            tokio::spawn(async move {
                let closing = connection.closing.clone();
                tokio::select! {
                    greeted = greeted => if let Some(stream) = greeted {
                        drop(sender.send(Ok(Guarded::new(stream, connection))).await);
                    },
                    () = closing.cancelled() => {}
                }
            });
        }
    });
    ReceiverStream::new(receiver)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::AsyncReadExt;

    #[tokio::test]
    async fn a_silent_connection_ends() {
        let all = Connections::of(8, Duration::from_millis(20), Duration::from_millis(60));
        let read = |connection: Arc<Connection>| async move {
            let (stream, _other) = tokio::io::duplex(64);
            let mut guarded = Guarded::new(stream, connection);
            let ended = tokio::time::timeout(Duration::from_millis(300), guarded.read_u8()).await;
            ended.ok().map(|ended| ended.unwrap_err().kind())
        };
        let silent = all.open(String::new()).unwrap();
        let probed = all.open(String::new()).unwrap();
        drop(probed.begin());
        let (watching, known) = (all.open(String::new()).unwrap(), all.open(String::new()).unwrap());
        known.know("anna");
        let _call = watching.begin();
        let ended = tokio::join!(read(silent), read(probed), read(watching.clone()), read(known));
        assert_eq!(ended, (Some(ErrorKind::TimedOut), Some(ErrorKind::TimedOut), None, None));
    }
}
