//! CPU seconds by stage of the bake.

use cairn_input::observer::{Observer, Stage};
use std::collections::BTreeMap;

/// CPU seconds by stage.
#[derive(Clone)]
pub struct Clock {
    last: f64,
    seconds: BTreeMap<Stage, f64>,
}

impl Clock {
    pub fn new(observer: &mut dyn Observer) -> Clock {
        Clock { last: observer.cpu_seconds(), seconds: BTreeMap::new() }
    }

    /// The time since the last call belongs to this stage.
    pub fn lap(&mut self, stage: Stage, observer: &mut dyn Observer) {
        let now = observer.cpu_seconds();
        *self.seconds.entry(stage).or_default() += now - self.last;
        self.last = now;
    }

    /// The time since the last call belongs to none.
    pub fn skip(&mut self, observer: &mut dyn Observer) {
        self.last = observer.cpu_seconds();
    }

    pub fn into_seconds(self) -> BTreeMap<Stage, f64> {
        self.seconds
    }
}
