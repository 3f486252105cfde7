//! The global program against structures with known answers.

use crate::wall::{self, face, wall};
use cairn_statics::global::{Balance, GlobalBody, GlobalContact, GlobalProblem, Objective, analyse};
use glam::DVec3;

const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

fn solve(bodies: &[GlobalBody], contacts: &[GlobalContact], objective: Objective) -> Balance {
    let report = analyse(&GlobalProblem { bodies, contacts, gravity: GRAVITY }, objective).expect("a valid pile");
    assert!(report.bound <= report.total + 1e-6, "bound {} total {}", report.bound, report.total);
    report
}

fn stands(bodies: &[GlobalBody], contacts: &[GlobalContact]) -> bool {
    solve(bodies, contacts, Objective::default()).stands()
}

/// Blocks of length 1, each overhanging the one below by factor/2i, i counted from the top; the lowest overhangs a
/// table.
fn overhang(count: usize, factor: f64) -> Balance {
    let (mut bodies, mut contacts) = (Vec::new(), Vec::new());
    let mut reach = 0.0;
    for k in 0..count {
        // Right end of block k, the lowest first.
        let below = reach;
        reach += factor / (2.0 * (count - k) as f64);
        let height = k as f64 * 0.2;
        bodies.push(GlobalBody { mass: 2.0, center_of_mass: DVec3::new(reach - 0.5, height + 0.1, 0.0), radius: 0.6 });
        contacts.extend(face(k, k.checked_sub(1), [reach - 1.0, below], height, 0.2, 0.5));
    }
    solve(&bodies, &contacts, Objective::default())
}

#[test]
fn overhang_of_the_harmonic_sum() {
    for count in [1, 2, 3, 5, 10] {
        assert!(overhang(count, 0.99).stands(), "{count} blocks, 1 % inside");
        let falls = overhang(count, 1.01);
        assert!(!falls.stands(), "{count} blocks, 1 % outside: {}", falls.total);
        assert!(falls.bound > 0.5 * falls.total, "{count}: bound {} of {}", falls.bound, falls.total);
    }
}

#[test]
fn a_floating_body_and_a_hanging_one() {
    let body = |y: f64| GlobalBody { mass: 1.0, center_of_mass: DVec3::new(0.0, y, 0.0), radius: 1.0 };
    let contacts = face(0, None, [-0.5, 0.5], 0.0, 0.5, 0.5);
    let report = solve(&[body(0.5), body(5.0)], &contacts, Objective::default());
    assert!((report.imbalance[1] - 1.0).abs() < 1e-6 && report.imbalance[0] < 1e-6);
    assert_eq!(report.worst(), Some(1));
    assert_eq!(report.unsupported_fraction(0.1), 0.5);
}

/// A ball on a frictionless slope leans on a row of ten blocks that slide freely on the ground: one body lacks support.
#[test]
fn least_squares_smears_and_the_sum_of_norms_finds_the_one() {
    let slope = 0.5f64.atan();
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let mut bodies = vec![GlobalBody { mass: 1.0, center_of_mass: at(0.0, 0.5), radius: 0.5 }];
    let mut contacts = vec![GlobalContact {
        body: 0,
        other: None,
        point: at(-0.5 * slope.sin(), 0.5 - 0.5 * slope.cos()),
        normal: at(slope.sin(), slope.cos()),
        friction: 0.0,
    }];
    for k in 1..=10 {
        bodies.push(GlobalBody { mass: 1.0, center_of_mass: at(k as f64, 0.5), radius: 0.7 });
        contacts.extend(face(k, None, [k as f64 - 0.5, k as f64 + 0.5], 0.0, 0.5, 0.0));
        let point = at(k as f64 - 0.5, 0.5);
        contacts.push(GlobalContact { body: k, other: Some(k - 1), point, normal: DVec3::X, friction: 0.0 });
    }
    let squares = solve(&bodies, &contacts, Objective::LeastSquares);
    assert_eq!(squares.unsupported_fraction(0.1), 0.0, "spread over eleven bodies: {:?}", squares.imbalance);
    assert!(squares.total > 0.49);
    for sharpen in [0, 2] {
        let norms = solve(&bodies, &contacts, Objective::SumOfNorms { sharpen });
        assert_eq!((norms.worst(), norms.unsupported_fraction(0.1)), (Some(0), 1.0 / 11.0), "{:?}", norms.imbalance);
        assert!((norms.total - slope.sin()).abs() < 1e-5 && (norms.bound - slope.sin()).abs() < 1e-5);
    }
}

