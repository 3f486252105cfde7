//! Ctrl-C and SIGTERM: ask the bake to end; if it does not listen in time, end the process.

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};

/// Exit code of a command that a person ended.
const CANCELLED: u8 = 130;
/// Exit code of a command that a system ended, and that is to run again.
pub const TRY_AGAIN: u8 = 75;

/// The exit code of who asked first: a person, or a system that wants the machine back. 0: nobody did.
static ASKED: AtomicU8 = AtomicU8::new(0);
/// Held while a file appears under its final name: the process does not end meanwhile.
static WRITING: Mutex<()> = Mutex::new(());

/// How long a bake has to end by itself. A step takes far less; a geometry library may not come back for minutes.
const PATIENCE: Duration = Duration::from_millis(1500);

/// Set in the environment of a process that is to end when its standard input does.
pub const ENDS_WITH_INPUT: &str = "CAIRN_ENDS_WITH_INPUT";

/// From here on, Ctrl-C and SIGTERM are ours.
pub fn listen() {
    if std::env::var_os(ENDS_WITH_INPUT).is_some() {
        when_input_ends();
    }
    static ONCE: Once = Once::new();
    // Without a handler they still end the process, if less politely.
    ONCE.call_once(|| drop(hear()));
}

#[cfg(unix)]
fn hear() -> std::io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let runtime = Builder::new_current_thread().enable_io().build()?;
    let (mut interrupt, mut hang_up, mut terminate) = {
        let _inside = runtime.enter();
        (signal(SignalKind::interrupt())?, signal(SignalKind::hangup())?, signal(SignalKind::terminate())?)
    };
    obey(runtime, async move || {
        tokio::select! {
            _ = interrupt.recv() => CANCELLED,
            _ = hang_up.recv() => CANCELLED,
            _ = terminate.recv() => TRY_AGAIN,
        }
    });
    Ok(())
}

#[cfg(windows)]
fn hear() -> std::io::Result<()> {
    use tokio::signal::windows::{ctrl_break, ctrl_c, ctrl_close, ctrl_shutdown};
    let runtime = Builder::new_current_thread().enable_io().build()?;
    let (mut interrupt, mut stop, mut close, mut shutdown) = {
        let _inside = runtime.enter();
        (ctrl_c()?, ctrl_break()?, ctrl_close()?, ctrl_shutdown()?)
    };
    obey(runtime, async move || {
        tokio::select! {
            _ = interrupt.recv() => CANCELLED,
            _ = stop.recv() => CANCELLED,
            _ = close.recv() => CANCELLED,
            _ = shutdown.recv() => TRY_AGAIN,
        }
    });
    Ok(())
}

/// Asks the process to end each time that a signal comes. `next`: waits for one and gives its exit code.
fn obey(runtime: Runtime, mut next: impl AsyncFnMut() -> u8 + Send + 'static) {
    std::thread::spawn(move || {
        loop {
            ask(runtime.block_on(next()));
        }
    });
}

/// From here on, the end of the standard input is as Ctrl-C: another process holds its other end, and writes nothing.
pub fn when_input_ends() {
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        ask(CANCELLED);
    });
}

fn ask(code: u8) {
    if ASKED.compare_exchange(0, code, Ordering::SeqCst, Ordering::SeqCst).is_ok() {
        std::thread::spawn(|| {
            std::thread::sleep(PATIENCE);
            end();
        });
    } else {
        end();
    }
}

/// Whether the process is to end.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst) != 0
}

/// With which exit code a command ends that was cancelled.
pub fn code() -> u8 {
    match ASKED.load(Ordering::SeqCst) {
        0 => CANCELLED,
        code => code,
    }
}

/// Whether a system wants the machine back, and runs the command again.
pub fn is_from_outside() -> bool {
    code() == TRY_AGAIN
}

/// Keeps the process alive until the guard is dropped.
pub fn shield() -> MutexGuard<'static, ()> {
    WRITING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn end() {
    let _nothing_is_half_written = shield();
    eprintln!("\nerror: cancelled");
    std::process::exit(code().into());
}
