//! Estimate of the number of props that fit into a control mesh, before the fill: a model fitted on finished fills.

use cairn_engine::shape::Size;
use cairn_input::params::Fill;
use cairn_input::scene::{Prop, Scene};

/// The packing is a product of powers of these; `crowding` is an exponent of e.
pub const FEATURES: [&str; 7] = ["1", "solidity", "boxiness", "flatness", "slenderness", "bend", "crowding"];
/// An exponent for each of the features.
pub type Weights = [f64; FEATURES.len()];

/// The fitted exponents; the example `fit_estimate` prints them.
const PACKING: Weights = [-0.161, 1.052, 0.053, 0.167, -0.107, -0.729, -0.194];

/// The room that is filled.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// m^3.
    pub volume: f64,
    /// Of its surface, m^2.
    pub area: f64,
}

impl Room {
    /// The numbers that decide how densely a prop packs, in the order of [`FEATURES`]; logarithms, except for
    /// `crowding`:
    ///
    /// - `solidity`: volume / volume of the convex hull
    /// - `boxiness`: volume of the convex hull / volume of the box around it
    /// - `flatness`: shortest / longest edge of that box
    /// - `slenderness`: length / width, from e upward
    /// - `bend`: solidity, to the power of the logarithm of length / width: the room in the bend of a long prop, where
    ///   others lie
    /// - `crowding`: the share of the room that is within a prop's thickness of its surface
    pub fn features(&self, prop: &Prop, size: &Size) -> Weights {
        let [least, middle, longest] = size.extents.to_array();
        let thickness = least * (prop.scale[0] + prop.scale[1]) / 2.0;
        let crowding = (thickness * self.area / self.volume).min(MOST_CROWDED);
        let solidity = size.volume / size.hull_volume;
        let boxiness = size.hull_volume / (least * middle * longest);
        let length = libm::log(longest / middle);
        let slenderness = (length - 1.0).max(0.0);
        [
            1.0,
            libm::log(solidity),
            libm::log(boxiness),
            libm::log(least / longest),
            slenderness,
            libm::log(solidity) * length,
            crowding,
        ]
    }

    /// Volume of the room over the mean volume of a prop, and the mean features of the props, by their weight.
    pub fn load(&self, scene: &Scene, sizes: &[Size]) -> (f64, Weights) {
        let total: f64 = scene.props.iter().map(|p| p.weight).sum();
        let (mut volume, mut features) = (0.0, Weights::default());
        for (prop, size) in scene.props.iter().zip(sizes).filter(|(prop, _)| prop.weight > 0.0) {
            volume += prop.weight / total * size.volume * mean_cube(prop);
            for (sum, feature) in features.iter_mut().zip(self.features(prop, size)) {
                *sum += prop.weight / total * feature;
            }
        }
        (self.volume / volume, features)
    }
}

/// A room smaller than this, against its props, is beyond the model.
const MOST_CROWDED: f64 = 3.0;
/// The share of a volume that props fill is between these.
const RANGE: (f64, f64) = (0.02, 0.9);

/// Share that stacked boxes fill of a room that is not made for them. Other props fill this times the share that they
/// fill of the boxes around them.
const STACKED: f64 = 0.85;

/// The stated range of props of one size is the expected number of bodies divided and multiplied by this. Three fills
/// at `draft` that the law was not fitted to had 0.90, 0.94 and 1.03 times that number; too few to say how many of ten
/// others are within the range. The example `fit_estimate` prints the factor of nine of ten for the fills it is given.
pub const FACTOR: f64 = 1.5;
/// Mean diameters of props that differ by more than this ratio share a room in ways that no law of means knows: where
/// large ones find no room, small ones take it.
const MIXED: f64 = 3.0;

/// How many bodies nine of ten fills have, from and to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyRange {
    pub low: usize,
    pub high: usize,
    /// Ratio of the props' sizes, where it decides on the range.
    pub mixed: Option<f64>,
}

/// The range around [`expected_bodies`]. Of props of very different sizes, up to what the smallest would be by itself.
pub fn body_range(scene: &Scene, sizes: &[Size], room: &Room, fill: &Fill, share: f64) -> BodyRange {
    let expected = expected_bodies(scene, sizes, room, fill, share);
    let most = (fill.max_bodies as usize).min(fill.count.unwrap_or(u32::MAX) as usize);
    let within = |bodies: f64| (bodies.round().max(1.0) as usize).min(most);
    // Of an open mesh, the volume is an estimate: so is the number.
    let enclosed: Vec<Size> = sizes.iter().map(|size| Size { volume: size.enclosed, ..*size }).collect();
    let other = expected_bodies(scene, &enclosed, room, fill, share);
    let (low, high) = (within(expected.min(other) as f64 / FACTOR), within(expected.max(other) as f64 * FACTOR));
    let drawn = || scene.props.iter().zip(sizes).filter(|(prop, _)| prop.weight > 0.0);
    let volume = |(prop, size): (&Prop, &Size)| size.volume * mean_cube(prop);
    let least = drawn().map(volume).fold(f64::INFINITY, f64::min);
    let ratio = libm::cbrt(drawn().map(volume).fold(0.0, f64::max) / least);
    let smallest = drawn().find(|drawn| volume(*drawn) == least);
    match smallest.filter(|_| ratio > MIXED) {
        Some((prop, size)) => {
            let alone = Scene { props: vec![prop.clone()], ..Scene::default() };
            let fitting = expected_bodies(&alone, std::slice::from_ref(size), room, fill, share);
            let high = high.max(fitting);
            BodyRange { low, high, mixed: (high > low).then_some(ratio) }
        }
        None => BodyRange { low, high, mixed: None },
    }
}

/// Bodies that fit, by this share of the packing that fills usually reach, and by the limits given.
pub fn expected_bodies(scene: &Scene, sizes: &[Size], room: &Room, fill: &Fill, share: f64) -> usize {
    let (times, features) = room.load(scene, sizes);
    let mut packing = libm::exp(features.iter().zip(PACKING).map(|(f, w)| f * w).sum::<f64>()).clamp(RANGE.0, RANGE.1);
    if fill.method.traits().has_order {
        let [_, solidity, boxiness, ..] = features;
        packing += fill.order * (STACKED * libm::exp(solidity + boxiness) - packing).max(0.0);
    }
    let fitting = (share * packing * times).ceil().max(1.0);
    (fitting.min(fill.max_bodies as f64) as usize).min(fill.count.unwrap_or(u32::MAX) as usize).max(1)
}

/// Mean of s^3 for the scales of a prop: lo + (hi - lo) u^k, u even between 0 and 1.
fn mean_cube(prop: &Prop) -> f64 {
    let ([lo, hi], k) = (prop.scale, prop.scale_power());
    let range = hi - lo;
    let term = |n: i32, times: f64| times * lo.powi(3 - n) * range.powi(n) / (f64::from(n) * k + 1.0);
    term(0, 1.0) + term(1, 3.0) + term(2, 3.0) + term(3, 1.0)
}
