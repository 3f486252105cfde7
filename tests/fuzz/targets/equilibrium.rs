//! Any touches: the verdict's certificate is substituted into the equations, by code that shares nothing with the
//! solver.

use cairn_statics::local::{
    Analyser, EXCLUDED_FORCE, FORCE_ROUNDING, FrictionLaw, LocalContact, LocalProblem, Options, PROOF_TOLERANCE,
    REFERENCE_EXCLUDED_FORCE, STABLE_RESIDUAL, Verdict,
};
use glam::DVec3;

/// Bytes of one touch: seven numbers of two bytes.
const TOUCH: usize = 14;
const MOST_TOUCHES: usize = 24;
/// Of a touch, in bounding radii.
const FARTHEST: f64 = 4.0;
/// What this substitution may add of rounding, in units of what it sums.
const ROUNDING: f64 = 1e-12;

/// First byte: how numbers are written and which law holds. Then the touches.
pub fn run(bytes: &[u8]) {
    let Some((form, rest)) = bytes.split_first() else { return };
    let law = if form & 1 == 0 { FrictionLaw::Cone } else { FrictionLaw::PAPER };
    let number = |bytes: &[u8]| {
        let whole = i16::from_le_bytes([bytes[0], bytes[1]]);
        match form & 2 {
            // Few values, many of them equal: lines, planes and doubled points.
            0 => f64::from(whole % 9) / 8.0,
            // All sizes: a sign, a digit and a power of ten.
            _ => f64::from(whole % 16) * 10f64.powi(i32::from(whole / 16) % 12 - 6),
        }
    };
    let touch = |bytes: &[u8]| {
        let at: Vec<f64> = bytes.chunks_exact(2).map(number).collect();
        LocalContact {
            point: DVec3::new(at[0], at[1], at[2]),
            normal: DVec3::new(at[3], at[4], at[5]),
            // What a scene may have.
            friction: at[6].abs().min(2.0),
        }
    };
    let contacts: Vec<LocalContact> = rest.chunks_exact(TOUCH).take(MOST_TOUCHES).map(touch).collect();
    // A body's touches lie about on its bounding sphere or within. A million radii away, rounding decides.
    if contacts.iter().any(|contact| contact.point.length() > FARTHEST) {
        return;
    }
    let gravity = DVec3::NEG_Y;
    let problem = LocalProblem { contacts: &contacts, mass: 1.0, center_of_mass: DVec3::ZERO, radius: 1.0, gravity };
    let mut analyser = Analyser::new();
    let options = Options { friction_law: law, margin: form & 4 != 0, ..Options::default() };
    // Where all touches lie on a patch of a hundredth of the radius, both solvers may find no proof. Such a verdict is
    // counted, and promises nothing; `found/equilibrium/small-patch` is one.
    let is_open = |analyser: &Analyser| analyser.counters().uncertified > 0;
    if analyser.analyse(&problem, &options).is_err() || is_open(&analyser) {
        return;
    }
    let Ok(verdict) = analyser.analyse(&problem, &options) else { return };
    match verdict {
        Verdict::Stable { forces, residual, margin } => {
            assert_eq!(forces.len(), contacts.len());
            assert!(margin.is_none_or(|margin| margin >= 0.0), "{margin:?}");
            balances(&contacts, forces, residual, law);
        }
        Verdict::Unstable { certificate, residual } => {
            let weight = certificate.force.dot(-gravity);
            assert!(residual > 0.0 && (weight - residual).abs() <= ROUNDING, "{weight} {residual}");
            excludes(&contacts, certificate.force, certificate.torque, residual, law);
        }
    }
    // The same again, and from the answer: the same verdict.
    let is_stable = verdict.is_stable();
    let last =
        if let Verdict::Stable { forces, .. } = verdict { forces.to_vec() } else { vec![DVec3::ZERO; contacts.len()] };
    assert_eq!(analyser.analyse(&problem, &options).unwrap().is_stable(), is_stable);
    // A proof of instability leaves forces of EXCLUDED_FORCE open: a wedge that needs as much may be found stable, too.
    let sum = |forces: &[DVec3]| forces.iter().map(|force| force.length()).sum::<f64>();
    let first = sum(&last);
    let again = analyser.analyse_from(&problem, &options, &last).unwrap();
    let jams = match again {
        Verdict::Stable { forces, .. } => sum(forces).max(first) >= EXCLUDED_FORCE,
        Verdict::Unstable { .. } => first >= EXCLUDED_FORCE,
    };
    let again = again.is_stable();
    assert!(again == is_stable || jams || is_open(&analyser), "from its own answer");
}

