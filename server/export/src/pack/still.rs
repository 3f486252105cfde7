//! The pile at rest: merged meshes in levels of detail, convex hulls of its outside, and instances.

use super::file::{GltfFile, Looks};
use super::outside;
use super::pile::PackedPile;
use super::surface::Surfaces;
use super::{Level, PackError, PackedFile, PileBounds};
use cairn_engine::shape::outer_hulls;
use cairn_geometry::mesh::TriMesh;
use cairn_gltf::INSTANCING;
use cairn_gltf::document::Object;
use cairn_render::{RenderModel, silhouette_difference};
use glam::{DQuat, DVec3};
use serde_json::json;

/// The picture in which the first level may not be seen to differ.
const PICTURE: [u32; 2] = [1920, 1080];
/// The error of the first level, in picture elements, when the pile fills the picture; each further level has
/// [`COARSER`] times that of the one before.
const FIRST_ERROR_PX: f64 = 0.5;
const COARSER: f64 = 4.0;
/// How often the error of the first level is halved until its silhouette is right.
const HALVINGS: u32 = 4;
/// From where silhouettes are compared: azimuth and elevation, degrees. No axis among them.
const VIEWS: [(f64, f64); 3] = [(17.0, 12.0), (139.0, 34.0), (262.0, 5.0)];
/// Between the points of a triangle that are tried for whether anybody sees them, in the same.
const SPACING_PX: f64 = 6.0;
/// Convex hulls of the outside, at most.
const MOST_HULLS: u32 = 24;

/// The levels, the finest first; each less dense than the one before it.
pub fn levels(
    pile: &PackedPile,
    source: &RenderModel,
    looks: &Looks,
    (count, is_compressed): (u32, bool),
) -> Result<Vec<(PackedFile, Level)>, PackError> {
    let pixel = pixel(pile);
    let mut found: Vec<(PackedFile, Level)> = Vec::new();
    let (mut first, mut spacing, mut before) = (FIRST_ERROR_PX, SPACING_PX, usize::MAX);
    for number in 0..count {
        let name = format!("static.lod{}.glb", found.len());
        let kept = loop {
            let error_px = first * COARSER.powi(number as i32);
            let all = at_rest(pile, error_px * pixel);
            if all.triangles() > before / 10 * 9 {
                // A coarser error does not help: props of a few triangles have none to lose.
                break None;
            }
            before = all.triangles();
            let (surfaces, mut level) = merged(pile, all, spacing * pixel);
            level.error_px = error_px;
            let bytes = mesh_file(&format!("pile_LOD{}", found.len()), &surfaces, looks, is_compressed)?;
            if number > 0 {
                break Some((bytes, level));
            }
            let model = RenderModel { name: &name, bytes: &bytes, resolve: source.resolve };
            let difference = silhouette_difference(source, &model, PICTURE, &VIEWS)?;
            level.silhouette = Some(difference);
            if difference.farthest_px <= 1 || first <= FIRST_ERROR_PX / f64::from(1 << HALVINGS) {
                break Some((bytes, level));
            }
            (first, spacing, before) = (first / 2.0, spacing / 2.0, usize::MAX);
        };
        let Some((bytes, level)) = kept else { continue };
        let mut file = PackedFile::new(&name, "static mesh", bytes);
        (file.triangles, file.vertices, file.draws) = (level.triangles, level.vertices, level.draws);
        found.push((file, level));
    }
    Ok(found)
}

/// The size of a picture element when the pile fills the height or the width of the picture, in the pile's unit.
fn pixel(pile: &PackedPile) -> f64 {
    let PileBounds { low, high } = bounds(pile);
    let [width, height] = PICTURE.map(f64::from);
    let [x, y, z] = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    (y / height).max(x.min(z) / width)
}

/// The box around the pile at rest.
pub fn bounds(pile: &PackedPile) -> PileBounds {
    let mut bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (body, pose) in pile.bodies.iter().zip(pile.rest()) {
        let place = pose.affine();
        for vertex in pile.kinds[body.kind].surfaces.0.values().flat_map(|surface| &surface.vertices) {
            let point = place.transform_point3(DVec3::from(vertex.position.map(f64::from)));
            bounds = (bounds.0.min(point), bounds.1.max(point));
        }
    }
    PileBounds { low: bounds.0.to_array(), high: bounds.1.to_array() }
}

/// All bodies as they rest, within an error, in the pile's unit.
pub fn at_rest(pile: &PackedPile, error: f64) -> Surfaces {
    let light: Vec<Surfaces> = pile.kinds.iter().map(|kind| kind.surfaces.simplified(error / kind.scale)).collect();
    let mut all = Surfaces::default();
    for (number, (body, pose)) in pile.bodies.iter().zip(pile.rest()).enumerate() {
        all.append(&light[body.kind], &pose.affine(), number as u32);
    }
    all
}

/// The error of the first level, in the pile's unit.
pub fn first_error(pile: &PackedPile) -> f64 {
    FIRST_ERROR_PX * pixel(pile)
}

