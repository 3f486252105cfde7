//! USD results: with textures, baked again, verified, in batches.

use crate::cli::desk::Desk;

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

/// A box in centimetres, Z up, whose mesh is a payload.
fn published(desk: &Desk) {
    std::fs::create_dir_all(desk.path("kit/brick")).unwrap();
    let header = "#usda 1.0\n(\n    defaultPrim = \"brick\"\n    metersPerUnit = 0.01\n    upAxis = \"Z\"\n)\n";
    let mesh = "point3f[] points = [(-12, -5, 0), (-12, -5, 7), (-12, 5, 0), (-12, 5, 7), (12, -5, 0), (12, -5, 7), \
                (12, 5, 0), (12, 5, 7)]\nint[] faceVertexCounts = [4, 4, 4, 4, 4, 4]\n\
                int[] faceVertexIndices = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]\n";
    let payload = format!(
        "{header}def Xform \"brick\"\n{{\ndef Mesh \"body\"\n{{\n{mesh}\
         uniform token subdivisionScheme = \"none\"\n}}\n}}\n"
    );
    desk.write("kit/brick/geo.usda", payload);
    let top = "def Xform \"brick\" (\n    payload = @./geo.usda@\n)\n{\n}\n";
    desk.write("kit/brick/brick.usda", format!("{header}{top}"));
    desk.write("kit/lost.usda", format!("{header}{}", top.replace("geo", "gone")));
    desk.write(
        "kit/odd.usda",
        format!("{header}{}", top.replace("./geo.usda", "./brick/geo.usda@</wall>").replace(">@", ">")),
    );
    let cages = format!(
        "{header}def Xform \"brick\"\n{{\ndef Mesh \"body\" (\n    \
         prepend apiSchemas = [\"MaterialBindingAPI\"]\n)\n{{\n{mesh}\
         rel material:binding = </brick/other>\n}}\ndef Cube \"cube\"\n{{\n}}\ndef Material \"other\"\n{{\n}}\n\
         def SkelRoot \"doll\"\n{{\n}}\n}}\n"
    );
    desk.write("kit/cages.usda", cages);
}

const BRICKS: &str = "--control cone.glb --prop kit/brick/brick.usda --accuracy draft --set fill.count=6 \
                      --set glue=natural --frames 4";

#[test]
fn props_that_are_usd_are_referred_to() {
    let desk = Desk::new();
    published(&desk);
    std::fs::create_dir_all(desk.path("shots/a")).unwrap();
    for name in ["pile.usda", "shots/a/pile.usda", "pile.usdc", "pile.usdz", "pile.glb"] {
        desk.line(&format!("bake {BRICKS} -o {name} -q")).ok();
    }
    let text = |name: &str| String::from_utf8(bytes(&desk, name)).unwrap();
    assert!(
        text("pile.usda").contains("references = @./kit/brick/brick.usda@\n")
            && !text("pile.usda").contains("faceVertexCounts")
    );
    assert!(text("shots/a/pile.usda").contains("references = @../../kit/brick/brick.usda@\n"));
    let done = desk.line(&format!("bake {BRICKS} -o other.usdz"));
    assert!(done.stderr.contains("a .usdz holds copies of what is USD, without its variants"), "{}", done.stderr);
    // The payload is among its files: without it, it is another result.
    assert!(text("pile.usda").contains("\"uri\":\"kit/brick/geo.usda\""));
    assert_eq!(desk.line("verify pile.usda pile.usdc pile.usdz shots/a/pile.usda").ok().matches("the same").count(), 4);
    desk.line("bake pile.usda -o again.usda -q").ok();
    assert_eq!(text("again.usda"), text("pile.usda"));
    // All formats show the same bodies, with the asset's mesh.
    desk.line("render pile.glb -o glb.png --size 90x60 --samples 4").ok();
    for name in ["pile.usda", "pile.usdc", "pile.usdz", "shots/a/pile.usda"] {
        desk.line(&format!("render {name} -o usd.png --size 90x60 --samples 4")).ok();
        let picture = |name: &str| image::open(desk.path(name)).unwrap().to_rgb8();
        let (expected, found) = (picture("glb.png"), picture("usd.png"));
        let differs = |(a, b): &(&image::Rgb<u8>, &image::Rgb<u8>)| (0..3).any(|c| a[c].abs_diff(b[c]) > 16);
        let different = found.pixels().zip(expected.pixels()).filter(differs).count();
        assert!(different < 60, "{name}: {different} pixels differ");
    }
    // A pile is built around one that is USD.
    let around =
        "--control cone.glb --prop stick.glb --around pile.usdc --accuracy draft --set fill.count=3 --frames 2";
    desk.line(&format!("bake {around} -o around.glb -q")).ok();
    std::fs::remove_file(desk.path("kit/brick/geo.usda")).unwrap();
    desk.line("render pile.usda -o gone.png")
        .fails(65, &["it takes kit/brick/geo.usda by reference, which is not there"]);
    desk.line("verify pile.usda").fails(65, &["its file kit/brick/geo.usda is not here"]);
}

