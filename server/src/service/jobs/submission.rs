//! Requests for bakes: their id, and the limits of their caller.

use super::Entry;
use crate::job::request;
use crate::service::access::Caller;
use crate::service::status::Fault;
use crate::wire::effective::effective;
use crate::wire::from_proto;
use crate::wire::proto::BakeSpec;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A request for a bake.
pub struct BakeSubmission {
    pub spec: BakeSpec,
    pub labels: BTreeMap<String, String>,
    pub priority: i32,
}

/// Checks that a caller may have one more bake. `workers`: bakes that the server runs at the same time.
pub(super) fn within_limits<'a>(
    caller: &Caller,
    workers: usize,
    entries: impl Iterator<Item = &'a Arc<Entry>>,
) -> Result<(), Fault> {
    let limits = caller.limits;
    let (mut unfinished, mut bytes) = (0, 0);
    for entry in entries {
        let now = entry.state.borrow();
        if now.status.owner == *caller.name {
            unfinished += usize::from(!now.has_ended());
            bytes += (now.status.event_bytes + now.result_bytes).unsigned_abs();
        }
    }
    // Without a limit of running bakes, the caller may use all workers.
    let most = limits.queue.map(|queue| limits.bakes.unwrap_or(workers).max(1).saturating_add(queue));
    if let Some(most) = most.filter(|&most| unfinished >= most) {
        let what =
            format!("{} has {unfinished} running or waiting bakes of at most {most}: wait for one to end", caller.name);
        return Err(Fault::CallerLimit(what));
    }
    if let Some(most) = limits.bytes.filter(|&most| bytes >= most) {
        let what = format!("the bakes of {} take {bytes} bytes of at most {most}: delete some of them", caller.name);
        return Err(Fault::CallerLimit(what));
    }
    Ok(())
}

/// The id of a bake: a hash of everything that its pile depends on.
pub fn bake_id(spec: &BakeSpec) -> String {
    let mut spec = spec.clone();
    spec.assets.sort_by(|a, b| a.uri.cmp(&b.uri));
    // An unset field and one set to its default give the same id.
    if let Some(scene) = &spec.scene
        && let Ok(params) = from_proto::params(scene)
    {
        spec.scene = Some(effective(scene, &params));
    }
    request::hash(&spec).to_hex().to_string()
}
