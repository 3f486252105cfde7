//! Messages on the wire. A field of a bake's spec that this version does not know is refused: a newer client must not
//! get another pile from an older server.

use crate::status::Fault;
use bytes::{Buf, Bytes};
use cairn_files::version::VERSION;
use cairn_wire::proto::{BakeRequest, BatchCreateBakesRequest, CreateBakeRequest, FieldProblem, PlanBakeRequest};
use cairn_wire::scene_file::schema;
use prost::Message;
use prost_reflect::{DynamicMessage, Value};
use std::any::TypeId;
use std::marker::PhantomData;
use tonic::Status;
use tonic::codec::{BufferSettings, Codec, DecodeBuf, Decoder};
use tonic_prost::{ProstCodec, ProstEncoder};

/// The usual codec, which also looks for unknown fields.
pub struct CheckedCodec<T, U>(PhantomData<(T, U)>);

impl<T, U> Default for CheckedCodec<T, U> {
    fn default() -> Self {
        CheckedCodec(PhantomData)
    }
}

impl<T: Message + Send + 'static, U: Message + Default + Send + 'static> Codec for CheckedCodec<T, U> {
    type Encode = T;
    type Decode = U;
    type Encoder = ProstEncoder<T>;
    type Decoder = CheckedDecoder<U>;

    fn encoder(&mut self) -> Self::Encoder {
        ProstCodec::<T, U>::raw_encoder(BufferSettings::default())
    }

    fn decoder(&mut self) -> Self::Decoder {
        CheckedDecoder(PhantomData)
    }
}

pub struct CheckedDecoder<U>(PhantomData<U>);

impl<U: Message + Default + 'static> Decoder for CheckedDecoder<U> {
    type Item = U;
    type Error = Status;

    fn decode(&mut self, buffer: &mut DecodeBuf<'_>) -> Result<Option<U>, Status> {
        let bytes = buffer.copy_to_bytes(buffer.remaining());
        let message = U::decode(bytes.clone()).map_err(|error| Status::internal(error.to_string()))?;
        // Without unknown fields, most libraries write the same number of bytes.
        match name_of_request::<U>().filter(|_| message.encoded_len() != bytes.len()) {
            Some(name) => check(name, bytes).map(|()| Some(message)),
            None => Ok(Some(message)),
        }
    }
}

/// The name of a message that has a bake's spec.
fn name_of_request<U: 'static>() -> Option<&'static str> {
    let named = [
        (TypeId::of::<BakeRequest>(), "cairn.v1.BakeRequest"),
        (TypeId::of::<PlanBakeRequest>(), "cairn.v1.PlanBakeRequest"),
        (TypeId::of::<CreateBakeRequest>(), "cairn.v1.CreateBakeRequest"),
        (TypeId::of::<BatchCreateBakesRequest>(), "cairn.v1.BatchCreateBakesRequest"),
    ];
    named.into_iter().find(|(id, _)| *id == TypeId::of::<U>()).map(|(_, name)| name)
}

#[allow(clippy::result_large_err)]
fn check(name: &str, bytes: Bytes) -> Result<(), Status> {
    let broken = |error: &dyn std::fmt::Display| Status::internal(error.to_string());
    let descriptor = schema::pool().get_message_by_name(name).ok_or_else(|| broken(&name))?;
    let request = DynamicMessage::decode(descriptor, bytes).map_err(|error| broken(&error))?;
    let mut problems = Vec::new();
    for name in ["spec", "requests"] {
        if let Some(spec) = request.get_field_by_name(name) {
            look(name, &spec, &mut problems);
        }
    }
    if problems.is_empty() { Ok(()) } else { Err(Fault::RequestInvalid(problems).into()) }
}

/// Looks for unknown fields in a value and all that is in it.
fn look(path: &str, value: &Value, problems: &mut Vec<FieldProblem>) {
    match value {
        Value::Message(message) => {
            for unknown in message.unknown_fields() {
                let number = unknown.number();
                let description = format!(
                    "{path}: this server (cairn {VERSION}) does not know the field of number {number}: update it, or \
                     leave the field out"
                );
                problems.push(FieldProblem { field: path.into(), description });
            }
            message.fields().for_each(|(field, value)| look(&format!("{path}.{}", field.name()), value, problems));
        }
        Value::List(list) => {
            list.iter().enumerate().for_each(|(index, value)| look(&format!("{path}[{index}]"), value, problems));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_wire::proto::{BakeSpec, Prop, Scene};
    use tonic::Code;
    use tonic_types::StatusExt;

    /// A field of a message: its number, and bytes.
    fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
        [&[number << 3 | 2, u8::try_from(bytes.len()).unwrap()], bytes].concat()
    }

    /// The number 15 as a field, of which no message of the request has any, and its value.
    const UNKNOWN: [u8; 3] = [0xf8, 0x7f, 1];

    #[test]
    fn unknown_fields_of_a_spec_are_refused() {
        let prop = Prop { path: "a.glb".into(), ..Default::default() };
        let scene = Scene { seed: Some(7), ..Default::default() };
        let number = |name: &str| {
            let scene = schema::scene();
            u8::try_from(scene.get_field_by_name(name).unwrap().number()).unwrap()
        };
        let in_prop = field(number("props"), &[prop.encode_to_vec(), UNKNOWN.to_vec()].concat());
        for (scene, after_spec, expected) in [
            (scene.encode_to_vec(), &[][..], &[][..]),
            // A call may have options that an older server does not know.
            (scene.encode_to_vec(), &UNKNOWN, &[]),
            ([scene.encode_to_vec(), UNKNOWN.to_vec()].concat(), &[], &["spec.scene"]),
            ([scene.encode_to_vec(), in_prop].concat(), &[], &["spec.scene.props[0]"]),
            // Written twice, which is another way to write the same.
            ([scene.encode_to_vec(), scene.encode_to_vec()].concat(), &[], &[]),
        ] {
            let spec = field(1, &scene);
            BakeSpec::decode(&spec[..]).unwrap();
            let request = [field(1, &spec), after_spec.to_vec()].concat();
            let checked = check("cairn.v1.PlanBakeRequest", request.into());
            let found: Vec<String> = checked.as_ref().err().map_or(Vec::new(), |status| {
                assert_eq!(status.code(), Code::InvalidArgument);
                let details = status.get_error_details();
                details.bad_request().unwrap().field_violations.iter().map(|found| found.field.clone()).collect()
            });
            assert_eq!(found, expected);
        }
        assert_eq!(name_of_request::<PlanBakeRequest>(), Some("cairn.v1.PlanBakeRequest"));
    }
}
