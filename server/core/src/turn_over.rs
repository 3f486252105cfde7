//! Turning over: gravity points down again. Every body waits in place, on the ground or in the air.

mod hovering;

use cairn_engine::shape::{Shape, corners};
use cairn_engine::world::{Units, World};
use cairn_geometry::interior::DistanceGrid;
use cairn_input::error::Error;
use cairn_input::params::{Params, Switch};
use cairn_input::scene::Scene;
use cairn_motion::control::PileControl;
use cairn_motion::guard::Guard;
use cairn_motion::instance::Instance;
use cairn_motion::pile::Pile;
use cairn_motion::policy::Policy;
use cairn_motion::record::{Pace, Recorder};
use cairn_motion::step::Simulation;
use cairn_prepare::check::FLOATING;
use cairn_prepare::container::Container;
use cairn_prepare::container::core::Core;
use cairn_prepare::effects::{EffectName, Resolved};
use glam::DVec3;

/// A pile before it is turned over.
pub struct TurnOverInputs<'a, 'r> {
    pub scene: &'a Scene,
    pub params: &'a Params,
    pub resolved: &'r Resolved,
    pub shapes: &'a [Shape],
    pub units: Units,
    /// The fill's; upside down, engine units.
    pub bodies: &'r [Instance],
    /// Height of the ground, m.
    pub ground: f64,
    /// Number of them that an earlier pile had there, the first ones.
    pub kept: usize,
    /// What was filled.
    pub container: Option<&'r Container>,
    /// Stands in the pile, where only its surface is made of props.
    pub core: Option<&'a Core>,
    /// The region of the control, engine units; `None`: everywhere.
    pub region: Option<&'a DistanceGrid>,
    /// The pile comes to rest before frame 0, and before anything happens.
    pub settles_first: bool,
}

impl TurnOverInputs<'_, '_> {
    /// Whether the control mesh stands on the ground: a pile in the air starts where it is modelled.
    fn stands(&self) -> bool {
        let low = self.scene.control.as_ref().map(|model| model.mesh.bounds().0.y);
        low.is_some_and(|low| low - self.ground <= FLOATING * self.units.length)
    }
}

/// A body that has fallen this far below all of the scene, in d, can no longer hit anything.
const FALL_DEPTH: f64 = 50.0;

/// The pile right after turning over. In a glued one, bodies that would hover have come down, or are left out.
pub fn run<'a>(inputs: &TurnOverInputs<'a, '_>) -> Result<Simulation<'a>, Error> {
    let mut sim = with_bodies(inputs)?;
    sim.pile.places = (0..inputs.bodies.len()).collect();
    if !inputs.resolved.is_on(EffectName::Glue) || inputs.bodies.is_empty() {
        return Ok(sim);
    }
    let landed = hovering::land(&sim.pile, inputs.bodies.len(), inputs);
    if landed.bodies.is_empty() {
        return Ok(sim);
    }
    let notes = sim.pile.notes;
    let mut sim = with_bodies(&TurnOverInputs { bodies: &landed.bodies, ..*inputs })?;
    sim.pile.notes = notes;
    sim.pile.places = landed.places;
    sim.pile.counters.hovering_lowered = landed.lowered as u64;
    sim.pile.counters.hovering_left_out = landed.left_out as u64;
    if landed.left_out > 0 {
        let bodies = if landed.left_out == 1 { "body was" } else { "bodies were" };
        sim.pile.notes.push(format!(
            "{} {bodies} left out, since no chain of meshes that touch led from what would hover to what stands: \
             smaller props reach further into thin parts",
            landed.left_out
        ));
    }
    Ok(sim)
}

