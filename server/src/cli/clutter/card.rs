//! The data card of a folder of layouts, and its contact sheet.

use super::Args;
use super::lines_file::{LinesFile, Spent};
use crate::cli::Failure;
use crate::sheet::{self, Candidate};
use cairn_clutter::line::name_of;
use cairn_clutter::{Library, Line};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Result};
use std::path::Path;

/// What is counted over a file of lines.
#[derive(Default)]
pub struct Counts {
    pub layouts: u64,
    pub bodies: u64,
    /// Numbers of layouts that were not made, and why.
    pub failed: Vec<(u64, String)>,
    rejected: BTreeMap<String, u64>,
    taken_away: BTreeMap<String, u64>,
    places: BTreeMap<String, u64>,
    labels: BTreeMap<String, u64>,
    arrangements: BTreeMap<String, u64>,
    poses: BTreeMap<String, u64>,
    sizes: BTreeMap<usize, u64>,
    drifts: Vec<f64>,
    drifts_mujoco: Vec<f64>,
    overlaps: Vec<f64>,
    overlaps_in_view: Vec<f64>,
    targets_in_view: Vec<f64>,
    may_leave: u64,
}

impl Counts {
    pub fn read(path: &Path) -> Result<Counts> {
        let mut counts = Counts::default();
        for text in BufReader::new(File::open(path)?).lines() {
            if let Ok(line) = serde_json::from_str::<Line>(&text?) {
                counts.add(line);
            }
        }
        Ok(counts)
    }

    fn add(&mut self, line: Line) {
        for (why, count) in &line.rejected {
            *self.rejected.entry(name_of(*why)).or_default() += u64::from(*count);
        }
        if let Some(why) = line.failed {
            self.failed.push((line.layout, why));
            return;
        }
        for (why, count) in &line.taken_away {
            *self.taken_away.entry(name_of(*why)).or_default() += u64::from(*count);
        }
        let name = |value: &dyn std::fmt::Debug| format!("{value:?}").to_lowercase();
        self.layouts += 1;
        self.bodies += line.bodies.len() as u64;
        *self.places.entry(line.place).or_default() += 1;
        *self.arrangements.entry(name(&line.arrangement)).or_default() += 1;
        *self.poses.entry(name(&line.pose)).or_default() += 1;
        *self.sizes.entry(line.bodies.len()).or_default() += 1;
        for body in line.bodies {
            *self.labels.entry(body.label).or_default() += 1;
            self.may_leave += u64::from(body.may_leave == Some(true));
        }
        self.drifts.extend(line.proof.drift);
        self.drifts_mujoco.extend(line.proof.drift_mujoco);
        self.overlaps.push(line.proof.overlap);
        if let Some(view) = line.view {
            self.overlaps_in_view.push(view.overlap);
            self.targets_in_view.extend(view.target);
        }
    }

    /// What the command prints.
    pub fn summary(&self, folder: &Path, before: u64) -> String {
        let again: u64 = self.rejected.values().sum();
        let mut text = format!("{}: {} layouts, {} bodies", folder.display(), self.layouts, self.bodies);
        let (away, failed) = (self.taken_away.values().sum(), self.failed.len() as u64);
        for (count, what) in
            [(before, "finished before"), (again, "drawn again"), (away, "bodies taken away"), (failed, "failed")]
        {
            if count > 0 {
                text += &format!(", {count} {what}");
            }
        }
        text + "\n"
    }
}

/// The value below which this share of all is.
fn share_below(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(at.saturating_sub(1)).copied().unwrap_or(0.0)
}

/// Writes `README.md` and the contact sheet.
pub fn write(
    args: &Args,
    library: &Library,
    lines: &Path,
    file: &LinesFile,
    counts: &Counts,
) -> std::result::Result<(), Failure> {
    let text = card(args, library, lines, file, counts);
    let path = args.output.join("README.md");
    cairn_files::write_atomically(&path, text.as_bytes()).map_err(|error| Failure::write(&path, &error))?;
    if args.sheet > 0 && counts.layouts > 0 { contact_sheet(args, library, lines, counts) } else { Ok(()) }
}

/// Pictures are taken from so many degrees above the horizon, to look into bins.
const ELEVATION: f64 = 62.0;

