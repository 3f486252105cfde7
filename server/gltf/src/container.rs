//! The outermost form of a file: is it glTF, and where are its JSON and its binary chunk?

use crate::problem::ProblemKind;

const MAGIC: &[u8] = b"glTF";
const CHUNK_JSON: &[u8] = b"JSON";
const CHUNK_BIN: &[u8] = b"BIN\0";

/// The JSON text and, in a GLB, the first binary chunk.
pub struct Chunks<'a> {
    pub json: &'a [u8],
    pub bin: Option<&'a [u8]>,
}

pub fn open(bytes: &[u8]) -> Result<Chunks<'_>, ProblemKind> {
    if bytes.is_empty() {
        return Err(ProblemKind::EmptyFile);
    }
    if bytes.starts_with(MAGIC) {
        return open_glb(bytes);
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if text.trim_ascii_start().first() == Some(&b'{') {
        return Ok(Chunks { json: text, bin: None });
    }
    Err(ProblemKind::NotGltf { seems: guess(bytes) })
}

fn open_glb(bytes: &[u8]) -> Result<Chunks<'_>, ProblemKind> {
    let broken = |fault: String| ProblemKind::Glb { fault };
    let word = |at: usize| {
        let bytes = at.checked_add(4).and_then(|end| bytes.get(at..end))?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(broken(format!("it ends after {} bytes, within the header", bytes.len())));
    };
    if version != 2 {
        return Err(ProblemKind::Version { version: version.to_string() });
    }
    let length = length as usize;
    if length > bytes.len() {
        return Err(broken(format!("it should have {length} bytes but ends after {}", bytes.len())));
    }
    // Bytes after the declared length are allowed to be anything.
    let bytes = &bytes[..length];
    let (mut json, mut bin) = (None, None);
    let mut at = 12;
    while at < length {
        let Some(header) = bytes.get(at..at + 8) else {
            return Err(broken(format!("it ends within the header of a chunk, at byte {at}")));
        };
        let size = u32::from_le_bytes([header[0], header[1], header[2], header[3]]) as usize;
        let start = at + 8;
        let Some(data) = start.checked_add(size).and_then(|end| bytes.get(start..end)) else {
            let left = length - start;
            return Err(broken(format!("a chunk of {size} bytes begins at byte {start}, where {left} are left")));
        };
        let kind = &header[4..8];
        if json.is_none() && kind != CHUNK_JSON {
            return Err(broken("its first chunk is not JSON".to_owned()));
        } else if kind == CHUNK_JSON && json.is_none() {
            json = Some(data);
        } else if kind == CHUNK_BIN && bin.is_none() {
            bin = Some(data);
        }
        at = start + size;
    }
    // Padding should be spaces; some writers pad with zeros, and some put a byte order mark before the text.
    let json = json.ok_or_else(|| broken("it has no JSON chunk".to_owned()))?;
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let end = json.iter().rposition(|&b| b != 0).map_or(0, |last| last + 1);
    Ok(Chunks { json: &json[..end], bin })
}

/// The likely format of a file that is not glTF, from its first bytes.
fn guess(bytes: &[u8]) -> &'static str {
    const SIGNS: [(&[u8], &str); 28] = [
        (b"\x89PNG", "a PNG picture"),
        (b"\xff\xd8\xff", "a JPEG picture"),
        (b"GIF8", "a GIF picture"),
        (b"RIFF", "a RIFF file (WebP, WAV or AVI)"),
        (b"\xabKTX", "a KTX texture"),
        (b"BLENDER", "a Blender file"),
        (b"Kaydara FBX", "an FBX file"),
        (b"; FBX", "an FBX file"),
        (b"ply", "a PLY file"),
        (b"solid", "an STL file"),
        (b"OFF", "an OFF file"),
        (b"COFF", "an OFF file"),
        (b"#usda", "a USD file"),
        (b"PXR-USDC", "a USD file"),
        (b"Ogawa", "an Alembic file"),
        (b"\x89HDF", "an HDF5 or Alembic file"),
        (b"3DS", "a 3D Studio file"),
        (b"MM", "a 3D Studio or TIFF file"),
        (b"PK\x03\x04", "a zip archive (perhaps .zip, .usdz or .3mf): unpack it first"),
        (b"\x1f\x8b", "a gzip archive or an old compressed Blender file: unpack it first"),
        (b"\x28\xb5\x2f\xfd", "a Zstandard archive or a compressed Blender file"),
        (b"version https://git-lfs", "a Git LFS pointer: fetch the real file with `git lfs pull`"),
        (b"<!DOCTYPE", "a web page: the download gave a page instead of the file"),
        (b"<html", "a web page: the download gave a page instead of the file"),
        (b"<?xml", "an XML file (perhaps COLLADA)"),
        (b"<COLLADA", "a COLLADA file"),
        (b"%PDF", "a PDF document"),
        (b"\x7fELF", "a program"),
    ];
    if let Some((_, seems)) = SIGNS.iter().find(|(sign, _)| bytes.starts_with(sign)) {
        return seems;
    }
    // Binary STL: 80 bytes of anything, the number of triangles, 50 bytes each.
    if let Some(&[a, b, c, d]) = bytes.get(80..84)
        && 84 + 50 * u64::from(u32::from_le_bytes([a, b, c, d])) == bytes.len() as u64
    {
        return "a binary STL file";
    }
    let head = &bytes[..bytes.len().min(4096)];
    let vertex = |line: &[u8]| line.starts_with(b"v ") || line.starts_with(b"mtllib ") || line.starts_with(b"vn ");
    if head.split(|&b| b == b'\n').any(vertex) {
        return "a Wavefront OBJ file";
    }
    let texty = |&b: &u8| b >= 32 || b.is_ascii_whitespace();
    if head.iter().all(|&b| b == 0) {
        "a file of zeros, as a broken copy leaves it"
    } else if head.iter().all(texty) {
        "some other text"
    } else {
        "some other binary file"
    }
}