fn with_bodies<'a>(inputs: &TurnOverInputs<'a, '_>) -> Result<Simulation<'a>, Error> {
    let &TurnOverInputs { scene, params, resolved, units, bodies, ground, .. } = inputs;
    let world = world(inputs)?;
    let control = control(inputs, &world);
    let depth = (!params.ground).then(|| units.height_to_engine(scene.lowest().min(ground)) - FALL_DEPTH);
    let floor = depth.map_or(units.height_to_engine(ground), |depth| depth - FALL_DEPTH);
    let guard = Guard::new(scene, params, resolved, units, floor);
    let recorder = Recorder::new(&world, Pace::new(params, resolved.is_on(EffectName::Frames), units));
    let bounces = resolved.is_on(EffectName::Restitution);
    let mut pile = Pile::new(world, scene, inputs.shapes, control, recorder, params, bounces);
    for &body in bodies {
        let id = pile.insert(body)?;
        Policy::wait(&mut pile.world, id);
    }
    for placed in scene.bodies.iter().filter(|placed| placed.is_stacked()) {
        let id = pile.place(placed)?;
        match placed.pinned {
            true => Policy::pin(&mut pile.world, id),
            false => Policy::wait(&mut pile.world, id),
        }
        pile.control.place(id);
    }
    // What an earlier pile had there stands where it was set down then.
    if resolved.is_on(EffectName::Glue) && params.glue.anchor != Switch::Off && inputs.kept == 0 {
        set_down(&mut pile, bodies.len(), inputs);
    }
    pile.world.zero_step();
    Simulation::new(pile, guard, depth, params, inputs.settles_first)
}

/// A pile on a tip or a round foot may have room below it for no prop: it is set down on the ground, or on scenery.
fn set_down(pile: &mut Pile, filled: usize, inputs: &TurnOverInputs) {
    let (is_on_ground, gap) = match inputs.container.filter(|container| container.is_carried(FLOATING)) {
        Some(container) => (true, gap_to_scenery(pile, filled, container)),
        None => {
            let gap = pile.world.lowest(0..filled) - inputs.units.height_to_engine(inputs.ground);
            (inputs.params.ground && inputs.scene.statics.is_empty() && inputs.stands(), gap)
        }
    };
    if !(is_on_ground && inputs.core.is_none() && gap > 0.0 && gap.is_finite()) {
        return;
    }
    for id in 0..filled {
        let pose = &mut pile.instances[id].pose;
        pose.translation.y -= gap;
        pile.world.put(id, pose);
    }
    if gap > FLOATING {
        pile.notes.push(format!(
            "the pile was moved down by {:.3} m as a whole, until it stands: its lowest props do not reach the foot of \
             the shape; smaller props do",
            gap * inputs.units.length
        ));
    }
}

/// The least height of a body's corner above what carries its place, d.
fn gap_to_scenery(pile: &Pile, filled: usize, container: &Container) -> f64 {
    let length = pile.world.units.length;
    let gap = |body: &Instance| {
        let heights = corners(&pile.shapes[body.prop], body.scale / length, &body.pose).map(|p| {
            // A corner that has sunk in a little is still above it.
            p.y - container.support(p + DVec3::Y * FLOATING)
        });
        heights.fold(f64::INFINITY, f64::min)
    };
    pile.instances[..filled].iter().map(gap).fold(f64::INFINITY, f64::min)
}

/// A world with the ground, the core and all scenery that stands still.
fn world(inputs: &TurnOverInputs) -> Result<World, Error> {
    let TurnOverInputs { scene, params, resolved, units, ground, .. } = inputs;
    let mut world = World::new(*units, &resolved.physics, resolved.thickness, resolved.compounds);
    if resolved.is_on(EffectName::Guard) {
        world.watch_bobbing();
    }
    if params.ground {
        world.add_ground(units.height_to_engine(*ground), params.ground_friction);
    }
    for model in scene.statics.iter().filter(|model| model.keys.is_empty()) {
        world.add_scenery(&model.model.mesh, model.friction).map_err(Error::Internal)?;
    }
    if let Some(core) = inputs.core {
        world.add_core(&core.mesh, core.is_convex, params.ground_friction).map_err(Error::Internal)?;
    }
    Ok(world)
}

fn control<'a>(inputs: &TurnOverInputs<'a, '_>, world: &World) -> PileControl<'a> {
    let &TurnOverInputs { params, resolved, region, .. } = inputs;
    PileControl::new(&params.control, resolved, params.gravity, params.seed, world.step_length(), region)
}
