//! The arguments that describe a scene, for all commands: a scene file, flags, or both.

use super::allowed::AllowArgs;
use super::{Failure, output};
use cairn_export::Format;
use cairn_files::fence::Fence;
use cairn_files::problem::Problem;
use cairn_files::{is_model_file, split_node};
use cairn_job::provenance;
use cairn_wire::scene_file::SceneTree;
use cairn_wire::to_proto;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

#[derive(Clone, clap::Args)]
pub struct SceneArgs {
    /// Scene file (.toml or .json), as written by `cairn scene`, or a result (.glb, .json, .usdc, .usda, .usdz), which
    /// holds its scene; - is a scene file on the standard input. The flags below override it
    pub scene: Option<PathBuf>,

    /// Closed mesh that the pile fills: a .glb or .gltf file, or one node of it (shapes.glb#Dome), or a USD file or
    /// prim of it (shapes.usd#/Dome); repeat it for several piles that lean on each other
    #[arg(long, value_name = "FILE[#NODE]", help_heading = "Scene")]
    control: Vec<String>,

    /// Prop of the pile; repeat it for several. The weight is its frequency relative to the others [default: 1]
    #[arg(long = "prop", value_name = "FILE[#NODE][:WEIGHT]", help_heading = "Scene")]
    props: Vec<String>,

    /// Scenery that never moves, at its location in its file; repeat it for several
    #[arg(long = "static", value_name = "FILE[#NODE]", help_heading = "Scene")]
    statics: Vec<String>,

    /// Result of an earlier bake (.glb or USD) to build around: its bodies stand as in its last frame; repeat it for
    /// several
    #[arg(long, value_name = "FILE", help_heading = "Scene")]
    around: Vec<String>,

    /// Result of an earlier bake (.glb) that this one changes: bodies with nothing new near them stay where they lie
    #[arg(long, value_name = "FILE", help_heading = "Scene")]
    from: Option<String>,

    /// Accuracy preset; `paper` is the method's original setting, `standard` the default. `auto` chooses one by `goal`
    #[arg(long, value_parser = accuracy_names(), help_heading = "Scene")]
    accuracy: Option<String>,

    /// Seed of the random numbers: the same seed gives the same pile [default: 1]
    #[arg(long, value_parser = clap::value_parser!(i64).range(0..), help_heading = "Scene")]
    seed: Option<i64>,

    /// Frames after the first [default: until the pile is at rest]
    #[arg(long, value_parser = clap::value_parser!(i32).range(0..), help_heading = "Scene")]
    frames: Option<i32>,

    /// Frames per second [default: 24]
    #[arg(long, help_heading = "Scene")]
    fps: Option<f64>,

    /// Set any field of the scene, such as fill.count=200, control=off or props.0.density=700; repeat it for several
    #[arg(long, value_name = "FIELD=VALUE", help_heading = "Scene")]
    set: Vec<String>,

    /// Folder of the files of a result that is given as the scene; folders below it are searched [default: its own
    /// folder, one above it, the current one]
    #[arg(long, value_name = "FOLDER", help_heading = "Scene")]
    assets: Option<PathBuf>,

    #[command(flatten)]
    allow: AllowArgs,
}

/// The names of the accuracies. They are never freed, because clap takes only static text.
fn accuracy_names() -> Vec<&'static str> {
    let presets = to_proto::accuracies().into_iter().map(|accuracy| &*to_proto::accuracy_name(accuracy).leak());
    presets.chain([AUTO]).collect()
}

/// The accuracy that a goal chooses.
const AUTO: &str = "auto";

/// Whether a path names a result instead of a scene file. A `.json` may be either.
pub fn is_result(path: &Path) -> bool {
    match Format::of(path) {
        Some(Format::Json) => cairn_files::read(path).is_ok_and(|bytes| provenance::origin(&bytes).is_some()),
        format => format.is_some_and(Format::states_origin),
    }
}

