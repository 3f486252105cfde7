//! The ratios of sizes and masses among a scene's bodies, and the engine's settings for them.

use cairn_input::params::{Params, Physics, Switch};
use cairn_input::scene::Scene;

/// Beyond this ratio of sizes the small bodies are simulated coarsely, and the user is warned.
pub const MOST_SIZE_RATIO: f64 = 100.0;
/// Beyond this ratio of masses a heavy body sinks into a light one, and the user is warned.
pub const MOST_MASS_RATIO: f64 = 1000.0;

/// Square of the contact frequency, per characteristic time, that a light body needs under one of its own mass; it
/// grows with the ratio of the masses. Measured on two cubes: at a frequency of 1, the light one sinks by a tenth of
/// its edge times that ratio, and it may sink by 0.008 of it.
const STIFFNESS: f64 = 12.5;

/// The bodies that the world will have: their props, each with the value of one that may occur.
fn bodies<'a>(
    scene: &'a Scene,
    params: &Params,
    value: impl Fn(usize, f64, Option<f64>) -> f64 + 'a,
) -> impl Iterator<Item = (usize, f64)> + 'a {
    let fills = scene.is_filled(params);
    let drawn = move |i: usize| {
        scene.props[i].weight > 0.0 && (fills || scene.emitters.iter().any(|e| scene.emitted(e).any(|k| k == i)))
    };
    let ends =
        (0..scene.props.len()).filter(move |&i| drawn(i)).flat_map(|i| scene.props[i].scale.map(|s| (i, s, None)));
    // Kept bodies carry like scenery. Bodies thrown in later are no part of the pile: where they sink in, the guard
    // acts.
    let moving = scene.bodies.iter().filter(|b| b.is_stacked() && (!b.pinned || b.pinned_until.is_some()));
    let given = moving.map(|b| (b.prop, b.scale, b.mass));
    ends.chain(given).map(move |(prop, scale, mass)| (prop, value(prop, scale, mass)))
}

/// The largest value over the smallest, and the props that have them.
fn ratio(values: impl Iterator<Item = (usize, f64)>) -> Option<(f64, usize, usize)> {
    let all: Vec<(usize, f64)> = values.collect();
    let least = all.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let most = all.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    (least.1 > 0.0).then(|| (most.1 / least.1, least.0, most.0))
}

/// Largest mass over smallest; 1 without bodies. `mass`: of a prop at scale 1, kg.
pub fn mass_ratio(scene: &Scene, params: &Params, mass: impl Fn(usize) -> f64) -> f64 {
    let of = move |prop: usize, scale: f64, kg: Option<f64>| kg.unwrap_or_else(|| mass(prop) * scale.powi(3));
    ratio(bodies(scene, params, of)).map_or(1.0, |found| found.0)
}

/// Smallest thickness that a body may have, m; infinite without bodies. `thickness`: of a prop at scale 1, m.
pub fn least_thickness(scene: &Scene, params: &Params, thickness: impl Fn(usize) -> f64) -> f64 {
    let filled = (0..scene.props.len()).filter(|&i| scene.is_filled(params) && scene.props[i].weight > 0.0);
    let emitted = scene.emitters.iter().flat_map(|e| scene.emitted(e));
    let drawn = filled.chain(emitted).map(|i| (i, scene.props[i].scale[0]));
    let placed = scene.bodies.iter().map(|body| (body.prop, body.scale));
    drawn.chain(placed).map(|(prop, scale)| thickness(prop) * scale).fold(f64::INFINITY, f64::min)
}

/// Warnings about sizes and masses that are too far apart. `diameter` (m) and `mass` (kg): of a prop at scale 1.
pub fn warnings(
    scene: &Scene,
    params: &Params,
    diameter: impl Fn(usize) -> f64,
    mass: impl Fn(usize) -> f64,
) -> Vec<String> {
    let name = |prop: usize| scene.props[prop].model.name.as_str();
    let size_of = |prop: usize, scale: f64, _| diameter(prop) * scale;
    let sizes = ratio(bodies(scene, params, size_of)).filter(|found| found.0 > MOST_SIZE_RATIO * 1.001);
    let sizes = sizes.map(|(ratio, small, large)| {
        format!(
            "sizes differ by {ratio:.0}:1 ({} and {}); beyond {MOST_SIZE_RATIO:.0}:1 the small ones are simulated \
             coarsely: bake them apart, or bring the sizes nearer to each other",
            name(small),
            name(large)
        )
    });
    let mass_of = |prop: usize, scale: f64, kg: Option<f64>| kg.unwrap_or_else(|| mass(prop) * scale.powi(3));
    let masses = ratio(bodies(scene, params, mass_of)).filter(|found| found.0 > MOST_MASS_RATIO * 1.001);
    let masses = masses.map(|(ratio, light, heavy)| {
        format!(
            "masses differ by {ratio:.0}:1 ({} and {}); beyond {MOST_MASS_RATIO:.0}:1 a heavy body sinks into a light \
             one below it: bring densities or sizes nearer to each other",
            name(light),
            name(heavy)
        )
    });
    sizes.into_iter().chain(masses).collect()
}

/// The engine's settings under which a heavy body does not sink into a light one: contacts as stiff as the ratio of the
/// masses (up to [`MOST_MASS_RATIO`]) needs. `thickness`: of the thinnest body, in d; a thin one stiffens the contacts
/// by itself.
pub fn stiffened(physics: &Physics, ratio: f64, thickness: f64) -> Physics {
    let ratio = match physics.switches.stiff_contacts {
        Switch::Auto => ratio.min(MOST_MASS_RATIO),
        Switch::On => MOST_MASS_RATIO,
        Switch::Off => return physics.clone(),
    };
    let needed = (STIFFNESS * ratio).sqrt();
    let given = physics.stiffness(thickness);
    if needed <= given {
        return physics.clone();
    }
    Physics { contact_frequency: physics.contact_frequency * needed / given, ..physics.clone() }
}

/// As many substeps as a pile of such contacts needs to stand calmly. `thickness`: as in [`stiffened`].
pub fn calmed(physics: &Physics, thickness: f64, characteristic_time: f64) -> Physics {
    let step = physics.step.seconds(characteristic_time) / characteristic_time;
    Physics { substeps: physics.calm_substeps_for(physics.stiffness(thickness), step), ..physics.clone() }
}
