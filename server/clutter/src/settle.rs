//! Lets the bodies of a layout fall until they rest, and tries whether they stay.
//!
//! Engines differ most in friction: that of MuJoCo yields, so that a body that leans on friction creeps. Hence bodies
//! settle with next to none, and on ground that tilts a little to four sides in between: what could roll or tip has
//! done so. Then statics asks whether each body stands a small push to any side: one whose center of mass is right
//! above an edge of what it stands on tips where contacts yield. The trial asks whether they also rest on contacts as
//! soft as theirs. Where too few bodies are left, others fall among them, and all of it again.

use crate::Library;
use crate::arrange::{self, Start};
use crate::draw::{Drawn, draw_more};
use crate::pile::Pile;
use crate::proof::{self, MOST_DRIFT};
use cairn_engine::world::{BodyId, REST_SPEED, World};
use glam::DVec3;
use rand_pcg::Pcg64Mcg;

/// Bodies that move for longer than this go, characteristic times: of some 10 cm, 5 s. If others still move after as
/// long, the layout is drawn again.
const PATIENCE: f64 = 50.0;
/// It rests once no body has moved for this long, characteristic times.
const REST_TIME: f64 = 1.0;
/// Bodies have landed once all but this share have been slower than this, d per characteristic time, for so many steps,
/// or after so many characteristic times. What rolls may roll on.
const STILL_FAST: f64 = 0.06;
const SLOW: f64 = 0.1;
const SLOW_STEPS: u64 = 6;
const LANDING: f64 = 20.0;
/// Steps between two looks for bodies that have left the place.
const LOOK: u64 = 16;
/// The ground tilts by this much to each of four sides, degrees, each time for so long, characteristic times. Of 80
/// layouts of household objects, 65 stood in MuJoCo without it, 70 with 2 degrees, and 75 with 4. 100 trays and 50
/// tables all stood with this time; with three quarters of it, and a landing that ended sooner, 2 of 100 did not.
const TILT: f64 = 4.0;
const TILT_TIME: f64 = 2.0;
/// Steps are at least this long until bodies rest for the first time, characteristic times: with half as long ones, as
/// many layouts stand, and one takes nearly twice as long.
const COARSE_STEP: f64 = 0.1;
/// Bodies are parted until they overlap by this share of the thinner one's thickness at most.
const RESIDUAL: f64 = 0.01;
/// Steps in which bodies are parted at most.
const MOST_PARTING: u64 = 60;
/// Times that bodies at fault are taken away at most.
const ROUNDS: usize = 8;
/// Times that others take the place of bodies that were taken away, at most, and how many for each that lacks.
const MOST_REFILLS: u32 = 3;
const MORE: f64 = 1.5;
/// Share of the bodies that are tried beyond those that are wanted, where nothing keeps them in.
const RESERVE: f64 = 0.03;

/// Why an attempt is no layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// There was no room for as many bodies as were to be there.
    NoRoom,
    /// Too many bodies left the place, or one lies on its rim.
    NotContained,
    /// Bodies still moved after a long time.
    NotAtRest,
    /// Bodies overlap.
    Overlap,
    /// A body moved in the trial.
    Drift,
    /// A body stands so close to tipping that a small push does it.
    Tips,
    /// A body moved in MuJoCo.
    DriftInMujoco,
    /// Too many or too few bodies rest on the target.
    Covered,
    /// As the camera sees them, bodies hide too much or too little of each other.
    OverlapInView,
    /// As the camera sees it, too much or too little of the target is hidden.
    TargetInView,
}

/// A layout at rest.
pub struct Settled<'a> {
    pub pile: Pile<'a>,
    /// Largest overlap of two bodies, or of one and the place, m.
    pub overlap: f64,
    /// The least push that a body stands, weights; `None`: none was tried.
    pub push: Option<f64>,
    /// The largest way of a body in the trial, m; `None`: there was none.
    pub drift: Option<f64>,
}

