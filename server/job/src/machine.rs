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
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// Sets the number of threads, this one included; 0: one per processor, or as `RAYON_NUM_THREADS` says. Call it once,
/// before any work.
pub fn use_threads(count: usize) -> Result<(), rayon::ThreadPoolBuildError> {
    rayon::ThreadPoolBuilder::new().num_threads(count).use_current_thread().build_global()
}

/// Limits the memory of this process, bytes, if the system can.
#[cfg(unix)]
pub fn limit_memory(bytes: u64) -> std::io::Result<()> {
    rlimit::setrlimit(rlimit::Resource::AS, bytes, bytes)
}

#[cfg(not(unix))]
pub fn limit_memory(_bytes: u64) -> std::io::Result<()> {
    Ok(())
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
