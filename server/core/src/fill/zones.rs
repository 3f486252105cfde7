//! The layout of several props: in bands, along a gradient or in clusters.

use super::filling::FillTask;
use cairn_input::params::{Layout, SortBy};
use cairn_motion::instance;
use glam::DVec3;
use rand::{Rng, RngExt};

/// Bodies in a cluster.
const CLUSTER: usize = 15;
/// A gradient reaches this far beyond a band, as a share of the container's volume.
const BLEND: f64 = 0.35;
/// Heights at which the volume below is known.
const HEIGHTS: usize = 64;

/// The places that each prop may take.
pub struct Zones {
    layout: Layout,
    /// Low and high end of each prop's band, as shares of the container's volume from below; shape `[prop]`.
    bands: Vec<[f64; 2]>,
    /// Share of the container's volume below [`HEIGHTS`] heights, even from its base to its top.
    below: Vec<f64>,
    bottom: f64,
    height: f64,
    /// Centers of the clusters, each with its prop.
    clusters: Vec<(DVec3, usize)>,
}

impl Zones {
    /// `None` if every prop may be everywhere, or only one prop is drawn.
    pub fn new(task: &FillTask, rng: &mut impl Rng) -> Option<Zones> {
        let layout = task.params.fill.layout;
        let drawn: Vec<usize> = task.drawn_props().collect();
        if layout == Layout::Mixed || drawn.len() < 2 {
            return None;
        }
        let inside = task.inside();
        let (bottom, height) = (task.container.base, task.height().max(f64::MIN_POSITIVE));
        let mut below = vec![0.0; HEIGHTS];
        for p in &inside {
            below[level(p.y, bottom, height)] += 1.0 / inside.len() as f64;
        }
        let mut sum = 0.0;
        below.iter_mut().for_each(|share| {
            sum += *share;
            *share = sum;
        });
        let mut cluster = || {
            let prop = instance::draw(&task.scene.props, drawn.iter().copied(), rng).0;
            (inside[rng.random_range(0..inside.len())], prop)
        };
        let clustered = layout == Layout::Clusters && !inside.is_empty();
        let count = if clustered { task.expected.div_ceil(CLUSTER) } else { 0 };
        let clusters = (0..count).map(|_| cluster()).collect();
        Some(Zones { layout, bands: bands(task, drawn), below, bottom, height, clusters })
    }

    /// This prop may be here. Draws a number if the layout is a gradient.
    pub fn allows(&self, prop: usize, p: DVec3, rng: &mut impl Rng) -> bool {
        let below = || self.below[level(p.y, self.bottom, self.height)];
        let [low, high] = self.bands[prop];
        // How far from its band the prop would be.
        let beyond = || (low - below()).max(below() - high).max(0.0);
        match self.layout {
            Layout::Mixed => true,
            Layout::Bands => beyond() <= 0.5 / HEIGHTS as f64,
            Layout::Gradient => beyond() < BLEND * rng.random::<f64>(),
            Layout::Clusters => {
                let distance = |cluster: &(DVec3, usize)| p.distance_squared(cluster.0);
                let nearest = self.clusters.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
                nearest.is_none_or(|(_, theirs)| *theirs == prop)
            }
        }
    }
}

/// Index of a height among the [`HEIGHTS`].
fn level(y: f64, bottom: f64, height: f64) -> usize {
    ((y - bottom) / height * HEIGHTS as f64).clamp(0.0, HEIGHTS as f64 - 1.0) as usize
}

/// The bands of these props, in the order that is asked for.
fn bands(task: &FillTask, mut drawn: Vec<usize>) -> Vec<[f64; 2]> {
    let (props, shapes, wanted) = (&task.scene.props, task.shapes, &task.params.fill);
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
