//! What a caller asks for: which bake it is, and whether the caller may have one more.

use super::Entry;
use crate::job::request;
use crate::service::access::Caller;
use crate::service::status::Fault;
use crate::wire::effective::effective;
use crate::wire::from_proto;
use crate::wire::proto::{self, BakeSpec};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A request for a bake, as its caller put it.
pub struct Order {
    pub spec: BakeSpec,
    pub labels: BTreeMap<String, String>,
    pub priority: i32,
}

/// Whether a caller may have one more bake beside those that it has. `workers`: bakes that the server runs at once.
pub(super) fn within_limits<'a>(
    caller: &Caller,
    workers: usize,
    entries: impl Iterator<Item = &'a Arc<Entry>>,
) -> Result<(), Fault> {
    let limits = caller.limits;
    let (mut unfinished, mut bytes) = (0, 0);
    for entry in entries {
        let now = entry.now.borrow();
        if now.status.owner == *caller.name {
            unfinished += usize::from(!now.has_ended());
            bytes += (now.status.event_bytes + now.result_bytes).unsigned_abs();
        }
    }
    // Where its entry does not say, as many of its bakes run as the server has workers.
    let most = limits.queue.map(|queue| limits.bakes.unwrap_or(workers).max(1).saturating_add(queue));
    if let Some(most) = most.filter(|&most| unfinished >= most) {
        let told = format!("{} has {unfinished} bakes that run or wait, of {most}: wait for one to end", caller.name);
        return Err(Fault::CallerLimit(told));
    }
    if let Some(most) = limits.bytes.filter(|&most| bytes >= most) {
        let told = format!("the bakes of {} take {bytes} bytes, of {most}: delete some of them", caller.name);
        return Err(Fault::CallerLimit(told));
    }
    Ok(())
}

/// The id of a bake: a hash of all that its result depends on.
pub fn bake_id(spec: &BakeSpec) -> String {
    let mut spec = spec.clone();
    spec.set_format(match spec.format() {
        proto::OutputFormat::Unspecified => proto::OutputFormat::Glb,
        format => format,
    });
    spec.assets.sort_by(|a, b| a.uri.cmp(&b.uri));
    // A field that is not set and one that is set to its default are the same.
    if let Some(scene) = &spec.scene
        && let Ok(params) = from_proto::params(scene)
    {
        spec.scene = Some(effective(scene, &params));
    }
    request::hash(&spec).to_hex().to_string()
}
