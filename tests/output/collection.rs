//! A still of every model of a collection, written where `tests/viewers/run` shows it to the Khronos validator.
//!
//! The collection is a folder with a `MANIFEST.tsv`: `CAIRN_COLLECTION`, or `../shared/data` beside the workspace;
//! without one, the example assets.

use crate::output::files::encode;
use crate::output::files::pile_of;
use cairn_export::{ExportScene, Format, SourceModel};
use cairn_geometry::pose::Pose;
use cairn_input::asset::{self, Limits, Source};
use glam::{DQuat, DVec3};
use std::path::{Path, PathBuf};

/// Names relative to a folder, sorted: all that the manifest lists of these kinds, or the folder's own.
pub fn collection() -> (PathBuf, Vec<String>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = std::env::var_os("CAIRN_COLLECTION").map_or(root.join("../shared/data"), PathBuf::from);
    if let Ok(manifest) = std::fs::read_to_string(folder.join("MANIFEST.tsv")) {
        let fields = manifest.lines().skip(1).map(|line| line.split('\t').collect::<Vec<_>>());
        let wanted = fields.filter(|fields| ["object", "control", "reader"].contains(&fields[1]));
        return (folder, wanted.map(|fields| fields[0].to_owned()).collect());
    }
    let folder = root.join("examples/assets");
    let entries = std::fs::read_dir(&folder).unwrap();
    let files = entries.map(|entry| entry.unwrap()).filter(|entry| entry.path().is_file());
    let mut names: Vec<String> = files.map(|entry| entry.file_name().into_string().unwrap()).collect();
    names.sort();
    (folder, names)
}

#[test]
fn what_can_be_read_can_be_written() {
    let results = Path::new(env!("CARGO_TARGET_TMPDIR")).join("results");
    let _ = std::fs::remove_dir_all(&results);
    std::fs::create_dir_all(&results).unwrap();
    let (folder, names) = collection();
    let pose = Pose { translation: DVec3::Y, rotation: DQuat::from_rotation_x(1.0) };
    let pile = pile_of(&[(0, 1.0), (0, 2.0)], vec![vec![pose; 2]]);
    let mut written = 0;
    for name in names {
        let path = folder.join(&name);
        let bytes = std::fs::read(&path).unwrap();
        let beside = path.parent().unwrap();
        let resolve = |relative: &str| {
            let path = cairn_files::beside(beside, relative).ok_or("it leads away")?;
            std::fs::read(path).map_err(|error| error.to_string())
        };
        let limits = Limits::default();
        if asset::read(&Source { name: &name, bytes: &bytes, node: None, resolve: &resolve, limits }).is_err() {
            continue;
        }
        let model =
            SourceModel { name: "prop", file: &name, bytes: &bytes, node: None, resolve: &resolve, asset: None };
        let scene = ExportScene { props: vec![model], scenery: vec![model], ..Default::default() };
        let result = encode(Format::Glb, &pile, &scene).unwrap_or_else(|error| panic!("{name}: {error}"));
        std::fs::write(results.join(format!("{}.glb", name.replace(['/', '\\'], "_"))), result).unwrap();
        written += 1;
    }
    assert!(written >= 10);
}
