//! USD: a layer as text or as a crate, with its pictures beside it; or all in one package.
//!
//! The default prim `Pile` has below it:
//!
//! - `Bodies`, a `PointInstancer`: `ids` are the bodies' numbers, in all formats the same; `Prototypes` holds the
//!   props, each with its own materials, so that it can be referred to by itself; one whose origin is far from it is
//!   moved to its centre of mass, about which it then turns between two frames. A time code is a frame. `velocities`
//!   (per second) and `angularVelocities` (degrees per second) lead from each frame to the next; they are zero before
//!   the first frame and from the last one on, so that the pile rests there. Bodies that appear later are among the
//!   `invisibleIds` until then, and without size for programs that do not look at these.
//! - `Scenery`, where there is any: each file below a prim of its name. Moving pieces have time samples.
//! - `Glue`, where bodies may be glued: a point for each dot, where it is at the last frame, with the purpose `guide`.
//!   Its primvars `cairn:bodies` (the second is -1 for the ground or scenery), `cairn:normal`, `cairn:force`,
//!   `cairn:moment` and `cairn:broken` are those of the `.glb`; the bodies' primvars `cairn:cluster` (-1: none) and
//!   `cairn:anchored`, too.
//! - `Physics`, if the scene's `usd` asks for it: the pile of the last frame for simulators (`physics.rs`).
//!
//! Metres, Y up, from time code 0 on, unless the scene's `usd` asks for other axes, units and time codes ([`layout`]).
//! Props and scenery that are USD themselves are references to their files, unless copies are asked for. The figures of
//! the pile are custom data of `Pile`, so that they follow a reference to it; the result's origin is custom data of the
//! layer.

mod arcs;
mod binary;
mod bounding_box;
mod glue;
mod instancer;
mod layer;
pub mod layout;
mod material;
mod model;
mod origin;
mod physics;
mod sound;
mod stage;
mod text;
mod textures;
mod to_gltf;

use super::hierarchy::BranchFrame;
use super::{Encoded, ExportError, ExportScene, ORIGIN};
use bounding_box::BoundingBox;
use cairn_core::report::TIMED_FIGURES;
use cairn_core::report::bake::BakedPile;
use cairn_wire::proto::UsdMotion;
use glam::DAffine3;
use instancer::WrittenBodies;
use layer::{Encoding, Layer, short_name};
use layout::Layout;
use model::UsdStage;
use openusd::gf;
use openusd::sdf::{AbstractData, FieldKey, Path, Value};
use openusd::tf::Token;
use openusd::usda;
use openusd::usdc::CrateData;
use openusd::usdz::ArchiveWriter;
pub use origin::read as read_origin;
use std::collections::HashMap;
use std::io::{Cursor, Error};
pub use textures::FOLDER;
pub use to_gltf::{ConvertedStage, PartChoice, PartPrim, StagePart, convert, to_gltf};

/// The first bytes of the formats.
const TEXT: &[u8] = b"#usda";
const CRATE: &[u8] = b"PXR-USDC";
const ZIP: &[u8] = b"PK\x03\x04";

/// Whether a file begins as one of USD's formats does: an archive with the name of a layer, as USD demands.
pub fn is_usd(bytes: &[u8]) -> bool {
    /// Where the length of the first file's name stands in an archive, and where the name begins.
    const NAME_LENGTH: usize = 26;
    const NAME: usize = 30;
    if !bytes.starts_with(ZIP) {
        return [TEXT, CRATE].iter().any(|begin| bytes.starts_with(begin));
    }
    let name = bytes.get(NAME_LENGTH..NAME_LENGTH + 2).and_then(|length| {
        let length = usize::from(u16::from_le_bytes([length[0], length[1]]));
        std::str::from_utf8(bytes.get(NAME..NAME + length)?).ok()
    });
    name.is_some_and(cairn_files::is_usd)
}

/// The layer of a file; of a package, its first one. The crate's readers may panic.
fn open(bytes: &[u8]) -> Option<Box<dyn AbstractData + '_>> {
    if bytes.starts_with(ZIP) { open_layer(sound::first_layer(bytes)?) } else { open_layer(bytes) }
}

