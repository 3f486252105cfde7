//! Attacks on a server, for tests and for the siege.

use crate::service::server::{asset, content, sha256, spec};
use bytes::Bytes;
use cairn_service::client::Connection;
use cairn_wire::proto::BakeSpec;
use std::io::{Cursor, Write};
use std::pin::Pin;
use std::task::{Context, Poll};
use tonic::codegen::{Service, http};
use tonic::transport::Channel;
use tonic::{Code, Status};

/// A model that is small for what it stands for.
pub struct Bomb {
    pub name: &'static str,
    /// Its file's name.
    file: &'static str,
    bytes: Vec<u8>,
    /// What the refusal says, and what bounds it.
    pub says: &'static str,
    pub bound: &'static str,
}

#[derive(Clone, Copy, PartialEq)]
pub enum BombSize {
    /// Of some kilobytes.
    Small,
    /// As they were found.
    Large,
}

const TRIANGLE: &str = "def Mesh \"m\" {\npoint3f[] points = [(0,0,0), (1,0,0), (0,1,0)]\n\
                        int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n}\n";

pub async fn upload(connection: &mut Connection, files: &[Vec<u8>]) {
    connection.upload(&files.iter().map(|bytes| (sha256(bytes), bytes.clone().into())).collect()).await.unwrap();
}

impl Bomb {
    /// Uploads it, and gives a bake of it.
    pub async fn upload(&self, connection: &mut Connection) -> BakeSpec {
        upload(connection, &[self.bytes.clone(), content("cone-small.glb")]).await;
        let mut spec = spec(&[]);
        spec.scene.as_mut().unwrap().props[0].path = self.file.into();
        spec.assets[1].uri = self.file.into();
        spec.assets[1].sha256 = sha256(&self.bytes);
        spec
    }

    pub fn bytes(&self) -> usize {
        self.bytes.len()
    }
}

/// Models that stand for much.
pub fn bombs(size: BombSize) -> Vec<Bomb> {
    let is_large = size == BombSize::Large;
    let usd = |prims: String| format!("#usda 1.0\n{prims}").into_bytes();
    let mut bombs = vec![
        Bomb {
            name: "30 nested double references in USD",
            file: "nested.usda",
            bytes: usd(nested(|name, before| {
                format!("def \"{name}\" (references = [</a{before}>, </b{before}>]) {{}}\n")
            })),
            says: "the references of a prim multiply to more than",
            bound: "1,000 sites of a prim, counted before it is composed",
        },
        Bomb {
            name: "a deflated .usdz",
            file: "deflated.usdz",
            bytes: deflated(if is_large { 1 << 30 } else { 1 << 20 }),
            says: "is compressed, which USD forbids in a .usdz",
            bound: "no compression",
        },
        Bomb {
            name: "instances of instances in USD",
            file: "instances.usda",
            bytes: usd(instances(if is_large { 1_000_000 } else { 500_000 })),
            says: "prims and instances of few bytes",
            bound: "nodes by the bytes of the files; prototypes are read once",
        },
        Bomb {
            name: "value clips without an end in USD",
            file: "clips.usda",
            bytes: usd(format!(
                "def Xform \"a\" (clips = {{ dictionary default = {{\nstring templateAssetPath = \"a.#.usda\"\n\
                 double templateStartTime = 0\ndouble templateEndTime = 1e300\ndouble templateStride = 1\n}} }}) {{\n\
                 {TRIANGLE}}}\n"
            )),
            says: "its value clips are more than",
            bound: "10,000 clips",
        },
    ];
    // Ten thousand prims take seconds.
    if is_large {
        bombs.push(Bomb {
            name: "prims that double at every level of USD",
            file: "levels.usda",
            bytes: usd(nested(|name, before| {
                format!(
                    "def \"{name}\" {{\ndef \"x\" (references = </a{before}>) {{}}\n\
                     def \"y\" (references = </b{before}>) {{}}\n}}\n"
                )
            })),
            says: "it is not composed",
            bound: "prims and sites by the bytes of the files",
        });
    }
    bombs
}

/// Two prims in each of 30 steps, each with the two before it.
fn nested(prim: impl Fn(String, usize) -> String) -> String {
    let mut prims = format!("def \"a0\" {{ {TRIANGLE} }}\ndef \"b0\" {{ {TRIANGLE} }}\n");
    for n in 1..=30 {
        prims += &prim(format!("a{n}"), n - 1);
        prims += &prim(format!("b{n}"), n - 1);
    }
    prims
}

/// A thousand instances of instances.
fn instances(count: usize) -> String {
    let each = 1000;
    let list = |entry: &str, count: usize| vec![entry; count].join(",");
    let instancer = |name: &str, of: &str, count: usize| {
        format!(
            "def PointInstancer \"{name}\" {{\nrel prototypes = <{of}>\nint[] protoIndices = [{}]\n\
             point3f[] positions = [{}]\n}}\n",
            list("0", count),
            list("(0,0,0)", count)
        )
    };
    format!(
        "def Xform \"p\" {{ {TRIANGLE} }}\n{}{}",
        instancer("inner", "/p", each),
        instancer("outer", "/inner", count / each)
    )
}

