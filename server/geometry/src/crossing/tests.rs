use super::*;
use glam::DQuat;

fn cuboid(half: DVec3) -> TriMesh {
    let corner = |i: usize| DVec3::new(f64::from(i as u32 & 1), f64::from(i as u32 >> 1 & 1), f64::from(i as u32 >> 2));
    let points = (0..8).map(|i| (corner(i) * 2.0 - 1.0) * half).collect();
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    TriMesh { points, triangles: faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect() }
}

fn at(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, y, z))
}

#[test]
fn boxes_overlap_by_the_depth_of_their_faces() {
    let (plank, cube) = (Surface::new(&cuboid(DVec3::new(2.0, 0.1, 0.5))), Surface::new(&cuboid(DVec3::splat(0.5))));
    // Crossed, with no corner of one in the other, and the cube a corner deep in the plank.
    for (x, depth) in [(0.3, 0.07), (1.7, 0.02)] {
        let turned = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.4), DVec3::new(x, 0.6 - depth, 0.1));
        let found = plank.overlap(&cube, &turned).expect("they cross").depth;
        assert!((found - depth).abs() < 1e-6, "{found}");
        let other = cube.overlap(&plank, &turned.inverse()).expect("they cross").depth;
        assert!((other - depth).abs() < 1e-6, "{other}");
        assert!(plank.crosses(&cube, &turned));
    }
    // A larger copy, by the scale in the map.
    let large = DAffine3::from_scale_rotation_translation(DVec3::splat(2.0), DQuat::IDENTITY, DVec3::Y * 1.05);
    assert!((plank.overlap(&cube, &large).expect("they cross").depth - 0.05).abs() < 1e-6);
}

#[test]
fn what_touches_does_not_cross() {
    let cube = Surface::new(&cuboid(DVec3::splat(0.5)));
    for place in [at(1.0, 0.0, 0.0), at(1.0, 1.0, 0.25), at(0.25, 1.0, -0.5), at(1.0, 1.0, 1.0)] {
        assert!(!cube.crosses(&cube, &place) && cube.overlap(&cube, &place).is_none());
        assert_eq!(cube.distance(&cube, &place, 1.0), Some(0.0));
    }
    let just = at(1.0 - 1e-15, 0.3, 0.3);
    assert!(cube.crosses(&cube, &just));
    let edge = DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.7), DVec3::new(1.3, 0.0, 0.2));
    let gap = 1.3 - 0.5 - 0.5 * (0.7f64.cos() + 0.7f64.sin());
    assert!((cube.distance(&cube, &edge, 1.0).expect("near") - gap).abs() < 1e-12);
    assert_eq!(cube.distance(&cube, &edge, gap / 2.0), None);
}

#[test]
fn two_contacts_are_two_regions() {
    // A clamp whose jaws are too narrow for the cube between them.
    let mut clamp = cuboid(DVec3::new(1.0, 0.1, 0.1)).transformed(&at(0.0, 2.0, 0.0));
    for x in [-0.58, 0.57] {
        clamp.append(&cuboid(DVec3::new(0.1, 2.0, 0.1)).transformed(&at(x, 0.0, 0.0)));
    }
    let (clamp, cube) = (Surface::new(&clamp), Surface::new(&cuboid(DVec3::splat(0.5))));
    let found = clamp.overlap(&cube, &DAffine3::IDENTITY).expect("they cross").depth;
    assert!((found - 0.03).abs() < 1e-6, "{found}");
}

#[test]
fn a_sheet_cuts_within_its_plane() {
    let sheet = TriMesh {
        points: [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, z)| DVec3::new(x, 0.0, z)).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let (sheet, cube) = (Surface::new(&sheet), Surface::new(&cuboid(DVec3::splat(0.5))));
    let found = cube.overlap(&sheet, &at(1.4, 0.2, 0.0)).expect("they cross").depth;
    assert!((found - 0.1).abs() < 1e-4, "{found}");
}
