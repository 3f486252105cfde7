//! Schemas of other versions: callers of the one before, whom `proto/baseline.binpb` stands for, and those of the next,
//! which has fields and values that nobody knows yet; and this version as the caller of such a server.

use crate::service::server::{Server, assert_fault, fields, short};
use bytes::{Buf, BufMut, Bytes};
use cairn_wire::proto::bake_event::Kind;
use cairn_wire::proto::{self, BakeEvent, BakeState, BakeStatus};
use prost::Message;
use prost_reflect::{DescriptorPool, DynamicMessage, MessageDescriptor, Value};
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{EnumValueDescriptorProto, FieldDescriptorProto, FileDescriptorSet};
use tonic::codec::{Codec, DecodeBuf, Decoder, EncodeBuf, Encoder};
use tonic::{Code, Request, Status};
use tonic_types::StatusExt;

/// The number of what the next schema adds.
const NEXT: i32 = 900;

/// The schema of the version before.
fn before() -> DescriptorPool {
    DescriptorPool::decode(&include_bytes!("../../proto/baseline.binpb")[..]).unwrap()
}

/// This schema with a field `next` in every message, and a value more in every enum.
fn next() -> DescriptorPool {
    let mut set = FileDescriptorSet::decode(&cairn_wire::scene_file::schema::pool().encode_to_vec()[..]).unwrap();
    for file in set.file.iter_mut().filter(|file| file.package() == "cairn.v1") {
        for message in &mut file.message_type {
            message.field.push(FieldDescriptorProto {
                name: Some("next".into()),
                number: Some(NEXT),
                label: Some(Label::Optional.into()),
                r#type: Some(Type::String.into()),
                ..Default::default()
            });
        }
        for one in &mut file.enum_type {
            let name = format!("{}_NEXT", one.name().to_uppercase());
            one.value.push(EnumValueDescriptorProto { name: Some(name), number: Some(NEXT), ..Default::default() });
        }
    }
    DescriptorPool::from_file_descriptor_set(set).unwrap()
}

fn message(pool: &DescriptorPool, name: &str) -> MessageDescriptor {
    pool.get_message_by_name(&format!("cairn.v1.{name}")).unwrap()
}

/// A message of this version, as a caller with another schema has it.
fn as_in(pool: &DescriptorPool, name: &str, of: &impl Message) -> DynamicMessage {
    DynamicMessage::decode(message(pool, name), &of.encode_to_vec()[..]).unwrap()
}

/// Bytes as they are.
#[derive(Clone, Copy, Default)]
struct Raw;

impl Codec for Raw {
    type Encode = Vec<u8>;
    type Decode = Bytes;
    type Encoder = Raw;
    type Decoder = Raw;

    fn encoder(&mut self) -> Raw {
        Raw
    }

    fn decoder(&mut self) -> Raw {
        Raw
    }
}

impl Encoder for Raw {
    type Item = Vec<u8>;
    type Error = Status;

    fn encode(&mut self, item: Vec<u8>, buffer: &mut EncodeBuf<'_>) -> Result<(), Status> {
        buffer.put_slice(&item);
        Ok(())
    }
}

impl Decoder for Raw {
    type Item = Bytes;
    type Error = Status;

    fn decode(&mut self, buffer: &mut DecodeBuf<'_>) -> Result<Option<Bytes>, Status> {
        Ok(Some(buffer.copy_to_bytes(buffer.remaining())))
    }
}

/// Calls with a request of any schema. The messages of the answer.
async fn call(server: &Server, method: &str, request: &DynamicMessage) -> Result<Vec<Bytes>, Status> {
    let channel = crate::service::server::channel(&format!("http://{}", server.target().address)).await;
    let mut client = tonic::client::Grpc::new(channel);
    client.ready().await.unwrap();
    let path = format!("/cairn.v1.PileService/{method}").parse().unwrap();
    let request = Request::new(request.encode_to_vec());
    let mut answer = client.server_streaming(request, path, Raw).await?.into_inner();
    let mut messages = Vec::new();
    while let Some(message) = answer.message().await? {
        messages.push(message);
    }
    Ok(messages)
}

