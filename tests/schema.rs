//! The comments of `proto/cairn/v1` are true: every `Default: X.` is the value that an unset field gets, and every
//! `Range: A to B.` is what the core accepts.

use cairn_input::scene::Prop;
use cairn_job::Job;
use cairn_wire::effective::effective;
use cairn_wire::from_proto;
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use cairn_wire::scene_file::schema::{self, comment, stated};
use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor};
use serde_json::Value;
use std::path::Path;

/// A field that holds a value: its path in a scene with one prop and one static, and its comment.
struct Field {
    path: String,
    comment: String,
    descriptor: FieldDescriptor,
}

fn fields(message: &MessageDescriptor, prefix: &str) -> Vec<Field> {
    let mut found = Vec::new();
    for descriptor in message.fields() {
        let path = format!("{prefix}{}", descriptor.name());
        match descriptor.kind() {
            Kind::Message(group) if descriptor.is_list() => found.extend(fields(&group, &format!("{path}.0."))),
            Kind::Message(group) => found.extend(fields(&group, &format!("{path}."))),
            _ => found.push(Field {
                path,
                comment: comment(&descriptor.parent_file(), descriptor.path()).replace('\n', " "),
                descriptor,
            }),
        }
    }
    found
}

fn all_fields() -> Vec<Field> {
    fields(&schema::scene(), "")
}

/// A scene of one of everything, read from the examples.
fn scene() -> SceneTree {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
    let mut scene = SceneTree::default();
    for (field, name) in [("control_mesh", "cone.glb"), ("props.0", "stick.glb"), ("statics.0", "cube.glb")] {
        scene.set(&format!("{field}={}", assets.join(name).display())).unwrap();
    }
    scene.set(&format!("region={}", assets.join("cone.glb").display())).unwrap();
    for one in ["bodies.0.prop=stick", "emitters.0.rate=10", "statics.0.keyframes.0.frame=0"] {
        scene.set(one).unwrap();
    }
    scene
}

fn at<'a>(scene: &'a Value, path: &str) -> Option<&'a Value> {
    scene.pointer(&format!("/{}", path.replace('.', "/")))
}

#[test]
fn every_field_has_a_comment() {
    for field in all_fields() {
        assert!(!field.comment.is_empty(), "{} has no comment", field.path);
    }
}

#[test]
fn the_stated_defaults_are_the_defaults() {
    let mut scene = scene();
    // A bake has no use for a control mesh beside these.
    let lists = ["piles.0.path=cone.glb", "around.0.path=pile.glb", "usd.embed=false", "remove.0.number=0"];
    for one in lists.into_iter().chain(["collapse.azimuth=0", "from.path=pile.glb"]) {
        scene.set(one).unwrap();
    }
    let message = scene.to_message();
    let params = from_proto::params(&message).unwrap();
    let values = SceneTree::from_message(&effective(&message, &params)).to_value();
    for Field { path, comment, descriptor } in all_fields() {
        let default = stated(&comment, "Default: ");
        match (at(&values, &path), default) {
            _ if path.ends_with("path") || path == "bodies.0.prop" => {
                assert!(comment.ends_with("Required."), "{path} is required");
            }
            (None, None) => assert!(descriptor.containing_oneof().is_some(), "{path} states no default"),
            (None, Some(default)) => assert!(default.starts_with("not set"), "{path} has no default, not {default}"),
            (Some(Value::String(name)), default) => assert_eq!(default.as_ref(), Some(name), "{path}"),
            (Some(Value::Array(numbers)), default) => {
                let default: Option<Vec<f64>> = default.and_then(|default| serde_json::from_str(&default).ok());
                assert_eq!(default, numbers.iter().map(Value::as_f64).collect(), "{path}");
            }
            (Some(Value::Number(number)), default) => {
                let default: Option<f64> = default.and_then(|default| default.parse().ok());
                assert_eq!(default, number.as_f64(), "{path}");
            }
            (Some(value), default) => assert_eq!(default, Some(value.to_string()), "{path}"),
        }
    }
}

