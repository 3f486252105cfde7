//! Piles of the same form and any size: the cone of `examples/assets`, scaled until it takes the wanted number of
//! props.

use crate::gltf::gltf;
use anyhow::{Context, anyhow, ensure};
use cairn_files::problem::Problem;
use cairn_geometry::mesh::TriMesh;
use cairn_job::Job;
use cairn_wire::proto;
use cairn_wire::scene_file::SceneTree;
use glam::{DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rapier3d::parry::transformation::convex_hull;
use std::path::{Path, PathBuf};

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Boxes of 1 x 0.1 x 0.1 m.
    Sticks,
    /// Bananas, each of several hulls.
    Bananas,
    /// Twenty different stones.
    Rubble,
}

impl Kind {
    pub const ALL: [Kind; 3] = [Kind::Sticks, Kind::Bananas, Kind::Rubble];

    pub fn name(self) -> &'static str {
        match self {
            Kind::Sticks => "sticks",
            Kind::Bananas => "bananas",
            Kind::Rubble => "rubble",
        }
    }

    /// How many bodies are wanted, from the fewest on.
    pub fn sizes(self) -> &'static [usize] {
        match self {
            Kind::Sticks => &[100, 1_000, 10_000, 100_000],
            _ => &[100, 1_000, 10_000],
        }
    }

    fn props(self, folder: &Path) -> std::io::Result<Vec<proto::Prop>> {
        let prop = |path: PathBuf| proto::Prop { path: path.display().to_string(), ..Default::default() };
        match self {
            Kind::Sticks => Ok(vec![prop(asset("stick.glb"))]),
            Kind::Bananas => Ok(vec![prop(asset("banana.glb"))]),
            Kind::Rubble => stones()
                .iter()
                .enumerate()
                .map(|(number, stone)| {
                    let path = folder.join(format!("stone{number}.gltf"));
                    std::fs::write(&path, gltf(stone))?;
                    Ok(proto::Prop { density: Some(2400.0), friction: Some(0.9), ..prop(path) })
                })
                .collect(),
        }
    }
}

fn asset(name: &str) -> PathBuf {
    Path::new(env!("CAIRN_REPOSITORY")).join("examples/assets").join(name)
}

/// Hulls of random points on ellipsoids, 0.3 to 1.2 m long; always the same.
fn stones() -> Vec<TriMesh> {
    const STONES: usize = 20;
    const POINTS: usize = 24;
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut between = |low: f32, high: f32| low + (high - low) * rng.random::<f32>();
    let mut stone = || {
        let half = between(0.15, 0.6) * Vec3::new(1.0, between(0.5, 1.0), between(0.5, 1.0));
        let mut direction = || loop {
            let point = Vec3::new(between(-1.0, 1.0), between(-1.0, 1.0), between(-1.0, 1.0));
            if (0.1..1.0).contains(&point.length()) {
                return point.normalize();
            }
        };
        let points: Vec<Vec3> = (0..POINTS).map(|_| half * direction()).collect();
        let (points, triangles) = convex_hull(&points);
        TriMesh { points: points.into_iter().map(Vec3::as_dvec3).collect::<Vec<DVec3>>(), triangles }
    };
    (0..STONES).map(|_| stone()).collect()
}

/// Writes a scene for which the plan expects so many bodies into the folder; returns the scene file.
pub fn write(kind: Kind, wanted: f64, accuracy: &str, set: &[String], folder: &Path) -> anyhow::Result<PathBuf> {
    let invalid =
        |problems: Vec<Problem>| anyhow!(problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"));
    std::fs::create_dir_all(folder)?;
    let folder = folder.canonicalize()?;
    let cone = asset("cone.glb").display().to_string();
    let message = proto::Scene {
        control_mesh: Some(proto::ControlMesh { path: cone }),
        props: kind.props(&folder)?,
        ..Default::default()
    };
    let mut tree = SceneTree::from_message(&message);
    // The mesh decides how many there are, not the bound.
    let own = [format!("accuracy={accuracy}"), "fill.max_bodies=100000".to_owned()];
    for assignment in own.iter().chain(set) {
        tree.set(assignment).map_err(invalid)?;
    }
    let job = Job::read(&tree.to_message()).map_err(invalid)?;
    let mut scene = job.scene;
    let control = scene.control.as_ref().context("a cone")?.mesh.clone();
    let mut factor = 1.0;
    /// Each brings the expected number several times nearer.
    const ROUNDS: usize = 8;
    for _ in 0..ROUNDS {
        scene.control.as_mut().context("a cone")?.mesh = control.scaled(factor);
        let expected = cairn_core::plan(&scene, &job.params)?.expected_bodies;
        ensure!(expected > 0, "nothing fits into a cone {factor} times as large");
        factor *= (wanted / expected as f64).cbrt();
    }
    let mesh = folder.join("control.gltf");
    std::fs::write(&mesh, gltf(&control.scaled(factor)))?;
    tree.put("control_mesh", serde_json::json!({ "path": mesh.display().to_string() }));
    let path = folder.join("scene.toml");
    std::fs::write(&path, tree.to_toml())?;
    Ok(path)
}
