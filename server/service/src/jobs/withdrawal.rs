//! Callers that no longer want a bake: it is cancelled or deleted, unless others want it.

use super::{Bakes, Entry};
use crate::access::{Caller, CallerRole};
use crate::blocking::in_place;
use crate::status::Fault;
use cairn_wire::proto::BakeStatus;

impl Bakes {
    /// Withdraws a caller's interest in a bake. Without any left, or if an operator asks, the bake is cancelled; this
    /// waits for its end.
    pub async fn cancel(&self, caller: &Caller, id: &str) -> Result<BakeStatus, Fault> {
        let entry = self.find(caller, id)?;
        if self.withdraw(caller, &entry)? {
            entry.cancelled.cancel();
            entry.wait_ended().await;
        }
        self.status(&entry)
    }

    /// Cancels a bake and removes its files, unless others want it.
    pub async fn delete(&self, caller: &Caller, id: &str) -> Result<(), Fault> {
        let entry = self.find(caller, id)?;
        if !self.store.is_here() {
            return Err(Fault::DataAway);
        }
        if self.withdraw(caller, &entry)? {
            entry.cancelled.cancel();
            entry.wait_ended().await;
            in_place(|| self.remove_ended(&entry.id()))?;
            self.request_trim();
        }
        Ok(())
    }

    /// Takes a caller out of those that want a bake. Returns whether it is to end.
    fn withdraw(&self, caller: &Caller, entry: &Entry) -> Result<bool, Fault> {
        let status = entry.state.borrow().status.clone();
        let is_known = status.owner == *caller.name || status.callers.iter().any(|known| known.name == *caller.name);
        if !is_known && !caller.is_operator() {
            return Err(Fault::NotYours(status.owner));
        }
        let others = status.callers.iter().any(|known| known.name != *caller.name);
        let leaves_it_to_others = match caller.role {
            CallerRole::Artist => others,
            CallerRole::Operator => false,
            CallerRole::Anybody => others && status.callers.iter().any(|known| known.name == *caller.name),
        };
        if !leaves_it_to_others {
            return Ok(true);
        }
        entry.state.send_modify(|now| now.status.callers.retain(|known| known.name != *caller.name));
        self.save_callers(entry);
        Ok(false)
    }
}
