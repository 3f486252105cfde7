//! The graph of contacts: as Graphviz reads it, and as a picture.

use super::FoundPile;
use cairn_analysis::{AnalysedBody, PileAnalysis, Standing, Touch};
use std::collections::BTreeMap;
use std::fmt::Write;

/// A pair that carries less than this share of the largest force is drawn dotted.
const LITTLE: f64 = 1e-3;

/// Green safe to remove, red not, yellow open, orange falls.
fn color(body: &AnalysedBody) -> &'static str {
    match (&body.removal, body.standing) {
        (_, Standing::FallsAlone | Standing::FallsWithOthers) => "orange",
        (Some(removal), _) if removal.is_safe => "palegreen",
        (Some(removal), _) if removal.is_open => "khaki",
        (Some(_), _) => "salmon",
        (None, _) => "white",
    }
}

/// Bodies as boxes, pairs that touch as arrows from what is carried to what carries it, as wide as the force is large.
pub fn dot(pile: &FoundPile, analysis: &PileAnalysis) -> String {
    let largest = largest(analysis);
    let mut text = String::from("digraph contacts {\n  rankdir=TB;\n  node [shape=box, style=filled];\n");
    text += "  ground [shape=plaintext, style=\"\"];\n";
    for (k, (body, figures)) in pile.bodies.iter().zip(&analysis.bodies).enumerate() {
        let color = color(figures);
        let name = body.name.replace('\\', "\\\\").replace('"', "\\\"");
        let _ = writeln!(text, "  b{k} [label=\"{name}\\n{:.3} N\", fillcolor={color}];", figures.load);
    }
    for touch in &analysis.touches {
        let force = force(touch);
        // Up on the body: the other one carries it.
        let other = touch.other.map_or("ground".to_owned(), |other| format!("b{other}"));
        let body = format!("b{}", touch.body);
        let (above, below) = if touch.force[1] >= 0.0 { (body, other) } else { (other, body) };
        let width = 0.3 + 4.0 * if largest > 0.0 { force / largest } else { 0.0 };
        let style = if force > LITTLE * largest { "solid" } else { "dotted" };
        let _ = writeln!(text, "  {above} -> {below} [label=\"{force:.3}\", penwidth={width:.2}, style={style}];");
    }
    text + "}\n"
}

fn force(touch: &Touch) -> f64 {
    touch.force.iter().map(|f| f * f).sum::<f64>().sqrt()
}

fn largest(analysis: &PileAnalysis) -> f64 {
    analysis.touches.iter().map(force).fold(0.0, f64::max)
}

/// Width and height of a box of the picture, and the room between boxes and between rows, in its units.
const BOX: [f64; 2] = [96.0, 30.0];
const ROOM: [f64; 2] = [18.0, 46.0];
/// Letters of a name that a box has room for.
const LETTERS: usize = 14;

/// The same as a picture: bodies in rows, each above all that carry it, and in a row by their places in the pile.
pub fn svg(pile: &FoundPile, analysis: &PileAnalysis) -> String {
    let rows = rows(analysis);
    let across = |body: usize| pile.scene.bodies[body].pose.translation;
    let mut in_row: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    (0..analysis.bodies.len()).for_each(|body| in_row.entry(rows[body]).or_default().push(body));
    let widest = in_row.values().map(Vec::len).max().unwrap_or(1) as f64;
    let top = in_row.keys().next_back().copied().unwrap_or(0);
    let width = widest * (BOX[0] + ROOM[0]) + ROOM[0];
    let height = (top + 2) as f64 * (BOX[1] + ROOM[1]) + ROOM[1];
    let level = |row: usize| height - (row + 2) as f64 * (BOX[1] + ROOM[1]);
    let mut places = vec![[0.0; 2]; analysis.bodies.len()];
    for (&row, bodies) in &mut in_row {
        bodies.sort_by(|&a, &b| {
            let (a, b) = (across(a), across(b));
            a.x.total_cmp(&b.x).then(a.z.total_cmp(&b.z))
        });
        let from = (width - bodies.len() as f64 * (BOX[0] + ROOM[0])) / 2.0 + ROOM[0] / 2.0;
        for (k, &body) in bodies.iter().enumerate() {
            places[body] = [from + k as f64 * (BOX[0] + ROOM[0]), level(row)];
        }
    }
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
         font-family=\"sans-serif\" font-size=\"11\" text-anchor=\"middle\">\n"
    );
    let ground = height - ROOM[1] / 2.0;
    let _ = writeln!(
        text,
        "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <path d=\"M 0 {ground:.1} H {width:.1}\" stroke=\"gray\" stroke-width=\"2\"/>"
    );
    let largest = largest(analysis);
    for touch in &analysis.touches {
        let force = force(touch);
        let middle = |body: usize| [places[body][0] + BOX[0] / 2.0, places[body][1] + BOX[1] / 2.0];
        let [x, y] = middle(touch.body);
        let [u, v] = touch.other.map_or([x, ground], middle);
        let share = if largest > 0.0 { force / largest } else { 0.0 };
        let dashes = if force > LITTLE * largest { "" } else { " stroke-dasharray=\"2 3\"" };
        let _ = writeln!(
            text,
            "<path d=\"M {x:.1} {y:.1} L {u:.1} {v:.1}\" stroke=\"dimgray\" stroke-width=\"{:.2}\"{dashes}>\
             <title>{force:.3} N</title></path>",
            0.6 + 5.0 * share
        );
    }
    for (k, (body, figures)) in pile.bodies.iter().zip(&analysis.bodies).enumerate() {
        let [x, y] = places[k];
        let whole = escaped(&body.name);
        let short: String = body.name.chars().take(LETTERS).collect();
        let _ = writeln!(
            text,
            "<g><title>{whole}: carries {:.3} N</title><rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{}\" height=\"{}\" \
             rx=\"4\" fill=\"{}\" stroke=\"black\" stroke-width=\"0.6\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text></g>",
            figures.load,
            BOX[0],
            BOX[1],
            color(figures),
            x + BOX[0] / 2.0,
            y + BOX[1] / 2.0 + 4.0,
            escaped(&short)
        );
    }
    text + "</svg>\n"
}

/// The row of each body: 0 on the ground or scenery, otherwise above all that carry it. Bodies that carry each other in
/// a circle are as low as those that they do not carry allow.
fn rows(analysis: &PileAnalysis) -> Vec<usize> {
    let count = analysis.bodies.len();
    let mut rows = vec![0; count];
    for _ in 0..count {
        let mut grows = false;
        for (below, body) in analysis.bodies.iter().enumerate() {
            for &above in &body.carries {
                let in_circle = analysis.bodies[above].rests_on_it.binary_search(&below).is_ok();
                if !in_circle && rows[above] <= rows[below] {
                    (rows[above], grows) = (rows[below] + 1, true);
                }
            }
        }
        if !grows {
            break;
        }
    }
    rows
}

/// As text of XML, without characters that it cannot have.
fn escaped(text: &str) -> String {
    let plain = text.chars().filter(|c| !c.is_control());
    plain.collect::<String>().replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
