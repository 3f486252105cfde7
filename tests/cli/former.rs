//! Bakes from earlier results, by commands and files.

use crate::cli::desk::{Desk, box_data, box_json, glb};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// A desk with boxes on the ground, `short.glb` and `long.glb`, which is longer on one side, and two props.
fn desk() -> Desk {
    let desk = Desk::new();
    for (name, length) in [("short.glb", 1.2), ("long.glb", 1.4)] {
        let mut document = box_json();
        document["nodes"][0]["translation"] = json!([length / 2.0, 0.15, 0.0]);
        desk.write(name, glb(&document, &box_data([length, 0.3, 0.3])));
    }
    desk.write("crumb.glb", glb(&box_json(), &box_data([0.12, 0.06, 0.07])));
    desk
}

const HOW: &str = "--prop crumb.glb --accuracy draft --seed 3 --set glue=as_modelled";

/// Each body's node as it is at the end, by its name: the numbers of the file.
fn ends(desk: &Desk, result: &str) -> BTreeMap<String, Value> {
    let bytes = std::fs::read(desk.path(result)).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let (json, bin) = (&bytes[20..20 + length], &bytes[20 + length + 8..]);
    let json: Value = serde_json::from_slice(json).unwrap();
    let floats = |accessor: usize, width: usize| -> Vec<u32> {
        let accessor = &json["accessors"][accessor];
        let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let offset = view["byteOffset"].as_u64().unwrap_or(0) + accessor["byteOffset"].as_u64().unwrap_or(0);
        let last = accessor["count"].as_u64().unwrap() as usize - 1;
        let at = offset as usize + last * width * 4;
        bin[at..at + width * 4].chunks_exact(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    let nodes = json["nodes"].as_array().unwrap();
    let pile = nodes.iter().find(|node| node["name"] == "pile").unwrap();
    let mut all = BTreeMap::new();
    for body in pile["children"].as_array().unwrap() {
        let index = body.as_u64().unwrap() as usize;
        let node = &nodes[index];
        let own = |key: &str| -> Vec<u32> {
            node[key].as_array().unwrap().iter().map(|x| (x.as_f64().unwrap() as f32).to_bits()).collect()
        };
        let mut pose = json!({ "translation": own("translation"), "rotation": own("rotation") });
        let channels = json["animations"][0]["channels"].as_array().cloned().unwrap_or_default();
        for channel in channels.iter().filter(|channel| channel["target"]["node"] == index) {
            let path = channel["target"]["path"].as_str().unwrap();
            let sampler = &json["animations"][0]["samplers"][channel["sampler"].as_u64().unwrap() as usize];
            let width = if path == "rotation" { 4 } else { 3 };
            if path != "scale" {
                pose[path] = json!(floats(sampler["output"].as_u64().unwrap() as usize, width));
            }
        }
        all.insert(node["name"].as_str().unwrap().to_owned(), pose);
    }
    all
}

/// Bodies of one result that another one has under the same name, with the same bits.
fn shared(one: &BTreeMap<String, Value>, other: &BTreeMap<String, Value>) -> usize {
    one.iter().filter(|(name, pose)| other.get(*name) == Some(*pose)).count()
}

/// Over two bakes from earlier results, names and bits of what is far from the change stay; the file says what it was
/// made from, and is verified with all before it.
#[test]
fn a_chain_of_results_keeps_names_and_bits_and_is_verified() {
    let desk = desk();
    desk.line(&format!("bake --control short.glb {HOW} -o a.glb")).ok();
    desk.line(&format!("bake --control long.glb {HOW} --from a.glb -o b.glb --report b.json")).ok();
    desk.line(&format!("bake --control short.glb {HOW} --from b.glb -o c.glb")).ok();
    let [a, b, c] = ["a.glb", "b.glb", "c.glb"].map(|name| ends(&desk, name));
    let report: Value = serde_json::from_slice(&std::fs::read(desk.path("b.json")).unwrap()).unwrap();
    let counted = |name: &str| report["counts"][name].as_u64().unwrap() as usize;
    assert_eq!(counted("bodies_kept") + counted("bodies_moved") + counted("bodies_gone"), a.len());
    assert!(shared(&a, &b) >= counted("bodies_kept"), "{} of {}", shared(&a, &b), counted("bodies_kept"));
    assert!(shared(&a, &b) * 2 > a.len(), "{} of {} bodies are kept", shared(&a, &b), a.len());
    assert!(shared(&a, &c) * 2 > a.len(), "{} of {} bodies are kept over two bakes", shared(&a, &c), a.len());
    let said = desk.line("verify c.glb").ok();
    for result in ["a.glb: the same", "b.glb: the same", "c.glb: the same"] {
        assert!(said.contains(result), "{said}");
    }
    // What changed is in the request: another predecessor is another one.
    std::fs::copy(desk.path("b.glb"), desk.path("a.glb")).unwrap();
    desk.line("verify b.glb").fails(65, &["its file a.glb is not here with the content that was baked"]);
}

/// Other ways to fill, several shapes, a container, an entrance and a separation: bodies far from the change stay.
#[test]
fn an_earlier_result_goes_with_other_ways_to_bake() {
    let desk = desk();
    let mut document = box_json();
    document["nodes"][0]["translation"] = json!([-0.6, 0.15, 0.0]);
    desk.write("apart.glb", glb(&document, &box_data([0.3, 0.3, 0.3])));
    let bin = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets/bin.glb");
    std::fs::copy(bin, desk.path("bin.glb")).unwrap();
    let longer = ["--control short.glb", "--control long.glb"];
    let both = ["--control short.glb --control apart.glb", "--control long.glb --control apart.glb"];
    let fuller = ["--set fill.share=0.55", "--set fill.share=0.8"];
    for (scale, how, [before, after], least) in [
        (1.4, "--set fill=pour", longer, 0.5),
        (1.4, "--set fill=stack --set entrance=rain", longer, 0.5),
        (1.4, "--set hold.separate=on", both, 0.5),
        // All but the lowest are near what was the top.
        (2.0, "--static bin.glb --set fill.into=bin.glb", fuller, 0.1),
    ] {
        let size = format!("--set props.0.scale_min={scale} --set props.0.scale_max={scale}");
        let same = format!("--prop crumb.glb --accuracy draft --seed 3 --quiet {size} {how}");
        desk.line(&format!("bake {same} {before} -o a.glb")).ok();
        desk.line(&format!("bake {same} {after} --from a.glb -o b.glb --report b.json")).ok();
        let [a, b] = ["a.glb", "b.glb"].map(|name| ends(&desk, name));
        let report: Value = serde_json::from_slice(&std::fs::read(desk.path("b.json")).unwrap()).unwrap();
        let counted = |name: &str| report["counts"][name].as_u64().unwrap() as usize;
        let kept = counted("bodies_kept");
        assert_eq!(kept + counted("bodies_moved") + counted("bodies_gone"), a.len(), "{how}");
        assert!(kept as f64 >= least * a.len() as f64 && counted("bodies_new") > 0, "{how}: {kept} of {}", a.len());
        assert!(shared(&a, &b) >= kept, "{how}: {} of {kept} kept bodies are the same", shared(&a, &b));
    }
}

/// A result whose state was changed is refused, with the file and the field.
#[test]
fn a_damaged_result_is_refused() {
    let desk = desk();
    desk.line(&format!("bake --control short.glb {HOW} --set fill.count=5 -o a.glb")).ok();
    let bytes = std::fs::read(desk.path("a.glb")).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let pile = json["nodes"].as_array().unwrap().iter().find(|node| node["name"] == "pile").unwrap();
    let view = pile["extras"]["cairn"]["state"].as_u64().unwrap() as usize;
    let begin = 20 + length + 8 + json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
    // The version; the prop of the first body, behind seven counts and the ground.
    for (at, words) in [(0, "what it holds of its pile is damaged"), (36, "its bodies and its props disagree")] {
        let mut changed = bytes.clone();
        changed[begin + at] = 9;
        desk.write("changed.glb", changed);
        desk.line(&format!("check --control long.glb {HOW} --from changed.glb")).fails(65, &["changed.glb", words]);
    }
}
