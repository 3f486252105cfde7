//! What the tools take and give. Comments are what agents read.

use super::command::Call;
use rmcp::schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::path::Path;

/// A scene: a file, or meshes by their paths, or both
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct SceneArgs {
    /// Scene file (.toml or .json), or a result, which holds its scene; the other fields override it
    #[serde(default)]
    pub scene: Option<String>,
    /// Closed meshes that the pile fills: .glb, .gltf or USD, one node of a file as shapes.glb#Dome
    #[serde(default)]
    pub control: Vec<String>,
    /// Props, as file, file#node or file:weight
    #[serde(default)]
    pub props: Vec<String>,
    /// Scenery that does not move
    #[serde(default)]
    pub statics: Vec<String>,
    /// draft, preview, standard, fine, reference or paper
    #[serde(default)]
    pub accuracy: Option<String>,
    /// The same seed gives the same pile
    #[serde(default)]
    pub seed: Option<u64>,
    /// Fields of the scene as FIELD=VALUE, such as fill.count=200 or control=off
    #[serde(default)]
    pub set: Vec<String>,
}

impl SceneArgs {
    /// The call of a command for this scene.
    pub fn call(&self, command: &str) -> Result<Call, String> {
        let call = Call::new(command).flag("--only-allowed");
        let call = match self.scene.as_deref() {
            // It would be read from the client's messages.
            Some("-") => return Err("scene: - is no scene here; name a file".into()),
            Some(path) => call.positional(path),
            None => call,
        };
        Ok(call
            .each("--control", &self.control)
            .each("--prop", &self.props)
            .each("--static", &self.statics)
            .each("--accuracy", &self.accuracy)
            .each("--seed", self.seed)
            .each("--set", &self.set))
    }
}

