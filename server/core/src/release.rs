//! Release: layer after layer begins to move, from the bottom to the top, while the control strengthens the pile
//! (paper, 4.1, example 2). A body that still waits when nothing carries it any more is released at once.

mod carriers;

use cairn_engine::world::{BodyId, Role, World};
use cairn_input::error::Error;
use cairn_input::observer::{Observer, Stage};
use cairn_input::params::{Params, ReleaseOrder, Switch};
use cairn_motion::step::Simulation;
use carriers::Carriers;
use glam::DVec3;
use std::collections::BTreeMap;

/// The withdrawal of the control follows the release at this distance, characteristic times. Bodies that are held for
/// longer seem to stand, and then fall; piles whose bodies are held for less keep a little less of their shape.
const LAG: f64 = 1.0;

/// Releases the layers one after the other. `stands`: the control is withdrawn behind them, so that the pile stands by
/// itself. `support`: height of what carries a place, engine units.
pub fn run(
    sim: &mut Simulation,
    params: &Params,
    order: ReleaseOrder,
    stands: bool,
    support: &dyn Fn(DVec3) -> f64,
    observer: &mut dyn Observer,
) -> Result<(), Error> {
    let world = &sim.pile.world;
    let interval = (world.units.duration(params.release.interval) / world.step_length()).round().max(1.0) as u64;
    let layers = layers(world, params.release.layer, order, support);
    let total = layers.len() as u64 * interval;
    sim.show(observer, Stage::Release);
    if stands && params.control.until.is_none() && params.control.stand != Switch::On && sim.pile.control.is_on() {
        sim.pile.withdraw_control(LAG);
    }
    let mut carriers = Carriers::default();
    for layer in layers {
        sim.pile.counters.layers += 1;
        let waits = |id: &BodyId| sim.pile.world.bodies()[*id].role == Role::Waiting;
        let layer: Vec<BodyId> = layer.into_iter().filter(waits).collect();
        layer.into_iter().for_each(|id| sim.pile.release(id));
        for _ in 0..interval {
            let lost = carriers.lost(&mut sim.pile);
            sim.pile.counters.released_early += lost.len() as u64;
            lost.into_iter().for_each(|id| sim.pile.release(id));
            sim.advance(observer, Stage::Release, |sim| sim.pile.step as f64 / total as f64)?;
        }
    }
    sim.pile.recorder.begin_hold();
    Ok(())
}

/// Waiting bodies by the height of their centre of mass above what carries the pile there, in slices of `thickness`
/// from the lowest on; empty slices are left out.
fn layers(world: &World, thickness: f64, order: ReleaseOrder, support: &dyn Fn(DVec3) -> f64) -> Vec<Vec<BodyId>> {
    let height = |id: BodyId| {
        let place = world.pose(id).translation;
        place.y - support(place)
    };
    let waiting = || world.present().filter(|&id| world.bodies()[id].role == Role::Waiting);
    let lowest = waiting().map(height).fold(f64::INFINITY, f64::min);
    let mut slices = BTreeMap::<u64, Vec<BodyId>>::new();
    for id in waiting() {
        slices.entry(((height(id) - lowest) / thickness) as u64).or_default().push(id);
    }
    let slices = slices.into_values();
    match order {
        ReleaseOrder::BottomUp => slices.collect(),
        ReleaseOrder::TopDown => slices.rev().collect(),
        ReleaseOrder::AtOnce => slices.reduce(|all, slice| [all, slice].concat()).into_iter().collect(),
    }
}
