//! Stages against what USD's own library shows of them: closed forms, or its answers.

use super::*;
use glam::{Mat4, Quat, Vec3};

fn no_files(_: &str) -> Result<Vec<u8>, String> {
    Err("there are none".into())
}

/// A stage in metres, Y up, with this in its default prim.
fn stage(fields: &str, inside: &str) -> String {
    format!(
        "#usda 1.0\n(\n    defaultPrim = \"X\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n{fields}\n)\n\
         def Xform \"X\"\n{{\n{inside}\n}}\n"
    )
}

/// A mesh of this name, a triangle of 1 x 1 m, with more in it.
fn triangle(name: &str, more: &str) -> String {
    format!(
        "def Mesh \"{name}\"\n{{\n    int[] faceVertexCounts = [3]\n    int[] faceVertexIndices = [0, 1, 2]\n    \
         point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n    uniform token subdivisionScheme = \"none\"\n\
         {more}\n}}\n"
    )
}

/// What a part of a stage shows, or all of it in motion.
struct Shown {
    json: serde_json::Value,
    bin: Vec<u8>,
    notes: Vec<String>,
}

impl Shown {
    fn of(text: &str, parts: &[PartChoice]) -> Shown {
        let ConvertedStage { glb, notes, .. } = convert(text.as_bytes(), &no_files, parts).unwrap();
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        Shown { json: serde_json::from_slice(&glb[20..20 + length]).unwrap(), bin: glb[28 + length..].to_vec(), notes }
    }

    /// As a prop.
    fn still(text: &str) -> Shown {
        Shown::of(text, &[PartChoice { prim: None, at_origin: false }])
    }

    fn numbers(&self, accessor: &serde_json::Value) -> Vec<f32> {
        let accessor = &self.json["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let start = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        let bytes = &self.bin[start..start + view["byteLength"].as_u64().unwrap() as usize];
        let words = bytes.chunks_exact(4).map(|word| word.try_into().unwrap());
        match accessor["componentType"].as_u64() {
            Some(5126) => words.map(f32::from_le_bytes).collect(),
            _ => words.map(|word| u32::from_le_bytes(word) as f32).collect(),
        }
    }

    /// Triangles in the world, at a time in seconds.
    fn triangles(&self, seconds: f32) -> Vec<[Vec3; 3]> {
        let scene = &self.json["scenes"][0]["nodes"];
        let mut found = Vec::new();
        let mut open: Vec<(usize, Mat4)> =
            scene.as_array().unwrap().iter().map(|node| (node.as_u64().unwrap() as usize, Mat4::IDENTITY)).collect();
        while let Some((number, above)) = open.pop() {
            let node = &self.json["nodes"][number];
            let place = above * self.place(number, seconds);
            let children = node["children"].as_array().into_iter().flatten();
            open.extend(children.map(|child| (child.as_u64().unwrap() as usize, place)));
            let Some(mesh) = node["mesh"].as_u64() else { continue };
            for primitive in self.json["meshes"][mesh as usize]["primitives"].as_array().unwrap() {
                let points = self.numbers(&primitive["attributes"]["POSITION"]);
                let at = |i: &f32| place.transform_point3(Vec3::from_slice(&points[3 * *i as usize..]));
                let corners = self.numbers(&primitive["indices"]);
                found.extend(corners.chunks_exact(3).map(|t| [at(&t[0]), at(&t[1]), at(&t[2])]));
            }
        }
        found
    }

    fn place(&self, number: usize, seconds: f32) -> Mat4 {
        let node = &self.json["nodes"][number];
        if let Some(matrix) = node["matrix"].as_array() {
            let values: Vec<f32> = matrix.iter().map(|v| v.as_f64().unwrap() as f32).collect();
            return Mat4::from_cols_slice(&values);
        }
        let part = |name: &str, rest: &[f32]| -> Vec<f32> {
            let own = node[name].as_array().map(|all| all.iter().map(|v| v.as_f64().unwrap() as f32).collect());
            self.sampled(number, name, seconds).or(own).unwrap_or_else(|| rest.to_vec())
        };
        let scale = Vec3::from_slice(&part("scale", &[1.0; 3]));
        let turn = Quat::from_slice(&part("rotation", &[0.0, 0.0, 0.0, 1.0])).normalize();
        Mat4::from_scale_rotation_translation(scale, turn, Vec3::from_slice(&part("translation", &[0.0; 3])))
    }

    /// The value of a channel at a key, or of the last one before.
    fn sampled(&self, number: usize, path: &str, seconds: f32) -> Option<Vec<f32>> {
        let animation = self.json["animations"].get(0)?;
        let channels = animation["channels"].as_array().unwrap();
        let channel = channels.iter().find(|channel| {
            channel["target"]["node"].as_u64() == Some(number as u64) && channel["target"]["path"] == path
        })?;
        let sampler = &animation["samplers"][channel["sampler"].as_u64().unwrap() as usize];
        let (times, values) = (self.numbers(&sampler["input"]), self.numbers(&sampler["output"]));
        let at = times.partition_point(|time| *time <= seconds + 1e-4).saturating_sub(1);
        let width = values.len() / times.len();
        Some(values[at * width..(at + 1) * width].to_vec())
    }

    fn bounds(&self, seconds: f32) -> [Vec3; 2] {
        let corners = self.triangles(seconds).into_iter().flatten();
        corners.fold([Vec3::MAX, Vec3::MIN], |[low, high], p| [low.min(p), high.max(p)])
    }

    #[track_caller]
    fn spans(&self, seconds: f32, low: [f32; 3], high: [f32; 3]) {
        let [found_low, found_high] = self.bounds(seconds);
        let off = (found_low - Vec3::from(low)).abs().max((found_high - Vec3::from(high)).abs());
        assert!(off.max_element() < 1e-5, "{found_low} to {found_high}");
    }
}

fn area(triangles: &[[Vec3; 3]]) -> f32 {
    triangles.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).sum()
}

