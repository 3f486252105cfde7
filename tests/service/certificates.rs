//! TLS, and callers identified by certificates.

use crate::service::server::{Server, assert_fault, command};
use cairn_service::client::{Connection, Target};
use cairn_wire::proto::ListBakesRequest;
use rcgen::{BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair};
use std::path::Path;
use std::time::{Duration, SystemTime};
use tonic::Code;

/// An authority.
struct Authority {
    pem: String,
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    fn new() -> Authority {
        let mut authority = CertificateParams::new(Vec::new()).unwrap();
        authority.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().unwrap();
        let pem = authority.self_signed(&key).unwrap().pem();
        Authority { pem, issuer: Issuer::new(authority, key) }
    }

    /// Certificate and key, PEM.
    fn sign(&self, certificate: &CertificateParams) -> (String, String) {
        let key = KeyPair::generate().unwrap();
        (certificate.signed_by(&key, &self.issuer).unwrap().pem(), key.serialize_pem())
    }

    /// A certificate with this common name; `None`: without one.
    fn sign_subject(&self, common_name: Option<&str>) -> Option<(Vec<u8>, Vec<u8>)> {
        let mut certificate = CertificateParams::new(vec!["somebody".into()]).unwrap();
        certificate.distinguished_name = rcgen::DistinguishedName::new();
        if let Some(name) = common_name {
            certificate.distinguished_name.push(DnType::CommonName, name);
        }
        let (certificate, key) = self.sign(&certificate);
        Some((certificate.into_bytes(), key.into_bytes()))
    }
}

/// An authority, and what it signed for a name: certificate and key, PEM.
fn signed(name: &str) -> (String, String, String) {
    let authority = Authority::new();
    let (certificate, key) = authority.sign(&CertificateParams::new(vec![name.into()]).unwrap());
    (authority.pem, certificate, key)
}

