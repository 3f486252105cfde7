//! What a catalogue file says: props, places, and what a layout may have. TOML. Long: types, checks and their tests.

use cairn_files::problem::{Problem, nearest};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Most bodies of one layout: small piles at scale, not large ones.
pub const MOST_BODIES: u32 = 500;

/// A camera is no farther than this along each axis, m.
const FARTHEST: f64 = 1e4;

/// Of bodies at rest with this friction, MuJoCo moves none by 2 mm in 2 s, where bricks and bananas lie in a bin; with
/// 0.1, in an eighth of the layouts; with 0.7, in all: its contacts creep by a millimeter a second for each tenth of
/// its weight that a body leans on friction.
const SETTLE_FRICTION: f64 = 0.05;

/// A catalogue as its file has it, folders replaced by the models in them.
#[derive(Clone, Debug)]
pub struct Catalogue {
    /// Its file's folder, from which paths are.
    pub folder: PathBuf,
    pub settings: Settings,
    pub props: Vec<PropEntry>,
    pub places: Vec<PlaceEntry>,
}

/// What holds for all layouts.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Layouts of another seed are others.
    pub seed: Option<u64>,
    /// Preset of shapes and engine, as a scene's `accuracy`.
    pub accuracy: Option<String>,
    /// m/s^2.
    pub gravity: Option<f64>,
    /// Largest friction while bodies settle; then they have their own. Bodies that hardly lean on their friction stay
    /// in engines whose friction yields, as MuJoCo's does.
    pub settle_friction: Option<f64>,
    /// Bodies of a layout.
    pub count: Option<Span>,
    /// How bodies begin; of several, each layout draws one.
    pub arrangement: Option<OneOrMore<Arrangement>>,
    /// Which way up they begin; of several, each layout draws one.
    pub pose: Option<OneOrMore<StartPose>>,
    /// One body of each layout that is looked for.
    pub target: Option<Target>,
    /// From where layouts are looked at.
    pub camera: Option<CameraEntry>,
    /// Mean share of a body's outline, as the camera sees it, that others hide.
    pub overlap: Option<Span>,
    /// How often a layout is drawn again at most.
    pub attempts: Option<u32>,
}

/// Props: a model, or a folder of models.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PropEntry {
    /// A model's file, a node or prim of it, or a folder; from the catalogue's folder.
    pub path: String,
    /// What it is called in lines; its file or node, if it is not given.
    pub label: Option<String>,
    /// How often it is drawn, relative to the others.
    pub weight: Option<f64>,
    pub friction: Option<f64>,
    /// kg/m^3.
    pub density: Option<f64>,
    pub restitution: Option<f64>,
    pub scale_min: Option<f64>,
    pub scale_max: Option<f64>,
    /// Of the model, for the data card.
    pub license: Option<String>,
}

/// A place.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceEntry {
    /// A model's file, or a node or prim of it, where the file places it; from the catalogue's folder.
    pub path: String,
    pub label: Option<String>,
    /// How often it is drawn, relative to the others.
    pub weight: Option<f64>,
    pub friction: Option<f64>,
    /// Bodies of a layout here, instead of the catalogue's.
    pub count: Option<Span>,
    /// Instead of a count: share of the place's inside that the bodies fill, to its rim.
    pub level: Option<Span>,
    /// Instead of the catalogue's.
    pub camera: Option<CameraEntry>,
    pub license: Option<String>,
}

/// A pinhole in the place's frame. What is left out is chosen so that all of the place is in the picture, from above at
/// a slant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraEntry {
    /// m.
    pub position: Option<[f64; 3]>,
    /// What is in the middle of the picture, m.
    pub look_at: Option<[f64; 3]>,
    /// Vertical, degrees.
    pub field_of_view: Option<f64>,
}

/// One body that is looked for.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// Of its prop.
    pub label: String,
    /// Bodies that have to leave before it can: those that rest on it.
    pub covered_by: Option<Span>,
    /// Share of its outline, as the camera sees it, that is seen past other bodies and the place.
    pub visible: Option<Span>,
}

