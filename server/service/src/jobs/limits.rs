//! The limits of new work: whether the server takes any, its places, and what a caller and its project may have.

use super::{Bakes, Entry};
use crate::access::{Caller, CallerLimits};
use crate::accounts::Account;
use crate::asset_owners::{AssetOwners, Reservation};
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
    uploads: &AssetOwners,
) -> Result<(), Fault> {
    let account = account(caller);
    let [own, of_project] = sums(&account, entries, uploads);
    check(&caller.name, caller.limits, workers, own)?;
    match &caller.project {
        Some(project) => check(&format!("project {}", project.name), project.limits, workers, of_project),
        None => Ok(()),
    }
}

/// The account of a caller.
pub(super) fn account(caller: &Caller) -> Account {
    Account::new(caller.project(), &caller.name)
}

/// Unfinished bakes, and bytes of bakes and uploads.
type Sum = (usize, u64);

/// Of an account, and of its project.
fn sums<'a>(account: &Account, entries: impl Iterator<Item = &'a Arc<Entry>>, uploads: &AssetOwners) -> [Sum; 2] {
    let mut sums = uploads.bytes(account).map(|bytes| (0, bytes));
    for entry in entries {
        let now = entry.state.borrow();
        let payer = now.payer();
        let is_within = [payer == *account, payer.project == account.project];
        for ((unfinished, bytes), _) in sums.iter_mut().zip(is_within).filter(|(_, is_within)| *is_within) {
            *unfinished += usize::from(!now.has_ended());
            *bytes += now.bytes();
        }
    }
    sums
}

fn check(name: &str, limits: CallerLimits, workers: usize, (unfinished, bytes): Sum) -> Result<(), Fault> {
    // Without a limit of running bakes, it may use all workers.
    let most = limits.queue.map(|queue| limits.bakes.unwrap_or(workers).max(1).saturating_add(queue));
    if let Some(most) = most.filter(|&most| unfinished >= most) {
        let what = format!("{name} has {unfinished} running or waiting bakes of at most {most}: wait for one to end");
        return Err(Fault::CallerLimit(what));
    }
    if let Some(most) = limits.bytes.filter(|&most| bytes >= most) {
        let what = format!("the bakes and uploads of {name} take {bytes} bytes of at most {most}: delete some bakes");
        return Err(Fault::CallerLimit(what));
    }
    Ok(())
}

impl Bakes {
    /// Holds room for an upload of a caller. Its own uploads that were not used for longest make room; if that is not
    /// enough, it is refused.
    pub fn make_room(&self, caller: &Caller, bytes: u64) -> Result<Reservation, Fault> {
        let account = account(caller);
        let project = caller.project.as_deref();
        let limits = [caller.limits.bytes, project.and_then(|project| project.limits.bytes)];
        let uploads = &self.store.owners;
        let over = || {
            let sums = sums(&account, self.entries().values(), uploads).map(|(_, taken)| taken);
            let over = |(most, taken): (Option<u64>, u64)| taken.saturating_sub(most.unwrap_or(u64::MAX));
            limits.into_iter().zip(sums).map(over).max().unwrap_or(0)
        };
        // What is held counts at once, so that several uploads do not take the same room.
        let held = uploads.reserve(&account, bytes);
        let too_much = over();
        if too_much > 0 && uploads.bytes_of_assets(&account) >= too_much {
            self.store.free(&account, too_much);
            self.request_trim();
        }
        match over() {
            0 => Ok(held),
            too_much => {
                let names = [Some(caller.name.to_string()), project.map(|project| format!("project {}", project.name))];
                let limits = names.into_iter().flatten().zip(limits);
                let limits = limits.filter_map(|(name, most)| Some(format!("{name} may keep {} bytes", most?)));
                let limits = limits.collect::<Vec<_>>().join(", ");
                Err(Fault::CallerLimit(format!(
                    "an upload of {bytes} bytes is {too_much} too many ({limits}): delete some bakes"
                )))
            }
        }
    }
}
