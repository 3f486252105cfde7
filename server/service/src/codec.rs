//! Messages on the wire. What would take too much memory is refused before it is decoded, and so is a field of a bake's
//! spec that this version does not know: a newer client must not get another pile from an older server.

use crate::blocking::in_place;
use crate::bounds;
use crate::status::Fault;
use bytes::Buf;
use cairn_wire::scene_file::schema;
use prost::Message;
use prost_reflect::MessageDescriptor;
use std::marker::PhantomData;
use tonic::Status;
use tonic::codec::{BufferSettings, Codec, DecodeBuf, Decoder};
use tonic_prost::{ProstCodec, ProstEncoder};

/// The usual codec, which looks at requests first.
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
        let is_long = bytes.len() > LONG;
        let decode = || {
            let Some(request) = request::<U>() else {
                return U::decode(bytes).map(Some).map_err(|error| Status::internal(error.to_string()));
            };
            bounds::check(&request, &bytes, &["spec", "requests"])?;
            U::decode(bytes).map(Some).map_err(|error| {
                let what =
                    format!("it is no message {}: {error}; encode it by this server's schema", request.full_name());
                Fault::field("", what).into()
            })
        };
        if is_long { in_place(decode) } else { decode() }
    }
}

/// Larger messages take longer to decode than other calls may wait.
const LONG: usize = 64 << 10;

/// The schema of a request; `None`: of an answer, which a client reads.
fn request<U>() -> Option<MessageDescriptor> {
    let name = std::any::type_name::<U>().rsplit("::").next()?;
    name.ends_with("Request").then(|| schema::pool().get_message_by_name(&format!("cairn.v1.{name}")))?
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_wire::proto::PlanBakeRequest;
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
            let checked = bounds::check(&super::request::<PlanBakeRequest>().unwrap(), &request, &["spec", "requests"]);
            let checked = checked.map_err(Status::from);
            let found: Vec<String> = checked.as_ref().err().map_or(Vec::new(), |status| {
                assert_eq!(status.code(), Code::InvalidArgument);
                let details = status.get_error_details();
                details.bad_request().unwrap().field_violations.iter().map(|found| found.field.clone()).collect()
            });
            assert_eq!(found, expected);
        }
        assert_eq!(request::<PlanBakeRequest>().unwrap().full_name(), "cairn.v1.PlanBakeRequest");
        assert!(request::<BakeSpec>().is_none());
    }
}
