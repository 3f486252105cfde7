//! Where a bake's time goes: a flame graph for each small scene, from samples of the running bake, and what README.md
//! beside this file describes them.
//!
//!     CARGO_PROFILE_RELEASE_DEBUG=line-tables-only cargo run --release --package cairn-flames --example flames

mod names;
#[path = "../piles/mod.rs"]
mod piles;

use anyhow::Context;
use cairn_core::report::bake::Bake;
use cairn_input::observer::Silent;
use clap::Parser;
use names::short;
use pprof::flamegraph::{self, Options};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

#[derive(Parser)]
struct Args {
    /// Samples of a scene at least: it is baked until there are so many
    #[arg(long, default_value_t = 4000)]
    samples: usize,
    /// Where the graphs are written; README.md is, where there is one
    #[arg(long, default_value = "tests/studies/flames")]
    out: PathBuf,
}

/// Samples per second of CPU time; not a divisor of anything.
const FREQUENCY: i32 = 997;
/// What takes less of the time, per cent, is not drawn.
const LEAST: f64 = 0.5;
const WIDTH: usize = 1200;

/// A stage of a bake, and the function that a sample of it is in. Of two that a sample is in, the first counts.
const STAGES: [(&str, &str); 11] = [
    ("shapes", "shape::run"),
    ("walls", "container::new"),
    ("fill", "fill::run"),
    ("glue", "glue::run"),
    ("control", "control::cycle"),
    ("release", "release::run"),
    ("hold", "hold::run"),
    ("figures", "make::measure"),
    ("figures", "physics_alone"),
    ("figures", "make::report"),
    ("other", ""),
];

/// What was sampled: stacks from the outermost function on, and how often each was seen.
type Stacks = BTreeMap<Vec<String>, usize>;

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    cairn_job::machine::use_threads(1)?;
    std::fs::create_dir_all(&args.out)?;
    let mut text = String::new();
    for (name, file, set) in piles::SMALL {
        let (stacks, bake) = sampled(name, args.samples)?;
        std::fs::write(args.out.join(format!("{name}.svg")), drawn(name, &stacks)?)?;
        let set: String = set.iter().map(|assignment| format!(" --set {assignment}")).collect();
        let _ = writeln!(
            text,
            "**{name}**, {} bodies (`examples/{file}{set}`), {} samples:",
            bake.report.bodies,
            count(&stacks)
        );
        let _ = writeln!(text, "{}.", shares(stages(&stacks)));
        let _ = writeln!(text, "By function, without what it calls: {}.\n", shares(leaves(&stacks)));
        let _ = writeln!(text, "![]({name}.svg)\n");
    }
    print!("{text}");
    into_page(&args.out.join("README.md"), &text)
}

fn count(stacks: &Stacks) -> usize {
    stacks.values().sum()
}

/// Bakes a scene, again and again, until there are so many samples.
fn sampled(name: &str, samples: usize) -> anyhow::Result<(Stacks, Bake)> {
    let job = piles::small(name, &[])?;
    // Stacks cannot be walked from within these.
    let foreign = ["libc", "libgcc", "pthread", "vdso"];
    let guard = pprof::ProfilerGuardBuilder::default().frequency(FREQUENCY).blocklist(&foreign).build()?;
    loop {
        let bake = cairn_core::bake(&job.scene, &job.params, &mut Silent)?;
        let report = guard.report().build()?;
        let mut stacks = Stacks::new();
        for (frames, &seen) in &report.data {
            let all = frames.frames.iter().rev().flat_map(|frame| frame.iter().rev());
            let mut stack: Vec<String> =
                all.filter_map(|symbol| short(&symbol.name(), symbol.filename.as_deref())).collect();
            stack.dedup();
            // The report is made under the same clock.
            let Some(from) = stack.iter().position(|name| name == "bake") else { continue };
            *stacks.entry(stack.split_off(from + 1)).or_default() += seen as usize;
        }
        if count(&stacks) >= samples {
            return Ok((stacks, bake));
        }
    }
}

fn stages(stacks: &Stacks) -> BTreeMap<String, usize> {
    let mut found = BTreeMap::new();
    for (stack, seen) in stacks {
        let is_in = |function: &str| function.is_empty() || stack.iter().any(|name| name == function);
        let (stage, _) = STAGES.iter().find(|(_, function)| is_in(function)).expect("the last one takes all");
        *found.entry((*stage).to_owned()).or_default() += seen;
    }
    found
}

/// By the innermost function.
fn leaves(stacks: &Stacks) -> BTreeMap<String, usize> {
    let mut found = BTreeMap::new();
    for (stack, seen) in stacks {
        if let Some(leaf) = stack.last() {
            *found.entry(format!("`{leaf}`")).or_default() += seen;
        }
    }
    found
}

/// The largest shares, per cent.
fn shares(of: BTreeMap<String, usize>) -> String {
    const MOST: usize = 6;
    const LEAST: f64 = 0.02;
    let all: usize = of.values().sum();
    let mut of: Vec<(String, usize)> = of.into_iter().collect();
    of.sort_by_key(|(_, seen)| std::cmp::Reverse(*seen));
    let share = |seen: usize| seen as f64 / all as f64;
    let large = of.into_iter().filter(|(_, seen)| share(*seen) >= LEAST).take(MOST);
    large.map(|(name, seen)| format!("{name} {:.0} %", 100.0 * share(seen))).collect::<Vec<_>>().join(", ")
}

fn drawn(name: &str, stacks: &Stacks) -> anyhow::Result<Vec<u8>> {
    let lines: Vec<String> = stacks.iter().map(|(stack, seen)| format!("bake;{} {seen}", stack.join(";"))).collect();
    let mut options = Options::default();
    options.title = format!("A bake of {name}");
    options.min_width = LEAST;
    options.image_width = Some(WIDTH);
    options.deterministic = true;
    // Pages show pictures without running them.
    options.no_javascript = true;
    let mut svg = Vec::new();
    flamegraph::from_lines(&mut options, lines.iter().map(String::as_str), &mut svg).context("a flame graph")?;
    Ok(svg)
}

/// Puts the text between the two marks of the page.
fn into_page(page: &Path, text: &str) -> anyhow::Result<()> {
    const MARKS: [&str; 2] = ["<!-- made by the command above -->\n", "<!-- end -->\n"];
    let Ok(old) = std::fs::read_to_string(page) else { return Ok(()) };
    let (head, rest) = old.split_once(MARKS[0]).context("the page has no mark")?;
    let (_, tail) = rest.split_once(MARKS[1]).context("the page has no end mark")?;
    let date = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    let machine = cairn_job::machine::name();
    let head = format!("{head}{}{}, Cairn {}, {machine}.\n\n", MARKS[0], &date[..10], env!("CARGO_PKG_VERSION"));
    Ok(std::fs::write(page, format!("{head}{text}{}{tail}", MARKS[1]))?)
}
