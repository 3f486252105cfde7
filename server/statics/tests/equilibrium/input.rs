//! Input without meaning is refused by name; input at the edge of meaning gets the physically right answer.

use crate::physics::block;
use cairn_statics::local::*;
use glam::DVec3;

fn run(case: &crate::generator::Case) -> Result<bool, ProblemError> {
    Analyser::new().analyse(&case.problem(), &Options::default()).map(|v| v.is_stable())
}

#[test]
fn nonsense_is_refused() {
    let good = block(0.5);
    assert_eq!(run(&good), Ok(true));
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut case = good.clone();
        case.contacts[2].point.y = bad;
        assert_eq!(run(&case), Err(ProblemError::Point(2)));
        let mut case = good.clone();
        case.contacts[1].normal.x = bad;
        assert_eq!(run(&case), Err(ProblemError::Normal(1)));
        let mut case = good.clone();
        case.contacts[3].friction = bad;
        assert!(matches!(run(&case), Err(ProblemError::Friction { index: 3, .. })));
        let mut case = good.clone();
        case.mass = bad;
        assert!(matches!(run(&case), Err(ProblemError::Mass(_))));
        let mut case = good.clone();
        case.radius = bad;
        assert!(matches!(run(&case), Err(ProblemError::Radius(_))));
        let mut case = good.clone();
        case.center_of_mass.z = bad;
        assert_eq!(run(&case), Err(ProblemError::CenterOfMass));
        let mut case = good.clone();
        case.gravity.y = bad;
        assert_eq!(run(&case), Err(ProblemError::Gravity));
    }
    let mut case = good.clone();
    case.contacts[0].normal = DVec3::ZERO;
    assert_eq!(run(&case), Err(ProblemError::Normal(0)));
    let mut case = good.clone();
    case.contacts[0].friction = -0.1;
    assert_eq!(run(&case), Err(ProblemError::Friction { index: 0, friction: -0.1 }));
    for mass in [0.0, -1.0] {
        assert_eq!(run(&crate::generator::Case { mass, ..good.clone() }), Err(ProblemError::Mass(mass)));
    }
    for sides in [0, 2, MAX_SIDES + 1, u32::MAX] {
        let law = FrictionLaw::Pyramid { sides, fit: Fit::Inscribed };
        let options = Options { friction_law: law, ..Options::default() };
        let refused = Analyser::new().analyse(&good.problem(), &options).map(|v| v.is_stable());
        assert_eq!(refused, Err(ProblemError::Sides(sides)));
    }
}

#[test]
fn without_contacts_it_falls_and_without_gravity_it_floats() {
    for solver in [Solver::Fast, Solver::Clarabel] {
        let options = Options { solver, margin: true, ..Options::default() };
        let mut falling = block(0.5);
        falling.contacts.clear();
        match Analyser::new().analyse(&falling.problem(), &options) {
            Ok(Verdict::Unstable { certificate, residual }) => {
                assert!((residual - 1.0).abs() < 1e-15 && certificate.force.distance(DVec3::Y) < 1e-15);
            }
            other => panic!("{other:?}"),
        }
        let mut floating = block(0.5);
        floating.gravity = DVec3::ZERO;
        match Analyser::new().analyse(&floating.problem(), &options) {
            Ok(Verdict::Stable { forces, residual, .. }) => {
                assert!(forces.iter().all(|f| f.is_finite()) && residual <= REFERENCE_RESIDUAL);
            }
            other => panic!("{other:?}"),
        }
        floating.contacts.clear();
        assert_eq!(run(&floating), Ok(true));
    }
}

/// Numbers at the ends of the range: an error or a verdict, never a panic and never NaN.
#[test]
fn extremes_do_not_break_it() {
    let sizes = [1e-300, 1e-150, 1e-20, 1.0, 1e20, 1e150, 1e300];
    for length in sizes {
        for value in sizes {
            for solver in [Solver::Fast, Solver::Clarabel] {
                let mut case = block(0.5);
                case.contacts[0].friction = value;
                case.contacts[1].normal *= value;
                case.contacts[2].point.x *= value;
                case.radius = length;
                case.gravity *= value;
                let options = Options { solver, margin: true, ..Options::default() };
                match Analyser::new().analyse(&case.problem(), &options) {
                    Ok(Verdict::Stable { forces, residual, margin }) => {
                        assert!(forces.iter().all(|f| f.is_finite()), "{length:e} {value:e}");
                        assert!(residual.is_finite() && margin.is_some_and(f64::is_finite), "{length:e} {value:e}");
                    }
                    Ok(Verdict::Unstable { certificate, residual }) => {
                        assert!(certificate.force.is_finite() && certificate.torque.is_finite());
                        assert!(residual.is_finite(), "{length:e} {value:e}");
                    }
                    Err(_) => (),
                }
            }
        }
    }
}
