//! A mesh with materials, put together from faces.

use crate::file::File;
use crate::vector::{Point, area, sum, unit};
use serde_json::{Map, Value, json};
use std::f64::consts::TAU;

/// Materials: name, linear base colour, roughness.
const MATERIALS: [(&str, Point, f64); 20] = [
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
    ("brick", [0.42, 0.13, 0.07], 0.9),
    ("timber", [0.62, 0.42, 0.22], 0.8),
    ("china", [0.85, 0.86, 0.88], 0.3),
    ("glaze", [0.10, 0.28, 0.40], 0.3),
    ("grass", [0.13, 0.25, 0.07], 0.95),
    ("soil", [0.16, 0.11, 0.07], 0.95),
    ("paint", [0.05, 0.16, 0.30], 0.5),
    ("gold", [0.72, 0.47, 0.12], 0.4),
    ("stone", [0.45, 0.44, 0.42], 0.9),
];

/// Vertices, and triangles by material.
#[derive(Default)]
pub struct Asset {
    points: Vec<Point>,
    normals: Vec<Point>,
    faces: Vec<(&'static str, Vec<[usize; 3]>)>,
    /// A PNG for the first material, laid along x.
    texture: Option<Vec<u8>>,
}

impl Asset {
    pub fn with_texture(png: Vec<u8>) -> Asset {
        Asset { texture: Some(png), ..Asset::default() }
    }

    fn add(&mut self, material: &'static str, faces: impl Iterator<Item = [usize; 3]>) {
        match self.faces.iter_mut().find(|(name, _)| *name == material) {
            Some((_, known)) => known.extend(faces),
            None => self.faces.push((material, faces.collect())),
        }
    }

    /// A plane piece of surface with vertices of its own.
    pub fn flat(&mut self, corners: &[Point], faces: &[[usize; 3]], material: &'static str) {
        let base = self.points.len();
        let normal = unit(area(faces[0].map(|i| corners[i])));
        self.points.extend(corners);
        self.normals.extend(corners.iter().map(|_| normal));
        self.add(material, faces.iter().map(|f| f.map(|i| base + i)));
    }

    /// A surface without edges.
    pub fn smooth(&mut self, points: &[Point], parts: &[(&'static str, Vec<[usize; 3]>)]) {
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

    pub fn cuboid(&mut self, low: Point, high: Point, material: &'static str) {
        let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
        for side in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            self.flat(&side.map(corner), &[[0, 1, 2], [0, 2, 3]], material);
        }
    }

    /// A wheel: a disc square to z, between `center` and `depth` beyond it along z.
    pub fn disc(&mut self, [x, y, z]: Point, radius: f64, depth: f64, material: &'static str) {
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
    pub fn extrusion(&mut self, profile: &[[f64; 2]], caps: &[[usize; 3]], depth: f64, material: &'static str) {
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

    /// Turned about the z axis, radians, and then moved.
    pub fn moved(mut self, turn: f64, by: Point) -> Asset {
        let (sin, cos) = turn.sin_cos();
        let turned = |[x, y, z]: Point| [x * cos - y * sin, x * sin + y * cos, z];
        self.points.iter_mut().for_each(|point| *point = sum(turned(*point), by));
        self.normals.iter_mut().for_each(|normal| *normal = turned(*normal));
        self
    }

    pub fn to_glb(&self, name: &str) -> Vec<u8> {
        let mut file = File::default();
        let mut all = Parts::default();
        self.write(name, &mut file, &mut all);
        let mut root = all.root();
        if let Some(png) = &self.texture {
            all.materials[0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
            root["textures"] = json!([{ "source": 0 }]);
            root["images"] = json!([{ "bufferView": file.view(png, Map::new()), "mimeType": "image/png" }]);
        }
        root["materials"] = json!(all.materials);
        file.finish(root)
    }

    /// Adds its node, mesh and materials.
    fn write(&self, name: &str, file: &mut File, all: &mut Parts) {
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
        for (name, faces) in &self.faces {
            let indices = file.indices(faces);
            primitives.push(json!({ "attributes": attributes, "indices": indices, "material": all.materials.len() }));
            all.materials.push(material(name));
        }
        all.nodes.push(json!({ "name": name, "mesh": all.meshes.len() }));
        all.meshes.push(json!({ "name": name, "primitives": primitives }));
    }
}

/// A file of several things, a node for each.
pub fn to_glb_of(things: &[(String, Asset)]) -> Vec<u8> {
    let (mut file, mut all) = (File::default(), Parts::default());
    things.iter().for_each(|(name, asset)| asset.write(name, &mut file, &mut all));
    let mut root = all.root();
    root["materials"] = json!(all.materials);
    file.finish(root)
}

/// Parts of a file.
#[derive(Default)]
struct Parts {
    nodes: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
}

impl Parts {
    /// The file without its materials.
    fn root(&self) -> Value {
        json!({
            "asset": { "version": "2.0", "generator": "cairn examples" },
            "scene": 0,
            "scenes": [{ "nodes": (0..self.nodes.len()).collect::<Vec<_>>() }],
            "nodes": self.nodes,
            "meshes": self.meshes,
        })
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
