//! How far the silhouettes of two files differ, in picture elements.

use super::camera::Camera;
use super::nodes::PlacedMesh;
use super::ray_scene::RayScene;
use super::{Loaded, Moment, RenderError, RenderModel, bounds};
use glam::{DAffine3, DQuat, DVec3};
use rayon::prelude::*;

/// Picture elements that one file covers and the other does not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct SilhouetteDifference {
    /// How far the farthest of them is from what the other covers, counted as a king moves; at most [`FARTHEST`].
    pub farthest_px: u32,
    /// Those farther than one.
    pub beyond_one_px: usize,
}

/// No difference is measured farther.
const FARTHEST: u32 = 16;

/// Compares the piles of two files in their last frames, from each azimuth and elevation, in degrees. The camera is
/// fitted to the first file. A gap between bodies, through which one looks, is part of the silhouette.
pub fn silhouette_difference(
    one: &RenderModel,
    other: &RenderModel,
    size: [u32; 2],
    views: &[(f64, f64)],
) -> Result<SilhouetteDifference, RenderError> {
    let load = |model: &RenderModel| Loaded::read(model, Moment::End, false).map_err(|problem| problem.of(model));
    let loaded = [load(one)?, load(other)?];
    let points = loaded[0].points(&loaded[0].placed, true);
    let (low, high) = bounds(&points);
    let radius = ((high - low).length() / 2.0).max(f64::MIN_POSITIVE);
    let middle = (low + high) / 2.0;
    let to_unit =
        DAffine3::from_scale_rotation_translation(DVec3::splat(1.0 / radius), DQuat::IDENTITY, -middle / radius);
    let seen: Vec<DVec3> = points.iter().map(|p| to_unit.transform_point3(*p)).collect();
    let piles: Vec<Vec<PlacedMesh>> =
        (loaded.iter()).map(|file| file.placed.iter().filter(|placed| placed.in_pile).copied().collect()).collect();
    let scenes: Vec<RayScene> =
        loaded.iter().zip(&piles).map(|(file, pile)| RayScene::new(&file.library, pile, to_unit)).collect();
    let mut all = SilhouetteDifference::default();
    for &(azimuth, elevation) in views {
        let camera = Camera::fitted(&seen, azimuth, elevation, size);
        let masks: Vec<Mask> = scenes.iter().map(|scene| Mask::of(scene, &camera, size)).collect();
        for (covered, by) in [(&masks[0], &masks[1]), (&masks[1], &masks[0])] {
            let found = covered.beyond(by);
            all.farthest_px = all.farthest_px.max(found.farthest_px);
            all.beyond_one_px += found.beyond_one_px;
        }
    }
    Ok(all)
}

/// What a pile covers of a picture.
struct Mask {
    width: usize,
    covered: Vec<bool>,
}

impl Mask {
    fn of(scene: &RayScene, camera: &Camera, [width, height]: [u32; 2]) -> Mask {
        let ray = |column: u32, row: u32| camera.element([column, row], [width, height]);
        let row = |y: u32| (0..width).map(move |x| !scene.is_clear(camera.eye, ray(x, y)));
        let covered = (0..height).into_par_iter().flat_map_iter(row).collect();
        Mask { width: width as usize, covered }
    }

    /// What is covered here and not by the other.
    fn beyond(&self, other: &Mask) -> SilhouetteDifference {
        let mut found = SilhouetteDifference::default();
        let height = self.covered.len() / self.width;
        let differs = (0..self.covered.len()).filter(|&at| self.covered[at] && !other.covered[at]);
        for at in differs {
            let (x, y) = (at % self.width, at / self.width);
            let reaches = |distance: &u32| {
                let reach = *distance as usize;
                let (left, right) = (x.saturating_sub(reach), (x + reach).min(self.width - 1));
                (y.saturating_sub(reach)..=(y + reach).min(height - 1))
                    .any(|y| other.covered[y * self.width + left..=y * self.width + right].contains(&true))
            };
            let distance = (1..FARTHEST).find(reaches).unwrap_or(FARTHEST);
            found.farthest_px = found.farthest_px.max(distance);
            found.beyond_one_px += usize::from(distance > 1);
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_other_does_not_cover_is_counted_by_its_distance() {
        let mask = |rows: [&str; 3]| Mask { width: 6, covered: rows.concat().chars().map(|c| c == '#').collect() };
        let wide = mask(["###...", "#####.", "###..."]);
        let narrow = mask(["###...", "###...", "###..."]);
        assert_eq!(wide.beyond(&narrow), SilhouetteDifference { farthest_px: 2, beyond_one_px: 1 });
        assert_eq!(narrow.beyond(&wide), SilhouetteDifference::default());
    }
}