/// What is no message, is too large or means no call is answered as all other errors are.
#[tokio::test]
async fn bytes_that_are_no_message_have_an_answer() {
    let server = Server::start(&[]);
    server.ready().await;
    let send = async |method: &str, bytes: Vec<u8>| {
        let channel = crate::service::server::channel(&format!("http://{}", server.target().address)).await;
        let mut client = tonic::client::Grpc::new(channel);
        client.ready().await.unwrap();
        let path = format!("/cairn.v1.PileService/{method}").parse().unwrap();
        client.unary(Request::new(bytes), path, Raw).await.unwrap_err()
    };
    // A field of 100 bytes, of which two are there; a wire type that there is not; text that is not UTF-8; a group.
    for bytes in
        [&b"\x0a\x64ab"[..], b"\x0f", b"\x0a\x02\xff\xfe", b"\x0b\x0b", b"\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff"]
    {
        for method in ["GetBake", "CreateBake", "PlanBake", "CancelBake", "HaveAssets"] {
            let refused = send(method, bytes.to_vec()).await;
            assert_fault(&refused, Code::InvalidArgument, "REQUEST_INVALID");
        }
    }
    let refused = send("GetBake", b"\x0a\x64ab".to_vec()).await;
    let words = "it is no message cairn.v1.GetBakeRequest";
    assert!(refused.message().contains(words), "{refused:?}");
    assert!(refused.message().contains("encode it by this server's schema"), "{refused:?}");
    let refused = send("PlanBake", vec![0; 33 << 20]).await;
    assert_fault(&refused, Code::OutOfRange, "REQUEST_TOO_LARGE");
    assert!(refused.message().contains("the call cannot be taken: "), "{refused:?}");
    let refused = send("BakeTwice", Vec::new()).await;
    assert_fault(&refused, Code::Unimplemented, "NOT_OFFERED");
    assert!(refused.message().contains("there is no such call; see GetServerInfo"), "{refused:?}");
}

/// A caller of the version before bakes, and understands all that it knew.
#[tokio::test]
async fn the_version_before_is_understood() {
    let server = Server::start(&[]);
    server.ready().await;
    let pool = before();
    let wanted = as_in(&pool, "BakeRequest", &crate::service::server::request(short(1)));
    assert_eq!(wanted.unknown_fields().count(), 0);
    let events = call(&server, "Bake", &wanted).await.unwrap();
    let read = |bytes: &Bytes| DynamicMessage::decode(message(&pool, "BakeResponse"), bytes.clone()).unwrap();
    let events: Vec<DynamicMessage> = events.iter().map(read).collect();
    let event = |answer: &DynamicMessage| answer.get_field_by_name("event").unwrap().as_message().unwrap().clone();
    let of = |event: &DynamicMessage, name: &str| event.get_field_by_name(name).unwrap().as_message().unwrap().clone();
    let accepted = of(&event(&events[0]), "accepted");
    let id = accepted.get_field_by_name("bake_id").unwrap().as_str().unwrap().to_owned();
    let summary = of(&event(events.last().unwrap()), "summary");
    assert_eq!(summary.get_field_by_name("body_count").unwrap().as_i32(), Some(12));

    let mut get = DynamicMessage::new(message(&pool, "GetBakeRequest"));
    get.set_field_by_name("bake_id", Value::String(id.clone()));
    let answer = call(&server, "GetBake", &get).await.unwrap().swap_remove(0);
    let answer = DynamicMessage::decode(message(&pool, "GetBakeResponse"), answer).unwrap();
    let bake = of(&answer, "bake");
    assert_eq!(bake.get_field_by_name("state").unwrap().as_enum_number(), Some(BakeState::Succeeded.into()));
    let mut fetch = DynamicMessage::new(message(&pool, "DownloadResultRequest"));
    fetch.set_field_by_name("bake_id", Value::String(id));
    let parts = call(&server, "DownloadResult", &fetch).await.unwrap();
    let part = |bytes: &Bytes| DynamicMessage::decode(message(&pool, "DownloadResultResponse"), bytes.clone()).unwrap();
    let chunk = |part: &DynamicMessage| part.get_field_by_name("chunk").unwrap().as_bytes().unwrap().clone();
    let file: Vec<u8> = parts.iter().map(part).flat_map(|part| chunk(&part)).collect();
    assert!(file.starts_with(b"glTF"));
}

