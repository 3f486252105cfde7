//! `cairn mcp` as an agent meets it: what its tools may write, and what they read.

use crate::cli::desk::{Desk, box_data, box_json, glb};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};

/// A running server of tools.
struct Agent {
    process: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    calls: u64,
}

impl Agent {
    /// `cairn mcp` in the desk's folder.
    fn start(desk: &Desk, arguments: &[&str]) -> Agent {
        let mut command = desk.command(&[&["mcp"], arguments].concat());
        let mut process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (input, output) = (process.stdin.take().unwrap(), BufReader::new(process.stdout.take().unwrap()));
        let mut agent = Agent { process, input, output, calls: 0 };
        let client = json!({ "name": "test", "version": "0" });
        let hello = json!({ "protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": client });
        agent.ask("initialize", hello);
        agent.send(json!({ "jsonrpc": "2.0", "method": "notifications/initialized" }));
        agent
    }

    fn send(&mut self, message: Value) {
        writeln!(self.input, "{message}").unwrap();
    }

    fn ask(&mut self, method: &str, params: Value) -> Value {
        self.calls += 1;
        let id = self.calls;
        self.send(json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": params }));
        loop {
            let mut line = String::new();
            assert!(self.output.read_line(&mut line).unwrap() > 0, "it has ended");
            let answer: Value = serde_json::from_str(&line).unwrap();
            if answer["id"] == id {
                return answer;
            }
        }
    }

    /// The text of a tool's error; `None` if it has done its work.
    fn call(&mut self, tool: &str, arguments: &Value) -> Option<String> {
        let answer = self.ask("tools/call", json!({ "name": tool, "arguments": arguments }));
        let result = &answer["result"];
        result["isError"].as_bool().unwrap_or(true).then(|| format!("{} {}", result["content"], answer["error"]))
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn with(scene: &Value, more: &Value) -> Value {
    let mut all = scene.clone();
    all.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    all
}

/// No tool overwrites what is outside of its folder, nor a report anything but a report.
#[test]
fn tools_write_below_their_folder_alone() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("piles")).unwrap();
    for name in ["cone.glb", "stick.glb"] {
        std::fs::rename(desk.path(name), desk.path("piles").join(name)).unwrap();
    }
    for name in ["secret", "piles/package.json"] {
        desk.write(name, r#"{ "kept": true }"#);
    }
    let scene = json!({
        "control": ["cone.glb"], "props": ["stick.glb"], "accuracy": "draft", "set": ["fill.count=3"],
    });
    let mut agent = Agent::start(&desk, &["--folder", "piles"]);
    let secret = desk.path("secret").display().to_string();
    for (tool, arguments) in [
        ("bake", with(&scene, &json!({ "output": "pile.glb", "report": "../secret" }))),
        ("bake", with(&scene, &json!({ "output": "pile.glb", "report": secret }))),
        ("bake", with(&scene, &json!({ "output": "../pile.glb" }))),
        ("bake", with(&scene, &json!({ "output": "sub/../../pile.glb" }))),
        ("render", json!({ "pile": "cone.glb", "output": "../a.png" })),
        ("analyse", json!({ "pile": "cone.glb", "output": "../a.glb" })),
        ("pack", json!({ "pile": "cone.glb", "output": "../pack" })),
    ] {
        let error = agent.call(tool, &arguments).expect("it is refused");
        assert!(error.contains("the folder that this server writes below"), "{tool}: {error}");
    }
    let report = with(&scene, &json!({ "output": "pile.glb", "report": "package.json" }));
    let error = agent.call("bake", &report).expect("it is refused");
    assert!(error.contains("is no report of Cairn"), "{error}");
    let text = with(&scene, &json!({ "output": "pile.glb", "report": "cone.glb" }));
    assert!(agent.call("bake", &text).expect("it is refused").contains("is not the name of a report"));
    for name in ["secret", "piles/package.json"] {
        assert_eq!(std::fs::read_to_string(desk.path(name)).unwrap(), r#"{ "kept": true }"#);
    }
    assert!(!desk.files().iter().any(|name| name.contains("pile.glb") || name.contains("a.png")), "{:?}", desk.files());
    let done = with(&scene, &json!({ "output": "pile.glb", "report": "pile.report.json" }));
    assert_eq!(agent.call("bake", &done), None);
    assert_eq!(agent.call("bake", &done), None, "an earlier report is replaced");
    assert!(desk.path("piles/pile.glb").is_file() && desk.path("piles/pile.report.json").is_file());
}

/// A call may name any file; a scene or a model that a call names may not.
#[test]
fn scenes_name_no_files_outside() {
    let desk = Desk::new();
    for name in ["piles", "kit"] {
        std::fs::create_dir(desk.path(name)).unwrap();
    }
    std::fs::rename(desk.path("stick.glb"), desk.path("kit/stick.glb")).unwrap();
    std::fs::rename(desk.path("cone.glb"), desk.path("piles/cone.glb")).unwrap();
    desk.write(
        "piles/pile.toml",
        "accuracy = 'draft'\ncontrol_mesh.path = 'cone.glb'\nfill.count = 3\n[[props]]\npath = '../kit/stick.glb'\n",
    );
    desk.write("kit/pass.png", b"\x89PNG\r\n\x1a\nrest");
    let mut painted = box_json();
    painted["images"] = json!([{ "uri": "../kit/pass.png" }]);
    painted["textures"] = json!([{ "source": 0 }]);
    painted["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    painted["meshes"][0]["primitives"][0]["material"] = json!(0);
    desk.write("piles/painted.glb", glb(&painted, &box_data([0.3, 0.2, 0.4])));

    let mut agent = Agent::start(&desk, &["--folder", "piles"]);
    let by_scene = json!({ "scene": "pile.toml", "output": "pile.glb" });
    let error = agent.call("bake", &by_scene).expect("it is refused");
    assert!(error.contains("and only the scene names it") && error.contains("--allow"), "{error}");
    let painted = json!({ "pile": "painted.glb", "output": "a.png", "size": "16x16" });
    let error = agent.call("render", &painted).expect("it is refused");
    assert!(error.contains("and only painted.glb names it"), "{error}");
    assert!(!desk.path("piles/a.png").exists());
    let by_call = json!({
        "control": ["cone.glb"], "props": ["../kit/stick.glb"], "accuracy": "draft", "set": ["fill.count=3"],
        "output": "pile.glb",
    });
    assert_eq!(agent.call("bake", &by_call), None);
    drop(agent);
    let mut agent = Agent::start(&desk, &["--folder", "piles", "--allow", "kit"]);
    assert_eq!(agent.call("bake", &by_scene), None);
}

/// A server of tools that could write everywhere does not start.
#[test]
fn the_root_is_no_folder_for_tools() {
    let desk = Desk::new();
    desk.line("mcp --folder /").fails(2, &["the tools could write any", "--folder"]);
    desk.line("mcp --folder none").fails(2, &["there is no folder none"]);
}
