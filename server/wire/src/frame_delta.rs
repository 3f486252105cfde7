//! A bake's frames as messages: only the changes since the last one.

use crate::proto;
use crate::proto::bake_event::Kind;
use crate::to_proto;
use cairn_input::observer::{Frame, FrameBody, Stage, State};

/// The state that a reader of the messages so far knows.
#[derive(Default)]
pub struct FrameDelta {
    /// Whether the bodies are those of the result.
    is_result: bool,
    /// Shape `[body]`; `None` once removed.
    known: Vec<Option<Known>>,
    /// Shape `[body]`.
    states: Vec<State>,
    /// The numbers in the names of the result's bodies; empty where they are the indices.
    numbers: Vec<usize>,
}

#[derive(Clone, Copy, PartialEq)]
struct Known {
    scale: f32,
    position: [f32; 3],
    rotation: [f32; 4],
}

impl Known {
    fn of(shown: &FrameBody) -> Known {
        Known {
            scale: shown.scale as f32,
            position: shown.pose.translation.as_vec3().to_array(),
            rotation: shown.pose.rotation.normalize().as_quat().to_array(),
        }
    }
}

impl FrameDelta {
    /// The numbers in the names of the result's bodies, before its frames.
    pub fn set_numbers(&mut self, numbers: &[usize]) {
        self.numbers = numbers.to_vec();
    }

    /// The table of new bodies, if there are any, and the frame.
    pub fn next(&mut self, frame: &Frame) -> impl Iterator<Item = Kind> + use<> {
        let is_fill = frame.stage == Stage::Fill;
        if !is_fill && !self.is_result {
            let numbers = std::mem::take(&mut self.numbers);
            *self = FrameDelta { is_result: true, numbers, ..Default::default() };
        }
        let first = self.known.len();
        let table = (first < frame.bodies.len()).then(|| body_table(frame, first, &self.numbers));
        let mut message = proto::Frame {
            stage: proto::Stage::from(frame.stage).into(),
            frame_number: to_proto::signed(frame.number),
            time_seconds: frame.time,
            ..Default::default()
        };
        for (id, shown) in frame.bodies.iter().enumerate() {
            let now = shown.as_ref().map(Known::of);
            if self.known.get(id) == Some(&now) {
                continue;
            }
            match now {
                Some(body) => {
                    message.body_indices.push(to_proto::signed(id));
                    message.positions.extend(body.position);
                    message.rotations.extend(body.rotation);
                    message.scales.extend(is_fill.then_some(body.scale));
                }
                None => message.removed_body_indices.push(to_proto::signed(id)),
            }
            match self.known.get_mut(id) {
                Some(known) => *known = now,
                None => self.known.push(now),
            }
        }
        self.add_states(frame, &mut message);
        table.map(Kind::BodyTable).into_iter().chain([Kind::Frame(message)])
    }

    fn add_states(&mut self, frame: &Frame, message: &mut proto::Frame) {
        self.states.resize(frame.bodies.len(), State::Free);
        for (id, (known, shown)) in self.states.iter_mut().zip(frame.bodies).enumerate() {
            let now = shown.map_or(State::Free, |shown| shown.state);
            if *known != now {
                *known = now;
                message.state_body_indices.push(to_proto::signed(id));
                message.states.push(to_proto::body_state(now).into());
            }
        }
    }
}

