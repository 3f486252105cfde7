//! The contact sheet as a single page, which needs no other file, server or network.

use super::{Candidate, Thumbnail};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::read::DeflateDecoder;
use image::codecs::jpeg::JpegEncoder;
use serde_json::{Map, Value, json};
use std::io::Read;

const PAGE: &str = include_str!("sheet.html");
/// `viewer.min.js`, compressed.
const VIEWER: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/viewer.deflate"));
const JPEG_QUALITY: u8 = 88;

/// Makes the page. It embeds the results in their order while they fit into `room` bytes.
pub fn page(
    title: &str,
    order: &str,
    entries: &[(Candidate, Thumbnail)],
    shown: &[String],
    mut room: usize,
) -> Result<String, image::ImageError> {
    let mut listed = Vec::new();
    let mut models = String::new();
    for (number, (candidate, thumbnail)) in entries.iter().enumerate() {
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode_image(thumbnail)?;
        // The shown figures come first.
        let rest = candidate.figures.keys().filter(|name| !shown.contains(name));
        let names = shown.iter().chain(rest);
        let figures: Map<String, Value> =
            names.filter_map(|name| Some((name.clone(), candidate.formatted(name)?.into()))).collect();
        listed.push(json!({
            "name": candidate.name,
            "picture": format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)),
            "figures": figures,
        }));
        if candidate.bytes.len() <= room {
            room -= candidate.bytes.len();
            let text = STANDARD.encode(&candidate.bytes);
            models += &format!("<script type=\"text/plain\" id=\"model-{number}\">{text}</script>\n");
        }
    }
    let sheet = json!({ "title": title, "order": order, "shown": shown, "entries": listed });
    // The data must not end its script element.
    let sheet = sheet.to_string().replace('<', "\\u003c");
    let mut viewer = String::new();
    DeflateDecoder::new(VIEWER).read_to_string(&mut viewer)?;
    let parts = [("/*VIEWER*/", &viewer), ("/*SHEET*/", &sheet), ("<!--MODELS-->", &models)];
    let mut page = String::new();
    let mut rest = PAGE;
    for (mark, content) in parts {
        let (before, after) = rest.split_once(mark).expect("the page has its marks, in this order");
        page += before;
        page += content;
        rest = after;
    }
    Ok(page + rest)
}
