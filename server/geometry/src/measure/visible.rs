//! How bodies meet as a camera sees them: by their own meshes, not by the shapes that collide.

use super::percentile;
use crate::contact::REAL_CONTACT;
use crate::crossing::Surface;
use crate::mesh::{TriMesh, boxes_meet};
use crate::pose::Pose;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Bodies that are looked at in a large pile, spread evenly over their order; each with all of its neighbours.
const LOOKED_AT: usize = 100;
/// A gap between touching bodies is measured up to this many thicknesses.
const FARTHEST: f64 = 1.0;

/// How the meshes of a pile's bodies cut each other, and how far those that touch are apart. In thicknesses of the
/// thinner body of a pair.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Visible {
    /// Share of the bodies with a triangle that crosses one of another body.
    pub cut_share: f64,
    /// Depth of overlaps over all pairs whose meshes cross, or are no farther apart than [`REAL_CONTACT`].
    pub depth_mean: f64,
    pub depth_p95: f64,
    pub depth_max: f64,
    /// Between bodies whose collision shapes touch, 95 of 100 gaps are no wider; 0 where the meshes cross. `None`
    /// without such pairs.
    pub gap_p95: Option<f64>,
    /// The same in the meshes' unit.
    pub depth_p95_length: f64,
    pub gap_p95_length: Option<f64>,
    /// Pairs of bodies that were held against each other.
    pub pairs: u64,
}

/// A pair of bodies, in thicknesses of the thinner one.
struct Neighbours {
    bodies: [usize; 2],
    /// The thickness of the thinner one.
    unit: f64,
    /// `None` where no triangles cross.
    depth: Option<f64>,
    /// `None`: wider than was looked for.
    gap: Option<f64>,
}

/// Boxes, and which of them meet.
pub struct Neighbourhood {
    boxes: Vec<(DVec3, DVec3)>,
    /// By their lower ends along X.
    order: Vec<usize>,
    widest: f64,
}

impl Neighbourhood {
    pub fn new(boxes: Vec<(DVec3, DVec3)>) -> Neighbourhood {
        let mut order: Vec<usize> = (0..boxes.len()).collect();
        order.sort_by(|&i, &j| boxes[i].0.x.total_cmp(&boxes[j].0.x).then(i.cmp(&j)));
        let widest = boxes.iter().map(|b| b.1.x - b.0.x).fold(0.0, f64::max);
        Neighbourhood { boxes, order, widest }
    }

    /// The others whose boxes meet this one.
    pub fn of(&self, i: usize) -> Vec<usize> {
        let (lo, hi) = self.boxes[i];
        let begin = self.order.partition_point(|&j| self.boxes[j].0.x < lo.x - self.widest);
        let along = self.order[begin..].iter().copied().take_while(|&j| self.boxes[j].0.x <= hi.x);
        along.filter(|&j| j != i && boxes_meet(self.boxes[i], self.boxes[j], DVec3::ZERO)).collect()
    }
}

/// A pile's visible meshes, to hold its bodies against each other.
pub struct Sight<'a> {
    bodies: &'a [(usize, f64, Pose)],
    /// Of each body, m.
    thickness: &'a [f64],
    /// By how much each body was lowered.
    lowered: Vec<f64>,
    /// One for each prop that a body has.
    surfaces: Vec<Option<Surface>>,
    near: Neighbourhood,
}

