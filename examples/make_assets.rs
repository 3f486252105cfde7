//! Writes the example props and control meshes: `cargo run --release --example make_assets [FOLDER]`.
//!
//! Metres, Y up, base at y = 0, centred above the origin. Every mesh is closed and faces outward.

use serde_json::{Map, Value, json};
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

type Point = [f64; 3];

fn main() -> std::io::Result<()> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/assets");
    let folder = std::env::args_os().nth(1).map_or(default, PathBuf::from);
    std::fs::create_dir_all(&folder)?;
    let assets = [
        ("stick", stick()),
        ("book", book()),
        ("banana", banana()),
        ("cube", cube()),
        ("card", card()),
        ("ball", ball(0.5)),
        ("cart", cart()),
        // Control meshes for sticks: at a packing of 0.4, a cubic metre holds 40 of them.
        ("cone", revolved(&[[1.723, 0.0], [0.0, 1.723 * 2.8]])),
        ("cone-small", revolved(&[[1.132, 0.0], [0.0, 1.132 * 2.8]])),
        ("cylinder", revolved(&[[0.85, 0.0], [0.85, 0.85 * 2.5], [0.0, 0.85 * 2.5]])),
        ("dome", dome(1.53, 1.53)),
        ("letter-t", letter_t(1.2)),
        // For bananas and books.
        ("mound", dome(0.4, 0.3)),
        ("spiral", spiral(0.25, 0.9, [0.25, 2.2])),
        ("heap", heap([0.55, 0.33], CART_RIM, 0.37)),
    ];
    for (name, asset) in assets {
        std::fs::write(folder.join(name).with_extension("glb"), asset.to_glb(name))?;
    }
    Ok(())
}

/// Materials: name, linear base colour, roughness.
const MATERIALS: [(&str, Point, f64); 11] = [
    ("wood", [1.0, 1.0, 1.0], 0.7),
    ("cover", [0.12, 0.03, 0.04], 0.6),
    ("paper", [0.80, 0.74, 0.60], 0.9),
    ("banana", [0.86, 0.58, 0.06], 0.5),
    ("tip", [0.11, 0.07, 0.03], 0.8),
    ("red", [0.55, 0.07, 0.05], 0.5),
    ("control", [0.70, 0.74, 0.78], 0.8),
    ("face", [0.88, 0.86, 0.80], 0.4),
    ("back", [0.06, 0.12, 0.40], 0.4),
    ("steel", [0.16, 0.17, 0.19], 0.35),
    ("plank", [0.36, 0.20, 0.09], 0.7),
];

/// 1 m long and 0.1 m thick, with a wood grain along it.
fn stick() -> Asset {
    let mut asset = Asset { texture: Some(wood_grain()), ..Asset::default() };
    asset.cuboid([-0.5, 0.0, -0.05], [0.5, 0.1, 0.05], "wood");
    asset
}

fn cube() -> Asset {
    let mut asset = Asset::default();
    asset.cuboid([-0.1, 0.0, -0.1], [0.1, 0.2, 0.1], "red");
    asset
}

