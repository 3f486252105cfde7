//! `cairn rank`: ranks the results of a batch, and makes a contact sheet.

use super::{Failure, interrupt, output, print, print_note, print_warning, table};
use crate::sheet::{self, Candidate, SortKey, Thumbnail};
use image::ImageFormat;
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Ranks the results of a batch by their figures, and makes a contact sheet
///
/// The sheet is a page with a picture and the figures of each result, and an animated 3-D view of the selected one. It
/// is a single file that opens from the disk. A picture of the sheet (.png) is written beside it.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn rank out
  cairn rank out --by kept_shape --by penetration_p95_rel:least -o sheet.html
  cairn rank out --by cpu_seconds:least --top 10

Figures are the measures and counts of the reports (examples/guide/measures.md), and seed, bodies and cpu_seconds.")]
pub struct Args {
    /// Folder of results (.glb, .usdc, .usda, .usdz) with reports, as written by `cairn batch`
    folder: PathBuf,

    /// Figure to sort by, largest first, or smallest first with :least; repeat it to break ties [default: the first
    /// available one of shape_iou, kept_shape and seed]
    #[arg(long, value_name = "FIGURE[:least]")]
    by: Vec<SortKey>,

    /// Figure to show with each picture, besides the sorting ones [default: penetration_p95_rel, bodies]
    #[arg(long, value_name = "FIGURE")]
    show: Vec<String>,

    /// Show only the first results, this many
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    top: Option<u64>,

    /// Page to write (.html); the picture is written beside it [default: contact-sheet.html in the folder]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Print only the ranking
    #[arg(long)]
    no_sheet: bool,

    /// Print the ranking as JSON: place, result, and all figures
    #[arg(long)]
    json: bool,

    /// Limit of the results embedded in the page for its 3-D view, first ones first
    #[arg(long, value_name = "MIB", default_value_t = 256)]
    embed_mib: usize,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    interrupt::listen();
    let page = args.output.clone().unwrap_or_else(|| args.folder.join("contact-sheet.html"));
    let picture = page.with_extension("png");
    if !args.no_sheet {
        output::check(&page, &[])?;
        output::check(&picture, &[])?;
    }
    let (mut candidates, left_out) = sheet::read(&args.folder).map_err(Failure::input)?;
    for problem in &left_out {
        print_warning(&format!("skipped: {problem}"));
    }
    if candidates.is_empty() {
        return Err(Failure::Input(left_out));
    }
    // Not every scene has the first ones.
    let usual =
        ["shape_iou", "kept_shape", "seed"].map(|figure| SortKey { figure: figure.into(), least: figure == "seed" });
    let is_known = |key: &SortKey| candidates.iter().any(|one| one.figures.contains_key(&key.figure));
    let keys = match &args.by[..] {
        [] => usual.into_iter().find(is_known).into_iter().collect(),
        keys => keys.to_vec(),
    };
    sheet::sort(&mut candidates, &keys).map_err(Failure::Usage)?;
    candidates.truncate(args.top.map_or(usize::MAX, |top| usize::try_from(top).unwrap_or(usize::MAX)));
    let shown = shown(args, &keys);
    if !args.no_sheet {
        write(args, candidates, &keys, &shown, &page, &picture)
    } else {
        print(&ranking(args, candidates.iter(), &shown))
    }
}

/// The figures to show: the sorting ones, and the requested ones.
fn shown(args: &Args, keys: &[SortKey]) -> Vec<String> {
    let usual = ["penetration_p95_rel", "bodies"].map(str::to_owned);
    let others = if args.show.is_empty() { &usual[..] } else { &args.show };
    let mut shown: Vec<String> = keys.iter().map(|key| key.figure.clone()).collect();
    for figure in others {
        if !shown.contains(figure) {
            shown.push(figure.clone());
        }
    }
    shown
}

fn write(
    args: &Args,
    candidates: Vec<Candidate>,
    keys: &[SortKey],
    shown: &[String],
    page: &Path,
    picture: &Path,
) -> Result<(), Failure> {
    let mut entries: Vec<(Candidate, Thumbnail)> = Vec::new();
    for candidate in candidates {
        if interrupt::is_requested() {
            return Err(Failure::Cancelled);
        }
        let thumbnail = sheet::thumbnail(&candidate, cairn_render::Settings::default().elevation)?;
        entries.push((candidate, thumbnail));
    }
    let title = args.folder.canonicalize().ok().and_then(|folder| folder.file_name().map(|name| name.to_owned()));
    let title = title.map_or("results".into(), |name| name.to_string_lossy().into_owned());
    let order =
        |key: &SortKey| format!("{}{}", key.figure.replace('_', " "), if key.least { ", smallest first" } else { "" });
    let order = keys.iter().map(order).collect::<Vec<_>>().join("; ");
    let internal = |error: &dyn std::fmt::Display| Failure::Internal(error.to_string());
    let line = format!("{} variants by {order}", entries.len());
    let drawn = sheet::sheet(&title, &line, &entries, shown).map_err(|error| internal(&error))?;
    let mut png = Cursor::new(Vec::new());
    drawn.write_to(&mut png, ImageFormat::Png).map_err(|error| internal(&error))?;
    let html = sheet::page(&title, &order, &entries, shown, args.embed_mib << 20).map_err(|error| internal(&error))?;
    {
        let _complete = interrupt::shield();
        output::write(picture, png.get_ref())?;
        output::write(page, html.as_bytes())?;
    }
    print(&ranking(args, entries.iter().map(|(candidate, _)| candidate), shown))?;
    print_note(&format!("wrote {} and {}", page.display(), picture.display()));
    Ok(())
}

fn ranking<'a>(args: &Args, candidates: impl Iterator<Item = &'a Candidate>, shown: &[String]) -> String {
    if args.json {
        let object = |(number, one): (usize, &Candidate)| {
            let place = number + 1;
            json!({ "place": place, "result": one.path, "figures": one.figures })
        };
        return format!("{:#}\n", candidates.enumerate().map(object).collect::<Value>());
    }
    let rows = candidates.enumerate().map(|(number, candidate)| {
        let figures = shown.iter().map(|figure| candidate.formatted(figure).unwrap_or_default());
        [(number + 1).to_string(), candidate.path.display().to_string()].into_iter().chain(figures).collect()
    });
    table([String::new(), "result".to_owned()].into_iter().chain(shown.iter().cloned()).collect(), rows)
}