/// A half ring of voussoirs of inner radius `1 - t/2` and outer `1 + t/2`, feet on the ground.
fn stones(stones: usize, thickness: f64, friction: f64) -> (Vec<GlobalBody>, Vec<GlobalContact>) {
    let (inner, outer, z) = (1.0 - thickness / 2.0, 1.0 + thickness / 2.0, 0.1);
    let step = std::f64::consts::PI / stones as f64;
    // Centroid of a ring sector of half angle step/2.
    let centroid = 2.0 / 3.0 * (outer.powi(3) - inner.powi(3)) / (outer.powi(2) - inner.powi(2)) * (step / 2.0).sin()
        / (step / 2.0);
    let radial = |a: f64| DVec3::new(-a.cos(), a.sin(), 0.0);
    let (mut bodies, mut contacts) = (Vec::new(), Vec::new());
    for k in 0..=stones {
        let a = k as f64 * step;
        if k < stones {
            let middle = radial(a + step / 2.0);
            bodies.push(GlobalBody { mass: 1.0, center_of_mass: middle * centroid, radius: step.max(thickness) / 2.0 });
        }
        // Joint k: along the arch from stone k - 1 into stone k.
        let along = DVec3::new(a.sin(), a.cos(), 0.0);
        let (body, other, normal) = match k {
            0 => (0, None, along),
            k if k == stones => (k - 1, None, -along),
            k => (k, Some(k - 1), along),
        };
        for r in [inner, outer] {
            for z in [-z, z] {
                let point = radial(a) * r + DVec3::new(0.0, 0.0, z);
                contacts.push(GlobalContact { body, other, point, normal, friction });
            }
        }
    }
    (bodies, contacts)
}

fn arch(count: usize, thickness: f64, friction: f64) -> bool {
    let (bodies, contacts) = stones(count, thickness, friction);
    stands(&bodies, &contacts)
}

/// A semicircular arch stands from a thickness of 0.1075 of its mean radius (Milankovitch 1907; Heyman's rounded
/// 0.106), if friction keeps the joints from sliding.
#[test]
fn a_masonry_arch_needs_its_thickness() {
    assert!(arch(25, 0.1075 * 1.03, 2.0));
    assert!(!arch(25, 0.1075 * 0.97, 2.0));
    assert!(!arch(25, 0.2, 0.2), "thick, but it slides");
}

/// A wedge of half angle `alpha` between two blocks on the ground pushes them apart unless the ground's friction holds.
fn wedge(alpha: f64, mu: f64, ground: f64, block: f64) -> bool {
    let (s, c) = alpha.sin_cos();
    let bodies = [
        GlobalBody { mass: 1.0, center_of_mass: DVec3::new(0.0, 1.0, 0.0), radius: 0.5 },
        GlobalBody { mass: block, center_of_mass: DVec3::new(-5.0, 0.5, 0.0), radius: 5.0 },
        GlobalBody { mass: block, center_of_mass: DVec3::new(5.0, 0.5, 0.0), radius: 5.0 },
    ];
    let mut contacts = Vec::new();
    for (body, side) in [(1, -1.0), (2, 1.0)] {
        for z in [-0.3, 0.3] {
            // The wedge's faces lean by alpha: their normals (into the wedge) point inward and up.
            let point = DVec3::new(side * 0.2, 0.9, z);
            contacts.push(GlobalContact {
                body: 0,
                other: Some(body),
                point,
                normal: DVec3::new(-side * c, s, 0.0),
                friction: mu,
            });
        }
        let x = if side < 0.0 { [-10.0, -0.2] } else { [0.2, 10.0] };
        contacts.extend(face(body, None, x, 0.0, 0.3, ground));
    }
    stands(&bodies, &contacts)
}

#[test]
fn a_wedge_pushes_its_walls_apart() {
    let (alpha, mu, block) = (0.3f64, 0.1, 4.0);
    // At the limit the wedge slips down: friction mu N acts up along both faces.
    let normal = 0.5 / (alpha.sin() + mu * alpha.cos());
    let thrust = normal * (alpha.cos() - mu * alpha.sin());
    let needed = thrust / (block + 0.5);
    assert!(wedge(alpha, mu, needed * 1.01, block));
    assert!(!wedge(alpha, mu, needed * 0.99, block));
}

