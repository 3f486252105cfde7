//! Balance as a linear system: for given weights of the unknowns, M = A D A^T in blocks of 6 x 6, one row of blocks per
//! body, and its solution by conjugate gradients, preconditioned by an incomplete Cholesky factorisation without
//! fill-in.

use super::program::GlueProgram;
use nalgebra::{Matrix6, Vector6};
use std::collections::BTreeMap;

/// Mobility of the unknowns: squares of a scale.
pub struct Mobility {
    /// Shape `[contact]`.
    pub contacts: Vec<f64>,
    /// Shape `[site]`; 0 where there is no joint.
    pub joints: Vec<f64>,
    /// Of the bodies' missing support.
    pub missing: f64,
}

/// The matrix, and its incomplete factor.
pub struct Factor {
    /// Shape `[body]`.
    diagonal: Vec<Matrix6<f64>>,
    /// Pairs of adjacent bodies, the earlier in the order first, and the block at its row and the other's column.
    beside: Vec<((usize, usize), Matrix6<f64>)>,
    order: Vec<usize>,
    /// Per place in the order: the end of its row among the blocks.
    row_ends: Vec<usize>,
    /// The factor's blocks off its diagonal: a body earlier in the order, ascending by place, and the block.
    lower: Vec<(usize, Matrix6<f32>)>,
    /// Inverse of the factor's diagonal blocks, per place in the order.
    inverse: Vec<Matrix6<f32>>,
}

/// The factorised matrix's diagonal is enlarged by this factor, at first.
const SHIFT: f64 = 1.05;
/// Relative accuracy of an answer that no later iteration corrects: of a residual, of a total.
pub const ACCURATE: f64 = 1e-3;
/// Regularisation of a body whose forces span fewer than six directions, as a share of its block's trace.
const LEAST: f64 = 1e-9;

impl Factor {
    pub fn new(program: &GlueProgram, mobility: &Mobility) -> Factor {
        let count = program.target.len();
        let mut diagonal = vec![Matrix6::identity() * mobility.missing; count];
        let place = places(&program.order);
        let mut beside: BTreeMap<(usize, usize), Matrix6<f64>> = BTreeMap::new();
        for (site, &joint) in program.sites.iter().zip(&mobility.joints) {
            let product = |a: usize, b: usize| {
                let mut block = site.ends()[a].joint_lever() * site.ends()[b].joint_lever().transpose() * joint;
                for at in site.contacts.clone() {
                    block +=
                        program.lever(site, a, at) * program.lever(site, b, at).transpose() * mobility.contacts[at];
                }
                block
            };
            for (number, end) in site.ends().iter().enumerate() {
                diagonal[end.body] += product(number, number);
            }
            if let [a, b] = site.ends() {
                let (a, b) = (place[a.body], place[b.body]);
                let block = if a < b { product(0, 1) } else { product(1, 0) };
                *beside.entry((a.min(b), a.max(b))).or_default() += block;
            }
        }
        for block in &mut diagonal {
            let trace = block.trace();
            *block += Matrix6::identity() * if trace > 0.0 { LEAST * trace } else { 1.0 };
        }
        let body = |(a, b): (usize, usize)| (program.order[a], program.order[b]);
        let mut factor = Factor {
            diagonal,
            beside: beside.iter().map(|(&pair, block)| (body(pair), *block)).collect(),
            order: program.order.clone(),
            row_ends: Vec::new(),
            lower: Vec::new(),
            inverse: Vec::new(),
        };
        let mut rows: Vec<Vec<(usize, Matrix6<f64>)>> = vec![Vec::new(); count];
        beside.iter().for_each(|(&(a, b), block)| rows[b].push((a, block.transpose())));
        let mut shift = SHIFT;
        while !factor.factorise(rows.clone(), shift) {
            shift *= 1.5;
            // Beyond this factor, the diagonal outweighs all else, unless entries are not numbers: then nothing moves.
            if shift > 1.0 / LEAST {
                factor.row_ends = vec![0; count];
                factor.lower = Vec::new();
                factor.inverse = vec![Matrix6::zeros(); count];
                break;
            }
        }
        factor
    }

