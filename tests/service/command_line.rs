//! The program as a client of the server. Long: its commands share scenes and servers.

use crate::service::server::{
    PROGRAM, Server, accepted_id, asset, begin, content, endless, events, request, sha256, short, status, until,
};
use cairn_service::client::Connection;
use cairn_wire::proto::{BakeState, BakeStatus, DeleteBakeRequest, ListBakesRequest};
use prost::Message;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

/// Runs `cairn LINE` in the folder of the example models.
fn cairn(folder: &Path, line: &str) -> Output {
    for name in ["cone-small.glb", "stick.glb"] {
        std::fs::copy(asset(name), folder.join(name)).unwrap();
    }
    let mut command = Command::new(PROGRAM);
    command.args(line.split_whitespace()).current_dir(folder).env_remove("CAIRN_TOKEN").output().unwrap()
}

const SCENE: &str = "--control cone-small.glb --prop stick.glb --accuracy draft --set fill.count=12";

#[test]
fn the_same_bytes_from_near_and_far() {
    let server = Server::start(&[]);
    let far = &server.addresses[0];
    for format in ["glb", "csv"] {
        let near = cairn(server.folder(), &format!("bake {SCENE} -o near.{format}"));
        assert!(near.status.success());
        let done = cairn(server.folder(), &format!("bake {SCENE} -o far.{format} --report far.txt --server {far}"));
        let printed = String::from_utf8(done.stderr).unwrap();
        assert_eq!(done.status.code(), Some(0), "{printed}");
        let read = |name: &str| std::fs::read(server.path(&format!("{name}.{format}"))).unwrap();
        assert!(read("near") == read("far"), "the results differ");
        assert!(printed.contains("12 bodies") && printed.starts_with("bake "), "{printed}");

        let id = printed.lines().next().unwrap().strip_prefix("bake ").unwrap().to_owned();
        let done = cairn(server.folder(), &format!("watch {id} -o again.{format} --quiet --server {far}"));
        assert!(done.status.success() && done.stderr.is_empty(), "{done:?}");
        assert!(read("again") == read("far"));
    }
}

/// Assets that are USD are sent with the layers that they name, and a result refers to them from where it is written.
#[test]
fn assets_of_a_show_are_sent_and_referred_to() {
    let server = Server::start(&[]);
    let far = &server.addresses[0];
    std::fs::create_dir_all(server.path("kit/geo")).unwrap();
    std::fs::create_dir_all(server.path("shots/a")).unwrap();
    std::fs::copy(asset("kit.usda"), server.path("kit/geo/kit.usda")).unwrap();
    let prop = "#usda 1.0\n(\n    defaultPrim = \"brick\"\n    metersPerUnit = 0.01\n    upAxis = \"Z\"\n)\n\
                def \"brick\" (\n    payload = @./geo/kit.usda@</Kit/Brick>\n)\n{\n}\n";
    std::fs::write(server.path("kit/brick.usda"), prop).unwrap();
    let scene = "--control cone-small.glb --prop kit/brick.usda --accuracy draft --set fill.count=6 --frames 4";
    for (set, name) in [("", "pile.usda"), ("", "shots/a/pile.usda"), ("--set usd.up_axis=z", "shots/pile.usda")] {
        let bake = |to: &str| {
            let done = cairn(server.folder(), &format!("bake {scene} {set} -q -o {name} {to}"));
            assert!(done.status.success(), "{done:?}");
            std::fs::read_to_string(server.path(name)).unwrap()
        };
        let (near, remote) = (bake(""), bake(&format!("--server {far}")));
        assert!(near.contains("kit/brick.usda@\n") && !near.contains("faceVertexCounts"), "{name}");
        assert!(near == remote, "{name}: the results differ");
    }
}

