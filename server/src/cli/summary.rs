//! The summary that ends a bake, in a few lines.

use super::print_done;
use cairn_gltf::grouped;
use cairn_job::goal::length;
use serde_json::json;
use std::path::Path;

/// Prints the summary: its lines, or an object of result, bodies, frames and seconds.
pub fn print(
    bodies: usize,
    frames: usize,
    measure: impl Fn(&str) -> Option<f64>,
    counted: impl Fn(&str) -> u64,
    seconds: f64,
    output: &Path,
) {
    let object = || json!({ "result": output, "bodies": bodies, "frames": frames, "seconds": seconds });
    print_done(lines(bodies, frames, measure, counted, seconds, output), object);
}

/// The lines of the summary. `measure` and `counted` return the report's measures and counts by name.
fn lines(
    bodies: usize,
    frames: usize,
    measure: impl Fn(&str) -> Option<f64>,
    counted: impl Fn(&str) -> u64,
    seconds: f64,
    output: &Path,
) -> Vec<String> {
    let percent = |value: f64| format!("{:.0} %", value * 100.0);
    let count = |n: usize, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
    let mut lines = vec![format!("{}, {}", count(bodies, "body", "bodies"), count(frames, "frame", "frames"))];
    if let Some(fill) = measure("fill_fraction") {
        let filled = if counted("core_triangles") > 0 { "the shell's volume" } else { "the control mesh's volume" };
        lines[0] += &format!(", {} of {filled}", percent(fill));
    }
    if let (Some(end), Some(start), Some(kept)) =
        (measure("shape_iou"), measure("shape_iou_start"), measure("kept_shape"))
    {
        lines.push(format!(
            "shape: {} match with the control mesh as it was drawn; {} after turning over, {} of it kept",
            percent(end),
            percent(start),
            percent(kept)
        ));
    }
    lines.extend(kept(&counted));
    lines.extend(glue(&measure, counted));
    if let (Some(speed), Some(moving)) = (measure("resting_speed_max"), measure("moving")) {
        let state = match moving as usize {
            0 if measure("rest_seconds").is_some() => "all at rest".to_owned(),
            0 => "no body moves in the last frame".to_owned(),
            some => format!("{} of {} still moving", grouped(some as u64), count(bodies, "body", "bodies")),
        };
        lines.push(format!("{state}; largest speed at the end: {:.1} mm/s", speed * 1000.0));
    }
    lines.extend(seen(&measure));
    lines.push(format!("{} in {seconds:.1} s", output.display()));
    lines
}

/// The line about an earlier result that the bake has changed.
fn kept(counted: impl Fn(&str) -> u64) -> Option<String> {
    let [kept, moved, new, gone] = ["kept", "moved", "new", "gone"].map(|what| counted(&format!("bodies_{what}")));
    let text = format!(
        "earlier pile: {} of {} bodies kept to the bit, {} moved, {} gone; {} new",
        grouped(kept),
        grouped(kept + moved + gone),
        grouped(moved),
        grouped(gone),
        grouped(new)
    );
    (kept + moved + gone > 0).then_some(text)
}

/// The line about what is seen where bodies meet, if that was measured.
fn seen(measure: impl Fn(&str) -> Option<f64>) -> Option<String> {
    let (depth, share) = (measure("visible_depth_p95")?, measure("visible_depth_p95_rel")?);
    let mut line = match measure("visible_cut_share")? {
        0.0 => "seen: no mesh cuts another".to_owned(),
        _ => format!("seen: meshes cut each other by up to {}, {:.1} % of a thickness", length(depth), share * 100.0),
    };
    if let Some(gap) = measure("visible_gap_p95") {
        line += &format!("; gaps where bodies touch are up to {}", length(gap));
    }
    Some(line + " (95 of 100)")
}

/// The line about glue, if the pile may have any.
fn glue(measure: impl Fn(&str) -> Option<f64>, counted: impl Fn(&str) -> u64) -> Option<String> {
    let whole = |value: f64| grouped(value as u64);
    let pairs = whole(measure("touches")?);
    let mut line = match counted("glue_dots") {
        0 => format!("glued: none of {pairs} contact pairs"),
        dots => {
            let (clusters, anchored) = (counted("glue_clusters"), measure("anchored").unwrap_or(0.0));
            let clusters = match clusters {
                0 => String::new(),
                1 => " in 1 cluster".into(),
                many => format!(" in {} clusters", grouped(many)),
            };
            let ground = if anchored > 0.0 { format!(", {} to the ground", whole(anchored)) } else { String::new() };
            format!("glued: {} of {pairs} contact pairs{clusters}{ground}", grouped(dots))
        }
    };
    if let Some(moved) = measure("moved_freed") {
        // A single moved body must not show as 0 %.
        let share = if moved > 0.0 && moved < 0.005 { "less than 1".into() } else { format!("{:.0}", moved * 100.0) };
        line += &format!("; {share} % of the bodies moved when released");
    }
    if let broken @ 1.. = counted("glue_dots_broken") {
        line += &format!("; {} broke", grouped(broken));
    }
    Some(line)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_about_glue() {
        let line = |figures: &[(&str, f64)], counts: &[(&str, u64)]| {
            let measure = |name: &str| figures.iter().find(|(n, _)| *n == name).map(|(_, value)| *value);
            glue(measure, |name| counts.iter().find(|(n, _)| *n == name).map_or(0, |(_, count)| *count))
        };
        assert_eq!(line(&[], &[]), None);
        let figures = [("touches", 1050.0), ("anchored", 2.0), ("moved_freed", 0.0)];
        let text = line(&figures, &[("glue_dots", 29), ("glue_clusters", 23)]).unwrap();
        assert_eq!(
            text,
            "glued: 29 of 1,050 contact pairs in 23 clusters, 2 to the ground; 0 % of the bodies moved when released"
        );
        let text = line(&[("touches", 12.0), ("moved_freed", 0.004)], &[]).unwrap();
        assert_eq!(text, "glued: none of 12 contact pairs; less than 1 % of the bodies moved when released");
        let counts = [("glue_dots", 1000), ("glue_clusters", 1), ("glue_dots_broken", 3)];
        let text = line(&[("touches", 1_234_567.0)], &counts).unwrap();
        assert_eq!(text, "glued: 1,000 of 1,234,567 contact pairs in 1 cluster; 3 broke");
    }
}
