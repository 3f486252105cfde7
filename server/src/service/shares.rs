//! What callers share: so much at once in all, and no caller more than its share, so that nobody can keep out the others.

use crate::service::access::Caller;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

pub struct Shares {
    all: Arc<Semaphore>,
    /// Most that one caller may hold.
    each: usize,
    callers: Mutex<BTreeMap<Arc<str>, Weak<Semaphore>>>,
}

/// Held until it is dropped.
pub struct Held {
    _of_all: OwnedSemaphorePermit,
    _own: OwnedSemaphorePermit,
}

impl Shares {
    pub fn new(all: usize, each: usize) -> Shares {
        let all = Arc::new(Semaphore::new(all.min(Semaphore::MAX_PERMITS)));
        Shares { all, each: each.clamp(1, Semaphore::MAX_PERMITS), callers: Mutex::default() }
    }

    /// The next one, if it is free for this caller.
    pub fn try_hold(&self, caller: &Caller) -> Option<Held> {
        let own = self.own(caller).try_acquire_owned().ok()?;
        Some(Held { _of_all: self.all.clone().try_acquire_owned().ok()?, _own: own })
    }

    /// Waits for the next one that is free for this caller.
    pub async fn hold(&self, caller: &Caller) -> Held {
        let never_closed = "the semaphores are never closed";
        let own = self.own(caller).acquire_owned().await.expect(never_closed);
        Held { _of_all: self.all.clone().acquire_owned().await.expect(never_closed), _own: own }
    }

    fn own(&self, caller: &Caller) -> Arc<Semaphore> {
        let mut callers = self.callers.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = callers.get(&caller.name).and_then(Weak::upgrade) {
            return own;
        }
        // Who holds nothing is forgotten.
        callers.retain(|_, own| own.strong_count() > 0);
        let own = Arc::new(Semaphore::new(self.each));
        callers.insert(caller.name.clone(), Arc::downgrade(&own));
        own
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_caller_leaves_room_for_another() {
        let shares = Shares::new(4, 3);
        let (greedy, other) = (Caller::named("greedy"), Caller::named("other"));
        let mut held: Vec<Held> = std::iter::from_fn(|| shares.try_hold(&greedy)).collect();
        assert_eq!(held.len(), 3);
        let last = shares.try_hold(&other).unwrap();
        assert!(shares.try_hold(&other).is_none(), "all are held");
        held.pop();
        assert!(shares.try_hold(&greedy).is_some());
        drop((held, last));
        shares.try_hold(&other).unwrap();
        assert_eq!(shares.callers.lock().unwrap().len(), 1, "who holds nothing is forgotten");
    }
}
