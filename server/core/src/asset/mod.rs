//! glTF 2.0 and GLB bytes in, one mesh out.
//!
//! Reads what carries geometry and nothing else: a missing picture or a broken animation does not matter. Everything
//! that stands in the way is told at once, with its place and a remedy. No input panics, leaves the file's folder, or
//! takes more time and memory than the [`Limits`] say: every count is held against the bytes that are there before
//! it is used.
//!
//! The `gltf` crate has the types of the document and reads the accessors' bytes. Before it stands `gate`: the crate
//! panics on hostile input, and refuses a whole file for a fault in a texture.

mod accessor;
mod buffer;
pub mod compressed;
pub mod container;
mod gate;
mod geometry;
mod log;
mod node;
mod problem;
mod remedy;
mod strip;
#[cfg(test)]
mod tests;
pub mod uri;

use std::panic::{AssertUnwindSafe, catch_unwind};

use glam::DMat3;

use crate::geometry::mesh::TriMesh;
use crate::geometry::topology::{drop_flat, weld};
use accessor::Accessors;
pub use accessor::number;
use buffer::Buffers;
use gate::{Gate, MESHES, NODES};
use geometry::{Builder, Built};
use log::{Checked, Log};
use node::Nodes;
pub use problem::{AssetProblem, ProblemKind};

/// Bounds on the work that one file may cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of the file and its buffers together. Default 1 GiB.
    pub bytes: u64,
    /// Triangles of the result, every instance counted: counted before any is laid out. Default 4 million, which take about
    /// 20 s and 800 MB to look at; at most 1 thousand million.
    pub triangles: u64,
    /// Nodes of the file, and instances of one node's mesh. Default 200 thousand.
    pub nodes: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits { bytes: 1 << 30, triangles: 4_000_000, nodes: 200_000 }
    }
}

/// Above this many triangles, their corners could not be numbered in 32 bits.
const MOST_TRIANGLES: u64 = 1_000_000_000;

/// A file to read.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// What messages call the file.
    pub name: &'a str,
    /// The file itself: `.gltf` or `.glb`, told apart by content.
    pub bytes: &'a [u8],
    /// The name of one node, to read it and all below it (`Brick` of `kit.glb#Brick`); or of a scene, where no node has it.
    pub node: Option<&'a str>,
    /// Gives the bytes of an external buffer, or why not. The path is relative to the glTF's folder, `/` between its
    /// parts, and does not lead out of it: no root, drive, scheme, `..` or backslash.
    pub resolve: &'a dyn Fn(&str) -> Result<Vec<u8>, String>,
    pub limits: Limits,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Asset {
    /// Metres, glTF axes. Equal points are one point, every point is used, and there is at least one triangle. None has
    /// two equal corners; one whose corners lie on a line is merged with its neighbour, where that does not tear the
    /// surface.
    ///
    /// A whole file stands in its scene's frame. A chosen node stands in a frame with the node's own origin and the
    /// world's axes: the rotation and scale of all that is above the node are applied, the translation is not.
    pub mesh: TriMesh,
    /// The linear part (rotation, scale, shear) of the chosen node's world transform, already applied to `mesh`.
    /// Identity for a whole file.
    pub linear: DMat3,
    /// Number of the chosen node in the file.
    pub root: Option<usize>,
    /// Triangles left out because they have no area.
    pub degenerate: usize,
    /// What was read otherwise than it stands in the file, one sentence each.
    pub notes: Vec<String>,
}

/// Reads `source`, or tells everything that is wrong with it.
pub fn read(source: &Source<'_>) -> Result<Asset, Vec<AssetProblem>> {
    let mut log = Log::new(source.name);
    // A fault of this reader must cost one file, not the process. None is known.
    let read = catch_unwind(AssertUnwindSafe(|| read_with(source, &mut log)));
    match read {
        Ok(Ok(asset)) if !log.any() => return Ok(asset),
        Ok(_) => {}
        Err(panic) => {
            let message = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
            let message = message.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            log.refuse("", ProblemKind::Internal { message });
        }
    }
    Err(log.into_problems())
}

