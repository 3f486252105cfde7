//! The time by which the store ages: that of servers at work on it. The machine's clock may jump, and a server that is
//! off for a month must not find everything a month older.

use cairn_files::failpoints;
use std::fs;
use std::io::Result;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// A clock that goes on where the last server's has stopped.
#[derive(Debug)]
pub struct StoreClock {
    path: PathBuf,
    began: SystemTime,
    since: Instant,
}

impl StoreClock {
    /// Goes on from the file. Without one, from `newest`, the last use of what is in the store, or from the machine's
    /// time if that is earlier or there is nothing.
    pub fn open(path: &Path, newest: impl FnOnce() -> Option<SystemTime>) -> StoreClock {
        let text = fs::read_to_string(path).unwrap_or_default();
        let kept = text.strip_suffix('\n').unwrap_or_default().parse().ok().map(Duration::from_secs);
        let kept = kept.and_then(|since| SystemTime::UNIX_EPOCH.checked_add(since));
        let now = SystemTime::now();
        let began = kept.unwrap_or_else(|| newest().map_or(now, |newest| newest.min(now)));
        StoreClock { path: path.to_owned(), began, since: Instant::now() }
    }

    pub fn now(&self) -> SystemTime {
        self.began + self.since.elapsed()
    }

    /// Keeps the time for the next server.
    pub fn save(&self) -> Result<()> {
        let seconds = self.now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs();
        // Half of a time is none.
        failpoints::at("clock-write")?;
        fs::write(&self.path, format!("{seconds}\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_goes_on_where_it_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clock");
        let days = |days: u64| Duration::from_secs(days * 86_400);
        let near = |a: SystemTime, b: SystemTime| {
            let apart = a.duration_since(b).unwrap_or_else(|error| error.duration());
            assert!(apart < Duration::from_secs(60), "{apart:?} apart");
        };
        let now = SystemTime::now();
        near(StoreClock::open(&path, || None).now(), now);
        // The machine's clock has jumped ahead of what is here, or back.
        near(StoreClock::open(&path, || Some(now - days(40))).now(), now - days(40));
        near(StoreClock::open(&path, || Some(now + days(40))).now(), now);
        // What the last server knew counts, whatever the machine's clock says.
        for kept in [now - days(40), now + days(40)] {
            StoreClock { path: path.clone(), began: kept, since: Instant::now() }.save().unwrap();
            near(StoreClock::open(&path, || Some(now)).now(), kept);
        }
        fs::write(&path, "1795990384").unwrap();
        near(StoreClock::open(&path, || None).now(), now);
    }
}
