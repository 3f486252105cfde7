//! The study's plot: error over CPU time, a panel for each headline figure.

use super::figures::{Figure, HEADLINE};
use super::table::{self, MedianRange, StudyRow, front};
use super::{Study, VariantKind};
use cairn_files::write_atomically;
use image::{ImageFormat, RgbImage};
use libm::{log10, pow};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::io::Cursor;
use std::path::Path;
use std::sync::Once;

const SIZE: (u32, u32) = (1620, 680);
const FONT: &str = "Noto Sans";
const PRESET: RGBColor = RGBColor(0x1f, 0x5f, 0xa8);
const KNOB: RGBColor = RGBColor(0x8c, 0x8c, 0x8c);
const FRONT: RGBColor = RGBColor(0xd9, 0x6a, 0x1c);

type PlotError = Box<dyn std::error::Error>;

/// Writes `cost.svg` and `cost.png` into the folder.
pub fn draw(study: &Study, folder: &Path) -> Result<(), PlotError> {
    static FONTS: Once = Once::new();
    FONTS.call_once(|| {
        let _ = register_font(FONT, FontStyle::Normal, notosans::REGULAR_TTF);
    });
    let mut svg = String::new();
    sheet(study, &SVGBackend::with_string(&mut svg, SIZE).into_drawing_area())?;
    let mut picture = RgbImage::new(SIZE.0, SIZE.1);
    sheet(study, &BitMapBackend::with_buffer(&mut picture, SIZE).into_drawing_area())?;
    let mut png = Cursor::new(Vec::new());
    picture.write_to(&mut png, ImageFormat::Png)?;
    write_atomically(&folder.join("cost.svg"), svg.as_bytes())?;
    Ok(write_atomically(&folder.join("cost.png"), png.get_ref())?)
}

fn sheet<B: DrawingBackend>(study: &Study, area: &DrawingArea<B, Shift>) -> Result<(), PlotError>
where
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    let (head, body) = area.split_vertically(130);
    heading(study, &head)?;
    for (figure, panel) in HEADLINE.iter().zip(body.split_evenly((1, HEADLINE.len()))) {
        self::panel(study, figure, &panel)?;
    }
    area.present()?;
    Ok(())
}

fn heading<B: DrawingBackend>(study: &Study, area: &DrawingArea<B, Shift>) -> Result<(), PlotError>
where
    B::ErrorType: 'static,
{
    let seeds = match study.rows.iter().map(|row| row.seeds.len()).max().unwrap_or(0) {
        1 => "1 seed".to_owned(),
        n => format!("{n} seeds"),
    };
    let title = format!("What accuracy costs: {} ({seeds}, {})", study.scene, study.machine);
    area.draw(&Text::new(title, (20, 10), (FONT, 26).into_font()))?;
    // The first sentences give the recommendation; the tables have the details.
    let advice = study.advice().map_or(String::new(), |advice| advice.replace('`', ""));
    for (sentence, y) in advice.splitn(2, ". ").zip([42, 64]) {
        area.draw(&Text::new(sentence, (20, y), (FONT, 17).into_font()))?;
    }
    let font = || (FONT, 18).into_font();
    let mut x = 24;
    for (color, what) in
        [(PRESET, "preset"), (KNOB, "standard with one parameter changed"), (FRONT, "no cheaper one is more accurate")]
    {
        if color == FRONT {
            area.draw(&PathElement::new([(x - 8, 104), (x + 14, 104)], color.stroke_width(2)))?;
        } else {
            area.draw(&Circle::new((x + 3, 104), 5, color.filled()))?;
        }
        area.draw(&Text::new(what, (x + 22, 94), font()))?;
        x += 60 + 9 * what.len() as i32;
    }
    area.draw(&Text::new("bars: range over the seeds", (x, 94), font()))?;
    Ok(())
}

