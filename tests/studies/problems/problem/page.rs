//! `results.md`: the tables, and a sentence for each plot.

use super::results::{Kind, Measured, Row, Study};
use super::{PROBLEMS, Problem, ours};
use std::fmt::Write;

/// Two digits.
pub fn short(value: f64) -> String {
    match value {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 10.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.1}"),
        v if v >= 0.1 => format!("{v:.2}"),
        v if v >= 0.01 => format!("{v:.3}"),
        v if v >= 0.001 => format!("{v:.4}"),
        v => format!("{v:.0e}"),
    }
}

fn error(row: &Row, problem: &Problem) -> String {
    match row.error {
        None => "stopped: too long".into(),
        Some(error) if error <= problem.least => format!("<= {}", problem.least),
        Some(error) => short(error),
    }
}

/// An error with its unit.
fn with_unit(row: &Row, problem: &Problem) -> String {
    format!("{} {}", error(row, problem), problem.unit)
}

fn list(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// No peer is both cheaper and more accurate.
pub fn is_on_front(problem: &Problem, measured: &Measured, row: &Row) -> bool {
    measured.beaten_by(row, problem).next().is_none()
}

/// The problems on which a row is on the front, or below it; and those on which it is not.
fn split(study: &Study, row: impl Fn(&'static Problem, &Measured) -> bool) -> [Vec<String>; 2] {
    let (on, off): (Vec<_>, Vec<_>) = PROBLEMS.iter().partition(|problem| row(problem, study.of(problem)));
    [on, off].map(|problems| problems.into_iter().map(|p| format!("`{}`", p.name)).collect())
}

/// A sentence about where a row is on the front.
fn front(name: &str, [on, off]: &[Vec<String>; 2]) -> String {
    let mut text = format!(
        "On {} of {} problems, no peer is both cheaper and more accurate than {name}: {}.",
        on.len(),
        PROBLEMS.len(),
        list(on)
    );
    if !off.is_empty() {
        let _ = write!(text, " On {} it is beaten: {}.", off.len(), list(off));
    }
    text
}

fn is_unseen(row: &&Row, problem: &Problem) -> bool {
    row.error.is_some_and(|error| error < problem.seen)
}

/// What to choose.
pub fn advice(problem: &Problem, measured: &Measured) -> String {
    let cheapest = |kind: Kind| {
        let good = measured.of_kind(kind).filter(|row| is_unseen(row, problem));
        good.min_by(|a, b| a.cost().total_cmp(&b.cost()))
    };
    let (seen, unit) = (problem.seen, problem.unit);
    let mut text = match cheapest(Kind::Preset) {
        Some(row) => format!(
            "Choose `{}`: the cheapest preset whose error nobody sees (below {seen} {unit}): {} for {} ms",
            row.settings,
            with_unit(row, problem),
            short(row.cost())
        ),
        None => {
            let value = |row: &&Row| row.error.unwrap_or(f64::INFINITY);
            let best = measured.of_kind(Kind::Preset).min_by(|a, b| value(a).total_cmp(&value(b))).expect("presets");
            format!(
                "No preset has an error below {seen} {unit}, from which on it is seen; the best is `{}` with {} for {} \
                 ms",
                best.settings,
                with_unit(best, problem),
                short(best.cost())
            )
        }
    };
    let other = cheapest(Kind::Peer);
    let _ = match other {
        Some(row) => {
            write!(text, "; of the peers, {} is the cheapest below it, with {} ms", row.name(), short(row.cost()))
        }
        None => write!(text, "; no peer is below it"),
    };
    text.push('.');
    text
}

/// What beats `standard`.
fn verdict(problem: &Problem, measured: &Measured) -> String {
    let standard = measured.preset("standard");
    let mut better: Vec<&Row> = measured.beaten_by(standard, problem).collect();
    better.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
    let names: Vec<String> = better
        .iter()
        .map(|row| format!("{}: {} for {} ms", row.name(), with_unit(row, problem), short(row.cost())))
        .collect();
    match names.is_empty() {
        true => "`standard` is on the front: no peer is both cheaper and more accurate.".into(),
        false => format!("`standard` is **not** on the front. Cheaper and more accurate: {}.", list(&names)),
    }
}

/// The price of one more digit.
fn span(problem: &Problem, measured: &Measured) -> String {
    let [draft, reference] = ["draft", "reference"].map(|name| measured.preset(name));
    format!(
        "From `draft` to `reference`: {} to {}, for {} times the time.",
        with_unit(draft, problem),
        with_unit(reference, problem),
        short(reference.cost() / draft.cost())
    )
}

pub fn markdown(study: &Study) -> String {
    let mut text = String::new();
    let (low, high) = (study.load[0], study.load[1]);
    let rounds = study.problems.iter().flat_map(|m| &m.rows).map(|row| row.cpu.len()).max().unwrap_or(0);
    let _ = write!(
        text,
        "# Errors against a truth, and what they cost\n\nSmall problems with known answers, in Cairn and in other \
         engines. [How they are measured](README.md).\n\nMade by `tests/studies/problems/run` on {}, {} cores, one \
         thread each, load {low} to {high}. Times are CPU milliseconds for each simulated \
         second, medians of {rounds} rounds.\n\n",
        study.machine, study.cores
    );
    let of_preset = |preset: &str| split(study, |problem, m| is_on_front(problem, m, m.preset(preset)));
    let delivered = split(study, |problem, m| is_on_front(problem, m, m.delivered(problem)));
    let _ = writeln!(text, "## Where `standard` is on the front\n");
    let _ = writeln!(text, "{}\n", front("`standard`, physics alone", &of_preset("standard")));
    let _ = writeln!(
        text,
        "{}\n",
        front("`standard` as it is delivered, with its control where something stands", &delivered)
    );
    let others: Vec<String> = ours::PRESETS
        .iter()
        .filter(|preset| **preset != "standard")
        .map(|preset| format!("`{preset}` on {}", of_preset(preset)[0].len()))
        .collect();
    let _ = writeln!(text, "The other presets, physics alone, are on the front thus often: {}.\n", list(&others));
    // Those of one cause together.
    let worse: Vec<_> = PROBLEMS.iter().filter(|problem| study.of(problem).is_out_of_order(problem)).collect();
    let mut causes: Vec<(&str, Vec<String>)> = Vec::new();
    for problem in &worse {
        let cause = problem.fault.unwrap_or("the cause is not known");
        let name = format!("`{}`", problem.name);
        match causes.iter_mut().find(|(known, _)| *known == cause) {
            Some((_, names)) => names.push(name),
            None => causes.push((cause, vec![name])),
        }
    }
    if !worse.is_empty() {
        let _ = writeln!(text, "`reference` errs more than `draft` on {}:\n", worse.len());
        for (cause, names) in causes {
            let _ = writeln!(text, "- {}: {cause}.", list(&names));
        }
        text.push('\n');
    }
    let _ = writeln!(
        text,
        "| problem | error | draft | preview | standard | fine | reference | on the front | delivered |"
    );
    let _ = writeln!(text, "|{}", " --- |".repeat(9));
    for problem in PROBLEMS {
        let measured = study.of(problem);
        let cells: Vec<String> = ours::PRESETS
            .iter()
            .map(|preset| {
                let row = measured.preset(preset);
                format!("{} / {} ms", error(row, problem), short(row.cost()))
            })
            .collect();
        let [on, delivered] = [measured.preset("standard"), measured.delivered(problem)]
            .map(|row| if is_on_front(problem, measured, row) { "yes" } else { "no" });
        let _ = writeln!(
            text,
            "| [{}](#{}) | {} | {} | {on} | {delivered} |",
            problem.name,
            problem.name,
            problem.unit,
            cells.join(" | ")
        );
    }
    parameters(study, &mut text);
    for problem in PROBLEMS {
        section(problem, study.of(problem), &mut text);
    }
    text
}

/// What single parameters gain over `standard`.
fn parameters(study: &Study, text: &mut String) {
    let _ = write!(
        text,
        "\n## Single parameters\n\n`standard` with one parameter changed, physics alone, on the {} problems: how often \
         it is a tenth cheaper and errs by no more than a tenth more, how often it errs by half or less, and how often \
         by twice as much or more. Time: relative to `standard`, median of the problems.\n\n",
        PROBLEMS.len()
    );
    let _ = writeln!(text, "| parameter | time | cheaper, no worse | half the error | twice the error |");
    let _ = writeln!(text, "|{}", " --- |".repeat(5));
    let names = study.problems.iter().flat_map(|m| m.of_kind(Kind::Parameter)).map(|row| row.settings.clone());
    let mut known = Vec::new();
    for name in names {
        if known.contains(&name) {
            continue;
        }
        // Time and error over those of `standard`.
        let ratios: Vec<(&Problem, f64, f64)> = PROBLEMS
            .iter()
            .filter_map(|problem| {
                let measured = study.of(problem);
                let row = measured.of_kind(Kind::Parameter).find(|row| row.settings == name)?;
                let standard = measured.preset("standard");
                let error = Measured::error(row, problem)? / Measured::error(standard, problem)?;
                Some((problem, row.cost() / standard.cost(), error))
            })
            .collect();
        let mut times: Vec<f64> = ratios.iter().map(|r| r.1).collect();
        times.sort_by(f64::total_cmp);
        let of = |is: &dyn Fn(f64, f64) -> bool| -> String {
            let names: Vec<String> =
                ratios.iter().filter(|r| is(r.1, r.2)).map(|r| format!("`{}`", r.0.name)).collect();
            if names.is_empty() { "-".into() } else { format!("{}: {}", names.len(), names.join(", ")) }
        };
        let _ = writeln!(
            text,
            "| `{name}` | {:.2} | {} | {} | {} |",
            times[times.len() / 2],
            of(&|time, error| time <= 0.9 && error <= 1.1),
            of(&|_, error| error <= 0.5),
            of(&|_, error| error >= 2.0)
        );
        known.push(name);
    }
}

fn section(problem: &Problem, measured: &Measured, text: &mut String) {
    let _ = write!(
        text,
        "\n## {}\n\n**{}.** {}\n\n{}\n\n{} {}\n\n![Error over CPU time: {}](plots/{}.svg)\n\n",
        problem.name,
        problem.title,
        problem.truth,
        advice(problem, measured),
        verdict(problem, measured),
        span(problem, measured),
        problem.title.to_lowercase(),
        problem.name
    );
    let _ = writeln!(text, "| engine | settings | CPU ms | error, {} |", problem.unit);
    let _ = writeln!(text, "| --- | --- | --- | --- |");
    for row in &measured.rows {
        let engine = if row.kind == Kind::Preset { format!("**{}**", row.engine) } else { row.engine.clone() };
        let _ = writeln!(text, "| {engine} | {} | {} | {} |", row.settings, short(row.cost()), error(row, problem));
    }
}
