//! The reader and the topology against a collection of real and broken files, if one is at hand.
//!
//! The collection is a folder with a `MANIFEST.tsv`: `CAIRN_COLLECTION`, or `../shared/data` beside the workspace. Its
//! kinds: `object` and `control` are models that must be read (those below `orig/` are in other formats and must be
//! refused as such), `reader` exercises features, `invalid` breaks rules. With `--nocapture` the tests print their
//! tables.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cairn_geometry::mesh::TriMesh;
use cairn_geometry::topology::{WELD_TOLERANCE, inspect, oriented, weld};
use cairn_input::asset::{self, Asset, AssetProblem, Limits, ProblemKind, Source};

struct Entry {
    name: String,
    kind: String,
    triangles: Option<usize>,
    watertight: String,
    /// `key=value` pairs that another reader measured.
    measured: BTreeMap<String, f64>,
}

fn collection() -> Option<(PathBuf, Vec<Entry>)> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("CAIRN_COLLECTION").map_or(beside, PathBuf::from);
    let Ok(manifest) = std::fs::read_to_string(folder.join("MANIFEST.tsv")) else {
        println!("no collection of files at {}: nothing was tried", folder.display());
        return None;
    };
    let entry = |line: &str| {
        let fields: Vec<&str> = line.split('\t').collect();
        let measured = fields.get(10).copied().unwrap_or_default().split("; ");
        let pair = |text: &str| {
            text.split_once('=').and_then(|(k, v)| Some((k.to_owned(), v.trim_end_matches("(tol:0)").parse().ok()?)))
        };
        Entry {
            name: fields[0].into(),
            kind: fields[1].into(),
            triangles: fields[5].parse().ok(),
            watertight: fields[6].into(),
            measured: measured.filter_map(pair).collect(),
        }
    };
    Some((folder, manifest.lines().skip(1).map(entry).collect()))
}

fn read(folder: &Path, name: &str) -> Result<Asset, Vec<AssetProblem>> {
    let path = folder.join(name);
    let bytes = std::fs::read(&path).expect("the manifest's files are there");
    let beside = path.parent().expect("a file has a folder").to_owned();
    let resolve = |uri: &str| std::fs::read(beside.join(uri)).map_err(|e| e.to_string());
    asset::read(&Source { name, bytes: &bytes, node: None, resolve: &resolve, limits: Limits::default() })
}