/// A playing card, upright: 63 x 88 mm and a hundredth as thick, its face to the front and its back to the back.
fn card() -> Asset {
    let [side, height, thick] = [0.0315, 0.088, 0.00088 / 2.0];
    let corner = |i: usize| {
        let pick = |bit: usize, low: f64, high: f64| if i >> bit & 1 == 1 { high } else { low };
        [pick(0, -side, side), pick(1, 0.0, height), pick(2, -thick, thick)]
    };
    let mut asset = Asset::default();
    let sides: [([usize; 4], &'static str); 6] = [
        ([4, 5, 7, 6], "face"),
        ([0, 2, 3, 1], "back"),
        ([0, 4, 6, 2], "face"),
        ([1, 3, 7, 5], "face"),
        ([0, 1, 5, 4], "face"),
        ([2, 6, 7, 3], "face"),
    ];
    for (side, material) in sides {
        asset.flat(&side.map(corner), &[[0, 1, 2], [0, 2, 3]], material);
    }
    asset
}

/// A ball on the ground.
fn ball(radius: f64) -> Asset {
    const STEPS: usize = 16;
    let profile: Vec<[f64; 2]> = (0..=STEPS)
        .map(|i| {
            let (sin, cos) = (PI * (i as f64 / STEPS as f64 - 0.5)).sin_cos();
            let out = if i == 0 || i == STEPS { 0.0 } else { radius * cos };
            [out, radius + radius * sin]
        })
        .collect();
    turned(&profile, "steel")
}

/// Height of the cart's rim, m.
const CART_RIM: f64 = 0.7;

/// A box of planks on four wheels, 1.1 x 0.66 m inside.
fn cart() -> Asset {
    let [half_x, half_z, wall, floor] = [0.55, 0.33, 0.03, 0.28];
    let (out_x, out_z) = (half_x + wall, half_z + wall);
    let mut asset = Asset::default();
    asset.cuboid([-out_x, floor - wall, -out_z], [out_x, floor, out_z], "plank");
    asset.cuboid([-out_x, floor, -out_z], [out_x, CART_RIM, -half_z], "plank");
    asset.cuboid([-out_x, floor, half_z], [out_x, CART_RIM, out_z], "plank");
    asset.cuboid([-out_x, floor, -half_z], [-half_x, CART_RIM, half_z], "plank");
    asset.cuboid([half_x, floor, -half_z], [out_x, CART_RIM, half_z], "plank");
    let (radius, gap) = (0.17, 0.02);
    for (x, z) in [(-0.35, -1.0), (0.35, -1.0), (-0.35, 1.0), (0.35, 1.0)] {
        let near = out_z + gap;
        asset.disc([x, radius, z * near], radius, z * 0.05, "steel");
    }
    for x in [-0.35, 0.35] {
        asset.cuboid([x - 0.025, radius - 0.025, -out_z - gap], [x + 0.025, radius + 0.025, out_z + gap], "steel");
        asset.cuboid([x - 0.06, radius + 0.025, -0.28], [x + 0.06, floor - wall, 0.28], "plank");
    }
    asset
}

/// A heap on a rectangle of these half edges at height `base`: nearly upright at the sides and round above.
fn heap([half_x, half_z]: [f64; 2], base: f64, height: f64) -> Asset {
    const RINGS: usize = 12;
    const SIDES: usize = 48;
    // A rectangle with round corners, shrinking upward as a superellipse does.
    let at = |ring: usize, k: usize| -> Point {
        let up = ring as f64 / RINGS as f64;
        let out = (1.0 - up.powf(2.5)).powf(1.0 / 2.5);
        let (sin, cos) = (TAU * (k % SIDES) as f64 / SIDES as f64).sin_cos();
        let square = |v: f64| v.signum() * v.abs().powf(0.5);
        [out * half_x * square(cos), base + up * height, -out * half_z * square(sin)]
    };
    let mut asset = Asset::default();
    for k in 0..SIDES {
        asset.flat(&[[0.0, base, 0.0], at(0, k + 1), at(0, k)], &[[0, 1, 2]], "control");
        for ring in 0..RINGS {
            let top = ring + 1 == RINGS;
            let corners = [at(ring, k), at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k)];
            if top {
                let peak = [corners[0], corners[1], [0.0, base + height, 0.0]];
                asset.flat(&peak, &[[0, 1, 2]], "control");
            } else {
                asset.flat(&corners, &[[0, 1, 2], [0, 2, 3]], "control");
            }
        }
    }
    asset
}

