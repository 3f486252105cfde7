//! The sandbox of a worker: it parses files of strangers, so it can open no file outside of its folders, no connection
//! and no program, and reach no other process. Linux has one without privileges; on other systems there is none.

use std::path::Path;

/// What a sandbox lacks on this machine, one sentence each.
pub type Missing = Vec<&'static str>;

pub const NO_FILES: &str = "Files are not shut off: Landlock needs Linux 5.13, and to be switched on in the kernel";
pub const NO_CALLS: &str = "Connections, programs and other processes are not shut off: seccomp is not there";
pub const NO_SANDBOX: &str = "This system has no sandbox that needs no privileges: run the server as a user of its own";

/// Puts this thread, and all that it starts later, into the sandbox. `folders`: those that it may read and write.
#[cfg(target_os = "linux")]
pub fn enter(folders: &[&Path]) -> Missing {
    let mut missing = Vec::new();
    if !linux::shut_files(folders).unwrap_or(false) {
        missing.push(NO_FILES);
    }
    if linux::shut_calls().is_err() {
        missing.push(NO_CALLS);
    }
    missing
}

#[cfg(not(target_os = "linux"))]
pub fn enter(_: &[&Path]) -> Missing {
    vec![NO_SANDBOX]
}

/// What a sandbox lacks, tried in a thread of its own.
pub fn tried() -> Missing {
    std::thread::spawn(|| enter(&[])).join().unwrap_or_else(|_| vec![NO_SANDBOX])
}

#[cfg(target_os = "linux")]
mod linux {
    use landlock::{
        ABI, Access, AccessFs, AccessNet, RulesetAttr, RulesetCreatedAttr, RulesetError, RulesetStatus, Scope,
        path_beneath_rules,
    };
    use seccompiler::{
        BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter, SeccompRule,
    };
    use std::collections::BTreeMap;
    use std::path::Path;

    /// What a worker may read besides: figures of the machine and of itself.
    const READABLE: [&str; 9] = [
        "/dev/null",
        "/dev/urandom",
        "/dev/zero",
        "/proc/self",
        "/proc/meminfo",
        "/proc/cpuinfo",
        "/proc/stat",
        "/sys/devices/system/cpu",
        "/sys/fs/cgroup",
    ];
    /// The newest version whose rights are taken away; of older kernels, those that they know.
    const NEWEST: ABI = ABI::V6;

    /// Whether the kernel shuts off files.
    pub fn shut_files(folders: &[&Path]) -> Result<bool, RulesetError> {
        let all = AccessFs::from_all(NEWEST);
        let status = landlock::Ruleset::default()
            .handle_access(all)?
            .handle_access(AccessNet::from_all(NEWEST))?
            .scope(Scope::from_all(NEWEST))?
            .create()?
            .add_rules(path_beneath_rules(READABLE, AccessFs::from_read(NEWEST)))?
            .add_rules(path_beneath_rules(folders, all & !AccessFs::Execute))?
            .restrict_self()?;
        Ok(status.ruleset != RulesetStatus::NotEnforced)
    }

    /// Calls that reach the network, other programs and processes, and the machine.
    const SHUT: [i64; 55] = [
        libc::SYS_socket,
        libc::SYS_socketpair,
        libc::SYS_connect,
        libc::SYS_bind,
        libc::SYS_listen,
        libc::SYS_accept,
        libc::SYS_accept4,
        libc::SYS_execve,
        libc::SYS_execveat,
        libc::SYS_ptrace,
        libc::SYS_process_vm_readv,
        libc::SYS_process_vm_writev,
        libc::SYS_process_madvise,
        libc::SYS_kcmp,
        libc::SYS_pidfd_open,
        libc::SYS_pidfd_getfd,
        libc::SYS_pidfd_send_signal,
        libc::SYS_kill,
        libc::SYS_tkill,
        libc::SYS_rt_sigqueueinfo,
        libc::SYS_rt_tgsigqueueinfo,
        libc::SYS_setpriority,
        libc::SYS_mq_open,
        libc::SYS_msgget,
        libc::SYS_semget,
        libc::SYS_shmget,
        libc::SYS_bpf,
        libc::SYS_perf_event_open,
        libc::SYS_userfaultfd,
        libc::SYS_io_uring_setup,
        libc::SYS_io_uring_enter,
        libc::SYS_io_uring_register,
        libc::SYS_keyctl,
        libc::SYS_add_key,
        libc::SYS_request_key,
        libc::SYS_mount,
        libc::SYS_umount2,
        libc::SYS_pivot_root,
        libc::SYS_chroot,
        libc::SYS_move_mount,
        libc::SYS_open_tree,
        libc::SYS_fsopen,
        libc::SYS_setns,
        libc::SYS_unshare,
        libc::SYS_init_module,
        libc::SYS_finit_module,
        libc::SYS_delete_module,
        libc::SYS_kexec_load,
        libc::SYS_reboot,
        libc::SYS_swapon,
        libc::SYS_swapoff,
        libc::SYS_mknodat,
        libc::SYS_acct,
        libc::SYS_syslog,
        libc::SYS_open_by_handle_at,
    ];
    /// On x86-64, the same calls have other numbers with this bit; and these are further ones.
    #[cfg(target_arch = "x86_64")]
    const OTHER_NUMBERS: (i64, std::ops::Range<i64>) = (0x4000_0000, 512..548);

