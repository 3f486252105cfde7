//! A file to read, and the limits of reading.

use crate::gate::{Gate, MESHES, NODES};
use crate::log::{Log, Logged};
use crate::problem::{ProblemKind, clip};
use crate::{compressed, container};

/// Bounds on the work that one file may cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of the file and its buffers together. Default 1 GiB.
    pub bytes: u64,
    /// Triangles of the result, every instance counted: counted before any is made. Default 4 million, which take about
    /// 20 s and 800 MB to check; at most 1 thousand million.
    pub triangles: u64,
    /// Nodes of the file, and instances of one node's mesh. Default 200 thousand.
    pub nodes: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits { bytes: 1 << 30, triangles: 4_000_000, nodes: 200_000 }
    }
}

/// Gives the bytes of an external file, or why not. The path is relative to the glTF's folder, `/` between its parts:
/// no root, drive, scheme or backslash. That of a picture may start with `../`, that of a buffer may not; neither has
/// `..` elsewhere.
pub type Resolver<'a> = dyn Fn(&str) -> Result<Vec<u8>, String> + 'a;

/// A file to read.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// The file's name in messages.
    pub name: &'a str,
    /// The file itself: `.gltf` or `.glb`; its content decides which.
    pub bytes: &'a [u8],
    /// The name of one node, to read it and all below it (`Brick` of `kit.glb#Brick`); or of a scene, where no node has
    /// it.
    pub node: Option<&'a str>,
    /// Gives the bytes of external buffers.
    pub resolve: &'a Resolver<'a>,
    pub limits: Limits,
}

impl<'a> Source<'a> {
    /// The document behind the gate, and the binary chunk of a GLB.
    pub(crate) fn open(&self, log: &mut Log) -> Logged<(Gate<'a>, Option<&'a [u8]>)> {
        let (size, limit) = (self.bytes.len() as u64, self.limits.bytes);
        if size > limit {
            return Err(log.refuse("", ProblemKind::Limit { what: "bytes", found: size, limit }));
        }
        let chunks = container::open(self.bytes).map_err(|what| log.refuse("", what))?;
        let gate = Gate::open(chunks.json, is_harmless, log)?;
        check_version(&gate, log)?;
        Ok((gate, chunks.bin))
    }
}

/// glTF 2.x is read, unless the file says that it needs a later minor version.
fn check_version(gate: &Gate<'_>, log: &mut Log) -> Logged<()> {
    let asset = gate.root("asset");
    let Some(version) = asset.and_then(|asset| asset.member("version")) else {
        // A JSON file without a version is no glTF, except for very old glTF.
        if asset.is_some() || gate.has(NODES) || gate.has(MESHES) {
            return Err(log.refuse("/asset/version", ProblemKind::Missing));
        }
        return Err(log.refuse("", ProblemKind::NotGltf { seems: "some other JSON" }));
    };
    let needed = asset.and_then(|asset| asset.member("minVersion")?.word());
    let major = |text: String| text.split('.').next().and_then(|n| n.parse::<u32>().ok());
    if version.word().and_then(major) != Some(2) {
        let version = version.word().map_or_else(|| version.describe(), |text| clip(&text));
        return Err(log.refuse("/asset/version", ProblemKind::Version { version }));
    }
    match needed {
        Some(text) if text != "2.0" => {
            Err(log.refuse("/asset/minVersion", ProblemKind::Version { version: clip(&text) }))
        }
        _ => Ok(()),
    }
}

/// Extensions that are read, that leave geometry as it is, or whose every use is checked where it stands.
fn is_harmless(name: &str) -> bool {
    const CHECKED: [&str; 6] = [
        "KHR_mesh_quantization",
        compressed::DRACO,
        compressed::MESHOPT[0],
        compressed::MESHOPT[1],
        "EXT_mesh_gpu_instancing",
        "KHR_node_visibility",
    ];
    const PARTS: [&str; 6] = ["_materials_", "_texture_", "_lights_", "_animation_", "_xmp", "_physics_"];
    CHECKED.contains(&name) || PARTS.iter().any(|part| name.contains(part))
}