/// How bodies begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Arrangement {
    /// Each as low as it finds room, all over the place.
    Scattered,
    /// One on the other, about the middle.
    Heaped,
    /// In stacks, flat sides down.
    Stacked,
}

/// Which way up bodies begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StartPose {
    /// Any rotation.
    Any,
    /// Their own y axis up, turned at random.
    Upright,
    /// Their flattest side down, turned at random.
    Flat,
}

/// A number, or a smallest and a largest one.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Span {
    One(f64),
    Two([f64; 2]),
}

impl Span {
    pub fn ends(self) -> [f64; 2] {
        match self {
            Span::One(one) => [one; 2],
            Span::Two(two) => two,
        }
    }

    pub fn holds(self, value: f64) -> bool {
        let [least, most] = self.ends();
        (least..=most).contains(&value)
    }
}

/// A value, or a list of them.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum OneOrMore<T> {
    One(T),
    More(Vec<T>),
}

impl<T: Clone> OneOrMore<T> {
    pub fn all(&self) -> Vec<T> {
        match self {
            OneOrMore::One(one) => vec![one.clone()],
            OneOrMore::More(more) => more.clone(),
        }
    }
}

const SETTINGS: &[&str] = &[
    "seed",
    "accuracy",
    "gravity",
    "settle_friction",
    "count",
    "arrangement",
    "pose",
    "target",
    "camera",
    "overlap",
    "attempts",
    "props",
    "places",
];
const TARGET: &[&str] = &["label", "covered_by", "visible"];
const CAMERA: &[&str] = &["position", "look_at", "field_of_view"];
const PROP: &[&str] =
    &["path", "label", "weight", "friction", "density", "restitution", "scale_min", "scale_max", "license"];
const PLACE: &[&str] = &["path", "label", "weight", "friction", "count", "level", "camera", "license"];

impl Catalogue {
    /// Reads a catalogue, or returns all its problems.
    pub fn read(path: &Path) -> Result<Catalogue, Vec<Problem>> {
        let bytes = cairn_files::read(path).map_err(|problem| vec![problem])?;
        let text = String::from_utf8(bytes).map_err(|_| {
            vec![Problem::at(path, "it is not text", "Name a catalogue in TOML, with [[props]] and [[places]].")]
        })?;
        Catalogue::parse(path, &text)
    }

    /// `path`: of the file that has this text.
    pub fn parse(path: &Path, text: &str) -> Result<Catalogue, Vec<Problem>> {
        let mut table: toml::Table = text.parse().map_err(|error: toml::de::Error| {
            vec![Problem::at(path, format!("not TOML: {}", error.message()), "Correct the text.")]
        })?;
        let mut found = Found { path, problems: Vec::new() };
        found.names("", &table, SETTINGS);
        let mut list = |name: &str| match table.remove(name) {
            Some(toml::Value::Array(list)) => list,
            Some(_) => vec![toml::Value::Boolean(false)],
            None => Vec::new(),
        };
        let (props, places) = (list("props"), list("places"));
        let props: Vec<PropEntry> = found.entries("props", props, PROP);
        let places: Vec<PlaceEntry> = found.entries("places", places, PLACE);
        for (name, known) in [("target", TARGET), ("camera", CAMERA)] {
            if let Some(toml::Value::Table(inner)) = table.get(name) {
                found.names(name, inner, known);
            }
        }
        table.retain(|name, _| SETTINGS.contains(&name));
        let settings: Settings = found.value("", toml::Value::Table(table)).unwrap_or_default();
        let folder = cairn_files::folder_of(path).to_owned();
        let props: Vec<PropEntry> =
            props.into_iter().enumerate().flat_map(|(i, entry)| found.models(&folder, i, entry)).collect();
        let catalogue = Catalogue { folder, settings, props, places };
        found.check(&catalogue);
        if found.problems.is_empty() { Ok(catalogue) } else { Err(found.problems) }
    }

