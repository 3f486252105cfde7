//! Free memory goes back to the system. The allocator of glibc keeps what was freed, however much: a server would have
//! the memory of its busiest hour forever.

// The only call of a library without a safe form.
#![allow(unsafe_code)]

#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn give_back() {
    // SAFETY: it takes a number, locks what it works on, and may be called by any thread at any time.
    unsafe { libc::malloc_trim(0) };
}

/// Other allocators give it back themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn give_back() {}
