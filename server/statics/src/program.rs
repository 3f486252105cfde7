//! What the cone programs share: a sparse matrix in the making, and what a solver's forces count for.

/// An interior point may end a rounding outside its cone, and a breakdown anywhere: then the contact counts as
/// unloaded.
pub(crate) fn clip(f: &[f64], mu: f64) -> [f64; 3] {
    if !f.iter().all(|x| x.is_finite()) {
        return [0.0; 3];
    }
    let normal = f[0].max(0.0);
    let tangential = libm::hypot(f[1], f[2]);
    let keep = if tangential > mu * normal { mu * normal / tangential } else { 1.0 };
    [normal, keep * f[1], keep * f[2]]
}

/// A sparse matrix in the making.
#[derive(Default)]
pub(crate) struct Triplets {
    pub rows: Vec<usize>,
    pub columns: Vec<usize>,
    pub values: Vec<f64>,
    pub height: usize,
}

impl Triplets {
    pub fn push(&mut self, row: usize, column: usize, value: f64) {
        self.rows.push(row);
        self.columns.push(column);
        self.values.push(value);
    }
}
