//! URIs of buffers and images: data URIs are decoded, relative paths are checked, everything else is refused.

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

/// The bytes that a URI stands for: its own data, or a file below the glTF's folder.
pub fn fetch(uri: &str, resolve: &Resolver) -> Result<Vec<u8>, String> {
    if is_data(uri) {
        return decode_data(uri);
    }
    resolve(&relative_path(uri).map_err(|why| format!("{uri}: {why}"))?)
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

/// The path of a file at or below the glTF's own folder, `/` between its parts; or why it is not one.
///
/// Percent-encoding is undone once, so that `my%20bin` works; but a URI that encodes a dot, a slash, a backslash or a
/// colon tries to get past this check. Colons are refused wherever they stand: schemes, drives, alternate streams.
pub fn relative_path(uri: &str) -> Result<String, &'static str> {
    if encodes_path_syntax(uri) {
        return Err("it hides a dot, slash, backslash or colon by %-encoding");
    }
    let bytes = decode_percent(uri).ok_or("a % is not followed by two hexadecimal digits")?;
    let path = String::from_utf8(bytes).map_err(|_| "its %-encoding is not UTF-8")?;
    // A second decoding must find nothing either, in case the resolver decodes once more.
    if encodes_path_syntax(&path) {
        return Err("it hides a dot, slash, backslash or colon by %-encoding");
    }
    if path.chars().any(char::is_control) {
        return Err("it contains control characters");
    }
    if path.contains('\\') {
        return Err("it contains a backslash");
    }
    if path.contains(':') {
        return Err("it names a scheme or drive, and only files beside the glTF are read");
    }
    if path.starts_with('/') || path.starts_with('~') {
        return Err("it is an absolute path");
    }
    let mut parts = Vec::new();
    for part in path.split('/') {
        match part {
            "." | "" => {}
            // Some systems drop trailing dots and spaces: `.. ` and `...` lead up there.
            _ if part.trim_end_matches(['.', ' ']).is_empty() => return Err("it leads out of the glTF's folder"),
            _ => parts.push(part),
        }
    }
    if parts.is_empty() { Err("it names no file") } else { Ok(parts.join("/")) }
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
        for (uri, path) in [
            ("a.bin", "a.bin"),
            ("./a.bin", "a.bin"),
            ("sub/dir//a.bin", "sub/dir/a.bin"),
            ("my%20file.bin", "my file.bin"),
            ("h%C3%BCgel.bin", "hügel.bin"),
            ("hügel.bin", "hügel.bin"),
            ("100%25.bin", "100%.bin"),
            ("a..b/c.bin", "a..b/c.bin"),
            (".hidden", ".hidden"),
        ] {
            assert_eq!(relative_path(uri).as_deref(), Ok(path), "{uri}");
        }
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
            "/etc/passwd",
            "//host/share",
            "~/a",
            "C:/a.bin",
            "c:a",
            "file:///etc/passwd",
            "http://x/y.bin",
            "a.bin:stream",
            "..\\a",
            "a\\b",
            "%2e%2e/a",
            "%2E./a",
            "a%2fb",
            "%5ca",
            "%252e%252e/a",
            "%252fa",
            "file%3a//x",
            "%ff",
            "%",
            "%4",
            "%zz",
            "a%00b",
            "a\nb",
            ".. /a",
            ".../a",
            ". ./a",
        ] {
            let found = relative_path(uri);
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
