//! Tools around the program: completions, manual pages, scene schema, colors, diagnosis.

use crate::cli::desk::Desk;
use serde_json::Value;
use std::process::{Command, Stdio};

#[test]
fn completions_for_every_shell() {
    let desk = Desk::new();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = desk.line(&format!("completions {shell}")).ok();
        for word in ["bake", "doctor", "control", "accuracy"] {
            assert!(script.contains(word), "{shell} does not know {word}");
        }
    }
    // Bash reads it, and completes a command with it.
    desk.write("cairn.bash", desk.line("completions bash").ok());
    let script =
        "source cairn.bash; COMP_WORDS=(cairn ren); COMP_CWORD=1; _cairn cairn ren cairn; echo ${COMPREPLY[*]}";
    let bash = Command::new("bash").args(["-c", script]).current_dir(desk.path("")).output();
    if let Ok(answer) = bash {
        assert_eq!(String::from_utf8_lossy(&answer.stdout).trim(), "render");
    }
}

#[test]
fn manual_pages() {
    let desk = Desk::new();
    assert!(desk.line("man").ok().contains("cairn\\-bake(1)"));
    let page = desk.line("man bake").ok();
    assert!(page.contains(".TH cairn-bake 1") && page.contains("\\-\\-control"), "{page}");
    desk.line("man bkae").fails(2, &["bkae", "Did you mean `bake`?"]);
    std::fs::create_dir(desk.path("man1")).unwrap();
    desk.line("man --output man1").ok();
    let pages = std::fs::read_dir(desk.path("man1")).unwrap().count();
    assert!(pages > 8 && desk.path("man1/cairn-doctor.1").is_file() && desk.path("man1/cairn.1").is_file());
    assert!(!desk.path("man1/cairn-worker.1").exists(), "not for persons");
    desk.line("man --output nowhere").fails(65, &["nowhere", "Create it first"]);
}

#[test]
fn the_scene_schema_knows_every_field() {
    let schema: Value = serde_json::from_str(&Desk::new().line("schema").ok()).unwrap();
    let of = |path: &str| schema.pointer(&format!("/definitions/{path}")).unwrap_or_else(|| panic!("no {path}"));
    assert_eq!(of("Scene/properties/gravity/minimum"), 0.01);
    assert_eq!(of("Scene/properties/gravity/default"), 9.81);
    assert_eq!(of("Prop/anyOf/0/properties/weight/minimum"), 0);
    assert_eq!(of("Control/anyOf/0/properties/speed/exclusiveMinimum"), 0);
    assert_eq!(of("Scene/properties/props/items/$ref"), "#/definitions/Prop");
    let described = |field: &Value| field["description"].as_str().is_some_and(|text| !text.is_empty());
    let groups = schema["definitions"].as_object().unwrap();
    for (name, group) in groups {
        let object = group.pointer("/anyOf/0").unwrap_or(group);
        let fields = object["properties"].as_object().unwrap();
        assert!(!fields.is_empty() && fields.values().all(described), "{name} has fields that say nothing");
    }
}

#[test]
fn colours_obey_no_color() {
    let desk = Desk::new();
    let printed = |no_color: bool| {
        let mut command = desk.command(&["check", "nothing.toml"]);
        command.env_remove("NO_COLOR").env("CLICOLOR_FORCE", "1");
        if no_color {
            command.env("NO_COLOR", "1");
        }
        String::from_utf8(command.output().unwrap().stderr).unwrap()
    };
    assert!(printed(false).contains("\x1b["));
    assert!(printed(true).contains("error: nothing.toml") && !printed(true).contains('\x1b'));
}

#[test]
fn the_doctor_tells_the_machine_and_tries_a_bake() {
    let desk = Desk::new();
    let printed = desk.line("doctor --skip-bake").ok();
    for part in ["cairn", env!("CARGO_PKG_VERSION"), "rapier3d", "threads", "memory", "GiB free"] {
        assert!(printed.contains(part), "{part} is not in: {printed}");
    }
    let printed: Value = serde_json::from_str(&desk.line("doctor --json").ok()).unwrap();
    let findings = &printed["findings"];
    assert_eq!(findings["result"], "the same with one thread", "{printed:#}");
    assert!(findings["kept_shape"].as_str().is_some_and(|printed| printed.contains("expected")), "{printed:#}");
    assert!(desk.files().iter().all(|name| name.ends_with(".glb")), "it leaves nothing behind");
}