impl<'a> Sight<'a> {
    /// `bodies`: index into `props`, uniform scale and pose. `thickness`: of each body, m.
    pub fn new(props: &[&TriMesh], bodies: &'a [(usize, f64, Pose)], thickness: &'a [f64]) -> Sight<'a> {
        let used: BTreeSet<usize> = bodies.iter().map(|b| b.0).collect();
        let surface = |i: usize| used.contains(&i).then(|| Surface::new(props[i]));
        let surfaces: Vec<Option<Surface>> = (0..props.len()).into_par_iter().map(surface).collect();
        let lowered = vec![0.0; bodies.len()];
        let mut sight = Sight { bodies, thickness, lowered, surfaces, near: Neighbourhood::new(Vec::new()) };
        sight.near = sight.neighbourhood(REAL_CONTACT);
        sight
    }

    /// For gaps up to that of a thickness.
    fn neighbourhood(&self, gap: f64) -> Neighbourhood {
        let reached = |i: usize| {
            let (lo, hi) = self.of(i).bounds(&self.map(i));
            let reach = DVec3::splat(gap * self.thickness[i] / 2.0);
            (lo - reach, hi + reach)
        };
        Neighbourhood::new((0..self.bodies.len()).map(reached).collect())
    }

    fn of(&self, i: usize) -> &Surface {
        self.surfaces[self.bodies[i].0].as_ref().expect("it is used")
    }

    fn map(&self, i: usize) -> DAffine3 {
        let (_, scale, pose) = self.bodies[i];
        let at = pose.translation - DVec3::Y * self.lowered[i];
        DAffine3::from_scale_rotation_translation(DVec3::splat(scale), pose.rotation, at)
    }

    /// In the frame of the first one: the other's place, and the thickness of the thinner one.
    fn between(&self, pair: [usize; 2]) -> (DAffine3, f64) {
        let [to_world, placed] = pair.map(|i| self.map(i));
        let unit = self.thickness[pair[0]].min(self.thickness[pair[1]]) / self.bodies[pair[0]].1;
        (to_world.inverse() * placed, unit)
    }

    /// The bodies that no chain of neighbours joins to one that is carried: each of a chain is no farther from the next
    /// one than `gap` of the thinner one's thickness, mesh from mesh. Ascending.
    pub fn hanging(&self, gap: f64, is_carried: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut joined: Vec<bool> = (0..self.bodies.len()).map(is_carried).collect();
        let front: Vec<usize> = (0..joined.len()).filter(|&i| joined[i]).collect();
        self.join(&self.neighbourhood(gap), gap, front, &mut joined);
        (0..joined.len()).filter(|&i| !joined[i]).collect()
    }

    /// Follows chains of neighbours from these bodies through all that are not joined yet, and returns those found.
    fn join(&self, near: &Neighbourhood, gap: f64, mut front: Vec<usize>, joined: &mut [bool]) -> Vec<usize> {
        let mut found = Vec::new();
        while let Some(i) = front.pop() {
            for j in near.of(i) {
                let pair = [i.min(j), i.max(j)];
                let meet = || {
                    let ((between, unit), [one, other]) = (self.between(pair), pair.map(|i| self.of(i)));
                    one.distance(other, &between, gap * unit).is_some()
                };
                if !joined[j] && meet() {
                    joined[j] = true;
                    front.push(j);
                    found.push(j);
                }
            }
        }
        found
    }

    /// These bodies in groups, each joined by such chains within it; the lowest group first.
    pub fn groups(&self, bodies: &[usize], gap: f64) -> Vec<Vec<usize>> {
        let near = self.neighbourhood(gap);
        let mut joined = vec![true; self.bodies.len()];
        bodies.iter().for_each(|&i| joined[i] = false);
        let mut groups = Vec::new();
        for &first in bodies {
            if !std::mem::replace(&mut joined[first], true) {
                let mut group = vec![first];
                group.extend(self.join(&near, gap, vec![first], &mut joined));
                groups.push(group);
            }
        }
        let low = |group: &Vec<usize>| group.iter().map(|&i| self.lowest(i)).fold(f64::INFINITY, f64::min);
        groups.sort_by(|a, b| low(a).total_cmp(&low(b)));
        groups
    }

    /// How far down a group can go as a whole until it meets another body, mesh from mesh no farther than `gap` of the
    /// thinner one's thickness, or the ground at this height, m; `None`: farther than `farthest`, m. It meets nothing
    /// on its way: each step is as long as the shortest distance (conservative advancement, Mirtich 1996).
    pub fn way_down(&self, group: &[usize], gap: f64, ground: Option<f64>, farthest: f64) -> Option<f64> {
        let is_in = |i: usize| group.contains(&i);
        let reached = |i: usize| {
            let (lo, hi) = self.of(i).bounds(&self.map(i));
            let reach = DVec3::splat(gap * self.thickness[i]);
            (if is_in(i) { lo - DVec3::Y * farthest } else { lo } - reach, hi + reach)
        };
        let near = Neighbourhood::new((0..self.bodies.len()).map(reached).collect());
        let others = |i: usize| near.of(i).into_iter().filter(|&j| !is_in(j)).map(move |j| [i, j]);
        let pairs: Vec<[usize; 2]> = group.iter().flat_map(|&i| others(i)).collect();
        let low = group.iter().map(|&i| (self.lowest(i), self.thickness[i]));
        let low = low.reduce(|a, b| if b.0 < a.0 { b } else { a })?;
        let mut down = 0.0;
        while down < farthest {
            let mut step = farthest - down;
            if let Some(ground) = ground {
                let left = low.0 - down - ground;
                if left <= gap * low.1 {
                    return Some(down);
                }
                step = step.min(left);
            }
            for &pair in &pairs {
                let ((mut between, unit), scale) = (self.between(pair), self.bodies[pair[0]].1);
                // The other one rises as the group goes down.
                let own = self.map(pair[0]).inverse();
                between.translation += own.transform_vector3(DVec3::Y * down);
                let [one, other] = pair.map(|i| self.of(i));
                let Some(left) = one.distance(other, &between, (step / scale).max(gap * unit)) else { continue };
                if left <= gap * unit {
                    return Some(down);
                }
                step = step.min(left * scale);
            }
            down += step;
        }
        None
    }

    /// Lowers a group, m.
    pub fn lower(&mut self, group: &[usize], by: f64) {
        group.iter().for_each(|&i| self.lowered[i] += by);
        self.near = self.neighbourhood(REAL_CONTACT);
    }

    /// By how much each body was lowered, m.
    pub fn lowered(&self) -> &[f64] {
        &self.lowered
    }

    /// The height of a body's lowest point.
    pub fn lowest(&self, i: usize) -> f64 {
        self.of(i).lowest(&self.map(i))
    }

    /// `touching`: pairs, the lower index first, whose collision shapes touch. `all`: every body is looked at; else at
    /// most [`LOOKED_AT`].
    pub fn visible(&self, touching: &BTreeSet<[usize; 2]>, all: bool) -> Visible {
        let count = self.bodies.len();
        let stride = if all { 1 } else { count.div_ceil(LOOKED_AT).max(1) };
        let is_looked_at = |i: usize| i.is_multiple_of(stride);
        // A pair of two that are looked at is found by the earlier one.
        let neighbours = |i: usize| self.near.of(i).into_iter().filter(move |&j| j > i || !is_looked_at(j));
        let pair = |i: usize, j: usize| {
            let pair = [i.min(j), i.max(j)];
            let ((between, own_unit), [one, other]) = (self.between(pair), pair.map(|i| self.of(i)));
            let unit = own_unit * self.bodies[pair[0]].1;
            let depth = one.overlap(other, &between).map(|found| found.depth / own_unit);
            let reach = if touching.contains(&pair) { FARTHEST } else { REAL_CONTACT };
            let gap = match depth {
                Some(_) => Some(0.0),
                None => one.distance(other, &between, reach * own_unit).map(|gap| gap / own_unit),
            };
            Neighbours { bodies: pair, unit, depth, gap }
        };
        let looked_at: Vec<usize> = (0..count).filter(|&i| is_looked_at(i)).collect();
        let found: Vec<Vec<Neighbours>> =
            looked_at.par_iter().map(|&i| neighbours(i).map(|j| pair(i, j)).collect()).collect();
        let found: Vec<Neighbours> = found.into_iter().flatten().collect();
        let cut: BTreeSet<usize> = found.iter().filter(|n| n.depth.is_some()).flat_map(|n| n.bodies).collect();
        let cut = cut.into_iter().filter(|&i| is_looked_at(i)).count();
        let near = || found.iter().filter(|n| n.gap.is_some_and(|gap| gap <= REAL_CONTACT));
        let depths: Vec<f64> = near().map(|n| n.depth.unwrap_or(0.0)).collect();
        let lengths: Vec<f64> = near().map(|n| n.depth.unwrap_or(0.0) * n.unit).collect();
        let touch = || found.iter().filter(|n| touching.contains(&n.bodies));
        let gaps: Vec<f64> = touch().map(|n| n.gap.unwrap_or(FARTHEST)).collect();
        let wide: Vec<f64> = touch().map(|n| n.gap.unwrap_or(FARTHEST) * n.unit).collect();
        Visible {
            cut_share: cut as f64 / looked_at.len().max(1) as f64,
            // The sum of nothing is a zero below zero.
            depth_mean: (0.0 + depths.iter().sum::<f64>()) / depths.len().max(1) as f64,
            depth_p95: percentile(&depths, 0.95),
            depth_max: depths.iter().copied().fold(0.0, f64::max),
            gap_p95: (!gaps.is_empty()).then(|| percentile(&gaps, 0.95)),
            depth_p95_length: percentile(&lengths, 0.95),
            gap_p95_length: (!wide.is_empty()).then(|| percentile(&wide, 0.95)),
            pairs: found.len() as u64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ROUNDING;

    fn cube() -> TriMesh {
        let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) - 0.5;
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        TriMesh { points: (0..8).map(corner).collect(), triangles }
    }

    /// A row of cubes of this size, whose neighbours are these shares of it apart, or overlap.
    fn row(size: f64, gaps: &[f64]) -> Vec<(usize, f64, Pose)> {
        let mut at = 0.0;
        let mut bodies = vec![(0, size, Pose::IDENTITY)];
        for gap in gaps {
            at += size * (1.0 + gap);
            // Not quite level: the meshes cross along lines, not in planes.
            let translation = DVec3::new(at, 0.1 * size * (bodies.len() % 2) as f64, 0.0);
            bodies.push((0, size, Pose { translation, ..Pose::IDENTITY }));
        }
        bodies
    }

    #[test]
    fn cuts_and_gaps_are_in_thicknesses() {
        let cube = cube();
        let bodies = row(0.2, &[-0.02, 0.01, 0.3, 0.03]);
        let touching = BTreeSet::from([[0, 1], [1, 2], [3, 4]]);
        let seen = Sight::new(&[&cube], &bodies, &[0.2; 5]).visible(&touching, true);
        assert!((seen.cut_share - 0.4).abs() < ROUNDING, "{seen:?}");
        // Of three pairs that are near, one cuts.
        assert!((seen.depth_max - 0.02).abs() < 1e-6 && (seen.depth_mean - 0.02 / 3.0).abs() < 1e-6, "{seen:?}");
        assert!((seen.depth_p95_length - 0.2 * seen.depth_p95).abs() < ROUNDING);
        let gap = seen.gap_p95.expect("three pairs touch");
        assert!((gap - (0.01 + 0.9 * 0.02)).abs() < 1e-6, "{gap}");
        assert!((seen.gap_p95_length.expect("they touch") - 0.2 * gap).abs() < ROUNDING);
        assert_eq!(Sight::new(&[&cube], &bodies, &[0.2; 5]).visible(&BTreeSet::new(), true).gap_p95, None);
    }

    #[test]
    fn a_sample_of_a_large_pile_is_looked_at() {
        let cube = cube();
        // Every second pair cuts: so does every body.
        let gaps: Vec<f64> = (0..999).map(|k| if k % 2 == 0 { -0.01 } else { 0.01 }).collect();
        let bodies = row(1.0, &gaps);
        let thickness = [1.0; 1000];
        let sight = Sight::new(&[&cube], &bodies, &thickness);
        let [all, some] = [true, false].map(|all| sight.visible(&BTreeSet::new(), all));
        assert!(all.pairs == 999 && some.pairs < 2 * 100 + 1, "{} and {}", all.pairs, some.pairs);
        assert!(all.cut_share == 1.0 && some.cut_share == 1.0);
        assert!((all.depth_mean - 0.005).abs() < 1e-4 && (some.depth_mean - 0.005).abs() < 1e-4);
    }

    #[test]
    fn what_hangs_has_no_chain_of_neighbours() {
        let cube = cube();
        // Gaps beyond a twentieth part the row; what cuts touches, too.
        let bodies = row(0.2, &[0.04, -0.01, 0.06, 0.01]);
        let sight = Sight::new(&[&cube], &bodies, &[0.2; 5]);
        assert_eq!(sight.hanging(REAL_CONTACT, |i| i == 0), [3, 4]);
        assert_eq!(sight.hanging(0.07, |i| i == 0), []);
        assert_eq!(sight.hanging(REAL_CONTACT, |i| i == 4), [0, 1, 2]);
        assert_eq!(sight.hanging(REAL_CONTACT, |_| false), [0, 1, 2, 3, 4]);
        assert!((sight.lowest(0) + 0.1).abs() < ROUNDING && (sight.lowest(1) + 0.08).abs() < ROUNDING);
    }

    #[test]
    fn a_group_comes_down_until_it_meets_something() {
        let cube = cube();
        let at = |x: f64, y: f64| (0, 0.2, Pose { translation: DVec3::new(x, y, 0.0), ..Pose::IDENTITY });
        // Two cubes side by side over a third one, a gap of 0.05 below them, and one that is far from all.
        let bodies = [at(0.0, 0.0), at(0.05, 0.25), at(0.252, 0.25), at(3.0, 1.0)];
        let mut sight = Sight::new(&[&cube], &bodies, &[0.2; 4]);
        let hanging = sight.hanging(REAL_CONTACT, |i| i == 0);
        assert_eq!(hanging, [1, 2, 3]);
        let groups = sight.groups(&hanging, REAL_CONTACT);
        assert_eq!(groups, [vec![1, 2], vec![3]], "the lowest first");
        let down = sight.way_down(&groups[0], 0.01, Some(-0.1), 0.1).expect("it meets the third cube");
        assert!((0.048 - ROUNDING..=0.05).contains(&down), "{down}");
        assert_eq!(sight.way_down(&groups[0], 0.01, Some(-0.1), 0.04), None, "it may not go so far");
        assert_eq!(sight.way_down(&groups[1], 0.01, None, 0.5), None, "nothing is below");
        let to_ground = sight.way_down(&groups[1], 0.01, Some(0.7), 0.5).expect("the ground is below");
        assert!((0.198 - ROUNDING..=0.2 + ROUNDING).contains(&to_ground), "{to_ground}");
        sight.lower(&groups[0], down);
        assert_eq!(sight.hanging(REAL_CONTACT, |i| i == 0), [3]);
        assert_eq!(sight.lowered(), [0.0, down, down, 0.0]);
    }
}
