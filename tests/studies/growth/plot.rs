//! Time and memory per body over bodies.

use crate::row::Row;
use crate::scenes::Kind;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use std::path::Path;

const SIZE: (u32, u32) = (1120, 460);
const FONT: &str = "Noto Sans";
const COLORS: [RGBColor; 3] = [RGBColor(0x1f, 0x5f, 0xa8), RGBColor(0xd9, 0xa0, 0x1c), RGBColor(0x70, 0x70, 0x70)];

pub fn draw(rows: &[Row], path: &Path) -> anyhow::Result<()> {
    let _ = register_font(FONT, FontStyle::Normal, notosans::REGULAR_TTF);
    let area = SVGBackend::new(path, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let panels = area.split_evenly((1, 2));
    panel(rows, "CPU ms per body", &Row::time_per_body, &panels[0])?;
    panel(rows, "KiB of memory per body, at the peak", &Row::memory_per_body, &panels[1])?;
    Ok(area.present()?)
}

fn panel(
    rows: &[Row],
    title: &str,
    of: &dyn Fn(&Row) -> f64,
    area: &DrawingArea<SVGBackend, Shift>,
) -> anyhow::Result<()> {
    let Some(first) = rows.first() else { return Ok(()) };
    let (mut x, mut y) = ((first.bodies as f64, first.bodies as f64), (of(first), of(first)));
    for row in rows {
        x = (x.0.min(row.bodies as f64), x.1.max(row.bodies as f64));
        y = (y.0.min(of(row)), y.1.max(of(row)));
    }
    let mut chart = ChartBuilder::on(area)
        .caption(title, (FONT, 18))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d((x.0 / 1.3..x.1 * 1.3).log_scale(), (y.0 / 1.5..y.1 * 1.5).log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc("bodies")
        .x_labels(4)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| if *y < 10.0 { format!("{y:.1}") } else { format!("{y:.0}") })
        .label_style((FONT, 14))
        .draw()?;
    for (kind, color) in Kind::ALL.into_iter().zip(COLORS) {
        let points: Vec<(f64, f64)> =
            rows.iter().filter(|row| row.kind == kind).map(|row| (row.bodies as f64, of(row))).collect();
        chart.draw_series(points.iter().map(|&point| Circle::new(point, 5, color.filled())))?;
        chart
            .draw_series(LineSeries::new(points, color.stroke_width(2)))?
            .label(kind.name())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
    }
    chart.configure_series_labels().position(SeriesLabelPosition::LowerLeft).label_font((FONT, 15)).draw()?;
    Ok(())
}
