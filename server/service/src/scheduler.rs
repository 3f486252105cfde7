//! The order in which waiting bakes start: by priority, then by the number of running bakes of their caller, fewest
//! first, so that nobody holds all workers while others wait, then by age. The limits of running bakes of a caller and
//! of its project are kept, as they are when a bake starts.

use crate::access::Caller;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

pub struct Scheduler {
    state: Mutex<SchedulerState>,
    /// A slot became free, or a bake no longer waits.
    changed: Notify,
}

struct SchedulerState {
    free: usize,
    /// Running bakes of each caller that has any.
    running: BTreeMap<Arc<str>, usize>,
    /// And of each project.
    of_projects: BTreeMap<String, usize>,
    waiting: BTreeMap<QueuePosition, Caller>,
    next: u64,
}

/// The higher priority first, then the earlier.
type QueuePosition = (Reverse<i32>, u64);

/// The right to run one bake, until it is dropped.
pub struct Slot {
    scheduler: Arc<Scheduler>,
    caller: Caller,
}

/// A place in the queue, until it is dropped.
pub struct Waiting {
    scheduler: Arc<Scheduler>,
    position: QueuePosition,
}

impl Scheduler {
    pub fn new(count: usize) -> Arc<Scheduler> {
        let (running, of_projects, waiting) = Default::default();
        let state = SchedulerState { free: count, running, of_projects, waiting, next: 0 };
        Arc::new(Scheduler { state: Mutex::new(state), changed: Notify::new() })
    }

    /// Gives the bakes that wait the limits that `of` says.
    pub fn set_limits(&self, of: impl Fn(&Caller) -> Caller) {
        self.state().waiting.values_mut().for_each(|caller| *caller = of(caller));
        self.changed.notify_waiters();
    }

    fn state(&self) -> MutexGuard<'_, SchedulerState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Enters the queue.
    pub fn enter(self: &Arc<Self>, caller: Caller, priority: i32) -> Waiting {
        let mut state = self.state();
        state.next += 1;
        let position = (Reverse(priority), state.next);
        state.waiting.insert(position, caller);
        Waiting { scheduler: self.clone(), position }
    }
}

impl Waiting {
    /// Waits for a slot. Dropping the future leaves the queue.
    pub async fn slot(self) -> Slot {
        let scheduler = &self.scheduler;
        loop {
            let changed = scheduler.changed.notified();
            tokio::pin!(changed);
            changed.as_mut().enable();
            let begun = scheduler.state().begin(self.position);
            if let Some(caller) = begun {
                return Slot { scheduler: scheduler.clone(), caller };
            }
            changed.await;
        }
    }
}