/// Whether the core takes a scene with this value.
fn accepts(path: &str, comment: &str, is_list: bool, value: f64) -> bool {
    let mut scene = scene();
    if path == "props.0.scale_max" || path == "props.0.scale_min" {
        scene.set(&format!("props.0.scale_min={value:?}")).unwrap();
        scene.set(&format!("props.0.scale_max={value:?}")).unwrap();
    }
    let values = match stated(comment, "Default: ").filter(|default| default.starts_with('[')) {
        // A list: its first number.
        Some(default) => format!("[{value:?}{}", &default[default.find(',').unwrap()..]),
        None if is_list => format!("[{value:?}]"),
        None => format!("{value:?}"),
    };
    if path == "bodies.0.kept_until_frame" || path == "bodies.0.kept_until_seconds" {
        scene.set("bodies.0.kept=true").unwrap();
    }
    if path == "remove.0.count" {
        scene.set("remove.0.choice=any").unwrap();
    }
    if scene.set(&format!("{path}={values}")).is_err() {
        return false; // more than the wire holds
    }
    match Job::read(&scene.to_message()) {
        // Values out of range, not values that contradict others.
        Err(problems) => !problems.iter().any(|p| p.what.contains("out of range") || p.what.contains("negative")),
        Ok(job) => match cairn_core::plan(&job.scene, &job.params) {
            // Values out of range, not props that do not fit into the cone.
            Err(cairn_core::Error::Invalid(problems)) => {
                !problems.iter().any(|problem| problem.text.contains("out of range"))
            }
            _ => true,
        },
    }
}

#[test]
fn the_stated_ranges_are_the_ranges() {
    /// Beyond a bound, as a share of it or by itself at 0.
    fn beyond(bound: f64, sign: f64) -> f64 {
        bound + sign * if bound == 0.0 { 1e-3 } else { bound.abs() * 0.01 }
    }
    for Field { path, comment, descriptor } in all_fields() {
        let is_replaced = descriptor.field_descriptor_proto().options.as_ref().is_some_and(|o| o.deprecated());
        if is_replaced || !matches!(descriptor.kind(), Kind::Double | Kind::Int32 | Kind::Int64) {
            continue;
        }
        let range = stated(&comment, "Range: ").unwrap_or_else(|| panic!("{path} states no range"));
        let whole = !matches!(descriptor.kind(), Kind::Double);
        let (low, high) = match range.split_once(" to ") {
            Some((low, high)) => (low, Some(high.parse::<f64>().unwrap())),
            None => (&*range, None),
        };
        if let Some(excluded) = low.strip_prefix("above ") {
            assert!(
                !accepts(&path, &comment, descriptor.is_list(), excluded.parse().unwrap()),
                "{path} must be above {excluded}"
            );
        } else {
            let low: f64 = low.parse().unwrap();
            assert!(accepts(&path, &comment, descriptor.is_list(), low), "{path} may be {low}");
            let below = if whole { low - 1.0 } else { beyond(low, -1.0) };
            assert!(!accepts(&path, &comment, descriptor.is_list(), below), "{path} may not be {below}");
        }
        // A double cannot hold the largest 64-bit number.
        if let Some(high) = high.filter(|_| !matches!(descriptor.kind(), Kind::Int64)) {
            assert!(accepts(&path, &comment, descriptor.is_list(), high), "{path} may be {high}");
            let above = if whole { high + 1.0 } else { beyond(high, 1.0) };
            assert!(!accepts(&path, &comment, descriptor.is_list(), above), "{path} may not be {above}");
        }
    }
}

#[test]
fn parameters_survive_the_wire_and_back() {
    for accuracy in ["paper", "draft", "standard", "fine"] {
        let mut scene = SceneTree::default();
        scene.set(&format!("accuracy={accuracy}")).unwrap();
        scene.set("fill.count=7").unwrap();
        scene.set("ground_height=-2").unwrap();
        let params = from_proto::params(&scene.to_message()).unwrap();
        let wire = cairn_wire::to_proto::params(&params);
        let tree = SceneTree::from_message(&wire);
        assert_eq!(tree.to_message(), wire);
        assert_eq!(from_proto::params(&wire).unwrap(), params);
    }
    assert_eq!(from_proto::params(&proto::Scene::default()).unwrap().seed, 1);
}

/// The core's own constructor of a prop has the same defaults.
#[test]
fn a_prop_of_the_core_has_the_schemas_defaults() {
    let job = Job::read(&scene().to_message()).unwrap();
    let read = &job.scene.props[0];
    assert_eq!(format!("{read:?}"), format!("{:?}", Prop::new(read.model.clone())));
}
