//! The variants of a scene: every seed with every combination of values, each with its own file name.

use cairn_export::Format;
use cairn_files::problem::Problem;
use cairn_wire::scene_file::SceneTree;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Most variants of one matrix.
const MOST: usize = 100_000;

/// A range of whole numbers, both ends included, or a single number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    pub first: u64,
    pub last: u64,
}

impl Span {
    fn parse(text: &str, between: &str) -> Result<Span, String> {
        let (first, last) = text.split_once(between).unwrap_or((text, text));
        let number = |text: &str| text.trim().parse().map_err(|_| format!("`{text}` is not a whole number"));
        let span = Span { first: number(first)?, last: number(last)? };
        if span.first > span.last { Err(format!("{first} comes after {last}")) } else { Ok(span) }
    }
}

/// In the form of array jobs: `8-15`.
impl FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Span, String> {
        Span::parse(text, "-")
    }
}

/// Ranges such as `0..49`, both ends included, and single numbers, separated by commas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seeds(Vec<Span>);

impl FromStr for Seeds {
    type Err = String;

    fn from_str(text: &str) -> Result<Seeds, String> {
        text.split(',').map(|part| Span::parse(part, "..")).collect::<Result<_, _>>().map(Seeds)
    }
}

impl Seeds {
    /// All seeds in the given order, without repetitions.
    fn all(&self) -> impl Iterator<Item = u64> {
        let mut seen = std::collections::BTreeSet::new();
        self.0.iter().flat_map(|span| span.first..=span.last).filter(move |seed| seen.insert(*seed)).take(MOST + 1)
    }
}

/// A field of the scene, and its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Vary {
    field: String,
    values: Vec<String>,
}

impl FromStr for Vary {
    type Err = String;

    fn from_str(text: &str) -> Result<Vary, String> {
        let (field, values) = text.split_once('=').ok_or("it has no `=`; write FIELD=VALUE,VALUE")?;
        let values = match toml::from_str::<toml::Table>(&format!("values = [{values}]")) {
            // TOML handles lists and quoted text with commas.
            Ok(list) => list["values"].as_array().into_iter().flatten().map(toml::Value::to_string).collect(),
            Err(_) => values.split(',').map(|value| value.trim().to_owned()).collect(),
        };
        Ok(Vary { field: field.trim().to_owned(), values })
    }
}

/// One bake of the matrix.
#[derive(Clone, Debug)]
pub struct Variant {
    /// Index in the matrix, from 0.
    pub index: usize,
    pub tree: SceneTree,
    /// The `--set` assignments that turn the scene into this variant.
    pub assignments: Vec<String>,
    pub output: PathBuf,
    /// Whether at most one varied field has another value than its first. These variants together have every value.
    pub is_sample: bool,
}

impl Variant {
    /// The path of its report.
    pub fn report(&self) -> PathBuf {
        self.output.with_extension("report.json")
    }
}

/// The arguments that define the variants.
pub struct Matrix<'a> {
    pub scene: &'a SceneTree,
    pub seeds: Option<&'a Seeds>,
    pub vary: &'a [Vary],
    /// The result's path, with `{seed}`, `{index}` and the names of varied fields in it.
    pub output: &'a str,
}

