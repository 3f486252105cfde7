//! What was asked of a bake, all that decides its result included: so that a finished result is known again, and can be asked
//! for again.

use super::sources::InputFile;
use crate::model::document;
use crate::model::export::Format;
use crate::wire::digest::hex;
use crate::wire::proto::{AssetReference, BakeSpec, OutputFormat};
use crate::wire::versions::versions;
use prost::Message;
use sha2::{Digest, Sha256};

/// A file and those beside it that it names, with their hashes. One that is not there matters only to who needs it.
pub fn assets(file: &InputFile) -> Vec<AssetReference> {
    let asset = |uri: String, bytes: &[u8]| AssetReference { uri, sha256: hex(&Sha256::digest(bytes)) };
    let folder = file.name.rfind(['/', '\\']).map_or("", |at| &file.name[..=at]);
    let beside = document::external_files(&file.bytes).unwrap_or_default();
    let beside = beside.iter().filter_map(|relative| {
        let bytes = (file.resolve)(relative).ok()?;
        Some(asset(format!("{folder}{relative}"), &bytes))
    });
    std::iter::once(asset(file.name.clone(), &file.bytes)).chain(beside).collect()
}

/// The hash of a request and of the versions: the same hash, the same result, to the last byte. The request is one with nothing left
/// to defaults.
pub fn hash(request: &BakeSpec) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for bytes in [versions().encode_to_vec(), request.encode_to_vec()] {
        hasher.update(&(bytes.len() as u64).to_le_bytes()).update(&bytes);
    }
    hasher.finalize()
}

/// As the schema names it.
pub fn output_format(format: Format) -> OutputFormat {
    match format {
        Format::Glb => OutputFormat::Glb,
        Format::Json => OutputFormat::Json,
        Format::Csv => OutputFormat::Csv,
    }
}
