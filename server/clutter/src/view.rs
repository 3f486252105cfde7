//! What a camera sees of a layout: how much of each body others hide, by rays through the elements of a picture.
//!
//! Meshes are those that are seen, not those that collide. SI, the place's frame.

use crate::catalogue::{CameraEntry, Catalogue, PlaceEntry};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_geometry::rays::{Ray, RaySoup, Triangle};
use cairn_input::scene::{Scene, StaticModel};
use glam::DVec3;
use std::sync::atomic::{AtomicU64, Ordering};

/// Width and height of the picture, elements.
const SIZE: [usize; 2] = [320, 240];
/// Vertical field of view where the catalogue does not say, degrees.
const FIELD: f64 = 45.0;
/// Height of the camera above the horizon where the catalogue does not say, degrees.
const ELEVATION: f64 = 45.0;
/// A point nearer than this share of the distance to what the camera looks at is behind it.
const NEAREST: f64 = 1e-3;

/// The cameras and meshes of a catalogue whose layouts are looked at.
pub struct View {
    /// One per place.
    cameras: Vec<Camera>,
    props: Vec<Seen>,
    places: Vec<RaySoup>,
    renders: AtomicU64,
}

/// A mesh for rays, and its lowest and highest corner.
struct Seen {
    soup: RaySoup,
    bounds: (DVec3, DVec3),
}

/// A pinhole.
struct Camera {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// Half the picture's width and height at distance 1.
    half: [f64; 2],
    near: f64,
}

/// A body as a camera sees it.
pub struct SeenBody {
    pub prop: usize,
    pub scale: f64,
    /// Of the prop's own origin.
    pub pose: Pose,
}

/// What is seen of a layout.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// Mean share of a body's outline in the picture that other bodies hide, over those that are in it; 0 without any.
    pub overlap: f64,
    /// Share of each body's outline in the picture that is seen, past other bodies and the place; 0 of one that is not
    /// in it. Shape `[body]`.
    pub visible: Vec<f64>,
}

impl View {
    /// `None`: the catalogue asks for nothing that a camera sees.
    pub fn new(catalogue: &Catalogue, scene: &Scene) -> Option<View> {
        if !catalogue.is_looked_at() {
            return None;
        }
        let own = catalogue.settings.camera;
        let camera = |(entry, model): (&PlaceEntry, &StaticModel)| {
            Camera::new(entry.camera.or(own).unwrap_or_default(), model.model.mesh.bounds())
        };
        let seen = |mesh: &TriMesh| Seen { soup: soup(mesh), bounds: mesh.bounds() };
        Some(View {
            cameras: catalogue.places.iter().zip(&scene.statics).map(camera).collect(),
            props: scene.props.iter().map(|prop| seen(&prop.model.mesh)).collect(),
            places: scene.statics.iter().map(|place| soup(&place.model.mesh)).collect(),
            renders: AtomicU64::new(0),
        })
    }

    /// Pictures that were taken so far.
    pub fn renders(&self) -> u64 {
        self.renders.load(Ordering::Relaxed)
    }