#[test]
fn the_doctor_names_what_other_versions_left() {
    let desk = Desk::new();
    let cache = desk.path("kept");
    let printed = || {
        let mut command = desk.command(&["doctor", "--skip-bake", "--json"]);
        let done = command.env_remove("CAIRN_NO_CACHE").env("CAIRN_CACHE", &cache).output().unwrap();
        let printed: Value = serde_json::from_slice(&done.stdout).unwrap();
        printed["findings"]["cache"].as_str().unwrap().to_owned()
    };
    let mut bake = desk.command(&["bake", "--control", "cone.glb", "--prop", "stick.glb", "-o", "pile.glb"]);
    bake.args(["--accuracy", "draft", "--set", "fill.count=2", "--quiet"]).env_remove("CAIRN_NO_CACHE");
    assert!(bake.env("CAIRN_CACHE", &cache).status().unwrap().success());
    assert!(printed().starts_with("0 MiB in ") && !printed().contains("other versions"), "{}", printed());
    // An entry of another version, what versions before that left, and what is not the cache's.
    std::fs::create_dir_all(cache.join("content-v2/sha256")).unwrap();
    for (name, size) in [("bake-0123456789abcdef-01.cached", 3), ("content-v2/sha256/ab", 2), ("notes.txt", 5)] {
        std::fs::write(cache.join(name), vec![7; size << 20]).unwrap();
    }
    assert!(printed().starts_with("5 MiB in ") && printed().contains("5 MiB of other versions"), "{}", printed());
}

/// A server's data are the user's, not those of the folder in which it is started; what an earlier version left in that
/// folder is named and not touched.
#[test]
#[cfg(target_os = "linux")]
fn a_server_keeps_its_data_in_the_users_folder() {
    use std::io::{BufRead, BufReader, Read};
    let desk = Desk::new();
    std::fs::create_dir(desk.path("cairn-data")).unwrap();
    let mut command = desk.command(&["serve", "--listen", "127.0.0.1:0"]);
    let mut server = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut address = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut address).unwrap();
    server.kill().unwrap();
    let mut log = String::new();
    server.stderr.take().unwrap().read_to_string(&mut log).unwrap();
    server.wait().unwrap();
    assert!(address.starts_with("127.0.0.1:"), "{address} {log}");
    assert!(desk.path("user/cairn-server").is_dir());
    assert!(log.contains("--data cairn-data") && log.contains(desk.path("cairn-data").to_str().unwrap()), "{log}");
    assert_eq!(std::fs::read_dir(desk.path("cairn-data")).unwrap().count(), 0);
}

/// Every fault of a settings file is named at once, before anything is made.
#[test]
fn all_faults_of_a_settings_file_are_named() {
    let desk = Desk::new();
    desk.write("cairn.toml", "workerss = 4\nqueue = \"many\"\nlog = \"text\"\nunfinished = \"again\"\n");
    let words = [
        "unknown setting `workerss`. Did you mean `workers`?",
        "`queue`: invalid type",
        "`unfinished`: unknown variant",
    ];
    desk.line("serve --config cairn.toml").fails(78, &words);
    desk.write("cairn.toml", "workers = \n");
    desk.line("serve --config cairn.toml").fails(78, &["cairn.toml", "it must be TOML"]);
    assert!(!desk.path("user").exists());
}

#[test]
fn a_plan_tells_what_each_accuracy_is_expected_to_cost() {
    let desk = Desk::new();
    let printed = desk.line("plan --control cone.glb --prop stick.glb").ok();
    for word in ["bodies", "control", "draft", "reference", "CPU time", "overlap by", "of the thinner body's thickness"]
    {
        assert!(printed.contains(word), "{printed}");
    }
    let plan: Value = serde_json::from_str(&desk.line("plan --json --control cone.glb --prop stick.glb").ok()).unwrap();
    let seconds = |i: usize| plan["estimates"][i]["cpu_seconds"].as_f64().unwrap();
    assert!((1..5).all(|i| seconds(i - 1) < seconds(i)), "{plan:#}");
    // A field that the scene sets holds at each accuracy.
    let fewer = desk.line("plan --json --control cone.glb --prop stick.glb --set fill.count=5").ok();
    let fewer: Value = serde_json::from_str(&fewer).unwrap();
    assert!(fewer["estimates"][4]["cpu_seconds"].as_f64().unwrap() < seconds(4));
    desk.line("plan --control cone.glb --prop stik.glb").fails(65, &["stick.glb"]);
}

