//! The contact sheet as one picture.

use super::Candidate;
use cairn_render::{RenderError, RenderModel, Settings, render};
use image::RgbImage;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use std::sync::Once;

/// Size of a result's picture, pixels.
const SIZE: [u32; 2] = [320, 240];
/// Rays per pixel. Few suffice, since a small picture hides the grain.
const SAMPLES: u32 = 8;
/// Space between and around pictures, pixels.
const GAP: u32 = 16;
const LINE: u32 = 20;
const HEAD: u32 = 64;
const FONT: &str = "Noto Sans";
const PAPER: RGBColor = RGBColor(0xf6, 0xf3, 0xee);
const INK: RGBColor = RGBColor(0x26, 0x23, 0x1f);
const SOFT: RGBColor = RGBColor(0x7a, 0x73, 0x6a);
const MARK: RGBColor = RGBColor(0xc2, 0x57, 0x1a);

/// A small picture of a result.
pub type Thumbnail = RgbImage;

/// Renders the last frame, seen from this many degrees above the horizon.
pub fn thumbnail(candidate: &Candidate, elevation: f64) -> Result<Thumbnail, RenderError> {
    let name = candidate.path.display().to_string();
    let model =
        RenderModel { name: &name, bytes: &candidate.bytes, resolve: &|_| Err("a result names no other file".into()) };
    render(&model, None, &Settings { size: SIZE, samples: SAMPLES, elevation, ..Settings::default() })
}

/// All pictures with rank, name and the figures `shown`. `order`: a line about them.
pub fn sheet(
    title: &str,
    order: &str,
    entries: &[(Candidate, Thumbnail)],
    shown: &[String],
) -> Result<RgbImage, Box<dyn std::error::Error>> {
    static FONTS: Once = Once::new();
    FONTS.call_once(|| {
        let _ = register_font(FONT, FontStyle::Normal, notosans::REGULAR_TTF);
    });
    let count = entries.len() as u32;
    // The sheet is about 1.5 times as wide as it is high.
    let columns = (f64::from(count) * 1.5).sqrt().ceil().clamp(1.0, 12.0) as u32;
    let cell = (SIZE[0] + GAP, SIZE[1] + LINE * (shown.len() as u32 + 1) + GAP + GAP / 2);
    let size = (GAP + columns.min(count).max(2) * cell.0, HEAD + count.div_ceil(columns) * cell.1);
    let mut picture = RgbImage::from_pixel(size.0, size.1, image::Rgb([PAPER.0, PAPER.1, PAPER.2]));
    let place = |number: usize| {
        let (column, row) = (number as u32 % columns, number as u32 / columns);
        (GAP + column * cell.0, HEAD + row * cell.1)
    };
    for (number, (_, thumbnail)) in entries.iter().enumerate() {
        let (x, y) = place(number);
        image::imageops::replace(&mut picture, thumbnail, x.into(), y.into());
    }
    let area = BitMapBackend::with_buffer(&mut picture, size).into_drawing_area();
    let font = |size: f64, color: RGBColor| (FONT, size).into_font().color(&color);
    area.draw(&Text::new(title, (GAP as i32, 10), font(24.0, INK)))?;
    area.draw(&Text::new(order, (GAP as i32, 38), font(15.0, SOFT)))?;
    for (number, (candidate, _)) in entries.iter().enumerate() {
        let (x, y) = place(number);
        let (left, right, mut y) = (x as i32, (x + SIZE[0]) as i32, (y + SIZE[1] + 5) as i32);
        area.draw(&Text::new((number + 1).to_string(), (left, y), font(16.0, MARK)))?;
        area.draw(&Text::new(candidate.name.clone(), (left + 30, y), font(16.0, INK)))?;
        for figure in shown {
            y += LINE as i32;
            let Some(value) = candidate.formatted(figure) else { continue };
            area.draw(&Text::new(figure.replace('_', " "), (left, y), font(14.0, SOFT)))?;
            let style = font(14.0, INK).pos(Pos::new(HPos::Right, VPos::Top));
            area.draw(&Text::new(value, (right, y), style))?;
        }
    }
    area.present()?;
    drop(area);
    Ok(picture)
}
