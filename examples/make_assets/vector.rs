//! Points and directions.

pub type Point = [f64; 3];

pub fn sum(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub fn mean(points: &[Point]) -> Point {
    points.iter().copied().fold([0.0; 3], sum).map(|x| x / points.len() as f64)
}

pub fn unit(v: Point) -> Point {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

/// Twice a triangle's area, along its outward normal.
pub fn area([a, b, c]: [Point; 3]) -> Point {
    let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}