/// The scene file on the standard input, read once. Its paths are relative to the current folder.
fn from_stdin() -> Result<SceneTree, Failure> {
    static CONTENT: OnceLock<Result<Vec<u8>, String>> = OnceLock::new();
    let read = || {
        let (mut bytes, mut input) = (Vec::new(), std::io::stdin().lock().take(MOST_STDIN));
        input.read_to_end(&mut bytes).map(|_| bytes).map_err(|error| error.to_string())
    };
    let bytes = CONTENT
        .get_or_init(read)
        .as_ref()
        .map_err(|error| Failure::input(Problem::new("the standard input", error.clone(), "Name a scene file.")))?;
    let is_json = bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{');
    let name = if is_json { "stdin.json" } else { "stdin.toml" };
    SceneTree::read(Path::new(name), bytes).map_err(Failure::Input)
}

/// The largest scene on the standard input, bytes, as of a scene file.
const MOST_STDIN: u64 = 1 << 30;

impl SceneArgs {
    /// With one more field set, over all others.
    pub fn with(&self, assignment: String) -> SceneArgs {
        let set = self.set.iter().cloned().chain([assignment]).collect();
        SceneArgs { set, ..self.clone() }
    }

    /// The scene file, then the flags, then `--set`, each over what came before.
    pub fn tree(&self) -> Result<SceneTree, Failure> {
        self.read(self.allow.is_strict())
    }

    /// The same, of which only some files may be read: to send them.
    pub fn tree_to_send(&self) -> Result<SceneTree, Failure> {
        self.read(true)
    }

    fn read(&self, is_fenced: bool) -> Result<SceneTree, Failure> {
        let own = self.own()?;
        let given = cairn_job::model_files(&own.to_message());
        let tree = self.over(own)?;
        if !is_fenced {
            return Ok(tree);
        }
        // The folder of a result is that in which its files were found, which may be any.
        let home = match &self.scene {
            Some(path) if is_result(path) => cairn_files::folder_of(path),
            _ => tree.folder(),
        };
        let flags = [&self.control, &self.props, &self.statics, &self.around].into_iter().flatten().chain(&self.from);
        let flags = flags.map(|path| split_weight(path).map_or(&**path, |(path, _)| path));
        let flags = flags.map(|path| PathBuf::from(split_node(path).0));
        let set = cairn_job::model_files(&tree.to_message()).into_iter().filter(|path| !given.contains(path));
        let named: Vec<PathBuf> = flags.chain(set).collect();
        let others: Vec<PathBuf> = self.allow.folders()?.into_iter().chain(self.assets.clone()).collect();
        let fence = Fence::new(home, &others, named);
        Ok(tree.fenced(fence))
    }

    /// The scene file.
    fn own(&self) -> Result<SceneTree, Failure> {
        Ok(match &self.scene {
            Some(path) if is_result(path) => provenance::scene(path, self.assets.as_deref()).map_err(Failure::Input)?,
            Some(path) if output::is_stdout(path) => from_stdin()?,
            Some(path) => SceneTree::load(path).map_err(Failure::Input)?,
            None if self.control.is_empty() && self.props.is_empty() && self.set.is_empty() => {
                let remedy = "Give a scene file, or --control and --prop; see --help for examples.";
                return Err(Failure::usage("command line", "no scene is given", remedy));
            }
            None => SceneTree::default(),
        })
    }

    /// The flags, then `--set`, over a scene.
    fn over(&self, mut tree: SceneTree) -> Result<SceneTree, Failure> {
        let mut problems = Vec::new();
        match &*self.control {
            [] => {}
            [control] => tree.put("control_mesh", json!({ "path": control })),
            several => {
                let piles = several.iter().map(|path| json!({ "path": path })).collect();
                tree.put("piles", Value::Array(piles));
            }
        }
        if !self.around.is_empty() {
            let around = self.around.iter().map(|path| json!({ "path": path })).collect();
            tree.put("around", Value::Array(around));
        }
        if let Some(from) = &self.from {
            tree.put("from", json!({ "path": from }));
        }
        if !self.props.is_empty() {
            let props = self.props.iter().filter_map(|prop| {
                split_weight(prop).map_err(|problem| problems.push(problem)).ok().map(|(path, weight)| match weight {
                    Some(weight) => json!({ "path": path, "weight": weight }),
                    None => json!({ "path": path }),
                })
            });
            let props = props.collect();
            tree.put("props", Value::Array(props));
        }
        if !self.statics.is_empty() {
            let statics = self.statics.iter().map(|path| json!({ "path": path })).collect();
            tree.put("statics", Value::Array(statics));
        }
        if let Some(seed) = self.seed {
            tree.put("seed", seed.into());
        }
        if let Some(frames) = self.frames {
            tree.put_in("output", "frames", frames.into());
        }
        let accuracy = self.accuracy.iter().map(|accuracy| format!("accuracy={accuracy}"));
        let fps = self.fps.iter().map(|fps| format!("output.fps={fps:?}"));
        for assignment in accuracy.chain(fps).chain(self.set.iter().cloned()) {
            if let Err(found) = tree.set(&assignment) {
                problems.extend(found);
            }
        }
        if problems.is_empty() { Ok(tree) } else { Err(Failure::Usage(problems)) }
    }

    /// The arguments for another process.
    pub fn to_args(&self) -> Vec<OsString> {
        let given = |name: &str, value: &dyn ToString| [OsString::from(name), value.to_string().into()];
        let flag = |name: &'static str, values: &[String]| -> Vec<OsString> {
            values.iter().flat_map(|value| given(name, value)).collect()
        };
        let mut args: Vec<OsString> = self.scene.iter().map(|path| path.clone().into_os_string()).collect();
        args.extend(flag("--control", &self.control));
        args.extend(flag("--prop", &self.props));
        args.extend(flag("--static", &self.statics));
        args.extend(flag("--around", &self.around));
        args.extend(flag("--from", self.from.as_slice()));
        args.extend(flag("--accuracy", self.accuracy.as_slice()));
        args.extend(self.seed.iter().flat_map(|seed| given("--seed", seed)));
        args.extend(self.frames.iter().flat_map(|frames| given("--frames", frames)));
        args.extend(self.fps.iter().flat_map(|fps| given("--fps", fps)));
        args.extend(flag("--set", &self.set));
        args.extend(self.assets.iter().flat_map(|folder| ["--assets".into(), folder.clone().into_os_string()]));
        args.extend(self.allow.to_args());
        args
    }
}

