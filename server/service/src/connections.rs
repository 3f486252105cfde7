//! The connections of a server: how many there may be, which are closed because nothing is said on them, and which give
//! way to others. Half of the process's file handles are for connections, and half of these for callers who have shown
//! a token: nobody who has none can lock them out.

use cairn_job::machine;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::warn;

/// A connection without a call is closed after this time; one whose calls have shown no token, after the second one
/// without a call.
const SILENT: Duration = Duration::from_secs(10);
const IDLE: Duration = Duration::from_secs(120);
/// Of the file handles, the share for connections; of these, the share for those who have shown no token.
const SHARE: usize = 2;
const SHARE_OF_STRANGERS: usize = 2;
/// Connections at most.
const MOST: usize = 16_384;
/// File handles that the server asks for.
const HANDLES: u64 = 65_536;
/// Interval between warnings.
const WARNING: Duration = Duration::from_secs(60);

/// All connections of a server.
pub struct Connections {
    most: usize,
    table: Mutex<Table>,
    silent: Duration,
    idle: Duration,
}

#[derive(Default)]
struct Table {
    next: u64,
    open: BTreeMap<u64, Weak<Connection>>,
    warned: Option<Instant>,
}

/// One connection.
pub struct Connection {
    number: u64,
    connections: Arc<Connections>,
    state: Mutex<ConnectionState>,
    /// Cancelled when it has to end.
    pub closing: CancellationToken,
}

struct ConnectionState {
    /// Who is at the other end: an address, or the name of a caller once it has shown a token.
    owner: String,
    is_known: bool,
    /// Open calls, and whether there has been any.
    calls: usize,
    is_used: bool,
    /// When it was opened, or the last call began or ended.
    last: Instant,
}

/// Open while it lives.
pub struct Call(Arc<Connection>);

impl Connections {
    /// As many as the file handles of this process allow.
    pub fn new() -> Arc<Connections> {
        let handles = machine::file_handles(HANDLES).map_or(usize::MAX, |handles| handles as usize);
        Connections::of((handles / SHARE).min(MOST), SILENT, IDLE)
    }

    /// With these patiences before the first call, and after one.
    pub fn of(most: usize, silent: Duration, idle: Duration) -> Arc<Connections> {
        Arc::new(Connections { most: most.max(SHARE_OF_STRANGERS), table: Mutex::default(), silent, idle })
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in a new connection. Where there are too many, the one that has been idle longest gives way, of whoever
    /// holds most: first of those who have shown no token. `None`: all are in use.
    pub fn open(self: &Arc<Connections>, owner: String) -> Option<Arc<Connection>> {
        // Before the lock, which the end of a connection takes: these may be the last that hold one.
        let all: Vec<Arc<Connection>>;
        let mut table = self.table();
        all = table.open.values().filter_map(Weak::upgrade).collect();
        let open: Vec<&Arc<Connection>> = all.iter().filter(|other| !other.closing.is_cancelled()).collect();
        let strangers = open.iter().filter(|other| !other.state().is_known).count();
        let mut is_full = open.len() >= self.most;
        if is_full || strangers >= self.most / SHARE_OF_STRANGERS {
            let closed = idlest(&open, false).or_else(|| is_full.then(|| idlest(&open, true)).flatten());
            if table.warned.is_none_or(|before| before.elapsed() > WARNING) {
                table.warned = Some(Instant::now());
                warn!(
                    connections = open.len(),
                    most = self.most,
                    "many connections are open: the idlest ones are closed; raise the number of file handles \
                     (ulimit -n) if they are your callers'"
                );
            }
            if let Some(closed) = closed {
                closed.closing.cancel();
                is_full = false;
            }
        }
        if is_full {
            return None;
        }
        let number = table.next;
        table.next += 1;
        let state = ConnectionState { owner, is_known: false, calls: 0, is_used: false, last: Instant::now() };
        let closing = CancellationToken::new();
        let new = Arc::new(Connection { number, connections: self.clone(), state: Mutex::new(state), closing });
        table.open.insert(number, Arc::downgrade(&new));
        Some(new)
    }
}

/// The connection that has been idle longest, of whoever holds most of those that may be closed: strangers' ones, or
/// those of known callers without a call.
fn idlest<'a>(open: &[&'a Arc<Connection>], known: bool) -> Option<&'a Arc<Connection>> {
    let mut by_owner: BTreeMap<String, Vec<(Instant, &Arc<Connection>)>> = BTreeMap::new();
    for &other in open {
        let state = other.state();
        if state.is_known == known && (!known || state.calls == 0) {
            by_owner.entry(state.owner.clone()).or_default().push((state.last, other));
        }
    }
    let most = by_owner.into_values().max_by_key(Vec::len)?;
    most.into_iter().min_by_key(|(last, _)| *last).map(|(_, other)| other)
}

