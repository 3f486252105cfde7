//! The example assets are what they promise to be.

use std::collections::BTreeMap;
use std::path::Path;

type Key = [i64; 3];

/// Shared points of a one-mesh file, in micrometres, with all triangles.
fn welded(path: &Path) -> Vec<[Key; 3]> {
    let file = gltf::Gltf::open(path).unwrap();
    let mut triangles = Vec::new();
    for primitive in file.document.meshes().flat_map(|m| m.primitives().collect::<Vec<_>>()) {
        let reader = primitive.reader(|_| file.blob.as_deref());
        let points: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        let key = |&i: &u32| points[i as usize].map(|x| (f64::from(x) * 1e6).round() as i64);
        triangles.extend(indices.chunks(3).map(|t| [key(&t[0]), key(&t[1]), key(&t[2])]));
    }
    triangles
}

fn volume(triangles: &[[Key; 3]]) -> f64 {
    let six = triangles.iter().map(|t| {
        let [a, b, c] = t.map(|k| glam::DVec3::from(k.map(|x| x as f64 * 1e-6)));
        a.dot(b.cross(c))
    });
    six.sum::<f64>() / 6.0
}

#[test]
fn assets_are_closed_outward_small_and_stand_on_the_ground() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
    let volumes = [
        ("stick", 0.01),
        ("cube", 0.008),
        ("book", 0.16 * 0.04 * 0.24),
        ("banana", 0.000183),
        ("cone", 15.0),
        ("cone-small", 4.25),
        ("cylinder", 4.82),
        ("dome", 7.5),
        ("letter-t", 8.64),
        ("mound", 0.1),
        ("card", 0.063 * 0.088 * 0.00088),
        ("ball", 0.52),
        ("brick", 0.24 * 0.071 * 0.115),
        ("plank", 1.2 * 0.04 * 0.15),
        ("plate", 0.00041),
        ("bowl", 0.000167),
        ("shelf", 0.96),
        ("wall", 3.0 * 1.6 * 0.245),
        ("tower", 1.25 * 2.6 * 1.25),
        ("cart", 0.1),
        ("heap", 0.184),
        ("spiral", 2.7),
        ("hills", 19.8),
        ("bin", 1.24 * 0.84 * 0.72 - 1.2 * 0.8 * 0.7),
        ("tray", 0.58 * 0.42 * 0.11 - 0.56 * 0.4 * 0.1),
        ("desk", 1.4 * 0.03 * 0.8 + 4.0 * 0.04 * 0.04 * 0.69),
        ("pillar", 0.345),
        ("stairs", 3.15),
        ("rack", 0.077),
        ("jar", 0.0024),
        ("jar-tipped", 0.0024),
        ("coin", 0.0000189),
        ("hoard", 0.00998),
        ("pawn", 0.182),
        ("left", 1.35),
        ("right", 1.35),
    ];
    let mut files: Vec<String> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "glb"))
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_string())
        .collect();
    files.sort();
    let mut expected = volumes.map(|(name, _)| name);
    expected.sort();
    assert_eq!(files, expected);
    for (name, expected) in volumes {
        let path = folder.join(name).with_extension("glb");
        assert!(path.metadata().unwrap().len() < 100_000, "{name} is too large");
        let triangles = welded(&path);
        let mut edges: BTreeMap<(Key, Key), i32> = BTreeMap::new();
        for t in &triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                assert_ne!(a, b, "{name} has a degenerate triangle");
                *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
            }
        }
        assert!(edges.values().all(|&n| n == 0), "{name} is not closed");
        let found = volume(&triangles);
        assert!((found - expected).abs() < 0.08 * expected, "{name} encloses {found} m^3");
        let base = triangles.iter().flatten().map(|k| k[1]).min();
        match name {
            // The heap stands on the cart's rim, and the tipped jar is held.
            "heap" => assert_eq!(base, Some(700_000)),
            "jar-tipped" => assert!(base > Some(0)),
            _ => assert_eq!(base, Some(0), "{name} does not stand on the ground"),
        }
    }
}