#[test]
fn a_notch_is_no_part_of_a_face() {
    let face = |more: &str| {
        let mesh = format!(
            "def Mesh \"m\"\n{{\n    int[] faceVertexCounts = [6, 3]\n    \
             int[] faceVertexIndices = [0, 5, 4, 3, 2, 1, 0, 1, 2]\n    point3f[] points = [(10, 0, 0), (10, 3, 0), \
             (3, 3, 0), (3, 10, 0), (0, 10, 0), (0, 0, 0)]\n{more}\n}}\n"
        );
        let shown = Shown::still(&stage("", &mesh)).triangles(0.0);
        let normals: Vec<f32> = shown.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).z.signum()).collect();
        (area(&shown), normals)
    };
    // 51 of the L, and 10.5 of a triangle in it.
    let (whole, normals) = face("");
    assert!((whole - 61.5).abs() < 1e-4, "{whole}");
    assert_eq!(normals, [-1.0, -1.0, -1.0, -1.0, 1.0]);
    let (left, normals) = face("    uniform token orientation = \"leftHanded\"");
    assert!(left == whole && normals == [1.0, 1.0, 1.0, 1.0, -1.0]);
    let (holes, _) = face("    int[] holeIndices = [1]");
    assert!((holes - 51.0).abs() < 1e-4, "{holes}");
}

#[test]
fn instances_that_are_hidden_or_inactive_are_left_out() {
    let shown = |fields: &str, metadata: &str| {
        let points = triangle("p", "");
        let inside = format!(
            "def PointInstancer \"pi\"{metadata}\n{{\n    rel prototypes = [ </X/pi/p> ]\n    \
             int[] protoIndices = [0, 0, 0]\n    point3f[] positions = [(0, 0, 0), (2, 0, 0), (4, 0, 0)]\n\
             {fields}\n{points}\n}}\n"
        );
        let text = stage("    startTimeCode = 5", &inside);
        let still = Shown::still(&text);
        // What comes later is a point before.
        let moving = area(&Shown::of(&text, &[]).triangles(0.0));
        assert!((moving - area(&still.triangles(0.0))).abs() < 1e-6, "{fields}{metadata}");
        still.bounds(0.0).map(|p| p.x)
    };
    assert_eq!(shown("", ""), [0.0, 5.0]);
    assert_eq!(shown("    int64[] invisibleIds = [2]", ""), [0.0, 3.0]);
    assert_eq!(shown("    int64[] ids = [7, 8, 9]\n    int64[] invisibleIds = [7, 9]", ""), [2.0, 3.0]);
    let times = "    int64[] invisibleIds = [0, 1, 2]\n    int64[] invisibleIds.timeSamples = { 4: [0], 6: [2] }";
    assert_eq!(shown(times, ""), [2.0, 5.0]);
    assert_eq!(shown("", " (\n    inactiveIds = [0]\n)"), [2.0, 5.0]);
    assert_eq!(shown("", " (\n    append inactiveIds = [2]\n)"), [0.0, 3.0]);
}

#[test]
fn instances_come_when_they_are_seen() {
    let inside = format!(
        "def PointInstancer \"pi\"\n{{\n    rel prototypes = [ </X/pi/p> ]\n    int[] protoIndices = [0, 0]\n    \
         point3f[] positions = [(0, 0, 0), (2, 0, 0)]\n    \
         int64[] invisibleIds.timeSamples = {{ 0: [1], 12: [] }}\n{}\n}}\n",
        triangle("p", "")
    );
    let shown = Shown::of(&stage("    endTimeCode = 24\n    timeCodesPerSecond = 24", &inside), &[]);
    assert!((area(&shown.triangles(0.0)) - 0.5).abs() < 1e-6);
    assert!((area(&shown.triangles(0.5)) - 1.0).abs() < 1e-6);
}

