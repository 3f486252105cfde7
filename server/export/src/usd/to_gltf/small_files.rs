//! Small files that stand for much: each is refused before it takes time or memory.

use super::convert;
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;

fn refused(bytes: &[u8]) -> String {
    let none = |_: &str| Err("no file".to_owned());
    convert(bytes, &none, &[]).err().expect("it is too large")
}

fn stage(prims: &str) -> Vec<u8> {
    format!("#usda 1.0\n{prims}").into_bytes()
}

const TRIANGLE: &str = "def Mesh \"m\" {\npoint3f[] points = [(0,0,0), (1,0,0), (0,1,0)]\n\
                        int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n}\n";

#[test]
fn references_that_double() {
    let mut prims = format!("{TRIANGLE}def \"a0\" (references = </m>) {{}}\ndef \"b0\" (references = </m>) {{}}\n");
    for n in 1..30 {
        for name in ["a", "b"] {
            prims += &format!("def \"{name}{n}\" (references = [</a{0}>, </b{0}>]) {{}}\n", n - 1);
        }
    }
    let says = "the references of a prim multiply to more than 1000: it is not composed";
    assert!(refused(&stage(&prims)).contains(says));
    // Behind a relationship that is followed, too.
    let shown = TRIANGLE.replace("points =", "points_ =").replace("def Mesh", "def Xform");
    let bound = TRIANGLE.replace("{\n", "{\nrel material:binding = </a29.r>\n");
    let prims = format!("{bound}{}{shown}", prims.replace(TRIANGLE, "def \"m\" {}\n"));
    assert!(refused(&stage(&prims)).contains(says));
}

#[test]
fn instances_of_instances() {
    let mut prims = format!("def \"p0\" {{ {TRIANGLE} }}\n");
    let positions = vec!["(0,0,0)"; 100].join(",");
    let indices = vec!["0"; 100].join(",");
    for n in 1..5 {
        prims += &format!(
            "def PointInstancer \"p{n}\" {{\nrel prototypes = </p{}>\nint[] protoIndices = [{indices}]\n\
             point3f[] positions = [{positions}]\n}}\n",
            n - 1
        );
    }
    assert!(refused(&stage(&prims)).contains("prims and instances of few bytes: it is not read"));
}

#[test]
fn very_many_prims_and_properties_of_few_bytes() {
    let prims: String = (0..20_000).map(|n| format!("def \"a{n}\" {{}}\n")).collect();
    assert!(refused(&stage(&prims)).contains("prims of few bytes: save it as .usdc"));
    let properties: String = (0..30_000).map(|n| format!("int a{n}\n")).collect();
    let what = refused(&stage(&format!("def \"a\" {{\n{properties}}}")));
    assert!(what.contains("one of its prims has more than 25000 properties"), "{what}");
}

#[test]
fn a_mesh_that_is_repeated() {
    let numbers = vec!["(0,0,0)"; 100_000].join(",");
    let mut prims = format!(
        "def Mesh \"m\" {{\npoint3f[] points = [{numbers}]\nint[] faceVertexCounts = []\n\
                 int[] faceVertexIndices = []\n}}\n"
    );
    for n in 0..100 {
        prims += &format!("def \"a{n}\" (references = </m>) {{}}\n");
    }
    assert!(refused(&stage(&prims)).contains("its references repeat meshes of more than"));
}

#[test]
fn a_package_that_is_compressed() {
    let package = |method| {
        let mut package = zip::ZipWriter::new(Cursor::new(Vec::new()));
        package.start_file("a.usda", SimpleFileOptions::default().compression_method(method)).expect("a file");
        package.write_all(&stage(TRIANGLE)).expect("its bytes");
        package.finish().expect("a package").into_inner()
    };
    let what = refused(&package(zip::CompressionMethod::Deflated));
    assert!(what.contains("its file a.usda is compressed, which USD forbids in a .usdz"), "{what}");
    let none = |_: &str| Err("no file".to_owned());
    assert!(convert(&package(zip::CompressionMethod::Stored), &none, &[]).is_ok());
}

#[test]
fn instances_show_their_prototype_each_at_its_place() {
    let prims = format!(
        "def PointInstancer \"all\" {{\nrel prototypes = [</all/p>, </all/q>]\nint[] protoIndices = [0, 1, 0]\n\
         point3f[] positions = [(1,0,0), (2,0,0), (3,0,0)]\ndef \"p\" {{ {TRIANGLE} {} }}\n\
         def \"q\" {{ {TRIANGLE} }}\n}}\n",
        TRIANGLE.replace("\"m\"", "\"n\"")
    );
    let none = |_: &str| Err("no file".to_owned());
    let glb = convert(&stage(&prims), &none, &[]).expect("it is read").glb;
    let document = gltf_json(&glb);
    let nodes = document["nodes"].as_array().expect("nodes");
    let name = |node: usize| nodes[node]["name"].as_str().expect("a name");
    let below = |node: usize| -> Vec<usize> {
        let children = nodes[node]["children"].as_array();
        children.into_iter().flatten().map(|child| child.as_u64().expect("a number") as usize).collect()
    };
    let mut found = Vec::new();
    let mut seen = std::collections::BTreeSet::new();
    for node in (0..nodes.len()).filter(|node| nodes[*node]["name"].as_str().is_some_and(|name| name.contains('.'))) {
        let [prototype] = below(node)[..] else { panic!("one prototype below each") };
        let meshes = below(prototype);
        assert!(meshes.iter().chain([&prototype]).all(|node| seen.insert(*node)), "no node stands twice");
        let x = nodes[node]["translation"][0].as_f64().expect("a place");
        found.push((x, name(prototype), meshes.iter().map(|mesh| name(*mesh)).collect::<Vec<_>>()));
    }
    assert_eq!(found, [(1.0, "p", vec!["m", "n"]), (2.0, "q", vec!["m"]), (3.0, "p", vec!["m", "n"])]);
}

fn gltf_json(glb: &[u8]) -> serde_json::Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    serde_json::from_slice(&glb[20..20 + length]).expect("JSON")
}
