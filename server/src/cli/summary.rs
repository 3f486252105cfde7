//! A bake's end in a few lines.

use cairn_core::hold::REST_SPEED;
use cairn_core::report::Report;
use std::path::Path;

/// What an artist wants to know, one entry per line.
pub fn lines(report: &Report, frames: usize, seconds: f64, output: &Path) -> Vec<String> {
    let measure = |name: &str| report.measures.get(name).copied().flatten();
    let percent = |value: f64| format!("{:.0} %", value * 100.0);
    let mut lines = vec![format!("{} bodies, {} frames", report.bodies, frames)];
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
    if let (Some(speed), Some(relative)) = (measure("resting_speed_max"), measure("resting_speed_max_rel")) {
        let state = if relative < REST_SPEED { "all at rest" } else { "not at rest" };
        lines.push(format!("{state}: in the last second no point was faster than {speed:.3} m/s"));
    }
    lines.push(format!("{} in {seconds:.1} s", output.display()));
    lines
}
