//! Models as the world writes them: nothing of them is lost in silence.

use crate::cli::desk::{Desk, box_data, box_json, glb};
use serde_json::{Value, json};

/// A picture of one pixel.
const PNG: &[u8] = &[
    0x89, b'P', b'N', b'G', 13, 10, 26, 10, 0, 0, 0, 13, b'I', b'H', b'D', b'R', 0, 0, 0, 1, 0, 0, 0, 1, 8, 2, 0, 0, 0,
    0x90, 0x77, 0x53, 0xde, 0, 0, 0, 12, b'I', b'D', b'A', b'T', 8, 0xd7, 0x63, 0xf8, 0xcf, 0xc0, 0, 0, 3, 1, 1, 0,
    0x18, 0xdd, 0x8d, 0xb0, 0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82,
];

const BAKE: &str = "bake --control cone.glb --accuracy draft --set fill.count=3 -o pile.glb";

/// A brick whose material `Clay` has a picture of this URI, and its buffer inside or at another URI.
fn painted(picture: &str, buffer: Option<&str>) -> Value {
    let mut document = box_json();
    document["meshes"][0]["primitives"][0]["material"] = json!(0);
    document["materials"] = json!([{ "name": "Clay", "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    document["textures"] = json!([{ "source": 0 }]);
    document["images"] = json!([{ "uri": picture }]);
    document["buffers"][0]["uri"] = json!(buffer.map_or_else(inline, str::to_owned));
    document
}

/// The buffer of a brick as a data URI.
fn inline() -> String {
    let data: String = box_data([0.3, 0.2, 0.4]).iter().map(|byte| format!("%{byte:02x}")).collect();
    format!("data:application/octet-stream,{data}")
}

/// The JSON of a `.glb`.
fn json_of(desk: &Desk, name: &str) -> Value {
    let bytes = std::fs::read(desk.path(name)).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

/// A folder with the picture at `kit/textures/Red.png`, for a model in `kit/gltf`.
fn kit() -> Desk {
    let desk = Desk::new();
    for folder in ["kit/gltf/sub", "kit/textures"] {
        std::fs::create_dir_all(desk.path(folder)).unwrap();
    }
    desk.write("kit/textures/Red.png", PNG);
    for name in ["own.png", "two words.png", "10%.png", "50%25.png", "sub/deep.png"] {
        desk.write(&format!("kit/gltf/{name}"), PNG);
    }
    desk
}

#[test]
fn pictures_are_found_under_every_name_that_means_them() {
    let desk = kit();
    for uri in [
        "own.png",
        "./own.png",
        ".\\own.png",
        "OWN.PNG",
        "two words.png",
        "two%20words.png",
        "10%.png",
        "10%25.png",
        "50%25.png",
        "sub\\deep.png",
        "Sub/Deep.png",
        "sub/../own.png",
        "../textures/Red.png",
        "..\\textures\\Red.png",
        "../Textures/red.PNG",
        "C:\\work\\kit\\gltf\\own.png",
        "D:/kit/sub/deep.png",
        "/home/someone/own.png",
        "file:///home/someone/own.png",
    ] {
        desk.write("kit/gltf/brick.gltf", painted(uri, None).to_string());
        let done = desk.line(&format!("{BAKE} --prop kit/gltf/brick.gltf"));
        assert!(done.code == 0 && !done.stderr.contains("image"), "{uri}: {}", done.stderr);
        let image = &json_of(&desk, "pile.glb")["images"][0];
        assert!(image["mimeType"] == "image/png" && image["bufferView"].is_u64(), "{uri}: {image}");
    }
    // Scene, files and their hashes are in the result: it can be repeated.
    desk.write("kit/gltf/brick.gltf", painted("../Textures/red.PNG", None).to_string());
    desk.line(&format!("{BAKE} --prop kit/gltf/brick.gltf")).ok();
    let assets = json_of(&desk, "pile.glb")["asset"]["extras"]["cairn"]["assets"].to_string();
    assert!(assets.contains("\"kit/Textures/red.PNG\""), "{assets}");
    assert_eq!(desk.line("verify pile.glb").ok(), "pile.glb: the same\n");
}

/// Each warning names model, image, material and the places that were searched: in `check`, in the bake, in its report.
#[test]
fn pictures_that_are_not_found_are_reported() {
    let desk = kit();
    desk.write("kit/gltf/none.png", "this is no picture");
    desk.write("kit/secret", "this is no picture either");
    for (uri, words) in [
        ("gone.png", "was not found (looked for kit/gltf/gone.png): the result shows the material without it"),
        ("../gone.png", "was not found (looked for kit/gone.png)"),
        ("C:\\a\\gone.png", "was not found (looked for kit/gltf/a/gone.png, kit/gltf/gone.png)"),
        ("a%20b.png", "was not found (looked for kit/gltf/a b.png, kit/gltf/a%20b.png)"),
        ("../secret", "was not found (looked for kit/secret)"),
        ("https://example.org/a.png", "is not read, because it names a scheme"),
        ("none.png", "is no PNG, JPEG, WebP, AVIF, KTX2 or DDS file"),
    ] {
        desk.write("kit/gltf/brick.gltf", painted(uri, None).to_string());
        let expected = format!("kit/gltf/brick.gltf: the image \"{uri}\" of material `Clay`");
        let checked = desk.line("check --control cone.glb --prop kit/gltf/brick.gltf").ok();
        let done = desk.line(&format!("{BAKE} --prop kit/gltf/brick.gltf --report report.json"));
        assert_eq!(done.code, 0, "{}", done.stderr);
        let report: Value = serde_json::from_slice(&std::fs::read(desk.path("report.json")).unwrap()).unwrap();
        for text in [&checked, &done.stderr, &report["notes"].as_array().unwrap()[0].as_str().unwrap().to_owned()] {
            assert!(text.contains(&expected) && text.contains(words), "{uri}: {text}");
        }
    }
    // A material that nothing shows is not missed, and neither is the picture of a control mesh.
    let mut unused = painted("gone.png", None);
    unused["meshes"][0]["primitives"][0]["material"] = json!(null);
    desk.write("unused.gltf", unused.to_string());
    desk.write("painted.gltf", painted("gone.png", None).to_string());
    let small = "--set props.0.scale_min=0.2 --set props.0.scale_max=0.2";
    let checked = desk.line(&format!("check --control painted.gltf --prop unused.gltf {small}")).ok();
    assert!(!checked.contains("image"), "{checked}");
    // A still has no warning of its own place.
    let done = desk.line("render kit/gltf/brick.gltf -o still.png --size 40x30 --samples 1");
    assert!(done.code == 0 && done.stderr.contains("is not shown"), "{}", done.stderr);
}

#[test]
fn buffers_are_found_under_every_name_that_means_them() {
    let desk = kit();
    for name in ["test.bin", "example 10%.bin", "raw space.bin", "sub/deep.bin"] {
        desk.write(&format!("kit/gltf/{name}"), box_data([0.3, 0.2, 0.4]));
    }
    for uri in [
        "test.bin",
        ".\\test.bin",
        "TEST.bin",
        "example 10%.bin",
        "example%2010%25.bin",
        "raw space.bin",
        "raw%20space.bin",
        "sub\\deep.bin",
        "C:\\export\\test.bin",
    ] {
        desk.write("kit/gltf/brick.gltf", painted("own.png", Some(uri)).to_string());
        let done = desk.line(&format!("{BAKE} --prop kit/gltf/brick.gltf"));
        assert_eq!(done.code, 0, "{uri}: {}", done.stderr);
    }
    for (uri, words) in [
        ("gone.bin", &["kit/gltf/gone.bin: no such file", "Put the .bin file"][..]),
        ("../textures/Red.png", &["it leads out of the glTF's folder", "write its plain name"]),
        ("a.bin:stream", &["it names a scheme or a stream", "write its plain name"]),
    ] {
        desk.write("kit/gltf/brick.gltf", painted("own.png", Some(uri)).to_string());
        desk.line("check --control cone.glb --prop kit/gltf/brick.gltf").fails(65, words);
    }
}

/// What decorates and cannot be read is left out, and said so; it does not cost the bake.
#[test]
fn broken_decoration_is_left_out() {
    let desk = Desk::new();
    let mut document = painted("own.png", None);
    document["images"] = json!([{ "bufferView": 99, "mimeType": "image/png" }]);
    document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(77);
    document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!("none");
    desk.write("brick.gltf", document.to_string());
    let done = desk.line(&format!("{BAKE} --prop brick.gltf"));
    assert_eq!(done.code, 0, "{}", done.stderr);
    for words in ["NORMAL of mesh 0 cannot be read", "baseColorTexture of material Clay cannot be read"] {
        assert!(done.stderr.contains(words), "{words}: {}", done.stderr);
    }
    document["meshes"][0]["primitives"][0]["material"] = json!(5);
    desk.write("brick.gltf", document.to_string());
    let done = desk.line(&format!("{BAKE} --prop brick.gltf"));
    assert!(done.code == 0 && done.stderr.contains("the material of mesh 0 cannot be read"), "{}", done.stderr);
}

/// A brick, shown by `nodes`.
fn nodes(nodes: Value) -> Vec<u8> {
    let mut document = box_json();
    document["nodes"] = nodes;
    glb(&document, &box_data([0.3, 0.2, 0.4]))
}

#[test]
fn hidden_nodes_are_no_part_of_anything() {
    let desk = Desk::new();
    let proxy = json!({ "name": "Proxy", "mesh": 0, "scale": [5, 5, 5], "children": [2],
        "extensions": { "KHR_node_visibility": { "visible": false } } });
    let (brick, below) = (json!({ "name": "Brick", "mesh": 0, "children": [1] }), json!({ "name": "Low", "mesh": 0 }));
    desk.write("brick.glb", nodes(json!([brick, proxy, below])));
    let check = |prop: &str| desk.line(&format!("check --control cone.glb --prop {prop}")).ok();
    let diameter = |text: &str| text.lines().find(|line| line.contains("prop diameter")).unwrap().to_owned();
    let hidden = check("brick.glb");
    assert!(hidden.contains("node `Proxy`: it is hidden (KHR_node_visibility): it is left out"), "{hidden}");
    desk.write("plain.glb", nodes(json!([{ "name": "Brick", "mesh": 0 }])));
    assert_eq!(diameter(&hidden), diameter(&check("plain.glb")));
    assert!(!check("plain.glb").contains("hidden"));
    // Neither the result nor its picture has it.
    desk.line(&format!("{BAKE} --prop brick.glb")).ok();
    let names: Vec<Value> =
        json_of(&desk, "pile.glb")["nodes"].as_array().unwrap().iter().map(|node| node["name"].clone()).collect();
    assert!(names.iter().all(|name| name != "Proxy" && name != "Low"), "{names:?}");
    for name in ["brick", "plain"] {
        desk.line(&format!("render {name}.glb -o {name}.png --size 80x60 --samples 1")).ok();
    }
    let read = |name: &str| std::fs::read(desk.path(name)).unwrap();
    assert!(read("brick.png") == read("plain.png"));
    // What is named is wanted, and what is switched on is seen.
    assert!(check("brick.glb#Low").contains("can be baked"));
    let mut seen = proxy_of(true);
    seen["scale"] = json!([0.5, 0.5, 0.5]);
    desk.write("seen.glb", nodes(json!([seen])));
    assert!(!check("seen.glb").contains("hidden"));
    desk.write("brick.glb", nodes(json!([proxy_of(false)])));
    desk.line("check --control cone.glb --prop brick.glb")
        .fails(65, &["it holds no triangles: its meshes are hidden (KHR_node_visibility, 1 node)"]);
}

fn proxy_of(visible: bool) -> Value {
    json!({ "mesh": 0, "extensions": { "KHR_node_visibility": { "visible": visible } } })
}

/// Instances of a node are nodes of the result, which every program shows; the extension stays where it is asked for.
#[test]
fn instances_become_nodes() {
    let desk = Desk::new();
    let mut document = box_json();
    let mut data = box_data([0.1, 0.1, 0.1]);
    let places = [[0.0f32, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.3, 0.1]];
    data.extend(places.iter().flatten().flat_map(|x| x.to_le_bytes()));
    let view = json!({ "buffer": 0, "byteOffset": 168, "byteLength": 36 });
    document["bufferViews"].as_array_mut().unwrap().push(view);
    let accessor = json!({ "bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC3" });
    document["accessors"].as_array_mut().unwrap().push(accessor);
    document["buffers"][0]["byteLength"] = json!(204);
    document["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 2 } } });
    document["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    desk.write("copies.glb", glb(&document, &data));
    desk.line(&format!("{BAKE} --prop copies.glb")).ok();
    let pile = json_of(&desk, "pile.glb");
    assert!(pile.get("extensionsUsed").is_none() && pile.get("extensionsRequired").is_none(), "{pile}");
    let shown: Vec<&Value> = pile["nodes"].as_array().unwrap().iter().filter(|n| n["mesh"].is_u64()).collect();
    assert_eq!(shown.len(), 9);
    let place = |node: &Value| {
        let t = node.get("translation").cloned().unwrap_or(json!([0.0, 0.0, 0.0]));
        [0, 1, 2].map(|k| t[k].as_f64().unwrap() as f32)
    };
    let found: Vec<[f32; 3]> = shown[..3].iter().map(|node| place(node)).collect();
    assert_eq!(found, places);
    desk.line(&format!("{BAKE} --prop copies.glb --set output.instancing=true")).ok();
    assert_eq!(json_of(&desk, "pile.glb")["extensionsRequired"], json!(["EXT_mesh_gpu_instancing"]));
}

#[test]
fn morph_targets_have_no_weights_in_the_result() {
    let desk = Desk::new();
    let mut document = box_json();
    document["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 0 }]);
    document["meshes"][0]["weights"] = json!([1]);
    desk.write("fat.glb", glb(&document, &box_data([0.3, 0.2, 0.4])));
    let done = desk.line(&format!("{BAKE} --prop fat.glb"));
    assert!(done.code == 0 && done.stderr.contains("the default weights of its morph targets"), "{}", done.stderr);
    let mesh = &json_of(&desk, "pile.glb")["meshes"][0];
    assert!(mesh.get("weights").is_none() && mesh["primitives"][0]["targets"].is_array(), "{mesh}");
    // Weights of 0 change nothing.
    document["meshes"][0]["weights"] = json!([0]);
    desk.write("fat.glb", glb(&document, &box_data([0.3, 0.2, 0.4])));
    let checked = desk.line("check --control cone.glb --prop fat.glb").ok();
    assert!(!checked.contains("default weights"), "{checked}");
}

/// Notes are often the reason of a problem.
#[test]
fn a_refused_scene_keeps_its_notes() {
    let desk = Desk::new();
    let mut document = box_json();
    document["nodes"][0]["skin"] = json!(0);
    document["skins"] = json!([{ "joints": [0] }]);
    desk.write("doll.glb", glb(&document, &box_data([30.0, 20.0, 40.0])));
    let note = "node `Brick`: its skin is not applied";
    for command in ["check", "plan", "bake -o pile.glb"] {
        let done = desk.line(&format!("{command} --control cone.glb --prop doll.glb"));
        done.fails(65, &["larger than the control mesh", "note: doll.glb: ", note]);
    }
    let done = desk.line("check --json --control cone.glb --prop doll.glb");
    let answer: Value = serde_json::from_str(&done.stdout).unwrap();
    assert!(answer["ok"] == false && answer["notes"][0].as_str().unwrap().contains(note), "{answer}");
    // Where a file cannot be read, the notes of the others stay.
    desk.line("check --control cone.glb --prop doll.glb --prop gone.glb").fails(65, &["gone.glb: no such file", note]);
}

/// Archives keep results with their files, but not their folders.
#[test]
fn files_of_a_result_are_found_by_their_content() {
    let desk = Desk::new();
    for folder in ["project/assets", "archive/old", "empty"] {
        std::fs::create_dir_all(desk.path(folder)).unwrap();
    }
    let brick = painted("../pictures/red.png", Some("brick.bin")).to_string();
    std::fs::create_dir(desk.path("project/pictures")).unwrap();
    desk.write("project/pictures/red.png", PNG);
    desk.write("project/assets/brick.bin", box_data([0.3, 0.2, 0.4]));
    desk.write("project/assets/brick.gltf", &brick);
    std::fs::copy(desk.path("cone.glb"), desk.path("project/assets/cone.glb")).unwrap();
    let mut command = desk.command(&["bake", "--control", "assets/cone.glb", "--prop", "assets/brick.gltf"]);
    command.args(["--accuracy", "draft", "--set", "fill.count=3", "-o", "pile.glb"]);
    assert!(command.current_dir(desk.path("project")).output().unwrap().status.success());

    // Laid flat, and under other names.
    for (from, to) in [
        ("pile.glb", "pile.glb"),
        ("assets/cone.glb", "cone.glb"),
        ("assets/brick.gltf", "old/Brick (1).gltf"),
        ("assets/brick.bin", "brick.dat"),
        ("pictures/red.png", "red.png"),
    ] {
        std::fs::rename(desk.path(&format!("project/{from}")), desk.path(&format!("archive/{to}"))).unwrap();
    }
    assert_eq!(desk.line("verify archive/pile.glb").ok(), "archive/pile.glb: the same\n");
    assert_eq!(desk.line("verify archive/pile.glb --assets archive").ok(), "archive/pile.glb: the same\n");
    desk.line("bake archive/pile.glb -o again.glb").ok();
    let read = |name: &str| std::fs::read(desk.path(name)).unwrap();
    assert!(read("again.glb") == read("archive/pile.glb"));
    desk.line("bake archive/pile.glb -o archive/red.png --format glb").fails(65, &["the scene reads this file"]);

    // All that are missing, and no remedy that was followed already.
    std::fs::remove_file(desk.path("archive/red.png")).unwrap();
    desk.write("archive/brick.dat", box_data([0.3, 0.2, 0.5]));
    let missing = ["assets/brick.bin is not here", "pictures/red.png is not here"];
    let done = desk.line("verify archive/pile.glb");
    done.fails(65, &missing);
    done.fails(65, &["Name the folder of the file by --assets"]);
    let done = desk.line("verify archive/pile.glb --assets archive");
    done.fails(65, &missing);
    done.fails(65, &["No file in archive or below it has its SHA-256"]);
    assert!(!done.stderr.contains("Name the folder"), "{}", done.stderr);
}

/// Shapes and scenery by node are where the file has them; only a prop comes alone.
#[test]
fn a_node_stands_where_its_file_places_it() {
    let desk = Desk::new();
    let mut document = box_json();
    document["nodes"][0]["name"] = json!("block");
    document["nodes"][0]["translation"] = json!([5.0, 0.5, 0.0]);
    document["nodes"][0]["scale"] = json!([4.0, 5.0, 3.0]);
    desk.write("placed.glb", glb(&document, &box_data([0.3, 0.2, 0.4])));
    let frames = |scene: &str| {
        desk.line(&format!("bake {scene} --accuracy draft --no-cache --frames 2 -o pile.json")).ok();
        let table: Value = serde_json::from_slice(&std::fs::read(desk.path("pile.json")).unwrap()).unwrap();
        table["frames"].clone()
    };
    for scene in ["--control placed.glb# --prop brick.glb", "--control cone.glb --prop stick.glb --static placed.glb#"]
    {
        let whole = frames(&scene.replace('#', ""));
        assert_eq!(frames(&scene.replace('#', "#block")), whole, "{scene}");
        let x = whole[0][0][0].as_f64().unwrap();
        assert_eq!(x > 4.0, scene.starts_with("--control placed"), "{x}");
    }
}
