//! What holds a pile: nothing, as few dots as Cairn finds, those that Clarabel finds, as many at random, all that could
//! be, and dots of bounded strength. Each pile is released, awake, for 20 characteristic times.
//!
//!     cargo study glue -- examples/sticks.toml --set fill.count=200 --strength 1,3,10,30

mod piles;

use anyhow::{Context, anyhow};
use cairn_core::glue::{Ends, Watch, release_trial};
use cairn_engine::world::BodyId;
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::measure::{Instances, ShapeMeasurer, kept_shape};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_motion::glue::sites::Sites;
use cairn_motion::instance::Instance;
use cairn_motion::pile::Pile;
use cairn_statics::glue::{self, GlueJoint, GlueOptions, GluePlacement, MOST_ROUNDS, interior_point};
use clap::Parser;
use cpu_time::ProcessTime;
use glam::DVec3;
use rand::SeedableRng;
use rand::seq::index;
use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// What holds a pile: nothing, few dots, as many at random, all of them, and weaker ones.
#[derive(Parser)]
struct Args {
    /// Scene files
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Set a field of each scene, as `cairn bake --set` does
    #[arg(long)]
    set: Vec<String>,
    /// Piles of more bodies than this are not given to Clarabel
    #[arg(long, default_value_t = 800)]
    oracle: usize,
    /// Friction counts by this factor
    #[arg(long, default_value_t = 0.5)]
    factor: f64,
    /// Bounds on a dot's force, in weights of the median prop
    #[arg(long, value_delimiter = ',')]
    strength: Vec<f64>,
}

const NORMAL_PRICE: f64 = 0.02;

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    println!(
        "| scene | glue | bodies | touches | dots | largest force | imbalance | fallen | CPU s | moved | kept, \
         released |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for scene in &args.scenes {
        rows(scene, &args)?;
    }
    Ok(())
}

fn rows(scene: &Path, args: &Args) -> anyhow::Result<()> {
    let full = piles::Full::of(scene, &args.set)?;
    let sim = full.turn_over()?;
    let sites = Sites::new(&sim.pile.world, None, true, &BTreeSet::new());
    let problem = sites.problem(DVec3::NEG_Y);
    let rounds = MOST_ROUNDS;
    let options = |strength| GlueOptions { friction_factor: args.factor, normal_price: NORMAL_PRICE, strength, rounds };
    let control = &full.job.scene.control.as_ref().context("the scene fills no control mesh")?.mesh;
    let ruler = Ruler::new(control, full.job.scene.props.iter().map(|prop| prop.model.mesh.clone()).collect());
    let name = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let print_row = |glue: &str, placed: &GluePlacement, seconds: f64| -> anyhow::Result<()> {
        let loose: Vec<BodyId> = placed
            .fallen
            .iter()
            .map(|&body| sites.assembly.ids[body])
            .chain(sites.unreachable.iter().copied())
            .collect();
        let dots: Vec<_> = placed.joints.iter().map(|j| sites.joint(j.site, j.force, j.moment, 0.0, 1.0)).collect();
        let (world, policy) = (sim.pile.world.clone(), sim.pile.policy.clone());
        let watch = Watch { ends: Ends::Late, most_displacement: 0.0 };
        let freed = release_trial(world, policy, &dots, &loose, DVec3::NEG_Y, watch, &mut |_| Ok(()))?;
        let poses = freed.final_poses().context("it was released to its end")?;
        println!(
            "| {name} | {glue} | {} | {} | {} | {:.1} | {:.1e} | {} | {seconds:.2} | {:.3} | {:.3} |",
            sites.assembly.ids.len(),
            sites.real_with(placed),
            dots.len(),
            dots.iter().map(|dot| dot.force.length()).fold(0.0, f64::max),
            placed.imbalance,
            placed.fallen.len(),
            freed.moved,
            ruler.kept(&sim.pile, &poses).ok_or_else(|| anyhow!("the pile has no shape"))?,
        );
        Ok(())
    };
    let at = |touches: Vec<usize>| {
        let dot = |touch: usize| GlueJoint { site: touch, force: DVec3::ZERO, moment: DVec3::ZERO };
        GluePlacement {
            joints: touches.into_iter().map(dot).collect(),
            imbalance: f64::NAN,
            ..GluePlacement::default()
        }
    };
    let mut going = || ControlFlow::Continue(());
    print_row("none", &at(Vec::new()), 0.0)?;
    let begin = ProcessTime::now();
    let least = glue::place(&problem, &options(None), &mut going)?;
    print_row("as few as Cairn finds", &least, begin.elapsed().as_secs_f64())?;
    if sites.assembly.ids.len() <= args.oracle {
        let begin = ProcessTime::now();
        let placed = interior_point::place(&problem, &options(None), &mut going)?;
        print_row("as few as Clarabel finds", &placed, begin.elapsed().as_secs_f64())?;
    }
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(full.job.params.seed);
    let chance = index::sample(&mut rng, problem.sites.len(), least.joints.len()).into_vec();
    print_row("as many at random", &at(BTreeSet::from_iter(chance).into_iter().collect()), 0.0)?;
    print_row("every touch", &at((0..problem.sites.len()).collect()), 0.0)?;
    for &strength in &args.strength {
        let begin = ProcessTime::now();
        let placed = glue::place(&problem, &options(Some(strength)), &mut going)?;
        print_row(&format!("at most {strength} weights"), &placed, begin.elapsed().as_secs_f64())?;
    }
    Ok(())
}

/// Measures a pile's shape.
struct Ruler {
    control: TriMesh,
    region: MeshInterior,
    props: Vec<TriMesh>,
}

impl Ruler {
    fn new(control: &TriMesh, props: Vec<TriMesh>) -> Ruler {
        Ruler { control: control.clone(), region: MeshInterior::new(control), props }
    }

    /// `kept_shape` of these poses against those of the pile. Engine units; shape `[body]`.
    fn kept(&self, pile: &Pile, poses: &[Option<Pose>]) -> Option<f64> {
        let place = |(b, pose): (&Instance, Pose)| {
            (b.prop, b.scale, pile.shapes[b.prop].prop_pose(&pile.world.units.pose_to_si(&pose), b.scale))
        };
        let begin: Vec<_> = pile.instances.iter().enumerate().map(|(id, b)| place((b, pile.world.pose(id)))).collect();
        let end: Vec<_> = pile.instances.iter().zip(poses).filter_map(|(b, &pose)| Some(place((b, pose?)))).collect();
        let begin = Instances { props: &self.props, bodies: &begin };
        let measurer = ShapeMeasurer::new(&self.control, &self.region, &begin);
        kept_shape(&measurer.measure(&begin), &measurer.shape_iou(&Instances { props: &self.props, bodies: &end }))
    }
}
