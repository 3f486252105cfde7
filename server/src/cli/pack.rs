//! `cairn pack`: a pile for games and the web.

use super::allowed::{AllowArgs, check_refused};
use super::{Failure, bounds, interrupt, output, print, print_warning};
use cairn_export::ExportError;
use cairn_export::pack::{self, MANIFEST, Manifest, PackError, PackOptions};
use cairn_files::problem::Problem;
use cairn_files::{FileSource, folder_of};
use cairn_job::InputFile;
use cairn_render::RenderModel;
use std::borrow::Cow;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Packs a pile for games and the web
///
/// Writes a folder: the pile at rest as a static mesh in levels of detail, without the triangles that nobody sees from
/// outside; convex colliders of its outside; instances; a skeleton with a clip; textures that hold the motion for a
/// vertex shader; and a manifest with all sizes. Coarser levels that would save nothing are left out.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn pack pile.glb -o pile
  cairn pack pile.glb -o web --meshopt

What each program takes is in examples/guide/engines.md.")]
pub struct Args {
    /// The pile: .glb, as `cairn bake` writes it
    #[arg(value_name = "PILE")]
    pile: PathBuf,

    /// Folder to write: a new or empty one, or an earlier pack
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,

    /// Levels of detail at most, 1 to 8
    #[arg(long, value_name = "COUNT", default_value_t = PackOptions::default().levels,
        value_parser = clap::value_parser!(u32).range(1..=8))]
    levels: u32,

    /// Compress meshes by EXT_meshopt_compression, which three.js, Babylon.js and Unity read, and Blender does not
    #[arg(long)]
    meshopt: bool,

    /// Print the manifest
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    allow: AllowArgs,
}

/// What a pack may leave of an earlier one.
const FILES: [&str; 6] =
    ["colliders.glb", "instances.glb", "skinned.glb", "motion.glb", "motion.positions.exr", "motion.rotations.exr"];

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    check(args)?;
    bounds::use_threads(0)?;
    let disk: Arc<dyn FileSource> = args.allow.disk(&[&args.pile], false)?;
    let file = InputFile::read(&args.pile, &disk).map_err(Failure::input)?;
    let bad = |what: String| Failure::input(Problem::new(&file.name, what, "Give a .glb that `cairn bake` wrote."));
    let bytes = cairn_export::as_gltf(&file.bytes, &*file.resolve).map(Cow::into_owned).map_err(bad)?;
    let model = RenderModel { name: &file.name, bytes: &bytes, resolve: &*file.resolve };
    let options = PackOptions { levels: args.levels, is_compressed: args.meshopt };
    let packed = pack::pack(&model, &options, &mut || !interrupt::is_requested());
    let manifest = match packed {
        Ok(Some(manifest)) => manifest,
        Ok(None) => return Err(Failure::Cancelled),
        Err(PackError::Render(error)) => return Err(error.into()),
        Err(PackError::Export(error @ ExportError::TooLarge)) => return Err(error.into()),
        Err(PackError::Mesh(error)) => return Err(Failure::Internal(error.to_string())),
        Err(error) => return Err(bad(error.to_string())),
    };
    check_refused(disk.refused())?;
    write(&args.output, &manifest)?;
    manifest.left_out.iter().for_each(|sentence| print_warning(sentence));
    print(&if args.json { manifest.text() } else { summary(&manifest) })
}

/// Whether the pack can be written there.
fn check(args: &Args) -> Result<(), Failure> {
    let folder = &args.output;
    let refuse = |what: &str, remedy: &str| Err(Failure::input(Problem::at(folder, what, remedy)));
    if folder.exists() && !folder.is_dir() {
        return refuse("a file, not a folder", "Name a folder.");
    }
    let lies_in = |path: &Path| folder_of(path).canonicalize().ok() == folder.canonicalize().ok();
    if folder.is_dir() {
        if lies_in(&args.pile) {
            return refuse("the pile itself lies in this folder", "Name another folder.");
        }
        let is_empty = folder.read_dir().is_ok_and(|mut entries| entries.next().is_none());
        if !is_empty && !folder.join(MANIFEST).is_file() {
            return refuse("the folder has files, and they are no pack", "Name a new or an empty folder.");
        }
        return output::check(&folder.join(MANIFEST), &[]);
    }
    output::check(folder, &[])
}

/// Writes all files; the manifest is the last one. An earlier pack loses its manifest first, so that a folder with a
/// manifest is always complete.
fn write(folder: &Path, manifest: &Manifest) -> Result<(), Failure> {
    let _complete = output::begin()?;
    let make = |path: &Path| std::fs::create_dir_all(path).map_err(|error| Failure::write(path, &error));
    let old = FILES.iter().map(|name| (*name).to_owned()).chain((0..8).map(|level| format!("static.lod{level}.glb")));
    for name in [MANIFEST.to_owned()].into_iter().chain(old) {
        match std::fs::remove_file(folder.join(&name)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                return Err(Failure::write(&folder.join(&name), &error));
            }
            _ => {}
        }
    }
    make(folder)?;
    for file in &manifest.files {
        let path = folder.join(&file.file);
        make(folder_of(&path))?;
        output::write(&path, &file.content)?;
    }
    output::write(&folder.join(MANIFEST), manifest.text().as_bytes())
}

fn summary(manifest: &Manifest) -> String {
    let mut text = String::new();
    let kib = |bytes: usize| format!("{:.0} KiB", bytes as f64 / 1024.0);
    for file in &manifest.files {
        let triangles = match file.triangles {
            0 => String::new(),
            count => format!("{count} triangles, {} draw calls", file.draws),
        };
        writeln!(text, "  {:<24}{:>12}  {triangles}", file.file, kib(file.bytes)).expect("a string takes all");
    }
    for (number, level) in manifest.levels.iter().enumerate() {
        let silhouette = level.silhouette.map_or(String::new(), |difference| {
            format!("; its silhouette at 1080p is off by {} px at most", difference.farthest_px)
        });
        writeln!(
            text,
            "level {number}: {:.1} % of the pile's triangles; {:.0} % were hidden{silhouette}",
            100.0 * level.triangle_share,
            100.0 * level.hidden_share
        )
        .expect("a string takes all");
    }
    text
}