/// A ramp that winds once around the axis between two radii, rising from one height to another, with upright sides.
fn spiral(inner: f64, outer: f64, [low, high]: [f64; 2]) -> Asset {
    const SIDES: usize = 72;
    // Open by a wedge, so that its beginning and its end do not touch.
    const WEDGE: f64 = 0.05;
    let at = |k: usize, radius: f64, top: bool| -> Point {
        let share = k as f64 / SIDES as f64;
        let (sin, cos) = (TAU * (1.0 - WEDGE) * share).sin_cos();
        [radius * cos, if top { low + (high - low) * share } else { 0.0 }, -radius * sin]
    };
    let mut asset = Asset::default();
    for k in 0..SIDES {
        let corner = |next: usize, radius: f64, top: bool| at(k + next, radius, top);
        let [a, b, c, d] =
            [corner(0, inner, true), corner(0, outer, true), corner(1, outer, true), corner(1, inner, true)];
        let [e, f, g, h] =
            [corner(0, inner, false), corner(0, outer, false), corner(1, outer, false), corner(1, inner, false)];
        for side in [[a, b, c, d], [e, h, g, f], [f, g, c, b], [e, a, d, h]] {
            asset.flat(&[side[0], side[1], side[2]], &[[0, 1, 2]], "control");
            asset.flat(&[side[0], side[2], side[3]], &[[0, 1, 2]], "control");
        }
    }
    let end = |k: usize| [at(k, inner, false), at(k, outer, false), at(k, outer, true), at(k, inner, true)];
    asset.flat(&end(0), &[[0, 1, 2], [0, 2, 3]], "control");
    let [a, b, c, d] = end(SIDES);
    asset.flat(&[a, d, c, b], &[[0, 1, 2], [0, 2, 3]], "control");
    asset
}

/// A hard cover, open at three sides, around a block of pages.
fn book() -> Asset {
    let [side, height, depth] = [0.08, 0.04, 0.24];
    let (board, inset) = (0.004, 0.005);
    let top = height - board;
    let (spine, edge) = (board - side, side - inset);
    let profile = [
        [-side, 0.],
        [side, 0.],
        [side, board],
        [spine, board],
        [spine, top],
        [side, top],
        [side, height],
        [-side, height],
    ];
    let caps = [[0, 1, 2], [0, 2, 3], [0, 3, 7], [3, 4, 7], [4, 5, 6], [4, 6, 7]];
    let mut asset = Asset::default();
    asset.extrusion(&profile, &caps, depth, "cover");
    asset.cuboid([spine, board, inset - depth / 2.0], [edge, top, depth / 2.0 - inset], "paper");
    asset
}

/// A bent, tapered tube with five soft edges and dark ends.
fn banana() -> Asset {
    const RINGS: usize = 25;
    const SIDES: usize = 15;
    let bend = 0.13;
    let mut points: Vec<Point> = Vec::new();
    for i in 0..RINGS {
        let along = i as f64 / (RINGS - 1) as f64;
        let (sin, cos) = (PI * (1.2 + 0.6 * along)).sin_cos();
        let body = (PI * (0.04 + 0.93 * along)).sin().powf(0.45);
        let stalk = if along > 0.85 { 1.0 - 3.5 * (along - 0.85) } else { 1.0 };
        for k in 0..SIDES {
            let turn = TAU * k as f64 / SIDES as f64;
            let radius = 0.019 * body * stalk * (1.0 + 0.06 * (5.0 * turn).cos());
            let out = bend + radius * turn.cos();
            points.push([out * cos, out * sin, -radius * turn.sin()]);
        }
    }
    let last = (RINGS - 1) * SIDES;
    points.extend([mean(&points[..SIDES]), mean(&points[last..])]);
    let lowest = points.iter().fold(f64::INFINITY, |low, p| low.min(p[1]));
    points.iter_mut().for_each(|p| p[1] -= lowest);
    let (mut skin, mut tips) = (Vec::new(), Vec::new());
    for k in 0..SIDES {
        let next = (k + 1) % SIDES;
        for i in 0..RINGS - 1 {
            let [a, b] = [i * SIDES + k, i * SIDES + next];
            let faces = if i == 0 || i + 3 > RINGS - 1 { &mut tips } else { &mut skin };
            faces.extend([[a, b + SIDES, a + SIDES], [a, b, b + SIDES]]);
        }
        tips.extend([[next, k, points.len() - 2], [last + k, last + next, points.len() - 1]]);
    }
    let mut asset = Asset::default();
    asset.smooth(&points, &[("banana", skin), ("tip", tips)]);
    asset
}