#[test]
fn every_file_is_read_or_refused_for_a_stated_reason() {
    let Some((folder, entries)) = collection() else { return };
    let mut table: BTreeMap<(String, String), usize> = BTreeMap::new();
    let mut wrong = Vec::new();
    let mut slowest = Duration::ZERO;
    for entry in &entries {
        let started = Instant::now();
        let result = read(&folder, &entry.name);
        slowest = slowest.max(started.elapsed());
        let foreign = entry.name.contains("/orig/");
        let outcome = match &result {
            Ok(asset) => {
                let found = asset.mesh.triangles.len() + asset.degenerate;
                // The tool behind the manifest reads no fans, and gives no figures for what it could not read.
                let same = entry.triangles.is_none_or(|n| n == found) || entry.name.contains("Mesh_PrimitiveMode");
                if !same {
                    wrong.push(format!("{}: {found} triangles, expected {:?}", entry.name, entry.triangles));
                }
                for note in &asset.notes {
                    println!("{}\tread\t{note}", entry.name);
                }
                "read".to_owned()
            }
            Err(problems) => {
                for problem in problems {
                    println!("{}\trefused\t{problem}", entry.name);
                }
                let Some(first) = problems.first() else { panic!("{}: refused without a reason", entry.name) };
                if problems.iter().any(|p| matches!(p.what, ProblemKind::Internal { .. })) {
                    wrong.push(format!("{}: {first}", entry.name));
                }
                let reason = format!("{:?}", first.what);
                format!("refused: {}", reason.split([' ', '{']).next().unwrap_or_default())
            }
        };
        let expected = match entry.kind.as_str() {
            "object" | "control" if foreign => outcome == "refused: NotGltf",
            "object" | "control" => outcome == "read",
            "reader" => {
                let empty = outcome == "refused: NoTriangles" && entry.triangles == Some(0);
                outcome == "read" || empty || outcome == "refused: Version"
            }
            _ => true,
        };
        if !expected {
            wrong.push(format!("{}: {outcome}", entry.name));
        }
        let kind = if foreign { "other formats" } else { &entry.kind };
        *table.entry((kind.to_owned(), outcome)).or_default() += 1;
    }
    for ((kind, outcome), count) in &table {
        println!("{kind}\t{outcome}\t{count}");
    }
    println!("slowest file: {slowest:?}");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn topology_agrees_with_the_manifest() {
    let Some((folder, entries)) = collection() else { return };
    let mut wrong = Vec::new();
    let mut seen = 0;
    for entry in entries.iter().filter(|e| e.triangles.is_some_and(|n| n > 0)) {
        let Ok(asset) = read(&folder, &entry.name) else { continue };
        seen += 1;
        let found = inspect(&asset.mesh);
        let (repaired, repair) = oriented(&asset.mesh);
        let after = inspect(&repaired);
        println!("{}\t{}\t{found:?}\t{:?}\t{after:?}", entry.name, entry.watertight, repair.describe());

        // Seams between nodes with transforms of their own meet to within rounding only.
        let near = inspect(&weld(&asset.mesh, WELD_TOLERANCE));
        let watertight = match entry.watertight.as_str() {
            "yes" => found.is_watertight() || near.is_watertight(),
            "closed,misoriented" => found.closed && found.nonmanifold_edges == 0 && found.misoriented_edges > 0,
            _ => !found.is_watertight(),
        };
        if !watertight {
            wrong.push(format!("{}: watertight is {}, found {found:?}", entry.name, entry.watertight));
        }
        let counts = [("boundary_edges", found.boundary_edges), ("nonmanifold_edges", found.nonmanifold_edges)];
        for (key, count) in counts {
            let expected = entry.measured.get(key).copied().unwrap_or(0.0);
            if count as f64 != expected && !near.is_watertight() {
                wrong.push(format!("{}: {key} is {expected}, found {count}", entry.name));
            }
        }
        if let Some(expected) = entry.measured.get("signed_vol")
            && found.is_watertight() // else the figure depends on the origin
            && (found.signed_volume - expected).abs() > 1e-3 * expected.abs() + 1e-9 * found.diagonal.powi(3)
        {
            wrong.push(format!("{}: volume is {expected}, found {}", entry.name, found.signed_volume));
        }
        if after.closed && repair.unorientable == 0 && after.nonmanifold_edges == 0 {
            let outward = after.signed_volume > 0.0 && after.misoriented_edges == 0;
            if !outward {
                wrong.push(format!("{}: not outward: {after:?}", entry.name));
            }
        }
    }
    println!("{seen} files");
    for w in &wrong {
        println!("WRONG {w}");
    }
    assert!(wrong.is_empty(), "{} of {seen}", wrong.len());
}

/// All triangles of a file's default scene as the `gltf` crate reads it, if it does; it neither reads nor survives
/// every file that is read here.
fn second_opinion(path: &Path) -> Option<TriMesh> {
    let beside = path.parent()?;
    let file = gltf::Gltf::from_slice(&std::fs::read(path).ok()?).ok()?;
    let bytes = |buffer: gltf::Buffer| match buffer.source() {
        gltf::buffer::Source::Bin => file.blob.clone(),
        gltf::buffer::Source::Uri(uri) => std::fs::read(beside.join(uri)).ok(),
    };
    let buffers: Vec<Vec<u8>> = file.buffers().map(bytes).collect::<Option<_>>()?;
    let mut mesh = TriMesh::default();
    let scene = file.default_scene().or_else(|| file.scenes().next())?;
    let mut stack: Vec<(gltf::Node, glam::DAffine3)> = scene.nodes().map(|n| (n, glam::DAffine3::IDENTITY)).collect();
    while let Some((node, above)) = stack.pop() {
        let local = glam::Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
        let world = above * glam::DAffine3::from_mat4(local);
        stack.extend(node.children().map(|child| (child, world)));
        for primitive in node.mesh().into_iter().flat_map(|m| m.primitives().collect::<Vec<_>>()) {
            if primitive.mode() != gltf::mesh::Mode::Triangles {
                return None;
            }
            let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
            let points: Vec<_> = reader.read_positions()?.map(|p| glam::Vec3::from(p).as_dvec3()).collect();
            let indices: Vec<u32> = match reader.read_indices() {
                Some(indices) => indices.into_u32().collect(),
                None => (0..points.len() as u32).collect(),
            };
            let triangles = indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
            mesh.append(&TriMesh { points, triangles }.transformed(&world));
        }
    }
    Some(mesh)
}

#[test]
fn meshes_agree_with_a_second_reader() {
    let Some((folder, entries)) = collection() else { return };
    let mut compared = 0;
    for entry in entries.iter().filter(|e| ["object", "control", "reader"].contains(&e.kind.as_str())) {
        let Ok(asset) = read(&folder, &entry.name) else { continue };
        // Roots that are children too are counted twice there.
        let path = folder.join(&entry.name);
        let Ok(Some(other)) = std::panic::catch_unwind(|| second_opinion(&path)) else { continue };
        if other.triangles.len() != asset.mesh.triangles.len() + asset.degenerate {
            println!(
                "{}: {} triangles, the other has {}",
                entry.name,
                asset.mesh.triangles.len(),
                other.triangles.len()
            );
            continue;
        }
        compared += 1;
        let (ours, theirs) = (inspect(&asset.mesh), inspect(&other));
        let (low, high) = asset.mesh.bounds();
        let (other_low, other_high) = weld(&other, 0.0).bounds();
        // The other multiplies its transforms in single precision.
        let near = 1e-5 * (ours.diagonal + low.abs().max_element());
        assert!(low.distance(other_low) < near && high.distance(other_high) < near, "{}", entry.name);
        assert!((ours.area - theirs.area).abs() <= 1e-5 * ours.area, "{}", entry.name);
        if ours.is_watertight() {
            let off = (ours.signed_volume - theirs.signed_volume).abs();
            assert!(off <= 1e-5 * ours.diagonal.powi(3), "{}: {off}", entry.name);
        }
    }
    println!("{compared} files compared");
    assert!(compared > 0);
}