/// `book.glb:0.3` -> path and weight. A number after the last colon is a weight. After a complete file name, anything
/// but a number is an error. The colon of a Windows drive (`C:\book.glb`) is neither.
fn split_weight(prop: &str) -> Result<(&str, Option<Value>), Problem> {
    let Some((path, weight)) = prop.rsplit_once(':') else { return Ok((prop, None)) };
    if let Ok(weight) = weight.parse::<f64>() {
        return Ok((path, Some(cairn_wire::scene_file::number(weight))));
    }
    if is_model_file(Path::new(path)) {
        let what = format!("the weight `{weight}` is not a number");
        return Err(Problem::new(format!("--prop {prop}"), what, "Write a number after the colon: book.glb:0.3."));
    }
    Ok((prop, None))
}

#[cfg(test)]
mod tests {
    use super::split_weight;
    use serde_json::json;

    #[test]
    fn a_weight_follows_the_last_colon() {
        assert_eq!(split_weight("book.glb:0.3"), Ok(("book.glb", Some(json!(0.3)))));
        assert_eq!(split_weight("kit.glb#Brick:2"), Ok(("kit.glb#Brick", Some(json!(2.0)))));
        assert_eq!(split_weight("book.glb:nan"), Ok(("book.glb", Some(json!("NaN")))));
        assert_eq!(split_weight("book.glb"), Ok(("book.glb", None)));
        assert!(split_weight("book.glb:heavy").is_err());
        assert!(split_weight("book.glb:").is_err());
    }

    #[test]
    fn a_drive_is_not_a_weight() {
        assert_eq!(split_weight(r"C:\kit\book.glb"), Ok((r"C:\kit\book.glb", None)));
        assert_eq!(split_weight(r"C:\kit\book.glb:0.3"), Ok((r"C:\kit\book.glb", Some(json!(0.3)))));
        assert_eq!(split_weight("C:/book.glb#A:b"), Ok(("C:/book.glb#A:b", None)));
    }
}
