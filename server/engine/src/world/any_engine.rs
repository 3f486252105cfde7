//! A pile that stands here may owe that to this engine. What others have not is taken away in trials.

use super::{Role, World};
use crate::shape::Shape;
use cairn_geometry::pose::Pose;
use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rapier3d::prelude::FrictionModel;

/// Every body begins off its place by this share of its thickness: others round poses, and have margins of their own.
const SHAKE: f64 = 1e-3;
/// Every body is smaller by this factor: where the engine presses bodies into each other, others push them apart, or
/// leave a gap. Of 131 rocks as a rabbit, 0.63 stood in MuJoCo and 0.29 in Bullet without this, 0.93 and 0.56 with
/// 0.995, all with 0.99.
const SMALLER: f64 = 0.99;

impl World {
    /// From now on, nothing resists rolling.
    pub fn roll_freely(&mut self) {
        self.rolling.end();
    }

    /// From now on, each contact point has friction of its own, as in all common engines, and nothing resists rolling.
    /// Every body is moved a little, and a little smaller. `shapes`: of the props.
    pub fn act_as_any_engine(&mut self, shapes: &[Shape]) {
        self.engine.integration_parameters.friction_model = FrictionModel::Coulomb;
        self.rolling.end();
        let mut rng = Pcg64Mcg::seed_from_u64(0);
        let mut way = || SHAKE * DVec3::from_array(std::array::from_fn(|_| rng.random::<f64>() * 2.0 - 1.0));
        for id in self.present().filter(|&id| self.bodies[id].role != Role::Pinned).collect::<Vec<_>>() {
            let (place, body) = (self.pose(id), &self.bodies[id]);
            let turn = DQuat::from_scaled_axis(way() * body.thickness / body.radius);
            let translation = place.translation + way() * body.thickness;
            self.put(id, &Pose { translation, rotation: turn * place.rotation });
            let (prop, scale) = (self.bodies[id].prop, self.bodies[id].scale);
            self.rescale(id, &shapes[prop], SMALLER * scale);
        }
        self.zero_step();
    }
}