/// Half a ball, or half of one that is pressed flat.
fn dome(radius: f64, height: f64) -> Asset {
    const STEPS: usize = 12;
    let profile: Vec<[f64; 2]> = (0..=STEPS)
        .map(|i| {
            let (sin, cos) = (PI / 2.0 * i as f64 / STEPS as f64).sin_cos();
            if i == STEPS { [0.0, height] } else { [radius * cos, height * sin] }
        })
        .collect();
    revolved(&profile)
}

/// Arms and stem of thickness `u`: 3 u wide and high.
fn letter_t(u: f64) -> Asset {
    let (half, arm) = (u / 2.0, 1.5 * u);
    let (low, high) = (2.0 * u, 3.0 * u);
    let profile =
        [[-half, 0.], [half, 0.], [half, low], [arm, low], [arm, high], [-arm, high], [-arm, low], [-half, low]];
    let caps = [[0, 1, 2], [0, 2, 7], [2, 3, 4], [2, 4, 5], [2, 5, 7], [7, 5, 6]];
    let mut asset = Asset::default();
    asset.extrusion(&profile, &caps, u, "control");
    asset
}

/// A profile of (radius, height) from the base's rim up to a point on the axis, turned around it, with a flat base.
fn revolved(profile: &[[f64; 2]]) -> Asset {
    turned(&[&[[0.0, profile[0][1]]], profile].concat(), "control")
}

/// A profile of (radius, height) from one point on the axis up to another, turned around it.
fn turned(profile: &[[f64; 2]], material: &'static str) -> Asset {
    const SIDES: usize = 48;
    let mut asset = Asset::default();
    let at = |[r, y]: [f64; 2], k: usize| {
        let (sin, cos) = (TAU * (k % SIDES) as f64 / SIDES as f64).sin_cos();
        [r * cos, y, -r * sin]
    };
    for k in 0..SIDES {
        for pair in profile.windows(2) {
            let (low, high) = (pair[0], pair[1]);
            if low[0] == 0.0 {
                asset.flat(&[[0.0, low[1], 0.0], at(high, k + 1), at(high, k)], &[[0, 1, 2]], material);
                continue;
            }
            let corners = [at(low, k), at(low, k + 1), at(high, k + 1), at(high, k)];
            let faces: &[[usize; 3]] = if high[0] == 0.0 { &[[0, 1, 2]] } else { &[[0, 1, 2], [0, 2, 3]] };
            asset.flat(&corners[..faces.len() + 2], faces, material);
        }
    }
    asset
}

/// Vertices, and triangles by material.
#[derive(Default)]
struct Asset {
    points: Vec<Point>,
    normals: Vec<Point>,
    faces: Vec<(&'static str, Vec<[usize; 3]>)>,
    /// A PNG for the first material, laid along x.
    texture: Option<Vec<u8>>,
}

impl Asset {
    fn add(&mut self, material: &'static str, faces: impl Iterator<Item = [usize; 3]>) {
        match self.faces.iter_mut().find(|(name, _)| *name == material) {
            Some((_, known)) => known.extend(faces),
            None => self.faces.push((material, faces.collect())),
        }
    }

    /// A plane piece of surface with vertices of its own.
    fn flat(&mut self, corners: &[Point], faces: &[[usize; 3]], material: &'static str) {
        let base = self.points.len();
        let normal = unit(area(faces[0].map(|i| corners[i])));
        self.points.extend(corners);
        self.normals.extend(corners.iter().map(|_| normal));
        self.add(material, faces.iter().map(|f| f.map(|i| base + i)));
    }

