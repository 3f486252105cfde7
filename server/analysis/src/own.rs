//! How far each body is from moving while its neighbours are held.

use super::{AZIMUTHS, Going, PileContacts};
use cairn_input::error::Error;
use cairn_statics::global::GlobalBody;
use cairn_statics::local::{Analyser, LocalContact, LocalProblem};
use glam::DVec3;

/// Larger pushes are not distinguished, in weights: a tilt of 84 degrees.
pub const MOST_PUSH: f64 = 10.0;
/// The least friction is found to this share.
const HALVINGS: u32 = 10;

/// The margins of one body.
#[derive(Clone, Debug, Default)]
pub struct Own {
    /// It falls even so.
    pub falls: bool,
    /// The share of friction that suffices.
    pub friction: Option<f64>,
    /// The least push, in its weight, and its direction, degrees from +Z toward +X.
    pub push: Option<(f64, f64)>,
    /// The least push in each direction; empty if it falls. Shape `[azimuth]`.
    pub pushes: Vec<f64>,
}

/// A direction across gravity, and its azimuth in degrees.
pub fn way(k: usize) -> (DVec3, f64) {
    let azimuth = k as f64 * 360.0 / AZIMUTHS as f64;
    let (sin, cos) = libm::sincos(azimuth.to_radians());
    (DVec3::new(sin, 0.0, cos), azimuth)
}

/// Shape `[body]`.
pub fn of(pile: &PileContacts, going: &mut Going) -> Result<Vec<Own>, Error> {
    let touching = pile.touching(&vec![false; pile.bodies.len()]);
    going.on(0.1)?;
    let ways: Vec<(DVec3, f64)> = (0..AZIMUTHS).map(way).collect();
    let directions: Vec<DVec3> = ways.iter().map(|(way, _)| *way).collect();
    let mut analyser = Analyser::new();
    let one = |(body, contacts): (&GlobalBody, &Vec<LocalContact>)| {
        let &GlobalBody { mass, center_of_mass, radius } = body;
        let problem = LocalProblem { contacts, mass, center_of_mass, radius, gravity: DVec3::NEG_Y };
        let Ok(Some(pushes)) = analyser.pushes(&problem, &directions, MOST_PUSH) else {
            return Own { falls: true, ..Own::default() };
        };
        let least = pushes.iter().copied().fold(MOST_PUSH, f64::min);
        let azimuth =
            pushes.iter().zip(&ways).find(|(push, _)| **push <= least).map_or(0.0, |(_, (_, azimuth))| *azimuth);
        let mut stands = |share: f64| {
            let weaker: Vec<LocalContact> =
                contacts.iter().map(|c| LocalContact { friction: share * c.friction, ..*c }).collect();
            let problem = LocalProblem { contacts: &weaker, ..problem };
            analyser.analyse(&problem, &Default::default()).is_ok_and(|verdict| verdict.is_stable())
        };
        let (mut low, mut high) = (0.0, 1.0);
        if stands(0.0) {
            high = 0.0;
        }
        for _ in 0..if high > 0.0 { HALVINGS } else { 0 } {
            let middle = (low + high) / 2.0;
            if stands(middle) { high = middle } else { low = middle }
        }
        Own { falls: false, friction: Some(high), push: Some((least, azimuth)), pushes }
    };
    Ok(pile.bodies.iter().zip(&touching).map(one).collect())
}
