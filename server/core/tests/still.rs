//! Piles of which only one pose is wanted: the last one, or the one that was placed.

use super::common::{cone, scene, stick};
use cairn_core::bake;
use cairn_geometry::pose::Pose;
use cairn_input::observer::{Frame, Observer, Progress, Silent};
use cairn_input::params::{Accuracy, Params, Switch};
use cairn_input::scene::{PlacedBody, Scene};
use glam::{DQuat, DVec3};
use std::ops::ControlFlow;

/// A stick of 0.5 x 0.06 x 0.06 m.
fn placed(x: f64, y: f64) -> PlacedBody {
    PlacedBody::new(0, Pose { translation: DVec3::new(x, y, 0.0), rotation: DQuat::IDENTITY })
}

fn sticks(bodies: Vec<PlacedBody>) -> Scene {
    Scene { control: None, bodies, ..scene(cone(0.6, 0.8), stick()) }
}

/// Keeps number and poses of each frame.
struct Poses(Vec<(usize, Vec<Pose>)>);

impl Observer for Poses {
    fn progress(&mut self, _: &Progress) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn cpu_seconds(&mut self) -> f64 {
        0.0
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame) {
        self.0.push((frame.number, frame.bodies.iter().map(|shown| shown.unwrap().pose).collect()));
    }
}

#[test]
fn without_frames_only_the_final_pose_is_shown() {
    let late = PlacedBody { start: 2.0 / 24.0, ..placed(3.0, 0.3) };
    let scene = sticks(vec![placed(0.0, 0.2), placed(0.1, 0.4), late]);
    let shown = |frames: Switch| {
        let mut params = Params::new(Accuracy::Draft);
        params.effects.frames = frames;
        let mut poses = Poses(Vec::new());
        bake(&scene, &params, &mut poses).unwrap();
        poses.0
    };
    let (all, alone) = (shown(Switch::Auto), shown(Switch::Off));
    assert!(all.len() > 3);
    assert_eq!(alone, [(0, all.last().unwrap().1.clone())]);
}

#[test]
fn support_of_pinned_bodies_is_measured_where_they_were_placed() {
    let kept = |x: f64, y: f64| PlacedBody { pinned: true, ..placed(x, y) };
    let mut params = Params::new(Accuracy::Draft);
    (params.output.frames, params.effects.frames) = (Some(0), Switch::Off);
    params.report.support = Switch::On;
    let unsupported = |bodies: Vec<PlacedBody>| {
        let baked = bake(&sticks(bodies.clone()), &params, &mut Silent).unwrap();
        for (is, was) in baked.pile.frames[0].iter().zip(&bodies).filter(|(_, was)| was.pinned) {
            assert!((is.translation - was.pose.translation).length() < 1e-6);
        }
        let share = baked.report.measures["unsupported_fraction"].unwrap();
        assert_eq!(share > 0.0, !baked.report.unsupported.is_empty());
        baked.report.unsupported
    };
    assert_eq!(unsupported(vec![kept(0.0, 0.03), kept(0.0, 0.09)]), [0; 0]);
    // The second one would tip over.
    assert_eq!(unsupported(vec![kept(0.0, 0.03), kept(0.35, 0.09), kept(3.0, 0.03)]), [1]);
    // Pinned bodies carry like scenery while others move.
    assert_eq!(unsupported(vec![kept(0.0, 0.03), kept(0.35, 0.09), placed(3.0, 0.03)]), [0; 0]);
}
