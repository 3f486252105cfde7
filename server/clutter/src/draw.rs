//! What layout number n is made of: its place, its props with their sizes, how they begin. Drawn from the catalogue's
//! seed, the number and the attempt alone.

use crate::Library;
use crate::catalogue::{Arrangement, MOST_BODIES, StartPose};
use cairn_input::scene::Prop;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Share of the room in which props lie that they fill, about: it says how many reach a level.
const PACKING: f64 = 0.4;
/// Bodies of a layout where the catalogue does not say.
const USUAL_COUNT: [f64; 2] = [10.0, 20.0];
/// Share of the bodies that begin beyond those that are to stay, where nothing keeps them in: some leave, or are taken
/// away. Others take their place where too few are left, but then all is shaken again: of shelves of 100, every second
/// one with 0.2, every third with 0.3.
const SPARE: f64 = 0.25;
/// The same where bodies begin on each other.
const SPARE_ON_OTHERS: f64 = 0.3;
/// The same between walls, as far as the range of counts leaves no room below.
const SPARE_IN_WALLS: f64 = 0.08;

/// What a layout is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    pub place: usize,
    pub arrangement: Arrangement,
    pub pose: StartPose,
    /// The prop and the scale of each body that begins.
    pub bodies: Vec<(usize, f64)>,
    /// How many are to stay.
    pub wanted: usize,
    /// The fewest and the most that may stay.
    pub range: [usize; 2],
    /// The body that is looked for, if the catalogue has one.
    pub target: Option<usize>,
}

/// The random numbers of one attempt at a layout.
pub fn numbers(seed: u64, number: u64, attempt: u32) -> Pcg64Mcg {
    let mut hasher = blake3::Hasher::new();
    for part in [seed, number, attempt.into()] {
        hasher.update(&part.to_le_bytes());
    }
    let bytes = *hasher.finalize().as_bytes();
    let (first, _) = bytes.split_first_chunk::<8>().expect("a hash is longer");
    Pcg64Mcg::seed_from_u64(u64::from_le_bytes(*first))
}

/// Draws what an attempt at a layout is made of. Place, arrangement and number of bodies are those of the first
/// attempt: else hard ones would be rare.
pub fn draw(library: &Library, number: u64, rng: &mut Pcg64Mcg) -> Drawn {
    let settings = &library.catalogue.settings;
    let mut first = numbers(library.catalogue.seed(), number, u32::MAX);
    let place = by_weight(library.places.iter().map(|place| place.weight), &mut first);
    let arrangements = settings.arrangement.as_ref().map_or(vec![Arrangement::Scattered], |all| all.all());
    let arrangement = arrangements[first.random_range(0..arrangements.len())];
    let poses = settings.pose.as_ref().map_or(vec![StartPose::Any], |all| all.all());
    let pose = poses[first.random_range(0..poses.len())];
    let props = &library.scene().props;
    let mut bodies = Vec::new();
    let found = &library.places[place];
    let (wanted, range) = match (found.level, found.volume) {
        (Some(level), Some(volume)) => {
            let [least, most] = level.ends();
            let share = least + first.random::<f64>() * (most - least);
            let wanted = PACKING * share * volume;
            let mut filled = 0.0;
            while bodies.len() < MOST_BODIES as usize {
                let (prop, scale) = draw_body(library, rng);
                filled += library.shapes[prop].volume * scale.powi(3);
                if filled > wanted && !bodies.is_empty() {
                    break;
                }
                bodies.push((prop, scale));
            }
            (bodies.len(), [1, bodies.len()])
        }
        _ => {
            let [least, most] = found.count.or(settings.count).map_or(USUAL_COUNT, |count| count.ends());
            let range = [least as usize, most as usize];
            let count = first.random_range(range[0]..=range[1]);
            let spare = |share: f64| (share * count as f64).ceil() as usize;
            let more = match found.surfaces.has_walls {
                true => spare(SPARE_IN_WALLS).saturating_sub(count - range[0]),
                false if arrangement == Arrangement::Scattered => spare(SPARE),
                false => spare(SPARE_ON_OTHERS),
            };
            bodies.extend((0..count + more).map(|_| draw_body(library, rng)));
            (count, range)
        }
    };
    let target = settings.target.as_ref().map(|target| {
        let named: Vec<usize> = (0..props.len()).filter(|&prop| library.labels[prop] == target.label).collect();
        let there = bodies.iter().position(|(prop, _)| named.contains(prop));
        there.unwrap_or_else(|| {
            let prop = named[rng.random_range(0..named.len())];
            let body = rng.random_range(0..bodies.len());
            bodies[body] = (prop, scale(&props[prop], rng));
            body
        })
    });
    Drawn { place, arrangement, pose, bodies, wanted, range, target }
}

/// Draws as many more bodies.
pub fn draw_more(library: &Library, count: usize, rng: &mut Pcg64Mcg) -> Vec<(usize, f64)> {
    (0..count).map(|_| draw_body(library, rng)).collect()
}

/// A prop and a scale.
fn draw_body(library: &Library, rng: &mut Pcg64Mcg) -> (usize, f64) {
    let props = &library.scene().props;
    let prop = by_weight(props.iter().map(|prop| prop.weight), rng);
    (prop, scale(&props[prop], rng))
}

/// An index, drawn by weight.
fn by_weight(weights: impl Iterator<Item = f64> + Clone, rng: &mut Pcg64Mcg) -> usize {
    let sum: f64 = weights.clone().sum();
    let mut left = rng.random::<f64>() * sum;
    let mut last = 0;
    for (i, weight) in weights.enumerate().filter(|(_, weight)| *weight > 0.0) {
        last = i;
        left -= weight;
        if left < 0.0 {
            break;
        }
    }
    last
}

fn scale(prop: &Prop, rng: &mut Pcg64Mcg) -> f64 {
    let [least, most] = prop.scale;
    if most > least { least + rng.random::<f64>() * (most - least) } else { least }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_number_and_each_attempt_has_numbers_of_its_own() {
        let first = |seed, number, attempt| numbers(seed, number, attempt).random::<u64>();
        let all = [first(1, 0, 0), first(1, 1, 0), first(1, 0, 1), first(2, 0, 0), first(1, 256, 0)];
        let distinct: std::collections::BTreeSet<u64> = all.iter().copied().collect();
        assert_eq!(distinct.len(), all.len());
        assert_eq!(first(1, 7, 2), first(1, 7, 2));
    }

    #[test]
    fn weights_count() {
        let mut rng = numbers(1, 0, 0);
        let mut counts = [0; 4];
        (0..4000).for_each(|_| counts[by_weight([1.0, 0.0, 2.0, 1.0].into_iter(), &mut rng)] += 1);
        assert_eq!(counts[1], 0);
        assert!((1900..2100).contains(&counts[2]) && (900..1100).contains(&counts[0]), "{counts:?}");
    }
}
