//! The study's plot: error over CPU time, a panel for each figure.

use super::table::{self, Row, Spread, front};
use super::{ACCURACY, Kind, SHAPE, Study};
use crate::files::write_atomically;
use image::{ImageFormat, RgbImage};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::io::Cursor;
use std::ops::Range;
use std::path::Path;
use std::sync::Once;

const SIZE: (u32, u32) = (1500, 1360);
const COLUMNS: usize = 3;
const FONT: &str = "Noto Sans";
const PRESET: RGBColor = RGBColor(0x1f, 0x5f, 0xa8);
const KNOB: RGBColor = RGBColor(0x8c, 0x8c, 0x8c);
const FRONT: RGBColor = RGBColor(0xd9, 0x6a, 0x1c);

type Fault = Box<dyn std::error::Error>;

/// Writes `cost.svg` and `cost.png` into the folder.
pub fn draw(study: &Study, folder: &Path) -> Result<(), Fault> {
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

fn sheet<B: DrawingBackend>(study: &Study, area: &DrawingArea<B, Shift>) -> Result<(), Fault>
where
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    let (head, body) = area.split_vertically(90);
    heading(study, &head)?;
    let names: Vec<(&str, bool)> = ACCURACY.map(|n| (n, false)).into_iter().chain(SHAPE.map(|n| (n, true))).collect();
    let panels = body.split_evenly((names.len().div_ceil(COLUMNS), COLUMNS));
    for (&(name, is_shape), panel) in names.iter().zip(&panels) {
        let title = if is_shape { format!("{name}: distance from {}", study.reference) } else { name.to_owned() };
        self::panel(&study.rows, name, &title, panel)?;
    }
    area.present()?;
    Ok(())
}

fn heading<B: DrawingBackend>(study: &Study, area: &DrawingArea<B, Shift>) -> Result<(), Fault>
where
    B::ErrorType: 'static,
{
    let seeds = study.rows.iter().map(|row| row.seeds.len()).max().unwrap_or(0);
    let title = format!("What accuracy costs: {} ({seeds} seeds, {})", study.scene, study.machine);
    area.draw(&Text::new(title, (20, 12), (FONT, 26).into_font()))?;
    let font = || (FONT, 18).into_font();
    let mut x = 24;
    for (color, what) in
        [(PRESET, "preset"), (KNOB, "standard with one parameter changed"), (FRONT, "nothing cheaper is more accurate")]
    {
        if color == FRONT {
            area.draw(&PathElement::new([(x - 8, 63), (x + 14, 63)], color.stroke_width(2)))?;
        } else {
            area.draw(&Circle::new((x + 3, 63), 5, color.filled()))?;
        }
        area.draw(&Text::new(what, (x + 22, 53), font()))?;
        x += 60 + 9 * what.len() as i32;
    }
    area.draw(&Text::new("bars: range over the seeds", (x, 53), font()))?;
    Ok(())
}

fn panel<B: DrawingBackend>(rows: &[Row], name: &str, title: &str, area: &DrawingArea<B, Shift>) -> Result<(), Fault>
where
    B::ErrorType: 'static,
{
    let points: Vec<(&Row, Spread)> = rows.iter().filter_map(|row| Some((row, *row.errors.get(name)?))).collect();
    let bound =
        |f: &dyn Fn(&(&Row, Spread)) -> f64, from: f64, of: fn(f64, f64) -> f64| points.iter().map(f).fold(from, of);
    let (left, right) = (bound(&|p| p.0.cost.low, f64::INFINITY, f64::min), bound(&|p| p.0.cost.high, 0.0, f64::max));
    if points.is_empty() || left <= 0.0 {
        return Ok(());
    }
    // Both axes are of decades; an error of 0 stands at the lower edge.
    let least = points.iter().map(|p| p.1.median).filter(|&e| e > 0.0).fold(f64::INFINITY, f64::min);
    let top = 2.0 * bound(&|p| p.1.high, 0.0, f64::max).max(1e-6);
    let floor = if least.is_finite() { (least / 2.0).max(top / 1e4) } else { top / 10.0 };
    let (x, y) = ((left / 1.25).log10()..(right * 1.6).log10(), floor.log10()..top.log10());
    let height = |error: f64| error.max(floor).log10();
    let mut chart = ChartBuilder::on(area)
        .caption(title, (FONT, 20).into_font())
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(72)
        .build_cartesian_2d(x.clone(), y.clone())?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc("CPU time, s")
        .x_labels(5)
        .y_labels(5)
        .x_label_formatter(&|x| two_digits(10f64.powf(*x)))
        .y_label_formatter(&|y| two_digits(10f64.powf(*y)))
        .label_style((FONT, 15).into_font())
        .axis_desc_style((FONT, 16).into_font())
        .draw()?;
    let best: Vec<(f64, f64)> = front(rows, name)
        .into_iter()
        .map(|i| (rows[i].cost.median.log10(), height(rows[i].errors[name].median)))
        .collect();
    let stairs = best.iter().zip(best.iter().skip(1)).flat_map(|(&a, &b)| [(b.0, a.1), b]);
    chart.draw_series(LineSeries::new(best.first().copied().into_iter().chain(stairs), FRONT.stroke_width(2)))?;
    for (row, error) in &points {
        let (color, size) = if row.kind == Kind::Preset { (PRESET, 5) } else { (KNOB, 3) };
        let at = (row.cost.median.log10(), height(error.median));
        let upright = PathElement::new([(at.0, height(error.low)), (at.0, height(error.high))], color.mix(0.6));
        let across = PathElement::new([(row.cost.low.log10(), at.1), (row.cost.high.log10(), at.1)], color.mix(0.6));
        chart.draw_series([upright, across])?;
        chart.draw_series([Circle::new(at, size, color.filled())])?;
    }
    let presets = points.iter().filter(|(row, _)| row.kind == Kind::Preset);
    let named: Vec<(&str, (f64, f64))> =
        presets.map(|(row, e)| (&*row.variant, (row.cost.median.log10(), height(e.median)))).collect();
    for (&(name, at), place) in named.iter().zip(label_places(&named, &x, &y)) {
        let label = EmptyElement::at(at) + Text::new(name.to_owned(), place, (FONT, 15).into_font().color(&PRESET));
        chart.draw_series([label])?;
    }
    Ok(())
}

fn two_digits(value: f64) -> String {
    if value < 1e-3 { format!("{value:.0e}") } else { table::short(value) }
}

/// Where each preset's name stands, in pixels from its point: above it, or below where a name is already there.
fn label_places(named: &[(&str, (f64, f64))], x: &Range<f64>, y: &Range<f64>) -> Vec<(i32, i32)> {
    /// Of a panel, about; pixels.
    const PANEL: (f64, f64) = (380.0, 290.0);
    let pixel =
        |at: (f64, f64)| (PANEL.0 * (at.0 - x.start) / (x.end - x.start), PANEL.1 * (y.end - at.1) / (y.end - y.start));
    let mut taken: Vec<(f64, f64)> = Vec::new();
    let mut places = Vec::new();
    for &(_, at) in named {
        let (px, py) = pixel(at);
        let free = |dy: &f64| taken.iter().all(|&(a, b)| (a - px).abs() > 75.0 || (b - (py + dy)).abs() > 16.0);
        let dy = [-20.0, 6.0, -38.0, 24.0, -56.0, 42.0].into_iter().find(free).unwrap_or(-20.0);
        taken.push((px, py + dy));
        places.push((7, dy as i32));
    }
    places
}