#[test]
fn what_the_server_refuses_has_the_exit_codes_of_a_bake() {
    let server = Server::start(&[]);
    let far = &server.addresses[0];
    let run = |line: String| {
        let done = cairn(server.folder(), &line);
        (done.status.code().unwrap(), String::from_utf8(done.stderr).unwrap())
    };
    let wrong = "--set physics.substeps=-1 --set props.0.weight=-1";
    let (code, printed) = run(format!("bake {SCENE} {wrong} -o far.glb --server {far}"));
    assert!(code == 65 && printed.contains("physics.substeps") && printed.contains("weight"), "{printed}");
    let (code, printed) = run(format!("bake {SCENE} --prop stik.glb -o far.glb --server {far}"));
    assert!(code == 65 && printed.contains("Did you mean stick.glb?"), "{printed}");
    let (code, printed) = run(format!("watch nothing --server {far}"));
    assert!(code == 65 && printed.contains("not the id of a bake"), "{printed}");
    let (code, printed) = run(format!("watch 0123456789 --server {far}"));
    assert!(code == 2 && printed.contains("0123456789"), "{printed}");
    let (code, printed) = run(format!("bake {SCENE} -o far.glb --server 127.0.0.1:9"));
    assert!(code == 75 && printed.contains("127.0.0.1:9"), "{printed}");
    assert!(!server.path("far.glb").exists());
}

#[tokio::test]
async fn cancel_from_elsewhere() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let id = begin(&mut connection, endless(1)).await;
    until(&mut connection, &id, BakeState::Running).await;
    let far = &server.addresses[0];
    assert!(cairn(server.folder(), &format!("cancel {id} --server {far}")).status.success());
    assert_eq!(status(&mut connection, &id).await.state(), BakeState::Cancelled);
    let done = cairn(server.folder(), &format!("watch {id} --server {far}"));
    assert_eq!(done.status.code(), Some(130));
}

/// A client with a bake of hours on the server, which runs: its process and its id.
async fn long_bake(server: &Server, connection: &mut Connection) -> (Child, String) {
    cairn(server.folder(), "--version");
    let line = format!("bake {SCENE} --set physics.step_natural=0.000001 -o far.glb --server {}", server.addresses[0]);
    let mut bake = Command::new(PROGRAM);
    let bake = bake.args(line.split_whitespace()).current_dir(server.folder()).stderr(Stdio::piped()).spawn().unwrap();
    let id = loop {
        let bakes = connection.service.list_bakes(ListBakesRequest::default()).await.unwrap().into_inner().bakes;
        if let Some(status) = bakes.first().filter(|bake| bake.progress.is_some()) {
            break status.bake_id.clone();
        }
    };
    (bake, id)
}

/// Ctrl-C ends the bake where it runs.
#[tokio::test]
async fn ctrl_c_cancels_on_the_server() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (mut bake, id) = long_bake(&server, &mut connection).await;
    assert!(Command::new("kill").args(["-INT", &bake.id().to_string()]).status().unwrap().success());
    assert_eq!(bake.wait().unwrap().code(), Some(130));
    assert_eq!(status(&mut connection, &id).await.state(), BakeState::Cancelled);
    assert!(!server.path("far.glb").exists());
}

/// A client whose server died says how to go on with the bake.
#[tokio::test]
async fn a_lost_server_may_come_back() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    let (bake, id) = long_bake(&server, &mut connection).await;
    server.signal("-KILL");
    let done = bake.wait_with_output().unwrap();
    let printed = String::from_utf8(done.stderr).unwrap();
    assert_eq!(done.status.code(), Some(75), "{printed}");
    assert!(printed.contains(&format!("`cairn watch {id} -o far.glb`")), "{printed}");
}

/// A file outside the folder that a link beside a model points to is not sent.
#[cfg(unix)]
#[test]
fn nothing_outside_of_a_models_folder_is_sent() {
    let server = Server::start(&[]);
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("scene")).unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("secret", b"a private key");
    write("scene/stick.glb", &content("stick.glb"));
    let control = serde_json::json!({ "asset": { "version": "2.0" }, "images": [{ "uri": "texture.png" }] });
    write("scene/control.gltf", control.to_string().as_bytes());
    std::os::unix::fs::symlink("../secret", folder.path().join("scene/texture.png")).unwrap();
    let mut command = std::process::Command::new(PROGRAM);
    command.args(["bake", "--control", "control.gltf", "--prop", "stick.glb", "-o", "pile.glb", "--server"]);
    let done = command.arg(&server.addresses[0]).current_dir(folder.path().join("scene")).output().unwrap();
    let printed = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.code() == Some(65) && printed.contains("texture.png: a link that leads out"), "{printed}");
    assert_eq!(std::fs::read_dir(server.path("data/assets")).unwrap().count(), 0);
}

