//! How Cairn's time and memory grow with the pile: bakes sticks, bananas and rubble in cones that take 100, 1,000, ...
//! of them.
//!
//!     cargo study growth -- --to 1000
//!
//! Goes on where it ended: what is measured stays in target/growth. README.md beside this file describes the rest.

#[path = "../../hard/rows/gltf.rs"]
mod gltf;
mod plot;
mod row;
mod scenes;
mod table;

use clap::Parser;
use row::{Asked, Row};
use scenes::Kind;
use std::path::PathBuf;

#[derive(Parser)]
struct Args {
    /// The largest pile, bodies
    #[arg(long, default_value_t = 1_000)]
    to: usize,
    /// draft, preview, standard, fine or reference
    #[arg(long, default_value = "draft")]
    accuracy: String,
    /// Only these kinds
    #[arg(long, value_enum, value_delimiter = ',')]
    only: Vec<Kind>,
    /// Set a field of each scene, as `cairn bake --set` does
    #[arg(long)]
    set: Vec<String>,
    /// A Blender, or a Python with bpy, to measure how long it takes to write the motion there; target/addon must have
    /// the add-on
    #[arg(long)]
    blender: Option<PathBuf>,
    /// The program that bakes
    #[arg(long, env = "CAIRN", default_value = "target/release/cairn")]
    cairn: PathBuf,
    /// Where growth-ACCURACY.md and .svg are written
    #[arg(long, default_value = "target/growth")]
    out: PathBuf,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let kept = PathBuf::from("target/growth");
    let asked = Asked {
        accuracy: &args.accuracy,
        set: &args.set,
        cairn: &args.cairn,
        blender: args.blender.as_deref(),
        kept: &kept,
    };
    let kinds = if args.only.is_empty() { Kind::ALL.to_vec() } else { args.only };
    // The small ones of all kinds first.
    let mut sizes: Vec<(usize, Kind)> =
        kinds.iter().flat_map(|&kind| kind.sizes().iter().map(move |&size| (size, kind))).collect();
    sizes.retain(|(size, _)| *size <= args.to);
    sizes.sort_by_key(|(size, _)| *size);
    let mut rows: Vec<Row> = Vec::new();
    for (size, kind) in sizes {
        eprintln!("{} {}", size, kind.name());
        let smaller = rows.iter().rfind(|row| row.kind == kind);
        let yields = smaller.map_or(1.0, |row| row.bodies as f64 / row.expected);
        rows.push(asked.row(kind, size, yields)?);
    }
    rows.sort_by_key(|row| (Kind::ALL.iter().position(|kind| *kind == row.kind), row.wanted));
    let text = table::markdown(&rows);
    print!("{text}");
    std::fs::create_dir_all(&args.out)?;
    std::fs::write(args.out.join(format!("growth-{}.md", args.accuracy)), text)?;
    plot::draw(&rows, &args.out.join(format!("growth-{}.svg", args.accuracy)))
}