/// Normal and tangents of a touch.
fn frame(contact: &LocalContact) -> DVec3 {
    contact.normal.normalize()
}

fn balances(contacts: &[LocalContact], forces: &[DVec3], residual: f64, law: FrictionLaw) {
    let (mut force, mut torque, mut sum) = (DVec3::NEG_Y, DVec3::ZERO, 0.0);
    for (contact, f) in contacts.iter().zip(forces) {
        force += *f;
        torque += contact.point.cross(*f);
        sum += f.length() * (1.0 + contact.point.length());
        let n = f.dot(frame(contact));
        let t = (*f - n * frame(contact)).length();
        // The paper's square reaches sqrt 2 beyond the circle.
        let most = contact.friction * n * if law == FrictionLaw::Cone { 1.0 } else { std::f64::consts::SQRT_2 };
        let room = 10.0 * PROOF_TOLERANCE * (1.0 + f.length()) * (1.0 + contact.friction);
        assert!(n >= -room && t <= most + room, "touch {contact:?} with force {f}: {n} {t} {most}");
    }
    let left = (force.length_squared() + torque.length_squared()).sqrt();
    let reported = residual.max(STABLE_RESIDUAL).max(FORCE_ROUNDING * sum);
    assert!(left <= reported + ROUNDING * sum, "{left} is left, {residual} is reported, of {sum}");
}

/// No force of a touch does work with the certificate: neither its normal part alone nor with the friction that helps
/// most.
fn excludes(contacts: &[LocalContact], z: DVec3, w: DVec3, residual: f64, law: FrictionLaw) {
    assert!((z.length_squared() + w.length_squared() - 1.0).abs() < 1e-6, "a unit wrench");
    for contact in contacts {
        let velocity = z + w.cross(contact.point);
        let along = velocity.dot(frame(contact));
        let across = (velocity - along * frame(contact)).length();
        // Of the square only the inscribed circle is tried, so that its frame does not matter.
        let _ = law;
        let work = along + contact.friction * across;
        let size = (1.0 + contact.point.length()) * (1.0 + contact.friction);
        assert!(
            work <= 1e-8 * size || work * REFERENCE_EXCLUDED_FORCE <= residual,
            "{work} against {residual} at {contact:?}"
        );
    }
}

pub fn seeds() -> Vec<Vec<u8>> {
    // A plate on three and on four touches, a body between two walls, a ladder, nothing at all.
    let touches: [&[[i16; 7]]; 4] = [
        &[[8, -4, 0, 0, 8, 0, 4], [-8, -4, 8, 0, 8, 0, 4], [-8, -4, -8, 0, 8, 0, 4]],
        &[[8, -4, 8, 0, 8, 0, 0], [8, -4, -8, 0, 8, 0, 0], [-8, -4, 8, 0, 8, 0, 0], [-8, -4, -8, 0, 8, 0, 0]],
        &[[8, 0, 0, -8, 0, 0, 8], [-8, 0, 0, 8, 0, 0, 8]],
        &[[8, -8, 0, 0, 8, 0, 4], [-8, 8, 0, 8, 0, 0, 0]],
    ];
    let bytes = |touches: &[[i16; 7]]| touches.iter().flatten().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    let with = |form: u8| touches.iter().map(move |touches| [&[form], &bytes(touches)[..]].concat());
    let mut seeds: Vec<Vec<u8>> = (0..8).flat_map(with).collect();
    seeds.push(vec![0]);
    seeds
}
