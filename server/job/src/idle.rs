//! Fields that a scene sets although they have no effect in it.

use cairn_input::params::Params;
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use serde_json::Value;

/// A sentence for each group of such fields. A group of which every field is set is that of an effective scene, as a
/// result holds it: nobody has chosen its values one by one. `is_filled`: whether the control mesh is.
pub fn notes(given: &proto::Scene, effective: &proto::Scene, params: &Params, is_filled: bool) -> Vec<String> {
    let is_glued = params.glue_bound(is_filled) > 0.0;
    let glued = "the pile is glued, and stands without being held; set glue=natural for a pile that is held";
    let at_once = "a glued pile is released at once; set glue=natural for layers";
    let groups = [
        (is_glued, "control", &[][..], glued),
        (is_glued, "release", &["resistance"], at_once),
        (
            !is_glued && params.glue.strength != Some(0.0),
            "glue",
            &["mode"],
            "nothing is glued; set glue=as_modelled, or tacky",
        ),
        (!has_shape(given), "fill", &["method", "upright"], "there is no control mesh to fill"),
    ];
    let (given, all) = (SceneTree::from_message(given).to_value(), SceneTree::from_message(effective).to_value());
    let sentence = |(is_idle, group, but, why): (bool, &str, &[&str], &str)| {
        let set = names(given.get(group));
        let idle: Vec<String> =
            set.iter().filter(|name| !but.contains(&&***name)).map(|name| format!("{group}.{name}")).collect();
        let is_chosen = !idle.is_empty() && set.len() < names(all.get(group)).len();
        (is_idle && is_chosen).then(|| {
            let have = if idle.len() == 1 { "has" } else { "have" };
            format!("{} {have} no effect here: {why}", idle.join(", "))
        })
    };
    groups.into_iter().filter_map(sentence).collect()
}

/// Whether there is anything to fill.
fn has_shape(given: &proto::Scene) -> bool {
    let has_container = given.fill.as_ref().is_some_and(|fill| fill.into.is_some());
    given.control_mesh.is_some() || has_container || !given.piles.is_empty()
}

/// The fields of a group that are set. A text in the place of a group is its mode.
fn names(group: Option<&Value>) -> Vec<String> {
    match group {
        Some(Value::Object(fields)) => fields.keys().cloned().collect(),
        Some(_) => vec!["mode".into()],
        None => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_wire::effective::effective;
    use cairn_wire::from_proto;

    #[test]
    fn what_has_no_effect_is_said() {
        let said = |assignments: &[&str], control_mesh: Option<&str>| {
            let mut tree = SceneTree::default();
            for assignment in assignments {
                tree.set(assignment).unwrap();
            }
            let control_mesh = control_mesh.map(|path| proto::ControlMesh { path: path.into() });
            let scene = proto::Scene { control_mesh, ..tree.to_message() };
            let params = from_proto::params(&scene).unwrap();
            let of =
                |given: &proto::Scene| notes(given, &effective(&scene, &params), &params, scene.control_mesh.is_some());
            assert!(of(&effective(&scene, &params)).is_empty(), "an effective scene has chosen nothing");
            of(&scene)
        };
        let dome = Some("dome.glb");
        for (assignments, control_mesh, words) in [
            (&["control.mode=hold"][..], dome, &["control.mode has no effect here: the pile is glued"][..]),
            (&["control.mode=hold", "glue=natural"], dome, &[]),
            (&["control=off"], dome, &[]),
            (
                &["release.order=top_down"],
                dome,
                &["release.order has no effect here: a glued pile is released at once"],
            ),
            (&["release.order=top_down", "glue=natural"], dome, &[]),
            (&["glue=natural", "glue.breaking=9"], dome, &["glue.breaking has no effect here: nothing is glued"]),
            (&["glue.strength=0"], dome, &[]),
            (&["glue.breaking=9"], dome, &[]),
            (
                &["fill.count=9", "fill.settle=100"],
                None,
                &["fill.count, fill.settle have no effect here: there is no control mesh to fill"],
            ),
            (&["fill.count=9"], dome, &[]),
        ] {
            let said = said(assignments, control_mesh);
            let is_so =
                said.len() == words.len() && said.iter().zip(words).all(|(text, words)| text.starts_with(words));
            assert!(is_so, "{assignments:?}: {said:?}");
        }
    }
}
