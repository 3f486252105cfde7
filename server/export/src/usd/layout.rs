//! How a stage is laid out: its axes and unit, its time codes, and the prim that holds the pile.

use cairn_files::problem::Problem;
use cairn_wire::proto::{self, UpAxis, UsdKind, UsdMotion, UsdPurpose};
use glam::{DAffine3, DQuat, DVec3};

/// Characters of the default prim's name.
const MOST_NAME: usize = 100;
/// Bytes of the folder before the paths of assets: the longest path that systems accept.
const MOST_FOLDER: usize = 4096;
/// The layout of a stage, within its ranges.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    pub is_z_up: bool,
    pub meters_per_unit: f64,
    /// Time code of frame 0, and frames of the bake in one of the stage.
    pub start: f64,
    pub samples: f64,
    pub default_prim: String,
    pub kind: UsdKind,
    /// `None`: shown always.
    pub purpose: Option<&'static str>,
    pub motion: UsdMotion,
    /// Models are copied, also where there are assets to refer to.
    pub embeds: bool,
    /// The pile can be simulated further.
    pub has_physics: bool,
    /// Before the paths of assets, if the scene says so.
    pub asset_folder: Option<String>,
}

/// Whether a text can stand before the paths of assets.
pub fn is_asset_folder(text: &str) -> bool {
    text.len() <= MOST_FOLDER && !text.contains(['@', '\0', '\n'])
}

impl Default for Layout {
    fn default() -> Layout {
        Layout::new(&proto::UsdLayout::default()).expect("the defaults are within their ranges")
    }
}

impl Layout {
    /// The layout that a scene asks for, or what is wrong with it.
    pub fn new(given: &proto::UsdLayout) -> Result<Layout, Vec<Problem>> {
        let mut problems = Vec::new();
        let mut wrong = |field: &str, what: String, remedy: String| {
            let field = format!("usd.{field}");
            problems.push(Problem::new(&field, what, remedy).of_field(&field));
        };
        let mut number = |field: &str, value: f64, low: f64, high: f64| {
            if !(low..=high).contains(&value) {
                wrong(field, format!("{value} is out of range"), format!("Give a value from {low} to {high}."));
            }
            value
        };
        let given = given.with_defaults();
        let unit = number("meters_per_unit", given.meters_per_unit(), 1e-6, 1e6);
        let start = number("start_frame", given.start_frame(), -1e6, 1e6);
        let samples = number("samples_per_frame", given.samples_per_frame().into(), 1.0, 100.0);
        let name = given.default_prim().to_owned();
        let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            && !name.starts_with(|c: char| c.is_ascii_digit())
            && (1..=MOST_NAME).contains(&name.len());
        if !is_plain {
            let shown: String = name.chars().take(MOST_NAME).collect();
            let remedy = format!("Give letters, digits and _, no digit first, {MOST_NAME} characters at most.");
            wrong("default_prim", format!("{shown:?} is no name of a prim"), remedy);
        }
        let asset_folder = given.asset_folder.clone();
        if asset_folder.as_deref().is_some_and(|folder| !is_asset_folder(folder)) {
            let remedy = format!("Give {MOST_FOLDER} bytes at most, without @ and ends of lines.");
            wrong("asset_folder", "it cannot stand in an asset path".into(), remedy);
        }
        let purpose = match given.purpose() {
            UsdPurpose::Unspecified | UsdPurpose::Default => None,
            UsdPurpose::Render => Some("render"),
            UsdPurpose::Proxy => Some("proxy"),
            UsdPurpose::Guide => Some("guide"),
        };
        let layout = Layout {
            is_z_up: given.up_axis() == UpAxis::Z,
            meters_per_unit: unit,
            start,
            samples,
            default_prim: name,
            kind: given.kind(),
            purpose,
            motion: given.motion(),
            embeds: given.embed(),
            has_physics: given.physics(),
            asset_folder,
        };
        if problems.is_empty() { Ok(layout) } else { Err(problems) }
    }

    /// From the pile's axes to the stage's.
    pub fn turn(&self) -> DQuat {
        if self.is_z_up { DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2) } else { DQuat::IDENTITY }
    }

    /// A rotation in the pile as one in the stage.
    pub fn rotation(&self, rotation: DQuat) -> DQuat {
        if self.is_z_up { self.turn() * rotation * self.turn().inverse() } else { rotation }
    }

    /// A place or velocity in the pile, in the stage.
    pub fn place(&self, place: DVec3) -> DVec3 {
        self.direction(place) / self.meters_per_unit
    }

    /// A vector that has no length in metres.
    pub fn direction(&self, direction: DVec3) -> DVec3 {
        if self.is_z_up { DVec3::new(direction.x, -direction.z, direction.y) } else { direction }
    }

    /// From the pile's frame to the stage's.
    pub fn to_stage(&self) -> DAffine3 {
        let scale = DVec3::splat(1.0 / self.meters_per_unit);
        DAffine3::from_scale_rotation_translation(scale, self.turn(), DVec3::ZERO)
    }

    /// The time code of a frame of the bake.
    pub fn time(&self, frame: f64) -> f64 {
        self.start + frame / self.samples
    }

    /// The kind of the default prim.
    pub fn kind(&self, has_references: bool) -> &'static str {
        match self.kind {
            UsdKind::Unspecified | UsdKind::Auto if has_references => "assembly",
            UsdKind::Unspecified | UsdKind::Auto | UsdKind::Component => "component",
            UsdKind::Group => "group",
            UsdKind::Assembly => "assembly",
            UsdKind::Subcomponent => "subcomponent",
        }
    }
}
