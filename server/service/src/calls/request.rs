//! Checks of requests before anything is done for them.

use crate::access::{Caller, LAST_PRIORITY};
use crate::jobs::{BakeSubmission, Entry, ListPosition};
use crate::status::Fault;
use cairn_files::problem::Problem;
use cairn_wire::proto::{
    AnalysePileRequest, AssetHeader, AssetReference, BakeRequest, BakeSpec, BakeState, BakeStatus, FieldProblem,
    FrameSelection, ListBakesRequest, ListBakesResponse, OutputFormat,
};
use cairn_wire::scene_file::SceneTree;
use cairn_wire::to_proto;
use prost::Message;
use std::collections::{BTreeMap, BTreeSet};
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
    if OutputFormat::try_from(spec.format).is_err() {
        let description = format!("there is no format {}; see OutputFormat", spec.format);
        problems.push(FieldProblem { field: "spec.format".into(), description });
    }
    problems.extend(asset_problems("spec.assets", &spec.assets));
    match &spec.scene {
        None => problems
            .push(FieldProblem { field: "spec.scene".into(), description: "it is missing; describe the scene".into() }),
        Some(scene) => {
            let unknown = SceneTree::from_message(scene).problems();
            problems.extend(unknown.iter().map(|problem: &Problem| to_proto::field_problem(problem)));
        }
    }
    if problems.is_empty() { Ok(spec) } else { Err(Fault::RequestInvalid(problems)) }
}

/// What is wrong with the form of these assets.
fn asset_problems(list: &str, assets: &[AssetReference]) -> Vec<FieldProblem> {
    let mut problems = Vec::new();
    let mut wrong = |field: String, description: String| problems.push(FieldProblem { field, description });
    if assets.len() > MAX_ASSETS {
        wrong(list.into(), format!("more than {MAX_ASSETS}; pack files into .glb"));
    }
    let mut uris = BTreeSet::new();
    for (index, AssetReference { uri, sha256 }) in assets.iter().enumerate().take(MAX_ASSETS) {
        let field = |name: &str| format!("{list}[{index}].{name}");
        if uri.is_empty() || uri.len() > MAX_URI {
            wrong(field("uri"), format!("{} bytes; give 1 to {MAX_URI}", uri.len()));
        } else if !uris.insert(Path::new(uri)) {
            wrong(field("uri"), format!("{uri:?} names two assets; name each file once"));
        }
        if !is_digest(sha256) {
            wrong(field("sha256"), format!("{uri}: {NO_DIGEST}"));
        }
    }
    problems
}

/// Names of nodes in one list.
const MAX_NAMES: usize = 1000;

/// The request of an analysis, if its form is right.
pub fn analysis(request: AnalysePileRequest) -> Result<AnalysePileRequest, Fault> {
    let mut problems = asset_problems("assets", &request.assets);
    let mut wrong = |field: &str, what: String| {
        problems.push(FieldProblem { field: field.into(), description: what });
    };
    match (request.bake_id.is_empty(), request.assets.is_empty()) {
        (true, true) => wrong("assets", "they are missing; give a file, or a bake_id".into()),
        (false, false) => wrong("bake_id", "assets are given, too; give one of them".into()),
        _ => {}
    }
    for (field, names) in [("scenery", &request.scenery), ("without", &request.without)] {
        if names.len() > MAX_NAMES {
            wrong(field, format!("more than {MAX_NAMES}; let names end in *"));
        }
        if names.iter().any(|name| name.len() > MAX_URI) {
            wrong(field, format!("a name is longer than {MAX_URI} bytes"));
        }
    }
    let mut range = |field: &str, value: Option<f64>, is_right: fn(f64) -> bool, range: &str| {
        if let Some(value) = value.filter(|&value| !value.is_finite() || !is_right(value)) {
            wrong(field, format!("{value} is out of range; give {range}"));
        }
    };
    range("friction", request.friction, |value| (0.0..=2.0).contains(&value), "0 to 2");
    range("density", request.density, |value| value > 0.0, "a number above 0");
    range("ground_height", request.ground_height, |_| true, "a number");
    range("time_seconds", request.time_seconds, |_| true, "a number");
    range("friction_share", request.friction_share, |value| (0.0..=1.0).contains(&value), "0 to 1");
    if request.no_ground && request.ground_height.is_some() {
        wrong("ground_height", "there is no ground; leave one of them out".into());
    }
    if problems.is_empty() { Ok(request) } else { Err(Fault::RequestInvalid(problems)) }
}

/// Labels of one bake, and bytes of a label's name and value.
const MAX_LABELS: usize = 64;
const MAX_LABEL_NAME: usize = 63;
const MAX_LABEL_VALUE: usize = 255;

