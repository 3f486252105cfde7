//! Images of a source file.

use cairn_gltf::Resolver;
use cairn_gltf::document::Object;
use cairn_gltf::uri::fetch;

/// Media type and bytes of an image that is to be embedded: a data URI, or a file that the resolver can reach. `None`
/// leaves the image as it is: a missing picture never spoils a pile.
pub fn external(image: &Object, resolve: &Resolver) -> Option<(&'static str, Vec<u8>)> {
    let bytes = fetch(image.get("uri")?.as_str()?, resolve).ok()?;
    Some((media_type(&bytes)?, bytes))
}

/// By the first bytes: names lie.
pub fn media_type(bytes: &[u8]) -> Option<&'static str> {
    const MAGIC: [(&[u8], &str); 4] = [
        (b"\x89PNG\r\n\x1a\n", "image/png"),
        (b"\xff\xd8\xff", "image/jpeg"),
        (b"\xabKTX 20\xbb\r\n\x1a\n", "image/ktx2"),
        (b"DDS ", "image/vnd-ms.dds"),
    ];
    if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        return Some("image/webp");
    }
    MAGIC.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|&(_, media)| media)
}
