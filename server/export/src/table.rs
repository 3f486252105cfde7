//! Plain tables of the poses, for tools that have their own renderer.
//!
//! A pose takes a point of the prop's own frame, first scaled by the body's uniform `scale`, to the world: metres,
//! Y up, right-handed; rotations are unit quaternions `x y z w`. Time starts at frame 0, the pile right after turning
//! over.
//!
//! `.csv`: one row per frame and body, frames first, with a header. Columns: `frame`, `time_s` (seconds), `body`
//! (index), `prop` (name), `scale`, `x_m`, `y_m`, `z_m`, `qx`, `qy`, `qz`, `qw`.
//!
//! `.json`: one object. `generator`; `fps` (1/s); `props` (names); `bodies`: per body `name` (that of its node in the
//! `.glb`), `prop` (index into `props`), `scale`; `pose`: the names of the seven columns with their units; `frames`:
//! shape `[frame][body][7]`, `null` until a body appears; the `.csv` has no row for it until then. Where bodies may be
//! glued, `glue`: that of the `.glb`'s node `pile`.

use super::{Encoded, ExportError, ExportScene, body_names, glue};
use cairn_core::report::bake::BakedPile;
use cairn_geometry::pose::Pose;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

const POSE_COLUMNS: [&str; 7] = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"];

#[derive(Serialize)]
struct Table<'a> {
    generator: &'static str,
    fps: f64,
    props: Vec<&'a str>,
    bodies: Vec<BodyEntry>,
    pose: [&'static str; 7],
    frames: Vec<Vec<Option<[f64; 7]>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    glue: Option<serde_json::Value>,
    /// The result's origin, as in the `.glb`.
    #[serde(skip_serializing_if = "Option::is_none")]
    cairn: Option<&'a serde_json::Value>,
}

#[derive(Serialize)]
struct BodyEntry {
    name: String,
    prop: usize,
    scale: f64,
}

/// The `.json`.
pub fn encode_json(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    let names = body_names(bake, scene);
    let table = Table {
        generator: concat!("cairn ", env!("CARGO_PKG_VERSION")),
        fps: bake.fps,
        props: scene.props.iter().map(|p| p.name).collect(),
        bodies: (bake.bodies.iter().zip(names))
            .map(|(body, name)| BodyEntry { name, prop: body.prop, scale: body.scale })
            .collect(),
        pose: POSE_COLUMNS,
        frames: bake.frames.iter().enumerate().map(|(frame, poses)| row(bake, frame, poses)).collect(),
        glue: bake.glue.as_ref().map(glue::whole),
        cairn: scene.origin,
    };
    Ok(Encoded::single(serde_json::to_vec(&table).map_err(std::io::Error::from)?))
}

/// The origin that a table in JSON states.
pub fn origin(result: &[u8]) -> Option<serde_json::Value> {
    #[derive(Deserialize)]
    struct Stated {
        cairn: serde_json::Value,
        #[serde(rename = "frames")]
        _frames: IgnoredAny,
    }
    let is_json = result.trim_ascii_start().starts_with(b"{");
    Some(serde_json::from_slice::<Stated>(result).ok().filter(|_| is_json)?.cairn)
}

/// The `.csv`.
pub fn encode_csv(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    let head = ["frame", "time_s", "body", "prop", "scale"];
    csv.write_record(head.iter().chain(&POSE_COLUMNS)).map_err(std::io::Error::from)?;
    for (frame, poses) in bake.frames.iter().enumerate() {
        for (index, (body, pose)) in bake.bodies.iter().zip(poses).enumerate() {
            if body.first_frame > frame {
                continue;
            }
            let prop = scene.props[body.prop].name;
            let row = (frame, frame as f64 / bake.fps, index, prop, body.scale, columns(pose));
            csv.serialize(row).map_err(std::io::Error::from)?;
        }
    }
    Ok(Encoded::single(csv.into_inner().map_err(|error| error.into_error())?))
}

fn row(bake: &BakedPile, frame: usize, poses: &[Pose]) -> Vec<Option<[f64; 7]>> {
    bake.bodies.iter().zip(poses).map(|(body, pose)| (body.first_frame <= frame).then(|| columns(pose))).collect()
}

fn columns(pose: &Pose) -> [f64; 7] {
    let [x, y, z] = pose.translation.to_array();
    let [qx, qy, qz, qw] = pose.rotation.normalize().to_array();
    [x, y, z, qx, qy, qz, qw]
}