impl Matrix<'_> {
    /// All variants, grouped by seed; the last field varies fastest.
    pub fn variants(&self) -> Result<Vec<Variant>, Vec<Problem>> {
        let combinations = self.vary.iter().fold(1_usize, |all, vary| all.saturating_mul(vary.values.len()));
        let seeds: Vec<Option<u64>> = self.seeds.map_or(vec![None], |seeds| seeds.all().map(Some).collect());
        if combinations.saturating_mul(seeds.len()) > MOST {
            let what = format!("more than {MOST} variants");
            return Err(vec![Problem::new("--seeds and --vary", what, "Bake them by several commands.")]);
        }
        let mut problems = Vec::new();
        let mut variants = Vec::new();
        for seed in seeds {
            for number in 0..combinations {
                let picks = self.picks(number);
                let others = picks.iter().filter(|(_, value)| *value > 0).count();
                let is_first_seed = variants.len() < combinations;
                let index = variants.len();
                let made = self.variant(index, seed, &picks, is_first_seed && others <= 1);
                variants.extend(made.map_err(|found| problems.extend(found)).ok());
                if !problems.is_empty() && !is_first_seed {
                    break;
                }
            }
        }
        // A wrong value is wrong in every combination.
        problems.sort_by_key(|problem: &Problem| problem.to_string());
        problems.dedup();
        if problems.is_empty() {
            problems.extend(same_name(&variants));
        }
        if problems.is_empty() { Ok(variants) } else { Err(problems) }
    }

    /// The fields, and the index of their value in a combination.
    fn picks(&self, mut number: usize) -> Vec<(&Vary, usize)> {
        let mut picks: Vec<(&Vary, usize)> = (self.vary.iter().rev())
            .map(|vary| {
                let pick = number % vary.values.len();
                number /= vary.values.len();
                (vary, pick)
            })
            .collect();
        picks.reverse();
        picks
    }

    fn variant(
        &self,
        index: usize,
        seed: Option<u64>,
        picks: &[(&Vary, usize)],
        is_sample: bool,
    ) -> Result<Variant, Vec<Problem>> {
        let mut tree = self.scene.clone();
        let seed_set = seed.map(|seed| format!("seed={seed}"));
        let values = picks.iter().map(|(vary, pick)| format!("{}={}", vary.field, vary.values[*pick]));
        let assignments: Vec<String> = values.chain(seed_set).collect();
        let mut problems = Vec::new();
        for assignment in &assignments {
            if let Err(found) = tree.set(assignment) {
                problems.extend(
                    found
                        .into_iter()
                        .map(|problem| Problem { place: problem.place.replacen("--set", "--vary", 1), ..problem }),
                );
            }
        }
        let seed = seed.or_else(|| tree.to_value().get("seed")?.as_u64()).unwrap_or(1);
        let mut names = BTreeMap::from([("seed".to_owned(), seed.to_string()), ("index".into(), index.to_string())]);
        for (vary, pick) in picks {
            let value = file_name_of(&vary.values[*pick]);
            names.insert(vary.field.clone(), value.clone());
            if let Some((_, last)) = vary.field.rsplit_once('.') {
                names.entry(last.to_owned()).or_insert(value);
            }
        }
        match fill_in(self.output, &names) {
            Ok(output) if problems.is_empty() => {
                Ok(Variant { index, tree, assignments, output: output.into(), is_sample })
            }
            Ok(_) => Err(problems),
            Err(problem) => {
                problems.push(problem);
                Err(problems)
            }
        }
    }
}

/// A value as a part of a file's name.
fn file_name_of(value: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "._-+".contains(c) { c } else { '-' };
    value.trim_matches('"').chars().map(plain).collect()
}

/// Digits of a padded number at most.
const MOST_DIGITS: usize = 20;

/// The output path with its placeholders replaced: `{seed}`, or `{seed:04}` with zeros before it.
fn fill_in(template: &str, names: &BTreeMap<String, String>) -> Result<String, Problem> {
    let place = format!("-o {template}");
    let known = || names.keys().map(|name| format!("{{{name}}}")).collect::<Vec<_>>().join(", ");
    let mut path = String::new();
    let mut rest = template;
    while let Some((before, after)) = rest.split_once('{') {
        let Some((name, behind)) = after.split_once('}') else {
            return Err(Problem::new(place, "a `{` is not closed", format!("Available: {}.", known())));
        };
        let (name, width) = name.split_once(':').map_or((name, None), |(name, width)| (name, Some(width)));
        let Some(value) = names.get(name) else {
            return Err(Problem::new(place, format!("there is no {{{name}}}"), format!("Available: {}.", known())));
        };
        path.push_str(before);
        match width.map(|width| (width.strip_prefix('0').unwrap_or_default(), width)) {
            None => path.push_str(value),
            Some((digits, _)) if digits.parse().is_ok_and(|digits: usize| (1..=MOST_DIGITS).contains(&digits)) => {
                let digits = digits.parse().unwrap_or(1);
                path.push_str(&format!("{value:0>digits$}"));
            }
            Some((_, width)) => {
                let what = format!("{{{name}:{width}}} has no width that is known");
                return Err(Problem::new(
                    place,
                    what,
                    format!("Write {{{name}:04}} for four digits, with zeros before."),
                ));
            }
        }
        rest = behind;
    }
    path.push_str(rest);
    match Format::of(Path::new(&path)) {
        Some(_) => Ok(path),
        None => Err(Problem::new(place, "the format is unknown", format!("End the name in {}.", Format::endings()))),
    }
}

