//! Whose turn it is to run: bakes wait by priority; then the caller of whom the fewest run is first, so that nobody holds all workers
//! while others wait; then by age. Of one caller only so many run at once.

use crate::service::access::Caller;
use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

pub struct Turns {
    state: Mutex<State>,
    /// A turn ended, or somebody no longer waits.
    changed: Notify,
}

struct State {
    free: usize,
    /// Turns of each caller that has any.
    running: BTreeMap<Arc<str>, usize>,
    waiting: BTreeMap<Place, Caller>,
    next: u64,
}

/// The higher priority first, then the earlier.
type Place = (Reverse<i32>, u64);

/// Lasts until it is dropped.
pub struct Turn {
    turns: Arc<Turns>,
    caller: Arc<str>,
}

/// Somebody who waits, until it is dropped.
struct Waiting<'a> {
    turns: &'a Turns,
    place: Place,
}

impl Turns {
    pub fn new(count: usize) -> Arc<Turns> {
        let state = State { free: count, running: BTreeMap::new(), waiting: BTreeMap::new(), next: 0 };
        Arc::new(Turns { state: Mutex::new(state), changed: Notify::new() })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a turn. Whoever stops waiting is out of the queue.
    pub async fn take(self: &Arc<Self>, caller: &Caller, priority: i32) -> Turn {
        let place = {
            let mut state = self.state();
            state.next += 1;
            let place = (Reverse(priority), state.next);
            state.waiting.insert(place, caller.clone());
            place
        };
        let waiting = Waiting { turns: self, place };
        loop {
            let changed = self.changed.notified();
            tokio::pin!(changed);
            changed.as_mut().enable();
            if self.state().begin(place) {
                drop(waiting);
                return Turn { turns: self.clone(), caller: caller.name.clone() };
            }
            changed.await;
        }
    }
}

impl State {
    /// Begins the turn of this place, if it is the first of those that may run.
    fn begin(&mut self, place: Place) -> bool {
        let running = |caller: &Caller| self.running.get(&caller.name).copied().unwrap_or(0);
        let may_run = |caller: &Caller| caller.limits.bakes.is_none_or(|most| running(caller) < most.max(1));
        let waiting = self.waiting.iter().filter(|(_, caller)| may_run(caller));
        let first = waiting.min_by_key(|((priority, age), caller)| (*priority, running(caller), *age));
        if self.free == 0 || first.map(|(place, _)| *place) != Some(place) {
            return false;
        }
        self.free -= 1;
        if let Some(caller) = self.waiting.remove(&place) {
            *self.running.entry(caller.name).or_default() += 1;
        }
        true
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        self.turns.state().waiting.remove(&self.place);
        self.turns.changed.notify_waiters();
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut state = self.turns.state();
        state.free += 1;
        if let Some(running) = state.running.get_mut(&self.caller) {
            *running -= 1;
        }
        state.running.retain(|_, running| *running > 0);
        drop(state);
        self.turns.changed.notify_waiters();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::access::Limits;
    use std::time::Duration;

    /// Names in the order in which their turns come, each ending before the next begins.
    async fn order(turns: &Arc<Turns>, wanted: &[(&'static str, i32)]) -> Vec<&'static str> {
        let all = turns.take(&Caller::named("first"), 0).await;
        let told = Arc::new(Mutex::new(Vec::new()));
        let mut tasks = Vec::new();
        for &(name, priority) in wanted {
            let (turns, told) = (turns.clone(), told.clone());
            tasks.push(tokio::spawn(async move {
                let _turn = turns.take(&Caller::named(name), priority).await;
                told.lock().unwrap().push(name);
            }));
            tokio::task::yield_now().await;
        }
        drop(all);
        for task in tasks {
            task.await.unwrap();
        }
        Arc::try_unwrap(told).unwrap().into_inner().unwrap()
    }

    #[tokio::test]
    async fn by_priority_then_by_age() {
        let turns = Turns::new(1);
        let told = order(&turns, &[("a", 0), ("b", -5), ("c", 7), ("d", 0)]).await;
        assert_eq!(told, ["c", "a", "d", "b"]);
    }

    #[tokio::test]
    async fn who_has_fewer_running_is_first() {
        let turns = Turns::new(2);
        let (greedy, other) = (Caller::named("greedy"), Caller::named("other"));
        let (first, second) = (turns.take(&greedy, 0).await, turns.take(&greedy, 0).await);
        let third = tokio::spawn({
            let (turns, greedy) = (turns.clone(), greedy.clone());
            async move { turns.take(&greedy, 0).await }
        });
        tokio::task::yield_now().await;
        let theirs = tokio::spawn({
            let turns = turns.clone();
            async move { turns.take(&other, 0).await }
        });
        tokio::task::yield_now().await;
        drop(first);
        let theirs = theirs.await.unwrap();
        assert!(!third.is_finished(), "it is older, but one of its caller runs already");
        drop(second);
        drop((theirs, third.await.unwrap()));
    }

    #[tokio::test]
    async fn a_callers_limit_lets_others_pass() {
        let turns = Turns::new(2);
        let greedy = Caller { limits: Limits { bakes: Some(1), ..Limits::default() }, ..Caller::named("greedy") };
        let first = turns.take(&greedy, 0).await;
        let no_turn = Duration::from_millis(20);
        assert!(tokio::time::timeout(no_turn, turns.take(&greedy, 100)).await.is_err());
        let other = turns.take(&Caller::named("other"), -100).await;
        drop((first, other));
        turns.take(&greedy, 0).await;
        let state = turns.state();
        assert!(state.free == 2 && state.waiting.is_empty() && state.running.is_empty());
    }
}