fn panel<B: DrawingBackend>(study: &Study, figure: &Figure, area: &DrawingArea<B, Shift>) -> Result<(), PlotError>
where
    B::ErrorType: 'static,
{
    let (rows, is_ranked) = (&study.rows[..], study.is_ranked(figure.name));
    let points: Vec<(&StudyRow, MedianRange)> =
        rows.iter().filter_map(|row| Some((row, *row.errors.get(figure.name)?))).collect();
    let bound = |f: &dyn Fn(&(&StudyRow, MedianRange)) -> f64, from: f64, of: fn(f64, f64) -> f64| {
        points.iter().map(f).fold(from, of)
    };
    let (left, right) = (bound(&|p| p.0.cost.low, f64::INFINITY, f64::min), bound(&|p| p.0.cost.high, 0.0, f64::max));
    if points.is_empty() || left <= 0.0 {
        area.draw(&Text::new(format!("{}: the scene has none", figure.name), (20, 12), (FONT, 17).into_font()))?;
        return Ok(());
    }
    // Both axes are logarithmic. An error of 0 is on a line of its own, below all others.
    let positive = |values: [f64; 2]| values.into_iter().filter(|&e| e > 0.0).fold(f64::INFINITY, f64::min);
    let least = points.iter().map(|p| positive([p.1.low, p.1.median])).fold(f64::INFINITY, f64::min);
    let top = 2.0 * bound(&|p| p.1.high, 0.0, f64::max).max(1e-6);
    let least = if least.is_finite() { least.max(top / 1e5) } else { top / 10.0 };
    let has_zero = points.iter().any(|p| p.1.low < least);
    let zero = least / 3.0;
    let floor = if has_zero { zero / 1.8 } else { least / 1.5 };
    let (x, y) = (log10(left / 1.25)..log10(right * 1.6), log10(floor)..log10(top));
    let height = |error: f64| if error < least { log10(zero) } else { log10(error) };
    let mut chart = ChartBuilder::on(area)
        .caption(figure.title, (FONT, 17).into_font())
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(72)
        .build_cartesian_2d(x.clone(), y)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc("CPU time, s")
        .x_labels(5)
        .y_labels(6)
        .x_label_formatter(&|x| two_digits(pow(10.0, *x)))
        .y_label_formatter(&|y| {
            if has_zero && *y < log10(least) - 0.05 { String::new() } else { two_digits(pow(10.0, *y)) }
        })
        .label_style((FONT, 15).into_font())
        .axis_desc_style((FONT, 16).into_font())
        .draw()?;
    if !is_ranked {
        area.draw(&Text::new("too few seeds to rank", (100, 44), (FONT, 16).into_font().color(&FRONT)))?;
    }
    if has_zero {
        let line = [(x.start, log10(zero)), (x.end, log10(zero))];
        chart.draw_series([PathElement::new(line, KNOB.mix(0.5))])?;
        let label = EmptyElement::at(line[1]) + Text::new("0", (-14, -18), (FONT, 15).into_font().color(&KNOB));
        chart.draw_series([label])?;
    }
    let best: Vec<(f64, f64)> = front(rows, figure.name)
        .into_iter()
        .map(|i| (log10(rows[i].cost.median), height(rows[i].errors[figure.name].median)))
        .collect();
    // Where seeds differ as much as presets do, there is no front.
    let best = if is_ranked { best } else { Vec::new() };
    let stairs = best.iter().zip(best.iter().skip(1)).flat_map(|(&a, &b)| [(b.0, a.1), b]);
    chart.draw_series(LineSeries::new(best.first().copied().into_iter().chain(stairs), FRONT.stroke_width(2)))?;
    let at = |row: &StudyRow, error: &MedianRange| (log10(row.cost.median), height(error.median));
    // Draw presets on top.
    let is_preset = |(row, _): &&(&StudyRow, MedianRange)| row.kind == VariantKind::Preset;
    let (presets, knobs): (Vec<_>, Vec<_>) = points.iter().partition(is_preset);
    for (row, error) in knobs.iter().chain(&presets) {
        let (color, size) = if row.kind == VariantKind::Preset { (PRESET, 6) } else { (KNOB, 3) };
        let at = at(row, error);
        if row.kind == VariantKind::Preset {
            let upright = PathElement::new([(at.0, height(error.low)), (at.0, height(error.high))], color.mix(0.6));
            let across = PathElement::new([(log10(row.cost.low), at.1), (log10(row.cost.high), at.1)], color.mix(0.6));
            chart.draw_series([upright, across])?;
        }
        chart.draw_series([Circle::new(at, size, color.filled())])?;
    }
    let pixel = |(row, error): &(&StudyRow, MedianRange)| chart.backend_coord(&at(row, error));
    let taken: Vec<(i32, i32)> = presets.iter().chain(&knobs).map(pixel).collect();
    let named: Vec<(&str, (i32, i32))> =
        presets.iter().map(|(row, _)| &*row.variant).zip(taken.iter().copied()).collect();
    for ((row, error), place) in
        presets.iter().zip(label_places(&named, &taken, chart.plotting_area().get_pixel_range().0.start))
    {
        let text = Text::new(row.variant.clone(), place, (FONT, 16).into_font().color(&PRESET));
        chart.draw_series([EmptyElement::at(at(row, error)) + text])?;
    }
    Ok(())
}

fn two_digits(value: f64) -> String {
    if value < 1e-3 { format!("{value:.0e}") } else { table::short(value) }
}

/// The offset of each name from its point, in pixels: near the point, and hiding neither names nor points.
fn label_places(named: &[(&str, (i32, i32))], points: &[(i32, i32)], left: i32) -> Vec<(i32, i32)> {
    /// Approximate size of a letter, pixels.
    const LETTER: (i32, i32) = (9, 17);
    /// Vertical offsets, nearest first.
    const ROWS: [i32; 6] = [-27, 10, -45, 28, -63, 46];
    let mut boxes: Vec<[i32; 4]> = Vec::new();
    let mut places = Vec::new();
    for &(name, (x, y)) in named {
        let wide = LETTER.0 * name.len() as i32;
        let sides = [12, -wide - 12, -wide / 2];
        let candidates = ROWS.into_iter().flat_map(|dy| sides.into_iter().map(move |dx| (dx, dy)));
        let price = |&(dx, dy): &(i32, i32)| {
            let place = [x + dx, y + dy, x + dx + wide, y + dy + LETTER.1];
            let covers = |b: &&[i32; 4]| place[0] < b[2] && b[0] < place[2] && place[1] < b[3] && b[1] < place[3];
            let hides = |p: &&(i32, i32)| {
                (place[0] - 6..place[2] + 6).contains(&p.0) && (place[1] - 6..place[3] + 6).contains(&p.1)
            };
            let outside = i32::from(place[0] < left);
            let hidden = points.iter().filter(hides).count() as i32;
            1000 * boxes.iter().filter(covers).count() as i32 + 1000 * outside + 100 * hidden + dy.abs()
        };
        let best = candidates.min_by_key(price).expect("there are candidates");
        boxes.push([x + best.0, y + best.1, x + best.0 + wide, y + best.1 + LETTER.1]);
        places.push(best);
    }
    places
}
