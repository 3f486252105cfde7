//! A seal at the end of a file of the server: a hash of what is before it, so that a disk that changes a byte is
//! noticed before anybody gets it.
//!
//! It is a field that no message has, so that earlier servers read sealed files, and this one reads theirs.

use std::io::{Error, ErrorKind, Result};

/// What is said of a file that has changed.
pub const CHANGED: &str = "it has changed since it was written";

/// The last field that Protocol Buffers have, with this many bytes.
const FIELD: [u8; 6] = [0xfa, 0xff, 0xff, 0xff, 0x0f, HASH as u8];
/// Bytes of the hash.
const HASH: usize = 8;

fn hash(content: &[u8]) -> [u8; HASH] {
    let mut hash = [0; HASH];
    blake3::Hasher::new().update(content).finalize_xof().fill(&mut hash);
    hash
}

/// The content with its seal.
pub fn sealed(mut content: Vec<u8>) -> Vec<u8> {
    let hash = hash(&content);
    content.extend(FIELD);
    content.extend(hash);
    content
}

/// The content without its seal, if it has one. Fails if it has changed.
pub fn unsealed(mut bytes: Vec<u8>) -> Result<Vec<u8>> {
    let end = bytes.len().saturating_sub(FIELD.len() + HASH);
    let (content, seal) = bytes.split_at(end);
    let Some(stated) = seal.strip_prefix(&FIELD) else { return Ok(bytes) };
    if stated != hash(content) {
        return Err(Error::new(ErrorKind::InvalidData, CHANGED));
    }
    bytes.truncate(end);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_wire::proto::BakeStatus;
    use prost::Message;

    #[test]
    fn a_changed_byte_is_noticed() {
        let status = BakeStatus { bake_id: "a bake".into(), owner: "anna".into(), ..Default::default() };
        let content = status.encode_to_vec();
        let whole = sealed(content.clone());
        assert_eq!(unsealed(whole.clone()).unwrap(), content);
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            // Without its seal, the content is as it was, with something behind it.
            assert!(unsealed(bytes).is_err() || at >= content.len(), "byte {at}");
        }
        // Earlier servers pass over it, and their files have none.
        assert_eq!(BakeStatus::decode(&whole[..]).unwrap(), status);
        assert_eq!(unsealed(content.clone()).unwrap(), content);
        assert!(unsealed(Vec::new()).unwrap().is_empty());
    }
}