/// With `--progress json`, each line on stderr is an object: progress, notes, the result, and errors, those of the
/// command line included. `-q` keeps errors.
/// What a farm asks of a machine for a bake, against what the bake takes.
#[test]
fn a_plan_says_what_a_bake_needs() {
    let desk = Desk::new();
    let scene = "--control cone.glb --prop stick.glb --accuracy draft";
    let needs = |count: usize| -> Value {
        let plan = desk.line(&format!("plan {scene} --set fill.count={count} --json")).ok();
        serde_json::from_str::<Value>(&plan).unwrap()["resources"].clone()
    };
    let number = |of: &Value, name: &str| of[name].as_f64().unwrap_or_else(|| panic!("{name}: {of}"));
    let (few, many) = (needs(5), needs(500));
    assert_eq!(few["cores"], 1);
    for name in ["seconds", "memory_bytes"] {
        assert!(number(&few, name) < number(&many, name), "{few} {many}");
        assert!(number(&few, name) < number(&few, &format!("most_{name}")), "{few}");
    }
    let bake = format!("bake {scene} --set fill.count=5 --no-cache -q -o pile.glb --report pile.json");
    desk.line(&bake).ok();
    let report: Value = serde_json::from_slice(&std::fs::read(desk.path("pile.json")).unwrap()).unwrap();
    let (took, most) = (number(&report, "peak_memory_bytes"), number(&few, "most_memory_bytes"));
    assert!(took < 2.0 * most && most < 4.0 * took, "{took} of {most}");
}

#[test]
fn json_lines_are_all_there_is() {
    let desk = Desk::new();
    let scene = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=3 --set output.frames=4";
    for (line, code, key) in [
        (format!("bake {scene} -o pile.glb --progress json"), 0, "result"),
        (format!("bake {scene} -o pile.glb --progress json --set control=off --set glue.breaking=9"), 0, "warning"),
        ("bake --control gone.glb --prop stick.glb -o pile.glb --progress json".into(), 65, "error"),
        ("bake --control gone.glb --prop stick.glb -o pile.glb --progress json -q".into(), 65, "error"),
        ("bake --nonsense -o pile.glb --progress=json".into(), 2, "error"),
        (format!("batch {scene} --seeds 1..2 -o {{seed:02}}.glb --progress json --json"), 0, "fraction"),
        ("batch --control gone.glb --prop stick.glb -o {seed}.glb --progress json".into(), 65, "error"),
        ("verify pile.glb --progress json --json".into(), 0, "stage"),
    ] {
        let done = desk.line(&line);
        assert_eq!(done.code, code, "{line}: {}", done.stderr);
        let parsed = |line: &str| serde_json::from_str::<serde_json::Value>(line);
        let lines: Vec<serde_json::Value> =
            done.stderr.lines().map(|one| parsed(one).unwrap_or_else(|_| panic!("{line}: {one}"))).collect();
        assert!(lines.iter().any(|object| object.get(key).is_some()), "{line}: {}", done.stderr);
        if line.ends_with("--json") {
            parsed(&done.stdout).unwrap();
        }
    }
    assert!(desk.path("01.glb").exists() && desk.path("02.glb").exists());
    let ranking = desk.line("rank . --no-sheet --json").ok();
    let ranking: Vec<serde_json::Value> = serde_json::from_str(&ranking).unwrap();
    assert!(ranking.len() == 2 && ranking[0]["place"] == 1 && ranking[0]["figures"]["bodies"] == 3.0, "{ranking:?}");
}

/// A scene on the standard input.
#[test]
fn a_scene_comes_from_a_pipe() {
    use std::io::Write;
    let desk = Desk::new();
    for (scene, code) in [
        ("control_mesh = 'cone.glb'\nprops = ['stick.glb']\n", 0),
        (" { \"control_mesh\": \"cone.glb\", \"props\": [\"stick.glb\"] }", 0),
        ("control_mesh = 'cone.glb'\nprosp = ['stick.glb']\n", 65),
    ] {
        let mut command = desk.command(&["check", "-"]);
        let mut child =
            command.stdin(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap();
        child.stdin.take().unwrap().write_all(scene.as_bytes()).unwrap();
        let done = child.wait_with_output().unwrap();
        let errors = String::from_utf8(done.stderr).unwrap();
        assert_eq!(done.status.code(), Some(code), "{errors}");
        assert!(code == 0 || errors.contains("stdin.toml:2: unknown field `prosp`"), "{errors}");
    }
}