#[test]
fn prims_below_meshes_are_shown_and_a_transform_may_begin_at_the_world() {
    let moved = |by: &str| format!("    double3 xformOp:translate = {by}\n    uniform token[] xformOpOrder = ");
    let child = triangle("lid", &format!("{}[\"xformOp:translate\"]", moved("(0, 3, 0)")));
    let nested = Shown::still(&stage("", &triangle("base", &child)));
    nested.spans(0.0, [0.0; 3], [1.0, 4.0, 0.0]);
    let scale = "    double3 xformOp:scale = (2, 2, 2)\n    uniform token[] xformOpOrder = [\"xformOp:scale\"]\n";
    let order = "[\"xformOp:scale\", \"!resetXformStack!\", \"xformOp:translate\"]";
    let reset = triangle("m", &format!("{}{order}", moved("(0, 1, 0)")));
    let text = stage("", &format!("{scale}{reset}"));
    for shown in [Shown::still(&text), Shown::of(&text, &[])] {
        shown.spans(0.0, [0.0, 1.0, 0.0], [1.0, 2.0, 0.0]);
    }
    // A reference to it would not be in its place.
    let converted = convert(text.as_bytes(), &no_files, &[PartChoice { prim: None, at_origin: false }]).unwrap();
    assert!(converted.parts[0].prims.is_empty());
    // Neither a scope nor a prim without a kind has a place.
    let inside = format!("def \"a\"\n{{\n{scale}def Scope \"b\"\n{{\n{scale}{}\n}}\n}}\n", triangle("m", ""));
    Shown::still(&stage("", &inside)).spans(0.0, [0.0; 3], [1.0, 1.0, 0.0]);
}

#[test]
fn values_lead_from_sample_to_sample_and_samples_count_before_defaults() {
    // Whole numbers in text, too.
    for kind in ["half", "float", "double"] {
        let turn = format!(
            "    {kind} xformOp:rotateZ = 45\n    {kind} xformOp:rotateZ.timeSamples = {{ 0: 0, 4: 360 }}\n    \
             uniform token[] xformOpOrder = [\"xformOp:rotateZ\"]"
        );
        let text = stage("    startTimeCode = 1\n    endTimeCode = 4", &triangle("m", &turn));
        Shown::still(&text).spans(0.0, [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let moving = Shown::of(&text, &[]);
        moving.spans(0.0, [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        moving.spans(1.0 / 24.0, [-1.0, -1.0, 0.0], [0.0, 0.0, 0.0]);
        moving.spans(2.0 / 24.0, [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]);
        moving.spans(3.0 / 24.0, [0.0, 0.0, 0.0], [1.0, 1.0, 0.0]);
    }
    let points = "    point3f[] points.timeSamples = { 0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], \
                  2: [(0, 0, 0), (3, 0, 0), (0, 1, 0)] }";
    let text = stage("    startTimeCode = 1", &triangle("m", points));
    Shown::still(&text).spans(0.0, [0.0; 3], [2.0, 1.0, 0.0]);
}

#[test]
fn a_prim_is_seen_when_it_says_so() {
    let inside = |visibility: &str| {
        let other = triangle(
            "n",
            "    double3 xformOp:translate = (2, 0, 0)\n    \
                                   uniform token[] xformOpOrder = [\"xformOp:translate\"]",
        );
        stage("    endTimeCode = 24\n    timeCodesPerSecond = 24", &format!("{}{other}", triangle("m", visibility)))
    };
    let text = inside("    token visibility.timeSamples = { 0: \"invisible\", 12: \"inherited\" }");
    let low = |shown: &Shown, seconds: f32| area(&shown.triangles(seconds));
    assert!((low(&Shown::still(&text), 0.0) - 0.5).abs() < 1e-6);
    let moving = Shown::of(&text, &[]);
    assert!((low(&moving, 0.0) - 0.5).abs() < 1e-6 && (low(&moving, 0.5) - 1.0).abs() < 1e-6);
    let hidden =
        inside("    token visibility = \"inherited\"\n    token visibility.timeSamples = { 0: \"invisible\" }");
    assert!((low(&Shown::of(&hidden, &[]), 0.9) - 0.5).abs() < 1e-6);
    // What a prim states of its purpose counts before what is above it.
    let render = triangle("m", "    uniform token purpose = \"render\"");
    let aids =
        format!("def Xform \"a\"\n{{\n    uniform token purpose = \"guide\"\n{render}{}\n}}\n", triangle("n", ""));
    assert!((low(&Shown::still(&stage("", &aids)), 0.0) - 0.5).abs() < 1e-6);
}

#[test]
fn motion_that_cannot_be_shown_is_said() {
    let shear = "    matrix4d xformOp:transform.timeSamples = { 0: ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), \
                 (0, 0, 0, 1)), 2: ((1, 0, 0, 0), (1, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)) }\n    \
                 uniform token[] xformOpOrder = [\"xformOp:transform\"]";
    let shown = Shown::of(&stage("    endTimeCode = 2", &triangle("m", shear)), &[]);
    assert!(shown.notes.iter().any(|note| note.contains("that shear")), "{:?}", shown.notes);
    shown.spans(0.0, [0.0; 3], [1.0, 1.0, 0.0]);
}