    /// Looks at a layout on a place.
    pub fn look(&self, place: usize, bodies: &[SeenBody]) -> Look {
        self.renders.fetch_add(1, Ordering::Relaxed);
        let camera = &self.cameras[place];
        let mut nearest = vec![(f32::INFINITY, usize::MAX); SIZE[0] * SIZE[1]];
        let mut outlines = vec![0u32; bodies.len()];
        for (k, body) in bodies.iter().enumerate() {
            let seen = &self.props[body.prop];
            let back = body.pose.rotation.inverse();
            // Distances along the ray are the same in the body's frame: its direction is scaled, too.
            let to_body = |way: DVec3| (back * way / body.scale).as_vec3a();
            let origin = to_body(camera.eye - body.pose.translation);
            let ([left, top], [right, bottom]) = camera.part(seen.bounds, body);
            for row in top..bottom {
                for column in left..right {
                    let ray = Ray::new(origin, to_body(camera.ray(column, row)));
                    let Some((_, distance)) = seen.soup.first(&ray, f32::INFINITY) else { continue };
                    outlines[k] += 1;
                    let element = &mut nearest[row * SIZE[0] + column];
                    if distance < element.0 {
                        *element = (distance, k);
                    }
                }
            }
        }
        let (mut first, mut clear) = (vec![0u32; bodies.len()], vec![0u32; bodies.len()]);
        for (i, &(distance, k)) in nearest.iter().enumerate().filter(|(_, element)| element.1 != usize::MAX) {
            first[k] += 1;
            let way = camera.ray(i % SIZE[0], i / SIZE[0]).as_vec3a();
            let before = self.places[place].first(&Ray::new(camera.eye.as_vec3a(), way), distance);
            clear[k] += u32::from(before.is_none());
        }
        let share = |part: u32, whole: u32| f64::from(part) / f64::from(whole.max(1));
        let shown: Vec<usize> = (0..bodies.len()).filter(|&k| outlines[k] > 0).collect();
        let hidden: f64 = shown.iter().map(|&k| 1.0 - share(first[k], outlines[k])).sum();
        Look {
            overlap: hidden / shown.len().max(1) as f64,
            visible: clear.iter().zip(&outlines).map(|(&part, &whole)| share(part, whole)).collect(),
        }
    }
}

impl Camera {
    /// What an entry leaves open is chosen so that all of the place is in the picture.
    fn new(entry: CameraEntry, (low, high): (DVec3, DVec3)) -> Camera {
        let target = entry.look_at.map_or((low + high) / 2.0, DVec3::from);
        let tangent = libm::tan(entry.field_of_view.unwrap_or(FIELD).to_radians() / 2.0);
        let half = [tangent * SIZE[0] as f64 / SIZE[1] as f64, tangent];
        let (sin, cos) = libm::sincos(ELEVATION.to_radians());
        let back = match entry.position {
            Some(position) => (DVec3::from(position) - target).try_normalize().unwrap_or(DVec3::Y),
            None => DVec3::new(0.0, sin, cos),
        };
        // From straight above, the picture's right is +X.
        let right = DVec3::Y.cross(back).try_normalize().unwrap_or(DVec3::X);
        let up = back.cross(right);
        let corner = |i: usize| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low) - target;
        let distance = |p: DVec3| back.dot(p) + (right.dot(p).abs() / half[0]).max(up.dot(p).abs() / half[1]);
        let far = (0..8).map(|i| distance(corner(i))).fold(0.0, f64::max);
        let eye = entry.position.map_or(target + back * far, DVec3::from);
        Camera { eye, right, up, forward: -back, half, near: NEAREST * eye.distance(target) }
    }

    /// The direction through the middle of an element: of length 1 along the camera's axis.
    fn ray(&self, column: usize, row: usize) -> DVec3 {
        let across = |at: usize, count: usize| (2.0 * at as f64 + 1.0) / count as f64 - 1.0;
        let (x, y) = (across(column, SIZE[0]), -across(row, SIZE[1]));
        self.forward + self.right * (x * self.half[0]) + self.up * (y * self.half[1])
    }

    /// The columns and rows in which a body may be: the first ones, and those behind the last.
    fn part(&self, (low, high): (DVec3, DVec3), body: &SeenBody) -> ([usize; 2], [usize; 2]) {
        let (mut least, mut most) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for i in 0..8 {
            let corner = DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low);
            let p = body.pose.transform_point(corner * body.scale) - self.eye;
            let depth = p.dot(self.forward);
            if depth < self.near {
                return ([0; 2], SIZE);
            }
            let at = [p.dot(self.right) / (depth * self.half[0]), -p.dot(self.up) / (depth * self.half[1])];
            for axis in 0..2 {
                let element = (at[axis] + 1.0) / 2.0 * SIZE[axis] as f64;
                (least[axis], most[axis]) = (least[axis].min(element), most[axis].max(element));
            }
        }
        let within = |at: f64, axis: usize| at.clamp(0.0, SIZE[axis] as f64) as usize;
        ([0, 1].map(|axis| within(least[axis].floor(), axis)), [0, 1].map(|axis| within(most[axis].ceil(), axis)))
    }
}

