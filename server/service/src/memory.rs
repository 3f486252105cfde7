//! The memory of all processes of bakes and plans together: where they exceed it, the largest one ends, before the
//! system ends any.

use crate::config::Config;
use cairn_job::machine;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

/// Of the machine's memory, what its bakes and plans may take together: the server itself and others need the rest.
const SHARE: [u64; 2] = [4, 5];
/// Interval of looks at processes. A process fills some hundred MiB in that time.
const LOOK: Duration = Duration::from_millis(100);
/// Plans, which are soon repeated, end first, if they have this share of it all.
const SHARE_OF_A_PLAN: u64 = 8;

/// What is left for the processes of bakes and plans.
pub struct MemoryBudget {
    /// Of one process, bytes; `None`: not limited.
    pub each: Option<u64>,
    all: u64,
    members: Mutex<BTreeMap<u32, Member>>,
    joined: Notify,
}

struct Member {
    is_plan: bool,
    over: CancellationToken,
}

/// The part of a process, until it is dropped.
pub struct Share {
    budget: Arc<MemoryBudget>,
    process: u32,
    over: CancellationToken,
}

impl MemoryBudget {
    /// Of the settings and the machine, or the control group of this process.
    pub fn new(config: &Config) -> Arc<MemoryBudget> {
        let [part, whole] = SHARE;
        let all = config.memory().unwrap_or_else(|| machine::memory() / whole * part);
        let limits = [config.bake_memory(), machine::memory_limit()].into_iter().flatten();
        let each = limits.min().map(|each| each.min(all));
        let mib = |bytes: u64| bytes >> 20;
        match (each, config.bake_memory()) {
            (Some(each), Some(wanted)) if each < wanted => warn!(
                bake_memory_mib = mib(each),
                set = mib(wanted),
                "the machine, its control group or `ulimit -v` leaves a bake less memory than is set"
            ),
            _ => info!(bake_memory_mib = each.map(mib), memory_mib = mib(all), "memory"),
        }
        Arc::new(MemoryBudget { each, all, members: Mutex::default(), joined: Notify::new() })
    }

    fn members(&self) -> MutexGuard<'_, BTreeMap<u32, Member>> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in a process.
    pub fn join(self: &Arc<MemoryBudget>, process: u32, is_plan: bool) -> Share {
        let over = CancellationToken::new();
        self.members().insert(process, Member { is_plan, over: over.clone() });
        self.joined.notify_one();
        Share { budget: self.clone(), process, over }
    }

    /// Asks a process to end. Returns whether nobody has before: it takes a while until its memory is free.
    fn end(&self, process: u32) -> bool {
        let over = self.members().get(&process).map(|member| member.over.clone());
        let over = over.filter(|over| !over.is_cancelled());
        over.iter().for_each(CancellationToken::cancel);
        over.is_some()
    }

    /// Looks at the processes again and again, while there are any.
    pub async fn watch(self: Arc<MemoryBudget>) {
        loop {
            let processes: Vec<(u32, bool)> =
                self.members().iter().map(|(process, member)| (*process, member.is_plan)).collect();
            if processes.is_empty() {
                self.joined.notified().await;
                continue;
            }
            let sizes: Vec<Size> = (processes.into_iter())
                .map(|(process, is_plan)| Size { process, is_plan, bytes: machine::memory_of(process) })
                .collect();
            if let Some(victim) = victim(&sizes, self.all)
                && self.end(victim.process)
            {
                warn!(
                    memory_mib = self.all >> 20,
                    process_mib = victim.bytes >> 20,
                    "bakes and plans together exceed their memory: the largest process ends"
                );
            }
            tokio::time::sleep(LOOK).await;
        }
    }
}

impl Share {
    /// Cancelled when the process has to end.
    pub fn over(&self) -> CancellationToken {
        self.over.clone()
    }

    /// What all processes may have, MiB.
    pub fn all_mib(&self) -> u64 {
        self.budget.all >> 20
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.budget.members().remove(&self.process);
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Size {
    process: u32,
    is_plan: bool,
    bytes: u64,
}

/// The process that ends, if all together exceed `most`.
fn victim(sizes: &[Size], most: u64) -> Option<Size> {
    if sizes.iter().map(|size| size.bytes).sum::<u64>() <= most {
        return None;
    }
    let plans = sizes.iter().filter(|size| size.is_plan && size.bytes > most / SHARE_OF_A_PLAN);
    plans.max_by_key(|size| size.bytes).or_else(|| sizes.iter().max_by_key(|size| size.bytes)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_process_ends_and_plans_first() {
        let size = |process, is_plan, bytes| Size { process, is_plan, bytes };
        let bakes = [size(1, false, 40), size(2, false, 50), size(3, true, 1)];
        assert_eq!(victim(&bakes, 91), None);
        assert_eq!(victim(&bakes, 90), Some(bakes[1]));
        let plans = [size(1, false, 60), size(2, true, 20), size(3, true, 30)];
        assert_eq!(victim(&plans, 100), Some(plans[2]));
    }

    #[test]
    fn a_process_is_asked_to_end_once() {
        let budget = MemoryBudget::new(&Config::default());
        let share = budget.join(1, false);
        assert!(budget.end(1) && share.over().is_cancelled());
        assert!(!budget.end(1), "it is about to end");
        drop(share);
        assert!(!budget.end(1), "it has ended");
    }

    #[test]
    fn a_limit_of_the_machine_is_that_of_a_bake() {
        let all = machine::memory() / SHARE[1] * SHARE[0];
        let of = |bake_memory_mib, memory_mib| {
            MemoryBudget::new(&Config { bake_memory_mib, memory_mib, ..Config::default() })
        };
        let budget = of(1 << 40, 0);
        assert!(budget.each.is_some_and(|each| each <= all) && budget.all == all);
        let budget = of(512, 100);
        assert_eq!((budget.each, budget.all), (Some(100 << 20), 100 << 20));
    }
}
