//! `cairn rank`: the results of a batch in order, and a contact sheet of them.

use super::{Failure, interrupt, output, print, tell};
use crate::sheet::{self, Candidate, Key, Shot};
use anstyle::AnsiColor;
use comfy_table::{CellAlignment, Table, presets};
use image::ImageFormat;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Order the results of a batch by their figures, and make a contact sheet of them
///
/// The sheet is a page with a picture of each result, its figures and a 3-D view of the chosen one that plays; it opens from the disk and
/// needs nothing beside it. Beside it, the same is written as a picture (.png).
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cairn rank out
  cairn rank out --by kept_shape --by penetration_p95_rel:least -o sheet.html
  cairn rank out --by cpu_seconds:least --top 10

Figures are those of the reports (examples/guide/measures.md), and seed, bodies and cpu_seconds.")]
pub struct Args {
    /// Folder of results (.glb) with their reports, as `cairn batch` fills it
    folder: PathBuf,

    /// Figure to order by, the largest first, or with :least the smallest; where it is equal, by the next one [default: kept_shape, or
    /// what there is of shape_iou and seed]
    #[arg(long, value_name = "FIGURE[:least]")]
    by: Vec<Key>,

    /// Figure to show with each picture, beside those that order [default: penetration_p95_rel, bodies]
    #[arg(long, value_name = "FIGURE")]
    show: Vec<String>,

    /// Only so many, the first ones
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u64).range(1..))]
    top: Option<u64>,

    /// Page to write: .html; the picture is beside it [default: contact-sheet.html in the folder]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,

    /// Only print the order
    #[arg(long)]
    no_sheet: bool,

    /// Most of the results that the page holds, for its 3-D view, the first ones first
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
    let (mut candidates, left_out) = sheet::read(&args.folder).map_err(|problem| Failure::Input(vec![problem]))?;
    for problem in &left_out {
        tell("warning", AnsiColor::Yellow, &format!("left out: {problem}"));
    }
    if candidates.is_empty() {
        return Err(Failure::Input(left_out));
    }
    // Not every scene has the first of them.
    let usual =
        ["kept_shape", "shape_iou", "seed"].map(|figure| Key { figure: figure.into(), least: figure == "seed" });
    let is_known = |key: &Key| candidates.iter().any(|one| one.figures.contains_key(&key.figure));
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
        print(&table(candidates.iter(), &shown))
    }
}

/// The figures to show: those that order, and those asked for.
fn shown(args: &Args, keys: &[Key]) -> Vec<String> {
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
    keys: &[Key],
    shown: &[String],
    page: &Path,
    picture: &Path,
) -> Result<(), Failure> {
    let mut entries: Vec<(Candidate, Shot)> = Vec::new();
    for candidate in candidates {
        if interrupt::asked() {
            return Err(Failure::Cancelled);
        }
        let shot = sheet::shot(&candidate)?;
        entries.push((candidate, shot));
    }
    let title = args.folder.canonicalize().ok().and_then(|folder| folder.file_name().map(|name| name.to_owned()));
    let title = title.map_or("results".into(), |name| name.to_string_lossy().into_owned());
    let order = |key: &Key| format!("{}{}", key.figure.replace('_', " "), if key.least { ", least first" } else { "" });
    let order = keys.iter().map(order).collect::<Vec<_>>().join("; ");
    let internal = |error: &dyn std::fmt::Display| Failure::Internal(error.to_string());
    let drawn = sheet::sheet(&title, &order, &entries, shown).map_err(|error| internal(&error))?;
    let mut png = Cursor::new(Vec::new());
    drawn.write_to(&mut png, ImageFormat::Png).map_err(|error| internal(&error))?;
    let html = sheet::page(&title, &order, &entries, shown, args.embed_mib << 20).map_err(|error| internal(&error))?;
    {
        let _complete = interrupt::shield();
        output::write(picture, png.get_ref())?;
        output::write(page, html.as_bytes())?;
    }
    print(&table(entries.iter().map(|(candidate, _)| candidate), shown))?;
    tell("note", AnsiColor::Cyan, &format!("{} and {}", page.display(), picture.display()));
    Ok(())
}

fn table<'a>(candidates: impl Iterator<Item = &'a Candidate>, shown: &[String]) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header(["".to_owned(), "result".to_owned()].into_iter().chain(shown.iter().cloned()));
    for column in table.column_iter_mut().skip(2) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    for (number, candidate) in candidates.enumerate() {
        let figures = shown.iter().map(|figure| candidate.told(figure).unwrap_or_default());
        table.add_row([(number + 1).to_string(), candidate.path.display().to_string()].into_iter().chain(figures));
    }
    table.lines().map(|line| line.trim().to_owned() + "\n").collect()
}
