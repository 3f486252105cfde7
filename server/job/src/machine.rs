//! This machine: its resources, and the time and memory that a bake takes.

use cairn_core::calibrate::calibrate;
use cpu_time::ProcessTime;
use std::path::Path;
use std::sync::OnceLock;
use sysinfo::{CpuRefreshKind, Disks, MemoryRefreshKind, System};

/// CPU seconds of this process so far, over all threads.
pub fn cpu_seconds() -> f64 {
    ProcessTime::try_now().map_or(0.0, |time| time.as_duration().as_secs_f64())
}

static SLOWNESS: OnceLock<f64> = OnceLock::new();

/// CPU time on this machine / that on the one that the cost model was fitted on. Measured once, in a few tenths of a
/// second.
pub fn slowness() -> Result<f64, cairn_core::Error> {
    match known_slowness() {
        Some(found) => Ok(found),
        None => calibrate(cpu_seconds).map(|found| *SLOWNESS.get_or_init(|| found)),
    }
}

/// The same, if it was measured.
pub fn known_slowness() -> Option<f64> {
    SLOWNESS.get().copied()
}

/// Takes the slowness from a process that has measured it.
pub fn set_slowness(found: f64) {
    SLOWNESS.get_or_init(|| found);
}

/// CPU seconds of this process since the start of the meter. Earlier time is excluded, because `cargo run` becomes the
/// program that it has built and passes its own time on.
pub struct Meter {
    began: f64,
}

impl Meter {
    pub fn start() -> Meter {
        Meter { began: cpu_seconds() }
    }

    pub fn seconds(&self) -> f64 {
        cpu_seconds() - self.began
    }
}

/// Peak resident memory of this process, bytes; `None` if the system does not report it.
pub fn peak_memory() -> Option<u64> {
    of_status(&std::fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// Sets the number of threads, this one included; 0: one per processor, or as `RAYON_NUM_THREADS` says. Call it once,
/// before any work.
pub fn use_threads(count: usize) -> Result<(), rayon::ThreadPoolBuildError> {
    rayon::ThreadPoolBuilder::new().num_threads(count).use_current_thread().build_global()
}

/// Limits the memory of this process, bytes, if the system can. A lower limit that it has already stays.
#[cfg(unix)]
pub fn limit_memory(bytes: u64) -> std::io::Result<()> {
    let bytes = memory_limit().map_or(bytes, |limit| limit.min(bytes));
    rlimit::setrlimit(rlimit::Resource::AS, bytes, bytes)
}

/// The limit of the memory of this process and of each that it starts, bytes (`ulimit -v`).
#[cfg(unix)]
pub fn memory_limit() -> Option<u64> {
    rlimit::Resource::AS.get().ok().map(|(soft, _)| soft).filter(|bytes| *bytes != rlimit::INFINITY)
}

#[cfg(not(unix))]
pub fn memory_limit() -> Option<u64> {
    None
}

#[cfg(not(unix))]
pub fn limit_memory(_bytes: u64) -> std::io::Result<()> {
    Ok(())
}

/// File handles that this process may have, after it has asked for so many; `None`: the system sets no limit.
#[cfg(unix)]
pub fn file_handles(wanted: u64) -> Option<u64> {
    rlimit::increase_nofile_limit(wanted).ok()
}

#[cfg(not(unix))]
pub fn file_handles(_wanted: u64) -> Option<u64> {
    None
}

/// The machine's memory, bytes, or what its control groups leave this process and all that it starts.
pub fn memory() -> u64 {
    let mut system = System::new();
    system.refresh_memory_specifics(MemoryRefreshKind::nothing().with_ram());
    control_group_memory().map_or(system.total_memory(), |limit| limit.min(system.total_memory()))
}

/// The least memory that a control group of this process may have, bytes: of its own one, and of those above it.
fn control_group_memory() -> Option<u64> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let limits = groups.lines().flat_map(|line| {
        let mut parts = line.splitn(3, ':').skip(1);
        let (kinds, path) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
        let (root, file) = match kinds {
            "" => ("/sys/fs/cgroup", "memory.max"),
            kinds if kinds.split(',').any(|kind| kind == "memory") => {
                ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
            }
            _ => return Vec::new(),
        };
        // In a container, the path may be that of the host: the root is its own group then.
        let group = Path::new(path.trim_start_matches('/'));
        group.ancestors().map(|group| Path::new(root).join(group).join(file)).collect()
    });
    limits.filter_map(|file| std::fs::read_to_string(file).ok()?.trim().parse().ok()).min()
}

/// Resident memory of a process, bytes; 0 if it has ended, or the system does not report it.
pub fn memory_of(process: u32) -> u64 {
    if cfg!(target_os = "linux") {
        let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
        return of_status(&status, "VmRSS:").unwrap_or(0);
    }
    let (mut system, process) = (System::new(), sysinfo::Pid::from_u32(process));
    let what = sysinfo::ProcessRefreshKind::nothing().with_memory();
    system.refresh_processes_specifics(sysinfo::ProcessesToUpdate::Some(&[process]), true, what);
    system.process(process).map_or(0, sysinfo::Process::memory)
}

/// A figure of a process's status in `/proc`, bytes.
fn of_status(status: &str, name: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// Available memory, bytes.
pub fn free_memory() -> u64 {
    let mut system = System::new();
    system.refresh_memory_specifics(MemoryRefreshKind::nothing().with_ram());
    system.available_memory()
}

/// Free space on the disk of a folder, bytes; `None` if the system does not report it.
pub fn free_disk(folder: &Path) -> Option<u64> {
    // On Windows, a canonical path has a form in which no disk's name is.
    let folder = if cfg!(windows) { std::path::absolute(folder) } else { folder.canonicalize() }.ok()?;
    let disks = Disks::new_with_refreshed_list();
    let holding = disks.list().iter().filter(|disk| folder.starts_with(disk.mount_point()));
    holding.max_by_key(|disk| disk.mount_point().as_os_str().len()).map(|disk| disk.available_space())
}

/// Processor extensions that speed up mathematics, as far as present.
pub fn cpu_features() -> Vec<&'static str> {
    let mut found = Vec::new();
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    {
        let known = [
            ("sse4.2", std::is_x86_feature_detected!("sse4.2")),
            ("avx", std::is_x86_feature_detected!("avx")),
            ("avx2", std::is_x86_feature_detected!("avx2")),
            ("fma", std::is_x86_feature_detected!("fma")),
            ("avx512f", std::is_x86_feature_detected!("avx512f")),
        ];
        found.extend(known.iter().filter(|(_, there)| *there).map(|(name, _)| *name));
    }
    #[cfg(target_arch = "aarch64")]
    if std::arch::is_aarch64_feature_detected!("neon") {
        found.push("neon");
    }
    found
}

/// The processor and its number of threads, for tables.
pub fn name() -> String {
    let mut system = System::new();
    system.refresh_cpu_list(CpuRefreshKind::nothing());
    let brand = system.cpus().first().map_or(std::env::consts::ARCH.into(), |cpu| cpu.brand().trim().to_owned());
    format!("{brand}, {} threads", system.cpus().len())
}