/// A path may visibly lead out of the scene's folder, by `../`. A link is not visible.
#[cfg(unix)]
#[test]
fn a_model_behind_a_link_is_not_sent() {
    let server = Server::start(&[]);
    let folder = tempfile::tempdir().unwrap();
    for name in ["scene", "library"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("library/stick.glb", &content("stick.glb"));
    write("scene/cone.glb", &content("cone-small.glb"));
    let link = |to: &str, name: &str| std::os::unix::fs::symlink(to, folder.path().join("scene").join(name)).unwrap();
    link("../library/stick.glb", "stick.glb");
    link("../library", "props");
    link("cone.glb", "control.glb");
    let scene = |prop: &str| {
        let text = "accuracy = 'draft'\ncontrol_mesh.path = 'control.glb'\nfill.count = 12\n";
        write("scene/pile.toml", format!("{text}[[props]]\npath = '{prop}'\n").as_bytes());
    };
    let run = |line: &str, within: &str| {
        let mut command = Command::new(PROGRAM);
        command.arg("bake").args(line.split_whitespace()).args(["-o", "pile.glb", "--server", &server.addresses[0]]);
        let done = command.current_dir(folder.path().join(within)).output().unwrap();
        (done.status.code().unwrap(), String::from_utf8(done.stderr).unwrap())
    };
    for prop in ["stick.glb", "props/stick.glb"] {
        scene(prop);
        for (line, within) in [("pile.toml", "scene"), ("scene/pile.toml", "")] {
            let (code, printed) = run(line, within);
            assert!(
                code == 65 && printed.contains(&format!("{prop}: a link that leads out of the scene")),
                "{printed}"
            );
        }
        let (code, printed) = run(&format!("--control control.glb --prop {prop}"), "scene");
        assert!(code == 65 && printed.contains("a link that leads out of the scene"), "{printed}");
    }
    assert_eq!(std::fs::read_dir(server.path("data/assets")).unwrap().count(), 0, "nothing was sent");
    // A link that stays in the folder is as good as the file, and so is any where its target is allowed.
    let (code, printed) = run("pile.toml --allow ../library", "scene");
    assert_eq!(code, 0, "{printed}");
}

/// A file outside that only a scene or a model names is not sent, whoever can read it; and nothing is sent that is not
/// a model by its content.
#[test]
fn what_only_a_scene_names_outside_is_not_sent() {
    const KEY: &str = "-----BEGIN OPENSSH PRIVATE KEY-----\nb3BlbnNzaC1rZXktdjEAAAAA\n";
    let server = Server::start(&[]);
    let folder = tempfile::tempdir().unwrap();
    for name in ["scene", "outside"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("scene/cone.glb", &content("cone-small.glb"));
    write("scene/stick.glb", &content("stick.glb"));
    write("outside/stick.glb", &content("stick.glb"));
    write("outside/id_rsa", KEY.as_bytes());
    write("scene/id_rsa", KEY.as_bytes());
    write("scene/notes.json", br#"{ "password": "secret" }"#);
    write("outside/pass.png", b"\x89PNG\r\n\x1a\nrest");
    write("outside/secret.usda", b"#usda 1.0\n(defaultPrim = \"a\")\ndef Mesh \"a\" {}\n");
    write(
        "scene/link.usda",
        b"#usda 1.0\n(defaultPrim = \"a\")\ndef \"a\" (references = @../outside/secret.usda@) {}\n",
    );
    write("scene/painted.gltf", painted("../outside/pass.png", 0.2).as_bytes());
    let buffers = |uri: &str| {
        let mut json: serde_json::Value = serde_json::from_str(&painted("none.png", 0.2)).unwrap();
        json["buffers"][0]["uri"] = uri.into();
        json.to_string()
    };
    write("scene/greedy.gltf", buffers("id_rsa").as_bytes());
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let private = std::fs::Permissions::from_mode(0o600);
        std::fs::set_permissions(folder.path().join("outside/id_rsa"), private).unwrap();
    }
    let run = |command: &str, line: &str, allowed: &str| {
        let mut run = Command::new(PROGRAM);
        run.arg(command).args(line.split_whitespace());
        match command {
            "scene" => run.args(["--request", "sent"]),
            "bake" => run.args(["-o", "pile.glb", "--server", &server.addresses[0]]),
            _ => run.args(["--server", &server.addresses[0]]),
        };
        run.env("CAIRN_ALLOW", allowed).current_dir(folder.path().join("scene"));
        let done = run.output().unwrap();
        (done.status.code().unwrap(), String::from_utf8(done.stderr).unwrap())
    };
    let sent = || std::fs::read_dir(server.path("data/assets")).unwrap().count();
    let whole = folder.path().join("outside/stick.glb").display().to_string();
    let by_scene = |prop: &str| {
        let text = "accuracy = 'draft'\ncontrol_mesh.path = 'cone.glb'\nfill.count = 12\n";
        write("scene/pile.toml", format!("{text}[[props]]\npath = '{prop}'\n").as_bytes());
        "pile.toml".to_owned()
    };
    let by_flag = |prop: &str| format!("--control cone.glb --accuracy draft --set fill.count=12 --prop {prop}");
    let outside = "outside of the scene's folder, and only";
    for (prop, is_by_flag, more, words) in [
        ("../outside/id_rsa", false, "", outside),
        ("../outside/stick.glb", false, "", outside),
        (&*whole, false, "", outside),
        ("painted.gltf", false, "", "and only painted.gltf names it"),
        ("painted.gltf", true, "", "and only painted.gltf names it"),
        ("link.usda", false, "", "and only link.usda names it"),
        ("../outside/id_rsa", true, "", "this is not glTF"),
        ("../outside/id_rsa", false, "--allow ../outside", "this is not glTF"),
        ("id_rsa", false, "", "this is not glTF"),
        ("notes.json", false, "", "this is not glTF; it looks like some other JSON"),
        ("greedy.gltf", false, "", "a model names it as its buffer, but its name is not that of one"),
        ("stick.glb", true, "--allow nowhere", "there is no folder nowhere"),
    ] {
        let line = if is_by_flag { by_flag(prop) } else { by_scene(prop) };
        for command in ["bake", "plan", "scene"] {
            let (code, printed) = run(command, &format!("{line} {more}"), "");
            let expected = if words.contains("nowhere") { 2 } else { 65 };
            assert!(code == expected && printed.contains(words), "{command} {prop}: {code} {printed}");
            assert!(!folder.path().join("scene/sent").exists(), "{command} {prop}");
        }
        assert_eq!(sent(), 0, "{prop}");
    }
}

/// A result is a scene of somebody else, too: that it knows a file in a folder above does not open that folder.
#[test]
fn a_result_of_somebody_else_opens_no_folder() {
    let server = Server::start(&[]);
    let folder = tempfile::tempdir().unwrap();
    for name in ["evil", "lib"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    std::fs::write(folder.path().join("known.txt"), "known to all").unwrap();
    std::fs::write(folder.path().join("lib/private.glb"), content("stick.glb")).unwrap();
    std::fs::write(folder.path().join("evil/cone.glb"), content("cone-small.glb")).unwrap();
    let known = |uri: &str, content: &[u8]| serde_json::json!({ "uri": uri, "sha256": sha256(content) });
    let private = || known("lib/private.glb", &content("stick.glb"));
    for (assets, names_it) in [
        (vec![], "../lib/private.glb"),
        (vec![known("known.txt", b"known to all")], "lib/private.glb"),
        // Who knows a file by its hash learns nothing new from it.
        (vec![known("evil/cone.glb", &content("cone-small.glb")), private()], "lib/private.glb"),
    ] {
        let control = if names_it.starts_with("..") { "cone.glb" } else { "evil/cone.glb" };
        let is_known = assets.len() == 2;
        let scene = serde_json::json!({
            "control_mesh": control, "props": [names_it], "accuracy": "draft", "fill": { "count": 12 },
        });
        let versions = serde_json::json!({});
        let origin = serde_json::json!({
            "scene": scene, "assets": assets, "versions": versions, "result_blake3": "", "request_blake3": "",
        });
        let result = serde_json::json!({ "frames": [], "cairn": origin });
        std::fs::write(folder.path().join("evil/pile.json"), result.to_string()).unwrap();
        let mut command = Command::new(PROGRAM);
        command.args(["plan", "pile.json", "--server", &server.addresses[0]]).env_remove("CAIRN_ALLOW");
        let done = command.current_dir(folder.path().join("evil")).output().unwrap();
        let printed = String::from_utf8(done.stderr).unwrap();
        let is_refused = done.status.code() == Some(65) && printed.contains("and only the scene names it");
        assert!(if is_known { done.status.success() } else { is_refused }, "{names_it}: {printed}");
    }
}

/// What the user names by a flag is sent, and what lies in an allowed folder, by a flag or a setting.
#[test]
fn what_is_named_or_allowed_is_sent() {
    let server = Server::start(&[]);
    let folder = tempfile::tempdir().unwrap();
    for name in ["scene", "kit"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("scene/cone.glb", &content("cone-small.glb"));
    write("kit/stick.glb", &content("stick.glb"));
    write("kit/red.png", b"\x89PNG\r\n\x1a\nrest");
    write("kit/painted.gltf", painted("red.png", 0.2).as_bytes());
    let text = "accuracy = 'draft'\ncontrol_mesh.path = 'cone.glb'\nfill.count = 12\n";
    write("scene/pile.toml", format!("{text}[[props]]\npath = '../kit/stick.glb'\n").as_bytes());
    let flags = "--control cone.glb --accuracy draft --set fill.count=12";
    let kit = folder.path().join("kit").display().to_string();
    for (line, allowed) in [
        (format!("{flags} --prop ../kit/stick.glb"), ""),
        (format!("{flags} --prop stick.glb --set props.0.path=../kit/stick.glb"), ""),
        // A model that the user names has its own folder.
        (format!("{flags} --prop ../kit/painted.gltf"), ""),
        ("pile.toml --prop ../kit/stick.glb".to_owned(), ""),
        ("pile.toml --allow ../kit".to_owned(), ""),
        ("pile.toml".to_owned(), &*kit),
    ] {
        let mut command = Command::new(PROGRAM);
        command.arg("plan").args(line.split_whitespace()).args(["--server", &server.addresses[0]]);
        let done = command.env("CAIRN_ALLOW", allowed).current_dir(folder.path().join("scene")).output().unwrap();
        assert!(done.status.success(), "{line}: {}", String::from_utf8_lossy(&done.stderr));
    }
}

/// A result that has changed on disk is not delivered, whether the server or only its caller can detect it.
#[tokio::test]
async fn a_changed_result_is_not_written() {
    let server = Server::start(&[]);
    let mut connection = server.ready().await;
    for (name, is_status_changed) in
        [("result.glb", false), ("result.glb", true), ("report.json", false), ("report.json", true)]
    {
        let (printed, _) = events(connection.service.bake(request(short(1))).await.unwrap().into_inner()).await;
        let id = accepted_id(&printed);
        let folder = server.path("data/bakes").join(&id);
        let mut bytes = std::fs::read(folder.join(name)).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(folder.join(name), &bytes).unwrap();
        if is_status_changed {
            let path = folder.join("status.binpb");
            let mut status = BakeStatus::decode(&std::fs::read(&path).unwrap()[..]).unwrap();
            let summary = status.summary.as_mut().unwrap();
            let hash = if name == "result.glb" { &mut summary.result_sha256 } else { &mut summary.report_sha256 };
            *hash = sha256(&bytes);
            std::fs::write(path, status.encode_to_vec()).unwrap();
            std::fs::remove_file(folder.join("result.glb.head")).unwrap();
        }
        let line = format!("watch {id} -o again.glb --report again.json --server {}", server.addresses[0]);
        let done = cairn(server.folder(), &line);
        let printed = String::from_utf8(done.stderr).unwrap();
        let expected = if is_status_changed { "changed in transfer" } else { "changed since it was written" };
        assert!(done.status.code() == Some(75) && printed.contains(expected), "{name}: {printed}");
        assert!(!server.path("again.glb").exists() && !server.path("again.json").exists(), "{name}");
        connection.service.delete_bake(DeleteBakeRequest { bake_id: id }).await.unwrap();
    }
}

#[tokio::test]
async fn labels_and_priority() {
    let server = Server::start(&[]);
    let run = |rest: &str| {
        let done = cairn(server.folder(), &format!("bake {SCENE} -o far.glb {rest}"));
        (done.status.code().unwrap(), String::from_utf8(done.stderr).unwrap())
    };
    let far = format!("--server {}", server.addresses[0]);
    let (code, printed) = run(&format!("{far} --label shot=a010 --label show=kites --priority -5"));
    assert_eq!(code, 0, "{printed}");
    let mut connection = server.connect().await;
    let labels = [("shot".to_owned(), "a010".to_owned()), ("show".to_owned(), "kites".to_owned())];
    let list = ListBakesRequest { labels: labels.into_iter().collect(), ..Default::default() };
    let bakes = connection.service.list_bakes(list).await.unwrap().into_inner().bakes;
    assert_eq!(bakes.iter().map(|bake| bake.priority).collect::<Vec<_>>(), [-5]);
    for (rest, expected, words) in [
        (format!("{far} --label Shot=1"), 65, "its name does not begin with a letter"),
        (format!("{far} --label shot"), 2, "KEY=VALUE"),
        (format!("{far} --priority 101"), 2, "101"),
        ("--label shot=a010".to_owned(), 2, "--server"),
    ] {
        let (code, printed) = run(&rest);
        assert!(code == expected && printed.contains(words), "{rest}: {printed}");
    }
}

/// A prop with a picture of this URI, and with a skin.
fn painted(picture: &str, size: f32) -> String {
    let points = [[0.0, 0.0, 0.0], [size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]];
    let faces: [u16; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
    let data = points.iter().flatten().flat_map(|x| x.to_le_bytes()).chain(faces.iter().flat_map(|i| i.to_le_bytes()));
    let data: String = data.map(|byte| format!("%{byte:02x}")).collect();
    serde_json::json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0, "skin": 0 }],
        "skins": [{ "joints": [0] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "name": "Clay", "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0 }], "images": [{ "uri": picture }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4 },
            { "bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 12 },
        ],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 24 }],
        "buffers": [{ "byteLength": 72, "uri": format!("data:,{data}") }],
    })
    .to_string()
}

/// A picture of a folder above is sent, nothing else from there is, and what was not sent is reported.
#[test]
fn pictures_are_sent_and_missing_ones_reported() {
    const PNG: &[u8] = b"\x89PNG\r\n\x1a\nrest";
    let server = Server::start(&[]);
    let far = &server.addresses[0];
    for folder in ["kit/gltf", "kit/textures"] {
        std::fs::create_dir_all(server.path(folder)).unwrap();
    }
    std::fs::write(server.path("kit/textures/Red.png"), PNG).unwrap();
    std::fs::write(server.path("kit/secret.png"), "a private key").unwrap();
    let run = |arguments: &str| {
        let line = format!("bake --control cone-small.glb --prop kit/gltf/a.gltf {arguments}");
        let done = cairn(server.folder(), &format!("{line} --accuracy draft --set fill.count=3"));
        (done.status.code().unwrap(), String::from_utf8(done.stderr).unwrap())
    };
    let picture = |uri: &str| std::fs::write(server.path("kit/gltf/a.gltf"), painted(uri, 0.2)).unwrap();
    picture("..\\Textures\\red.png");
    for arguments in ["-o near.glb".to_owned(), format!("-o far.glb --server {far}")] {
        let (code, printed) = run(&arguments);
        assert!(code == 0 && !printed.contains("image"), "{printed}");
    }
    let read = |name: &str| std::fs::read(server.path(name)).unwrap();
    assert!(read("near.glb") == read("far.glb") && read("far.glb").windows(PNG.len()).any(|part| part == PNG));

    // In USD, pictures are files beside the result: the same ones from near and far.
    for folder in ["usd-near", "usd-far"] {
        std::fs::create_dir(server.path(folder)).unwrap();
    }
    for arguments in ["-o usd-near/a.usdc".to_owned(), format!("-o usd-far/a.usdc --server {far}")] {
        let (code, printed) = run(&arguments);
        assert_eq!(code, 0, "{printed}");
    }
    let all = |folder: &str| -> Vec<(String, Vec<u8>)> {
        let textures = server.path(folder).join("textures");
        let names = std::fs::read_dir(textures).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let names = names.map(|name| format!("{folder}/textures/{name}")).chain([format!("{folder}/a.usdc")]);
        names.map(|name| (name[folder.len()..].to_owned(), read(&name))).collect()
    };
    assert_eq!(all("usd-far").len(), 2);
    assert!(all("usd-near") == all("usd-far"));

    for (case, uri, words) in [
        ("when the picture is sent", "../textures/Red.png", ""),
        ("when the picture is far", "https://example.org/red.png", ""),
        (
            "when the picture is no picture",
            "../secret.png",
            "the image \"../secret.png\" of material `Clay` was not sent to the server (looked for kit/secret.png): \
             the result shows the material without it",
        ),
    ] {
        picture(uri);
        let (code, printed) = run(&format!("-o far.glb --server {far}"));
        assert_eq!(code, 0, "{case}: {printed}");
        assert_eq!(printed.contains("was not sent to the server"), !words.is_empty(), "{case}: {printed}");
        assert!(printed.contains(words), "{case}: {printed}");
    }
    let assets = std::fs::read_dir(server.path("data/assets")).unwrap();
    assert!(assets.flatten().all(|asset| std::fs::read(asset.path()).unwrap() != b"a private key"));

    // A refused bake keeps its notes.
    std::fs::write(server.path("kit/gltf/a.gltf"), painted("../textures/Red.png", 200.0)).unwrap();
    let (code, printed) = run(&format!("-o far.glb --server {far}"));
    assert!(code == 65 && printed.contains("error: kit/gltf/a.gltf: at "), "{printed}");
    assert!(printed.contains("note: kit/gltf/a.gltf: node 0: its skin is not applied"), "{printed}");
}

/// The bakes of a server from the command line; a result has the format of its name.
#[test]
fn bakes_are_listed_shown_awaited_and_deleted() {
    let server = Server::start(&[]);
    let far = &server.addresses[0];
    let run = |line: &str| {
        let done = cairn(server.folder(), &format!("{line} --server {far}"));
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (done.status.code().unwrap(), text(done.stdout), text(done.stderr))
    };
    let ok = |line: &str| {
        let (code, printed, errors) = run(line);
        assert_eq!(code, 0, "{line}: {errors}");
        printed
    };
    let scene = "--control cone-small.glb --prop stick.glb --accuracy draft --set fill.count=3";
    for shot in ["a010", "b:2.Ä"] {
        ok(&format!("bake {scene} --frames 4 --seed {} -o {}.glb --label shot={shot}", shot.len(), &shot[..1]));
    }
    let list = |more: &str| -> Vec<serde_json::Value> {
        serde_json::from_str(&ok(&format!("bakes list --json {more}"))).unwrap()
    };
    assert_eq!(list("").len(), 2);
    assert_eq!((list("--first 1").len(), list("--state failed").len(), list("--label shot=none").len()), (1, 0, 0));
    let found = list("--label shot=b:2.Ä --state succeeded");
    let id = found[0]["id"].as_str().unwrap();
    assert!(found.len() == 1 && found[0]["format"] == "glb" && found[0]["callers"][0]["labels"]["shot"] == "b:2.Ä");
    assert!(ok("bakes list").contains("shot=a010"));
    let start = &id[..8];
    assert!(ok(&format!("bakes show {start}")).contains(id));
    assert!(ok(&format!("bakes wait {start}")).contains("succeeded"));
    ok(&format!("watch {start} -o w.glb"));
    assert!(std::fs::read(server.path("w.glb")).unwrap() == std::fs::read(server.path("b.glb")).unwrap());
    ok(&format!("watch {start} -o w.usdz --report w.json"));
    assert!(std::fs::read(server.path("w.usdz")).unwrap().starts_with(b"PK"));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(server.path("w.json")).unwrap()).unwrap();
    assert_eq!(report["output"], "result.usdz");
    for name in ["w.txt", "w"] {
        let (code, _, errors) = run(&format!("watch {start} -o {name}"));
        assert!(code == 2 && errors.contains("the format is unknown"), "{errors}");
        assert!(!server.path(name).exists());
    }
    ok(&format!("bakes delete {start}"));
    let (code, _, errors) = run(&format!("bakes show {start}"));
    assert!(code == 2 && errors.contains("there is no bake"), "{errors}");
    let (code, _, errors) = run("bakes show x");
    assert!(code == 65 && errors.contains("not the id of a bake"), "{errors}");
}