fn open_layer<'a>(bytes: impl AsRef<[u8]> + 'a) -> Option<Box<dyn AbstractData + 'a>> {
    match bytes.as_ref() {
        whole if !sound::is_sound(whole) => None,
        whole if whole.starts_with(TEXT) => Some(Box::new(usda::parse(std::str::from_utf8(whole).ok()?).ok()?)),
        _ => Some(Box::new(CrateData::open(Cursor::new(bytes), true).ok()?)),
    }
}

/// The `.usdz`.
pub fn encode_package(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    let layout = Layout { embeds: true, ..scene.layout.clone() };
    let Encoded { bytes, sidecars, mut left_out } = encode(Encoding::Crate, bake, scene, layout)?;
    let assets = scene.props.iter().chain(&scene.scenery).filter(|model| model.asset.is_some()).count();
    if assets > 0 && !scene.layout.embeds {
        let what = "a .usdz holds copies of what is USD, without its variants and other materials: name the result \
                    .usdc for references";
        left_out.push(what.into());
    }
    let mut package = ArchiveWriter::new(Cursor::new(Vec::new()));
    let mut files =
        std::iter::once(("pile.usdc", &bytes)).chain(sidecars.iter().map(|(name, file)| (name.as_str(), file)));
    let packed = files.try_for_each(|(name, file)| package.add_layer(name, file));
    let bytes = packed.and_then(|()| package.finish()).map_err(|error| ExportError::Io(Error::other(error)))?;
    Ok(Encoded { left_out, ..Encoded::single(bytes.into_inner()) })
}

/// The `.usda`, and its pictures.
pub fn encode_text(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    encode(Encoding::Text, bake, scene, scene.layout.clone())
}

/// The `.usdc`, and its pictures.
pub fn encode_crate(bake: &BakedPile, scene: &ExportScene) -> Result<Encoded, ExportError> {
    encode(Encoding::Crate, bake, scene, scene.layout.clone())
}

fn encode(encoding: Encoding, bake: &BakedPile, scene: &ExportScene, layout: Layout) -> Result<Encoded, ExportError> {
    let mut layer = Layer::new(encoding, layout.clone());
    let root = Path::abs_root();
    let last = if layout.motion == UsdMotion::None { 0 } else { bake.frames.len().saturating_sub(1) };
    let rate = bake.fps / layout.samples;
    layer.set(&root, FieldKey::DefaultPrim, Token::from(&*layout.default_prim));
    layer.set(&root, FieldKey::Documentation, concat!("cairn ", env!("CARGO_PKG_VERSION")).to_owned());
    layer.set(&root, FieldKey::StartTimeCode, layout.time(0.0));
    layer.set(&root, FieldKey::EndTimeCode, layout.time(last as f64));
    layer.set(&root, FieldKey::FramesPerSecond, rate);
    layer.set(&root, FieldKey::TimeCodesPerSecond, rate);
    layer.set(&root, "metersPerUnit", layout.meters_per_unit);
    layer.set(&root, "upAxis", Token::from(if layout.is_z_up { "Z" } else { "Y" }));
    if let Some(origin) = scene.origin {
        origin::write(&mut layer, origin)?;
    }
    let pile = layer.prim(&root, &layout.default_prim, "Xform");
    let has_references = !layout.embeds && scene.props.iter().chain(&scene.scenery).any(|model| model.asset.is_some());
    layer.set(&pile, FieldKey::Kind, Token::from(layout.kind(has_references)));
    if let Some(purpose) = layout.purpose {
        layer.attribute(&pile, "uniform token purpose", Token::from(purpose));
    }
    if let Some(measures) = scene.measures {
        let figures = measures.iter().filter(|(name, _)| !TIMED_FIGURES.contains(&&***name));
        let figures = figures.filter_map(|(name, value)| Some((name.to_string(), Value::Double((*value)?))));
        let measures = HashMap::from([("measures".to_owned(), Value::Dictionary(figures.collect()))]);
        let data = HashMap::from([(ORIGIN.to_owned(), Value::Dictionary(measures))]);
        layer.set(&pile, FieldKey::CustomData, Value::Dictionary(data));
    }

    let mut stage = UsdStage::new(layer);
    stage.has_groups = has_references && matches!(layout.kind(true), "group" | "assembly");
    let WrittenBodies { prototypes, mut bounds } = instancer::write(&mut stage, &pile, bake, scene)?;
    if !scene.scenery.is_empty() {
        bounds.join(&scenery(&mut stage, &pile, bake, scene)?, DAffine3::IDENTITY);
    }
    describe(&mut stage.layer, &pile, &bounds, scene);
    let UsdStage { mut layer, textures, left_out, .. } = stage;
    if let Some(glue) = &bake.glue {
        glue::write(&mut layer, &pile, glue);
    }
    if layer.layout.has_physics {
        physics::write(&mut layer, &pile, bake, scene, &prototypes);
    }
    let sentence = |(model, what): (String, String)| format!("{model}: a USD result has no {what}");
    let left_out = left_out.into_iter().map(sentence).collect();
    Ok(Encoded { bytes: layer.encode()?, sidecars: textures.0, left_out })
}