fn body_table(frame: &Frame, first: usize, numbers: &[usize]) -> proto::BodyTable {
    let stage = if frame.stage == Stage::Fill { Stage::Fill } else { Stage::Release };
    let mut table = proto::BodyTable {
        stage: proto::Stage::from(stage).into(),
        first_body_index: to_proto::signed(first),
        ..Default::default()
    };
    for (id, shown) in frame.bodies.iter().enumerate().skip(first) {
        // A body that was inserted and removed between two frames has neither prop nor pose.
        let known = shown.as_ref().or(frame.comers.get(id));
        let (prop, scale) = known.map_or((0, 0.0), |known| (known.prop, known.scale));
        table.prop_indices.push(to_proto::signed(prop));
        table.scales.push(scale as f32);
        if stage == Stage::Release {
            table.numbers.extend(numbers.get(id).copied().map(to_proto::signed::<_, i32>));
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::pose::Pose;
    use glam::{DQuat, DVec3};

    fn body(x: f64, scale: f64) -> Option<FrameBody> {
        let pose = Pose { translation: DVec3::new(x, 0.0, 0.0), rotation: DQuat::IDENTITY };
        Some(FrameBody { prop: 1, scale, pose, state: State::Free })
    }

    fn messages(
        delta: &mut FrameDelta,
        stage: Stage,
        bodies: &[Option<FrameBody>],
    ) -> (Option<proto::BodyTable>, proto::Frame) {
        let sent: Vec<Kind> = delta.next(&Frame { stage, number: 0, time: 0.0, bodies, comers: &[] }).collect();
        match &sent[..] {
            [Kind::BodyTable(table), Kind::Frame(frame)] => (Some(table.clone()), frame.clone()),
            [Kind::Frame(frame)] => (None, frame.clone()),
            _ => panic!("a table at most, and a frame"),
        }
    }

    #[test]
    fn only_changes_are_sent() {
        let mut delta = FrameDelta::default();
        let (table, frame) = messages(&mut delta, Stage::Fill, &[body(1.0, 0.5), body(2.0, 0.5)]);
        assert_eq!(table.unwrap().prop_indices, [1, 1]);
        assert_eq!((frame.body_indices, frame.scales), (vec![0, 1], vec![0.5, 0.5]));
        let (table, frame) = messages(&mut delta, Stage::Fill, &[body(1.0, 0.5), None, body(3.0, 0.5)]);
        assert_eq!(table.unwrap().first_body_index, 2);
        assert_eq!((frame.body_indices, frame.removed_body_indices), (vec![2], vec![1]));
        let (table, frame) = messages(&mut delta, Stage::Fill, &[body(1.0, 0.6), None, body(3.0, 0.5)]);
        assert_eq!((table, frame.body_indices, frame.scales), (None, vec![0], vec![0.6]));
        assert_eq!((frame.positions, frame.rotations), (vec![1.0, 0.0, 0.0], vec![0.0, 0.0, 0.0, 1.0]));
    }

    #[test]
    fn the_bodies_of_the_result_are_sent_again() {
        let mut delta = FrameDelta::default();
        messages(&mut delta, Stage::Fill, &[body(1.0, 1.0)]);
        let (table, frame) = messages(&mut delta, Stage::Release, &[body(1.0, 1.0)]);
        assert_eq!(table.unwrap().stage(), proto::Stage::Release);
        assert_eq!((frame.body_indices, frame.scales), (vec![0], vec![]));
        let (table, frame) = messages(&mut delta, Stage::Hold, &[body(1.0, 1.0)]);
        assert!(table.is_none() && frame.body_indices.is_empty());
    }

    #[test]
    fn a_body_that_comes_in_later_has_its_prop_and_scale_from_the_beginning() {
        let comers = [body(1.0, 0.5).unwrap(), body(2.0, 0.7).unwrap()];
        let bodies = [Some(comers[0]), None];
        let mut delta = FrameDelta::default();
        let frame = Frame { stage: Stage::Hold, number: 0, time: 0.0, bodies: &bodies, comers: &comers };
        let Some(Kind::BodyTable(table)) = delta.next(&frame).next() else { panic!("no table") };
        assert_eq!((table.prop_indices, table.scales), (vec![1, 1], vec![0.5, 0.7]));
    }

    #[test]
    fn a_state_is_sent_when_it_changes() {
        let mut delta = FrameDelta::default();
        let of = |state| Some(FrameBody { state, ..body(1.0, 1.0).unwrap() });
        let (_, frame) = messages(&mut delta, Stage::Release, &[of(State::Waiting), of(State::Free)]);
        assert_eq!((frame.state_body_indices, frame.states), (vec![0], vec![proto::BodyState::Waiting.into()]));
        let (_, frame) = messages(&mut delta, Stage::Release, &[of(State::Waiting), of(State::Free)]);
        assert_eq!((frame.state_body_indices, frame.states), (vec![], vec![]));
        let (_, frame) = messages(&mut delta, Stage::Release, &[of(State::Free), of(State::Held)]);
        let changed = [proto::BodyState::Unspecified.into(), proto::BodyState::Held.into()];
        assert_eq!((frame.state_body_indices, frame.states), (vec![0, 1], changed.to_vec()));
        assert!(frame.body_indices.is_empty());
    }
}