#[test]
fn bad_piles_are_refused() {
    use cairn_statics::global::GlobalProblemError;
    let body = GlobalBody { mass: 1.0, center_of_mass: DVec3::ZERO, radius: 1.0 };
    let contact = GlobalContact { body: 0, other: None, point: DVec3::ZERO, normal: DVec3::Y, friction: 0.5 };
    let run = |body: GlobalBody, contact: GlobalContact, gravity: DVec3| {
        analyse(&GlobalProblem { bodies: &[body], contacts: &[contact], gravity }, Objective::default()).map(|_| ())
    };
    assert_eq!(run(body, contact, DVec3::ZERO), Err(GlobalProblemError::Gravity));
    assert_eq!(run(GlobalBody { mass: -1.0, ..body }, contact, GRAVITY), Err(GlobalProblemError::Body(0)));
    assert_eq!(run(GlobalBody { radius: f64::NAN, ..body }, contact, GRAVITY), Err(GlobalProblemError::Body(0)));
    assert_eq!(
        run(body, GlobalContact { normal: DVec3::ZERO, ..contact }, GRAVITY),
        Err(GlobalProblemError::Contact(0))
    );
    assert_eq!(
        run(body, GlobalContact { friction: f64::INFINITY, ..contact }, GRAVITY),
        Err(GlobalProblemError::Contact(0))
    );
    assert_eq!(run(body, GlobalContact { other: Some(0), ..contact }, GRAVITY), Err(GlobalProblemError::Index(0)));
    assert_eq!(run(body, GlobalContact { body: 3, ..contact }, GRAVITY), Err(GlobalProblemError::Index(0)));
    let empty = analyse(&GlobalProblem { bodies: &[], contacts: &[], gravity: GRAVITY }, Objective::default())
        .expect("an empty pile");
    assert!(empty.stands());
}

#[test]
fn a_thousand_bodies() {
    let (bodies, contacts) = wall(20, 50);
    for objective in [Objective::LeastSquares, Objective::SumOfNorms { sharpen: 2 }] {
        let report = solve(&bodies, &contacts, objective);
        assert!(report.converged);
        assert!(report.bound > 0.99 * report.total, "bound {} total {}", report.bound, report.total);
    }
}

/// Every stone of an arch that is too thin rests stably on its neighbours: the local analysis cannot know.
#[test]
fn the_local_analysis_sees_only_neighbours() {
    use cairn_statics::local;
    let (bodies, contacts) = stones(25, 0.09, 2.0);
    assert!(!stands(&bodies, &contacts));
    let mut analyser = local::Analyser::new();
    for (k, body) in bodies.iter().enumerate() {
        let touching = wall::contacts_of(k, &contacts);
        let problem = local::LocalProblem {
            contacts: &touching,
            mass: body.mass,
            center_of_mass: body.center_of_mass,
            radius: body.radius,
            gravity: GRAVITY,
        };
        assert!(
            analyser.analyse(&problem, &local::Options::default()).expect("a valid stone").is_stable(),
            "stone {k}"
        );
    }
}

/// Six hundred bodies of masses 1 : 1000 that touch at random, some of them nothing.
#[test]
fn a_disordered_pile_has_a_tight_bound() {
    use crate::generator::{rng, unit};
    use rand::RngExt;
    let rng = &mut rng(17);
    let bodies: Vec<GlobalBody> = (0..600)
        .map(|_| GlobalBody {
            mass: 10f64.powf(rng.random_range(-1.5..1.5)),
            center_of_mass: DVec3::new(
                rng.random_range(0.0..6.0),
                rng.random_range(0.0..6.0),
                rng.random_range(0.0..6.0),
            ),
            radius: 0.5,
        })
        .collect();
    let mut contacts = Vec::new();
    for (i, a) in bodies.iter().enumerate() {
        for (j, b) in bodies[..i].iter().enumerate() {
            let apart = a.center_of_mass - b.center_of_mass;
            if apart.length() < 0.7 {
                for _ in 0..2 {
                    contacts.push(GlobalContact {
                        body: i,
                        other: Some(j),
                        point: b.center_of_mass + apart / 2.0 + 0.2 * unit(rng),
                        normal: (apart.normalize() + 0.3 * unit(rng)).normalize(),
                        friction: 0.6,
                    });
                }
            }
        }
        if a.center_of_mass.y < 0.5 {
            let foot = a.center_of_mass.with_y(0.0);
            let corners = [[-0.2, -0.2], [0.2, -0.1], [0.0, 0.2]].map(|[x, z]| foot + DVec3::new(x, 0.0, z));
            contacts.extend(corners.map(|point| GlobalContact {
                body: i,
                other: None,
                point,
                normal: DVec3::Y,
                friction: 0.6,
            }));
        }
    }
    let plain = solve(&bodies, &contacts, Objective::SumOfNorms { sharpen: 0 });
    assert!(plain.converged && plain.total - plain.bound < 1e-3 * plain.total, "{} {}", plain.bound, plain.total);
    let sharp = solve(&bodies, &contacts, Objective::SumOfNorms { sharpen: 2 });
    assert!(sharp.converged && sharp.total == plain.total);
    assert!(sharp.unsupported_fraction(0.1) < plain.unsupported_fraction(0.1));
}
