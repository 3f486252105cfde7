//! The slowness of this machine, for estimates in its own CPU seconds.

use cairn_engine::shape::{Shape, Size};
use cairn_engine::world::{Insertion, Units, World};
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::error::Error;
use cairn_input::params::{Accuracy, Params};
use cairn_input::scene::{Model, Prop};
use cairn_prepare::estimate::CALIBRATION_SECONDS;
use glam::{DQuat, DVec3};

/// Boxes along each edge of the calibration's stack, and its steps.
const CALIBRATION: (usize, usize) = (5, 60);

/// CPU time on this machine / that on the one that the cost model was fitted on: a stack of boxes is simulated for
/// about a tenth of a second, three times, and the quickest run counts. `clock`: CPU seconds of this process.
pub fn calibrate(clock: impl Fn() -> f64) -> Result<f64, Error> {
    let prop = cube();
    let physics = Params::new(Accuracy::Standard).physics;
    let shape = Shape::new(&prop, Size::of(&prop.model.mesh), &physics).map_err(Error::Internal)?;
    let units = Units::new(shape.size.diameter, shape.mass, 9.81);
    let (edge, steps) = CALIBRATION;
    let mut least = f64::INFINITY;
    for _ in 0..3 {
        let begin = clock();
        let mut world = World::new(units, &physics, 0.5, false);
        world.add_ground(0.0, 0.7);
        for i in 0..edge.pow(3) {
            let place = DVec3::new((i % edge) as f64, (i / edge / edge) as f64 + 0.5, (i / edge % edge) as f64);
            let pose = Pose { translation: place * 0.6, rotation: DQuat::from_rotation_y(0.1 * i as f64) };
            let body = Insertion { prop: 0, scale: 1.0, pose, friction: 0.7, restitution: 0.0 };
            world.insert(&shape, &body).map_err(Error::Internal)?;
        }
        for _ in 0..steps {
            world.step();
        }
        least = least.min(clock() - begin);
    }
    Ok(least / CALIBRATION_SECONDS)
}

/// A cube with the edge 1 m.
fn cube() -> Prop {
    let corner = |i: usize| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64) - 0.5;
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let mesh = TriMesh { points: (0..8).map(corner).collect(), triangles };
    Prop::new(Model::new("cube", mesh))
}