#[test]
fn the_scene_says_how_a_stage_is_laid_out() {
    let desk = Desk::new();
    published(&desk);
    let staged = "--set usd.up_axis=z --set usd.meters_per_unit=0.01 --set usd.start_frame=1001 \
                  --set usd.samples_per_frame=2 --set usd.default_prim=bricks --set usd.kind=group \
                  --set usd.purpose=render --set usd.asset_folder=/show/assets";
    desk.line(&format!("bake {BRICKS} {staged} -o pile.usda -q")).ok();
    let text = String::from_utf8(bytes(&desk, "pile.usda")).unwrap();
    for words in [
        "upAxis = \"Z\"",
        "metersPerUnit = 0.01",
        "startTimeCode = 1001",
        "endTimeCode = 1003",
        "framesPerSecond = 12",
        "def Xform \"bricks\"",
        "kind = \"group\"",
        "purpose = \"render\"",
        "references = @/show/assets/kit/brick/brick.usda@",
    ] {
        assert!(text.contains(words), "{words}");
    }
    assert!(!text.contains("xformOp:transform"), "the asset is in the stage's own units and axes");
    // The layout changes the result alone: the pile comes from the cache.
    for (set, words) in [("usd.start_frame=1001", "bodies"), ("usd.embed=true", "this pile was baked before")] {
        let mut again = desk.command(&["bake", "--cache", "cache", "--set", set, "-o", "copy.usda"]);
        let done = again.env_remove("CAIRN_NO_CACHE").args(BRICKS.split_whitespace()).output().unwrap();
        assert!(String::from_utf8_lossy(&done.stderr).contains(words), "{set}: {done:?}");
    }
    assert!(String::from_utf8(bytes(&desk, "copy.usda")).unwrap().contains("faceVertexCounts"));
    for (set, words) in [
        ("usd.default_prim=a/b", "\"a/b\" is no name of a prim"),
        ("usd.meters_per_unit=0", "usd.meters_per_unit: 0 is out of range"),
        ("usd.samples_per_frame=0", "usd.samples_per_frame: 0 is out of range"),
        ("usd.asset_folder=a@b", "usd.asset_folder: it cannot stand in an asset path"),
        ("usd.up_axis=x", "usd.up_axis"),
    ] {
        let done = desk.line(&format!("bake {BRICKS} --set {set} -o wrong.usda"));
        assert!(done.code != 0 && done.stderr.contains(words), "{set}: {}", done.stderr);
    }
}

/// What a command line lacks is said with its usage.
#[test]
fn wrong_command_lines_show_the_usage() {
    let desk = Desk::new();
    for (line, usage) in [
        ("bake -o pile.glb", "Usage: cairn bake [OPTIONS] --output <FILE> [SCENE]"),
        ("bake --control cone.glb --prop stick.glb -o pile.xyz", "Usage: cairn bake "),
        ("batch --seeds 1..2 -o {seed}.glb", "Usage: cairn batch "),
        ("bakes list --nonsense", "Usage: cairn bakes list "),
    ] {
        desk.line(line).fails(2, &[usage]);
    }
    let done = desk.line("bake -o pile.glb --progress json");
    assert!(done.code == 2 && done.stderr.lines().all(|line| line.starts_with('{')), "{}", done.stderr);
}

#[test]
fn files_of_usd_that_cannot_be_used_say_why() {
    let desk = Desk::new();
    published(&desk);
    let check = |prop: &str| desk.line(&format!("check --control cone.glb --prop {prop}"));
    for (prop, words) in [
        ("kit/lost.usda", "it takes gone.usda by reference, which is not there"),
        ("kit/odd.usda", "it takes brick/geo.usda by reference, which has no prim /wall"),
        ("kit/brick/brick.usda#/wall", "it has no prim /wall; its top prims: /brick"),
        ("kit/brick/brick.usda#brick", "it has no prim brick; its top prims: /brick"),
        ("kit/cages.usda#/brick/cube", "its prim /brick/cube shows no meshes"),
    ] {
        check(prop).fails(65, &[words]);
    }
    let done = check("kit/cages.usda");
    for words in [
        "its subdivision is not applied: the pile is made of the cages (/brick/body)",
        "its materials other than UsdPreviewSurface are left out of copies and of pictures (/brick/other)",
        "it has shapes that are no meshes, which are left out: save them as meshes (/brick/cube)",
        "its skeleton is left out: meshes have their rest pose (/brick/doll)",
    ] {
        assert!(done.stderr.contains(words) || done.stdout.contains(words), "{words}: {}{}", done.stdout, done.stderr);
    }
    desk.write("text.usd", "no stage");
    check("text.usd").fails(65, &["text.usd: it is damaged, or no USD"]);
    // Few lines that make a hundred million prims.
    let mut bomb = "#usda 1.0\n(\n    defaultPrim = \"A0\"\n)\n".to_owned();
    for level in 0..8 {
        let child = |i| format!("def Xform \"c{i}\" (\n    references = </A{}>\n)\n{{\n}}\n", level + 1);
        bomb += &format!("def Xform \"A{level}\"\n{{\n{}}}\n", (0..10).map(child).collect::<String>());
    }
    desk.write("bomb.usda", bomb + "def Xform \"A8\"\n{\n}\n");
    check("bomb.usda")
        .fails(65, &["its references multiply to more than 50", "parts of few bytes: it is not composed"]);
    // Layers that name each other without an end.
    let header = "#usda 1.0\n(\n    subLayers = [@./";
    for number in 0..70 {
        desk.write(&format!("chain{number}.usda"), format!("{header}chain{}.usda@]\n)\n", number + 1));
    }
    check("chain0.usda").fails(65, &["its files name each other more than 64 times in a row"]);
}
