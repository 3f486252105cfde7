//! The removals of a report as arrays.

use cairn_export::arrays::Arrays;
use cairn_files::problem::Problem;
use cairn_geometry::pose::Pose;
use cairn_render::Moment;
use cairn_show::taking_apart::RemovedBody;
use std::fmt::Display;
use std::path::Path;

/// What a report says of a pile that was taken apart; at least one removal.
#[derive(serde::Deserialize)]
pub struct Removals {
    #[serde(default)]
    removals: Vec<RemovedBody>,
}

impl Removals {
    pub fn read(path: &Path) -> Result<Removals, Problem> {
        let no_report = |why: &dyn Display| Problem::at(path, format!("not a report: {why}"), "Bake the result again.");
        let read: Removals = serde_json::from_slice(&cairn_files::read(path)?).map_err(|error| no_report(&error))?;
        let bodies = read.removals.first().map_or(0, |first| first.before.len());
        let is_whole = |one: &RemovedBody| {
            let is_body = |body: usize| body < bodies;
            let all = [one.before.len(), one.after.len()];
            let moved = one.moved.iter().all(|(body, _)| is_body(*body));
            let touches = one.touches.iter().all(|touch| is_body(touch.body) && touch.other.is_none_or(is_body));
            all == [bodies; 2] && is_body(one.body) && moved && touches
        };
        match read.removals.iter().all(is_whole) {
            true if bodies > 0 => Ok(read),
            true => {
                let remedy = "Bake the scene with `remove`, or with `cairn batch --remove-sequences`.";
                Err(Problem::at(path, "no body was taken away", remedy))
            }
            false => Err(no_report(&"a removal names a body that is not there")),
        }
    }

    /// Before each removal, and after the last: the last frame in which the pile still rested, and the one in which it
    /// rests again.
    pub fn moments(&self) -> Vec<Moment> {
        let before = self.removals.iter().map(|one| one.frame.saturating_sub(1));
        let after = self.removals.last().map(|last| last.rest_frame.saturating_sub(1));
        before.chain(after).map(|frame| Moment::Frame(frame as u64)).collect()
    }

    /// Adds an array for each field; the first axis of all but `touches` and what belongs to it is the removal, or the
    /// state.
    pub fn add_to(&self, arrays: &mut Arrays) {
        let all = &self.removals;
        let (count, bodies) = (all.len(), all[0].before.len());
        let numbers = |of: fn(&RemovedBody) -> f64| all.iter().map(of).collect::<Vec<f64>>();
        let flags = |of: fn(&RemovedBody) -> bool| all.iter().map(of).collect::<Vec<bool>>();
        let removed: Vec<i32> = all.iter().map(|one| one.body as i32).collect();
        arrays.add("removed", &[count], &removed);
        arrays.add("is_safe", &[count], &flags(|one| one.forecast.as_ref().is_some_and(|said| said.is_safe)));
        arrays.add("is_open", &[count], &flags(|one| one.forecast.as_ref().is_some_and(|said| said.is_open)));
        arrays.add("at_rest", &[count], &flags(|one| one.at_rest));
        arrays.add("speed", &[count], &numbers(|one| one.speed));
        let mut moved = vec![0.0; count * bodies];
        for (k, one) in all.iter().enumerate() {
            one.moved.iter().for_each(|&(body, distance)| moved[k * bodies + body] = distance);
        }
        arrays.add("moved", &[count, bodies], &moved);
        let states = all.iter().map(|one| &one.before).chain(all.last().map(|last| &last.after));
        let row = |Pose { translation, rotation }: &Pose| {
            let (t, r) = (translation.to_array(), rotation.to_array());
            [t[0], t[1], t[2], r[0], r[1], r[2], r[3]]
        };
        let poses: Vec<f64> = states.flatten().flat_map(row).collect();
        arrays.add("poses", &[count + 1, bodies, 7], &poses);
        let touches = || all.iter().enumerate().flat_map(|(k, one)| one.touches.iter().map(move |touch| (k, touch)));
        let ends = |(k, touch): (usize, &cairn_analysis::Touch)| {
            [k as i32, touch.body as i32, touch.other.map_or(-1, |other| other as i32)]
        };
        let edges: Vec<i32> = touches().flat_map(ends).collect();
        let edge_count = edges.len() / 3;
        arrays.add("touches", &[edge_count, 3], &edges);
        let points: Vec<f64> = touches().flat_map(|(_, touch)| touch.point).collect();
        arrays.add("points", &[edge_count, 3], &points);
        let forces: Vec<f64> = touches().flat_map(|(_, touch)| touch.force).collect();
        arrays.add("forces", &[edge_count, 3], &forces);
    }
}
