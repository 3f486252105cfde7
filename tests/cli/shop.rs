//! A folder with a file for each fault of files, props, control meshes and scenes.

use crate::cli::desk::{Desk, box_data, box_json, glb};
use serde_json::{Value, json};
use std::path::Path;

/// A box's document, changed.
fn changed(change: impl FnOnce(&mut Value)) -> Value {
    let mut document = box_json();
    change(&mut document);
    document
}

/// Boxes of these sizes at these places, each facing inward or outward, as one mesh of several primitives.
fn boxes(parts: &[([f32; 3], [f32; 3], bool)]) -> Vec<u8> {
    let mut data = Vec::new();
    let mut document = box_json();
    let (mut views, mut accessors, mut primitives) = (Vec::new(), Vec::new(), Vec::new());
    for (size, place, is_inward) in parts {
        let mut own = box_data(*size);
        for point in own[..96].chunks_exact_mut(12) {
            for (axis, value) in point.chunks_exact_mut(4).enumerate() {
                let moved = f32::from_le_bytes(value.try_into().unwrap()) + place[axis];
                value.copy_from_slice(&moved.to_le_bytes());
            }
        }
        if *is_inward {
            own[96..].chunks_exact_mut(6).for_each(|triangle| {
                let (first, second) = triangle.split_at_mut(2);
                first.swap_with_slice(&mut second[..2]);
            });
        }
        let begin = data.len();
        let first = accessors.len();
        views.push(json!({ "buffer": 0, "byteOffset": begin, "byteLength": 96 }));
        views.push(json!({ "buffer": 0, "byteOffset": begin + 96, "byteLength": 72 }));
        accessors.push(json!({ "bufferView": first, "componentType": 5126, "count": 8, "type": "VEC3" }));
        accessors.push(json!({ "bufferView": first + 1, "componentType": 5123, "count": 36, "type": "SCALAR" }));
        primitives.push(json!({ "attributes": { "POSITION": first }, "indices": first + 1 }));
        data.extend(own);
    }
    document["bufferViews"] = json!(views);
    document["accessors"] = json!(accessors);
    document["meshes"][0]["primitives"] = json!(primitives);
    document["buffers"][0]["byteLength"] = json!(data.len());
    glb(&document, &data)
}

/// A ball of 80,000 triangles.
fn dense() -> Vec<u8> {
    const SIDES: u32 = 200;
    let turn = |k: u32| f64::from(k) / f64::from(SIDES) * std::f64::consts::TAU;
    let point = |row: u32, k: u32| {
        let (down, around) = (turn(row) / 2.0, turn(k));
        [down.sin() * around.cos(), down.cos(), down.sin() * around.sin()].map(|x| (0.1 * x) as f32)
    };
    let all = |row: u32| (0..SIDES).map(move |k| [row, k]);
    let at = |row: u32, k: u32| row * SIDES + k % SIDES;
    let points = (0..=SIDES).flat_map(all).flat_map(|[row, k]| point(row, k));
    let quads = (0..SIDES).flat_map(all);
    let corners = quads.flat_map(|[row, k]| {
        let [a, b, c, d] = [at(row, k), at(row, k + 1), at(row + 1, k + 1), at(row + 1, k)];
        [a, b, c, a, c, d]
    });
    let mut data: Vec<u8> = points.flat_map(f32::to_le_bytes).collect();
    let split = data.len();
    data.extend(corners.flat_map(u32::to_le_bytes));
    let document = changed(|json| {
        let [count, length] = [(SIDES + 1) * SIDES, data.len() as u32];
        json["accessors"][0]["count"] = json!(count);
        json["accessors"][0]["min"] = json!([-0.1, -0.1, -0.1]);
        json["accessors"][0]["max"] = json!([0.1, 0.1, 0.1]);
        json["accessors"][1]["count"] = json!(6 * SIDES * SIDES);
        json["accessors"][1]["componentType"] = json!(5125);
        json["bufferViews"][0]["byteLength"] = json!(split);
        json["bufferViews"][1] = json!({ "buffer": 0, "byteOffset": split, "byteLength": length - split as u32 });
        json["buffers"][0]["byteLength"] = json!(length);
    });
    glb(&document, &data)
}

