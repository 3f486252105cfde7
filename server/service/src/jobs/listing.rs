//! Bakes that callers see: one by its id, lists, and how many wait.

use super::{Bakes, Entry, EntryState, now};
use crate::access::Caller;
use crate::status::Fault;
use cairn_wire::proto::BakeState;
use std::sync::Arc;
use std::time::Duration;

impl Bakes {
    /// An accepted bake that a caller sees, by its id or the beginning of it. Those of other projects are as if there
    /// were none.
    pub fn find(&self, caller: &Caller, id: &str) -> Result<Arc<Entry>, Fault> {
        /// Digits of an id, and the fewest of them that a caller may name.
        const DIGITS: std::ops::RangeInclusive<usize> = 6..=64;
        let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        if !(DIGITS.contains(&id.len()) && id.bytes().all(is_digit)) {
            let what =
                "not the id of a bake; give its 64 lower-case hexadecimal digits, or the first 6 or more of them";
            return Err(Fault::field("bake_id", what));
        }
        let entries = self.entries();
        let mut found = entries.range(id.to_owned()..).take_while(|(known, _)| known.starts_with(id));
        let is_seen = |now: &EntryState| now.accepted && caller.sees(&now.status.project);
        let mut found = found.by_ref().filter(|(_, entry)| is_seen(&entry.state.borrow())).map(|(_, entry)| entry);
        match (found.next(), found.next()) {
            (Some(entry), None) => Ok(entry.clone()),
            (Some(_), Some(_)) => {
                Err(Fault::field("bake_id", format!("several bakes begin with {id}; give more of it")))
            }
            (None, _) => Err(Fault::BakeNotFound(id.into())),
        }
    }

    /// Whether a bake is still there.
    pub fn knows(&self, id: &str) -> bool {
        self.entries().get(id).is_some_and(|entry| entry.state.borrow().accepted)
    }

    /// All accepted bakes that a caller sees, latest first.
    pub fn seen(&self, caller: &Caller) -> Vec<Arc<Entry>> {
        let mut list = self.list();
        list.retain(|entry| caller.sees(&entry.state.borrow().status.project));
        list
    }

    /// All accepted bakes, latest first.
    pub(super) fn list(&self) -> Vec<Arc<Entry>> {
        let entries = self.entries();
        let mut list: Vec<_> = entries.values().filter(|entry| entry.state.borrow().accepted).cloned().collect();
        drop(entries);
        list.sort_by(|a, b| b.position.cmp(&a.position));
        list
    }

    /// How many bakes wait for a worker, and for how long the oldest has.
    pub fn waiting(&self) -> (usize, Duration) {
        let entries = self.entries();
        let waiting = entries.values().filter(|entry| entry.state.borrow().status.state() == BakeState::Queued);
        let now = now();
        let since = |entry: &Arc<Entry>| u64::try_from(now.seconds - entry.position.0).unwrap_or(0);
        let all: Vec<u64> = waiting.map(since).collect();
        (all.len(), Duration::from_secs(all.into_iter().max().unwrap_or(0)))
    }
}
