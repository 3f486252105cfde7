//! The outcome of reading every glTF file of a collection, as a table; and the cost of reading a large one.
//!
//!     cargo study gltf_table [-- FOLDER]
//!
//! The collection is FOLDER, or `CAIRN_COLLECTION`, or `../shared/data` beside the workspace; without one, the example
//! assets. Columns: file, `read`, `refused`, `panicked` or `hung`, triangles, message. Each file is read in a process
//! of its own, and the greatest memory of all is printed. Then a file of 100 MB, made here, is read in the same way.
//! Ends with 1 if a file panicked, hung for a minute, or took more than 100 MB of memory beyond its own size, or if the
//! large file took more than 300 MB. Its time is printed, not judged.

use anyhow::{Context, ensure};
use cairn_input::asset::{self, Limits, Source};
use cairn_job::machine;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Bytes of the large file, and of memory that reading it may take.
const LARGE: usize = 100_000_000;
const MOST_MEMORY: u64 = 300_000_000;
/// Bytes of memory that any other file may take beyond its own size.
const MOST_BEYOND: u64 = 100_000_000;
/// A process that runs longer hangs.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() -> anyhow::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--read", file] => read_alone(Path::new(file)),
        ["--row", file, name] => {
            let row = Row::read(Path::new(file), name)?;
            println!("{}", serde_json::to_string(&row)?);
            Ok(())
        }
        _ => {
            table(&folder(args.first()))?;
            large()
        }
    }
}

fn folder(given: Option<&String>) -> PathBuf {
    let root = Path::new(env!("CAIRN_REPOSITORY"));
    let beside = root.join("../shared/data");
    let given = given.map(PathBuf::from).or_else(|| std::env::var_os("CAIRN_COLLECTION").map(PathBuf::from));
    given.unwrap_or(if beside.is_dir() { beside } else { root.join("examples/assets") })
}

/// Every `.glb` and `.gltf` at or below a folder, sorted by name.
fn models(folder: &Path, found: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let entries = folder.read_dir().with_context(|| folder.display().to_string())?;
    for entry in entries {
        let path = entry?.path();
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        if path.is_dir() {
            models(&path, found)?;
        } else if ["glb", "gltf"].contains(&ending) {
            found.push(path);
        }
    }
    found.sort();
    Ok(())
}

fn read(path: &Path, name: &str) -> anyhow::Result<Result<asset::Asset, Vec<asset::AssetProblem>>> {
    let bytes = std::fs::read(path)?;
    let beside = path.parent().unwrap_or(Path::new(""));
    let resolve = |relative: &str| {
        let path = cairn_files::beside(beside, relative).ok_or("it leads out of the file's own folder")?;
        cairn_files::read(&path).map_err(|problem| problem.to_string())
    };
    Ok(asset::read(&Source { name, bytes: &bytes, node: None, resolve: &resolve, limits: Limits::default() }))
}

/// The outcome of a file.
#[derive(serde::Serialize, serde::Deserialize)]
struct Row {
    outcome: String,
    triangles: String,
    message: String,
    /// Of the process that read it, at most, bytes; `None` where the system does not report it.
    memory: Option<u64>,
}

impl Row {
    fn read(path: &Path, name: &str) -> anyhow::Result<Row> {
        let (outcome, triangles, message) = match read(path, name)? {
            Ok(asset) => ("read", asset.mesh.triangles.len().to_string(), asset.notes.join("; ")),
            Err(problems) => {
                let more =
                    if problems.len() > 1 { format!(" (and {} more)", problems.len() - 1) } else { String::new() };
                let message = problems.first().context("refused without a reason")?.to_string();
                ("refused", String::new(), message.trim_start_matches(&format!("{name}: ")).to_owned() + &more)
            }
        };
        Ok(Row { outcome: outcome.into(), triangles, message, memory: machine::peak_memory() })
    }