    pub fn seed(&self) -> u64 {
        self.settings.seed.unwrap_or(1)
    }

    pub fn settle_friction(&self) -> f64 {
        self.settings.settle_friction.unwrap_or(SETTLE_FRICTION)
    }

    /// Whether it asks for what a camera sees.
    pub fn is_looked_at(&self) -> bool {
        let Settings { camera, overlap, target, .. } = &self.settings;
        let is_target_seen = target.as_ref().is_some_and(|target| target.visible.is_some());
        is_target_seen
            || overlap.is_some()
            || camera.is_some()
            || self.places.iter().any(|place| place.camera.is_some())
    }

    pub fn attempts(&self) -> u32 {
        self.settings.attempts.unwrap_or(20)
    }
}

/// The problems of a catalogue so far.
struct Found<'a> {
    path: &'a Path,
    problems: Vec<Problem>,
}

impl Found<'_> {
    fn problem(&mut self, field: &str, what: impl Into<String>, remedy: impl Into<String>) {
        let place = if field.is_empty() { String::new() } else { format!(": {field}") };
        let place = format!("{}{place}", self.path.display());
        self.problems.push(Problem::new(place, what, remedy).of_field(field));
    }

    /// Names that are none of those.
    fn names(&mut self, field: &str, table: &toml::Table, known: &[&str]) {
        for name in table.keys().filter(|name| !known.contains(&name.as_str())) {
            let remedy = match nearest(name, known.iter().copied()) {
                Some(near) => format!("Did you mean {near}?"),
                None => format!("Known are {}.", known.join(", ")),
            };
            let place = if field.is_empty() { name.clone() } else { format!("{field}.{name}") };
            self.problem(&place, "a catalogue has no such field", remedy);
        }
    }

    fn value<T: DeserializeOwned>(&mut self, field: &str, value: toml::Value) -> Option<T> {
        match value.try_into() {
            Ok(value) => Some(value),
            Err(error) => {
                let what = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
                self.problem(field, what, "See `examples/guide/clutter.md` for what it may be.");
                None
            }
        }
    }

    fn entries<T: DeserializeOwned>(&mut self, name: &str, list: Vec<toml::Value>, known: &[&str]) -> Vec<T> {
        let mut entries = Vec::new();
        for (i, entry) in list.into_iter().enumerate() {
            let field = format!("{name}.{i}");
            match entry {
                toml::Value::Table(mut table) => {
                    self.names(&field, &table, known);
                    table.retain(|name, _| known.contains(&name));
                    entries.extend(self.value(&field, toml::Value::Table(table)));
                }
                _ => self.problem(&field, "it is not a table", format!("Write [[{name}]], and below it its fields.")),
            }
        }
        entries
    }

    /// An entry for each model of a folder, by name; one that is no folder stays.
    fn models(&mut self, folder: &Path, number: usize, entry: PropEntry) -> Vec<PropEntry> {
        let inside = folder.join(&entry.path);
        if !inside.is_dir() {
            return vec![entry];
        }
        let files = inside.read_dir().into_iter().flatten().flatten().map(|file| file.path());
        let mut files: Vec<PathBuf> = files.filter(|file| cairn_files::is_model_file(file)).collect();
        files.sort();
        if files.is_empty() {
            self.problem(&format!("props.{number}.path"), "no model is in this folder", "Name a folder of models.");
        }
        let path = |file: &Path| match (file.file_name(), entry.path.trim_end_matches('/')) {
            (Some(name), base) => format!("{base}/{}", name.to_string_lossy()),
            (None, base) => base.to_owned(),
        };
        files.iter().map(|file| PropEntry { path: path(file), label: None, ..entry.clone() }).collect()
    }

    fn check(&mut self, catalogue: &Catalogue) {
        let Catalogue { settings, props, places, .. } = catalogue;
        let is_read = self.problems.is_empty();
        if props.is_empty() && is_read {
            self.problem("props", "there are none", "Add [[props]] with a path.");
        }
        if places.is_empty() && is_read {
            self.problem("places", "there are none", "Add [[places]] with the path of a tray, bin, shelf or table.");
        }
        let none = |weights: Vec<Option<f64>>| weights.iter().all(|weight| *weight == Some(0.0));
        if !props.is_empty() && none(props.iter().map(|prop| prop.weight).collect()) {
            self.problem("props", "all have the weight 0", "Give one of them a weight.");
        }
        if !places.is_empty() && none(places.iter().map(|place| place.weight).collect()) {
            self.problem("places", "all have the weight 0", "Give one of them a weight.");
        }
        let most = f64::from(MOST_BODIES);
        self.span("count", settings.count, [1.0, most], true);
        self.span("attempts", settings.attempts.map(|n| Span::One(n.into())), [1.0, 1000.0], true);
        self.span("overlap", settings.overlap, [0.0, 1.0], false);
        self.camera("camera", settings.camera);
        self.span("settle_friction", settings.settle_friction.map(Span::One), [0.0, 2.0], false);
        self.span("seed", settings.seed.map(|n| Span::One(n as f64)), [0.0, 1e15], true);
        for (i, place) in places.iter().enumerate() {
            self.span(&format!("places.{i}.count"), place.count, [1.0, most], true);
            self.span(&format!("places.{i}.level"), place.level, [0.001, 1.0], false);
            self.camera(&format!("places.{i}.camera"), place.camera);
            self.span(&format!("places.{i}.weight"), place.weight.map(Span::One), [0.0, 1e9], false);
            if place.count.is_some() && place.level.is_some() {
                let remedy = "Leave one of them out.";
                self.problem(&format!("places.{i}.level"), "there is a count, too", remedy);
            }
        }
        for (name, list) in [
            ("arrangement", settings.arrangement.as_ref().map(|all| all.all().len())),
            ("pose", settings.pose.as_ref().map(|all| all.all().len())),
        ] {
            if list == Some(0) {
                self.problem(name, "the list is empty", "Give at least one, or leave it out.");
            }
        }
        if let Some(target) = &settings.target {
            self.span("target.covered_by", target.covered_by, [0.0, most], true);
            self.span("target.visible", target.visible, [0.0, 1.0], false);
            let labels: Vec<String> = props.iter().map(PropEntry::label).collect();
            if !labels.contains(&target.label) && !props.is_empty() {
                let remedy = match nearest(&target.label, labels.iter().map(String::as_str)) {
                    Some(near) => format!("Did you mean {near}?"),
                    None => format!("Name one of {}.", labels.join(", ")),
                };
                self.problem("target.label", format!("no prop has the label {}", target.label), remedy);
            }
        }
    }

    fn camera(&mut self, field: &str, camera: Option<CameraEntry>) {
        let Some(CameraEntry { position, look_at, field_of_view }) = camera else { return };
        self.span(&format!("{field}.field_of_view"), field_of_view.map(Span::One), [1.0, 150.0], false);
        for (name, point) in [("position", position), ("look_at", look_at)] {
            if point.is_some_and(|point| !point.iter().all(|value| value.abs() <= FARTHEST)) {
                let remedy =
                    format!("Give three numbers from {} to {FARTHEST}, meters in the place's frame.", -FARTHEST);
                self.problem(&format!("{field}.{name}"), "it is too far away", remedy);
            }
        }
        if position.is_some() && position == look_at {
            let remedy = "Move the position away from what the camera looks at.";
            self.problem(&format!("{field}.position"), "the camera looks at its own place", remedy);
        }
    }

    fn span(&mut self, field: &str, span: Option<Span>, [least, most]: [f64; 2], is_whole: bool) {
        let Some([low, high]) = span.map(Span::ends) else { return };
        let whole = if is_whole { "whole numbers" } else { "numbers" };
        let is_right = |n: f64| (least..=most).contains(&n) && (!is_whole || n.fract() == 0.0);
        if !is_right(low) || !is_right(high) {
            let remedy = format!("Give {whole} from {least} to {most}: one, or a smallest and a largest.");
            self.problem(field, format!("{} is out of range", if is_right(low) { high } else { low }), remedy);
        } else if low > high {
            self.problem(field, format!("{low} comes after {high}"), "Give the smaller number first.");
        }
    }
}