    /// `rows`: per place in the order, earlier places and the matrix's blocks, ascending. False where a block of the
    /// diagonal is not positive definite.
    fn factorise(&mut self, mut rows: Vec<Vec<(usize, Matrix6<f64>)>>, shift: f64) -> bool {
        let mut inverses: Vec<Matrix6<f64>> = Vec::with_capacity(rows.len());
        for i in 0..rows.len() {
            let (done, rest) = rows.split_at_mut(i);
            let row = &mut rest[0];
            for at in 0..row.len() {
                let (before, rest) = row.split_at_mut(at);
                let (j, block) = &mut rest[0];
                // M_ij less the products of the blocks that both rows have.
                let mut other = done[*j].iter().peekable();
                for (k, left) in before.iter() {
                    while other.next_if(|(m, _)| m < k).is_some() {}
                    if let Some((_, right)) = other.next_if(|(m, _)| m == k) {
                        *block -= left * right.transpose();
                    }
                }
                *block *= inverses[*j].transpose();
            }
            let mut pivot = self.diagonal[self.order[i]] * shift;
            row.iter().for_each(|(_, block)| pivot -= *block * block.transpose());
            let Some(inverse) = pivot.cholesky().and_then(|cholesky| cholesky.l().try_inverse()) else { return false };
            inverses.push(inverse);
        }
        self.row_ends = rows
            .iter()
            .scan(0, |end, row| {
                *end += row.len();
                Some(*end)
            })
            .collect();
        self.lower = rows.iter().flatten().map(|(j, block)| (self.order[*j], block.cast())).collect();
        self.inverse = inverses.iter().map(|inverse| inverse.cast()).collect();
        true
    }

    fn times(&self, x: &[Vector6<f64>], y: &mut [Vector6<f64>]) {
        y.iter_mut().zip(x.iter().zip(&self.diagonal)).for_each(|(y, (x, block))| *y = block * x);
        for ((a, b), block) in &self.beside {
            y[*a] += block * x[*b];
            y[*b] += block.tr_mul(&x[*a]);
        }
    }

    /// Solves with the incomplete factor. Shape of `z`: `[body]`.
    fn precondition(&self, r: &[Vector6<f64>], z: &mut [Vector6<f32>]) {
        let mut begin = 0;
        for (i, &body) in self.order.iter().enumerate() {
            let mut rest: Vector6<f32> = r[body].cast();
            self.lower[begin..self.row_ends[i]].iter().for_each(|(other, block)| rest -= block * z[*other]);
            z[body] = self.inverse[i] * rest;
            begin = self.row_ends[i];
        }
        for (i, &body) in self.order.iter().enumerate().rev() {
            let solved = self.inverse[i].tr_mul(&z[body]);
            z[body] = solved;
            let begin = if i > 0 { self.row_ends[i - 1] } else { 0 };
            self.lower[begin..self.row_ends[i]].iter().for_each(|(other, block)| z[*other] -= block.tr_mul(&solved));
        }
    }

    /// Solves M x = r from the guess `x`, to `tolerance` of the residual that it leaves or in `most` iterations.
    pub fn solve(&self, r: &[Vector6<f64>], x: &mut [Vector6<f64>], tolerance: f64, most: usize, work: &mut Workspace) {
        let Workspace { residual, direction, image, z } = work;
        [&mut *residual, direction, image].into_iter().for_each(|v| v.resize(r.len(), Vector6::zeros()));
        z.resize(r.len(), Vector6::zeros());
        self.times(x, image);
        residual.iter_mut().zip(r).zip(&*image).for_each(|((rest, r), y)| *rest = r - y);
        let begin = dot(residual, residual);
        self.precondition(residual, z);
        direction.iter_mut().zip(&*z).for_each(|(d, z)| *d = z.cast());
        let mut along = dot(residual, direction);
        let is_near = |residual: &[Vector6<f64>]| dot(residual, residual) <= tolerance * tolerance * begin;
        for number in 1..=most {
            if along <= 0.0 || !along.is_finite() {
                break;
            }
            self.times(direction, image);
            let curvature = dot(direction, image);
            if curvature <= 0.0 {
                break;
            }
            let step = along / curvature;
            for ((x, rest), (d, y)) in x.iter_mut().zip(residual.iter_mut()).zip(direction.iter().zip(&*image)) {
                *x += d * step;
                *rest -= y * step;
            }
            if number == most || is_near(residual) {
                break;
            }
            self.precondition(residual, z);
            let next = residual.iter().zip(&*z).map(|(r, z)| r.dot(&z.cast())).sum::<f64>();
            let turn = next / along;
            along = next;
            direction.iter_mut().zip(&*z).for_each(|(d, z)| *d = z.cast() + *d * turn);
        }
    }
}

/// Scratch memory of [`Factor::solve`].
#[derive(Default)]
pub struct Workspace {
    residual: Vec<Vector6<f64>>,
    direction: Vec<Vector6<f64>>,
    image: Vec<Vector6<f64>>,
    z: Vec<Vector6<f32>>,
}

fn dot(a: &[Vector6<f64>], b: &[Vector6<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

/// The place of each body in an order.
fn places(order: &[usize]) -> Vec<usize> {
    let mut places = vec![0; order.len()];
    order.iter().enumerate().for_each(|(place, &body)| places[body] = place);
    places
}
