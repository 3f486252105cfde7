//! Ctrl-C and SIGTERM: they request the end of the bake; if it does not end in time, they end the process.

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};

/// Exit code of a command that a person cancelled.
const CANCELLED: u8 = 130;
/// Exit code of a command that a system stopped and that should run again.
pub const TRY_AGAIN: u8 = 75;

/// The exit code of the first request to end, by a person or by a system that needs the machine. 0: there was none.
static REQUESTED: AtomicU8 = AtomicU8::new(0);
/// Held while files get their final names: the process does not end meanwhile.
static WRITING: Mutex<()> = Mutex::new(());

/// Time for a bake to end by itself. A step takes far less; a geometry library may take minutes.
const PATIENCE: Duration = Duration::from_millis(1500);

/// Set in the environment of a process that has to end when its standard input ends.
pub const ENDS_WITH_INPUT: &str = "CAIRN_ENDS_WITH_INPUT";

/// Handles Ctrl-C and SIGTERM from now on.
pub fn listen() {
    if std::env::var_os(ENDS_WITH_INPUT).is_some() {
        end_with_input();
    }
    static ONCE: Once = Once::new();
    // Without a handler, they still end the process at once.
    ONCE.call_once(|| drop(install_handlers()));
}

#[cfg(unix)]
fn install_handlers() -> std::io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let runtime = Builder::new_current_thread().enable_io().build()?;
    let (mut interrupt, mut hang_up, mut terminate) = {
        let _inside = runtime.enter();
        (signal(SignalKind::interrupt())?, signal(SignalKind::hangup())?, signal(SignalKind::terminate())?)
    };
    watch_signals(runtime, async move || {
        tokio::select! {
            _ = interrupt.recv() => CANCELLED,
            _ = hang_up.recv() => CANCELLED,
            _ = terminate.recv() => TRY_AGAIN,
        }
    });
    Ok(())
}

#[cfg(windows)]
fn install_handlers() -> std::io::Result<()> {
    use tokio::signal::windows::{ctrl_break, ctrl_c, ctrl_close, ctrl_shutdown};
    let runtime = Builder::new_current_thread().enable_io().build()?;
    let (mut interrupt, mut stop, mut close, mut shutdown) = {
        let _inside = runtime.enter();
        (ctrl_c()?, ctrl_break()?, ctrl_close()?, ctrl_shutdown()?)
    };
    watch_signals(runtime, async move || {
        tokio::select! {
            _ = interrupt.recv() => CANCELLED,
            _ = stop.recv() => CANCELLED,
            _ = close.recv() => CANCELLED,
            _ = shutdown.recv() => TRY_AGAIN,
        }
    });
    Ok(())
}

/// Requests the end for each signal. `next` waits for a signal and returns its exit code.
fn watch_signals(runtime: Runtime, mut next: impl AsyncFnMut() -> u8 + Send + 'static) {
    std::thread::spawn(move || {
        loop {
            request_end(runtime.block_on(next()));
        }
    });
}

/// Treats the end of the standard input like Ctrl-C. Another process holds its other end and writes nothing.
pub fn end_with_input() {
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        request_end(CANCELLED);
    });
}

fn request_end(code: u8) {
    if REQUESTED.compare_exchange(0, code, Ordering::SeqCst, Ordering::SeqCst).is_ok() {
        std::thread::spawn(|| {
            std::thread::sleep(PATIENCE);
            end();
        });
    } else {
        end();
    }
}

/// Whether the process has to end.
pub fn is_requested() -> bool {
    REQUESTED.load(Ordering::SeqCst) != 0
}

/// The exit code of a cancelled command.
pub fn code() -> u8 {
    match REQUESTED.load(Ordering::SeqCst) {
        0 => CANCELLED,
        code => code,
    }
}

/// Whether a system requested the end; it will run the command again.
pub fn is_from_outside() -> bool {
    code() == TRY_AGAIN
}

/// Keeps the process alive until the guard is dropped.
pub fn shield() -> MutexGuard<'static, ()> {
    WRITING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn end() {
    let _nothing_is_half_written = shield();
    if !super::is_json() {
        // After the `^C` of a terminal.
        eprintln!();
    }
    super::print_error("cancelled");
    std::process::exit(code().into());
}
