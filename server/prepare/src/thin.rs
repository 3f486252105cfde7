//! What props can fill of a shape: the parts that are too thin for them, the match that is expected, and the size that
//! does better.

use crate::check::{CheckedScene, ROUNDED, least_extents, mean_thickness};
use cairn_geometry::interior::MeshInterior;
use cairn_geometry::thickness::{LocalThickness, Part, describe_parts};
use cairn_input::error::counted;
use cairn_input::params::{FillMethod, Params};
use cairn_input::scene::Scene;

/// A control mesh that is thicker than so many props in the mean is not looked at from place to place.
const THICK: f64 = 8.0;
/// Smaller props are recommended if no more bodies than this would fit.
const MOST_TO_FIT: f64 = 3000.0;

/// The match that is expected of props at random places: [`INSIDE`], less [`LOST`] of what lies within [`REACH`] least
/// extents of the props from the surface, where props leave steps and gaps, less [`SPARSE`] of the bodies that a fill
/// leaves out to end sooner, and less the parts that are too thin. Fitted to 18 bakes of twelve pairs; 15 are within
/// 0.05, long props in thin limbs match less, by up to 0.13.
const INSIDE: f64 = 0.95;
const LOST: f64 = 0.265;
const REACH: f64 = 0.9;
const SPARSE: f64 = 0.15;
/// Below it, props are too large for the shape.
const POOR: f64 = 0.75;
/// The size that is recommended is expected to match so much: what is reached differs by some .05.
const WANTED: f64 = 0.8;

/// Parts of the control mesh that the props are too thick for, and what is expected of the rest.
#[derive(Default)]
pub struct Thin {
    pub parts: Vec<Part>,
    /// Times their size at which the props fill these parts and match the shape, with [`MOST_TO_FIT`] bodies at most.
    pub fitting_scale: Option<f64>,
    /// `shape_iou` of the filled shape; not known of props that are laid or poured.
    pub expected_match: Option<f64>,
}

impl Thin {
    /// `bodies`: that the fill will place. `fullness`: share of those that would find room.
    pub fn new(scene: &Scene, params: &Params, checked: &CheckedScene, bodies: usize, fullness: f64) -> Thin {
        let fills = checked.core.is_none() && params.fill.count.is_none();
        let is_known = params.fill.method == FillMethod::Insert;
        let Some(control) = checked.filled(scene, params).filter(|_| fills) else { return Thin::default() };
        let inside = INSIDE - SPARSE * (1.0 - fullness);
        // In a limb, props are aligned with it: their second extent must fit.
        let least = least_extents(scene, &checked.sizes);
        let (reach, mean) = (REACH * least.x, mean_thickness(control));
        if mean > THICK * least.y {
            let expected = inside - LOST * (2.0 * reach / mean).min(1.0);
            return Thin { expected_match: is_known.then_some(expected), ..Thin::default() };
        }
        let (local, needed) = (LocalThickness::new(&MeshInterior::new(&control.mesh)), ROUNDED * least.y);
        let parts = local.thinner(needed);
        let missing: f64 = parts.iter().map(|part| part.share).sum();
        let expected = (inside - LOST * local.share_within(reach) - missing).max(0.0);
        let smallest = libm::cbrt(bodies as f64 / MOST_TO_FIT);
        let matching = (is_known && expected < POOR || !parts.is_empty() && expected < WANTED)
            .then(|| (local.depth_of_share((inside - WANTED) / LOST) / reach).max(smallest));
        let filling = parts.iter().map(|part| part.thickness / needed);
        let fitting_scale = filling.chain(matching).filter(|scale| *scale >= smallest && *scale < 1.0).reduce(f64::min);
        Thin { parts, fitting_scale, expected_match: is_known.then_some(expected) }
    }

    pub fn warning(&self, scene: &Scene) -> Option<String> {
        let name = &scene.control.as_ref()?.name;
        let share: f64 = self.parts.iter().map(|part| part.share).sum();
        // Smaller ones would be too many.
        let size = self.fitting_scale.map_or("smaller".into(), |scale| format!("{scale:.2} times as large"));
        if self.parts.is_empty() {
            let expected = self.expected_match.filter(|expected| *expected < POOR)?;
            return Some(format!(
                "{name}: these props are expected to match only {:.0} % of the shape: use props that are {size}, or a \
                 thicker shape",
                100.0 * expected
            ));
        }
        let parts = counted(self.parts.len(), "part is", "parts are");
        Some(format!(
            "{name}: {parts} too thin for these props, {:.0} % of its volume: {}; what they cannot reach stays empty: \
             use props that are {size}, or a thicker shape",
            100.0 * share,
            describe_parts(&self.parts)
        ))
    }
}
