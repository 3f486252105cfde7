//! Resources that callers share. Each caller has a limit below the total, so that nobody can lock out the others.

use crate::access::Caller;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

pub struct Quota {
    all: Arc<Semaphore>,
    most: usize,
    /// Limit of each caller.
    each: usize,
    callers: Mutex<BTreeMap<Arc<str>, Weak<Semaphore>>>,
}

/// Held until it is dropped.
pub struct Permit {
    _of_all: OwnedSemaphorePermit,
    _own: OwnedSemaphorePermit,
}

impl Quota {
    pub fn new(all: usize, each: usize) -> Quota {
        let most = all.min(Semaphore::MAX_PERMITS);
        let all = Arc::new(Semaphore::new(most));
        Quota { all, most, each: each.clamp(1, Semaphore::MAX_PERMITS), callers: Mutex::default() }
    }

    /// The number of permits that are held.
    pub fn held(&self) -> usize {
        self.most - self.all.available_permits()
    }

    /// A permit, if one is free for this caller.
    pub fn try_acquire(&self, caller: &Caller) -> Option<Permit> {
        let own = self.own(caller).try_acquire_owned().ok()?;
        Some(Permit { _of_all: self.all.clone().try_acquire_owned().ok()?, _own: own })
    }

    /// Waits for a permit.
    pub async fn acquire(&self, caller: &Caller) -> Permit {
        let never_closed = "the semaphores are never closed";
        let own = self.own(caller).acquire_owned().await.expect(never_closed);
        Permit { _of_all: self.all.clone().acquire_owned().await.expect(never_closed), _own: own }
    }

    fn own(&self, caller: &Caller) -> Arc<Semaphore> {
        let mut callers = self.callers.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = callers.get(&caller.name).and_then(Weak::upgrade) {
            return own;
        }
        // Forget callers that hold nothing.
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
        let quota = Quota::new(4, 3);
        let (greedy, other) = (Caller::named("greedy"), Caller::named("other"));
        let mut held: Vec<Permit> = std::iter::from_fn(|| quota.try_acquire(&greedy)).collect();
        assert_eq!((held.len(), quota.held()), (3, 3));
        let last = quota.try_acquire(&other).unwrap();
        assert!(quota.try_acquire(&other).is_none(), "all are held");
        held.pop();
        assert!(quota.try_acquire(&greedy).is_some());
        drop((held, last));
        quota.try_acquire(&other).unwrap();
        assert_eq!(quota.callers.lock().unwrap().len(), 1, "callers that hold nothing are forgotten");
    }
}