/// Lets bodies fall until they rest, and takes away those that do not stand.
///
/// `is_tried`: each body has to stand a push and a trial.
pub fn settle<'a>(
    library: &'a Library,
    drawn: &'a Drawn,
    starts: &[Start],
    is_tried: bool,
    rng: &mut Pcg64Mcg,
) -> Result<Settled<'a>, Rejection> {
    let mut pile = Pile::new(library, drawn, starts);
    fall(&mut pile)?;
    shake(&mut pile)?;
    prove(pile, is_tried, rng)
}

/// Adds bodies, and lets them fall.
fn refill(pile: &mut Pile, count: usize, rng: &mut Pcg64Mcg) -> Result<(), Rejection> {
    let bodies = draw_more(pile.library, count, rng);
    let starts = arrange::add(pile, &bodies, rng);
    pile.add(&starts);
    fall(pile)
}

/// Lets bodies fall until nearly all have landed.
fn fall(pile: &mut Pile) -> Result<(), Rejection> {
    let (library, place) = (pile.library, pile.drawn.place);
    let own = &library.params.physics;
    let usual = library.units.duration(own.step);
    pile.world.use_step_and_contacts_of(usual.max(COARSE_STEP), own, library.thickness);
    // Nothing else keeps what rolls and slides on a table.
    let most =
        if library.places[place].surfaces.has_walls { library.catalogue.settle_friction() } else { f64::INFINITY };
    use_friction(library, place, &mut pile.world, most);
    pile.world.zero_step();
    until_slow(pile)
}

/// What could roll, slide or tip does so; then all rest.
fn shake(pile: &mut Pile) -> Result<(), Rejection> {
    let (library, place) = (pile.library, pile.drawn.place);
    let own = &library.params.physics;
    use_friction(library, place, &mut pile.world, library.catalogue.settle_friction());
    pile.world.roll_freely();
    tilt(&mut pile.world)?;
    use_friction(library, place, &mut pile.world, library.rest_friction());
    until_rest(pile)?;
    pile.world.use_step_and_contacts_of(library.units.duration(own.step), own, library.thickness);
    until_rest(pile)?;
    let going = |steps: u64| Ok::<bool, std::convert::Infallible>(steps < MOST_PARTING);
    let Ok(parted) = pile.world.depenetrate(RESIDUAL, going);
    if parted > 0 {
        until_rest(pile)?;
    }
    use_friction(library, place, &mut pile.world, f64::INFINITY);
    Ok(())
}

/// Takes away what is at fault, until nothing is.
fn prove<'a>(mut pile: Pile<'a>, is_tried: bool, rng: &mut Pcg64Mcg) -> Result<Settled<'a>, Rejection> {
    let (library, drawn) = (pile.library, pile.drawn);
    let reserve = match library.places[drawn.place].surfaces.has_walls {
        true => 0,
        false => (RESERVE * drawn.wanted as f64).ceil() as usize,
    };
    let mut last = Rejection::Tips;
    let mut refills = 0;
    for _ in 0..ROUNDS {
        let found = proof::faults(&pile, is_tried);
        if let Some(&(_, why)) = found.faults.first() {
            last = why;
            let touched = pile.take_away(&found.faults)?;
            settle_again(&mut pile, touched, last, &mut refills, rng)?;
            continue;
        }
        if pile.take_spare(drawn.wanted + reserve, false) {
            calm(&mut pile)?;
            continue;
        }
        let mut drift = None;
        if is_tried {
            let moved = proof::drifts(&pile);
            let bound = MOST_DRIFT * library.units.length;
            let far: Vec<_> =
                moved.iter().filter(|(_, way)| *way > bound).map(|&(id, _)| (id, Rejection::Drift)).collect();
            if !far.is_empty() {
                last = Rejection::Drift;
                let touched = pile.take_away(&far)?;
                if settle_again(&mut pile, touched, last, &mut refills, rng)? {
                    continue;
                }
            }
            let stays = |&&(id, _): &&(BodyId, f64)| pile.world.is_present(id);
            drift = Some(moved.iter().filter(stays).map(|&(_, way)| way).fold(0.0, f64::max));
        }
        // What touches no other body goes, and the others need not be tried again.
        pile.take_spare(drawn.wanted, true);
        if pile.take_spare(drawn.range[1], false) {
            calm(&mut pile)?;
            continue;
        }
        let stand = found.pushes.iter().filter(|(id, _)| pile.world.is_present(*id));
        let push = is_tried.then(|| stand.map(|&(_, push)| push).fold(proof::MOST_PUSH, f64::min));
        return Ok(Settled { overlap: proof::overlap(&pile.world), push, drift, pile });
    }
    Err(last)
}

