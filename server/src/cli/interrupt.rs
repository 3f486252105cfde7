//! Ctrl-C and SIGTERM: ask the bake to end; if it does not listen in time, end the process.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

static ASKED: AtomicBool = AtomicBool::new(false);
/// Held while a file appears under its final name: the process does not end meanwhile.
static WRITING: Mutex<()> = Mutex::new(());

/// How long a bake has to end by itself. A step takes far less; a geometry library may not come back for minutes.
const PATIENCE: Duration = Duration::from_millis(1500);

/// Set in the environment of a process that is to end when its standard input does.
pub const ENDS_WITH_INPUT: &str = "CAIRN_ENDS_WITH_INPUT";

/// From here on, Ctrl-C is ours.
pub fn listen() {
    if std::env::var_os(ENDS_WITH_INPUT).is_some() {
        when_input_ends();
    }
    // Without a handler Ctrl-C still ends the process, if less politely.
    let _ = ctrlc::set_handler(ask);
}

/// From here on, the end of the standard input is as Ctrl-C: another process holds its other end, and writes nothing.
pub fn when_input_ends() {
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        ask();
    });
}

fn ask() {
    if !ASKED.swap(true, Ordering::SeqCst) {
        std::thread::spawn(|| {
            std::thread::sleep(PATIENCE);
            end();
        });
    } else {
        end();
    }
}

/// Whether the user wants to end.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}

/// Keeps the process alive until the guard is dropped.
pub fn shield() -> MutexGuard<'static, ()> {
    WRITING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn end() {
    let _nothing_is_half_written = shield();
    eprintln!("\nerror: cancelled");
    std::process::exit(130);
}
