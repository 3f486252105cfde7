//! Requests for bakes: their id, and the limits of their caller.

use super::Entry;
use crate::access::{Caller, CallerLimits};
use crate::status::Fault;
use cairn_job::request;
use cairn_wire::effective::effective;
use cairn_wire::from_proto;
use cairn_wire::proto::{BakeSpec, Scene};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A request for a bake.
pub struct BakeSubmission {
    pub spec: BakeSpec,
    pub labels: BTreeMap<String, String>,
    pub priority: i32,
}

/// Puts the preset of the effective scene in the place of the accuracy `auto`.
pub(super) fn set_accuracy(spec: &mut BakeSpec, effective: Option<&Scene>) {
    if let (Some(scene), Some(effective)) = (&mut spec.scene, effective) {
        scene.accuracy = effective.accuracy;
    }
}

/// Checks that a caller and its project may have one more bake. `workers`: bakes that the server runs at the same time.
pub(super) fn within_limits<'a>(
    caller: &Caller,
    workers: usize,
    entries: impl Iterator<Item = &'a Arc<Entry>>,
) -> Result<(), Fault> {
    let [mut own, mut of_project] = [(0, 0); 2];
    for entry in entries {
        let now = entry.state.borrow();
        let add = |(unfinished, bytes): &mut (usize, u64)| {
            *unfinished += usize::from(!now.has_ended());
            *bytes += now.bytes();
        };
        if now.status.project == caller.project() {
            add(&mut of_project);
            if now.status.owner == *caller.name {
                add(&mut own);
            }
        }
    }
    check(&caller.name, caller.limits, workers, own)?;
    match &caller.project {
        Some(project) => check(&format!("project {}", project.name), project.limits, workers, of_project),
        None => Ok(()),
    }
}

fn check(name: &str, limits: CallerLimits, workers: usize, (unfinished, bytes): (usize, u64)) -> Result<(), Fault> {
    // Without a limit of running bakes, it may use all workers.
    let most = limits.queue.map(|queue| limits.bakes.unwrap_or(workers).max(1).saturating_add(queue));
    if let Some(most) = most.filter(|&most| unfinished >= most) {
        let what = format!("{name} has {unfinished} running or waiting bakes of at most {most}: wait for one to end");
        return Err(Fault::CallerLimit(what));
    }
    if let Some(most) = limits.bytes.filter(|&most| bytes >= most) {
        let what = format!("the bakes of {name} take {bytes} bytes of at most {most}: delete some of them");
        return Err(Fault::CallerLimit(what));
    }
    Ok(())
}

/// The id of a bake: a hash of everything that its pile depends on, and of the project, so that no project meets the
/// bakes of another one.
pub fn bake_id(spec: &BakeSpec, project: &str) -> String {
    let mut spec = spec.clone();
    spec.assets.sort_by(|a, b| a.uri.cmp(&b.uri));
    // An unset field and one set to its default give the same id.
    if let Some(scene) = &spec.scene
        && let Ok(params) = from_proto::params(scene)
    {
        spec.scene = Some(effective(scene, &params));
    }
    let hash = request::hash(&spec);
    let id = if project.is_empty() { hash } else { blake3::keyed_hash(hash.as_bytes(), project.as_bytes()) };
    id.to_hex().to_string()
}