fn soup(mesh: &TriMesh) -> RaySoup {
    let triangle = |i: usize| Triangle(mesh.corners(i).map(|p| p.as_vec3a()));
    RaySoup::new(&(0..mesh.triangles.len()).map(triangle).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_engine::shape::hull_mesh;
    use glam::DQuat;

    fn cube(low: DVec3, high: DVec3) -> TriMesh {
        let corner = |i: usize| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low);
        hull_mesh(&(0..8).map(corner).collect::<Vec<_>>())
    }

    /// A cube of 0.2 m as the only prop; the place is a plate at height 0 with a wall from there to `wall`.
    fn view(camera: CameraEntry, wall: f64) -> View {
        let prop = cube(DVec3::splat(-0.1), DVec3::splat(0.1));
        let mut place = cube(DVec3::new(-2.0, -0.1, -2.0), DVec3::new(2.0, 0.0, 2.0));
        place.append(&cube(DVec3::new(-2.0, 0.0, 1.0), DVec3::new(2.0, wall, 1.1)));
        View {
            cameras: vec![Camera::new(camera, place.bounds())],
            props: vec![Seen { bounds: prop.bounds(), soup: soup(&prop) }],
            places: vec![soup(&place)],
            renders: AtomicU64::new(0),
        }
    }

    fn body(x: f64, y: f64, z: f64) -> SeenBody {
        SeenBody { prop: 0, scale: 1.0, pose: Pose { translation: DVec3::new(x, y, z), rotation: DQuat::IDENTITY } }
    }

    /// From the front, at the height of the cubes' middle.
    fn ahead() -> CameraEntry {
        CameraEntry { position: Some([0.0, 0.1, 50.0]), look_at: Some([0.0, 0.1, 0.0]), field_of_view: Some(1.0) }
    }

    #[test]
    fn what_is_hidden_is_counted() {
        let view = view(ahead(), 0.01);
        let look = view.look(0, &[body(0.0, 0.1, 0.0), body(0.1, 0.1, -0.5)]);
        // Half of the farther one is hidden, of the nearer one nothing; the wall hides a twentieth of the height.
        assert!((look.overlap - 0.25).abs() < 0.02, "{look:?}");
        assert!((look.visible[0] - 0.95).abs() < 0.03 && (look.visible[1] - 0.475).abs() < 0.03, "{look:?}");
        let apart = view.look(0, &[body(-0.15, 0.1, 0.0), body(0.15, 0.1, 0.0)]);
        assert_eq!(apart.overlap, 0.0);
        assert_eq!(view.renders(), 2);
    }

    #[test]
    fn the_place_hides_what_is_behind_its_wall_and_is_no_overlap() {
        let look = view(ahead(), 0.2).look(0, &[body(0.0, 0.1, 0.0)]);
        assert_eq!((look.overlap, look.visible), (0.0, vec![0.0]));
    }

    #[test]
    fn what_is_out_of_the_picture_does_not_count() {
        let look = view(ahead(), 0.01).look(0, &[body(0.0, 0.1, 0.0), body(20.0, 0.1, 0.0), body(0.0, 0.1, 60.0)]);
        assert_eq!((look.overlap, &look.visible[1..]), (0.0, &[0.0, 0.0][..]));
    }

    #[test]
    fn by_itself_the_camera_sees_all_of_the_place() {
        let view = view(CameraEntry::default(), 0.5);
        let ends = [-1.9, 1.9].map(|x| [-1.9, 0.3].map(|z| body(x, 0.1, z))).into_iter().flatten();
        let look = view.look(0, &ends.collect::<Vec<_>>());
        assert!(look.visible.iter().all(|&visible| visible > 0.9), "{look:?}");
    }

    #[test]
    fn from_straight_above_what_lies_on_a_body_hides_it() {
        let above = CameraEntry { position: Some([0.0, 9.0, 0.0]), look_at: Some([0.0; 3]), field_of_view: Some(5.0) };
        let look = view(above, 0.5).look(0, &[body(0.0, 0.1, 0.0), body(0.0, 0.3, 0.0)]);
        assert_eq!((look.overlap, look.visible), (0.5, vec![0.0, 1.0]));
    }
}
