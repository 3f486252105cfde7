//! The limits of new work: whether the server takes any, its places, and what a caller and its project may have.

use super::{Bakes, Entry};
use crate::access::{Caller, CallerLimits};
use crate::status::Fault;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

impl Bakes {
    /// Refuses new work once the server is shutting down.
    pub fn accepts_work(&self) -> Result<(), Fault> {
        if self.draining.is_cancelled() { Err(Fault::ShuttingDown) } else { Ok(()) }
    }

    pub(super) fn queue_full(&self) -> Fault {
        let last = *self.last_time.lock().unwrap_or_else(PoisonError::into_inner);
        Fault::QueueFull { retry: last.clamp(Duration::from_secs(1), Duration::from_secs(60)) }
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
