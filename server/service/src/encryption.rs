//! TLS: certificates and keys, checked before the server listens and reloaded on SIGHUP.

use crate::accepting::{self, Guarded};
use crate::config::{self, Config};
use crate::connections::Connections;
use cairn_files::problem::Problem;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::WebPkiClientVerifier;
use rustls::{RootCertStore, ServerConfig};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;
use tokio_stream::wrappers::ReceiverStream;
use tracing::{debug, warn};
use x509_cert::Certificate;
use x509_cert::der::Decode;

/// A certificate that expires within this time causes a warning.
const SOON: Duration = Duration::from_secs(30 * 86_400);
/// Concurrent TLS handshakes, and the time limit of each.
const HANDSHAKES: usize = 1024;
const HANDSHAKE: Duration = Duration::from_secs(10);

/// Reads the files of the settings; `None` if there is no certificate.
pub fn read(config: &Config) -> Result<Option<Arc<ServerConfig>>, Vec<Problem>> {
    let mut problems = Vec::new();
    let mut read = |setting: &str, path: &Option<PathBuf>| config::read_file(setting, path, &mut problems);
    let certificate = read("tls_certificate", &config.tls_certificate);
    let key = read("tls_key", &config.tls_key);
    let client_ca = read("tls_client_ca", &config.tls_client_ca);
    let halves = [config.tls_certificate.is_some(), config.tls_key.is_some()];
    if halves[0] != halves[1] {
        let remedy = "Give tls_certificate and tls_key, or neither.";
        problems.push(Problem::new("tls", "only one of certificate and key is given", remedy));
    }
    if config.tls_client_ca.is_some() && halves == [false, false] {
        let remedy = "Give tls_certificate and tls_key, too.";
        problems.push(Problem::new("tls_client_ca", "client certificates need an encrypted connection", remedy));
    }
    if !problems.is_empty() {
        return Err(problems);
    }
    let Some((certificate, key)) = certificate.zip(key) else { return Ok(None) };
    let place = |path: &Option<PathBuf>| path.as_deref().unwrap_or(Path::new("")).display().to_string();
    let (certificate_file, key_file) = (place(&config.tls_certificate), place(&config.tls_key));
    let chain = certificates(&certificate_file, &certificate)?;
    warn_of_age(&certificate_file, &chain);
    let key = PrivateKeyDer::from_pem_slice(&key).map_err(|error| {
        vec![Problem::new(&key_file, format!("not a private key: {error}"), "Give a key in PEM, without a password.")]
    })?;
    let authorities = match client_ca {
        Some(ca) => Some((place(&config.tls_client_ca), certificates(&place(&config.tls_client_ca), &ca)?)),
        None => None,
    };
    server(chain, key, authorities, &certificate_file, &key_file).map(Some)
}

type Authorities = Option<(String, Vec<CertificateDer<'static>>)>;

fn server(
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
    authorities: Authorities,
    certificate_file: &str,
    key_file: &str,
) -> Result<Arc<ServerConfig>, Vec<Problem>> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ServerConfig::builder_with_provider(provider.clone());
    let builder = builder.with_safe_default_protocol_versions().expect("the provider knows TLS 1.2 and 1.3");
    let builder = match authorities {
        Some((file, authorities)) => {
            let wrong = |what: String| vec![Problem::new(&file, what, "Give certificates of authorities in PEM.")];
            let mut roots = RootCertStore::empty();
            for authority in authorities {
                roots.add(authority).map_err(|error| wrong(format!("not an authority's certificate: {error}")))?;
            }
            let verifier = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider).build();
            builder.with_client_cert_verifier(verifier.map_err(|error| wrong(error.to_string()))?)
        }
        None => builder.with_no_client_auth(),
    };
    let mut server = builder.with_single_cert(chain, key).map_err(|error| {
        let (place, what) = match error {
            rustls::Error::InconsistentKeys(_) => (key_file, format!("not the key of {certificate_file}")),
            error => (certificate_file, error.to_string()),
        };
        vec![Problem::new(place, what, "Give a certificate and its own key.")]
    })?;
    server.alpn_protocols = vec![b"h2".to_vec()];
    Ok(Arc::new(server))
}

fn certificates(file: &str, pem: &[u8]) -> Result<Vec<CertificateDer<'static>>, Vec<Problem>> {
    let wrong = |what: String| vec![Problem::new(file, what, "Give a certificate in PEM.")];
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(pem).collect();
    match found {
        Ok(found) if found.is_empty() => Err(wrong("it holds no certificate".into())),
        Ok(found) => Ok(found),
        Err(error) => Err(wrong(format!("not a certificate: {error}"))),
    }
}

/// Clients refuse an expired certificate, and their messages seldom say so.
fn warn_of_age(file: &str, chain: &[CertificateDer]) {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_secs() as i64);
    for certificate in chain {
        let Ok(certificate) = Certificate::from_der(certificate) else { continue };
        let certificate = certificate.tbs_certificate();
        let (subject, end) = (certificate.subject(), certificate.validity().not_after);
        match end.to_unix_duration().as_secs() as i64 - now {
            left if left < 0 => warn!(file, %subject, %end, "the certificate has expired: clients will refuse it"),
            left if left < SOON.as_secs() as i64 => {
                warn!(file, %subject, %end, "the certificate expires within 30 days: renew it, then send SIGHUP");
            }
            _ => {}
        }
    }
}

/// The encrypted connections of a listener. Each new one uses the latest settings.
pub fn incoming(
    listener: TcpListener,
    settings: watch::Receiver<Arc<ServerConfig>>,
    connections: Arc<Connections>,
) -> ReceiverStream<std::io::Result<Guarded<TlsStream<TcpStream>>>> {
    let handshakes = Arc::new(Semaphore::new(HANDSHAKES));
    accepting::incoming(listener, connections, move |stream: TcpStream| {
        let (acceptor, handshakes) = (TlsAcceptor::from(settings.borrow().clone()), handshakes.clone());
        async move {
            let _permit = handshakes.acquire_owned().await;
            match tokio::time::timeout(HANDSHAKE, acceptor.accept(stream)).await {
                Ok(Ok(stream)) => return Some(stream),
                Ok(Err(error)) => debug!(%error, "a TLS handshake failed"),
                Err(_) => debug!("a TLS handshake timed out"),
            }
            None
        }
    })
}
