//! USD results: with textures, baked again, verified, in batches.

use crate::desk::Desk;

/// The stick has a picture.
const SCENE: &str = "--control cone.glb --prop stick.glb --accuracy draft --set fill.count=6 --frames 12";

fn bytes(desk: &Desk, name: &str) -> Vec<u8> {
    std::fs::read(desk.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

#[test]
fn the_same_bytes_in_every_process_and_again_from_the_result() {
    let desk = Desk::new();
    for ending in ["usda", "usdc", "usdz"] {
        for (name, threads) in [("one", 1), ("two", 2)] {
            desk.line(&format!("bake {SCENE} -o {name}.{ending} -q --threads {threads}")).ok();
        }
        let whole = bytes(&desk, &format!("one.{ending}"));
        assert_eq!(whole, bytes(&desk, &format!("two.{ending}")), "{ending}");
        desk.line(&format!("bake one.{ending} -o again.{ending} -q")).ok();
        assert_eq!(whole, bytes(&desk, &format!("again.{ending}")), "{ending}");
        // Its scene bakes to any other format.
        desk.line(&format!("bake one.{ending} -o {ending}.glb -q")).ok();
        assert_eq!(bytes(&desk, &format!("{ending}.glb")), bytes(&desk, "usda.glb"));
    }
    assert_eq!(desk.line("verify one.usda one.usdc one.usdz").ok().matches("the same").count(), 3);
}

#[test]
fn what_is_not_as_it_was_written_differs() {
    let desk = Desk::new();
    desk.line(&format!("bake {SCENE} -o pile.usdc -q")).ok();
    let picture = desk.path("textures").read_dir().unwrap().next().unwrap().unwrap().path();
    std::fs::remove_file(&picture).unwrap();
    let done = desk.line("verify pile.usdc");
    assert_eq!((done.code, done.stdout.contains("DIFFERS: textures/")), (1, true), "{}", done.stdout);
    // A bake into the same folder restores it.
    desk.line(&format!("bake {SCENE} -o pile.usdc -q")).ok();
    assert!(desk.line("verify pile.usdc").ok().contains("the same"));
    desk.write("text.usda", "#usda 1.0\n");
    desk.line("verify text.usda").fails(65, &["text.usda: it does not hold its scene"]);
}

#[test]
fn pictures_need_a_folder_beside_the_result() {
    let desk = Desk::new();
    let before = desk.files();
    desk.line(&format!("bake {SCENE} -o - --format usdc")).fails(2, &["files beside it", "--format usdz"]);
    assert_eq!(desk.files(), before);
    desk.write("textures", "");
    desk.line(&format!("bake {SCENE} -o pile.usda")).fails(2, &["textures", "not a folder"]);
    std::fs::remove_file(desk.path("textures")).unwrap();
    let mut package = desk.command(&["bake", "--format", "usdz", "-q", "-o", "-"]);
    let done = package.args(SCENE.split(' ')).output().unwrap();
    assert!(done.stdout.starts_with(b"PK\x03\x04"), "{done:?}");
}

#[test]
fn a_batch_shares_its_pictures_and_knows_what_is_finished() {
    let desk = Desk::new();
    let batch = format!("batch {SCENE} --seeds 1..2 -o out/{{seed}}.usdc --progress none");
    desk.line(&batch).ok();
    let names = |folder: &str| desk.path(folder).read_dir().unwrap().count();
    assert_eq!((names("out"), names("out/textures")), (5, 1), "two results, their reports, a folder");
    // They are ranked, and shown with their pictures.
    let ranking = desk.line("rank out --json --by bodies").ok();
    let ranking: Vec<serde_json::Value> = serde_json::from_str(&ranking).unwrap();
    assert!(ranking.len() == 2 && ranking[0]["result"] == "out/1.usdc", "{ranking:?}");
    let sheet = std::fs::read_to_string(desk.path("out/contact-sheet.html")).unwrap();
    assert!(sheet.len() > 10_000);
    for name in ["contact-sheet.html", "contact-sheet.png"] {
        std::fs::remove_file(desk.path("out").join(name)).unwrap();
    }
    let done = desk.line("render out/1.usdc -o pile.png --size 80x60 --samples 1");
    assert!(done.code == 0 && done.stderr.is_empty(), "{}", done.stderr);
    desk.write("text.usda", "#usda 1.0\n");
    desk.line("render text.usda -o text.png").fails(65, &["text.usda: it shows no meshes"]);
    let before = desk.path("out/1.usdc").metadata().unwrap().modified().unwrap();
    desk.line(&batch).ok();
    assert_eq!(desk.path("out/1.usdc").metadata().unwrap().modified().unwrap(), before, "nothing is baked twice");
}