/// A package of spaces, which deflate to a thousandth.
fn deflated(size: usize) -> Vec<u8> {
    let mut package = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    package.start_file("a.usda", options).unwrap();
    package.write_all(b"#usda 1.0\n").unwrap();
    let spaces = vec![b' '; 1 << 20];
    for _ in 0..size >> 20 {
        package.write_all(&spaces).unwrap();
    }
    package.finish().unwrap().into_inner()
}

/// A `.glb` of one mesh with very many primitives.
pub fn primitives(count: usize) -> Bomb {
    let whole = std::fs::read(asset("stick.glb")).unwrap();
    let length = u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
    let mut json: serde_json::Value = serde_json::from_slice(&whole[20..20 + length]).unwrap();
    let one = json["meshes"][0]["primitives"][0].clone();
    json["meshes"][0]["primitives"] = vec![one; count].into();
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &whole[20 + length..];
    let word = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
    let whole = [b"glTF\x02\0\0\0", &word(20 + text.len() + rest.len())[..], &word(text.len()), b"JSON", &text, rest];
    Bomb { name: "primitives", file: "primitives.glb", bytes: whole.concat(), says: "", bound: "" }
}

/// The body of a call: bytes, and then an end or none.
struct Sent {
    bytes: Option<Bytes>,
    has_end: bool,
}

impl http_body::Body for Sent {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<Result<http_body::Frame<Bytes>, Status>>> {
        match self.bytes.take() {
            Some(bytes) => Poll::Ready(Some(Ok(http_body::Frame::data(bytes)))),
            None if self.has_end => Poll::Ready(None),
            None => Poll::Pending,
        }
    }
}

/// Bytes that a method gets, whatever they are.
#[derive(Clone)]
pub struct RawCall {
    method: &'static str,
    bytes: Bytes,
    has_end: bool,
}

impl RawCall {
    /// One message, as gRPC frames it.
    pub fn new(method: &'static str, message: &[u8]) -> RawCall {
        let length = u32::try_from(message.len()).unwrap().to_be_bytes();
        RawCall { method, bytes: [&[0][..], &length, message].concat().into(), has_end: true }
    }

    /// A message of which the last MiB never comes.
    pub fn unfinished(method: &'static str, size: usize) -> RawCall {
        let whole = RawCall::new(method, &vec![0; size]);
        RawCall { bytes: whole.bytes.slice(..whole.bytes.len() - (1 << 20)), has_end: false, ..whole }
    }

    /// Calls it. Gives the answer's code, if there is one.
    pub async fn send(&self, channel: &mut Channel, token: Option<&str>) -> Option<Code> {
        let mut request = http::Request::post(format!("http://siege/cairn.v1.PileService/{}", self.method))
            .header("content-type", "application/grpc")
            .header("te", "trailers");
        if let Some(token) = token {
            request = request.header("authorization", format!("Bearer {token}"));
        }
        let body = Sent { bytes: Some(self.bytes.clone()), has_end: self.has_end };
        let request = request.body(tonic::body::Body::new(body)).unwrap();
        std::future::poll_fn(|context| channel.poll_ready(context)).await.ok()?;
        let answer = channel.call(request).await.ok()?;
        Status::from_header_map(answer.headers()).map(|status| status.code())
    }
}

/// A field of bytes within a message: its number, and what it holds.
fn field(number: u8, content: &[u8]) -> Vec<u8> {
    let mut bytes = vec![number << 3 | 2];
    let mut length = content.len();
    while length >= 0x80 {
        bytes.push((length & 0x7f) as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
    bytes.extend_from_slice(content);
    bytes
}

/// Requests of so many bytes that would take some hundred times as many.
pub fn swelling(bytes: usize) -> Vec<(&'static str, RawCall)> {
    let empty = |number: u8| [number << 3 | 2, 0].repeat(bytes / 2);
    let props = field(1, &field(1, &empty(SCENE_PROPS)));
    vec![
        ("BatchCreateBakes of empty requests", RawCall::new("BatchCreateBakes", &empty(1))),
        ("PlanBake of empty props", RawCall::new("PlanBake", &props)),
        ("CreateBake of empty labels", RawCall::new("CreateBake", &empty(2))),
    ]
}

/// A request for a bake with so many bytes of labels, each its own, and without a scene.
pub fn labels(bytes: usize) -> RawCall {
    /// Of the label below.
    const EACH: usize = 24;
    let label = |n: usize| field(2, &[field(1, format!("{n:08}").as_bytes()), field(2, b"12345678")].concat());
    RawCall::new("CreateBake", &(0..bytes / EACH).flat_map(label).collect::<Vec<u8>>())
}

/// The number of the field `props` of a scene.
const SCENE_PROPS: u8 = 2;
