//! `cairn verify`: bakes results again and compares them.

use super::bounds::{self, Bounds};
use super::progress::{Mode, Reporter};
use super::{Failure, interrupt, print};
use cairn_export::pack::MANIFEST;
use cairn_export::{Encoded, Format};
use cairn_files::problem::Problem;
use cairn_job::report::versions_json;
use cairn_job::reuse::BakeCache;
use cairn_job::{FinishedBake, Job, provenance};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Bakes results again and compares every byte
///
/// Each result holds its scene, and the names and hashes of its files. It is baked again from these without the cache.
/// A result that was baked from an earlier one (`from`) is the same only as that is: the earlier one is verified, too.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn verify pile.glb
  cairn verify out/*.glb --sample 5      (5 of them, evenly spread)

Exit code 0: all are the same; 1: a result differs.")]
pub struct Args {
    /// Results: .glb, .json, .usdc, .usda, .usdz; a .csv, a .xml and a pack do not hold their scene
    #[arg(required = true, value_name = "RESULT")]
    results: Vec<PathBuf>,

    /// Bake only this many of them, evenly spread over the list
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    sample: Option<u64>,

    /// Folder of the scenes' files; folders below it are searched [default: the result's folder, one above it, the
    /// current one]
    #[arg(long, value_name = "FOLDER")]
    assets: Option<PathBuf>,

    /// Form of the progress on stderr
    #[arg(long, value_enum, default_value_t = Mode::Auto)]
    pub progress: Mode,

    /// Print a JSON object for each result, one per line: result, same, difference
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    bounds: Bounds,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    args.bounds.enforce(|| verify_all(args))
}

fn verify_all(args: &Args) -> Result<(), Failure> {
    bounds::use_threads(0)?;
    let mut is_same = true;
    let mut open: Vec<PathBuf> = sample(&args.results, args.sample).into_iter().rev().map(Path::to_owned).collect();
    let mut seen: BTreeSet<PathBuf> = BTreeSet::new();
    while let Some(path) = open.pop() {
        if !seen.insert(cairn_files::normalized(&path)) {
            continue;
        }
        let Verified { difference, former } = verify(args, &path)?;
        open.extend(former);
        is_same &= difference.is_none();
        let object = || json!({ "result": path, "same": difference.is_none(), "difference": difference });
        print(&match args.json {
            true => format!("{}\n", object()),
            false => format!("{}: {}\n", path.display(), difference.as_deref().unwrap_or("the same")),
        })?;
    }
    if is_same { Ok(()) } else { Err(Failure::Reported(1)) }
}

/// `count` of them at even distances, starting with the first.
fn sample(all: &[PathBuf], count: Option<u64>) -> Vec<&Path> {
    let count = count.map_or(all.len(), |count| usize::try_from(count).unwrap_or(usize::MAX).min(all.len()));
    (0..count).map(|number| &*all[number * all.len() / count]).collect()
}

/// Refuses what holds no scene, whoever wrote it.
fn check_format(path: &Path) -> Result<(), Failure> {
    let is_pack = path.is_dir() && path.join(MANIFEST).is_file();
    let kind = match Format::of(path) {
        _ if is_pack => "pack".to_owned(),
        Some(format) if !format.states_origin() => format!(".{}", format.extension()),
        _ => return Ok(()),
    };
    let what = format!("a {kind} cannot be verified: it does not hold its scene");
    let remedy = "Verify a .glb, .json or USD result of the same bake; or bake the scene again with --report, and \
                  compare output_blake3.";
    Err(Failure::input(Problem::at(path, what, remedy)))
}

/// A result that was baked again.
struct Verified {
    /// From the new one, if any.
    difference: Option<String>,
    /// The earlier result that it was baked from, to be verified next.
    former: Option<PathBuf>,
}

/// Bakes a result again.
fn verify(args: &Args, path: &Path) -> Result<Verified, Failure> {
    check_format(path)?;
    let tree = provenance::scene(path, args.assets.as_deref()).map_err(Failure::Input)?;
    let before = cairn_files::read(path).map_err(Failure::input)?;
    let Some(origin) = provenance::origin(&before) else { unreachable!("its scene was read") };
    let own = versions_json();
    if origin.versions != own {
        let what = format!("baked by other versions: {}; this is {own}", origin.versions);
        return Err(Failure::input(Problem::at(path, what, "Use the version of Cairn that baked it.")));
    }
    let job = Job::read_tree(&tree, args.bounds.limits())?;
    let job = job.relative_to(tree.folder()).written_into(cairn_files::folder_of(path));
    let former = tree.to_message().from.map(|from| PathBuf::from(from.path));
    let former = former.map(|path| tree.files().find(&path).unwrap_or(path));
    let verified = |difference: Option<String>| Verified { difference, former };
    let mut reporter = Reporter::new(args.progress);
    let format = Format::of(path).unwrap_or(Format::Glb);
    let done = job.run(format, &path.display().to_string(), &mut BakeCache::none(), &mut reporter);
    reporter.finish(done.is_ok());
    let FinishedBake { result, hash, .. } = done?;
    let Encoded { bytes, sidecars, .. } = result;
    if bytes == before {
        let is_there = |(name, bytes): &(&String, &Vec<u8>)| {
            std::fs::read(cairn_files::folder_of(path).join(name)).is_ok_and(|there| there == **bytes)
        };
        let wrong = sidecars.iter().find(|file| !is_there(file));
        return Ok(verified(wrong.map(|(name, _)| format!("DIFFERS: {name} beside it is missing or changed"))));
    }
    let motion =
        if hash.to_hex().as_str() == origin.result_blake3 { "the motion is the same" } else { "the motion differs" };
    let at = bytes.iter().zip(&before).position(|(a, b)| a != b).unwrap_or(bytes.len().min(before.len()));
    Ok(verified(Some(format!("DIFFERS from byte {at} on; by its hash, {motion}"))))
}
