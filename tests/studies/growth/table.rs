//! The rows as tables in Markdown.

use crate::row::Row;
use std::fmt::Write;

/// In the order of the bake.
const STAGES: [&str; 8] = ["read", "shape", "fill", "glue", "release", "hold", "measure", "encode"];
const MIB: f64 = 1024.0 * 1024.0;
/// Growth is computed from piles of so many bodies on: smaller ones are nearly all surface.
const FROM: usize = 1_000;

impl Row {
    /// CPU milliseconds.
    pub fn time_per_body(&self) -> f64 {
        1e3 * self.cpu_seconds / self.bodies as f64
    }

    /// KiB of memory.
    pub fn memory_per_body(&self) -> f64 {
        self.peak_bytes as f64 / 1024.0 / self.bodies as f64
    }

    fn stage(&self, name: &str) -> f64 {
        self.seconds.get(name).copied().unwrap_or(0.0)
    }
}

pub fn markdown(rows: &[Row]) -> String {
    let mut text = String::new();
    if let Some(row) = rows.first() {
        let set: String = row.set.iter().map(|assignment| format!(", `{assignment}`")).collect();
        let _ = writeln!(
            text,
            "Accuracy `{}`{set}; Cairn {}, {}. CPU seconds are of one thread.\n",
            row.accuracy, row.version, row.machine
        );
    }
    stages(rows, &mut text);
    text.push('\n');
    growth(rows, &mut text);
    text
}

fn stages(rows: &[Row], text: &mut String) {
    let _ = writeln!(
        text,
        "| scene | wanted | bodies | steps: fill, later | CPU s: {} | in all | wall s: 1 thread | 2 threads | peak \
         MiB | .glb MiB | \
         into Blender, CPU s | date |",
        STAGES.join(" | ")
    );
    let _ = writeln!(text, "|{}", " --- |".repeat(STAGES.len() + 11));
    for row in rows {
        let stages = STAGES.map(|name| format!("{:.2}", row.stage(name))).join(" | ");
        let wall = |threads| row.wall_seconds.get(&threads).map_or("-".into(), |seconds| format!("{seconds:.1}"));
        let blender = row.blender_seconds.map_or("-".into(), |seconds| format!("{seconds:.1}"));
        let [fill, later] = row.steps;
        let _ = writeln!(
            text,
            "| {} | {} | {} | {fill}, {later} | {stages} | {:.2} | {} | {} | {:.0} | {:.1} | {blender} | {} |",
            row.kind.name(),
            row.wanted,
            row.bodies,
            row.cpu_seconds,
            wall(1),
            wall(2),
            row.peak_bytes as f64 / MIB,
            row.output_bytes as f64 / MIB,
            row.date
        );
    }
}

/// Per body, and how many times that of the pile of a thousand.
fn growth(rows: &[Row], text: &mut String) {
    let _ = writeln!(
        text,
        "| scene | bodies | CPU ms per body | times that of {FROM} | fill | glue | release and hold | measure | KiB \
         per body | times that of {FROM} |"
    );
    let _ = writeln!(text, "|{}", " --- |".repeat(10));
    for row in rows {
        let base = rows.iter().find(|base| base.kind == row.kind && base.wanted == FROM);
        let ratio = |of: &dyn Fn(&Row) -> f64| match base.filter(|_| row.wanted >= FROM) {
            Some(base) if of(base) > 0.0 => format!("{:.2}", of(row) / of(base)),
            _ => "-".into(),
        };
        let per_body = |names: &'static [&str]| {
            move |row: &Row| names.iter().map(|name| row.stage(name)).sum::<f64>() / row.bodies as f64
        };
        let _ = writeln!(
            text,
            "| {} | {} | {:.2} | {} | {} | {} | {} | {} | {:.1} | {} |",
            row.kind.name(),
            row.bodies,
            row.time_per_body(),
            ratio(&Row::time_per_body),
            ratio(&per_body(&["fill"])),
            ratio(&per_body(&["glue"])),
            ratio(&per_body(&["release", "hold"])),
            ratio(&per_body(&["measure"])),
            row.memory_per_body(),
            ratio(&Row::memory_per_body)
        );
    }
}
