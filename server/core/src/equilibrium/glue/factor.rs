//! Balance as a linear system: for given weights of the unknowns, M = A D A^T in blocks of 6 x 6, one row of blocks per body, and
//! its solution by conjugate gradients, preconditioned by an incomplete Cholesky factorisation without fill.

use super::program::Program;
use nalgebra::{Matrix6, SMatrix, Vector6};

/// How much the unknowns may move: squares of a scale.
pub struct Mobility {
    /// Shape `[contact]`.
    pub contacts: Vec<f64>,
    /// Shape `[touch]`; 0 where there is no dot.
    pub dots: Vec<f64>,
    /// Of what may be missing.
    pub missing: f64,
}

/// The matrix, and its incomplete factor.
pub struct Factor {
    /// Shape `[body]`.
    diagonal: Vec<Matrix6<f64>>,
    /// Per body, the bodies beside it and their blocks (row: this body), by body.
    beside: Vec<Vec<(usize, Matrix6<f64>)>>,
    order: Vec<usize>,
    /// Per place in the order: earlier places and the factor's blocks, rising.
    lower: Vec<Vec<(usize, Matrix6<f64>)>>,
    /// Inverse of the factor's diagonal blocks.
    inverse: Vec<Matrix6<f64>>,
}

/// The diagonal of the matrix that is factorised is this much larger, at first.
const SHIFT: f64 = 1.05;
/// Beyond it, the matrix is not one.
const MOST_SHIFT: f64 = 1e9;
/// A body whose forces span less than all six directions moves a little in the others.
const LEAST: f64 = 1e-9;

impl Factor {
    pub fn new(program: &Program, mobility: &Mobility) -> Factor {
        let count = program.target.len();
        let mut diagonal = vec![Matrix6::identity() * mobility.missing; count];
        let mut beside: Vec<Vec<(usize, Matrix6<f64>)>> = vec![Vec::new(); count];
        for (touch, &dot) in program.touches.iter().zip(&mobility.dots) {
            let product = |a: &super::program::Side, b: &super::program::Side| {
                let mut block = a.dot * b.dot.transpose() * dot;
                let contacts = a.contacts.iter().zip(&b.contacts).zip(&mobility.contacts[touch.first..]);
                contacts.for_each(|((a, b), &m)| block += a * b.transpose() * m);
                block
            };
            for side in &touch.sides {
                diagonal[side.body] += product(side, side);
            }
            if let [a, b] = &touch.sides[..] {
                let block = product(a, b);
                add(&mut beside[a.body], b.body, block);
                add(&mut beside[b.body], a.body, block.transpose());
            }
        }
        for block in &mut diagonal {
            let trace = block.trace();
            *block += Matrix6::identity() * if trace > 0.0 { LEAST * trace } else { 1.0 };
        }
        beside.iter_mut().for_each(|row| row.sort_by_key(|(other, _)| *other));
        let mut factor =
            Factor { diagonal, beside, order: program.order.clone(), lower: Vec::new(), inverse: Vec::new() };
        let mut shift = SHIFT;
        while !factor.factorise(shift) {
            shift *= 1.5;
            if shift > MOST_SHIFT {
                // Numbers beyond their range: nothing moves.
                factor.lower = vec![Vec::new(); count];
                factor.inverse = vec![Matrix6::zeros(); count];
                break;
            }
        }
        factor
    }

    /// False where a block of the diagonal is not positive definite.
    fn factorise(&mut self, shift: f64) -> bool {
        let count = self.order.len();
        let mut place = vec![0; count];
        self.order.iter().enumerate().for_each(|(k, &body)| place[body] = k);
        self.lower = Vec::with_capacity(count);
        self.inverse = Vec::with_capacity(count);
        for (i, &body) in self.order.iter().enumerate() {
            let earlier = self.beside[body].iter().map(|(other, block)| (place[*other], *block));
            let mut row: Vec<(usize, Matrix6<f64>)> = earlier.filter(|(j, _)| *j < i).collect();
            row.sort_by_key(|(j, _)| *j);
            for at in 0..row.len() {
                let (before, rest) = row.split_at_mut(at);
                let (j, block) = &mut rest[0];
                // M_ij less the products of what both rows have.
                let mut other = self.lower[*j].iter().peekable();
                for (k, left) in before.iter() {
                    while other.next_if(|(m, _)| m < k).is_some() {}
                    if let Some((_, right)) = other.next_if(|(m, _)| m == k) {
                        *block -= left * right.transpose();
                    }
                }
                *block *= self.inverse[*j].transpose();
            }
            let mut pivot = self.diagonal[body] * shift;
            row.iter().for_each(|(_, block)| pivot -= block * block.transpose());
            let Some(inverse) = pivot.cholesky().and_then(|cholesky| cholesky.l().try_inverse()) else { return false };
            self.inverse.push(inverse);
            self.lower.push(row);
        }
        true
    }

    fn times(&self, x: &[Vector6<f64>], y: &mut [Vector6<f64>]) {
        for (body, y) in y.iter_mut().enumerate() {
            *y = self.diagonal[body] * x[body];
            for (other, block) in &self.beside[body] {
                *y += block * x[*other];
            }
        }
    }

    /// Solves with the incomplete factor.
    fn precondition(&self, r: &[Vector6<f64>], z: &mut [Vector6<f64>]) {
        for (i, &body) in self.order.iter().enumerate() {
            let mut rest = r[body];
            self.lower[i].iter().for_each(|(j, block)| rest -= block * z[self.order[*j]]);
            z[body] = self.inverse[i] * rest;
        }
        for (i, &body) in self.order.iter().enumerate().rev() {
            let solved = self.inverse[i].transpose() * z[body];
            z[body] = solved;
            self.lower[i].iter().for_each(|(j, block)| z[self.order[*j]] -= block.tr_mul(&solved));
        }
    }

    /// Solves M x = r from the guess `x`, to `tolerance` of the residual that it leaves or in `most` iterations.
    pub fn solve(&self, r: &[Vector6<f64>], x: &mut [Vector6<f64>], tolerance: f64, most: usize, work: &mut Work) {
        let Work { residual, direction, image, z } = work;
        [&mut *residual, direction, image, z].into_iter().for_each(|v| v.resize(r.len(), Vector6::zeros()));
        self.times(x, image);
        residual.iter_mut().zip(r).zip(&*image).for_each(|((rest, r), y)| *rest = r - y);
        let begin = dot(residual, residual);
        self.precondition(residual, z);
        direction.clone_from(z);
        let mut along = dot(residual, z);
        for _ in 0..most {
            let is_done = along <= 0.0 || dot(residual, residual) <= tolerance * tolerance * begin;
            if is_done || !along.is_finite() {
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
            self.precondition(residual, z);
            let next = dot(residual, z);
            let turn = next / along;
            along = next;
            direction.iter_mut().zip(&*z).for_each(|(d, z)| *d = z + *d * turn);
        }
    }
}

/// Scratch memory of [`Factor::solve`].
#[derive(Default)]
pub struct Work {
    residual: Vec<Vector6<f64>>,
    direction: Vec<Vector6<f64>>,
    image: Vec<Vector6<f64>>,
    z: Vec<Vector6<f64>>,
}

fn dot(a: &[Vector6<f64>], b: &[Vector6<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn add(row: &mut Vec<(usize, SMatrix<f64, 6, 6>)>, other: usize, block: Matrix6<f64>) {
    match row.iter_mut().find(|(o, _)| *o == other) {
        Some((_, sum)) => *sum += block,
        None => row.push((other, block)),
    }
}
