//! The priority of processes: while bakes use all cores, the server still answers at once.

/// How much lower than the server's the priority of a process is, as `nice` counts.
#[derive(Clone, Copy)]
pub enum Priority {
    /// Somebody waits for its answer, which takes no long time.
    Soon = 2,
    /// A bake, and what takes as long.
    Later = 10,
}

/// Lowers the priority of this process, before it has a second thread. Where that is not possible, it stays.
#[cfg(unix)]
pub fn lower(to: Priority) {
    let _ = rustix::process::nice(to as i32);
}

#[cfg(not(unix))]
pub fn lower(_: Priority) {}
