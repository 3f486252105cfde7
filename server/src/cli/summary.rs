//! A bake's end in a few lines.

use cairn_core::report::Report;
use std::path::Path;

/// What an artist wants to know, one entry per line.
pub fn lines(report: &Report, seconds: f64, output: &Path) -> Vec<String> {
    let measure = |name: &str| report.measures.get(name).copied().flatten();
    let percent = |value: f64| format!("{:.0} %", value * 100.0);
    let mut lines = vec![format!("{} bodies, {} frames", report.bodies, report.counts.get("frames").unwrap_or(&0))];
    if let Some(fill) = measure("fill_fraction") {
        lines[0] += &format!(", {} of the control mesh's volume", percent(fill));
    }
    if let (Some(start), Some(kept)) = (measure("shape_iou_start"), measure("kept_shape")) {
        lines.push(format!(
            "shape: {} like the control mesh after turning over, {} of that kept",
            percent(start),
            percent(kept)
        ));
    }
    if let Some(speed) = measure("resting_speed_max") {
        lines.push(format!("at the end the fastest body moves at {speed:.3} m/s"));
    }
    lines.push(format!("{} in {seconds:.1} s", output.display()));
    lines
}
