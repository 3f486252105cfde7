//! A lower bound on the number of joints of any choice.

use super::{GlueOptions, GlueProblem};
use crate::local::{Analyser, LocalContact, LocalProblem};

/// A body that its contacts cannot hold even among fixed neighbours (its local certificate proves that) needs a joint,
/// and a joint serves at most two bodies. `fallen`: bodies that are not there. Shape `[body]`.
pub fn at_least(pile: &GlueProblem, options: &GlueOptions, fallen: &[bool]) -> usize {
    let mut contacts: Vec<Vec<LocalContact>> = vec![Vec::new(); pile.bodies.len()];
    for c in pile.contacts {
        if fallen[c.body] || c.other.is_some_and(|other| fallen[other]) {
            continue;
        }
        let contact = LocalContact { point: c.point, normal: c.normal, friction: c.friction * options.friction_factor };
        contacts[c.body].push(contact);
        if let Some(other) = c.other {
            contacts[other].push(LocalContact { normal: -c.normal, ..contact });
        }
    }
    let mut analyser = Analyser::new();
    let mut needs = vec![false; pile.bodies.len()];
    for (index, (body, contacts)) in pile.bodies.iter().zip(&contacts).enumerate() {
        let problem = LocalProblem {
            contacts,
            mass: body.mass,
            center_of_mass: body.center_of_mass,
            radius: body.radius,
            gravity: pile.gravity,
        };
        let verdict = analyser.analyse(&problem, &Default::default());
        needs[index] = !fallen[index] && verdict.is_ok_and(|verdict| !verdict.is_stable());
    }
    let mut beside_another = vec![false; needs.len()];
    for site in pile.sites {
        if let Some(other) = site.other.filter(|&other| site.may_glue && needs[site.body] && needs[other]) {
            beside_another[site.body] = true;
            beside_another[other] = true;
        }
    }
    let count = |all: &[bool]| all.iter().filter(|yes| **yes).count();
    count(&needs) - count(&beside_another) / 2
}