impl SchedulerState {
    /// Takes a slot if this position is the first of those that may run. Returns its caller, if so.
    fn begin(&mut self, position: QueuePosition) -> Option<Caller> {
        let running = |caller: &Caller| self.running.get(&caller.name).copied().unwrap_or(0);
        let of_project = |caller: &Caller| self.of_projects.get(caller.project()).copied().unwrap_or(0);
        let may_run = |caller: &Caller| {
            let most_of_project = caller.project.as_ref().and_then(|project| project.limits.bakes);
            caller.limits.bakes.is_none_or(|most| running(caller) < most.max(1))
                && most_of_project.is_none_or(|most| of_project(caller) < most.max(1))
        };
        let waiting = self.waiting.iter().filter(|(_, caller)| may_run(caller));
        let first = waiting.min_by_key(|((priority, age), caller)| (*priority, running(caller), *age));
        if self.free == 0 || first.map(|(position, _)| *position) != Some(position) {
            return None;
        }
        let caller = self.waiting.remove(&position)?;
        self.free -= 1;
        *self.of_projects.entry(caller.project().to_owned()).or_default() += 1;
        *self.running.entry(caller.name.clone()).or_default() += 1;
        Some(caller)
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.scheduler.state().waiting.remove(&self.position);
        self.scheduler.changed.notify_waiters();
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut state = self.scheduler.state();
        state.free += 1;
        if let Some(running) = state.running.get_mut(&self.caller.name) {
            *running -= 1;
        }
        if let Some(running) = state.of_projects.get_mut(self.caller.project()) {
            *running -= 1;
        }
        state.running.retain(|_, running| *running > 0);
        state.of_projects.retain(|_, running| *running > 0);
        drop(state);
        self.scheduler.changed.notify_waiters();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::CallerLimits;
    use std::time::Duration;

    impl Scheduler {
        async fn take(self: &Arc<Self>, caller: &Caller, priority: i32) -> Slot {
            self.enter(caller.clone(), priority).slot().await
        }
    }

    /// Names in the order in which they get the only slot.
    async fn order(scheduler: &Arc<Scheduler>, wanted: &[(&'static str, i32)]) -> Vec<&'static str> {
        let all = scheduler.take(&Caller::named("first"), 0).await;
        let started = Arc::new(Mutex::new(Vec::new()));
        let mut tasks = Vec::new();
        for &(name, priority) in wanted {
            let (scheduler, started) = (scheduler.clone(), started.clone());
            tasks.push(tokio::spawn(async move {
                let _slot = scheduler.take(&Caller::named(name), priority).await;
                started.lock().unwrap().push(name);
            }));
            tokio::task::yield_now().await;
        }
        drop(all);
        for task in tasks {
            task.await.unwrap();
        }
        Arc::try_unwrap(started).unwrap().into_inner().unwrap()
    }

    #[tokio::test]
    async fn by_priority_then_by_age() {
        let scheduler = Scheduler::new(1);
        let started = order(&scheduler, &[("a", 0), ("b", -5), ("c", 7), ("d", 0)]).await;
        assert_eq!(started, ["c", "a", "d", "b"]);
    }

    #[tokio::test]
    async fn the_caller_with_fewer_running_bakes_is_first() {
        let scheduler = Scheduler::new(2);
        let (greedy, other) = (Caller::named("greedy"), Caller::named("other"));
        let (first, second) = (scheduler.take(&greedy, 0).await, scheduler.take(&greedy, 0).await);
        let third = tokio::spawn({
            let (scheduler, greedy) = (scheduler.clone(), greedy.clone());
            async move { scheduler.take(&greedy, 0).await }
        });
        tokio::task::yield_now().await;
        let theirs = tokio::spawn({
            let scheduler = scheduler.clone();
            async move { scheduler.take(&other, 0).await }
        });
        tokio::task::yield_now().await;
        drop(first);
        let theirs = theirs.await.unwrap();
        assert!(!third.is_finished(), "it is older, but one of its caller runs already");
        drop(second);
        drop((theirs, third.await.unwrap()));
    }

    #[tokio::test]
    async fn new_limits_hold_for_those_that_wait() {
        let scheduler = Scheduler::new(3);
        let limited = |most| {
            let limits = CallerLimits { bakes: Some(most), ..CallerLimits::default() };
            Caller { limits, ..Caller::named("anna") }
        };
        let first = scheduler.take(&limited(1), 0).await;
        let wait = |scheduler: &Arc<Scheduler>| {
            let scheduler = scheduler.clone();
            tokio::spawn(async move { scheduler.take(&limited(1), 0).await })
        };
        let (second, third) = (wait(&scheduler), wait(&scheduler));
        tokio::task::yield_now().await;
        scheduler.set_limits(|caller| Caller { limits: limited(2).limits, ..caller.clone() });
        let second = second.await.unwrap();
        tokio::task::yield_now().await;
        assert!(!third.is_finished(), "two of three run");
        drop((first, second));
        drop(third.await.unwrap());
        assert!(scheduler.state().running.is_empty());
    }

    #[tokio::test]
    async fn a_callers_limit_lets_others_pass() {
        let scheduler = Scheduler::new(2);
        let greedy =
            Caller { limits: CallerLimits { bakes: Some(1), ..CallerLimits::default() }, ..Caller::named("greedy") };
        let first = scheduler.take(&greedy, 0).await;
        let no_slot = Duration::from_millis(20);
        assert!(tokio::time::timeout(no_slot, scheduler.take(&greedy, 100)).await.is_err());
        let other = scheduler.take(&Caller::named("other"), -100).await;
        drop((first, other));
        scheduler.take(&greedy, 0).await;
        let state = scheduler.state();
        assert!(state.free == 2 && state.waiting.is_empty() && state.running.is_empty());
    }
}