impl Connection {
    fn state(&self) -> MutexGuard<'_, ConnectionState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A call begins. It ends when what this returns is dropped.
    pub fn begin(self: &Arc<Connection>) -> Call {
        let mut state = self.state();
        state.calls += 1;
        state.is_used = true;
        state.last = Instant::now();
        drop(state);
        Call(self.clone())
    }

    /// A call on it was accepted.
    pub fn know(&self, caller: &str) {
        let mut state = self.state();
        if !state.is_known {
            state.is_known = true;
            state.owner = caller.to_owned();
        }
    }

    /// How long it may be silent.
    pub fn patience(&self) -> Duration {
        self.connections.silent
    }

    /// When it must have said something; `None`: it may be silent.
    pub fn must_speak(&self) -> Option<Instant> {
        let state = self.state();
        let patience = if state.is_used { self.connections.idle } else { self.connections.silent };
        (!state.is_known && state.calls == 0).then(|| state.last + patience)
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.connections.table().open.remove(&self.number);
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        let mut state = self.0.state();
        state.calls -= 1;
        state.last = Instant::now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn connections(most: usize) -> Arc<Connections> {
        Connections::of(most, SILENT, IDLE)
    }

    fn is_open(connection: &Arc<Connection>) -> bool {
        !connection.closing.is_cancelled()
    }

    #[test]
    fn strangers_give_way_to_each_other_and_take_half_at_most() {
        let all = connections(8);
        let known: Vec<_> = (0..4).map(|_| all.open("10.0.0.1".into()).unwrap()).collect();
        known.iter().for_each(|connection| connection.know("anna"));
        let strangers: Vec<_> = (0..20).map(|_| all.open("10.0.0.2".into()).unwrap()).collect();
        assert_eq!(strangers.iter().filter(|one| is_open(one)).count(), 4);
        assert!(is_open(&strangers[19]) && known.iter().all(is_open));
        // A probe from elsewhere stays, whatever the others do.
        let probe = all.open("10.0.0.3".into()).unwrap();
        let more: Vec<_> = (0..20).map(|_| all.open("10.0.0.2".into()).unwrap()).collect();
        assert!(is_open(&probe) && is_open(&more[19]) && known.iter().all(is_open));
    }

    #[test]
    fn a_caller_with_a_token_cannot_lock_out_another() {
        let all = connections(8);
        let open = |name: &str| {
            let connection = all.open("10.0.0.1".into()).unwrap();
            connection.know(name);
            connection
        };
        let other = open("bob");
        let greedy: Vec<_> = (0..20).map(|_| open("anna")).collect();
        assert!(is_open(&other) && is_open(&greedy[19]));
        assert!(greedy.iter().filter(|one| is_open(one)).count() <= 7);
        // What is in use stays; if all is, no other is taken in.
        let used = connections(2);
        let open = |_| {
            let connection = used.open(String::new()).unwrap();
            connection.know("anna");
            connection
        };
        let kept: Vec<_> = (0..2).map(open).collect();
        let calls: Vec<_> = kept.iter().map(|connection| connection.begin()).collect();
        assert!(used.open(String::new()).is_none());
        drop(calls);
        assert!(used.open(String::new()).is_some());
    }
}