/// A picture of some of the layouts, evenly from all.
fn contact_sheet(args: &Args, library: &Library, lines: &Path, counts: &Counts) -> std::result::Result<(), Failure> {
    let wanted = args.sheet.min(counts.layouts);
    let path = args.output.join("layouts.jpg");
    let fault = |error: &dyn std::fmt::Display| Failure::Internal(format!("the contact sheet: {error}"));
    let file = File::open(lines).map_err(|error| Failure::write(lines, &error))?;
    let (mut entries, mut seen) = (Vec::new(), 0);
    for text in BufReader::new(file).lines().map_while(Result::ok) {
        let Ok(line) = serde_json::from_str::<Line>(&text) else { continue };
        if line.failed.is_some() {
            continue;
        }
        seen += 1;
        // The last of each of as many parts as are wanted.
        if seen * wanted / counts.layouts == (seen - 1) * wanted / counts.layouts {
            continue;
        }
        let millimeters = |drift: Option<f64>| drift.map(|drift| 1e3 * drift);
        let figures = [
            ("bodies", Some(line.bodies.len() as f64)),
            ("drift_mm", millimeters(line.proof.drift_mujoco.or(line.proof.drift))),
        ];
        let candidate = Candidate {
            name: format!("{} {}", line.layout, line.place),
            path: lines.to_owned(),
            bytes: cairn_clutter::model(library, &line)?,
            figures: figures.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect(),
        };
        let thumbnail = sheet::thumbnail(&candidate, ELEVATION).map_err(|error| fault(&error))?;
        entries.push((candidate, thumbnail));
    }
    let title = args.catalogue.file_stem().map_or(String::new(), |name| name.to_string_lossy().into_owned());
    let about = format!("{} of {} layouts", entries.len(), counts.layouts);
    let shown = ["bodies", "drift_mm"].map(str::to_owned);
    let picture = sheet::sheet(&title, &about, &entries, &shown).map_err(|error| fault(&error))?;
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Jpeg).map_err(|error| fault(&error))?;
    cairn_files::write_atomically(&path, bytes.get_ref()).map_err(|error| Failure::write(&path, &error))
}

fn table(title: &str, counts: &BTreeMap<String, u64>) -> String {
    let rows: String = counts.iter().map(|(name, count)| format!("| {name} | {count} |\n")).collect();
    format!("| {title} | count |\n| --- | --- |\n{rows}\n")
}

fn card(args: &Args, library: &Library, lines: &Path, file: &LinesFile, counts: &Counts) -> String {
    let name = lines.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
    let mut text = format!(
        "# Layouts\n\n`{name}`: {} layouts with {} bodies, made by Cairn {}; {}. `assets.json` has the props and the \
         places. SI units; Y is up; quaternions are x, y, z, w.\n\n",
        counts.layouts,
        counts.bodies,
        cairn_files::version::VERSION,
        args.conditions()
    );
    if args.sheet > 0 {
        text += "![Some of the layouts](layouts.jpg)\n\n";
    }
    text += &table("place", &counts.places);
    text += &table("prop", &counts.labels);
    text += &table("arrangement", &counts.arrangements);
    text += &table("pose at the beginning", &counts.poses);
    let sizes = counts.sizes.iter().map(|(size, count)| (format!("{size:3}"), *count)).collect();
    text += &table("bodies of a layout", &sizes);
    text += &table("drawn again because of", &counts.rejected);
    text += &table("bodies taken away because of", &counts.taken_away);
    text += "| figure, mm | median | 99 of 100 | most |\n| --- | --- | --- | --- |\n";
    for (name, values) in [
        ("drift in 2 s of our trial", &counts.drifts),
        ("drift in 2 s of MuJoCo", &counts.drifts_mujoco),
        ("deepest overlap", &counts.overlaps),
    ] {
        if !values.is_empty() {
            let [median, most, all] = [0.5, 0.99, 1.0].map(|share| 1e3 * share_below(values, share));
            text += &format!("| {name} | {median:.3} | {most:.3} | {all:.3} |\n");
        }
    }
    if !counts.overlaps_in_view.is_empty() {
        text += "\n| as the camera sees it, % | least | median | most |\n| --- | --- | --- | --- |\n";
        for (name, values) in [
            ("mean share of a body that others hide", &counts.overlaps_in_view),
            ("share of the target that is seen", &counts.targets_in_view),
        ] {
            if !values.is_empty() {
                let [least, median, most] = [0.0, 0.5, 1.0].map(|share| 100.0 * share_below(values, share));
                text += &format!("| {name} | {least:.1} | {median:.1} | {most:.1} |\n");
            }
        }
    }
    let share = counts.may_leave as f64 / counts.bodies.max(1) as f64;
    text += &format!("\nOf the bodies, {:.0} % are proven to be safe to remove.\n", 100.0 * share);
    let Spent { seconds, made, memory, new_shapes } = file.spent;
    if made > 0 {
        let mean = seconds / made as f64;
        text += &format!("\nOf those made last, a layout took {mean:.3} CPU s in the mean");
        text += &memory.map_or(String::new(), |bytes| format!(", and a process {} MB", bytes / 1_000_000));
        text += &format!(". Collision shapes that were new: {new_shapes} of {}.\n", library.shapes.len());
    }
    text += "\n## Licenses\n\n| model | license |\n| --- | --- |\n";
    let props = library.catalogue.props.iter().map(|prop| (&prop.path, &prop.license));
    for (path, license) in props.chain(library.catalogue.places.iter().map(|place| (&place.path, &place.license))) {
        text += &format!("| {path} | {} |\n", license.as_deref().unwrap_or("not stated"));
    }
    for (number, why) in &counts.failed {
        text += &format!("\nLayout {number} failed: {why}.\n");
    }
    text
}