    /// A surface without edges.
    fn smooth(&mut self, points: &[Point], parts: &[(&'static str, Vec<[usize; 3]>)]) {
        let base = self.points.len();
        let mut normals = vec![[0.0; 3]; points.len()];
        for face in parts.iter().flat_map(|(_, faces)| faces) {
            let area = area(face.map(|i| points[i]));
            face.iter().for_each(|&i| normals[i] = sum(normals[i], area));
        }
        self.points.extend(points);
        self.normals.extend(normals.into_iter().map(unit));
        for (material, faces) in parts {
            self.add(material, faces.iter().map(|f| f.map(|i| base + i)));
        }
    }

    fn cuboid(&mut self, low: Point, high: Point, material: &'static str) {
        let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
        for side in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            self.flat(&side.map(corner), &[[0, 1, 2], [0, 2, 3]], material);
        }
    }

    /// A wheel: a disc square to z, between `center` and `depth` beyond it along z.
    fn disc(&mut self, [x, y, z]: Point, radius: f64, depth: f64, material: &'static str) {
        const SIDES: usize = 24;
        let (back, front) = (z.min(z + depth), z.max(z + depth));
        let at = |k: usize, z: f64| {
            let (sin, cos) = (TAU * (k % SIDES) as f64 / SIDES as f64).sin_cos();
            [x + radius * cos, y + radius * sin, z]
        };
        for k in 0..SIDES {
            let corners = [at(k, back), at(k + 1, back), at(k + 1, front), at(k, front)];
            self.flat(&corners, &[[0, 1, 2], [0, 2, 3]], material);
            self.flat(&[[x, y, front], at(k, front), at(k + 1, front)], &[[0, 1, 2]], material);
            self.flat(&[[x, y, back], at(k + 1, back), at(k, back)], &[[0, 1, 2]], material);
        }
    }

    /// A profile in x and y, counter-clockwise and cut into `caps`, stretched along z.
    fn extrusion(&mut self, profile: &[[f64; 2]], caps: &[[usize; 3]], depth: f64, material: &'static str) {
        let at = |i: usize, z: f64| [profile[i % profile.len()][0], profile[i % profile.len()][1], z];
        let (back, front) = (-depth / 2.0, depth / 2.0);
        for i in 0..profile.len() {
            let corners = [at(i, back), at(i + 1, back), at(i + 1, front), at(i, front)];
            self.flat(&corners, &[[0, 1, 2], [0, 2, 3]], material);
        }
        let cap = |z: f64| -> Vec<Point> { (0..profile.len()).map(|i| at(i, z)).collect() };
        self.flat(&cap(front), caps, material);
        let turned: Vec<[usize; 3]> = caps.iter().map(|&[a, b, c]| [a, c, b]).collect();
        self.flat(&cap(back), &turned, material);
    }

    fn to_glb(&self, name: &str) -> Vec<u8> {
        let mut file = File::default();
        let mut attributes = json!({
            "POSITION": file.vectors(&self.points),
            "NORMAL": file.vectors(&self.normals),
        });
        if self.texture.is_some() {
            // Along the grain once; each side shows its own strip.
            let coordinates: Vec<[f64; 2]> = (self.points.iter().zip(&self.normals))
                .map(|(p, n)| [p[0] + 0.5, (p[1] + p[2]) * 2.5 + 0.3 * n[1]])
                .collect();
            attributes["TEXCOORD_0"] = json!(file.vectors(&coordinates));
        }
        let mut primitives = Vec::new();
        for (material, (_, faces)) in self.faces.iter().enumerate() {
            let indices = file.indices(faces);
            primitives.push(json!({ "attributes": attributes, "indices": indices, "material": material }));
        }
        let mut materials: Vec<Value> = self.faces.iter().map(|(name, _)| material(name)).collect();
        let mut root = json!({
            "asset": { "version": "2.0", "generator": "cairn examples" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "name": name, "mesh": 0 }],
            "meshes": [{ "name": name, "primitives": primitives }],
        });
        if let Some(png) = &self.texture {
            materials[0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
            root["textures"] = json!([{ "source": 0 }]);
            root["images"] = json!([{ "bufferView": file.view(png, Map::new()), "mimeType": "image/png" }]);
        }
        root["materials"] = json!(materials);
        file.finish(root)
    }
}

/// Buffer, views and accessors of a file.
#[derive(Default)]
struct File {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl File {
    fn view(&mut self, bytes: &[u8], mut view: Map<String, Value>) -> usize {
        view.insert("buffer".into(), json!(0));
        view.insert("byteOffset".into(), json!(self.bin.len()));
        view.insert("byteLength".into(), json!(bytes.len()));
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.push(Value::Object(view));
        self.views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], target: u32, mut accessor: Value) -> usize {
        let view = self.view(bytes, Map::from_iter([("target".to_string(), json!(target))]));
        accessor["bufferView"] = json!(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn vectors<const N: usize>(&mut self, vectors: &[[f64; N]]) -> usize {
        let single: Vec<[f32; N]> = vectors.iter().map(|v| v.map(|x| x as f32)).collect();
        let bytes: Vec<u8> = single.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let extreme = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..N).map(|axis| single.iter().map(|v| v[axis]).reduce(pick).unwrap_or(0.0)).collect()
        };
        let accessor = json!({
            "componentType": 5126, "type": format!("VEC{N}"), "count": single.len(),
            "min": extreme(f32::min), "max": extreme(f32::max),
        });
        self.accessor(&bytes, 34962, accessor)
    }

