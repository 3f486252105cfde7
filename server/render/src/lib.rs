//! A shaded still of any glTF file, by ray casting: software only, and the same picture for any number of threads.
//!
//! It must never know a bake: it reads the nodes of any file.
//!
//! Invariants: the same file and settings give the same bytes; triangles are bounded before any is read.

// The same bytes on every platform: no mathematics of the platform's own.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod animation;
mod camera;
mod glue;
mod library;
pub mod nodes;
mod ray_scene;
mod shade;
mod silhouette;
mod texture;
mod views;

use cairn_gltf::document::DocumentError;
use cairn_gltf::picture::uri_of;
use cairn_gltf::{Document, Resolver};
use camera::Camera;
use glam::{DAffine3, DQuat, DVec3};
use glue::DrawnGlue;
use image::RgbImage;
use library::Library;
use nodes::PlacedMesh;
use ray_scene::RayScene;
use shade::RenderJob;
pub use silhouette::{SilhouetteDifference, silhouette_difference};
use std::collections::BTreeSet;
use texture::Material;
pub use views::{Views, views};

/// Content and size of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    pub moment: Moment,
    /// Width and height, 1 to 16384 each.
    pub size: [u32; 2],
    /// Azimuth of the camera around the pile, degrees from +Z towards +X.
    pub azimuth: f64,
    /// Degrees above the horizon, -89 to 89.
    pub elevation: f64,
    /// Rays per picture element, at least 1. Noise falls with the square root.
    pub samples: u32,
    /// The moment to which the camera is fitted; `None`: the one that is shown.
    pub fit: Option<Moment>,
    /// How much the camera shows, relative to the pile, above 0.
    pub wide: f64,
    /// Show the dots of glue. Needs a pile that was baked with glue.
    pub glue: bool,
}

impl Default for Settings {
    fn default() -> Settings {
        let (azimuth, elevation) = (30.0, 16.0);
        let (moment, size) = (Moment::End, [1200, 900]);
        Settings { moment, fit: None, wide: 1.0, size, azimuth, elevation, samples: 16, glue: false }
    }
}

impl Settings {
    fn check(&self) -> Result<(), RenderError> {
        if self.size.iter().any(|side| !(1..=16384).contains(side)) || self.samples == 0 {
            return Err(RenderError::Settings(
                "a picture is 1 to 16384 pixels wide and high and has at least 1 sample",
            ));
        }
        if !(self.azimuth.is_finite() && self.elevation.is_finite() && self.wide.is_finite()) {
            return Err(RenderError::Settings("the camera's angles and what it shows must be numbers"));
        }
        Ok(())
    }
}

/// A moment of the file's first animation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    /// From 0. Needs a file that states its frame rate.
    Frame(u64),
    Seconds(f64),
    End,
}

/// A file to be rendered.
#[derive(Clone, Copy)]
pub struct RenderModel<'a> {
    /// For messages.
    pub name: &'a str,
    /// glTF or GLB.
    pub bytes: &'a [u8],
    /// Reads the file's external buffers and images.
    pub resolve: &'a Resolver<'a>,
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The input is wrong.
    #[error("{file}: {problem}")]
    File { file: String, problem: RenderFault },
    /// The command is wrong.
    #[error("{0}")]
    Settings(&'static str),
}

/// Why a file cannot be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderFault {
    #[error(transparent)]
    Document(#[from] DocumentError),
    #[error("has more triangles than can be rendered")]
    TooLarge,
    #[error("shows no triangles")]
    Empty,
    #[error("has no frame {0}; the last one is {1}")]
    NoFrame(u64, u64),
    #[error("states no frame rate; choose the moment in seconds")]
    NoFrameRate,
    #[error("has no glue; bake it to a .glb with glue (--set glue=as_modelled, or tacky), or leave out --glue")]
    NoGlue,
    #[error("describes its glue in a form that cannot be read; bake it again, or leave out --glue")]
    BrokenGlue,
}

/// Renders `model`; the camera is fitted to its node `pile`, or to everything where there is none. `control` is shown
/// as a translucent ghost.
pub fn render(
    model: &RenderModel,
    control: Option<&RenderModel>,
    settings: &Settings,
) -> Result<RgbImage, RenderError> {
    settings.check()?;
    let loaded = Loaded::read(model, settings.moment, settings.glue).map_err(|problem| problem.of(model))?;
    let ghost = control.map(|c| Loaded::read(c, Moment::Seconds(0.0), false).map_err(|p| p.of(c))).transpose()?;

    let pile = loaded.pile(&loaded.placed);
    let mut subject = match settings.fit {
        Some(moment) => Loaded::read(model, moment, false).map(|then| then.pile(&then.placed)),
        None => Ok(pile.clone()),
    }
    .map_err(|problem| problem.of(model))?;
    if let Some(ghost) = &ghost {
        subject.extend(ghost.points(&ghost.placed, false));
    }
    let Framed { to_unit, middle, size, camera } = Framed::new(subject, settings);

    // At rest, the lowest point of the pile and of its scenery, such as a table, is on the ground.
    let at_rest = loaded.points(&loaded.at_end, false);
    let ground = bounds(&at_rest).0.y.min(bounds(&pile).0.y);
    let rays = RayScene::new(&loaded.library, &loaded.placed, to_unit);
    if rays.is_empty() {
        return Err(RenderFault::Empty.of(model));
    }
    let bodies = || loaded.placed.iter().map(|p| p.body);
    let job = RenderJob {
        glue: loaded.glue.as_ref().map(|glue| glue.shown(to_unit, loaded.usual_radius(), bodies())),
        scene: rays,
        library: &loaded.library,
        ghost: ghost.as_ref().map(|ghost| RayScene::new(&ghost.library, &ghost.placed, to_unit)),
        ground: ((ground - middle.y) / size) as f32,
        camera,
        size: settings.size,
        samples: settings.samples,
    };
    Ok(job.run())
}

