//! URIs of buffers and images: data URIs are decoded, paths are read as the world writes them, everything else is
//! refused.

use std::borrow::Cow;

use base64::Engine;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use crate::source::Resolver;

/// Padding is often forgotten and its absence loses nothing.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// How far a URI may lead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// To files in the glTF's folder and below it.
    Below,
    /// To pictures in folders above it, too: whoever reads them takes only what is a picture by its first bytes.
    Above,
}

/// The bytes that a URI stands for: its own data, or a file that `resolve` gives.
pub fn fetch(uri: &str, resolve: &Resolver) -> Result<Vec<u8>, String> {
    if is_data(uri) {
        return decode_data(uri);
    }
    find(uri, Reach::Below, resolve, |_| true).map(|(_, bytes)| bytes).map_err(|missing| missing.why)
}

/// Why a URI leads to no file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotFound {
    pub why: String,
    /// The paths that were tried, relative to the glTF's folder.
    pub tried: Vec<String>,
}

/// The file that a URI names: the first of its [`paths`] that is there and is wanted. Gives the path, too.
pub fn find(
    uri: &str,
    reach: Reach,
    resolve: &Resolver,
    is_wanted: impl Fn(&[u8]) -> bool,
) -> Result<(String, Vec<u8>), NotFound> {
    let tried = paths(uri, reach).map_err(|why| NotFound { why: why.to_owned(), tried: Vec::new() })?;
    let mut first = None;
    for path in &tried {
        match resolve(path) {
            // Above the folder there may be anything, which is nobody's business.
            Ok(bytes) if path.starts_with("../") && !is_wanted(&bytes) => {
                first.get_or_insert_with(|| "it is not of the kind that is wanted".to_owned());
            }
            Ok(bytes) => return Ok((path.clone(), bytes)),
            Err(why) => {
                first.get_or_insert(why);
            }
        }
    }
    Err(NotFound { why: first.unwrap_or_default(), tried })
}

/// Is it a `data:` URI?
pub fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

/// The bytes of a data URI, of any media type, in base64 or percent-encoded.
pub fn decode_data(uri: &str) -> Result<Vec<u8>, String> {
    let (head, body) = uri.split_once(',').ok_or("there is no comma before the data")?;
    let base64 = head.rsplit(';').next().is_some_and(|last| last.trim().eq_ignore_ascii_case("base64"));
    let body = if body.contains('%') {
        Cow::Owned(decode_percent(body).ok_or("a % is not followed by two hexadecimal digits")?)
    } else {
        Cow::Borrowed(body.as_bytes())
    };
    if !base64 {
        return Ok(body.into_owned());
    }
    let spaced = body.iter().any(u8::is_ascii_whitespace);
    let body =
        if spaced { Cow::Owned(body.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect()) } else { body };
    BASE64.decode(&body).map_err(|e| format!("bad base64, {}", e.to_string().to_lowercase()))
}

/// The paths that a URI may mean, likeliest first, relative to the glTF's folder, `/` between their parts; or why it
/// means none. At least one; `..` only in front, and only where `reach` admits it.
///
/// Files of the world hold more than URIs. Percent-encoding is undone once, so that `my%20bin` works; the name as it
/// stands comes next, for exporters that do not encode (`10%.bin`). A backslash is a slash. Of a path from a root or a
/// drive, its last parts are looked for in the glTF's folder: `C:\kit\tex\a.png` as `kit/tex/a.png`, `tex/a.png`,
/// `a.png`. But a URI that encodes a dot, a slash, a backslash or a colon tries to get past these rules, and is
/// refused. So are colons that are of no drive: schemes, alternate streams.
pub fn paths(uri: &str, reach: Reach) -> Result<Vec<String>, &'static str> {
    const HIDDEN: &str = "it hides a dot, slash, backslash or colon by %-encoding";
    if encodes_path_syntax(uri) {
        return Err(HIDDEN);
    }
    let decoded = match decode_percent(uri) {
        Some(bytes) => Some(String::from_utf8(bytes).map_err(|_| "its %-encoding is not UTF-8")?),
        None => None,
    };
    // A second decoding must find nothing either, in case the resolver decodes once more.
    if decoded.as_deref().is_some_and(encodes_path_syntax) {
        return Err(HIDDEN);
    }
    let mut found = Vec::new();
    let as_it_stands = decoded.as_deref() != Some(uri);
    for text in decoded.iter().map(String::as_str).chain(as_it_stands.then_some(uri)) {
        for path in paths_of(text, reach)? {
            if !found.contains(&path) {
                found.push(path);
            }
        }
    }
    Ok(found)
}