/// After bodies were taken away: others take their place if too few are left. Returns whether any body has moved.
fn settle_again(
    pile: &mut Pile,
    touched: bool,
    why: Rejection,
    refills: &mut u32,
    rng: &mut Pcg64Mcg,
) -> Result<bool, Rejection> {
    if pile.lacks() {
        if *refills >= MOST_REFILLS {
            return Err(why);
        }
        *refills += 1;
        let lacking = (pile.drawn.wanted - pile.count()) as f64;
        refill(pile, (MORE * lacking).ceil() as usize, rng)?;
        shake(pile)?;
        return Ok(true);
    }
    if touched {
        calm(pile)?;
    }
    Ok(touched)
}

/// Lets those rest again that bodies which were taken away had touched: these are awake.
fn calm(pile: &mut Pile) -> Result<(), Rejection> {
    let (library, place) = (pile.library, pile.drawn.place);
    use_friction(library, place, &mut pile.world, library.catalogue.settle_friction());
    until_rest(pile)?;
    use_friction(library, place, &mut pile.world, f64::INFINITY);
    Ok(())
}

/// Gives bodies and place their own friction, at most this.
pub fn use_friction(library: &Library, place: usize, world: &mut World, most: f64) {
    let scene = library.scene();
    for &wall in &library.places[place].walls {
        world.set_wall_friction(wall, scene.statics[place].friction.min(most));
    }
    for id in world.present().collect::<Vec<_>>() {
        let prop = world.bodies()[id].prop;
        world.set_friction(id, scene.props[prop].friction.min(most));
    }
}

/// Tilts the ground to four sides.
fn tilt(world: &mut World) -> Result<(), Rejection> {
    let (sin, cos) = libm::sincos(TILT.to_radians());
    let steps = (TILT_TIME / world.step_length()).ceil() as u64;
    for side in [DVec3::X, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Z] {
        world.set_gravity(DVec3::NEG_Y * cos + side * sin);
        for _ in 0..steps {
            if !world.step().is_empty() {
                return Err(Rejection::NotContained);
            }
        }
    }
    world.set_gravity(DVec3::NEG_Y);
    Ok(())
}

/// Until nearly all bodies have landed.
fn until_slow(pile: &mut Pile) -> Result<(), Rejection> {
    let most = (LANDING / pile.world.step_length()).ceil() as u64;
    let mut slow = 0;
    for step in 0..most {
        if !pile.world.step().is_empty() {
            return Err(Rejection::NotContained);
        }
        if step % LOOK == 0 {
            // One that falls past the place would never be slow.
            pile.forget_left()?;
        }
        let world = &pile.world;
        let fast = world.present().filter(|&id| world.speed(id) >= SLOW).count();
        slow = if fast as f64 <= STILL_FAST * pile.count() as f64 { slow + 1 } else { 0 };
        if slow >= SLOW_STEPS {
            break;
        }
    }
    Ok(())
}

fn until_rest(pile: &mut Pile) -> Result<(), Rejection> {
    let most = (PATIENCE / pile.world.step_length()).ceil() as u64;
    let rest = (REST_TIME / pile.world.step_length()).ceil() as u64;
    let is_moving = |world: &World, id: &BodyId| world.speed(*id) >= REST_SPEED;
    for _ in 0..2 {
        let mut still = 0;
        for step in 0..most {
            if !pile.world.step().is_empty() {
                return Err(Rejection::NotContained);
            }
            if step % LOOK == 0 {
                pile.forget_left()?;
            }
            still = if pile.world.present().any(|id| is_moving(&pile.world, &id)) { 0 } else { still + 1 };
            if still >= rest {
                return Ok(());
            }
        }
        let moving = pile.world.present().filter(|id| is_moving(&pile.world, id));
        let moving: Vec<_> = moving.map(|id| (id, Rejection::NotAtRest)).collect();
        pile.take_away(&moving)?;
    }
    Err(Rejection::NotAtRest)
}
