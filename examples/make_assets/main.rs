//! Writes the example props and control meshes: `cargo run --release --example make_assets [FOLDER]`.
//!
//! Metres, Y up, base at y = 0, centred above the origin. Every mesh is closed and faces outward. In the folder
//! `stacks`: several things in one file, as they stand.

mod asset;
mod file;
mod places;
mod shapes;
mod stacks;
mod vector;

use clap::Parser;
use shapes::*;
use std::path::{Path, PathBuf};

/// Makes the meshes of the examples.
#[derive(Parser)]
struct Args {
    /// Folder for them; examples/assets if it is not named
    folder: Option<PathBuf>,
}

/// A piece of chess, 1 m high.
fn pawn() -> Vec<[f64; 2]> {
    let foot = [[0.36, 0.0], [0.36, 0.12], [0.27, 0.2], [0.21, 0.32], [0.185, 0.46], [0.2, 0.58], [0.27, 0.62]];
    let head = (0..=8).map(|k| {
        let angle = f64::from(k) / 8.0 * 2.4 - 0.83;
        [0.23 * angle.cos(), 0.8 + 0.23 * angle.sin()]
    });
    foot.into_iter().chain(head.take(8)).chain([[0.0, 1.03]]).collect()
}

fn main() -> std::io::Result<()> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
    let folder = Args::parse().folder.unwrap_or(default);
    std::fs::create_dir_all(&folder)?;
    let assets = [
        ("stick", stick()),
        ("book", book()),
        ("banana", banana()),
        ("cube", cube()),
        ("brick", block([0.24, 0.071, 0.115], "brick")),
        ("plank", block([1.2, 0.04, 0.15], "timber")),
        ("plate", plate()),
        ("bowl", bowl()),
        ("card", card()),
        ("ball", ball(0.5)),
        (
            "coin",
            turned(&[[0.0, 0.0], [0.03, 0.0], [0.032, 0.001], [0.032, 0.005], [0.03, 0.006], [0.0, 0.006]], "gold"),
        ),
        ("cart", cart()),
        // Control meshes for sticks: at a packing of 0.4, a cubic metre holds 40 of them.
        ("cone", revolved(&[[1.723, 0.0], [0.0, 1.723 * 2.8]])),
        ("cone-small", revolved(&[[1.132, 0.0], [0.0, 1.132 * 2.8]])),
        ("cylinder", revolved(&[[0.85, 0.0], [0.85, 0.85 * 2.5], [0.0, 0.85 * 2.5]])),
        ("dome", dome(1.53, 1.53)),
        ("letter-t", letter_t(1.2)),
        // For bananas and books.
        ("mound", dome(0.4, 0.3)),
        ("hoard", dome(0.2, 0.12)),
        ("pawn", revolved(&pawn())),
        ("spiral", spiral(0.25, 0.9, [0.25, 2.2])),
        // For what is stacked.
        ("shelf", block([1.6, 1.0, 0.6], "control")),
        ("wall", block([3.0, 1.6, 0.245], "control")),
        ("tower", block([1.25, 2.6, 1.25], "control")),
        ("heap", heap([0.55, 0.33], CART_RIM, 0.37)),
        // What piles lie on, in and around.
        ("hills", places::hills()),
        ("bin", places::bin()),
        ("tray", places::tray()),
        ("desk", places::desk()),
        ("pillar", places::pillar()),
        ("stairs", places::stairs()),
        ("rack", places::rack()),
        ("jar", places::jar()),
        // Its mouth is at x = -0.35, y = 0.7.
        ("jar-tipped", places::jar().moved(-2.0, [-0.7137, 0.8665, 0.0])),
        ("left", places::beside(-0.75)),
        ("right", places::beside(0.75)),
    ];
    for (name, asset) in assets {
        std::fs::write(folder.join(name).with_extension("glb"), asset.to_glb(name))?;
    }
    let folder = folder.join("stacks");
    std::fs::create_dir_all(&folder)?;
    for (name, things) in [("arch", stacks::arch()), ("table", stacks::table())] {
        std::fs::write(folder.join(name).with_extension("glb"), asset::to_glb_of(&things))?;
    }
    Ok(())
}
