//! How a pile comes to rest.

use super::common::{cone, scene, stick};
use cairn_core::bake;
use cairn_geometry::mesh::TriMesh;
use cairn_geometry::pose::Pose;
use cairn_input::observer::Silent;
use cairn_input::params::{Accuracy, ControlMode, Params, ReleaseOrder};
use cairn_input::scene::{PlacedBody, Scene};
use glam::{DQuat, DVec3};
use std::f64::consts::FRAC_PI_2;

/// Twenty-five layers of three planks (1.2 x 0.04 x 0.15 m), crosswise. With too few substeps for such stiff contacts,
/// it bobs up and down forever.
#[test]
fn a_tall_stack_of_thin_planks_is_calm() {
    let stick = stick();
    let points = stick.points.iter().map(|p| p * DVec3::new(1.2 / 0.5, 0.04 / 0.06, 0.15 / 0.06)).collect();
    let plank = TriMesh { points, ..stick };
    let pose = |layer: usize, number: usize| {
        let rotation = DQuat::from_rotation_y(if layer.is_multiple_of(2) { 0.0 } else { FRAC_PI_2 });
        let beside = rotation * DVec3::new(0.0, 0.0, 0.5 * (number as f64 - 1.0));
        Pose { translation: beside + DVec3::Y * (0.02 + 0.04 * layer as f64), rotation }
    };
    let bodies = (0..25).flat_map(|layer| (0..3).map(move |number| PlacedBody::new(0, pose(layer, number)))).collect();
    let scene = Scene { control: None, bodies, ..scene(cone(0.6, 0.8), plank) };
    let mut params = Params::new(Accuracy::Standard);
    params.control.mode = ControlMode::Off;
    params.release.order = ReleaseOrder::AtOnce;
    let report = bake(&scene, &params, &mut Silent).unwrap().report;
    assert_eq!(report.measures["moving"], Some(0.0));
    assert!(report.counts["steps"] < 100, "{} steps until it rests", report.counts["steps"]);
    assert!(report.measures["stack_drift_rel"].unwrap() < 0.02);
}
