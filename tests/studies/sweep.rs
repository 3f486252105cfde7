//! The stability sweep: bakes random small scenes and prints which invariants were violated:
//! `cargo study sweep -- --count 1000 --seed 1 [--only 17] [--out FOLDER]`.
//!
//! A failure shrinks to the simplest scene that still fails, which is written as a scene file for `cairn bake`.

#[path = "../hard/rows/mod.rs"]
mod rows;
#[path = "../hard/sweep/mod.rs"]
mod sweep;

use clap::Parser;
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::path::PathBuf;
use sweep::Verdict;

#[derive(Parser)]
struct Args {
    #[arg(long, default_value_t = 1000)]
    count: u64,
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only the scene of this number.
    #[arg(long)]
    only: Option<u64>,
    /// Every so many scenes, one is baked twice, and must come out the same.
    #[arg(long, default_value_t = 20)]
    twice: u64,
    /// Where failures are written.
    #[arg(long, default_value = "target/sweep")]
    out: PathBuf,
}

fn main() -> std::io::Result<()> {
    let args = Args::parse();
    if args.only.is_none() {
        // Panics are counted, not shown.
        std::panic::set_hook(Box::new(|_| {}));
    }
    let (mut sound, mut refused, mut repeated, mut violated) = (0, 0, 0, 0);
    for number in args.only.map_or(0..args.count, |n| n..n + 1) {
        let mut seed = [0; 32];
        seed[..8].copy_from_slice(&args.seed.to_le_bytes());
        seed[8..16].copy_from_slice(&number.to_le_bytes());
        let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &seed);
        let mut runner = TestRunner::new_with_rng(Config::default(), rng);
        let mut tree = sweep::recipe::recipe().new_tree(&mut runner).expect("nothing is filtered out");
        let recipe = tree.current();
        match sweep::run(&recipe) {
            Ok(Verdict::Sound(bake)) => {
                sound += 1;
                if number.is_multiple_of(args.twice) {
                    repeated += 1;
                    let again = sweep::run(&recipe);
                    if !matches!(again, Ok(Verdict::Sound(again)) if again.pile.frames == bake.pile.frames) {
                        violated += 1;
                        println!("scene {number}: a second run differs");
                    }
                }
            }
            Ok(Verdict::Refused(_)) => refused += 1,
            Err(violation) => {
                violated += 1;
                println!("scene {number}: {violation}");
                let smallest = shrunk(&mut tree);
                let path = sweep::file::write(&smallest, &args.out.join(format!("{}-{number}", args.seed)))?;
                println!("    {}: {:?}", path.display(), smallest);
            }
        }
    }
    println!(
        "seed {}: {sound} sound ({repeated} of them baked twice), {refused} refused, {violated} violated",
        args.seed
    );
    std::process::exit(i32::from(violated > 0))
}

/// The simplest recipe that still fails.
fn shrunk(tree: &mut impl ValueTree<Value = sweep::recipe::Recipe>) -> sweep::recipe::Recipe {
    /// Bound on the bakes.
    const STEPS: usize = 120;
    let mut smallest = tree.current();
    let mut going = tree.simplify();
    for _ in 0..STEPS {
        if !going {
            break;
        }
        let next = tree.current();
        if sweep::run(&next).is_err() {
            smallest = next;
            going = tree.simplify();
        } else {
            going = tree.complicate();
        }
    }
    smallest
}