/// Base-colour pictures of a file that cannot be had, one sentence each: a still shows the material without them.
pub fn missing_pictures(model: &RenderModel) -> Vec<String> {
    let Ok(document) = Document::parse(model.bytes, model.resolve) else { return Vec::new() };
    let material = |index| Material::read(&document, index)?.texture;
    let pictures: BTreeSet<usize> =
        (0..document.array("materials").len()).filter_map(material).map(|texture| texture.picture).collect();
    let sentence = |index: usize| {
        let fault = document.picture(index, model.resolve).err()?;
        let image =
            document.get("images", index).ok().and_then(uri_of).map_or(index.to_string(), |uri| format!("{uri:?}"));
        Some(format!("{}: the image {image} is not shown: {fault}", model.name))
    };
    pictures.into_iter().filter_map(sentence).collect()
}

impl RenderFault {
    fn of(self, model: &RenderModel) -> RenderError {
        RenderError::File { file: model.name.into(), problem: self }
    }
}

/// A camera on its subject, in unit space.
struct Framed {
    /// Takes the world to unit space.
    to_unit: DAffine3,
    /// Middle and half the diagonal of the subject's box, m.
    middle: DVec3,
    size: f64,
    camera: Camera,
}

impl Framed {
    /// `subject`: points that are to be seen.
    fn new(mut subject: Vec<DVec3>, settings: &Settings) -> Framed {
        let (low, high) = bounds(&subject);
        let size = ((high - low).length() / 2.0).max(f64::MIN_POSITIVE);
        let middle = (low + high) / 2.0;
        let scale = DVec3::splat(1.0 / size);
        let to_unit = DAffine3::from_scale_rotation_translation(scale, DQuat::IDENTITY, -middle / size);
        for point in &mut subject {
            *point = to_unit.transform_point3(middle + settings.wide * (*point - middle));
        }
        let camera = Camera::fitted(&subject, settings.azimuth, settings.elevation, settings.size);
        Framed { to_unit, middle, size, camera }
    }
}

/// A file at a moment.
struct Loaded {
    placed: Vec<PlacedMesh>,
    /// When the animation is over.
    at_end: Vec<PlacedMesh>,
    library: Library,
    /// If it is wanted.
    glue: Option<DrawnGlue>,
}

impl Loaded {
    fn read(model: &RenderModel, moment: Moment, with_glue: bool) -> Result<Loaded, RenderFault> {
        let document = Document::open(model.bytes, model.resolve)?;
        let end = animation::duration(&document)?;
        let seconds = match moment {
            Moment::End => end,
            Moment::Seconds(seconds) => seconds,
            Moment::Frame(frame) => {
                let (fps, frames) = nodes::frame_clock(&document).ok_or(RenderFault::NoFrameRate)?;
                if frame >= frames.max(1) {
                    return Err(RenderFault::NoFrame(frame, frames.max(1) - 1));
                }
                frame as f64 / fps
            }
        };
        let placed = nodes::placed(&document, seconds)?;
        let at_end = nodes::placed(&document, end)?;
        let library = Library::read(&document, &placed, model.resolve)?;
        let glue = with_glue.then(|| DrawnGlue::read(&document, seconds, end)).transpose()?;
        let loaded = Loaded { placed, at_end, library, glue };
        let points = loaded.points(&loaded.placed, false);
        if points.is_empty() || points.iter().any(|p| !p.is_finite()) {
            return Err(RenderFault::Empty);
        }
        Ok(loaded)
    }

    /// The outlines of the pile, or of everything where there is none.
    fn pile(&self, placed: &[PlacedMesh]) -> Vec<DVec3> {
        self.points(placed, placed.iter().any(|p| p.in_pile))
    }

    /// The median radius of the pile's bodies.
    fn usual_radius(&self) -> f64 {
        let radius = |p: &PlacedMesh| {
            let mesh = self.library.meshes.get(&p.mesh)?;
            Some((p.world * mesh.from_cube).transform_vector3(mesh.bounds[1]).length())
        };
        let mut radii: Vec<f64> = self.placed.iter().filter(|p| p.in_pile).filter_map(radius).collect();
        radii.sort_by(f64::total_cmp);
        radii.get(radii.len() / 2).copied().unwrap_or(0.0)
    }

    /// The outlines of every instance, in the world.
    fn points(&self, placed: &[PlacedMesh], only_pile: bool) -> Vec<DVec3> {
        let shown = placed.iter().filter(|p| p.in_pile || !only_pile);
        shown
            .filter_map(|p| Some((p.world, self.library.meshes.get(&p.mesh)?)))
            .flat_map(|(world, mesh)| {
                let map = world * mesh.from_cube;
                mesh.outline.iter().map(move |p| map.transform_point3(*p))
            })
            .collect()
    }
}

fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
}
