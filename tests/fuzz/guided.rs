//! The targets, guided by libFuzzer. `CAIRN_FUZZ_TARGET` says which; `run` calls this.

#![no_main]

mod targets;

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use std::sync::OnceLock;

static TARGET: OnceLock<fn(&[u8])> = OnceLock::new();

/// The target that was asked for. Its seeds go where the first run looks for them.
fn begin() -> fn(&[u8]) {
    let name = std::env::var("CAIRN_FUZZ_TARGET").expect("CAIRN_FUZZ_TARGET names a target");
    let target = targets::TARGETS.iter().find(|target| target.name == name).expect("a target of this name");
    if let Some(folder) = std::env::var_os("CAIRN_FUZZ_SEEDS") {
        for (index, seed) in (target.seeds)().into_iter().enumerate() {
            std::fs::write(Path::new(&folder).join(format!("seed-{index}")), seed).unwrap();
        }
    }
    // The core survives panics of some of its libraries. What no one catches ends the run all the same.
    std::panic::set_hook(Box::new(|info| eprintln!("{info}")));
    target.run
}

fuzz_target!(|bytes: &[u8]| TARGET.get_or_init(begin)(bytes));
