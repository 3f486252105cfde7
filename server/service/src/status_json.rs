//! The status of a bake as JSON, for scripts and hooks.

use cairn_export::Format;
use cairn_wire::proto::{BakeState, BakeStatus};
use prost_types::Timestamp;
use serde_json::{Value, json};

/// The states by the names that scripts use.
pub const STATES: [(&str, BakeState); 5] = [
    ("queued", BakeState::Queued),
    ("running", BakeState::Running),
    ("succeeded", BakeState::Succeeded),
    ("failed", BakeState::Failed),
    ("cancelled", BakeState::Cancelled),
];

pub fn state_of(bake: &BakeStatus) -> &'static str {
    STATES.iter().find(|(_, state)| *state == bake.state()).map_or("unknown", |(name, _)| name)
}

/// Seconds that it ran, or has run so far by this machine's clock.
pub fn seconds(bake: &BakeStatus) -> Option<f64> {
    let start = bake.start_time?;
    let end = bake.end_time.unwrap_or_else(|| std::time::SystemTime::now().into());
    let of = |time: Timestamp| time.seconds as f64 + f64::from(time.nanos) * 1e-9;
    Some((of(end) - of(start)).max(0.0))
}

/// A time in UTC, as in RFC 3339.
pub fn time(time: Option<Timestamp>) -> String {
    time.map_or(String::new(), |time| Timestamp { nanos: 0, ..time }.to_string())
}

pub fn object(bake: &BakeStatus) -> Value {
    let callers: Vec<Value> =
        bake.callers.iter().map(|caller| json!({ "name": caller.name, "labels": caller.labels })).collect();
    let failure = bake.failure.as_ref().map(|failure| json!({ "reason": failure.reason, "message": failure.message }));
    let summary = bake.summary.as_ref();
    json!({
        "id": bake.bake_id,
        "state": state_of(bake),
        "format": Format::from_wire(bake.format()).extension(),
        "requested": time(bake.create_time),
        "owner": bake.owner,
        "project": bake.project,
        "callers": callers,
        "priority": bake.priority,
        "seconds": seconds(bake),
        "progress": bake.progress.map(|progress| progress.fraction),
        "bodies": summary.map(|summary| summary.body_count),
        "frames": summary.map(|summary| summary.frame_count),
        "result_bytes": summary.map(|summary| summary.result_bytes),
        "result_sha256": summary.map(|summary| summary.result_sha256.clone()),
        "failure": failure,
    })
}
