//! Random damage to good files: whatever comes, the answer is a sound mesh or a list of problems.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::{Value, json};

use super::compressed;
use super::model::{Model, read_with, tetrahedron};
use crate::asset::{Limits, ProblemKind};

const CASES: usize = 20_000;

/// Files that use every part of the reader.
fn good_files() -> Vec<Model> {
    let mut sparse = tetrahedron();
    let places = sparse.add_view(&[1, 3]);
    let sparse = sparse.set(
        "/accessors/0/sparse",
        json!({
            "count": 2,
            "indices": { "bufferView": places, "componentType": 5121 },
            "values": { "bufferView": 0, "byteOffset": 12 }
        }),
    );
    let tree = tetrahedron()
        .set(
            "/nodes",
            json!([
                { "name": "Top", "scale": [-1, 2, 1], "children": [1, 2] },
                { "name": "Brick", "mesh": 0, "rotation": [0, 0, 0, 1], "translation": [1, 2, 3] },
                { "mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1], "children": [3] },
                { "mesh": 0, "extensions": {
                    "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 0, "SCALE": 0 } }
                } }
            ]),
        )
        .set("/scenes/0/nodes", json!([0, 1]));
    let mut strips = tetrahedron();
    let indices = strips.add_view(&[0, 1, 2, 255, 3, 2, 1, 0]);
    let strips = strips
        .set("/accessors/1", json!({ "bufferView": indices, "componentType": 5121, "count": 8, "type": "SCALAR" }))
        .set("/meshes/0/primitives/0/mode", json!(5))
        .set("/meshes/0/primitives/1", json!({ "attributes": { "POSITION": 0 }, "mode": 6 }))
        .set("/extensionsRequired", json!(["KHR_mesh_quantization", "ACME_x"]));
    let draco = compressed::DRACO.map(|stream| compressed::draco(&compressed::bytes(stream)));
    let [tight, filtered] = [(0, 0), (2, 1)].map(|(positions, indices)| {
        let (positions, indices) = (compressed::POSITIONS[positions], compressed::INDICES[indices]);
        compressed::meshopt("KHR_meshopt_compression", positions, indices)
    });
    let [edges, sequence] = draco;
    vec![tetrahedron(), sparse, tree, strips, edges, sequence, tight, filtered]
}

fn nasty(rng: &mut Pcg64Mcg) -> Value {
    let values = [
        json!(0),
        json!(1),
        json!(2),
        json!(3),
        json!(5),
        json!(-1),
        json!(255),
        json!(65535),
        json!(5120),
        json!(5121),
        json!(5122),
        json!(5123),
        json!(5125),
        json!(5126),
        json!(u32::MAX),
        json!(1u64 << 31),
        json!(1u64 << 62),
        json!(u64::MAX),
        json!(i64::MIN),
        json!(0.5),
        json!(1e300),
        json!(-1e-300),
        json!(null),
        json!(true),
        json!(""),
        json!("VEC3"),
        json!("SCALAR"),
        json!("Brick"),
        json!("../x"),
        json!("data:;base64,AAAA"),
        json!([]),
        json!({}),
        json!([0]),
        json!([0, 0, 0]),
        json!([1e200, 1e200, 1e200]),
        json!([0, 0, 0, 0]),
        json!({ "uri": "a" }),
    ];
    values[rng.random_range(0..values.len())].clone()
}

/// Replaces, removes or copies one value somewhere in the tree.
fn damage_json(json: &mut Value, rng: &mut Pcg64Mcg) {
    let mut at = json;
    loop {
        let size = match &*at {
            Value::Array(items) => items.len(),
            Value::Object(entries) => entries.len(),
            _ => 0,
        };
        if size == 0 || rng.random_range(0..40) == 0 {
            *at = nasty(rng);
            return;
        }
        let pick = rng.random_range(0..size);
        match at {
            Value::Array(items) => {
                match rng.random_range(0..20) {
                    0 => {
                        items.remove(pick);
                        return;
                    }
                    1 => {
                        let copy = items[pick].clone();
                        items.push(copy);
                        return;
                    }
                    _ => {}
                }
                at = &mut items[pick];
            }
            Value::Object(entries) => {
                let key = entries.keys().nth(pick).expect("within the size").clone();
                if rng.random_range(0..20) == 0 {
                    entries.remove(&key);
                    return;
                }
                at = &mut entries[&key];
            }
            _ => return,
        }
    }
}

fn damage_bytes(bytes: &mut Vec<u8>, rng: &mut Pcg64Mcg) {
    for _ in 0..rng.random_range(1..4) {
        if bytes.is_empty() {
            return;
        }
        let at = rng.random_range(0..bytes.len());
        match rng.random_range(0..5) {
            0 => bytes[at] = rng.random(),
            1 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => bytes.truncate(at),
            3 => bytes.insert(at, rng.random()),
            _ => {
                let end = (at + rng.random_range(1..8)).min(bytes.len());
                bytes[at..end].fill(if rng.random() { 0xff } else { 0 });
            }
        }
    }
}

#[test]
fn damaged_files_never_panic_and_never_give_a_broken_mesh() {
    let files = good_files();
    let mut rng = Pcg64Mcg::seed_from_u64(20_120_501);
    let limits = Limits { bytes: 1 << 20, triangles: 10_000, nodes: 1000 };
    let (mut read, mut refused) = (0, 0);
    for case in 0..CASES {
        let mut model = files[case % files.len()].clone();
        // The document's values, the numbers of the buffer, or any byte of the finished file.
        let kind = rng.random_range(0..4);
        match kind {
            0 | 1 => (0..rng.random_range(1..4)).for_each(|_| damage_json(&mut model.json, &mut rng)),
            2 => (0..rng.random_range(1..4)).for_each(|_| {
                let at = rng.random_range(0..model.bin.len());
                model.bin[at] = rng.random();
            }),
            _ => {}
        }
        // Damage may have left nothing to put the data URI into.
        let embed = rng.random() && model.json.pointer("/buffers/0").is_some_and(Value::is_object);
        let mut bytes = if embed { model.embedded() } else { model.glb() };
        if kind == 3 {
            damage_bytes(&mut bytes, &mut rng);
        }
        let node = if rng.random_range(0..4) == 0 { Some("Brick") } else { None };
        let resolve = |_: &str| Ok(vec![0x3f; 100]);
        match read_with(&bytes, node, &resolve, limits) {
            Ok(asset) => {
                read += 1;
                let mesh = &asset.mesh;
                assert!(mesh.points.iter().all(|p| p.is_finite()), "case {case}");
                assert!(!mesh.triangles.is_empty() && mesh.triangles.len() <= 10_000, "case {case}");
                for t in &mesh.triangles {
                    assert!(t.iter().all(|&v| (v as usize) < mesh.points.len()), "case {case}");
                    assert!(t[0] != t[1] && t[1] != t[2] && t[2] != t[0], "case {case}");
                }
            }
            Err(problems) => {
                refused += 1;
                assert!(!problems.is_empty(), "case {case}");
                for problem in problems {
                    assert!(!matches!(problem.what, ProblemKind::Internal { .. }), "case {case}: {problem}");
                    assert!(problem.to_string().len() < 2000 && !problem.remedy.is_empty(), "case {case}: {problem}");
                }
            }
        }
    }
    // Both happen often, or the damage is not of the right kind.
    assert!(read > CASES / 10 && refused > CASES / 4, "{read} read, {refused} refused");
}
