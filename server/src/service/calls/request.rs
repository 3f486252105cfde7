//! Checks of requests before anything is done for them.

use crate::model::export::Format;
use crate::problem::Problem;
use crate::scene_file::SceneTree;
use crate::service::access::{Caller, LAST_PRIORITY};
use crate::service::jobs::{BakeSubmission, Entry, ListPosition};
use crate::service::status::Fault;
use crate::wire::proto::{
    AssetHeader, AssetReference, BakeRequest, BakeSpec, BakeStatus, FieldProblem, FrameSelection, ListBakesRequest,
    ListBakesResponse, OutputFormat,
};
use crate::wire::to_proto;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

/// Assets of one request: more than any scene has files.
const MAX_ASSETS: usize = 10_000;
/// Longest uri, bytes: the longest path that systems accept.
const MAX_URI: usize = 4096;
/// Bakes on a page, by default and at most.
const PAGE: usize = 100;
const MAX_PAGE: i32 = 1000;

/// The spec of a bake, if its form is right. The worker checks the files.
pub fn checked(spec: Option<BakeSpec>) -> Result<BakeSpec, Fault> {
    let spec = spec.ok_or_else(|| Fault::field("spec", "it is missing; describe the bake"))?;
    let mut problems = Vec::new();
    let mut wrong = |field: String, description: String| problems.push(FieldProblem { field, description });
    if OutputFormat::try_from(spec.format).is_err() {
        wrong("spec.format".into(), format!("there is no format {}; see OutputFormat", spec.format));
    } else if !Format::from_wire(spec.format()).is_single_file() {
        let what =
            "a result of this format may have texture files, but the service returns one file; use OUTPUT_FORMAT_USDZ";
        wrong("spec.format".into(), what.into());
    }
    if spec.assets.len() > MAX_ASSETS {
        wrong("spec.assets".into(), format!("more than {MAX_ASSETS}; pack files into .glb"));
    }
    let mut uris = BTreeSet::new();
    for (index, AssetReference { uri, sha256 }) in spec.assets.iter().enumerate().take(MAX_ASSETS) {
        let field = |name: &str| format!("spec.assets[{index}].{name}");
        if uri.is_empty() || uri.len() > MAX_URI {
            wrong(field("uri"), format!("{} bytes; give 1 to {MAX_URI}", uri.len()));
        } else if !uris.insert(Path::new(uri)) {
            wrong(field("uri"), format!("{uri:?} names two assets; name each file once"));
        }
        if !is_digest(sha256) {
            wrong(field("sha256"), format!("{uri}: {NO_DIGEST}"));
        }
    }
    match &spec.scene {
        None => wrong("spec.scene".into(), "it is missing; describe the scene".into()),
        Some(scene) => {
            let unknown = SceneTree::from_message(scene).problems();
            problems.extend(unknown.iter().map(|problem: &Problem| to_proto::field_problem(problem)));
        }
    }
    if problems.is_empty() { Ok(spec) } else { Err(Fault::RequestInvalid(problems)) }
}

/// Labels of one bake, and letters of a label's name or value.
const MAX_LABELS: usize = 64;
const MAX_LABEL: usize = 63;

/// The submission of a caller, if its form is right.
pub fn submission(caller: &Caller, request: BakeRequest) -> Result<BakeSubmission, Fault> {
    let BakeRequest { spec, labels, priority, .. } = request;
    let spec = checked(spec)?;
    if labels.len() > MAX_LABELS {
        return Err(Fault::field("labels", format!("more than {MAX_LABELS}")));
    }
    let is_name = |name: &str| name.starts_with(|letter: char| letter.is_ascii_lowercase());
    let is_plain = |text: &str| {
        let plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || matches!(byte, b'-' | b'_');
        text.len() <= MAX_LABEL && text.bytes().all(plain)
    };
    if let Some((name, _)) = labels.iter().find(|(name, value)| !(is_name(name) && is_plain(name) && is_plain(value))) {
        let what = "names begin with a letter; names and values have up to 63 of a-z, 0-9, - and _";
        return Err(Fault::field("labels", format!("{:?}: {what}", name.chars().take(MAX_LABEL).collect::<String>())));
    }
    if !(-LAST_PRIORITY..=LAST_PRIORITY).contains(&priority) {
        let what = format!("{priority} is out of range; give -{LAST_PRIORITY} to {LAST_PRIORITY}");
        return Err(Fault::field("priority", what));
    }
    if priority > caller.highest_priority() {
        return Err(Fault::NotAllowed("only operators may give a priority above 0; give 0 or less".into()));
    }
    Ok(BakeSubmission { spec, labels: labels.into_iter().collect(), priority })
}

