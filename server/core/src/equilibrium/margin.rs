use super::projection::Projection;
use super::scaled::Scaled;
pub(super) fn of(_s: &Scaled, _p: &mut Projection) -> f64 {
    0.0
}
