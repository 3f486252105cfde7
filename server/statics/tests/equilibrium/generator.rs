//! Problems of every kind that a pile can produce, and worse, from a seed. Shared by the tests and the benchmark.

use cairn_statics::local::{LocalContact, LocalProblem};
use glam::{DMat3, DQuat, DVec3};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A problem that owns its contacts.
#[derive(Clone, Debug)]
pub struct Case {
    pub contacts: Vec<LocalContact>,
    pub mass: f64,
    pub center_of_mass: DVec3,
    pub radius: f64,
    pub gravity: DVec3,
}

impl Case {
    pub fn problem(&self) -> LocalProblem<'_> {
        LocalProblem {
            contacts: &self.contacts,
            mass: self.mass,
            center_of_mass: self.center_of_mass,
            radius: self.radius,
            gravity: self.gravity,
        }
    }

    /// The same case in other units: lengths by `length`, masses by `mass`, accelerations by `acceleration`.
    pub fn in_units(&self, length: f64, mass: f64, acceleration: f64) -> Case {
        let contacts = self.contacts.iter().map(|c| LocalContact { point: c.point * length, ..*c }).collect();
        Case {
            contacts,
            mass: self.mass * mass,
            center_of_mass: self.center_of_mass * length,
            radius: self.radius * length,
            gravity: self.gravity * acceleration,
        }
    }

    /// The same case seen from a turned frame.
    pub fn turned(&self, q: DQuat) -> Case {
        let contacts = self
            .contacts
            .iter()
            .map(|c| LocalContact { point: q * c.point, normal: q * c.normal, friction: c.friction })
            .collect();
        Case { contacts, center_of_mass: q * self.center_of_mass, gravity: q * self.gravity, ..*self }
    }
}

pub fn rng(seed: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed)
}

pub fn unit(rng: &mut impl Rng) -> DVec3 {
    loop {
        let v = DVec3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
        if (1e-3..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

pub fn rotation(rng: &mut impl Rng) -> DQuat {
    let u: f64 = rng.random();
    let (a, b) = (rng.random_range(0.0..std::f64::consts::TAU), rng.random_range(0.0..std::f64::consts::TAU));
    let (p, q) = ((1.0 - u).sqrt(), u.sqrt());
    DQuat::from_xyzw(p * a.sin(), p * a.cos(), q * b.sin(), q * b.cos()).normalize()
}

/// Ten to a power between `low` and `high`.
fn decade(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    10f64.powf(rng.random_range(low..high))
}

/// Case number `seed`. With Y up; [`Case::turned`] and [`Case::in_units`] are applied last.
pub fn case(seed: u64) -> Case {
    let mut rng = rng(seed);
    let n = if rng.random_bool(0.5) { rng.random_range(1..=8) } else { rng.random_range(1..=64) };
    case_of(&mut rng, n)
}

/// A case of `n` contacts.
pub fn case_of(rng: &mut impl Rng, n: usize) -> Case {
    let mut points = points(rng, n);
    let normals = normals(rng, &points);
    let friction = friction(rng, n);
    if rng.random_bool(0.1) {
        // Repeated points: each run of three collapses onto its first.
        for i in 0..n {
            points[i] = points[i / 3 * 3];
        }
    }
    let contacts =
        (0..n).map(|i| LocalContact { point: points[i], normal: normals[i], friction: friction[i] }).collect();
    let offset = if rng.random_bool(0.5) { DVec3::ZERO } else { unit(rng) * rng.random_range(0.0..0.3) };
    let case = Case { contacts, mass: 1.0, center_of_mass: offset, radius: 1.0, gravity: DVec3::new(0.0, -1.0, 0.0) };
    let (length, mass, acceleration) = (decade(rng, -6.0, 3.0), decade(rng, -6.0, 6.0), decade(rng, -2.0, 3.0));
    case.turned(rotation(rng)).in_units(length, mass, acceleration)
}

/// Points within the unit ball about the origin.
fn points(rng: &mut impl Rng, n: usize) -> Vec<DVec3> {
    let kind = rng.random_range(0..7);
    let height = rng.random_range(-0.9..0.3);
    let thin = decade(rng, -4.0, 0.0);
    let line = unit(rng);
    let base = unit(rng) * rng.random_range(0.0..0.5);
    let tilt = DMat3::from_quat(rotation(rng));
    (0..n)
        .map(|_| {
            let inside = unit(rng) * rng.random_range(0.0f64..1.0).cbrt();
            match kind {
                // All over the body's surface.
                0 => unit(rng),
                // Anywhere.
                1 => inside,
                // Coplanar and horizontal: a face on a table.
                2 => DVec3::new(inside.x, height, inside.z) * 0.7,
                // Coplanar at any tilt.
                3 => tilt * DVec3::new(inside.x, height, inside.z) * 0.7,
                // Collinear.
                4 => base + line * rng.random_range(-0.5..0.5),
                // Needle: a body long in one direction only.
                5 => DVec3::new(inside.x, inside.y * thin, inside.z * thin),
                // Close together.
                _ => base + inside * thin,
            }
        })
        .collect()
}

fn normals(rng: &mut impl Rng, points: &[DVec3]) -> Vec<DVec3> {
    let kind = rng.random_range(0..7);
    let common = unit(rng);
    points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let any = unit(rng);
            match kind {
                0 => any,
                // The conservative selection's.
                1 => DVec3::new(any.x, any.y.abs(), any.z),
                2 => DVec3::Y,
                // A slope, or a wall.
                3 => DVec3::new(common.x, common.y.abs(), common.z),
                // A clamp.
                4 => common * if i % 2 == 0 { 1.0 } else { -1.0 },
                // Into a round body.
                5 => (-*p).try_normalize().unwrap_or(DVec3::Y),
                // A rough table.
                _ => (DVec3::Y + any * 0.3).normalize(),
            }
        })
        .collect()
}

fn friction(rng: &mut impl Rng, n: usize) -> Vec<f64> {
    let kind = rng.random_range(0..5);
    let common = match kind {
        0 => 0.0,
        1 => 0.7,
        2 => decade(rng, -4.0, 0.0),
        _ => rng.random_range(0.0..2.0),
    };
    (0..n).map(|_| if kind == 4 { rng.random_range(0.0..2.0) } else { common }).collect()
}
