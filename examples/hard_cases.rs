//! Runs the hard cases and prints them as a table: `cargo run --release --example hard_cases -- [--full] [ROW ...]`.
//!
//! Every row is run by Cairn as it is delivered, by Cairn without control, and by rapier with its default parameters.
//! Without `--full`, some rows are shorter or smaller, as in the tests.

#[path = "../tests/hard/rows/mod.rs"]
mod rows;

use clap::Parser;
use rows::engines::Engine;
use rows::{Extent, Row};
use std::panic::{AssertUnwindSafe, catch_unwind};

#[derive(Parser)]
struct Args {
    /// Every row in the size that it names.
    #[arg(long)]
    full: bool,
    /// Only these rows.
    rows: Vec<String>,
}

fn main() {
    let args = Args::parse();
    let extent = if args.full { Extent::Full } else { Extent::Short };
    println!("| row | passes when | Cairn | without control | plain rapier |");
    println!("| --- | --- | --- | --- | --- |");
    for row in rows::ROWS.iter().filter(|row| args.rows.is_empty() || args.rows.iter().any(|name| name == row.name)) {
        let cells = [Engine::Cairn, Engine::Uncontrolled, Engine::Plain].map(|engine| cell(row, engine, extent));
        println!("| `{}` | {} | {} |", row.name, row.passes_when, cells.join(" | "));
    }
}

fn cell(row: &Row, engine: Engine, extent: Extent) -> String {
    if !row.shown.contains(&engine) {
        return String::new();
    }
    let Ok(outcome) = catch_unwind(AssertUnwindSafe(|| (row.run)(engine, extent))) else {
        return "**fails**: panics".into();
    };
    let judged = row.judged.contains(&engine);
    let verdict = match (outcome.passed, row.fails) {
        (true, _) => "passes".into(),
        (false, Some(why)) if judged => format!("**fails**, as expected ({why})"),
        (false, _) => "**fails**".into(),
    };
    format!("{verdict}: {}", outcome.told)
}