    /// Shuts off calls of the system.
    pub fn shut_calls() -> Result<(), seccompiler::Error> {
        let mut rules: BTreeMap<i64, Vec<SeccompRule>> = SHUT.into_iter().map(|call| (call, Vec::new())).collect();
        #[cfg(target_arch = "x86_64")]
        {
            let (bit, further) = OTHER_NUMBERS;
            let known: Vec<i64> = rules.keys().copied().collect();
            rules.extend(known.into_iter().chain(further).map(|call| (call | bit, Vec::new())));
            rules.extend([libc::SYS_fork, libc::SYS_vfork].map(|call| (call, Vec::new())));
        }
        // Of these, only what concerns this process: signals to its threads, its limits, and threads.
        let when = |operator, value| -> Result<Vec<SeccompRule>, seccompiler::Error> {
            let condition = SeccompCondition::new(0, SeccompCmpArgLen::Dword, operator, value)?;
            Ok(vec![SeccompRule::new(vec![condition])?])
        };
        rules.insert(libc::SYS_tgkill, when(SeccompCmpOp::Ne, std::process::id().into())?);
        rules.insert(libc::SYS_prlimit64, when(SeccompCmpOp::Ne, 0)?);
        let thread = libc::CLONE_THREAD as u64;
        rules.insert(libc::SYS_clone, when(SeccompCmpOp::MaskedEq(thread), 0)?);
        apply(rules, libc::EPERM)?;
        // Its flags are out of sight: the library then takes the older call.
        apply(BTreeMap::from([(libc::SYS_clone3, Vec::new())]), libc::ENOSYS)
    }

    fn apply(rules: BTreeMap<i64, Vec<SeccompRule>>, error: i32) -> Result<(), seccompiler::Error> {
        let refused = SeccompAction::Errno(error.unsigned_abs());
        let machine = std::env::consts::ARCH.try_into()?;
        let program: BpfProgram = SeccompFilter::new(rules, SeccompAction::Allow, refused, machine)?.try_into()?;
        seccompiler::apply_filter(&program)
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::net::TcpListener;
    use std::process::Command;

    #[test]
    fn nothing_outside_is_reached() {
        let folder = tempfile::tempdir().unwrap();
        let outside = tempfile::NamedTempFile::new().unwrap();
        let (inside, outside) = (folder.path().to_owned(), outside.path().to_owned());
        let tried = move || {
            let missing = enter(&[&inside]);
            assert!(std::fs::write(inside.join("a"), "b").is_ok() && std::fs::read(inside.join("a")).is_ok());
            assert!(std::fs::read_to_string("/proc/self/status").is_ok());
            assert!(std::thread::spawn(|| ()).join().is_ok());
            if !missing.contains(&NO_FILES) {
                assert!(std::fs::read(&outside).is_err() && std::fs::read("/etc/passwd").is_err());
                assert!(std::fs::write(outside.with_extension("new"), "").is_err());
                let parent = std::os::unix::process::parent_id();
                assert!(std::fs::read(format!("/proc/{parent}/environ")).is_err());
            }
            if !missing.contains(&NO_CALLS) {
                assert!(TcpListener::bind("127.0.0.1:0").is_err());
                assert!(Command::new("true").status().is_err());
            }
            missing
        };
        // As far as this machine has a sandbox, which `doctor` says.
        let missing = std::thread::spawn(tried).join().unwrap();
        assert_eq!(missing, super::tried());
    }
}