/// The name of a node, or of a file without its ending.
fn name_of(path: &str) -> String {
    let (file, node) = cairn_files::split_node(path);
    let last = |text: &str| text.rsplit(['/', '\\']).next().unwrap_or(text).to_owned();
    match node {
        Some(node) => last(node),
        None => last(file).split('.').next().unwrap_or(file).to_owned(),
    }
}

impl PropEntry {
    pub fn label(&self) -> String {
        self.label.clone().unwrap_or_else(|| name_of(&self.path))
    }
}

impl PlaceEntry {
    pub fn label(&self) -> String {
        self.label.clone().unwrap_or_else(|| name_of(&self.path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Catalogue, Vec<Problem>> {
        Catalogue::parse(Path::new("kit/catalogue.toml"), text)
    }

    #[test]
    fn a_catalogue_is_read() {
        let text = "count = [4, 9]\npose = \"any\"\narrangement = [\"heaped\", \"stacked\"]\n\
                    [[props]]\npath = \"a/brick.glb\"\n[[props]]\npath = \"kit.glb#Cup\"\nlabel = \"cup\"\n\
                    [[places]]\npath = \"bin.glb\"\nlevel = 0.5\n";
        let catalogue = parse(text).unwrap();
        assert_eq!(catalogue.settings.count.unwrap().ends(), [4.0, 9.0]);
        assert_eq!(catalogue.settings.arrangement.as_ref().unwrap().all(), [Arrangement::Heaped, Arrangement::Stacked]);
        let labels: Vec<String> = catalogue.props.iter().map(PropEntry::label).collect();
        assert_eq!(labels, ["brick", "cup"]);
        assert_eq!(catalogue.places[0].level.unwrap().ends(), [0.5, 0.5]);
        assert_eq!(catalogue.folder, Path::new("kit"));
    }

    #[test]
    fn all_problems_are_reported_at_once() {
        let text = "count = [9, 4]\nsed = 3\n[target]\nlabel = \"brik\"\ncovered_by = 0.5\n\
                    [[props]]\npath = \"brick.glb\"\nwieght = 2\n[[props]]\npath = 3\n\
                    [[places]]\npath = \"bin.glb\"\nlevel = 0.5\ncount = 0\n";
        let problems: Vec<String> = parse(text).unwrap_err().iter().map(Problem::to_string).collect();
        for words in [
            "kit/catalogue.toml: count: 9 comes after 4",
            "sed: a catalogue has no such field. Did you mean seed?",
            "target.label: no prop has the label brik. Did you mean brick?",
            "target.covered_by: 0.5 is out of range",
            "props.0.wieght: a catalogue has no such field. Did you mean weight?",
            "props.1: ",
            "places.0.level: there is a count, too",
            "places.0.count: 0 is out of range",
        ] {
            assert!(problems.iter().any(|problem| problem.contains(words)), "{words}: {problems:#?}");
        }
        assert_eq!(problems.len(), 8, "{problems:#?}");
        let text = format!("[[props]]\npath = '{}/src'\n[[places]]\npath = \"bin.glb\"", env!("CARGO_MANIFEST_DIR"));
        assert!(parse(&text).unwrap_err()[0].to_string().contains("no model is in this folder"));
        assert!(parse("a = ").unwrap_err()[0].to_string().contains("not TOML"));
        assert_eq!(parse("").unwrap_err().len(), 2);
    }
}