    fn indices(&mut self, faces: &[[usize; 3]]) -> usize {
        let bytes: Vec<u8> = faces.iter().flatten().flat_map(|&i| (i as u16).to_le_bytes()).collect();
        let accessor = json!({ "componentType": 5123, "type": "SCALAR", "count": 3 * faces.len() });
        self.accessor(&bytes, 34963, accessor)
    }

    fn finish(self, mut root: Value) -> Vec<u8> {
        root["accessors"] = json!(self.accessors);
        root["bufferViews"] = json!(self.views);
        root["buffers"] = json!([{ "byteLength": self.bin.len() }]);
        let mut json = root.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let word = |n: usize| (n as u32).to_le_bytes();
        let total = 28 + json.len() + self.bin.len();
        let head = [*b"glTF", word(2), word(total), word(json.len()), *b"JSON"].concat();
        [&head, &json[..], &word(self.bin.len()), b"BIN\0", &self.bin].concat()
    }
}

fn material(name: &str) -> Value {
    let known = MATERIALS.iter().find(|(known, ..)| *known == name).expect("a material of the table");
    let &(_, [r, g, b], roughness) = known;
    json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": roughness,
        },
    })
}

/// Long wavy fibres, light and dark.
fn wood_grain() -> Vec<u8> {
    const SIZE: [u32; 2] = [128, 64];
    let picture = image::RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let (u, v) = (TAU * f64::from(x) / f64::from(SIZE[0]), TAU * f64::from(y) / f64::from(SIZE[1]));
        let wave = v + 0.25 * u.sin() + 0.1 * (2.0 * u + 1.0).sin();
        let fibre = 0.5 + 0.3 * (3.0 * wave).sin() + 0.15 * (11.0 * v + 0.5 * u.cos()).sin() + 0.05 * (23.0 * v).sin();
        let blend = |dark: f64, light: f64| (dark + (light - dark) * fibre.clamp(0.0, 1.0)) as u8;
        image::Rgb([blend(138.0, 205.0), blend(102.0, 168.0), blend(70.0, 128.0)])
    });
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).expect("a picture in memory can be encoded");
    png.into_inner()
}

fn sum(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn mean(points: &[Point]) -> Point {
    points.iter().copied().fold([0.0; 3], sum).map(|x| x / points.len() as f64)
}

fn unit(v: Point) -> Point {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

/// Twice a triangle's area, along its outward normal.
fn area([a, b, c]: [Point; 3]) -> Point {
    let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}