/// A caller of the next version gets no other pile than it asked for, and is understood where nothing depends on it.
#[tokio::test]
async fn the_next_version_is_refused_where_it_matters() {
    let server = Server::start(&[]);
    server.ready().await;
    let pool = next();
    let wanted = as_in(&pool, "BakeRequest", &crate::service::server::request(short(1)));
    let with = |path: &[&str]| {
        fn set(message: &mut DynamicMessage, path: &[&str]) {
            match path {
                [] => message.set_field_by_name("next", Value::String("news".into())),
                [name, rest @ ..] => match message.get_field_by_name_mut(name).unwrap() {
                    Value::Message(inside) => set(inside, rest),
                    Value::List(list) => set(list[0].as_message_mut().unwrap(), rest),
                    other => panic!("{other:?}"),
                },
            }
        }
        let mut changed = wanted.clone();
        set(&mut changed, path);
        changed
    };
    for (path, field) in [
        (&["spec"][..], "spec"),
        (&["spec", "scene"], "spec.scene"),
        (&["spec", "scene", "props"], "spec.scene.props[0]"),
        (&["spec", "scene", "fill"], "spec.scene.fill"),
        (&["spec", "assets"], "spec.assets[0]"),
    ] {
        let refused = call(&server, "Bake", &with(path)).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument, "{path:?}: {refused:?}");
        assert_eq!(fields(&refused.get_error_details()), [field]);
        assert!(refused.get_error_details().bad_request().unwrap().field_violations[0].description.contains("900"));
    }
    // A value that this version does not know is none of its own.
    let mut other = wanted.clone();
    let spec = other.get_field_by_name_mut("spec").unwrap().as_message_mut().unwrap();
    let scene = spec.get_field_by_name_mut("scene").unwrap().as_message_mut().unwrap();
    scene.set_field_by_name("accuracy", Value::EnumNumber(NEXT));
    assert_eq!(call(&server, "Bake", &other).await.unwrap_err().code(), Code::InvalidArgument);
    // How a stream is sent does not change the pile.
    let events = call(&server, "Bake", &with(&[])).await.unwrap();
    assert!(events.len() > 2);
    let mut list = DynamicMessage::new(message(&pool, "ListBakesRequest"));
    list.set_field_by_name("next", Value::String("news".into()));
    let answer = call(&server, "ListBakes", &list).await.unwrap().swap_remove(0);
    // And the caller reads the answers of this version with its own schema.
    let answer = DynamicMessage::decode(message(&pool, "ListBakesResponse"), answer).unwrap();
    assert_eq!(answer.get_field_by_name("bakes").unwrap().as_list().unwrap().len(), 1);
}

/// What a server of the next version says is read as far as this version knows it.
#[test]
fn the_next_server_is_understood() {
    let pool = next();
    let mut status = BakeStatus { bake_id: "1234567890".into(), owner: "anna".into(), ..Default::default() };
    status.set_state(BakeState::Running);
    let mut sent = as_in(&pool, "BakeStatus", &status);
    sent.set_field_by_name("next", Value::String("news".into()));
    let read = BakeStatus::decode(&sent.encode_to_vec()[..]).unwrap();
    assert_eq!(read, status);
    // A state that there was not: neither ended nor anything else that this version would act on.
    sent.set_field_by_name("state", Value::EnumNumber(NEXT));
    let read = BakeStatus::decode(&sent.encode_to_vec()[..]).unwrap();
    assert_eq!((read.state(), &*read.owner), (BakeState::Unspecified, "anna"));
    // An event of a new kind has none, and is passed over.
    let event = BakeEvent { sequence_number: 7, ..Default::default() };
    let mut sent = as_in(&pool, "BakeEvent", &event);
    sent.set_field_by_name("next", Value::String("news".into()));
    let read = BakeEvent::decode(&sent.encode_to_vec()[..]).unwrap();
    assert_eq!((read.sequence_number, read.kind), (7, None::<Kind>));
    // So are errors of a kind that is new.
    let failure = proto::Failure { reason: "OUT_OF_LUCK".into(), code: 9, ..Default::default() };
    let mut sent = as_in(&pool, "Failure", &failure);
    sent.set_field_by_name("next", Value::String("news".into()));
    assert_eq!(proto::Failure::decode(&sent.encode_to_vec()[..]).unwrap(), failure);
}
