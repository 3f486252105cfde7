//! The graph of contacts, as Graphviz reads it.

use super::FoundPile;
use cairn_core::analysis::{PileAnalysis, Standing};
use std::fmt::Write;

/// A pair that carries less than this share of the largest force is drawn dotted.
const LITTLE: f64 = 1e-3;

/// Bodies as boxes, pairs that touch as arrows from what is carried to what carries it, as wide as the force is large.
pub fn dot(pile: &FoundPile, analysis: &PileAnalysis) -> String {
    let length = |force: &[f64; 3]| force.iter().map(|f| f * f).sum::<f64>().sqrt();
    let largest = analysis.touches.iter().map(|touch| length(&touch.force)).fold(0.0, f64::max);
    let mut text = String::from("digraph contacts {\n  rankdir=TB;\n  node [shape=box, style=filled];\n");
    text += "  ground [shape=plaintext, style=\"\"];\n";
    for (k, (body, figures)) in pile.bodies.iter().zip(&analysis.bodies).enumerate() {
        let color = match (&figures.removal, figures.standing) {
            (_, Standing::FallsAlone | Standing::FallsWithOthers) => "orange",
            (Some(removal), _) if removal.is_safe => "palegreen",
            (Some(removal), _) if removal.is_open => "khaki",
            (Some(_), _) => "salmon",
            (None, _) => "white",
        };
        let name = body.name.replace('\\', "\\\\").replace('"', "\\\"");
        let _ = writeln!(text, "  b{k} [label=\"{name}\\n{:.3} N\", fillcolor={color}];", figures.load);
    }
    for touch in &analysis.touches {
        let force = length(&touch.force);
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
