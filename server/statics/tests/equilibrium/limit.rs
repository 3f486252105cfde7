//! Limits of loads against closed forms.

use crate::wall::face;
use cairn_statics::global::{GlobalBody, GlobalContact};
use cairn_statics::limit::{self, Accuracy, Limit, LimitProblem, Load};
use glam::{DVec2, DVec3};

const G: f64 = 9.81;

/// The tilt, as a tangent, at which a pile goes.
pub fn tilt(bodies: &[GlobalBody], contacts: &[GlobalContact], way: DVec3) -> Limit {
    let (dead, live) = (limit::weights(bodies, G * DVec3::NEG_Y), limit::shake(bodies, G, way));
    let problem =
        LimitProblem { bodies, contacts, gravity: G, dead: &dead, live: &live, most: 10.0, accuracy: Accuracy::Fine };
    limit::find(&problem).expect("a valid pile")
}

/// Both proofs, and that they meet.
fn between(limit: &Limit) -> f64 {
    let stands = limit.stands_to.expect("it stands");
    assert!(stands <= limit.falls_from && limit.falls_from - stands < 1e-4, "{stands} to {}", limit.falls_from);
    stands
}

/// A block of 2 w x 2 h x 2 w slides at tan = friction, or tips at tan = w / h.
#[test]
fn a_block_slides_or_tips() {
    for (h, friction) in [(0.1, 0.5), (0.3, 0.5), (0.2, 0.5), (1.0, 0.9)] {
        let w = 0.1;
        let bodies = [GlobalBody { mass: 3.0, center_of_mass: DVec3::new(0.0, h, 0.0), radius: h + w }];
        let limit = tilt(&bodies, &face(0, None, [-w, w], 0.0, w, friction), DVec3::X);
        let expected = f64::min(friction, w / h);
        assert!((between(&limit) - expected).abs() < 1e-4, "{h}, {friction}: {limit:?}");
        assert_eq!(limit.moving().collect::<Vec<_>>(), [0]);
        assert!(limit.motion[0].0.x > 0.0, "it goes where it is pushed: {:?}", limit.motion);
    }
}

/// Of a tower of three, the upper two tip first.
#[test]
fn the_weakest_joint_goes() {
    let block =
        |k: usize| GlobalBody { mass: 1.0, center_of_mass: DVec3::new(0.0, 0.2 * k as f64 + 0.1, 0.0), radius: 0.3 };
    let bodies = [0, 1, 2].map(block);
    let contacts = [
        face(0, None, [-0.2, 0.2], 0.0, 0.2, 0.9),
        face(1, Some(0), [-0.1, 0.1], 0.2, 0.1, 0.9),
        face(2, Some(1), [-0.2, 0.2], 0.4, 0.2, 0.9),
    ]
    .concat();
    let limit = tilt(&bodies, &contacts, DVec3::Z);
    // The two above the narrow joint: half a width of .1 below a centre at .2.
    assert!((between(&limit) - 0.5).abs() < 1e-4, "{limit:?}");
    assert_eq!(limit.moving().collect::<Vec<_>>(), [1, 2]);
}

#[test]
fn what_does_not_stand_has_no_limit() {
    let bodies = [GlobalBody { mass: 1.0, center_of_mass: DVec3::new(0.3, 0.1, 0.0), radius: 0.3 }];
    let limit = tilt(&bodies, &face(0, None, [-0.1, 0.1], 0.0, 0.1, 0.5), DVec3::Z);
    assert_eq!(limit.stands_to, None, "{limit:?}");
    assert!(limit.falls_from <= 0.0, "{limit:?}");
}

/// A wedge between two walls bears any push; the price of its forces keeps the program bounded.
#[test]
fn a_wedge_has_an_answer() {
    let bodies = [GlobalBody { mass: 1.0, center_of_mass: DVec3::ZERO, radius: 0.2 }];
    let side = |x: f64, z: f64| GlobalContact {
        body: 0,
        other: None,
        point: DVec3::new(x, 0.0, z),
        normal: DVec3::new(-x.signum(), 0.0, 0.0),
        friction: 0.5,
    };
    let contacts = [side(-0.1, -0.1), side(-0.1, 0.1), side(0.1, 0.0)];
    let limit = tilt(&bodies, &contacts, DVec3::X);
    assert!(limit.reaches(10.0), "{limit:?}");
}

/// Stones of a semicircular arch of mean radius 1 with radial joints: the thinnest one that stands has the thickness
/// 0.1075 (Couplet, Milankovitch; Heyman's 0.106 is an approximation), and a little more with few joints.
fn arch(thickness: f64, stones: usize) -> (Vec<GlobalBody>, Vec<GlobalContact>) {
    let (inner, outer) = (1.0 - thickness / 2.0, 1.0 + thickness / 2.0);
    let joint = |k: usize| std::f64::consts::PI * k as f64 / stones as f64;
    let (mut bodies, mut contacts) = (Vec::new(), Vec::new());
    for k in 0..stones {
        let (from, to) = (joint(k), joint(k + 1));
        let (half, middle) = ((to - from) / 2.0, (from + to) / 2.0);
        let reach = 2.0 / 3.0 * (outer.powi(3) - inner.powi(3)) / (outer * outer - inner * inner) * half.sin() / half;
        let center = reach * DVec2::from_angle(middle);
        let area = half * (outer * outer - inner * inner);
        bodies.push(GlobalBody { mass: area, center_of_mass: center.extend(0.0), radius: 0.2 });
    }
    for k in 0..=stones {
        let along = DVec2::from_angle(joint(k));
        // Into the stone of this number, or for the last joint into the one before it.
        let (body, other, sign) = match k {
            0 => (0, None, 1.0),
            k if k == stones => (stones - 1, None, -1.0),
            k => (k, Some(k - 1), 1.0),
        };
        let normal = (sign * along.perp()).extend(0.0);
        for (r, z) in [(inner, -0.1), (inner, 0.1), (outer, -0.1), (outer, 0.1)] {
            let point = (r * along).extend(z);
            contacts.push(GlobalContact { body, other, point, normal, friction: 2.0 });
        }
    }
    (bodies, contacts)
}

#[test]
fn the_thinnest_arch() {
    let stands = |thickness: f64| {
        let (bodies, contacts) = arch(thickness, 60);
        let (dead, live) = (vec![Load::default(); bodies.len()], limit::weights(&bodies, G * DVec3::NEG_Y));
        let problem = LimitProblem {
            bodies: &bodies,
            contacts: &contacts,
            gravity: G,
            dead: &dead,
            live: &live,
            most: 1.0,
            accuracy: Accuracy::Fine,
        };
        let limit = limit::find(&problem).expect("a valid pile");
        let (stands, falls) = (limit.reaches(1.0), limit.falls_from < 0.5);
        assert!(stands != falls, "one of both is proven at {thickness}: {:?}, {}", limit.stands_to, limit.falls_from);
        stands
    };
    let (mut thin, mut thick) = (0.05, 0.2);
    assert!(!stands(thin) && stands(thick));
    while thick - thin > 2e-4 {
        let middle = (thin + thick) / 2.0;
        if stands(middle) { thick = middle } else { thin = middle }
    }
    assert!((thick - 0.1075).abs() < 5e-4, "{thick}");
}
