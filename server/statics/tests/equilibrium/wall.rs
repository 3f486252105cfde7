//! A brick wall for the global program, and its bricks for the local analysis. Shared by the tests and the benchmark.

use cairn_statics::global::{GlobalBody, GlobalContact};
use cairn_statics::local;
use glam::DVec3;

/// The four corners of the overlap of two boxes' faces: x from..to, half depth z.
pub fn face(body: usize, other: Option<usize>, x: [f64; 2], y: f64, z: f64, friction: f64) -> Vec<GlobalContact> {
    [[x[0], -z], [x[1], -z], [x[1], z], [x[0], z]]
        .map(|[x, z]| GlobalContact { body, other, point: DVec3::new(x, y, z), normal: DVec3::Y, friction })
        .to_vec()
}

/// A running bond of whole bricks: every other course begins half a brick later, and its ends hang over.
pub fn wall(courses: usize, bricks: usize) -> (Vec<GlobalBody>, Vec<GlobalContact>) {
    let (mut bodies, mut contacts) = (Vec::new(), Vec::new());
    for row in 0..courses {
        let shifted = row % 2 == 1;
        for k in 0..bricks {
            let (x, y) = (k as f64 + if shifted { 0.5 } else { 0.0 }, row as f64 * 0.3);
            let index = bodies.len();
            bodies.push(GlobalBody { mass: 1.0, center_of_mass: DVec3::new(x, y + 0.15, 0.0), radius: 0.6 });
            if row == 0 {
                contacts.extend(face(index, None, [x - 0.45, x + 0.45], y, 0.25, 0.7));
                continue;
            }
            let right = if shifted { k + 1 } else { k };
            for (other, span) in [(right.checked_sub(1), [x - 0.45, x - 0.05]), (Some(right), [x + 0.05, x + 0.45])] {
                if let Some(other) = other.filter(|o| *o < bricks) {
                    contacts.extend(face(index, Some((row - 1) * bricks + other), span, y, 0.25, 0.7));
                }
            }
        }
    }
    (bodies, contacts)
}

/// The contacts of one body, normals into it.
pub fn contacts_of(body: usize, contacts: &[GlobalContact]) -> Vec<local::LocalContact> {
    contacts
        .iter()
        .filter_map(|c| {
            let normal = match c {
                c if c.body == body => c.normal,
                c if c.other == Some(body) => -c.normal,
                _ => return None,
            };
            Some(local::LocalContact { point: c.point, normal, friction: c.friction })
        })
        .collect()
}
