//! Free memory goes back to the system. The allocator of glibc would keep what was freed, up to some dozen MiB for each
//! thread once a large request was there: a server would have the memory of its busiest hour forever.

// The only calls of a library without a safe form.
#![allow(unsafe_code)]

/// Pieces of this size, bytes, come from the system one by one, and go back to it at once.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE: libc::c_int = 256 << 10;

/// Keeps the allocator to one heap, since it gives back the end of no other, and to these bounds, which it otherwise
/// raises with the pieces that it sees. For threads that start later.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn set_up() {
    for (what, value) in [(libc::M_ARENA_MAX, 1), (libc::M_MMAP_THRESHOLD, LARGE), (libc::M_TRIM_THRESHOLD, LARGE)] {
        // SAFETY: it takes two numbers, locks what it works on, and may be called by any thread at any time.
        unsafe { libc::mallopt(what, value) };
    }
}

/// Gives back what is free between pieces in use.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn give_back() {
    // SAFETY: it takes a number, locks what it works on, and may be called by any thread at any time.
    unsafe { libc::malloc_trim(0) };
}

/// Other allocators give it back themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn set_up() {}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn give_back() {}