/// A folder with a file for each fault.
pub fn shop() -> Desk {
    let desk = Desk::new();
    let data = box_data([0.3, 0.2, 0.4]);
    let file = |name: &str, change: &dyn Fn(&mut Value)| desk.write(name, glb(&changed(|json| change(json)), &data));
    let text = |name: &str, change: &dyn Fn(&mut Value)| {
        let percent: String = data.iter().map(|byte| format!("%{byte:02x}")).collect();
        let mut document = box_json();
        document["buffers"][0]["uri"] = json!(format!("data:,{percent}"));
        change(&mut document);
        desk.write(name, document.to_string());
    };
    // Files.
    desk.write("dense.glb", dense());
    desk.write("empty.glb", "");
    desk.write("text.glb", "this is no model");
    desk.write("broken.gltf", "{ \"asset\": { \"version\": \"2.0\" }, ");
    let whole = glb(&box_json(), &data);
    desk.write("cut.glb", &whole[..whole.len() - 40]);
    text("old.gltf", &|json| json["asset"]["version"] = json!("1.0"));
    file("bent.glb", &|json| {
        json["extensionsRequired"] = json!(["ACME_bend"]);
        json["nodes"][0]["extensions"] = json!({ "ACME_bend": {} });
    });
    file("unused.glb", &|json| json["extensionsRequired"] = json!(["ACME_bend"]));
    file("lines.glb", &|json| json["meshes"][0]["primitives"][0]["mode"] = json!(1));
    file("mixed.glb", &|json| {
        let primitive = json["meshes"][0]["primitives"][0].clone();
        json["meshes"][0]["primitives"] = json!([primitive, { "attributes": { "POSITION": 0 }, "mode": 0 }]);
    });
    file("lacking.glb", &|json| drop(json["accessors"][0].as_object_mut().unwrap().remove("count")));
    file("typed.glb", &|json| json["accessors"][0]["count"] = json!("eight"));
    file("astray.glb", &|json| json["nodes"][0]["mesh"] = json!(7));
    file("circle.glb", &|json| json["nodes"] = json!([{ "mesh": 0, "children": [1] }, { "children": [0] }]));
    file("shared.glb", &|json| {
        json["nodes"] = json!([{ "children": [1, 2] }, { "children": [3] }, { "children": [3] }, { "mesh": 0 }]);
    });
    file("unturned.glb", &|json| json["nodes"][0]["rotation"] = json!([0, 0, 0, 0]));
    file("loose.glb", &|json| json["nodes"][0]["rotation"] = json!([0, 0, 0, 1.1]));
    file("projected.glb", &|json| {
        json["nodes"][0]["matrix"] = json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    });
    file("endless.glb", &|json| {
        let scale = json!([1e200, 1e200, 1e200]);
        json["nodes"] = json!([{ "scale": scale, "children": [1] }, { "scale": scale, "mesh": 0 }]);
    });
    file("far.glb", &|json| json["nodes"][0]["translation"] = json!([1e15, 0, 0]));
    file("twins.glb", &|json| {
        json["nodes"] = json!([{ "name": "Brick", "mesh": 0 }, { "name": "Brick", "mesh": 0 }]);
        json["scenes"][0]["nodes"] = json!([0, 1]);
    });
    text("above.gltf", &|json| json["buffers"][0]["uri"] = json!("../brick.bin"));
    text("bufferless.gltf", &|json| json["buffers"][0]["uri"] = json!("gone.bin"));
    text("garbled.gltf", &|json| json["buffers"][0]["uri"] = json!("data:;base64,?"));
    text("nothing.gltf", &|json| drop(json["buffers"][0].as_object_mut().unwrap().remove("uri")));
    text("short.gltf", &|json| json["buffers"][0]["uri"] = json!("data:,%01%02"));
    file("beyond.glb", &|json| json["accessors"][0]["count"] = json!(9));
    file("bytes.glb", &|json| json["accessors"][1]["componentType"] = json!(5126));
    file("strided.glb", &|json| json["bufferViews"][0]["byteStride"] = json!(4));
    file("packed.glb", &|json| {
        json["meshes"][0]["primitives"][0]["extensions"] =
            json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": { "POSITION": 0 } } });
        json["accessors"].as_array_mut().unwrap().iter_mut().for_each(|accessor| {
            accessor.as_object_mut().unwrap().remove("bufferView");
        });
    });
    let mut restarted = data.clone();
    restarted[96..98].copy_from_slice(&u16::MAX.to_le_bytes());
    let as_strip = changed(|json| json["meshes"][0]["primitives"][0]["mode"] = json!(5));
    desk.write("strip.glb", glb(&as_strip, &restarted));
    file("sparse.glb", &|json| {
        let places = json!({ "bufferView": 1, "componentType": 5123 });
        json["accessors"][0]["sparse"] = json!({ "count": 9, "indices": places, "values": { "bufferView": 0 } });
    });
    file("faulty.glb", &|json| {
        json["nodes"] = json!((0..90).map(|i| json!({ "mesh": 7 + i })).collect::<Vec<_>>());
        json["scenes"][0]["nodes"] = json!((0..90).collect::<Vec<_>>());
    });
    file("few.glb", &|json| json["accessors"][0]["count"] = json!(4));
    let mut nan = data.clone();
    nan[0..4].copy_from_slice(&f32::NAN.to_le_bytes());
    desk.write("nan.glb", glb(&box_json(), &nan));
    file("sceneless.glb", &|json| drop(json.as_object_mut().unwrap().remove("scenes")));
    file("scenes.glb", &|json| json["scenes"] = json!([{ "nodes": [0] }, { "name": "Second", "nodes": [0] }]));
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    file("hidden.glb", &|json| {
        json["nodes"] = json!([{ "mesh": 0 }, { "name": "Proxy", "mesh": 0, "extensions": hidden }]);
        json["scenes"][0]["nodes"] = json!([0, 1]);
    });
    let skin = |json: &mut Value| {
        json["nodes"][0]["skin"] = json!(0);
        json["skins"] = json!([{ "joints": [0] }]);
    };
    file("doll.glb", &|json| skin(json));
    desk.write("giant-doll.glb", glb(&changed(skin), &box_data([0.1, 100.0, 0.1])));
    file("morph.glb", &|json| json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 0 }]));
    file("fat.glb", &|json| {
        json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": 0 }]);
        json["meshes"][0]["weights"] = json!([1]);
    });
    file("unplaced.glb", &|json| {
        let primitive = json["meshes"][0]["primitives"][0].clone();
        json["meshes"][0]["primitives"] = json!([primitive, { "attributes": {} }]);
    });
    file("uneven.glb", &|json| json["accessors"][1]["count"] = json!(35));
    let mut needles = data.clone();
    needles[98..100].copy_from_slice(&0_u16.to_le_bytes());
    desk.write("needles.glb", glb(&box_json(), &needles));
    // What is no file, or none to be changed.
    for folder in ["folder.glb", "results"] {
        std::fs::create_dir(desk.path(folder)).unwrap();
    }
    desk.write("results/1.glb", &whole);
    let figures = json!({ "output_blake3": "0", "measures": {}, "warnings": [], "bodies": 1 });
    desk.write("results/1.report.json", figures.to_string());
    std::fs::File::create(desk.path("huge.glb")).unwrap().set_len((1 << 30) + 1).unwrap();
    desk.write("blank.txt", "\n");
    desk.write("locked.json", "{}");
    let mut locked = std::fs::metadata(desk.path("locked.json")).unwrap().permissions();
    locked.set_readonly(true);
    std::fs::set_permissions(desk.path("locked.json"), locked).unwrap();
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
    #[cfg(unix)]
    std::os::unix::fs::symlink(assets.join("cone-small.glb"), desk.path("linked.glb")).unwrap();
    let far = json!({ "control_mesh": "cone.glb", "props": [assets.join("stick.glb")] });
    desk.write("far.json", far.to_string());
    // What a result leaves out.
    let pictured = |json: &mut Value, uri: &str| {
        json["meshes"][0]["primitives"][0]["material"] = json!(0);
        json["materials"] = json!([{ "name": "Clay", "normalTexture": { "index": 0 } }]);
        json["textures"] = json!([{ "source": 0 }]);
        json["images"] = json!([{ "uri": uri }]);
    };
    text("pictured.gltf", &|json| pictured(json, "textures/gone.png"));
    text("distant.gltf", &|json| pictured(json, "https://example.org/red.png"));
    text("text-picture.gltf", &|json| pictured(json, "text.glb"));
    text("unnumbered.gltf", &|json| json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(-1));
    text("counted.gltf", &|json| {
        json["accessors"].as_array_mut().unwrap().push(json!({
            "bufferView": 0, "componentType": 5126, "count": 7, "type": "VEC3",
        }));
        json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(2);
    });
    for (name, primitive) in [("bare.gltf", json!({})), ("numbered.gltf", json!(1))] {
        text(name, &|json| json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive.clone()));
    }
    text("halting.gltf", &|json| {
        let accessors = json["accessors"].as_array_mut().unwrap();
        accessors.push(json!({ "bufferView": 1, "componentType": 5126, "count": 4, "type": "SCALAR" }));
        accessors.push(json!({ "bufferView": 0, "componentType": 5126, "count": 2, "type": "VEC3" }));
        json["animations"] = json!([{
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
            "samplers": [{ "input": 2, "output": 3 }],
        }]);
    });
    text("smudged.gltf", &|json| json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(77));
    file("filmed.glb", &|json| {
        json["nodes"][0]["camera"] = json!(0);
        json["cameras"] = json!([{ "type": "perspective" }]);
    });
    for (name, count) in [("forest.glb", 1001), ("grove.glb", 3)] {
        let places = (0..count).flat_map(|i| [i as f32 * 0.002, 0.0, 0.0]);
        let bytes: Vec<u8> = data.iter().copied().chain(places.flat_map(f32::to_le_bytes)).collect();
        let document = changed(|json| {
            let view = json!({ "buffer": 0, "byteOffset": 168, "byteLength": 12 * count });
            json["bufferViews"].as_array_mut().unwrap().push(view);
            let accessor = json!({ "bufferView": 2, "componentType": 5126, "count": count, "type": "VEC3" });
            json["accessors"].as_array_mut().unwrap().push(accessor);
            json["buffers"][0]["byteLength"] = json!(168 + 12 * count);
            json["nodes"][0]["extensions"] =
                json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 2 } } });
        });
        desk.write(name, glb(&document, &bytes));
    }
    // Control meshes and props.
    let large = box_data([4.0; 3]);
    let with_faces = |count: usize| changed(|json| json["accessors"][1]["count"] = json!(count));
    desk.write("lidless.glb", glb(&with_faces(30), &large));
    desk.write("torn.glb", glb(&with_faces(12), &large));
    desk.write("open-prop.glb", glb(&with_faces(30), &data));
    let room = |size: f32| ([size; 3], [0.0, 2.0, 0.0]);
    for (name, inner) in [("skin.glb", 3.9999), ("shell.glb", 3.8)] {
        let ((outer, place), (inner, _)) = (room(4.0), room(inner));
        desk.write(name, boxes(&[(outer, place, false), (inner, place, true)]));
    }
    desk.write("slab.glb", boxes(&[([5.0, 0.32, 5.0], [0.0, 0.16, 0.0], false)]));
    let rod = |i: usize| ([0.1, 3.0, 0.1], [2.0 + 0.3 * (i / 14) as f32, 1.5, 0.3 * (i % 14) as f32], false);
    let cube = ([1.0; 3], [0.0, 0.5, 0.0], false);
    desk.write("rods.glb", boxes(&std::iter::once(cube).chain((0..168).map(rod)).collect::<Vec<_>>()));
    desk.write(
        "partly.glb",
        boxes(&[([1.0; 3], [0.0, 0.5, 0.0], false), ([6.0, 0.15, 6.0], [9.0, 0.075, 0.0], false)]),
    );
    desk.write("crumb.glb", boxes(&[([0.02; 3], [0.0; 3], false)]));
    desk.write("grain.glb", boxes(&[([4e-4; 3], [0.0; 3], false)]));
    desk.write("pinch.glb", boxes(&[([2e-3; 3], [0.0, 1e-3, 0.0], false)]));
    desk.write("beam.glb", boxes(&[([0.1, 100.0, 0.1], [0.0; 3], false)]));
    desk.write("distant.glb", boxes(&[([1.0; 3], [500.0, 0.5, 0.0], false)]));
    desk.write("wide.glb", boxes(&[([9.0, 3.0, 9.0], [0.0, 1.5, 0.0], false)]));
    let (unit, beside) = (([1.0; 3], [0.0, 0.5, 0.0], false), |x| ([1.0; 3], [x, 0.5, 0.0], false));
    desk.write("apart.glb", boxes(&[unit, beside(3.0)]));
    desk.write("touching.glb", boxes(&[unit, beside(1.0)]));
    desk.write("overlapping.glb", boxes(&[unit, beside(0.5)]));
    desk.write("cavity.glb", boxes(&[unit, ([0.4; 3], [0.0, 0.5, 0.0], true)]));
    desk.write("doubled.glb", boxes(&[unit, unit]));
    desk.write("reversed.glb", boxes(&[([1.0; 3], [0.0, 0.5, 0.0], true)]));
    desk.write("hollow.glb", boxes(&[([0.3; 3], [0.0; 3], false), ([0.28; 3], [0.0; 3], true)]));
    let mut flipped = box_data([1.0; 3]);
    let (first, second) = flipped[96..100].split_at_mut(2);
    first.swap_with_slice(second);
    desk.write("flipped.glb", glb(&box_json(), &flipped));
    // It stands on one corner.
    desk.write(
        "top.glb",
        glb(
            &changed(|json| json["nodes"][0]["rotation"] = json!([0.325_057_6, 0.0, 0.325_057_6, 0.888_073_8])),
            &box_data([1.0; 3]),
        ),
    );
    // Scenes with bodies, emitters and moving scenery.
    let scene = |name: &str, more: &str| {
        desk.write(
            name,
            format!("control_mesh = 'cone.glb'\nprops = ['stick.glb', {{ path = 'brick.glb', weight = 0 }}]\n{more}"),
        );
    };
    for (name, body) in [
        ("placed.toml", "position = [9, 0.2, 0]"),
        ("placed-wrong.toml", "prop = '5'\nposition = [9, 0.2, 0]"),
        ("flat-place.toml", "position = [9, 0.2]"),
        ("unrotated.toml", "position = [9, 0.2, 0]\nrotation = [0, 0, 0, 0]"),
        ("kept.toml", "position = [9, 0.2, 0]\nkept = true\nkept_until_seconds = 2"),
        ("kept-thrown.toml", "position = [9, 0.2, 0]\nkept = true\nvelocity = [1, 0, 0]"),
        ("until.toml", "position = [9, 0.2, 0]\nkept_until_seconds = 2"),
        ("early.toml", "position = [9, 0.2, 0]\nkept = true\nstart_seconds = 3\nkept_until_seconds = 2"),
        ("thrown.toml", "position = [9, 0.2, 0]\nvelocity = [90, 0, 0]\nstart_seconds = 1"),
    ] {
        scene(name, &format!("[[bodies]]\n{}{body}\n", if body.starts_with("prop") { "" } else { "prop = '0'\n" }));
    }
    for (name, emitter) in [
        ("emitter.toml", "center = [0, 3, 0]\nsize = [1, 1, 1]"),
        ("emitter-high.toml", "center = [0, 90, 0]\nsize = [1, 1, 1]"),
        ("weightless.toml", "center = [0, 3, 0]\nsize = [1, 1, 1]\nprops = ['1']"),
        ("holed.toml", "mesh = 'torn.glb'"),
    ] {
        scene(name, &format!("[[emitters]]\n{emitter}\nrate = 5\ncount = 2\n"));
    }
    desk.write(
        "named-twice.toml",
        "control_mesh = 'cone.glb'\nprops = ['stick.glb', 'stick.glb']\n\
         [[bodies]]\nprop = 'stick'\nposition = [9, 0, 0]\n",
    );
    scene("keys.toml", "[[statics]]\npath = 'brick.glb'\nkeyframes = [{ frame = 2 }, { frame = 1 }]\n");
    let kit = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets/kit.usda")).unwrap();
    let caged = kit.replace("uniform token subdivisionScheme = \"none\"", "").replace("UsdPreviewSurface", "Other");
    let others = "def Xform \"Slab\"\n    {\n        def Sphere \"ball\"\n        {\n        }\n        \
                  def SkelRoot \"doll\"\n        {\n        }\n";
    desk.write("caged.usda", caged.replace("def Xform \"Slab\"\n    {\n", others));
    desk.write("lost.usda", "#usda 1.0\n(\n    subLayers = [@./gone.usda@]\n)\n");
    desk.write("kit.usda", kit);
    let catalogue = "[[props]]\npath = \"stick.glb\"\n";
    let places = "[[places]]\npath = \"brick.glb\"\n";
    desk.write("clutter.toml", format!("{catalogue}{places}"));
    desk.write("clutter-none.toml", catalogue);
    let camera = "camera = { position = [0, 1, 0], look_at = [0, 1, 0] }\n";
    let far = "camera = { look_at = [0, 1e9, 0] }\n";
    desk.write("clutter-camera.toml", format!("{camera}{catalogue}{places}{far}"));
    desk.write("clutter-field.toml", format!("{catalogue}{places}wieght = 2\n"));
    desk
}