    /// The same, by a process of its own: whatever becomes of it.
    fn read_apart(path: &Path, name: &str) -> anyhow::Result<Row> {
        let ended = |outcome: &str, message: String| {
            Ok(Row { outcome: outcome.into(), triangles: String::new(), message, memory: None })
        };
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("--row").arg(path).arg(name).stdout(Stdio::piped()).stderr(Stdio::piped());
        let (mut child, began) = (command.spawn()?, Instant::now());
        // Its output fits into its pipes.
        while child.try_wait()?.is_none() {
            if began.elapsed() > PATIENCE {
                child.kill()?;
                child.wait()?;
                return ended("hung", format!("it had not ended after {PATIENCE:?}"));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let output = child.wait_with_output()?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return ended(
                "panicked",
                format!("{}: {}", output.status, said.split_whitespace().collect::<Vec<_>>().join(" ")),
            );
        }
        Ok(serde_json::from_slice(&output.stdout)?)
    }
}

fn table(folder: &Path) -> anyhow::Result<()> {
    let mut paths = Vec::new();
    models(folder, &mut paths)?;
    let mut totals: BTreeMap<(String, String), usize> = BTreeMap::new();
    let (mut panicked, mut hung, mut greedy) = (0, 0, 0);
    let mut greatest = (0, String::new());
    for path in &paths {
        let name = path.strip_prefix(folder)?.display().to_string();
        let Row { outcome, triangles, message, memory } = Row::read_apart(path, &name)?;
        println!("{name}\t{outcome}\t{triangles}\t{message}");
        panicked += usize::from(outcome == "panicked");
        hung += usize::from(outcome == "hung");
        greedy +=
            usize::from(memory.is_some_and(|bytes| bytes > MOST_BEYOND + path.metadata().map_or(0, |file| file.len())));
        greatest = greatest.max((memory.unwrap_or(0), name.clone()));
        let kind = name.split(['/', '\\']).next().filter(|_| name.contains(['/', '\\'])).unwrap_or("files");
        *totals.entry((kind.to_owned(), outcome)).or_default() += 1;
    }
    for ((kind, outcome), count) in totals {
        println!("{kind}: {count} {outcome}");
    }
    println!(
        "{} files: {panicked} panicked, {hung} hung, {greedy} took too much memory; {:.0} MB at most ({})",
        paths.len(),
        greatest.0 as f64 / 1e6,
        greatest.1
    );
    ensure!(panicked + hung + greedy == 0, "a file panicked, hung or took too much memory");
    Ok(())
}

/// Makes a file of [`LARGE`] bytes, and reads it in a process of its own.
fn large() -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("large.glb");
    std::fs::write(&path, hills())?;
    let output = Command::new(std::env::current_exe()?).arg("--read").arg(&path).output()?;
    let printed = String::from_utf8_lossy(&output.stdout);
    print!("{printed}");
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(())
}

fn read_alone(path: &Path) -> anyhow::Result<()> {
    let (began, cpu) = (Instant::now(), machine::cpu_seconds());
    let asset = read(path, "large.glb")?.map_err(|problems| anyhow::anyhow!("{problems:?}"))?;
    let seconds = format!("{:.2} s ({:.2} s of CPU)", began.elapsed().as_secs_f64(), machine::cpu_seconds() - cpu);
    let (triangles, size) = (asset.mesh.triangles.len(), path.metadata()?.len() as f64 / 1e6);
    let Some(memory) = machine::peak_memory() else {
        println!("{size:.0} MB, {triangles} triangles: {seconds}; this system does not report the memory");
        return Ok(());
    };
    println!("{size:.0} MB, {triangles} triangles: {seconds}, {:.0} MB of memory", memory as f64 / 1e6);
    ensure!(memory <= MOST_MEMORY, "more than {} MB", MOST_MEMORY / 1_000_000);
    Ok(())
}

/// Hills as a scan has them: positions, normals and texture coordinates in floats, indices of 32 bits.
fn hills() -> Vec<u8> {
    const VERTEX: usize = 32;
    const TRIANGLE: usize = 12;
    let side = (LARGE as f64 / (VERTEX + 2 * TRIANGLE) as f64).sqrt() as u32;
    let vertices = (side * side) as usize;
    let quads = ((side - 1) * (side - 1)) as usize;
    let mut bin = Vec::with_capacity(LARGE);
    for (z, x) in (0..side).flat_map(|z| (0..side).map(move |x| (z, x))) {
        let (u, v) = (x as f32 / side as f32, z as f32 / side as f32);
        let height = 0.1 * (40.0 * u).sin() * (30.0 * v).cos();
        for value in [u, height, v, 0.0, 1.0, 0.0, u, v] {
            bin.extend_from_slice(&value.to_le_bytes());
        }
    }
    for (z, x) in (0..side - 1).flat_map(|z| (0..side - 1).map(move |x| (z, x))) {
        let corner = z * side + x;
        for index in [corner, corner + side, corner + 1, corner + 1, corner + side, corner + side + 1] {
            bin.extend_from_slice(&index.to_le_bytes());
        }
    }
    let split = vertices * VERTEX;
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 3,
        }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": vertices, "type": "VEC3" },
            { "bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": vertices, "type": "VEC3" },
            { "bufferView": 0, "byteOffset": 24, "componentType": 5126, "count": vertices, "type": "VEC2" },
            { "bufferView": 1, "componentType": 5125, "count": 6 * quads, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": split, "byteStride": VERTEX },
            { "buffer": 0, "byteOffset": split, "byteLength": bin.len() - split },
        ],
        "buffers": [{ "byteLength": bin.len() }],
    });
    let header = gltf::binary::Header { magic: *b"glTF", version: 2, length: 0 };
    let json = serde_json::to_vec(&document).expect("a document has a text").into();
    gltf::binary::Glb { header, json, bin: Some(bin.into()) }.to_vec().expect("it fits")
}