/// A plan and a batch on a server: the same bytes as here, and what is there is not baked again.
#[test]
fn plans_and_batches_on_a_server() {
    let server = Server::start(&[]);
    let far = &server.addresses[0];
    let run = |line: &str| {
        let done = cairn(server.folder(), line);
        assert_eq!(done.status.code(), Some(0), "{line}: {}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8(done.stdout).unwrap()
    };
    let scene = "--control cone-small.glb --prop stick.glb --accuracy draft --set fill.count=3 --set output.frames=4";
    let plan: serde_json::Value = serde_json::from_str(&run(&format!("plan {scene} --json --server {far}"))).unwrap();
    assert!(plan["estimates"].as_array().unwrap().len() >= 5 && plan["most_result_bytes"].as_i64().unwrap() > 1000);
    assert!(run(&format!("plan {scene} --server {far}")).contains("about 3"));
    let batch =
        |more: &str, output: &str| run(&format!("batch {scene} --seeds 1..2 -o {output} --json --jobs 2 {more}"));
    let states = |printed: String| -> Vec<String> {
        let rows: Vec<serde_json::Value> = serde_json::from_str(&printed).unwrap();
        rows.iter().map(|row| row["state"].as_str().unwrap().to_owned()).collect()
    };
    let there = format!("--server {far} --label shot=a010");
    assert_eq!(states(batch(&there, "far/{seed:02}.glb")), ["baked", "baked"]);
    assert_eq!(states(batch(&there, "far/{seed:02}.glb")), ["finished before", "finished before"]);
    batch("", "near/{seed:02}.glb");
    for name in ["01.glb", "02.glb"] {
        let read = |folder: &str| std::fs::read(server.path(folder).join(name)).unwrap();
        assert!(read("far") == read("near"), "{name}");
    }
}

/// A disk without room for the result is known before the bake; the server does not go on for nobody.
#[test]
fn a_result_without_room_is_not_baked() {
    let server = Server::start(&[]);
    let scene = ["bake", "--control", "cone-small.glb", "--prop", "stick.glb", "--accuracy", "draft", "-o", "far.glb"];
    let mut command = std::process::Command::new(crate::service::server::PROGRAM);
    for name in ["cone-small.glb", "stick.glb"] {
        std::fs::copy(crate::service::server::asset(name), server.path(name)).unwrap();
    }
    command.args(scene).args(["--server", &server.addresses[0], "--set", "physics.step_natural=0.000001"]);
    let done = command.current_dir(server.folder()).env("FAILPOINTS", "output-room=return(ENOSPC)").output().unwrap();
    let errors = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.code() == Some(65) && errors.contains("MiB are expected"), "{errors}");
    let listed = cairn(server.folder(), &format!("bakes list --json --server {}", server.addresses[0]));
    let listed: Vec<serde_json::Value> = serde_json::from_slice(&listed.stdout).unwrap();
    assert_eq!(listed[0]["state"], "cancelled");
}