const NO_DIGEST: &str = "not a SHA-256; give 64 lower-case hexadecimal digits";

/// Whether a text has the form of a SHA-256. No other text of a caller becomes part of a path.
fn is_digest(text: &str) -> bool {
    text.len() == 64 && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

pub fn check_digests(field: &str, digests: &[String]) -> Result<(), Fault> {
    if digests.len() > MAX_ASSETS {
        return Err(Fault::field(field, format!("more than {MAX_ASSETS}; ask in parts")));
    }
    let wrong = (digests.iter().enumerate())
        .filter(|(_, digest)| !is_digest(digest))
        .map(|(index, _)| FieldProblem { field: format!("{field}[{index}]"), description: NO_DIGEST.into() });
    let wrong: Vec<FieldProblem> = wrong.collect();
    if wrong.is_empty() { Ok(()) } else { Err(Fault::RequestInvalid(wrong)) }
}

/// Checks the header of an upload. `again`: the upload has sent one before.
pub fn check_header(header: &AssetHeader, again: bool, most: u64) -> Result<(), Fault> {
    if again {
        return Err(Fault::field("header", "only the first message may have one"));
    }
    if !is_digest(&header.sha256) {
        return Err(Fault::field("header.sha256", NO_DIGEST));
    }
    match u64::try_from(header.size_bytes) {
        Ok(bytes) if bytes > most => Err(Fault::AssetTooLarge(most)),
        Ok(_) => Ok(()),
        Err(_) => Err(Fault::field("header.size_bytes", "it is negative")),
    }
}

pub fn frames(given: i32) -> Result<FrameSelection, Fault> {
    FrameSelection::try_from(given).map_err(|_| Fault::field("frames", format!("there is no selection {given}")))
}

/// A page of the list. The token is the position of the last bake of the page before, even if that bake is gone.
pub fn page(mut list: Vec<Arc<Entry>>, request: &ListBakesRequest) -> Result<ListBakesResponse, Fault> {
    list.retain(|entry| {
        let bake = &entry.state().status;
        (request.owner.is_empty() || request.owner == bake.owner)
            && (request.states.is_empty() || request.states.contains(&bake.state))
            && request.labels.iter().all(|(name, value)| bake.labels.get(name) == Some(value))
    });
    let size = match request.page_size {
        0 => PAGE,
        size @ 1.. => size.min(MAX_PAGE) as usize,
        size => return Err(Fault::field("page_size", format!("{size} is negative; give 0 to {MAX_PAGE}"))),
    };
    let first = match &request.page_token[..] {
        "" => 0,
        token => {
            let last = position_of(token)
                .ok_or_else(|| Fault::field("page_token", "not a token of this server; leave it empty to begin"))?;
            list.partition_point(|entry| entry.position >= last)
        }
    };
    let rest = &list[first..];
    let page = &rest[..size.min(rest.len())];
    let next_page_token =
        page.last().filter(|_| rest.len() > size).map(|entry| token(&entry.position)).unwrap_or_default();
    // A summary that could not be written to disk is still in memory.
    let status = |entry: &Arc<Entry>| BakeStatus { summary: None, ..entry.state().status.clone() };
    Ok(ListBakesResponse { bakes: page.iter().map(status).collect(), next_page_token })
}

fn token((seconds, nanos, id): &ListPosition) -> String {
    format!("{seconds}.{nanos}.{id}")
}

/// The inverse of [`token`].
fn position_of(token: &str) -> Option<ListPosition> {
    let mut parts = token.splitn(3, '.');
    Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?, parts.next()?.to_owned()))
}
