//! The guide's page of measures lists every measure and count of reports, and no others.

use crate::cli::desk::Desk;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

fn page() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/guide/measures.md");
    std::fs::read_to_string(path).unwrap()
}

/// The names in the first cells of all tables with this heading.
fn named(heading: &str) -> BTreeSet<String> {
    let page = page();
    let mut names = BTreeSet::new();
    let mut is_in = false;
    for line in page.lines() {
        let first = line.strip_prefix("| ").and_then(|row| row.split(" | ").next());
        is_in = first.is_some_and(|first| first == heading || is_in);
        for name in first.filter(|_| is_in).unwrap_or_default().split('`').skip(1).step_by(2) {
            assert!(names.insert(name.to_owned()), "{name} stands there twice");
        }
    }
    names
}

/// The names in this part of the reports.
fn reported(reports: &[Value], part: &str) -> BTreeSet<String> {
    reports.iter().flat_map(|report| report[part].as_object().unwrap().keys().cloned()).collect()
}

/// A pile with all optional measures, a stack hit by a thrown body, and bodies that come in: together they have every
/// measure.
fn reports() -> [Value; 3] {
    let desk = Desk::new();
    desk.write(
        "stack.toml",
        r#"
control_mesh = "cone.glb"
accuracy = "draft"
fill = "off"
[output]
frames = 40
[[props]]
path = "stick.glb"
[[bodies]]
prop = "stick"
[[bodies]]
prop = "stick"
position = [0, 1, 0]
velocity = [1, 0, 0]
start_seconds = 0.5
"#,
    );
    let pile = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=12 \
                --set output.free_standing=true --set output.free_pour=true --set glue.proof=on \
                --set report.pictures=on";
    let rain = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=4 --set entrance=rain";
    [pile, "stack.toml --set report.pictures=on", rain].map(|args| {
        desk.line(&format!("bake {args} -o pile.json --report report.json --quiet")).ok();
        serde_json::from_slice(&std::fs::read(desk.path("report.json")).unwrap()).unwrap()
    })
}

#[test]
fn the_page_of_measures_is_the_report() {
    let reports = reports();
    let (figures, counts) = (reported(&reports, "measures"), reported(&reports, "counts"));
    assert!(figures.len() > 40 && counts.len() > 40, "{figures:?}, {counts:?}");
    assert_eq!(named("figure"), figures, "figures: the page, and the reports");
    assert_eq!(named("count"), counts, "counts: the page, and the reports");
    // Any report has all counts; figures may be missing.
    for report in &reports {
        assert_eq!(reported(std::slice::from_ref(report), "counts"), counts);
    }

    // The text around the tables speaks of parts of the report.
    let page = page();
    let pile = &reports[0];
    for source in pile["error_sources"].as_object().unwrap().keys() {
        assert!(page.contains(&format!("`{source}`")), "{source}");
    }
    for part in ["measures", "counts", "glue", "error_sources", "limited_by", "seconds", "bill", "warnings"] {
        assert!(pile.get(part).is_some() && page.contains(&format!("`{part}`")), "{part}");
    }
}
