//! A folder with a few models, and the program run in it.

use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// A working folder: `cone.glb` and `stick.glb` from the examples, `brick.glb` with a node `Brick`.
pub struct Desk {
    folder: TempDir,
}

/// The outcome of a run.
pub struct Done {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Desk {
    pub fn new() -> Desk {
        let desk = Desk { folder: tempfile::tempdir().unwrap() };
        let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
        std::fs::copy(assets.join("cone-small.glb"), desk.path("cone.glb")).unwrap();
        std::fs::copy(assets.join("stick.glb"), desk.path("stick.glb")).unwrap();
        desk.write("brick.glb", glb(&box_json(), &box_data([0.3, 0.2, 0.4])));
        desk
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    /// Names of all files, sorted.
    pub fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cairn"));
        // Each run simulates everything itself; tests of the cache remove this.
        command.env_remove("CAIRN_CACHE").env("CAIRN_NO_CACHE", "1");
        // A server that names no folder keeps its data in the user's.
        command.env("XDG_DATA_HOME", self.path("user"));
        command.args(args).current_dir(self.folder.path()).stdin(Stdio::null());
        command
    }

    /// Runs `cairn ARGS` in the folder.
    pub fn run(&self, args: &[&str]) -> Done {
        Done::of(self.command(args).output().unwrap())
    }

    /// Runs a command line without quotes in it.
    pub fn line(&self, line: &str) -> Done {
        self.run(&line.split_whitespace().collect::<Vec<_>>())
    }
}

impl Done {
    pub fn of(output: Output) -> Done {
        let Output { status, stdout, stderr } = output;
        Done {
            code: status.code().expect("not ended by a signal"),
            stdout: String::from_utf8(stdout).unwrap(),
            stderr: String::from_utf8(stderr).unwrap(),
        }
    }

    /// Asserts success. Returns the output.
    #[track_caller]
    pub fn ok(self) -> String {
        assert_eq!(self.code, 0, "{}", self.stderr);
        self.stdout
    }

    /// Asserts failure with this code and all of these texts. Long runs print their time first.
    #[track_caller]
    pub fn fails(&self, code: i32, texts: &[&str]) {
        assert_eq!(self.code, code, "{}", self.stderr);
        let first = self.stderr.lines().find(|line| !line.starts_with("read: "));
        assert!(first.is_some_and(|line| line.starts_with("error: ")), "{}", self.stderr);
        for part in texts {
            assert!(self.stderr.contains(part), "`{part}` is missing in:\n{}", self.stderr);
        }
    }
}

/// A GLB of a document and its one buffer.
pub fn glb(document: &Value, data: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
    let chunks: [&[u8]; 8] = [
        b"glTF\x02\0\0\0",
        &word(28 + text.len() + data.len()),
        &word(text.len()),
        b"JSON",
        &text,
        &word(data.len()),
        b"BIN\0",
        data,
    ];
    chunks.concat()
}

/// The document of a box of 0.3 x 0.2 x 0.4 m: 8 points and 12 triangles.
pub fn box_json() -> Value {
    json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": "Brick", "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            {
                "bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
                "min": [-0.15, -0.1, -0.2], "max": [0.15, 0.1, 0.2]
            },
            { "bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 96 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 72 }
        ],
        "buffers": [{ "byteLength": 168 }]
    })
}

/// The points of a box of this size around the origin, and its faces from outside.
pub fn box_data(size: [f32; 3]) -> Vec<u8> {
    let mut data = Vec::new();
    for corner in 0..8 {
        for (axis, length) in size.into_iter().enumerate() {
            let side = if corner >> axis & 1 == 1 { 0.5 } else { -0.5 };
            data.extend((side * length).to_le_bytes());
        }
    }
    for [a, b, c, d] in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6_u16]] {
        data.extend([a, b, c, a, c, d].into_iter().flat_map(u16::to_le_bytes));
    }
    data
}
