//! The problems of `tests/studies/problems`: Cairn's errors are those of the committed results, a higher preset is no
//! worse, and the page says what the results say.

use super::problem::results::{Kind, Measured, Row, Study, is_worse};
use super::problem::{Ask, PROBLEMS, Problem, ours, page};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CAIRN_REPOSITORY")).join("tests/studies/problems")
}

fn study() -> Study {
    Study::read(&folder().join("results.json")).expect("the committed results")
}

/// An error by a preset; of a limit, nothing.
fn error(problem: &Problem, preset: &str) -> Option<f64> {
    let Ask::Error { of, .. } = &problem.ask else { return None };
    let variant = ours::variant(preset).expect("a preset");
    Some(of(&ours::run(problem, 0, variant).expect("a problem bakes").motion).max(problem.least))
}

/// Up to this factor: changes beyond it ask for another run of the study.
const SAME: f64 = 1.5;

#[test]
fn errors_at_standard_are_those_of_the_page() {
    let study = study();
    PROBLEMS.par_iter().for_each(|problem| {
        let known = study.of(problem).preset("standard").error.expect("standard is never stopped").max(problem.least);
        match &problem.ask {
            Ask::Error { .. } => {
                let now = error(problem, "standard").expect("it has an error");
                assert!(
                    now <= SAME * known && known <= SAME * now,
                    "{}: {now} {}, in the results {known}; tests/studies/problems/run --fresh measures again",
                    problem.name,
                    problem.unit
                );
            }
            Ask::Limit { falls, .. } => {
                let standard = ours::variant("standard").expect("a preset");
                let does = |case: usize| falls(&ours::run(problem, case, standard).expect("it bakes").motion);
                assert!(does(0), "{}: what falls by far, falls", problem.name);
                // As far as the results say.
                assert_eq!(does(problem.timed()), known > problem.clear(), "{}", problem.name);
            }
        }
    });
}

/// CPU seconds that a problem may take `reference` here; the committed results have the others.
const CHEAP: f64 = 1.0;

/// But for those whose cause is known: once they are in order, they are no exceptions any more.
#[test]
fn reference_is_no_worse_than_draft() {
    let study = study();
    let seconds = |problem: &Problem| study.of(problem).preset("reference").cost() * 1e-3 * problem.seconds;
    let chosen: Vec<_> = PROBLEMS.iter().filter(|p| !p.is_limit() && seconds(p) < CHEAP).collect();
    assert!(chosen.len() >= 8, "{}", chosen.len());
    chosen.par_iter().for_each(|problem| {
        let [draft, reference] = ["draft", "reference"].map(|preset| error(problem, preset).expect("it has an error"));
        let (name, unit) = (problem.name, problem.unit);
        let errs = format!("{name}: reference errs by {reference} {unit}, draft by {draft}");
        assert_eq!(is_worse(problem, draft, reference), problem.fault.is_some(), "{errs}");
    });
}

#[test]
fn the_page_says_what_the_results_say() {
    let (study, path) = (study(), folder().join("results.md"));
    let page = page::markdown(&study);
    let written = std::fs::read_to_string(&path).expect("the page is there");
    // Lines are wrapped when it is written.
    let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    assert!(words(&written) == words(&page), "cargo study problems -- page {}", folder().display());
    for problem in PROBLEMS {
        let measured = study.of(problem);
        assert_eq!(measured.is_out_of_order(problem), problem.fault.is_some(), "{}", problem.name);
        let plot = folder().join("plots").join(format!("{}.svg", problem.name));
        assert!(plot.exists(), "{} is there", plot.display());
        let peers = measured.of_kind(Kind::Peer).filter(|row| row.error.is_some()).count();
        assert!(peers >= 9 && measured.rows.iter().all(|row| row.cpu.len() >= 3), "{}: {peers} peers", problem.name);
    }
}

/// What `README.md` of the study says.
#[test]
fn the_errors_say_what_the_readme_says() {
    let study = study();
    let of = |name: &str| {
        let problem = super::problem::of(name).expect("a problem");
        (problem, study.of(problem))
    };
    let least = |name: &str, engine: &str| {
        let (problem, measured) = of(name);
        let rows = measured.of_kind(Kind::Peer).filter(|row| row.engine.starts_with(engine));
        rows.filter_map(|row| Measured::error(row, problem)).fold(f64::INFINITY, f64::min)
    };
    let standard = |name: &str| of(name).1.preset("standard").error.expect("standard is never stopped");
    assert!(least("cards", "") > standard("cards"), "no peer is as good on a house of cards");
    let (sag, tower) = of("sag");
    let better: Vec<_> = tower.beaten_by(tower.preset("standard"), sag).map(|row| &*row.engine).collect();
    assert!(better.iter().all(|engine| *engine == "Jolt"), "a tower: {better:?}");
    assert!(least("arch", "Box3D") < standard("arch") && least("overhang", "Box3D") < standard("overhang"));
    assert!(least("top", "rapier") < standard("top"));
    let sunk = |row: &&Row| row.error.is_some_and(|error| error > 50.0);
    let engines: BTreeSet<_> = of("masses").1.of_kind(Kind::Peer).filter(sunk).map(|row| &row.engine).collect();
    assert!(engines.len() >= 4, "1000:1 sinks through in {engines:?}");
}
