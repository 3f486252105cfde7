//! Which of several props goes where: in bands, along a gradient or in clusters.

use crate::input::params::{Layout, Mixture as Wanted, SortBy};
use crate::input::scene::Scene;
use crate::prepare::shape::Shape;
use crate::sim::instance;
use glam::DVec3;
use rand::{Rng, RngExt};

/// Bodies in a cluster.
const CLUSTER: usize = 15;
/// A gradient reaches this far beyond a band, as a share of the container's volume.
const BLEND: f64 = 0.35;
/// Heights at which the volume below is known.
const HEIGHTS: usize = 64;

/// Where each prop may go.
pub struct Mixture {
    layout: Layout,
    /// From where to where each prop's band is, as shares of the container's volume from below; shape `[prop]`.
    bands: Vec<[f64; 2]>,
    /// Share of the container's volume below [`HEIGHTS`] heights, even from its base to its top.
    below: Vec<f64>,
    bottom: f64,
    height: f64,
    /// Middles of the clusters, and whose they are.
    clusters: Vec<(DVec3, usize)>,
}

impl Mixture {
    /// `inside`: points spread evenly over the container's inside; `heights`: of its base and its top; `expected`: the bodies that it
    /// takes. `None` where only one prop is drawn.
    pub fn new(
        scene: &Scene,
        shapes: &[Shape],
        wanted: &Wanted,
        inside: &[DVec3],
        [bottom, top]: [f64; 2],
        expected: usize,
        rng: &mut impl Rng,
    ) -> Option<Mixture> {
        let drawn: Vec<usize> = (0..scene.props.len()).filter(|&i| scene.props[i].weight > 0.0).collect();
        if drawn.len() < 2 {
            return None;
        }
        let height = (top - bottom).max(f64::MIN_POSITIVE);
        let mut below = vec![0.0; HEIGHTS];
        for p in inside {
            let at = ((p.y - bottom) / height * HEIGHTS as f64).clamp(0.0, HEIGHTS as f64 - 1.0);
            below[at as usize] += 1.0 / inside.len() as f64;
        }
        let mut sum = 0.0;
        below.iter_mut().for_each(|share| {
            sum += *share;
            *share = sum;
        });
        let mut cluster = || {
            let whose = instance::draw(&scene.props, drawn.iter().copied(), rng).0;
            (inside[rng.random_range(0..inside.len())], whose)
        };
        let clustered = wanted.layout == Layout::Clusters && !inside.is_empty();
        let count = if clustered { expected.div_ceil(CLUSTER) } else { 0 };
        let clusters = (0..count).map(|_| cluster()).collect();
        Some(Mixture {
            layout: wanted.layout,
            bands: bands(scene, shapes, wanted, drawn),
            below,
            bottom,
            height,
            clusters,
        })
    }

    /// Whether this prop may be here.
    pub fn allows(&self, prop: usize, p: DVec3, rng: &mut impl Rng) -> bool {
        if self.layout == Layout::Clusters {
            let near =
                |a: &&(DVec3, usize), b: &&(DVec3, usize)| p.distance_squared(a.0).total_cmp(&p.distance_squared(b.0));
            return self.clusters.iter().min_by(near).is_none_or(|(_, whose)| *whose == prop);
        }
        let at = ((p.y - self.bottom) / self.height * HEIGHTS as f64).clamp(0.0, HEIGHTS as f64 - 1.0);
        let below = self.below[at as usize];
        let [low, high] = self.bands[prop];
        let beyond = (low - below).max(below - high).max(0.0);
        match self.layout {
            Layout::Gradient => beyond < BLEND * rng.random::<f64>(),
            _ => beyond <= 0.5 / HEIGHTS as f64,
        }
    }
}

/// The bands of these props, in the order that is asked for.
fn bands(scene: &Scene, shapes: &[Shape], wanted: &Wanted, mut drawn: Vec<usize>) -> Vec<[f64; 2]> {
    let props = &scene.props;
    let scale = |i: usize| (props[i].scale[0] + props[i].scale[1]) / 2.0;
    drawn.sort_by(|&a, &b| match wanted.sort_by {
        SortBy::Size => (shapes[a].size.diameter * scale(a)).total_cmp(&(shapes[b].size.diameter * scale(b))),
        SortBy::Mass => (shapes[a].mass * scale(a).powi(3)).total_cmp(&(shapes[b].mass * scale(b).powi(3))),
        SortBy::Name => props[a].model.name.cmp(&props[b].model.name),
    });
    if wanted.descending {
        drawn.reverse();
    }
    let volume = |i: usize| props[i].weight * shapes[i].size.hull_volume * scale(i).powi(3);
    let total: f64 = drawn.iter().map(|&i| volume(i)).sum();
    let mut bands = vec![[0.0, 1.0]; props.len()];
    let mut below = 0.0;
    for i in drawn {
        bands[i] = [below, below + volume(i) / total];
        below += volume(i) / total;
    }
    bands
}
