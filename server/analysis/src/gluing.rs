//! Where glue is needed for a pile that does not stand.

use super::{Going, PileContacts};
use cairn_input::error::Error;
use cairn_statics::glue::{self, GlueError, GlueOptions, GlueProblem, GlueSite, MOST_ROUNDS};
use glam::DVec3;

/// A moment counts as the force that causes it at this share of the smaller radius, as for the glue of a bake.
const ARM: f64 = 0.25;
/// The glue is to hold with this share of friction.
const FRICTION: f64 = 0.5;

/// A dot of glue.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct NeededDot {
    pub body: usize,
    /// The other body; `None`: the ground or scenery.
    pub other: Option<usize>,
    /// m.
    pub point: [f64; 3],
    /// What it has to hold, N.
    pub force: f64,
}

/// Few dots with which the pile stands, and the bodies that no dot at a contact holds.
pub fn of(pile: &PileContacts, going: &mut Going) -> Result<(Vec<NeededDot>, Vec<usize>), Error> {
    // Bodies that hang together with the ground by contacts.
    let mut joined = vec![false; pile.bodies.len()];
    let mut grows = true;
    while grows {
        grows = false;
        for (contacts, _) in &pile.pairs {
            let first = &pile.contacts[contacts.start];
            let ends = [Some(first.body), first.other];
            let is_held = first.other.is_none() || ends.iter().flatten().any(|&end| joined[end]);
            for end in ends.into_iter().flatten().filter(|_| is_held) {
                grows |= !std::mem::replace(&mut joined[end], true);
            }
        }
    }
    let beyond = (0..joined.len()).filter(|&k| !joined[k]).map(|k| pile.ids[k]).collect();
    let gone: Vec<bool> = joined.iter().map(|is_joined| !is_joined).collect();
    let part = super::part::Part::new(pile, &gone, |_| 1.0);
    if part.bodies.is_empty() {
        return Ok((Vec::new(), beyond));
    }
    let radius = |body: usize| part.part_bodies[body].radius;
    let glued = |site: &GlueSite| {
        let points = &part.part_contacts[site.contacts.clone()];
        GlueSite {
            center: points.iter().map(|c| c.point).sum::<DVec3>() / points.len() as f64,
            arm: ARM * site.other.map_or(f64::INFINITY, radius).min(radius(site.body)),
            may_glue: true,
            ..site.clone()
        }
    };
    let sites: Vec<GlueSite> = part.sites.iter().map(glued).collect();
    let problem =
        GlueProblem { bodies: &part.part_bodies, contacts: &part.part_contacts, sites: &sites, gravity: DVec3::NEG_Y };
    let options = GlueOptions { friction_factor: FRICTION, normal_price: 0.02, strength: None, rounds: MOST_ROUNDS };
    let placement = match glue::place(&problem, &options, &mut || going.flow(0.95)) {
        Ok(placement) => placement,
        Err(GlueError::Cancelled) => return Err(Error::Cancelled),
        Err(error) => return Err(Error::Internal(error.to_string())),
    };
    let dot = |joint: &glue::GlueJoint| {
        let site = &sites[joint.site];
        let id = |body: usize| pile.ids[part.bodies[body]];
        NeededDot {
            body: id(site.body),
            other: site.other.map(id),
            point: pile.point(site.center),
            force: pile.newton(joint.force.length()),
        }
    };
    Ok((placement.joints.iter().map(dot).collect(), beyond))
}
