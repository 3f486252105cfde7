//! A tree of boxes over numbered things: triangles, bodies. It has no idea of what is in the boxes.
//!
//! Each node's things are split at the median of their centres along the longest axis, so that a tree of n things is
//! log2(n) deep, and equal input gives an equal tree.

use super::mesh::bounds;
use glam::DVec3;

/// Deep enough for the median split of 2^32 things, with two entries per level.
pub(super) const STACK: usize = 80;
/// Things in a leaf. Fewer make the tree deeper, more raise the price of a visit to a leaf.
const LEAF: usize = 4;

/// The tree. Lengths are in the unit of the boxes.
pub(super) struct BoxTree {
    pub nodes: Vec<Node>,
    /// Shape `[n]`: the name of the thing at each place of the tree's order.
    pub order: Vec<u32>,
}

pub(super) struct Node {
    pub lo: DVec3,
    pub hi: DVec3,
    /// Leaf: the place of its first thing. Inner node: its right child; the left one is the next node.
    pub first: u32,
    /// Things of a leaf, 0 for an inner node.
    pub count: u32,
}

/// What can be put into a tree.
pub trait Boxed {
    fn name(&self) -> u32;

    /// Lowest and highest corner.
    fn bounds(&self) -> (DVec3, DVec3);

    /// Decides on which side of a split it is.
    fn centre(&self) -> DVec3 {
        let (lo, hi) = self.bounds();
        (lo + hi) / 2.0
    }
}

impl BoxTree {
    /// Puts the things into the order of the tree.
    pub fn new(things: &mut [impl Boxed]) -> BoxTree {
        let mut nodes = Vec::with_capacity(things.len());
        if !things.is_empty() {
            split(&mut nodes, things, 0);
        }
        BoxTree { nodes, order: things.iter().map(Boxed::name).collect() }
    }
}

/// Appends the tree of `things`, whose first one has place `first`, and returns its root.
fn split(nodes: &mut Vec<Node>, things: &mut [impl Boxed], first: usize) -> usize {
    let count = things.len();
    let (lo, hi) = bounds(things.iter().map(Boxed::bounds).flat_map(|(lo, hi)| [lo, hi]));
    let at = nodes.len();
    if count <= LEAF {
        nodes.push(Node { lo, hi, first: first as u32, count: count as u32 });
        return at;
    }
    let (low, high) = bounds(things.iter().map(Boxed::centre));
    let axis = (high - low).max_position();
    let half = count / 2;
    // The name breaks ties.
    things.select_nth_unstable_by(half, |a, b| {
        a.centre()[axis].total_cmp(&b.centre()[axis]).then(a.name().cmp(&b.name()))
    });
    nodes.push(Node { lo, hi, first: 0, count: 0 });
    let (left, right) = things.split_at_mut(half);
    split(nodes, left, first);
    nodes[at].first = split(nodes, right, first + half) as u32;
    at
}
