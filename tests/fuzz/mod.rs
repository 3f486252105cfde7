//! A short run of every fuzz target, and all that was ever found. `tests/fuzz/run` searches for longer, guided by what
//! the inputs reach.

mod targets;

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use targets::{TARGETS, Target, contents, root};

/// Runs one input. Where it breaks a promise, it is kept, so that it can become a test.
fn run(target: &Target, input: &[u8]) {
    let broken = std::panic::catch_unwind(|| (target.run)(input)).is_err();
    if broken {
        let folder = root().join("target/fuzz-found").join(target.name);
        std::fs::create_dir_all(&folder).unwrap();
        let path =
            folder.join(format!("{:08x}", input.iter().fold(5381_u32, |h, b| h.wrapping_mul(33) ^ u32::from(*b))));
        std::fs::write(&path, input).unwrap();
        panic!("{}: {} breaks a promise; once fixed, put it into tests/fuzz/found/{0}", target.name, path.display());
    }
}

/// As others mutate, without looking at what is reached.
fn mutated(rng: &mut impl Rng, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..rng.random_range(1..=4) {
        let at = rng.random_range(0..=bytes.len());
        let end = (at + rng.random_range(1..=8)).min(bytes.len());
        match rng.random_range(0..6) {
            0 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
            1 if at < bytes.len() => bytes[at] = [0, 1, 0x7f, 0x80, 0xff, b'-', b'9', b'"'][rng.random_range(0..8)],
            2 => drop(bytes.drain(at..end)),
            3 => bytes.extend_from_within(at..end),
            4 => bytes.insert(at, rng.random()),
            _ => {
                let from = rng.random_range(0..=other.len());
                bytes.truncate(at);
                bytes.extend_from_slice(&other[from..]);
            }
        }
    }
    bytes
}

fn short(name: &str) {
    let target = TARGETS.iter().find(|target| target.name == name).unwrap();
    for found in contents(&root().join("tests/fuzz/found").join(name), &[""]) {
        run(target, &found);
    }
    let seeds = (target.seeds)();
    seeds.iter().for_each(|seed| run(target, seed));
    // Always the same inputs: a test that fails by chance helps nobody.
    let rng = &mut Pcg64Mcg::seed_from_u64(1);
    for _ in 0..target.short {
        let [seed, other] = [0, 0].map(|_| &seeds[rng.random_range(0..seeds.len())]);
        run(target, &mutated(rng, seed, other));
    }
}

#[test]
fn reading() {
    short("reading");
}

#[test]
fn scene() {
    short("scene");
}

#[test]
fn uploads() {
    short("uploads");
}

#[test]
fn equilibrium() {
    short("equilibrium");
}

#[test]
fn shape() {
    short("shape");
}
