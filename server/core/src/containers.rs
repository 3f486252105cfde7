//! The containers of a scene, and the fill of several.

use super::fill::{self, FillTask, Filled};
use super::keep::Kept;
use cairn_engine::shape::Shape;
use cairn_engine::world::Units;
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Progress};
use cairn_input::params::Params;
use cairn_input::scene::Scene;
use cairn_prepare::check::CheckedScene;
use cairn_prepare::container::Container;
use cairn_prepare::effects::{EffectName, Resolved};
use cairn_prepare::surroundings::Surroundings;
use std::ops::ControlFlow;

/// The container, if anything is filled. `surroundings`: of the control mesh.
pub fn of(
    scene: &Scene,
    params: &Params,
    checked: &CheckedScene,
    surroundings: Option<Surroundings>,
    resolved: &Resolved,
    units: &Units,
) -> Option<Container> {
    let control = checked.control.as_ref().filter(|_| resolved.is_on(EffectName::Fill))?;
    let is_simplified = resolved.is_on(EffectName::WallSimplification);
    let tolerance = if is_simplified { params.fill.wall_tolerance } else { 0.0 };
    let container = Container::new(control, units, checked.ground, tolerance);
    let container = match &checked.core {
        Some(core) => container.around(core, units),
        None => container,
    };
    Some(match surroundings {
        Some(surroundings) => container.apart_from(surroundings, scene, &checked.sizes),
        None => container,
    })
}

/// What the fills of several shapes share.
pub struct CommonFill<'a> {
    pub scene: &'a Scene,
    /// Shape `[prop]`.
    pub shapes: &'a [Shape],
    pub params: &'a Params,
    pub resolved: &'a Resolved,
    pub units: Units,
    /// What stays of an earlier pile.
    pub kept: Option<&'a Kept>,
}

/// Fills several shapes, one after the other: each leaves the bodies of those before it alone. `piles`: each with its
/// surroundings.
pub fn fill_all<'a>(
    common: &CommonFill,
    piles: impl ExactSizeIterator<Item = (&'a CheckedScene, Option<Surroundings>)>,
    observer: &mut dyn Observer,
) -> Result<Filled, Error> {
    let &CommonFill { scene, shapes, params, resolved, units, kept } = common;
    let count = piles.len();
    let mut all: Option<(Filled, f64)> = None;
    for (index, (checked, around)) in piles.enumerate() {
        let (own, mut params) = (scene.of_pile(index), scene.params_of_pile(index, params));
        let others = all.as_ref().map_or(&[][..], |(filled, _)| &filled.bodies);
        let there = others.len() + kept.map_or(0, |kept| kept.instances.len());
        let left = (params.fill.max_bodies as usize).saturating_sub(there);
        params.fill.max_bodies = u32::try_from(left).unwrap_or(u32::MAX);
        let Some(container) = of(&own, &params, checked, around, resolved, &units).filter(|_| left > 0) else {
            all.iter_mut().for_each(|(filled, _)| filled.full = false);
            break;
        };
        let mut part = PartOfFill { to: observer, begin: index as f64 / count as f64, share: 1.0 / count as f64 };
        let task = FillTask::new(&own, shapes, &params, units, &container, kept);
        let filled = fill::run(task, others, &mut part)?;
        match &mut all {
            None => all = Some((filled, container.volume)),
            Some((joined, volume)) => {
                *volume += container.volume;
                joined.join(filled, container.volume / *volume);
            }
        }
    }
    all.map(|(filled, _)| filled).ok_or_else(|| Error::Internal("no shape was filled".into()))
}

/// Shows the fill of one of several shapes as a part of all.
struct PartOfFill<'a> {
    to: &'a mut dyn Observer,
    begin: f64,
    share: f64,
}

impl Observer for PartOfFill<'_> {
    fn progress(&mut self, progress: &Progress) -> ControlFlow<()> {
        self.to.progress(&Progress { fraction: self.begin + self.share * progress.fraction, ..*progress })
    }

    fn cpu_seconds(&mut self) -> f64 {
        self.to.cpu_seconds()
    }

    fn wants_frames(&self) -> bool {
        // Its frames would show one shape after the other, each without those before it.
        false
    }
}