/// Describes the pile as a model to those that do not open it: its bounding box, its name, and which bake it is.
fn describe(layer: &mut Layer, pile: &Path, bounds: &BoundingBox, scene: &ExportScene) {
    /// The order of the boxes.
    const PURPOSES: [Option<&str>; 4] = [None, Some("render"), Some("proxy"), Some("guide")];
    /// The box of a purpose that nothing has: low above high. Larger numbers are warned of by readers of text.
    const NOTHING: [f32; 2] = [1e9, -1e9];
    if !bounds.is_empty() {
        layer.apply(pile, "GeomModelAPI");
        let before = PURPOSES.iter().position(|purpose| *purpose == layer.layout.purpose).unwrap_or(0);
        let nothing = NOTHING.map(|side| gf::Vec3f::from([side; 3]));
        let hint: Vec<gf::Vec3f> = (0..before).flat_map(|_| nothing).chain(bounds.extent()).collect();
        layer.attribute(pile, "float3[] extentsHint", hint);
    }
    let name = Value::String(layer.layout.default_prim.clone());
    let mut info = HashMap::from([("name".to_owned(), name)]);
    let version = scene.origin.and_then(|origin| origin.get("result_blake3")?.as_str());
    info.extend(version.map(|version| ("version".to_owned(), Value::String(version.to_owned()))));
    layer.set(pile, FieldKey::AssetInfo, Value::Dictionary(info));
}

/// The static geometry below one prim, each file below a prim of its name. Gives its bounding box in the stage.
fn scenery<'a>(
    stage: &mut UsdStage<'a>,
    pile: &Path,
    bake: &BakedPile,
    scene: &'a ExportScene,
) -> Result<BoundingBox, ExportError> {
    let top = stage.layer.prim(pile, "Scenery", "Xform");
    stage.group(&top);
    let mut bounds = BoundingBox::default();
    for (i, model) in scene.scenery.iter().enumerate() {
        let prim = stage.layer.prim(&top, short_name(model.name), "Xform");
        let shown = stage.layer.text(model.name);
        stage.layer.set(&prim, FieldKey::DisplayName, shown);
        let Some(poses) = bake.scenery.get(i).filter(|poses| !poses.is_empty()) else {
            let own = stage.put(&prim, model, BranchFrame::World, DAffine3::IDENTITY)?;
            bounds.join(&own, DAffine3::IDENTITY);
            continue;
        };
        instancer::place(stage, &prim, poses);
        // The prim has the motion; what is below it is placed in it.
        let below = stage.layer.layout.to_stage() != DAffine3::IDENTITY || stage.refers(model);
        let at = if below { stage.layer.prim(&prim, "Piece", "Xform") } else { prim };
        let own = stage.put(&at, model, BranchFrame::World, DAffine3::IDENTITY)?;
        bounds.join(&instancer::swept(&own, poses, &stage.layer.layout), DAffine3::IDENTITY);
    }
    Ok(bounds)
}
