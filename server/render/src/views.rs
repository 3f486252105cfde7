//! What a camera sees as numbers: which body each picture element shows, and how far it is.

use super::camera::Camera;
use super::ray_scene::RayScene;
use super::{Framed, Loaded, Moment, RenderError, RenderFault, RenderModel, Settings};
use rayon::prelude::*;

/// A camera's views of some moments.
pub struct Views {
    /// Width and height.
    pub size: [u32; 2],
    /// The body that an element shows, by its index in the result; in a file without a node `pile`, the mesh, by its
    /// place in the file. -1: none, or scenery. Shape `[moment, row, column]`, rows from the top.
    pub bodies: Vec<i32>,
    /// Distance of what an element shows along the camera's axis, m; infinite where it shows nothing. Same shape.
    pub depths: Vec<f32>,
    /// From the camera's frame to the world: X to the right, Y up, and it looks along -Z. Row by row.
    pub camera: [f64; 16],
    /// From a point of the camera's frame with Y down and Z ahead to column and row, times the depth. Row by row.
    pub intrinsics: [f64; 9],
}

/// Elements in all views: a gigabyte.
const MOST: u64 = 1 << 27;

/// The views of a file at these moments from one camera, which is fitted to `settings.fit`, or to the first of them.
pub fn views(model: &RenderModel, moments: &[Moment], settings: &Settings) -> Result<Views, RenderError> {
    settings.check()?;
    let elements = settings.size.iter().map(|&side| u64::from(side)).product::<u64>() * moments.len() as u64;
    if elements > MOST {
        return Err(RenderError::Settings("the arrays would have more than 134 million pixels; choose a smaller size"));
    }
    let load = |moment: Moment| Loaded::read(model, moment, false).map_err(|problem| problem.of(model));
    let first = settings.fit.or(moments.first().copied()).unwrap_or(settings.moment);
    let Framed { to_unit, middle, size, camera } = {
        let fitted = load(first)?;
        Framed::new(fitted.pile(&fitted.placed), settings)
    };
    let [width, height] = settings.size;
    let mut found = Views {
        size: settings.size,
        bodies: Vec::new(),
        depths: Vec::new(),
        camera: matrix(&camera, middle.to_array(), size),
        intrinsics: camera.intrinsics(settings.size),
    };
    for &moment in moments {
        let loaded = load(moment)?;
        let rays = RayScene::new(&loaded.library, &loaded.placed, to_unit);
        if rays.is_empty() {
            return Err(RenderFault::Empty.of(model));
        }
        let has_pile = loaded.placed.iter().any(|placed| placed.in_pile);
        let number = |at: usize| match has_pile {
            true => loaded.placed[at].body.map_or(-1, |body| body as i32),
            false => at as i32,
        };
        let element = |at: u32| {
            let ray = camera.element([at % width, at / width], settings.size);
            match rays.first(camera.eye, ray, f32::INFINITY) {
                Some(hit) => (number(hit.number), hit.distance * ray.dot(camera.forward) * size as f32),
                None => (-1, f32::INFINITY),
            }
        };
        let (bodies, depths): (Vec<i32>, Vec<f32>) = (0..width * height).into_par_iter().map(element).unzip();
        found.bodies.extend(bodies);
        found.depths.extend(depths);
    }
    Ok(found)
}

fn matrix(camera: &Camera, middle: [f64; 3], size: f64) -> [f64; 16] {
    let row = |k: usize| {
        let axes = [camera.right[k], camera.up[k], -camera.forward[k]].map(f64::from);
        [axes[0], axes[1], axes[2], middle[k] + size * f64::from(camera.eye[k])]
    };
    let mut all = [0.0; 16];
    (0..3).for_each(|k| all[4 * k..4 * k + 4].copy_from_slice(&row(k)));
    all[15] = 1.0;
    all
}