/// Two variants that would write the same file.
fn same_name(variants: &[Variant]) -> Option<Problem> {
    let mut known = BTreeMap::new();
    variants.iter().find_map(|variant| {
        let other: &Variant = known.insert(&variant.output, variant)?;
        let what = format!("written by two variants ({} and {})", description(other), description(variant));
        let remedy = "Put {seed}, {index} or names of varied fields into -o: out/{seed}-{accuracy}.glb.";
        Some(Problem::at(&variant.output, what, remedy))
    })
}

fn description(variant: &Variant) -> String {
    match &variant.assignments[..] {
        [] => format!("number {}", variant.index),
        assignments => assignments.join(" "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix(seeds: &str, vary: &[&str], output: &str) -> Result<Vec<Variant>, Vec<Problem>> {
        let vary: Vec<Vary> = vary.iter().map(|text| text.parse().unwrap()).collect();
        let seeds = seeds.parse().unwrap();
        Matrix { scene: &SceneTree::default(), seeds: Some(&seeds), vary: &vary, output }.variants()
    }

    #[test]
    fn every_seed_with_every_combination() {
        let vary = ["accuracy=draft,standard", "fill.count=10,20"];
        let variants = matrix("4..5,9,4", &vary, "{seed}-{accuracy}-{count}.glb").unwrap();
        let names: Vec<_> = variants.iter().map(|variant| variant.output.to_str().unwrap()).collect();
        assert_eq!(variants.len(), 12);
        assert_eq!(
            names[..5],
            ["4-draft-10", "4-draft-20", "4-standard-10", "4-standard-20", "5-draft-10"]
                .map(|name| format!("{name}.glb"))
        );
        assert_eq!(variants[4].assignments, ["accuracy=draft", "fill.count=10", "seed=5"]);
        let samples: Vec<_> =
            variants.iter().filter(|variant| variant.is_sample).map(|variant| variant.index).collect();
        assert_eq!(samples, [0, 1, 2]);
    }

    #[test]
    fn numbers_are_padded() {
        let variants = matrix("9..10", &["accuracy=draft"], "{seed:04}-{accuracy}-{index:02}.glb").unwrap();
        let names: Vec<_> = variants.iter().map(|variant| variant.output.to_str().unwrap()).collect();
        assert_eq!(names, ["0009-draft-00.glb", "0010-draft-01.glb"]);
    }

    #[test]
    fn values_may_have_commas_in_them() {
        let vary: Vary = "bodies.0.translation=[0,1,0],[0,2.5,0]".parse().unwrap();
        assert_eq!(vary.values, ["[0, 1, 0]", "[0, 2.5, 0]"]);
        let vary: Vary = "control_mesh.path=a/one.glb, two.glb".parse().unwrap();
        assert_eq!(vary.values, ["a/one.glb", "two.glb"]);
        assert_eq!(file_name_of("a/one.glb"), "a-one.glb");
    }

    #[test]
    fn all_problems_are_reported_once() {
        let problems = matrix("0..9", &["acuracy=draft", "fill.count=many"], "{seed}.glb").unwrap_err();
        assert_eq!(problems.len(), 2, "{problems:?}");
        assert!(problems.iter().all(|problem| problem.place.starts_with("--vary")), "{problems:?}");
        let wrong = |seeds, vary, output| matrix(seeds, vary, output).unwrap_err()[0].to_string();
        assert!(wrong("0..1", &[], "pile.glb").contains("two variants (seed=0 and seed=1)"));
        assert!(wrong("0..1", &[], "{sed}.glb").contains("{index}, {seed}"));
        assert!(wrong("0..1", &[], "{seed}.obj").contains("the format is unknown"));
        for width in ["4", "0", "0x", "099", ""] {
            let output = format!("{{seed:{width}}}.glb");
            let text = matrix("0..1", &[], &output).unwrap_err()[0].to_string();
            assert!(text.contains("has no width that is known") && text.contains("{seed:04}"), "{text}");
        }
        assert!(wrong("0..999999", &[], "{seed}.glb").contains("more than"));
        assert!("9..4".parse::<Seeds>().is_err() && "a".parse::<Seeds>().is_err() && "7-3".parse::<Span>().is_err());
    }
}