/// What is wrong with a label.
fn label_problems(name: &str, value: &str) -> Vec<FieldProblem> {
    let shown: String = name.chars().take(MAX_LABEL_NAME).collect();
    let problem = |what: String| FieldProblem { field: "labels".into(), description: format!("{shown:?}: {what}") };
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || matches!(byte, b'-' | b'_');
    let mut problems = Vec::new();
    if !name.starts_with(|letter: char| letter.is_ascii_lowercase()) {
        problems.push(problem("its name does not begin with a letter from a to z".into()));
    } else if !name.bytes().all(is_plain) {
        problems.push(problem("its name has other characters than a-z, 0-9, - and _".into()));
    }
    if name.len() > MAX_LABEL_NAME {
        problems.push(problem(format!("its name has {} characters; give {MAX_LABEL_NAME} at most", name.len())));
    }
    if value.chars().any(char::is_control) {
        problems.push(problem("its value has control characters".into()));
    }
    if value.len() > MAX_LABEL_VALUE {
        problems.push(problem(format!("its value has {} bytes; give {MAX_LABEL_VALUE} at most", value.len())));
    }
    problems
}

/// Checks the number of bakes in one request.
pub fn check_batch(count: usize) -> Result<(), Fault> {
    const MOST: usize = 1000;
    let is_right = (1..=MOST).contains(&count);
    is_right.then_some(()).ok_or_else(|| Fault::field("requests", format!("{count} bakes; give 1 to {MOST}")))
}

/// The submission of a caller, if its form is right.
pub fn submission(caller: &Caller, request: BakeRequest) -> Result<BakeSubmission, Fault> {
    let BakeRequest { spec, labels, priority, .. } = request;
    let spec = checked(spec)?;
    if labels.len() > MAX_LABELS {
        return Err(Fault::field("labels", format!("more than {MAX_LABELS}")));
    }
    let wrong: Vec<FieldProblem> = labels.iter().flat_map(|(name, value)| label_problems(name, value)).collect();
    if !wrong.is_empty() {
        return Err(Fault::RequestInvalid(wrong));
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

/// A page of the list. The token is a hash of the filter, and the position of the last bake of the page before, even if
/// that bake is gone.
pub fn page(mut list: Vec<Arc<Entry>>, request: &ListBakesRequest) -> Result<ListBakesResponse, Fault> {
    let unknown = request.states.iter().enumerate().find(|(_, state)| BakeState::try_from(**state).is_err());
    if let Some((index, state)) = unknown {
        return Err(Fault::field(&format!("states[{index}]"), format!("there is no state {state}; see BakeState")));
    }
    list.retain(|entry| {
        let bake = &entry.state().status;
        let has_all = |labels: &BTreeMap<String, String>| request.labels.iter().all(|(k, v)| labels.get(k) == Some(v));
        let is_of = |name: &str| request.owner.is_empty() || request.owner == name;
        (is_of(&bake.owner) || bake.callers.iter().any(|caller| is_of(&caller.name)))
            && (request.states.is_empty() || request.states.contains(&bake.state))
            && (has_all(&bake.labels) || bake.callers.iter().any(|caller| has_all(&caller.labels)))
    });
    let size = match request.page_size {
        0 => PAGE,
        size @ 1.. => size.min(MAX_PAGE) as usize,
        size => return Err(Fault::field("page_size", format!("{size} is negative; give 0 to {MAX_PAGE}"))),
    };
    let filter = filter_hash(request);
    let first = match &request.page_token[..] {
        "" => 0,
        token => {
            let wrong = |what: &str| Fault::field("page_token", what);
            let (of, last) = token.split_once('.').ok_or_else(|| wrong(NO_TOKEN))?;
            let last = position_of(last).ok_or_else(|| wrong(NO_TOKEN))?;
            if of != filter {
                return Err(wrong(
                    "it is of a list with another owner, other labels or states; repeat those of that call",
                ));
            }
            list.partition_point(|entry| entry.position >= last)
        }
    };
    let rest = &list[first..];
    let page = &rest[..size.min(rest.len())];
    let token = |entry: &Arc<Entry>| format!("{filter}.{}", token(&entry.position));
    let next_page_token = page.last().filter(|_| rest.len() > size).map(token).unwrap_or_default();
    // A summary that could not be written to disk is still in memory.
    let status = |entry: &Arc<Entry>| BakeStatus { summary: None, ..entry.state().status.clone() };
    Ok(ListBakesResponse { bakes: page.iter().map(status).collect(), next_page_token })
}

const NO_TOKEN: &str = "not a token of this server; leave it empty to begin";

/// Of all that selects the bakes of a list.
fn filter_hash(request: &ListBakesRequest) -> String {
    let filter = ListBakesRequest { page_size: 0, page_token: String::new(), ..request.clone() };
    blake3::hash(&filter.encode_to_vec()).to_hex()[..16].to_owned()
}

fn token((seconds, nanos, id): &ListPosition) -> String {
    format!("{seconds}.{nanos}.{id}")
}

/// The inverse of [`token`].
fn position_of(token: &str) -> Option<ListPosition> {
    let mut parts = token.splitn(3, '.');
    Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?, parts.next()?.to_owned()))
}
