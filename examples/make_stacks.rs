//! Writes the example scenes whose bodies are placed by hand: `cargo run --release --example make_stacks [FOLDER]`.
//!
//! `cards.toml`: a house of 40 playing cards, then cubes that are dropped on it. `overlap.toml`: crossed layers of
//! sticks, each sunk into the one below. Metres, Y up, the ground at y = 0.

use glam::{DQuat, DVec3};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;
use std::path::{Path, PathBuf};

fn main() -> std::io::Result<()> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    let folder = std::env::args_os().nth(1).map_or(default, PathBuf::from);
    std::fs::write(folder.join("cards.toml"), cards())?;
    std::fs::write(folder.join("overlap.toml"), overlap())
}

const CARDS: &str = "\
# A house of 40 playing cards, and cubes dropped on it from frame 96 on.
#
#   cairn bake examples/cards.toml -o cards.glb
#
# At this friction the house falls by itself (--set control=off). With more of it (--set props.0.friction=0.7
# --set ground_friction=0.7) it stands without control until it is hit. Written by the example make_stacks.

ground_friction = 0.5

[release]
order = \"at_once\"

[output]
frames = 216

[[props]]
path = \"assets/card.glb\"
friction = 0.5
density = 1200

[[props]]
path = \"assets/cube.glb\"
friction = 0.5
";

/// Edges of a card: height, width, thickness.
const CARD: [f64; 3] = [0.088, 0.063, 0.00088];
const STOREYS: usize = 5;
/// Between a pair and the next, beside what geometry asks for.
const GAP: f64 = 0.0002;

/// Five storeys of leaning pairs, with a flat card, its short side across, over each two neighbours.
fn cards() -> String {
    let [height, width, thick] = CARD;
    // Half a flat card is the foot of the pair above it and half of a card's edge, seen from above.
    let lean = (0..50).fold(0.35_f64, |lean, _| ((width / 2.0 - thick * lean.cos() / 2.0) / height).asin());
    let (sin, cos) = lean.sin_cos();
    let pitch = 2.0 * (height * sin + thick * cos) + GAP;
    let storey = height * cos + thick * sin;
    // The prop stands upright with its width along x: turned, it leans along x.
    let upright = DQuat::from_rotation_y(FRAC_PI_2);
    let mut scene = String::from(CARDS);
    let mut base = 0.0;
    for level in 0..STOREYS {
        let pairs = STOREYS - level;
        let first = -(pairs as f64 - 1.0) / 2.0 * pitch;
        for i in 0..pairs {
            let middle = first + i as f64 * pitch;
            // The foot on the right leans to the left, and the other way round.
            for side in [1.0, -1.0] {
                let turn = DQuat::from_rotation_z(side * lean);
                let center = DVec3::new(middle + side * (height * sin + thick * cos) / 2.0, base + storey / 2.0, 0.0);
                body(&mut scene, "card", center - turn * DVec3::Y * (height / 2.0), turn * upright);
            }
        }
        base += storey;
        let flat = DQuat::from_rotation_x(FRAC_PI_2);
        for i in 1..pairs {
            let middle = first + (i as f64 - 0.5) * pitch;
            let center = DVec3::new(middle, base + thick / 2.0, 0.0);
            body(&mut scene, "card", center - flat * DVec3::Y * (height / 2.0), flat);
        }
        base += thick;
    }
    for (k, x) in [0.03, -0.08, 0.1].into_iter().enumerate() {
        body(&mut scene, "cube", DVec3::new(x, base + 0.15, 0.004), DQuat::from_rotation_z(0.3 + k as f64));
        write!(scene, "scale = 0.2\nstart_frame = {}\n", 96 + 24 * k).expect("a text takes all");
    }
    scene
}

const OVERLAP: &str = "\
# A stack built by hand: crossed layers of sticks, each sunk into the one below by 5 to 25 % of its
# thickness. It settles without a jump.
#
#   cairn bake examples/overlap.toml -o overlap.glb
#
# Written by the example make_stacks.

[release]
order = \"at_once\"

[hold]
least_seconds = 3

[[props]]
path = \"assets/stick.glb\"
";

/// Eight layers of three sticks.
fn overlap() -> String {
    const THICK: f64 = 0.1;
    let mut scene = String::from(OVERLAP);
    let mut base = 0.0;
    for layer in 0..8 {
        let turn = DQuat::from_rotation_y(if layer % 2 == 0 { 0.0 } else { FRAC_PI_2 });
        for place in [-0.4, 0.0, 0.4] {
            body(&mut scene, "stick", turn * DVec3::Z * place + DVec3::Y * base, turn);
        }
        // 5 % between the lowest two layers, and more of it upward.
        base += THICK * (0.95 - 0.2 * f64::from(layer) / 6.0);
    }
    scene
}

fn body(scene: &mut String, prop: &str, position: DVec3, rotation: DQuat) {
    let [x, y, z] = position.to_array();
    let [a, b, c, d] = rotation.to_array();
    write!(
        scene,
        "\n[[bodies]]\nprop = \"{prop}\"\nposition = [{x:.6}, {y:.6}, {z:.6}]\nrotation = [{a:.8}, {b:.8}, {c:.8}, \
         {d:.8}]\n"
    )
    .expect("a text takes all");
}