/// The paths that a text without percent-encoding may mean.
fn paths_of(text: &str, reach: Reach) -> Result<Vec<String>, &'static str> {
    /// Last parts of a path from a root that are looked for together.
    const MOST_LAST: usize = 4;
    if text.chars().any(char::is_control) {
        return Err("it contains control characters");
    }
    let text = text.replace('\\', "/");
    let file_scheme = text.get(..5).filter(|scheme| scheme.eq_ignore_ascii_case("file:"));
    let mut path = &text[file_scheme.map_or(0, str::len)..];
    let drive = path.trim_start_matches('/');
    let mut is_from_root = file_scheme.is_some() || path.starts_with('/');
    if let [letter, b':', ..] = drive.as_bytes()
        && letter.is_ascii_alphabetic()
    {
        (path, is_from_root) = (&drive[2..], true);
    }
    if path.contains(':') {
        return Err("it names a scheme or a stream, and only files are read");
    }
    if path.starts_with('~') {
        return Err("it starts in a home folder, and only files beside the glTF are read");
    }
    let (mut up, mut parts) = (0, Vec::new());
    for part in path.split('/') {
        match part {
            "." | "" => {}
            ".." => match parts.pop() {
                Some(_) => {}
                None => up += 1,
            },
            // Some systems drop trailing dots and spaces: `.. ` and `...` lead up there.
            _ if part.trim_end_matches(['.', ' ']).is_empty() => return Err("it leads out of the glTF's folder"),
            _ => parts.push(part),
        }
    }
    if parts.is_empty() {
        return Err("it names no file");
    }
    if is_from_root {
        let first = parts.len().saturating_sub(MOST_LAST);
        return Ok((first..parts.len()).map(|from| parts[from..].join("/")).collect());
    }
    if up > 0 && reach == Reach::Below {
        return Err("it leads out of the glTF's folder");
    }
    Ok(vec![format!("{}{}", "../".repeat(up), parts.join("/"))])
}

fn encodes_path_syntax(text: &str) -> bool {
    const HIDDEN: [&[u8]; 4] = [b"2e", b"2f", b"5c", b"3a"];
    text.as_bytes().windows(3).any(|w| w[0] == b'%' && HIDDEN.iter().any(|h| w[1..].eq_ignore_ascii_case(h)))
}

