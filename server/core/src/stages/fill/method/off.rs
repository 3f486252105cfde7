//! No fill at all: the container stays empty.

use super::{Method, Pass};
use crate::error::Error;
use crate::input::observer::Observer;
use crate::stages::fill::filling::Filling;

pub struct Off;

impl Method for Off {
    fn run(&mut self, _: &mut Filling, _: &Pass, _: &mut dyn Observer) -> Result<bool, Error> {
        Ok(true)
    }
}