/// What is seen from outside of all bodies at rest; `spacing`: between samples.
fn merged(pile: &PackedPile, mut surfaces: Surfaces, spacing: f64) -> (Surfaces, Level) {
    let all = surfaces.triangles();
    let (points, corners) = surfaces.bare();
    surfaces.retain(&outside::seen(&points, corners.as_chunks().0, spacing));
    let left = surfaces.triangles();
    let level = Level {
        triangles: left,
        vertices: surfaces.vertices(),
        draws: surfaces.0.len(),
        error_px: 0.0,
        hidden_share: 1.0 - left as f64 / all as f64,
        triangle_share: left as f64 / pile.triangles() as f64,
        silhouette: None,
    };
    (surfaces, level)
}

fn mesh_file(name: &str, surfaces: &Surfaces, looks: &Looks, is_compressed: bool) -> Result<Vec<u8>, PackError> {
    let mut file = GltfFile::new(looks, is_compressed);
    let mesh = file.mesh(name, surfaces, &mut |_, _, _| Ok(()))?;
    let node = file.out.push("nodes", json!({ "name": name, "mesh": mesh }));
    let top = file.out.push("nodes", json!({ "name": "pile", "children": [node] }));
    file.finish(&[top])
}

/// Convex hulls of the heap's outside, for what falls or walks on it.
pub fn colliders(pile: &PackedPile) -> Result<PackedFile, PackError> {
    let (points, corners) = at_rest(pile, COARSER * first_error(pile)).bare();
    let mesh = TriMesh {
        points: points.into_iter().map(|p| DVec3::from(p.map(f64::from))).collect(),
        triangles: corners.as_chunks().0.to_vec(),
    };
    let plain = Looks::bare();
    let mut file = GltfFile::new(&plain, false);
    let (mut nodes, mut triangles, mut vertices) = (Vec::new(), 0, 0);
    for (number, hull) in outer_hulls(&mesh, MOST_HULLS).iter().enumerate() {
        let name = format!("pile_collider_{number:02}");
        let surfaces = Surfaces::of(hull);
        (triangles, vertices) = (triangles + surfaces.triangles(), vertices + surfaces.vertices());
        let mesh = file.mesh(&name, &surfaces, &mut |_, _, _| Ok(()))?;
        nodes.push(file.out.push("nodes", json!({ "name": name, "mesh": mesh })));
    }
    let draws = nodes.len();
    let top = file.out.push("nodes", json!({ "name": "pile", "children": nodes }));
    let mut packed = PackedFile::new("colliders.glb", "colliders", file.finish(&[top])?);
    (packed.triangles, packed.vertices, packed.draws) = (triangles, vertices, draws);
    Ok(packed)
}

/// A node for each prop, with an instance for each of its bodies at rest. `_BODY` has the body's number, by which the
/// textures of the motion have its row.
pub fn instances(pile: &PackedPile, looks: &Looks, is_compressed: bool) -> Result<PackedFile, PackError> {
    let mut file = GltfFile::new(looks, is_compressed);
    file.requires(INSTANCING);
    let (mut nodes, mut triangles, mut vertices, mut draws) = (Vec::new(), 0, 0, 0);
    for (number, kind) in pile.kinds.iter().enumerate() {
        if kind.surfaces.triangles() == 0 {
            continue;
        }
        let bodies: Vec<usize> = (0..pile.bodies.len()).filter(|&body| pile.bodies[body].kind == number).collect();
        let mesh = file.mesh(&kind.name, &kind.surfaces, &mut |_, _, _| Ok(()))?;
        let poses = bodies.iter().map(|&body| pile.rest()[body]);
        let places: Vec<[f32; 3]> = poses.clone().map(|pose| pose.translation.as_vec3().to_array()).collect();
        let turn = |rotation: DQuat| rotation.normalize().as_quat().to_array();
        let turns: Vec<[f32; 4]> = poses.clone().map(|pose| turn(pose.rotation)).collect();
        let scales: Vec<[f32; 3]> = poses.map(|pose| [pose.scale as f32; 3]).collect();
        let rows: Vec<[f32; 1]> = bodies.iter().map(|&body| [body as f32]).collect();
        let attributes = Object::from_iter([
            ("TRANSLATION".to_owned(), json!(file.floats(&places, false)?)),
            ("ROTATION".into(), json!(file.floats(&turns, false)?)),
            ("SCALE".into(), json!(file.floats(&scales, false)?)),
            ("_BODY".into(), json!(file.floats(&rows, false)?)),
        ]);
        let node = json!({
            "name": kind.name, "mesh": mesh, "extensions": { INSTANCING: { "attributes": attributes } },
        });
        nodes.push(file.out.push("nodes", node));
        triangles += bodies.len() * kind.surfaces.triangles();
        vertices += kind.surfaces.vertices();
        draws += kind.surfaces.0.len();
    }
    let top = file.out.push("nodes", json!({ "name": "pile", "children": nodes }));
    let mut packed = PackedFile::new("instances.glb", "instances", file.finish(&[top])?);
    (packed.triangles, packed.vertices, packed.draws) = (triangles, vertices, draws);
    Ok(packed)
}
