//! A bake's end in a few lines.

use cairn_core::sim::pile::REST_SPEED;
use std::path::Path;

/// What an artist wants to know, one entry per line. `measure` gives the report's figures by name.
pub fn lines(
    bodies: usize,
    frames: usize,
    measure: impl Fn(&str) -> Option<f64>,
    seconds: f64,
    output: &Path,
) -> Vec<String> {
    let percent = |value: f64| format!("{:.0} %", value * 100.0);
    let count = |n: usize, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
    let mut lines = vec![format!("{}, {}", count(bodies, "body", "bodies"), count(frames, "frame", "frames"))];
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
        lines.push(format!("{state}: in the last second no point was faster than {:.1} mm/s", speed * 1000.0));
    }
    lines.push(format!("{} in {seconds:.1} s", output.display()));
    lines
}
