//! Error over CPU time, one plot for each problem.

use crate::problem::Problem;
use crate::problem::page::short;
use crate::problem::results::{Kind, Measured, Row};
use image::RgbImage;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::path::Path;

const SIZE: (u32, u32) = (1000, 560);
const FONT: &str = "Noto Sans";
const PRESET: RGBColor = RGBColor(0x1f, 0x5f, 0xa8);
const CONTROL: RGBColor = RGBColor(0x5f, 0xb0, 0xe8);
const PARAMETER: RGBColor = RGBColor(0xa8, 0xb4, 0xc4);
/// Where the names of the presets stand beside their points, so that neighbours do not hide each other.
const NAMES: [(i32, i32); 5] = [(-12, -25), (-68, -8), (12, -8), (-12, 9), (-12, -25)];
const PEERS: [(&str, RGBColor); 6] = [
    ("rapier", RGBColor(0xd9, 0x6a, 0x1c)),
    ("Box3D", RGBColor(0x2e, 0x8b, 0x57)),
    ("Jolt", RGBColor(0xb0, 0x30, 0x60)),
    ("Bullet", RGBColor(0x70, 0x70, 0x70)),
    ("MuJoCo", RGBColor(0x7a, 0x4f, 0xb5)),
    ("Blender", RGBColor(0xc9, 0xa2, 0x27)),
];

/// Writes `plots/NAME.svg` into the folder, and `NAME.png` into the other one.
pub fn draw(problem: &Problem, measured: &Measured, folder: &Path, pictures: Option<&Path>) -> anyhow::Result<()> {
    let _ = register_font(FONT, FontStyle::Normal, notosans::REGULAR_TTF);
    std::fs::create_dir_all(folder.join("plots"))?;
    let path = folder.join("plots").join(format!("{}.svg", problem.name));
    sheet(problem, measured, &SVGBackend::new(&path, SIZE).into_drawing_area())?;
    if let Some(pictures) = pictures {
        let mut picture = RgbImage::new(SIZE.0, SIZE.1);
        sheet(problem, measured, &BitMapBackend::with_buffer(&mut picture, SIZE).into_drawing_area())?;
        picture.save(pictures.join(format!("{}.png", problem.name)))?;
    }
    Ok(())
}

fn sheet<B: DrawingBackend>(problem: &Problem, measured: &Measured, area: &DrawingArea<B, Shift>) -> anyhow::Result<()>
where
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    // What was stopped has no error.
    let point = |row: &Row| Some((row.cost(), Measured::error(row, problem)?));
    let points: Vec<(f64, f64)> = measured.rows.iter().filter_map(point).collect();
    let bounds = |of: fn(&(f64, f64)) -> f64| {
        let values = points.iter().map(of);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(0.0, f64::max))
    };
    let (x, y) = (bounds(|p| p.0), bounds(|p| p.1));
    let (chart_area, legend) = area.split_horizontally(SIZE.0 as i32 - 180);
    let mut chart = ChartBuilder::on(&chart_area)
        .caption(problem.title, (FONT, 20))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(76)
        .build_cartesian_2d((x.0 / 1.4..x.1 * 1.6).log_scale(), (y.0 / 1.6..y.1.max(4.0 * y.0) * 1.8).log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc("CPU time, ms for each simulated second")
        .y_desc(format!("error, {}", problem.unit))
        .x_label_formatter(&|x| short(*x))
        .y_label_formatter(&|y| short(*y))
        .label_style((FONT, 14))
        .draw()?;
    // Below one line, nobody sees the error; below the other, it is rounding.
    for (level, name) in [(problem.seen, "seen above"), (problem.least, "rounding")] {
        if level > y.0 / 1.5 && level < y.1 * 1.7 {
            let style = BLACK.mix(0.35).stroke_width(1);
            chart.draw_series(DashedLineSeries::new([(x.0 / 1.4, level), (x.1 * 1.6, level)], 4, 4, style))?;
            let text = Text::new(name, (0, -16), (FONT, 13).into_font().color(&BLACK.mix(0.5)));
            chart.draw_series([EmptyElement::at((x.0 / 1.35, level)) + text])?;
        }
    }
    let series: Vec<(f64, f64)> = measured.of_kind(Kind::Parameter).filter_map(point).collect();
    chart.draw_series(series.iter().map(|&at| Circle::new(at, 3, PARAMETER.filled())))?;
    for (name, color) in PEERS {
        let points = measured.of_kind(Kind::Peer).filter(|row| row.engine == name).filter_map(point);
        let points: Vec<(f64, f64)> = points.collect();
        chart.draw_series(LineSeries::new(points.clone(), color.mix(0.6)))?;
        chart.draw_series(points.into_iter().map(|at| TriangleMarker::new(at, 6, color.filled())))?;
    }
    let held = measured.of_kind(Kind::Control).filter_map(point);
    chart.draw_series(held.map(|at| Circle::new(at, 6, CONTROL.stroke_width(2))))?;
    let presets = || measured.of_kind(Kind::Preset).filter_map(|row| Some((row, point(row)?)));
    chart.draw_series(LineSeries::new(presets().map(|(_, at)| at), PRESET.stroke_width(2)))?;
    chart.draw_series(presets().map(|(_, at)| Circle::new(at, 6, PRESET.filled())))?;
    for ((row, at), offset) in presets().zip(NAMES) {
        let text = Text::new(row.settings.clone(), offset, (FONT, 15).into_font().color(&PRESET));
        chart.draw_series([EmptyElement::at(at) + text])?;
    }
    self::legend(measured, &legend)
}

fn legend<B: DrawingBackend>(measured: &Measured, area: &DrawingArea<B, Shift>) -> anyhow::Result<()>
where
    B::ErrorType: 'static,
{
    let mut own = vec![(PRESET, "Cairn's presets"), (PARAMETER, "standard, one changed")];
    if measured.of_kind(Kind::Control).next().is_some() {
        own.push((CONTROL, "standard, controlled"));
    }
    let count = own.len();
    let is_there = |name: &str| measured.rows.iter().any(|row| row.engine == name);
    let peers = PEERS.into_iter().filter(|(name, _)| is_there(name)).map(|(name, color)| (color, name));
    for (line, (color, name)) in own.into_iter().chain(peers).enumerate() {
        let y = 70 + 26 * line as i32;
        if line < count {
            area.draw(&Circle::new((8, y + 8), 5, color.filled()))?;
        } else {
            area.draw(&TriangleMarker::new((8, y + 9), 6, color.filled()))?;
        }
        area.draw(&Text::new(name, (22, y), (FONT, 15).into_font()))?;
    }
    Ok(())
}
