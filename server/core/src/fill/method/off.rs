//! No fill at all: the container stays empty.

use super::{Method, Pass};
use crate::fill::filling::Filling;
use cairn_input::error::Error;
use cairn_input::observer::Observer;

pub struct Off;

impl Method for Off {
    fn run(&mut self, _: &mut Filling, _: &Pass, _: &mut dyn Observer) -> Result<bool, Error> {
        Ok(true)
    }
}