/// The settings of a server that requires certificates, and the authority of its own.
fn asks_for_certificates(folder: &Path, clients: &Authority) -> ([&'static str; 6], Vec<u8>) {
    let (ca, certificate, key) = signed("localhost");
    for (name, text) in [("cert.pem", &certificate), ("key.pem", &key), ("clients.pem", &clients.pem)] {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let tls = ["--tls-certificate", "cert.pem", "--tls-key", "key.pem", "--tls-client-ca", "clients.pem"];
    (tls, ca.into_bytes())
}

const CALLERS: &str = "
[[caller]]
name = 'anna'
token = 'token of anna'

[[caller]]
name = 'farm'
certificate = 'farm.studio'
";

/// A certificate without a name, or with an unknown one, does not identify a caller that has only a token.
#[tokio::test]
async fn callers_by_the_subject_of_their_certificate() {
    let folder = tempfile::tempdir().unwrap();
    let clients = Authority::new();
    let (tls, ca) = asks_for_certificates(folder.path(), &clients);
    std::fs::write(folder.path().join("callers.toml"), CALLERS).unwrap();
    let server = Server::start_in(folder.path(), &[&tls[..], &["--callers-file", "callers.toml"]].concat());
    let address = server.addresses[0].replace("127.0.0.1", "localhost");
    let by = |common_name: Option<&str>, token: Option<&str>| Target {
        address: address.clone(),
        token: token.map(str::to_owned),
        ca: Some(ca.clone()),
        identity: clients.sign_subject(common_name),
        ..Default::default()
    };
    for common_name in [None, Some(""), Some("anna"), Some("farm.studio.example")] {
        let refused = Connection::open(&by(common_name, None)).await.err().expect("nobody's certificate");
        assert_fault(&refused, Code::Unauthenticated, "TOKEN_INVALID");
        // Tokens still work.
        Connection::open(&by(common_name, Some("token of anna"))).await.unwrap();
    }
    let mut farm = Connection::open(&by(Some("farm.studio"), None)).await.unwrap();
    farm.service.list_bakes(ListBakesRequest::default()).await.unwrap();
    crate::service::callers::until_logged(&server, "caller=\"farm\" call=\"ListBakes\"").await;
    assert!(server.log().contains("caller=\"anna\" call=\"GetServerInfo\""), "{}", server.log());
}

#[tokio::test]
async fn encrypted_and_with_certificates_on_both_sides() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let (ca, certificate, key) = signed("localhost");
    let (client_ca, client_certificate, client_key) = signed("artist");
    let (other_ca, other_certificate, other_key) = signed("localhost");
    for (name, text) in [("cert.pem", &certificate), ("key.pem", &key), ("clients.pem", &client_ca)] {
        write(name, text);
    }
    let tls = ["--tls-certificate", "cert.pem", "--tls-key", "key.pem"];
    let server = Server::start_in(folder.path(), &tls);
    let address = |server: &Server| server.addresses[0].replace("127.0.0.1", "localhost");
    let target = Target { address: address(&server), ca: Some(ca.into_bytes()), ..Default::default() };
    let mut connection = Connection::open(&target).await.unwrap();
    connection.service.list_bakes(ListBakesRequest::default()).await.unwrap();
    assert!(Connection::open(&Target { ca: Some(other_ca.into_bytes()), ..target.clone() }).await.is_err());
    assert!(Connection::open(&server.target()).await.is_err(), "not without encryption");
    drop(server);

    let server = Server::start_in(folder.path(), &[&tls[..], &["--tls-client-ca", "clients.pem"]].concat());
    let target = Target { address: address(&server), ..target };
    let identity = |certificate: &str, key: &str| Some((certificate.as_bytes().to_vec(), key.as_bytes().to_vec()));
    let known = Target { identity: identity(&client_certificate, &client_key), ..target.clone() };
    Connection::open(&known).await.unwrap();
    assert!(Connection::open(&target).await.is_err());
    let unknown = Target { identity: identity(&other_certificate, &other_key), ..target };
    assert!(Connection::open(&unknown).await.is_err());
}

/// A certificate with a wrong key is reported before the server listens; one that expires soon gives a warning; a new
/// one is reloaded.
#[tokio::test]
async fn certificates_are_checked_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let (first, second) = (signed("localhost"), signed("localhost"));
    write("cert.pem", &first.1);
    write("key.pem", &second.2);
    let tls = ["--tls-certificate", "cert.pem", "--tls-key", "key.pem"];
    let done = command(folder.path()).args(["--listen", "127.0.0.1:0"]).args(tls).output().unwrap();
    let message = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.code() == Some(78) && message.contains("key.pem: not the key of cert.pem"), "{message}");
    assert!(done.stdout.is_empty() && !message.contains("listening"), "{message}");
    write("cert.pem", "no certificate");
    let done = command(folder.path()).args(["--listen", "127.0.0.1:0"]).args(tls).output().unwrap();
    assert_eq!(done.status.code(), Some(78));

    let key = KeyPair::generate().unwrap();
    let mut old = CertificateParams::new(vec!["localhost".into()]).unwrap();
    old.not_after = rcgen::date_time_ymd(2001, 1, 1);
    write("cert.pem", &old.self_signed(&key).unwrap().pem());
    write("key.pem", &key.serialize_pem());
    let server = Server::start_in(folder.path(), &tls);
    assert!(server.log().contains("has expired"), "{}", server.log());
    let address = server.addresses[0].replace("127.0.0.1", "localhost");
    let target = Target { address, ca: Some(second.0.into_bytes()), ..Default::default() };
    assert!(Connection::open(&target).await.is_err());
    write("cert.pem", &second.1);
    write("key.pem", &second.2);
    server.signal("-HUP");
    while Connection::open(&target).await.is_err() {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// A certificate that expires soon gives a warning with a remedy at the start.
#[tokio::test]
async fn a_certificate_that_expires_soon_is_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let key = KeyPair::generate().unwrap();
    write("key.pem", &key.serialize_pem());
    for (days, is_warned) in [(29, true), (32, false)] {
        let mut certificate = CertificateParams::new(vec!["localhost".into()]).unwrap();
        certificate.not_after = (SystemTime::now() + Duration::from_secs(days * 86_400)).into();
        write("cert.pem", &certificate.self_signed(&key).unwrap().pem());
        let server = Server::start_in(folder.path(), &["--tls-certificate", "cert.pem", "--tls-key", "key.pem"]);
        let log = server.log();
        assert_eq!(log.contains("expires within 30 days: renew it"), is_warned, "{log}");
        assert!(!log.contains("has expired"), "{log}");
        drop(server);
        std::fs::remove_file(folder.path().join("log")).unwrap();
    }
}