fn read_with(source: &Source<'_>, log: &mut Log) -> Checked<Asset> {
    let limits = source.limits;
    let size = source.bytes.len() as u64;
    if size > limits.bytes {
        return Err(log.refuse("", ProblemKind::Limit { what: "bytes", found: size, limit: limits.bytes }));
    }
    let container = container::open(source.bytes).map_err(|what| log.refuse("", what))?;
    let gate = &Gate::open(container.json, is_harmless, log)?;
    check_version(gate, log)?;

    let most_triangles = limits.triangles.min(MOST_TRIANGLES);
    let buffers = Buffers::new(gate, container.bin, source.resolve, limits.bytes, size);
    let accessors = Accessors::new(gate, buffers, 3 * most_triangles);
    let mut builder = Builder {
        gate,
        accessors,
        quantized: gate.declares("KHR_mesh_quantization"),
        most_triangles,
        most_instances: limits.nodes as u64,
        broken: 0,
    };
    let mut nodes = Nodes::new(gate, limits.nodes, log)?;
    let placement = nodes.place_all(source.node, log)?;
    let Built { mut mesh, mut degenerate, why_empty } = builder.build(&nodes, &placement.placed, log)?;
    check_extensions(gate, log);
    let flat = drop_flat(&mut mesh);
    degenerate += flat.dropped;
    if degenerate > 0 {
        let all = degenerate + mesh.triangles.len();
        log.note("triangles of no area are left out", &format!("{degenerate} of {all}"));
        mesh = weld(&mesh, 0.0); // their points go too
    }
    if flat.folded > 0 {
        log.note("triangles of no area are merged with those beside them", &flat.folded.to_string());
    }
    if flat.left > 0 {
        log.note("triangles of no area could not be taken away and stay", &flat.left.to_string());
    }
    if mesh.triangles.is_empty() && !log.any() {
        let all = (degenerate > 0).then(|| format!("every triangle ({degenerate}) has no area"));
        return Err(log.refuse("", ProblemKind::NoTriangles { why: all.or(why_empty) }));
    }
    let notes = log.notes();
    Ok(Asset { mesh, linear: placement.linear, root: placement.root, degenerate, notes })
}

/// glTF 2.x is read, unless the file says that it needs a later minor version.
fn check_version(gate: &Gate<'_>, log: &mut Log) -> Checked<()> {
    let asset = gate.root("asset");
    let Some(version) = asset.and_then(|asset| asset.member("version")) else {
        // Every JSON file without this is something else, except for very old glTF.
        let what = if asset.is_some() || gate.has(NODES) || gate.has(MESHES) {
            return Err(log.refuse("/asset/version", ProblemKind::Missing));
        } else {
            ProblemKind::NotGltf { seems: "some other JSON" }
        };
        return Err(log.refuse("", what));
    };
    let needed = asset.and_then(|asset| asset.member("minVersion")?.word());
    let major = |text: String| text.split('.').next().and_then(|n| n.parse::<u32>().ok());
    if version.word().and_then(major) != Some(2) {
        let version = version.word().map_or_else(|| version.describe(), |text| problem::clip(&text));
        return Err(log.refuse("/asset/version", ProblemKind::Version { version }));
    }
    match needed {
        Some(text) if text != "2.0" => {
            Err(log.refuse("/asset/minVersion", ProblemKind::Version { version: problem::clip(&text) }))
        }
        _ => Ok(()),
    }
}

/// Extensions that are read, that leave geometry as it is, or that were judged where they stand.
fn is_harmless(name: &str) -> bool {
    const JUDGED: [&str; 6] = [
        "KHR_mesh_quantization",
        compressed::DRACO,
        compressed::MESHOPT[0],
        compressed::MESHOPT[1],
        "EXT_mesh_gpu_instancing",
        "KHR_node_visibility",
    ];
    const PARTS: [&str; 6] = ["_materials_", "_texture_", "_lights_", "_animation_", "_xmp", "_physics_"];
    JUDGED.contains(&name) || PARTS.iter().any(|part| name.contains(part))
}

/// A required extension that is not read refuses the file only if something that carries geometry uses it.
fn check_extensions(gate: &Gate<'_>, log: &mut Log) {
    for (name, met) in gate.unread() {
        if met {
            log.refuse("/extensionsRequired", ProblemKind::Extension { name: problem::clip(name) });
        } else {
            log.note(
                "it requires an extension that is not read, but nothing with geometry uses it",
                "/extensionsRequired",
            );
        }
    }
}