/// A problem, and what to do about it
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct FoundProblem {
    /// The field of the scene
    #[serde(default)]
    pub field: String,
    /// A file, with a line, a node or a field
    #[serde(default)]
    pub place: String,
    pub what: String,
    #[serde(default)]
    pub remedy: String,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct CheckResult {
    /// The scene can be baked
    pub ok: bool,
    pub problems: Vec<FoundProblem>,
    pub notes: Vec<String>,
    pub plan: Option<PlannedBake>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct PlannedBake {
    pub expected_bodies: usize,
    pub expected_steps: usize,
    /// Median, m
    pub prop_diameter: f64,
    pub warnings: Vec<String>,
    #[serde(flatten)]
    pub more: Map<String, Value>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct PlanResult {
    pub notes: Vec<String>,
    pub plan: PlannedBake,
    /// Of each accuracy
    pub estimates: Vec<Map<String, Value>>,
    /// Bytes of a result at most, by format
    pub most_result_bytes: Map<String, Value>,
    /// Cores, seconds and bytes of memory, as expected and as nine of ten bakes stay below
    pub resources: Option<Map<String, Value>>,
}

#[derive(Debug, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct BakeArgs {
    #[serde(flatten)]
    pub scene: SceneArgs,
    /// Result: .glb, .usdc, .usda, .usdz, .json, .csv, .xml (MuJoCo), .physics.glb, .hulls.glb or .pack.zip;
    /// below the server's folder; replaced if it is there
    pub output: String,
    /// Also write all figures there, as .json below the server's folder; replaces an earlier report alone
    #[serde(default)]
    pub report: Option<String>,
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct BakeResult {
    pub result: String,
    pub bodies: u64,
    /// Figures by name: kept_shape (1 is best), resting_speed_max_rel (below 0.01: at rest), hanging (0 is best), ...
    pub measures: Map<String, Value>,
    pub counts: Map<String, Value>,
    pub warnings: Vec<String>,
}

impl BakeResult {
    pub fn read(result: &str, report: &Path, mut warnings: Vec<String>) -> Result<BakeResult, String> {
        #[derive(Deserialize)]
        struct Report {
            bodies: u64,
            measures: Map<String, Value>,
            counts: Map<String, Value>,
        }
        let bytes = std::fs::read(report).map_err(|error| format!("the report cannot be read: {error}"))?;
        let Report { bodies, measures, counts } =
            serde_json::from_slice(&bytes).map_err(|error| format!("the report cannot be read: {error}"))?;
        warnings.dedup();
        Ok(BakeResult { result: result.into(), bodies, measures, counts, warnings })
    }
}

#[derive(Debug, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
pub struct RenderArgs {
    /// The pile: .glb, .gltf or USD
    pub pile: String,
    /// Picture: .png or .jpg, below the server's folder; replaced if it is there
    pub output: String,
    /// From 0; the last one unless given
    #[serde(default)]
    pub frame: Option<u64>,
    /// As 640x480
    #[serde(default)]
    pub size: Option<String>,
    /// Degrees around the pile
    #[serde(default)]
    pub azimuth: Option<f64>,
    /// Degrees above the horizon
    #[serde(default)]
    pub elevation: Option<f64>,
    /// Mesh to show as frosted glass, such as the control mesh
    #[serde(default)]
    pub control: Option<String>,
    /// Show the dots of glue
    #[serde(default)]
    pub glue: bool,
}

impl RenderArgs {
    pub fn call(&self) -> Call {
        let call = Call::new("render")
            .flag("--only-allowed")
            .option("--output", &self.output)
            .each("--frame", self.frame)
            .option("--size", self.size.as_deref().unwrap_or("640x480"))
            .each("--azimuth", self.azimuth)
            .each("--elevation", self.elevation)
            .each("--control", &self.control)
            .positional(&self.pile);
        if self.glue { call.flag("--glue") } else { call }
    }
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct PictureResult {
    pub picture: String,
}

#[derive(Debug, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
pub struct RankArgs {
    /// Folder of results with reports
    pub folder: String,
    /// Figures to sort by, largest first, or smallest first as FIGURE:least
    #[serde(default)]
    pub by: Vec<String>,
    /// Only the first ones, this many
    #[serde(default)]
    pub top: Option<u64>,
}

impl RankArgs {
    pub fn call(&self) -> Call {
        let call = Call::new("rank").flag("--json").flag("--no-sheet").each("--by", &self.by).each("--top", self.top);
        call.positional(&self.folder)
    }
}

#[derive(Serialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct Ranking {
    pub ranking: Vec<Ranked>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct Ranked {
    /// From 1
    pub place: u64,
    pub result: String,
    pub figures: Map<String, Value>,
}

#[derive(Debug, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
pub struct AnalysisArgs {
    /// The pile: .glb, .gltf or USD
    pub pile: String,
    /// Nodes that stand still
    #[serde(default)]
    pub scenery: Vec<String>,
    /// Nodes to leave out
    #[serde(default)]
    pub without: Vec<String>,
    /// Coulomb friction coefficient, 0 to 2
    #[serde(default)]
    pub friction: Option<f64>,
    /// Also write a .glb in which colors show what may be removed, below the server's folder
    #[serde(default)]
    pub output: Option<String>,
}

impl AnalysisArgs {
    pub fn call(&self) -> Call {
        Call::new("analyse")
            .flag("--json")
            .flag("--only-allowed")
            .each("--scenery", &self.scenery)
            .each("--without", &self.without)
            .each("--friction", self.friction)
            .each("--output", &self.output)
            .positional(&self.pile)
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct Analysis {
    /// Every body stands
    pub stands: bool,
    pub bodies: Vec<AnalysedNode>,
    /// An order in which all can be taken away, none of the others falling
    pub order: Vec<usize>,
    pub notes: Vec<String>,
    #[serde(flatten)]
    pub more: Map<String, Value>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct AnalysedNode {
    pub name: String,
    #[serde(flatten)]
    pub figures: Map<String, Value>,
}

#[derive(Debug, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
pub struct PackArgs {
    /// The pile: a .glb that a bake wrote
    pub pile: String,
    /// Folder below the server's: a new or empty one, or an earlier pack, which is replaced
    pub output: String,
    /// Compress meshes by EXT_meshopt_compression
    #[serde(default)]
    pub meshopt: bool,
}

impl PackArgs {
    pub fn call(&self) -> Call {
        let call = Call::new("pack").flag("--json").flag("--only-allowed");
        let call = call.option("--output", &self.output).positional(&self.pile);
        if self.meshopt { call.flag("--meshopt") } else { call }
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct PackResult {
    pub bodies: u64,
    pub triangles: u64,
    pub files: Vec<Packed>,
    pub left_out: Vec<String>,
    #[serde(flatten)]
    pub more: Map<String, Value>,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct Packed {
    pub file: String,
    pub what: String,
    pub bytes: u64,
    #[serde(flatten)]
    pub more: Map<String, Value>,
}
