//! Any bytes as calls of the service: each ends with a status, and the store holds what was announced or nothing.

use cairn_service::in_process::InProcess;
use cairn_wire::proto::{AssetHeader, HaveAssetsRequest, ListBakesRequest, UploadAssetRequest};
use prost::Message;
use sha2::{Digest, Sha256};
use std::cell::RefCell;
use std::path::Path;
use tempfile::TempDir;

thread_local! {
    static SERVICE: RefCell<(InProcess, TempDir)> = RefCell::new(service());
}

fn service() -> (InProcess, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    (InProcess::new(folder.path()).unwrap(), folder)
}

/// Calls that start no process.
const METHODS: [&str; 8] = [
    "UploadAsset",
    "UploadAsset",
    "HaveAssets",
    "GetServerInfo",
    "GetBake",
    "ListBakes",
    "WatchBake",
    "DownloadResult",
];

/// First byte: which call, and whether the rest is its bytes or the content of an upload.
pub fn run(bytes: &[u8]) {
    let Some((form, rest)) = bytes.split_first() else { return };
    let method = METHODS[usize::from(form % 8)];
    let encoding = if form & 8 == 0 { "identity" } else { "gzip" };
    let body = if form & 16 == 0 { rest.to_vec() } else { upload(rest) };
    SERVICE.with_borrow_mut(|(service, folder)| {
        let status = service.call(method, encoding, body);
        let status = status.unwrap_or_else(|| panic!("{method} ends without a status"));
        // gRPC's own libraries end calls whose frames or messages are broken with INTERNAL.
        let is_sound = form & 24 == 16 && method == "UploadAsset";
        let faults: &[i32] = if is_sound { &[2, 13, 15] } else { &[2, 15] };
        assert!((0..=16).contains(&status) && !faults.contains(&status), "{method}: {status}");
        assert!(names(&folder.path().join("partial")).is_empty(), "something is left half written");
        for (name, content) in names(&folder.path().join("assets")) {
            assert_eq!(name, sha256(&content), "an asset is what its name says");
            std::fs::remove_file(folder.path().join("assets").join(name)).unwrap();
        }
    });
}

/// An upload of the content, in pieces; its second byte says what is wrong with it.
fn upload(bytes: &[u8]) -> Vec<u8> {
    let [wrong, piece, content @ ..] = bytes else { return Vec::new() };
    let mut header = AssetHeader { sha256: sha256(content), size_bytes: content.len() as i64 };
    match wrong % 8 {
        1 => header.size_bytes += 1,
        2 => header.size_bytes -= 1,
        3 => header.size_bytes = i64::from(*wrong) << 55,
        4 => header.sha256.replace_range(..1, "x"),
        5 => header.sha256 = sha256(&[*wrong]),
        _ => {}
    }
    let mut body = framed(&UploadAssetRequest { header: Some(header.clone()), ..Default::default() });
    for chunk in content.chunks(usize::from(*piece) + 1) {
        body.extend(framed(&UploadAssetRequest { header: None, chunk: chunk.to_vec().into() }));
    }
    if wrong % 8 == 6 {
        body.extend(framed(&UploadAssetRequest { header: Some(header), ..Default::default() }));
    }
    body
}

/// As gRPC sets messages apart: no compression, the length, the message.
fn framed(message: &impl Message) -> Vec<u8> {
    let bytes = message.encode_to_vec();
    [&[0], &(bytes.len() as u32).to_be_bytes()[..], &bytes].concat()
}

fn names(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = folder.read_dir().unwrap().map(|entry| entry.unwrap());
    entries.map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap())).collect()
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

pub fn seeds() -> Vec<Vec<u8>> {
    let mut seeds: Vec<Vec<u8>> =
        (0..8).map(|wrong| [&[16, wrong, 7], &b"the content of a prop"[..]].concat()).collect();
    let whole = upload(b"\0\x40the content of a prop, which is longer");
    seeds.push([&[0], &whole[..]].concat());
    seeds.push([&[8], &whole[..]].concat());
    let have = HaveAssetsRequest { sha256: vec![sha256(b"a"), "b".into()] };
    seeds.push([&[2], &framed(&have)[..]].concat());
    let list = ListBakesRequest { page_size: 3, page_token: "1.2.ab".into(), ..Default::default() };
    seeds.push([&[5], &framed(&list)[..]].concat());
    seeds.extend([3, 4, 6, 7].map(|form| vec![form, 0, 0, 0, 0, 0]));
    seeds
}