fn decode_percent(text: &str) -> Option<Vec<u8>> {
    let digit = |b: u8| char::from(b).to_digit(16).map(|d| d as u8);
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(b) = bytes.next() {
        if b == b'%' {
            let (high, low) = (digit(bytes.next()?)?, digit(bytes.next()?)?);
            out.push(16 * high + low);
        } else {
            out.push(b);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_below_the_folder_are_kept() {
        for (uri, expected) in [
            ("a.bin", &["a.bin"][..]),
            ("./a.bin", &["a.bin"]),
            ("sub/dir//a.bin", &["sub/dir/a.bin"]),
            ("sub/../a.bin", &["a.bin"]),
            ("hügel.bin", &["hügel.bin"]),
            ("a..b/c.bin", &["a..b/c.bin"]),
            (".hidden", &[".hidden"]),
            // Percent-encoding either way.
            ("my%20file.bin", &["my file.bin", "my%20file.bin"]),
            ("h%C3%BCgel.bin", &["hügel.bin", "h%C3%BCgel.bin"]),
            ("100%25.bin", &["100%.bin", "100%25.bin"]),
            ("example 10%.bin", &["example 10%.bin"]),
            ("50%zz.bin", &["50%zz.bin"]),
            // Backslashes.
            (".\\test.bin", &["test.bin"]),
            ("tex\\a.png", &["tex/a.png"]),
            // Roots and drives.
            ("/etc/passwd", &["etc/passwd", "passwd"]),
            ("//host/share", &["host/share", "share"]),
            ("C:\\kit\\tex\\a.png", &["kit/tex/a.png", "tex/a.png", "a.png"]),
            ("c:a", &["a"]),
            ("file:///C:/kit/a%20b.png", &["kit/a b.png", "a b.png", "kit/a%20b.png", "a%20b.png"]),
            ("FILE:a.png", &["a.png"]),
            ("/../../etc/passwd", &["etc/passwd", "passwd"]),
            ("/1/2/3/4/5/6", &["3/4/5/6", "4/5/6", "5/6", "6"]),
        ] {
            let found = paths(uri, Reach::Below).unwrap_or_else(|why| panic!("{uri}: {why}"));
            assert_eq!(found, expected, "{uri}");
        }
    }

    #[test]
    fn pictures_may_lie_above_the_folder() {
        for (uri, path) in [
            ("../textures/red.png", "../textures/red.png"),
            ("..\\textures\\red.png", "../textures/red.png"),
            ("a/../../b/./c.png", "../b/c.png"),
            ("../../a.png", "../../a.png"),
        ] {
            assert_eq!(paths(uri, Reach::Above), Ok(vec![path.to_owned()]), "{uri}");
            assert!(paths(uri, Reach::Below).is_err(), "{uri}");
        }
        // Only what is wanted comes from there.
        let resolve = |_: &str| Ok(b"secret".to_vec());
        let is_png = |bytes: &[u8]| bytes.starts_with(b"\x89PNG");
        assert!(find("../secret", Reach::Above, &resolve, is_png).is_err());
        assert!(find("secret", Reach::Above, &resolve, is_png).is_ok());
    }

    #[test]
    fn paths_that_lead_elsewhere_are_refused() {
        for uri in [
            "",
            ".",
            "./",
            "..",
            "../a.bin",
            "a/../../b",
            "a/..",
            "~/a",
            "http://x/y.bin",
            "HTTPS://x/y.bin",
            "a.bin:stream",
            "C:/a.bin:stream",
            "C:",
            "/",
            "..\\a",
            "%2e%2e/a",
            "%2E./a",
            "a%2fb",
            "%5ca",
            "%252e%252e/a",
            "%252fa",
            "file%3a//x",
            "%ff",
            "a%00b",
            "a\nb",
            ".. /a",
            ".../a",
            ". ./a",
        ] {
            let found = paths(uri, Reach::Below);
            // `. .` is made of dots and spaces alone, like every part refused here that has no other fault.
            assert!(found.is_err(), "{uri:?} gave {found:?}");
        }
    }

    #[test]
    fn data_uris_of_every_form() {
        for uri in [
            "data:application/octet-stream;base64,AQID/w==",
            "data:application/octet-stream;base64,AQID/w",
            "data:application/gltf-buffer;base64,AQID/w==",
            "data:;base64,AQID/w==",
            "DATA:text/plain;charset=utf-8;BASE64,AQID%2Fw==",
            "data:application/octet-stream;base64,AQ\n ID/w==",
            "data:,%01%02%03%ff",
        ] {
            assert!(is_data(uri));
            assert_eq!(decode_data(uri).as_deref(), Ok(&[1u8, 2, 3, 255][..]), "{uri:?}");
        }
        for uri in ["data:", "data:;base64", "data:;base64,A", "data:;base64,A*==", "data:,%f", "data:,%+1"] {
            assert!(decode_data(uri).is_err(), "{uri:?}");
        }
        assert!(!is_data("dat"));
        assert!(!is_data("ü:data"));
    }
}
