//! How props get into the container. A fill method is one file here, a line in [`of`], and its [`FillMethod::traits`].

mod insert;
mod off;
mod pour;
mod stack;

pub use insert::grow_at;

use super::filling::Filling;
use super::zones::Zones;
use cairn_input::error::Error;
use cairn_input::observer::Observer;
use cairn_input::params::FillMethod;
use glam::DVec3;
use rand::Rng;

/// One pass of a fill: which props come, where they may go, and when it is enough.
pub struct Pass<'p> {
    /// The props that are drawn.
    pub props: &'p [usize],
    /// `None`: every prop may be everywhere.
    pub zones: Option<&'p Zones>,
    /// Number of loose bodies in the world at which the pass ends.
    pub limit: usize,
}

impl Pass<'_> {
    /// Whether this prop may be here, engine units.
    pub fn allows(&self, prop: usize, p: DVec3, rng: &mut impl Rng) -> bool {
        self.zones.is_none_or(|zones| zones.allows(prop, p, rng))
    }
}

/// A fill method. The fill asks [`Method::gravity`] and [`Method::is_open`] once, and calls [`Method::run`]: once where
/// the container is open, else for each pass, and again where the clean-up took too many bodies.
pub trait Method {
    /// Gravity of the fill as a share of the scene's, in a container of this height, d.
    fn gravity(&self, _height: f64) -> f64 {
        1.0
    }

    /// Whether the container is open while it is filled. Then the method adds the container itself.
    fn is_open(&self) -> bool {
        false
    }

    /// Adds bodies. Returns whether the container is full; if not, the pass has reached its limit.
    fn run(&mut self, filling: &mut Filling, pass: &Pass, observer: &mut dyn Observer) -> Result<bool, Error>;
}

/// The method that the parameters ask for.
pub fn of(method: FillMethod) -> Box<dyn Method> {
    match method {
        FillMethod::Insert => Box::new(insert::Insert),
        FillMethod::Pour => Box::new(pour::Pour),
        FillMethod::Stack => Box::new(stack::Stack),
        FillMethod::Off => Box::new(off::Off),
    }
}
