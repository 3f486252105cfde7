//! Scene files and the flags that equal them.

use crate::cli::desk::Desk;

const FLAGS: &str = "--control cone.glb --prop stick.glb --prop brick.glb#Brick:0.3 --static brick.glb \
                     --accuracy draft --seed 7 --frames 20 --fps 30 \
                     --set fill.count=12 --set control=off --set physics.step_seconds=0.01";

#[test]
fn flags_become_a_scene_file_and_back() {
    let desk = Desk::new();
    for (name, json) in [("pile.toml", ""), ("pile.json", "--json")] {
        let text = desk.line(&format!("scene {FLAGS} {json}")).ok();
        desk.write(name, &text);
        assert_eq!(desk.line(&format!("scene {name} {json}")).ok(), text);
        let printed = desk.line(&format!("check {name}")).ok();
        assert_eq!(printed, desk.line(&format!("check {FLAGS}")).ok());
    }
}

#[test]
fn a_full_scene_file_says_the_same() {
    let desk = Desk::new();
    let text = desk.line(&format!("scene --full {FLAGS}")).ok();
    desk.write("pile.toml", &text);
    assert_eq!(desk.line("scene --full pile.toml").ok(), text);
    assert!(text.contains("gravity = 9.81"), "{text}");
    assert!(text.contains("mode = \"off\""), "{text}");
    // The paper's preset has an infinite value.
    let text = desk.line("scene --full --accuracy paper --control cone.glb --prop stick.glb").ok();
    desk.write("paper.toml", &text);
    assert_eq!(desk.line("scene --full paper.toml").ok(), text);
}

#[test]
fn names_in_both_forms_and_groups_by_their_first_field() {
    let desk = Desk::new();
    let scenes = [
        "control_mesh = 'cone.glb'\nprops = ['stick.glb']\nfill = 'pour'\ncontrol = 'off'\naccuracy = 'fine'\n\
         output = { free_standing = true }",
        "controlMesh = { path = 'cone.glb' }\naccuracy = 'ACCURACY_FINE'\n[[props]]\npath = 'stick.glb'\n\
         [fill]\nmethod = 'FILL_METHOD_POUR'\n[control]\nmode = 'off'\n[output]\nfreeStanding = true",
    ];
    let [first, second] = scenes.map(|scene| {
        desk.write("pile.toml", scene);
        desk.line("scene pile.toml").ok()
    });
    assert_eq!(first, second);
}

#[test]
fn paths_are_relative_to_the_scene_file() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("scenes")).unwrap();
    desk.write("scenes/pile.toml", "control_mesh = '../cone.glb'\nprops = ['stick.glb']");
    std::fs::rename(desk.path("stick.glb"), desk.path("scenes/stick.glb")).unwrap();
    desk.line("check scenes/pile.toml").ok();
}

#[test]
fn flags_go_before_the_scene_file() {
    let desk = Desk::new();
    desk.write("pile.toml", "control_mesh = 'gone.glb'\nprops = ['gone.glb', 'gone.glb']\nseed = 3\nfill.count = 9");
    let text = desk.line("scene pile.toml --control cone.glb --prop stick.glb --seed 4 --set fill.count=null").ok();
    assert!(!text.contains("gone") && text.contains("seed = 4") && !text.contains("count"), "{text}");
}

#[test]
fn unknown_fields_and_wrong_types_all_at_once_with_their_lines() {
    let desk = Desk::new();
    desk.write(
        "pile.toml",
        "control_mesh = 'cone.glb'\nfps = 24\n[[props]]\npath = 'stick.glb'\ndensty = 3\n[[props]]\npath = 3\n[fill]\n\
         method = 'inser'\ncount = 2.5\n[release]\ninterval_natural = 1\ninterval_seconds = 1",
    );
    desk.line("bake pile.toml -o pile.glb").fails(
        65,
        &[
            "pile.toml:2: unknown field `fps`. Did you mean `output.fps`?",
            "pile.toml:5: unknown field `props.0.densty`. Did you mean `density`?",
            "pile.toml:7: `props.1.path` is 3.",
            "pile.toml:9: `fill.method` cannot be `inser`. Did you mean `insert`?",
            "pile.toml:10: `fill.count` is 2.5. It must be a whole number.",
            "pile.toml:13: `release.interval_seconds` and `interval_natural` exclude each other.",
        ],
    );
    desk.write("pile.json", r#"{ "controlMesh": "cone.glb", "props": [{ "path": "stick.glb", "wieght": 2 }] }"#);
    desk.line("check pile.json").fails(65, &["pile.json: unknown field `props.0.wieght`. Did you mean `weight`?"]);
}

#[test]
fn replaced_fields_are_refused_with_what_takes_their_place() {
    let desk = Desk::new();
    desk.write(
        "pile.toml",
        "control_mesh = 'cone.glb'\nprops = ['stick.glb']\nrelease.damping = 1\ncontrol.damping = 2",
    );
    desk.line("check pile.toml").fails(
        65,
        &[
            "release.damping: it is not used any more. Give `resistance` instead",
            "control.damping: it is not used any more. Give `resistance` instead",
        ],
    );
}

#[test]
fn texts_that_are_no_scene() {
    let desk = Desk::new();
    for (name, text, printed) in [
        ("a.toml", "seed = \n", "a.toml:1:"),
        ("a.toml", "seed = 1\nseed = 2\n", "a.toml:2: duplicate key"),
        ("a.json", "{\n\"seed\": 1,\n}", "a.json:3:"),
        ("b.json", "[1]", "b.json: the scene is a list"),
        ("b.toml", "\u{0}", "b.toml:1:"),
        ("a.txt", "seed = 1", "ends in .toml or .json"),
        ("cone.glb", "glTF", "--control"),
    ] {
        desk.write(name, text);
        desk.line(&format!("check {name}")).fails(65, &[printed]);
    }
    desk.write("latin.toml", b"# \xff\n");
    desk.line("check latin.toml").fails(65, &["latin.toml", "UTF-8"]);
    desk.line("check gone.toml").fails(65, &["gone.toml: no such file"]);
}

#[test]
fn set_changes_any_field() {
    let desk = Desk::new();
    let scene = "scene --control cone.glb --prop stick.glb --prop brick.glb";
    for (set, line) in [
        ("props.1.weight=2", "weight = 2.0"),
        ("props.1.scaleMax=3", "scale_max = 3.0"),
        ("props.2=stick.glb", "path = \"stick.glb\""),
        ("seed=9223372036854775807", "seed = 9223372036854775807"),
        ("fill=pour", "method = \"pour\""),
        ("fill.method=\"pour\"", "method = \"pour\""),
        ("output.free_standing=true", "free_standing = true"),
        ("release={layer=0.3,interval_seconds=2}", "interval_seconds = 2.0"),
        ("ground_height=-1.5", "ground_height = -1.5"),
    ] {
        let text = desk.line(&format!("{scene} --set {set}")).ok();
        assert!(text.contains(line), "{set}:\n{text}");
    }
    for (set, printed) in [
        ("fill.coutn=3", "Did you mean `count`?"),
        ("props.weight=3", "props.0"),
        ("props.7.weight=3", "the list has 2 elements"),
        ("seed", "path=value"),
        ("seed=1.5", "whole number"),
        ("seed=99999999999999999999", "whole number"),
        ("seed.low=1", "there is no field below `seed`"),
        ("control=of", "Did you mean `off`?"),
        ("physics.substeps=5000000000", "whole number up to"),
    ] {
        desk.line(&format!("{scene} --set {set}")).fails(2, &[&format!("--set {set}: "), printed]);
    }
}
